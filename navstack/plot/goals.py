"""The picture of goals over time: distance, velocity, states, plans, failures and recoveries."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from navstack.core import OutputError
from navstack.plot import canvas, colors
from navstack.plot.picture import Entries
from navstack.plot.run import circumstances
from navstack.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from navstack.explain import GoalReport, RecoveryRun

_PANELS: Final = ((4.35, 2.25), (3.2, 0.95), (2.05, 0.95), (0.55, 1.3))
"""Bottom and height of the panels, inches."""
STATES = {"PLANNING": colors.YELLOW, "CONTROLLING": colors.SKY, "CLEARING": colors.PURPLE, "MOTION": colors.GREEN}
"""Colors of the states."""
_LANES = ("state", "plan", "control", "recovery")
_LABEL_SHARE = 0.2
"""Share of the time axis that the full label of a goal needs."""
_SHOWN_NUMBERS: Final = 8
"""Numbers of recoveries that an entry of the legend lists."""
_LONGEST_LABEL: Final = 26
"""Longest text that fits next to the panels (characters)."""


def plot_goal_reports(
    reports: Sequence[GoalReport],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | Sequence[Axes] | None = None,
    record: Record | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw goals over time; `reports` are the results of `explain_goals(record)`. `record` adds a subtitle.

    To a .png, .svg or .pdf, into the axes `ax` (one, or four), or a new figure. Raises OutputError, also if no goal has
    samples, and InputError for another number of axes. Returns the file; without a path the list of the axes of the four
    panels: distance, linear velocity, angular velocity, and states.
    """
    # a goal without control cycles was canceled or replaced before it began
    goals = [report for report in reports if len(report.times) and math.isfinite(report.ended)]
    if not goals:
        status = reports[0].status if reports else "not sent"
        raise OutputError(f"the goal has nothing to draw: it was {status} before it began; omit --out")
    canvas.check_target(path, ax)
    begin, end = min(map(_begin, goals)), max(goal.ended for goal in goals)
    slack = 0.015 * max(end - begin, 1.0)
    with canvas.style():
        panels = canvas.Panels(
            path,
            ax,
            _PANELS,
            title=_title(reports),
            subtitle="" if record is None else circumstances(record),
            size=(10.0, 7.4),
            right=7.75,
        )
        panels.set_times(begin - slack, end + slack)
        distance, linear, angular, lanes = panels.axes
        for axes in (distance, linear, angular):
            axes.tick_params(labelbottom=False)
        _shade_states((distance, linear, angular), goals)
        _draw_distance(distance, goals)
        _draw_velocity(linear, angular, goals)
        _draw_lanes(lanes, goals)
        _add_legends(panels, goals)
        return panels.finish(dpi)


def _begin(goal: GoalReport) -> float:
    return goal.sent if goal.accepted is None else goal.accepted


def _title(reports: Sequence[GoalReport]) -> str:
    if len(reports) != 1:
        reached = sum(report.status == "SUCCEEDED" for report in reports)
        return f"{reached} of {len(reports)} goals reached"
    report = reports[0]
    title = f"goal {report.number}: {report.status} after {report.duration:.1f} s"
    if report.expired_limit_s is not None:
        title += f", time limit of {report.expired_limit_s:g} s exceeded"
    elif report.error_code:
        title += f", {report.error_name} ({report.error_code})"
    if report.recoveries:
        many = len(report.recoveries)
        title += f", {many} recover{'y' if many == 1 else 'ies'}"
    return title


# --- panels -----------------------------------------------------------------------------------------------------------


def _shade_states(panels: Sequence[Any], goals: Sequence[GoalReport]) -> None:
    """Color the background by the state of the goal manager."""
    for goal in goals:
        for span in goal.spans:
            for axes in panels:
                axes.axvspan(
                    span.begin, span.end, color=STATES.get(span.state, colors.FAINT), alpha=0.13, lw=0, zorder=0
                )


def _draw_distance(axes: Axes, goals: Sequence[GoalReport]) -> None:
    """Draw the straight-line distance, the remaining length of the plan and the terminal states."""
    highest = 0.1
    for goal in goals:
        along = np.where(np.isfinite(goal.remaining), goal.remaining, np.nan)
        axes.plot(goal.times, along, color=colors.PLAN, lw=1.6, zorder=3)
        axes.plot(goal.times, goal.distance, color=colors.DRIVEN, lw=1.8, zorder=4)
        for curve in (along, goal.distance):
            known = curve[np.isfinite(curve)]
            highest = max(highest, float(known.max()) if len(known) else 0.0)
    axes.set_ylim(-0.03 * highest, 1.2 * highest)
    axes.set_ylabel("distance to the goal (m)")
    for goal in goals:
        _draw_outcome(axes, goal, 1.19 * highest, alone=len(goals) == 1)


def _draw_outcome(axes: Axes, goal: GoalReport, y: float, *, alone: bool) -> None:
    """A vertical line at the end of a goal, labeled as far as the label fits."""
    color = colors.GREEN if goal.status == "SUCCEEDED" else colors.VERMILLION
    axes.axvline(goal.ended, color=color, lw=1.2, zorder=2)
    begin, end = axes.get_xlim()
    share = (goal.ended - _begin(goal)) / (end - begin)
    if alone:
        label = goal.status
    elif share > _LABEL_SHARE:
        label = f"goal {goal.number}: {goal.status}"
    else:
        label = f"goal {goal.number}" if share > _LABEL_SHARE / 3.0 else str(goal.number)
    axes.annotate(
        label,
        (goal.ended, y),
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=8,
        fontweight="bold",
        color=color,
        zorder=6,
    )


def _draw_velocity(linear: Axes, angular: Axes, goals: Sequence[GoalReport]) -> None:
    """Draw linear and angular velocity, each with its own axis: one of them would flatten the other."""
    for goal in goals:
        speed = np.where(np.abs(goal.velocity[:, 1]) > 1e-9, np.hypot(*goal.velocity[:, :2].T), goal.velocity[:, 0])
        linear.plot(goal.times, speed, color=colors.BLUE, lw=1.4, zorder=4)
        angular.plot(goal.times, goal.velocity[:, 2], color=colors.VERMILLION, lw=1.0, zorder=4)
    for axes, label in ((linear, "linear (m/s)"), (angular, "angular (rad/s)")):
        axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -0.1), max(high, 0.1))
        axes.set_ylabel(label, fontsize=8)


def _draw_lanes(axes: Axes, goals: Sequence[GoalReport]) -> None:
    """Draw states, plans, failures and recoveries, one lane each."""
    axes.set_ylim(len(_LANES) - 0.5, -0.5)
    axes.set_yticks(range(len(_LANES)), _LANES)
    axes.tick_params(axis="y", length=0)
    number = 0
    for goal in goals:
        for span in goal.spans:
            color = STATES.get(span.state, colors.FAINT)
            axes.barh(0, span.end - span.begin, left=span.begin, height=0.62, color=color, alpha=0.75, lw=0, zorder=3)
        for lane, failures in ((1, goal.failed_plans), (2, goal.failed_commands)):
            times = [t for t, _ in failures]
            axes.plot(times, [lane] * len(times), "x", ms=4, mew=1.0, color=colors.VERMILLION, zorder=4)
        axes.plot(goal.plan_times, [1] * len(goal.plan_times), "|", ms=9, mew=1.3, color=colors.BLUE, zorder=5)
        for recovery in goal.recoveries:
            number += 1
            _draw_recovery(axes, recovery, number)


def _draw_recovery(axes: Axes, recovery: RecoveryRun, number: int) -> None:
    color = colors.VERMILLION if recovery.outcome == "failed" else colors.PURPLE
    if recovery.end > recovery.begin:
        axes.barh(
            3, recovery.end - recovery.begin, left=recovery.begin, height=0.62, color=color, alpha=0.85, lw=0, zorder=3
        )
    else:
        axes.plot([recovery.begin], [3], "D", ms=8 if number < 10 else 10, color=color, mec="white", mew=0.6, zorder=4)
    if number > 99:  # three digits do not fit
        return
    axes.annotate(
        str(number),
        ((recovery.begin + recovery.end) / 2.0, 3),
        ha="center",
        va="center_baseline",
        fontsize=7,
        fontweight="bold",
        color="white",
        zorder=6,
    )


# --- legends ----------------------------------------------------------------------------------------------------------


def _add_legends(panels: canvas.Panels, goals: Sequence[GoalReport]) -> None:
    """Add a legend next to each panel; inside those of the caller. The axes of the velocities have their names."""
    entries = (_distance_entries(goals), [], [], _lane_entries(goals))
    for axes, of_panel in zip(panels.axes, entries, strict=True):
        if not of_panel:
            continue
        handles, labels = [handle for handle, _ in of_panel], [label for _, label in of_panel]
        if not panels.is_own:
            axes.legend(handles, labels, loc="best", handlelength=1.8, fontsize=6)
            continue
        panels.figure.legend(
            handles,
            labels,
            loc="upper left",
            bbox_to_anchor=(panels.right + 0.014, axes.get_position().y1),
            borderaxespad=0.0,
            handlelength=1.8,
            fontsize=8,
        )


def _distance_entries(goals: Sequence[GoalReport]) -> Entries:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: Entries = [(Line2D([], [], color=colors.DRIVEN, lw=1.8), "straight line")]
    if any(np.isfinite(goal.remaining).any() for goal in goals):
        entries.append((Line2D([], [], color=colors.PLAN, lw=1.6), "along the plan"))
    occurring = {span.state for goal in goals for span in goal.spans}
    return entries + [(Patch(facecolor=STATES[name], alpha=0.6), name) for name in STATES if name in occurring]


def _lane_entries(goals: Sequence[GoalReport]) -> Entries:
    from matplotlib.lines import Line2D

    entries: Entries = []
    if any(len(goal.plan_times) for goal in goals):
        entries.append((Line2D([], [], ls="none", marker="|", ms=9, mew=1.3, color=colors.BLUE), "plan found"))
    if any(len(goal.failed_plans) or len(goal.failed_commands) for goal in goals):
        entries.append((Line2D([], [], ls="none", marker="x", ms=4, mew=1.0, color=colors.VERMILLION), "failed"))
    return entries + _recovery_entries(goals)


def _recovery_entries(goals: Sequence[GoalReport]) -> Entries:
    """Return one entry per behavior and outcome, with the numbers of its executions."""
    from matplotlib.patches import Patch

    entries: Entries = []
    recoveries = [(run.name, run.outcome == "failed") for goal in goals for run in goal.recoveries]
    for name, failed in dict.fromkeys(recoveries):
        numbers = [str(n) for n, run in enumerate(recoveries, 1) if run == (name, failed)]
        which = ", ".join(numbers[:_SHOWN_NUMBERS]) + (", .." if len(numbers) > _SHOWN_NUMBERS else "")
        text = f"{name}{', failed' if failed else ''}"
        label = f"{which} {text}" if len(which) + len(text) <= _LONGEST_LABEL else f"{text}\n{which}"
        entries.append((Patch(facecolor=colors.VERMILLION if failed else colors.PURPLE, alpha=0.85), label))
    return entries
