"""The picture of goals over time: distance, velocity, states, plans, failures and recoveries. Times in s of the run."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.plot import canvas, colors


@dataclass(frozen=True, slots=True)
class Bar:
    """A time span: a state or a recovery."""

    label: str
    begin: float
    end: float
    failed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class GoalTrack:
    """The data of one goal."""

    label: str
    begin: float
    end: float
    outcome: str
    """Terminal state: SUCCEEDED, ABORTED, .."""
    states: Sequence[Bar]
    recoveries: Sequence[Bar]
    plans: Sequence[float]
    """Times of the plans found."""
    failed_plans: Sequence[float]
    failed_commands: Sequence[float]
    times: NDArray[np.float64]
    """(n,)"""
    distance: NDArray[np.float64]
    """(n,) straight-line distance to the goal (m)."""
    remaining: NDArray[np.float64]
    """(n,) remaining length of the plan (m); NaN without a plan."""
    velocity: NDArray[np.float64]
    """(n, 3) vx, vy (m/s), wz (rad/s)."""


STATES = {"PLANNING": colors.YELLOW, "CONTROLLING": colors.SKY, "CLEARING": colors.PURPLE}
_LANES = ("state", "plan", "control", "recovery")
_ROOM = 0.2
"""Share of the time axis that the label of a goal needs."""
_SHOWN_NUMBERS = 8
_LONGEST_LABEL = 26
"""Longest legend text that fits beside the panels (characters)."""


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
        width, height = 10.0, 6.7
        figure = canvas.new_figure(width, height)
        left, right = 0.72 / width, 7.75 / width
        # bottom and height of each panel, inches
        panels = [
            figure.add_axes((left, bottom / height, right - left, high / height))
            for bottom, high in ((3.55, 2.35), (2.1, 1.2), (0.55, 1.3))
        ]
        figure.text(left, 1.0 - 0.3 / height, title, fontsize=12, fontweight="bold", va="baseline")
        figure.text(left, 1.0 - 0.53 / height, subtitle, fontsize=8.5, color="#666666", va="baseline")
        for axes in panels:
            axes.set_xlim(begin - slack, end + slack)
            axes.grid(axis="x", color="#E3E3E3", lw=0.6)
            axes.set_axisbelow(True)
        for axes in panels[:2]:
            axes.tick_params(labelbottom=False)
        panels[-1].set_xlabel("time (s)")
        _shade(panels[:2], tracks)
        _draw_distance(panels[0], tracks)
        _draw_velocity(panels[1], tracks)
        _draw_lanes(panels[2], tracks)
        _legends(figure, panels, tracks, (right * width + 0.14) / width)
        return canvas.save(figure, out, dpi)


def _shade(panels: Sequence[Any], tracks: Sequence[GoalTrack]) -> None:
    for track in tracks:
        for bar in track.states:
            for axes in panels:
                axes.axvspan(bar.begin, bar.end, color=STATES.get(bar.label, colors.FAINT), alpha=0.13, lw=0, zorder=0)


def _draw_distance(axes: Any, tracks: Sequence[GoalTrack]) -> None:
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
    begin, end = axes.get_xlim()
    for track in tracks:
        ink = colors.GREEN if track.outcome == "SUCCEEDED" else colors.VERMILLION
        axes.axvline(track.end, color=ink, lw=1.2, zorder=2)
        share = (track.end - track.begin) / (end - begin)
        label = (
            f"{track.label}: {track.outcome}"
            if share > _ROOM
            else track.label
            if share > _ROOM / 3.0
            else track.label.split()[-1]
        )
        axes.annotate(
            label if len(tracks) > 1 else track.outcome,
            (track.end, 1.19 * highest),
            xytext=(-4, 0),
            textcoords="offset points",
            ha="right",
            va="top",
            fontsize=8,
            fontweight="bold",
            color=ink,
            zorder=6,
        )


def _draw_velocity(axes: Any, tracks: Sequence[GoalTrack]) -> None:
    for track in tracks:
        speed = np.where(np.abs(track.velocity[:, 1]) > 1e-9, np.hypot(*track.velocity[:, :2].T), track.velocity[:, 0])
        axes.plot(track.times, track.velocity[:, 2], color=colors.VERMILLION, lw=1.0, ls=(0, (4, 1.5)), zorder=3)
        axes.plot(track.times, speed, color=colors.BLUE, lw=1.4, zorder=4)
    axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -0.1), max(high, 0.1))
    axes.set_ylabel("velocity\n(m/s, rad/s)")


def _draw_lanes(axes: Any, tracks: Sequence[GoalTrack]) -> None:
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
            ink = colors.VERMILLION if bar.failed else colors.PURPLE
            if bar.end > bar.begin:
                axes.barh(3, bar.end - bar.begin, left=bar.begin, height=0.62, color=ink, alpha=0.85, lw=0, zorder=3)
            else:
                axes.plot([bar.begin], [3], "D", ms=8 if number < 10 else 10, color=ink, mec="white", mew=0.6, zorder=4)
            if number <= 99:
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


def _legends(figure: Any, panels: Sequence[Any], tracks: Sequence[GoalTrack], x: float) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def beside(axes: Any, handles: list[Any], labels: list[str]) -> None:
        top = axes.get_position().y1
        figure.legend(
            handles, labels, loc="upper left", bbox_to_anchor=(x, top), borderaxespad=0.0, handlelength=1.8, fontsize=8
        )

    line = Line2D([], [], color=colors.DRIVEN, lw=1.8)
    along = Line2D([], [], color=colors.PLAN, lw=1.6)
    planned = [along] if any(np.isfinite(track.remaining).any() for track in tracks) else []
    shown = [name for name in STATES if any(bar.label == name for track in tracks for bar in track.states)]
    shades = [Patch(facecolor=STATES[name], alpha=0.6) for name in shown]
    beside(panels[0], [line, *planned, *shades], ["straight line", *["along the plan"] * len(planned), *shown])
    turning = Line2D([], [], color=colors.VERMILLION, lw=1.0, ls=(0, (4, 1.5)))
    beside(panels[1], [Line2D([], [], color=colors.BLUE, lw=1.4), turning], ["linear (m/s)", "angular (rad/s)"])
    handles: list[Any] = []
    labels: list[str] = []
    if any(len(track.plans) for track in tracks):
        handles.append(Line2D([], [], ls="none", marker="|", ms=9, mew=1.3, color=colors.BLUE))
        labels.append("plan found")
    if any(len(track.failed_plans) or len(track.failed_commands) for track in tracks):
        handles.append(Line2D([], [], ls="none", marker="x", ms=4, mew=1.0, color=colors.VERMILLION))
        labels.append("failed")
    recoveries = [bar for track in tracks for bar in track.recoveries]
    for name, failed in dict.fromkeys((bar.label, bar.failed) for bar in recoveries):
        numbers = [str(n) for n, bar in enumerate(recoveries, 1) if (bar.label, bar.failed) == (name, failed)]
        which = ", ".join(numbers[:_SHOWN_NUMBERS]) + (", .." if len(numbers) > _SHOWN_NUMBERS else "")
        handles.append(Patch(facecolor=colors.VERMILLION if failed else colors.PURPLE, alpha=0.85))
        text = f"{name}{', failed' if failed else ''}"
        labels.append(f"{which} {text}" if len(which) + len(text) <= _LONGEST_LABEL else f"{text}\n{which}")
    beside(panels[2], handles, labels)


def is_drawable(track: GoalTrack) -> bool:
    """Returns False for a goal without control cycles, which was cancelled or replaced before it began."""
    return len(track.times) > 0 and math.isfinite(track.end)
