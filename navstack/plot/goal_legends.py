"""The legends of the picture of goals over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from navstack.plot import colors
from navstack.plot.goal_panels import STATES
from navstack.plot.goal_tracks import GoalTrack

_SHOWN_NUMBERS = 8
"""Numbers of recoveries that an entry lists."""
_LONGEST_LABEL = 26
"""Longest text that fits beside the panels (characters)."""
Entries = list[tuple[Any, str]]


def add_legends(panels: Sequence[Any], tracks: Sequence[GoalTrack], figure: Any = None, x: float = 0.0) -> None:
    """Adds a legend beside each of the three panels, `x` its left edge as a share of the figure; inside without a figure."""
    for axes, entries in zip(panels, (_distance(tracks), _velocity(), _lanes(tracks)), strict=True):
        handles, labels = [handle for handle, _ in entries], [label for _, label in entries]
        if figure is None:
            axes.legend(handles, labels, loc="best", handlelength=1.8, fontsize=6)
            continue
        figure.legend(
            handles,
            labels,
            loc="upper left",
            bbox_to_anchor=(x, axes.get_position().y1),
            borderaxespad=0.0,
            handlelength=1.8,
            fontsize=8,
        )


def _distance(tracks: Sequence[GoalTrack]) -> Entries:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: Entries = [(Line2D([], [], color=colors.DRIVEN, lw=1.8), "straight line")]
    if any(np.isfinite(track.remaining).any() for track in tracks):
        entries.append((Line2D([], [], color=colors.PLAN, lw=1.6), "along the plan"))
    occurring = {bar.label for track in tracks for bar in track.states}
    return entries + [(Patch(facecolor=STATES[name], alpha=0.6), name) for name in STATES if name in occurring]


def _velocity() -> Entries:
    from matplotlib.lines import Line2D

    linear = Line2D([], [], color=colors.BLUE, lw=1.4)
    angular = Line2D([], [], color=colors.VERMILLION, lw=1.0, ls=(0, (4, 1.5)))
    return [(linear, "linear (m/s)"), (angular, "angular (rad/s)")]


def _lanes(tracks: Sequence[GoalTrack]) -> Entries:
    from matplotlib.lines import Line2D

    entries: Entries = []
    if any(len(track.plans) for track in tracks):
        entries.append((Line2D([], [], ls="none", marker="|", ms=9, mew=1.3, color=colors.BLUE), "plan found"))
    if any(len(track.failed_plans) or len(track.failed_commands) for track in tracks):
        entries.append((Line2D([], [], ls="none", marker="x", ms=4, mew=1.0, color=colors.VERMILLION), "failed"))
    return entries + _recoveries(tracks)


def _recoveries(tracks: Sequence[GoalTrack]) -> Entries:
    """One entry per behavior and outcome, with the numbers of its executions."""
    from matplotlib.patches import Patch

    entries: Entries = []
    recoveries = [bar for track in tracks for bar in track.recoveries]
    for name, failed in dict.fromkeys((bar.label, bar.failed) for bar in recoveries):
        numbers = [str(n) for n, bar in enumerate(recoveries, 1) if (bar.label, bar.failed) == (name, failed)]
        which = ", ".join(numbers[:_SHOWN_NUMBERS]) + (", .." if len(numbers) > _SHOWN_NUMBERS else "")
        text = f"{name}{', failed' if failed else ''}"
        label = f"{which} {text}" if len(which) + len(text) <= _LONGEST_LABEL else f"{text}\n{which}"
        entries.append((Patch(facecolor=colors.VERMILLION if failed else colors.PURPLE, alpha=0.85), label))
    return entries
