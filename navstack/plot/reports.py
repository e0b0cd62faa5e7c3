"""Pictures of the reports of `navstack.explain`: a command, goals, passages, inflation.

That package does not import this one, nor the reverse; the reports are passed as they are.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from navstack.core.errors import InputError, OutputError
from navstack.plot.fan import Fan, plot_fan
from navstack.plot.goal import plot_goals
from navstack.plot.goal_tracks import Bar as Span
from navstack.plot.goal_tracks import GoalTrack
from navstack.plot.inflation import Curve, plot_inflation
from navstack.plot.openings import Opening
from navstack.plot.passages import KINDS, Bar, plot_passages
from navstack.plot.run import circumstances
from navstack.record import Record

_LONGEST_SUBTITLE = 110


def plot_command(report: Any, path: str | os.PathLike[str] | None = None, *, ax: Any = None, dpi: float = 130.0) -> Any:
    """Draws the trajectories of a control cycle; `report` is the result of `explain_command(record, time)`.

    Draws to a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises OutputError, and InputError for a local planner
    without trajectories. Returns the file; without a path the axes.
    """
    plan = report.plan
    if report.poses is None or report.counts is None or plan.totals is None:
        raise InputError(f"{report.planner} has no trajectories to draw; omit --out", planner=report.planner)
    rows = sorted(report.samples, key=lambda sample: sample.index)
    vx, vy, wz = (v + 0.0 if abs(v) >= 5e-4 else 0.0 for v in plan.command)
    requested = f" (requested {report.requested:.2f} s)" if report.time != report.requested else ""
    rejections: str = report.rejections
    return plot_fan(
        Fan(
            poses=report.poses,
            counts=report.counts,
            totals=plan.totals,
            rejected_by=[sample.rejected_by for sample in rows],
            best=plan.best,
            collisions=[int(sample.collision.get("step", -1)) for sample in rows],
        ),
        report.costmap,
        path,
        ax=ax,
        robot=report.robot,
        footprint=report.footprint,
        plan=plan.local_plan.poses if plan.local_plan is not None else None,
        title=f"{report.planner} at {report.time:.2f} s{requested}: vx {vx:.2f}{f', vy {vy:.2f}' if vy else ''}, wz {wz:.2f}",
        subtitle=rejections if len(rejections) <= _LONGEST_SUBTITLE else rejections[: _LONGEST_SUBTITLE - 1] + "…",
        dpi=dpi,
    )


def plot_goal_reports(
    reports: Sequence[Any],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    record: Record | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draws goals over time; `reports` are the results of `explain_goals(record)`. `record` adds a subtitle.

    Draws to a .png, .svg or .pdf, into the axes `ax` (one, or three), or a new figure. Raises OutputError, also if none of the
    goals has samples. Returns the file; without a path the list of the three panels' axes.
    """
    tracks = [track for report in reports if (track := _track(report)).is_drawable]
    if not tracks:
        status = reports[0].status if reports else "not sent"
        raise OutputError(f"the goal has nothing to draw: it was {status} before it began; omit --out")
    subtitle = "" if record is None else circumstances(record)
    return plot_goals(tracks, path, ax=ax, title=_goals_title(reports), subtitle=subtitle, dpi=dpi)


def _goals_title(reports: Sequence[Any]) -> str:
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


def _track(report: Any) -> GoalTrack:
    return GoalTrack(
        label=f"goal {report.number}",
        begin=report.sent if report.accepted is None else report.accepted,
        end=report.ended,
        outcome=report.status,
        states=[Span(span.state, span.begin, span.end) for span in report.spans],
        recoveries=[Span(r.name, r.begin, r.end, r.outcome == "failed") for r in report.recoveries],
        plans=report.plan_times.tolist(),
        failed_plans=[t for t, _ in report.failed_plans],
        failed_commands=[t for t, _ in report.failed_commands],
        times=report.times,
        distance=report.distance,
        remaining=report.remaining,
        velocity=report.velocity,
    )


def plot_passage_report(
    report: Any,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    name: str = "the map",
    dpi: float = 170.0,
) -> Any:
    """Draws a map with its passages; `report` is the result of `find_passages(configuration, grid)`, `name` that of the map.

    Draws to a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises OutputError. Returns the file; without a path
    the axes.
    """
    if report.shapes is not None:
        return _plot_openings(report, path, ax=ax, name=name, dpi=dpi)
    counts = ", ".join(f"{report.count(rating)} {kind.label}" for rating, kind in KINDS.items())
    return plot_passages(
        report.costmap,
        [Bar(i, passage.ends, passage.rating) for i, passage in enumerate(report.passages, 1)],
        path,
        ax=ax,
        title=f"passages of {name}: {counts}",
        subtitle=f"{report.costmap_name} costmap: inscribed radius {report.inscribed_radius:.3f} m, inflation radius "
        f"{report.inflation_radius:g} m   minimum width {report.widths.minimum:.2f} m, low-cost width "
        f"{report.widths.low_cost:.2f} m",
        dpi=dpi,
    )


def _plot_openings(report: Any, path: str | os.PathLike[str] | None, *, ax: Any, name: str, dpi: float) -> Any:
    """Draws what the passages of a report mean for its footprint."""
    verdicts = [shape.verdict for shape in report.shapes]
    radius = f"   turning radius {report.turning_radius:g} m" if report.turning_radius else ""
    return plot_passages(
        report.costmap,
        [
            Bar(i, passage.ends, verdict)
            for i, (passage, verdict) in enumerate(zip(report.passages, verdicts, strict=True), 1)
        ],
        path,
        ax=ax,
        title=f"passages of {name} for a footprint",
        subtitle=f"{report.costmap_name} costmap: footprint with inscribed radius {report.inscribed_radius:.3f} m, "
        f"circumscribed radius {report.circumscribed_radius:.3f} m{radius}",
        openings=[
            Opening(
                shape.headings[0].pose,
                tuple((r.low, r.high) for r in shape.headings),
                None if shape.path is None else shape.path.poses,
            )
            for shape in report.shapes
            if shape.headings
        ],
        footprint=report.footprint,
        dpi=dpi,
    )


def plot_inflation_curves(
    curves: Sequence[Any],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str = "inflation",
    dpi: float = 130.0,
) -> Any:
    """Draws cost against distance; `curves` are the results of `inflation_curves(configuration)`.

    Draws to a .png, .svg or .pdf, into the axes `ax` (one, or one per curve), or a new figure. Raises OutputError. Returns the
    file; without a path the list of the panels' axes.
    """
    return plot_inflation([_curve(curve) for curve in curves], path, ax=ax, title=title, dpi=dpi)


def _curve(curve: Any) -> Curve:
    reach = max(curve.cells[-1], curve.circumscribed_radius + curve.resolution)
    distances = np.linspace(0.0, 1.05 * reach, 1200)
    return Curve(
        label=f"{' and '.join(curve.costmaps)} costmap{'s' if len(curve.costmaps) > 1 else ''}",
        distances=distances,
        costs=curve.at(distances).astype(np.float64),
        cells=curve.cells,
        cell_costs=curve.cell_costs.astype(np.float64),
        inscribed=curve.inscribed_radius,
        circumscribed=curve.circumscribed_radius,
        inflation=curve.inflation_radius,
        subtitle=f"cost_scaling_factor {curve.cost_scaling_factor:g} / m   cells of {curve.resolution:g} m",
    )
