"""The picture of goals over time: distance, velocity, states, plans, failures and recoveries."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from navstack.plot import canvas
from navstack.plot.goal_legends import add_legends
from navstack.plot.goal_panels import draw_distance, draw_lanes, draw_velocity, shade_states
from navstack.plot.goal_tracks import GoalTrack

_WIDTH, _HEIGHT = 10.0, 6.7
"""Size of the figure, inches."""


def plot_goals(
    tracks: Sequence[GoalTrack],
    path: str | os.PathLike[str],
    *,
    title: str,
    subtitle: str = "",
    dpi: float = 130.0,
) -> Path:
    """Draws goals on one time axis, to a .png, .svg or .pdf. Raises OutputError. Returns the file."""
    out = Path(path)
    canvas.check_format(out)
    begin, end = min(t.begin for t in tracks), max(t.end for t in tracks)
    slack = 0.015 * max(end - begin, 1.0)
    with canvas.style():
        figure = canvas.new_figure(_WIDTH, _HEIGHT)
        left, right = 0.72 / _WIDTH, 7.75 / _WIDTH
        figure.text(left, 1.0 - 0.3 / _HEIGHT, title, fontsize=12, fontweight="bold", va="baseline")
        figure.text(left, 1.0 - 0.53 / _HEIGHT, subtitle, fontsize=8.5, color="#666666", va="baseline")
        panels = _panels(figure, left, right, (begin - slack, end + slack))
        shade_states(panels[:2], tracks)
        draw_distance(panels[0], tracks)
        draw_velocity(panels[1], tracks)
        draw_lanes(panels[2], tracks)
        add_legends(figure, panels, tracks, (right * _WIDTH + 0.14) / _WIDTH)
        return canvas.save(figure, out, dpi)


def _panels(figure: Any, left: float, right: float, limits: tuple[float, float]) -> list[Any]:
    """The axes of the three panels, from top to bottom, with a common time axis."""
    # bottom and height, inches
    panels = [
        figure.add_axes((left, bottom / _HEIGHT, right - left, high / _HEIGHT))
        for bottom, high in ((3.55, 2.35), (2.1, 1.2), (0.55, 1.3))
    ]
    for axes in panels:
        axes.set_xlim(*limits)
        axes.grid(axis="x", color="#E3E3E3", lw=0.6)
        axes.set_axisbelow(True)
    for axes in panels[:2]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time (s)")
    return panels
