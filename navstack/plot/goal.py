"""The picture of goals over time: distance, velocity, states, plans, failures and recoveries."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from navstack.plot import canvas
from navstack.plot.goal_legends import add_legends
from navstack.plot.goal_panels import draw_distance, draw_lanes, draw_velocity, shade_states
from navstack.plot.goal_tracks import GoalTrack

_WIDTH, _HEIGHT = 10.0, 6.7
"""Size of the figure, inches."""
_PANELS = ((3.55, 2.35), (2.1, 1.2), (0.55, 1.3))
"""Bottom and height of the panels, inches."""


def plot_goals(
    tracks: Sequence[GoalTrack],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str,
    subtitle: str = "",
    dpi: float = 130.0,
) -> Any:
    """Draws goals on one time axis, to a .png, .svg or .pdf, into the axes `ax` (one, or three), or a new figure.

    Raises OutputError, and InputError for another number of axes. Returns the file; without a path the list of the axes of the
    three panels: distance, velocity, and states.
    """
    canvas.check_target(path, ax)
    begin, end = min(t.begin for t in tracks), max(t.end for t in tracks)
    slack = 0.015 * max(end - begin, 1.0)
    with canvas.style():
        if ax is not None:
            panels = canvas.stacked_axes(ax, [height for _, height in _PANELS])
            panels[0].set_title("\n".join(part for part in (title, subtitle) if part), fontsize=9.0)
            _draw(panels, tracks, (begin - slack, end + slack))
            add_legends(panels, tracks)
            return panels
        figure = canvas.figure_for(path, _WIDTH, _HEIGHT)
        left, right = 0.72 / _WIDTH, 7.75 / _WIDTH
        figure.text(left, 1.0 - 0.3 / _HEIGHT, title, fontsize=12, fontweight="bold", va="baseline")
        figure.text(left, 1.0 - 0.53 / _HEIGHT, subtitle, fontsize=8.5, color="#666666", va="baseline")
        panels = [figure.add_axes((left, b / _HEIGHT, right - left, h / _HEIGHT)) for b, h in _PANELS]
        _draw(panels, tracks, (begin - slack, end + slack))
        add_legends(panels, tracks, figure, (right * _WIDTH + 0.14) / _WIDTH)
        return canvas.finish(figure, panels, path, dpi)


def _draw(panels: Sequence[Any], tracks: Sequence[GoalTrack], limits: tuple[float, float]) -> None:
    """Draws the three panels, from top to bottom, with a common time axis."""
    for axes in panels:
        axes.set_xlim(*limits)
        axes.grid(axis="x", color="#E3E3E3", lw=0.6)
        axes.set_axisbelow(True)
    for axes in panels[:2]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time (s)")
    shade_states(panels[:2], tracks)
    draw_distance(panels[0], tracks)
    draw_velocity(panels[1], tracks)
    draw_lanes(panels[2], tracks)
