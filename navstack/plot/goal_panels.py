"""The panels of the picture of goals over time: distance, velocity, and lanes of events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from navstack.plot import colors
from navstack.plot.goal_tracks import Bar, GoalTrack

STATES = {"PLANNING": colors.YELLOW, "CONTROLLING": colors.SKY, "CLEARING": colors.PURPLE, "MOTION": colors.GREEN}
"""Colours of the states."""
_LANES = ("state", "plan", "control", "recovery")
_LABEL_SHARE = 0.2
"""Share of the time axis that the full label of a goal needs."""


def shade_states(panels: Sequence[Any], tracks: Sequence[GoalTrack]) -> None:
    """Colours the background by the state of the goal manager."""
    for track in tracks:
        for bar in track.states:
            for axes in panels:
                axes.axvspan(bar.begin, bar.end, color=STATES.get(bar.label, colors.FAINT), alpha=0.13, lw=0, zorder=0)


def draw_distance(axes: Any, tracks: Sequence[GoalTrack]) -> None:
    """Draws the straight-line distance, the remaining length of the plan and the terminal states."""
    highest = 0.1
    for track in tracks:
        along = np.where(np.isfinite(track.remaining), track.remaining, np.nan)
        axes.plot(track.times, along, color=colors.PLAN, lw=1.6, zorder=3)
        axes.plot(track.times, track.distance, color=colors.DRIVEN, lw=1.8, zorder=4)
        for curve in (along, track.distance):
            known = curve[np.isfinite(curve)]
            highest = max(highest, float(known.max()) if len(known) else 0.0)
    axes.set_ylim(-0.03 * highest, 1.2 * highest)
    axes.set_ylabel("distance to the goal (m)")
    for track in tracks:
        _draw_outcome(axes, track, 1.19 * highest, alone=len(tracks) == 1)


def _draw_outcome(axes: Any, track: GoalTrack, y: float, *, alone: bool) -> None:
    """A vertical line at the end of a goal, labelled as far as the label fits."""
    color = colors.GREEN if track.outcome == "SUCCEEDED" else colors.VERMILLION
    axes.axvline(track.end, color=color, lw=1.2, zorder=2)
    begin, end = axes.get_xlim()
    share = (track.end - track.begin) / (end - begin)
    if alone:
        label = track.outcome
    elif share > _LABEL_SHARE:
        label = f"{track.label}: {track.outcome}"
    else:
        label = track.label if share > _LABEL_SHARE / 3.0 else track.label.split()[-1]
    axes.annotate(
        label,
        (track.end, y),
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=8,
        fontweight="bold",
        color=color,
        zorder=6,
    )


def draw_velocity(axes: Any, tracks: Sequence[GoalTrack]) -> None:
    """Draws linear and angular velocity."""
    for track in tracks:
        speed = np.where(np.abs(track.velocity[:, 1]) > 1e-9, np.hypot(*track.velocity[:, :2].T), track.velocity[:, 0])
        axes.plot(track.times, track.velocity[:, 2], color=colors.VERMILLION, lw=1.0, ls=(0, (4, 1.5)), zorder=3)
        axes.plot(track.times, speed, color=colors.BLUE, lw=1.4, zorder=4)
    axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -0.1), max(high, 0.1))
    axes.set_ylabel("velocity\n(m/s, rad/s)")


def draw_lanes(axes: Any, tracks: Sequence[GoalTrack]) -> None:
    """Draws states, plans, failures and recoveries, one lane each."""
    axes.set_ylim(len(_LANES) - 0.5, -0.5)
    axes.set_yticks(range(len(_LANES)), _LANES)
    axes.tick_params(axis="y", length=0)
    number = 0
    for track in tracks:
        for bar in track.states:
            color = STATES.get(bar.label, colors.FAINT)
            axes.barh(0, bar.end - bar.begin, left=bar.begin, height=0.62, color=color, alpha=0.75, lw=0, zorder=3)
        for lane, times in ((1, track.failed_plans), (2, track.failed_commands)):
            axes.plot(times, [lane] * len(times), "x", ms=4, mew=1.0, color=colors.VERMILLION, zorder=4)
        axes.plot(track.plans, [1] * len(track.plans), "|", ms=9, mew=1.3, color=colors.BLUE, zorder=5)
        for bar in track.recoveries:
            number += 1
            _draw_recovery(axes, bar, number)


def _draw_recovery(axes: Any, bar: Bar, number: int) -> None:
    color = colors.VERMILLION if bar.failed else colors.PURPLE
    if bar.end > bar.begin:
        axes.barh(3, bar.end - bar.begin, left=bar.begin, height=0.62, color=color, alpha=0.85, lw=0, zorder=3)
    else:
        axes.plot([bar.begin], [3], "D", ms=8 if number < 10 else 10, color=color, mec="white", mew=0.6, zorder=4)
    if number > 99:  # three digits do not fit
        return
    axes.annotate(
        str(number),
        ((bar.begin + bar.end) / 2.0, 3),
        ha="center",
        va="center_baseline",
        fontsize=7,
        fontweight="bold",
        color="white",
        zorder=6,
    )
