"""`navstack explain goal`: the timeline of a goal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.explain import GoalReport
    from navstack.plot.goal_tracks import GoalTrack
    from navstack.record import Record


def goal(
    run: options.RunFolder,
    number: Annotated[
        int | None, typer.Option("--goal", metavar="N", help="Number of the goal, from 1. [default: all goals]", min=1)
    ] = None,
    out: Annotated[Path | None, options.picture_file("goal.png")] = None,
    json_: options.Json = False,
) -> None:
    """Explain the outcome of a goal: states, plans, failures with their reasons, recoveries, times without progress."""
    from navstack.cli.output import print_files, print_json, stdout
    from navstack.explain import explain_goal, explain_goals
    from navstack.explain.printing import print_goal
    from navstack.record import Record

    record = Record.load(run)
    reports = explain_goals(record) if number is None else (explain_goal(record, number),)
    files: dict[str, str] = {}
    if out is not None:
        draw(record, reports, out)
        files["picture"] = str(out)
    if json_:
        document = {"goals": [report.as_dict() for report in reports]}
        print_json(document | ({"files": files} if files else {}))
        return
    for report in reports:
        print_goal(stdout(), report)
    print_files(files)


def draw(record: Record, reports: tuple[GoalReport, ...], out: Path) -> None:
    """Draws the timelines of goals. Raises OutputError if none of them has samples, or for an unknown suffix."""
    from navstack.core.errors import OutputError
    from navstack.plot.goal import plot_goals
    from navstack.plot.run import circumstances

    tracks = [track for report in reports if (track := _track(report)).is_drawable]
    if not tracks:
        raise OutputError(f"the goal has nothing to draw: it was {reports[0].status} before it began; omit --out")
    plot_goals(tracks, out, title=_title(reports), subtitle=circumstances(record))


def _title(reports: tuple[GoalReport, ...]) -> str:
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


def _track(report: GoalReport) -> GoalTrack:
    from navstack.plot.goal_tracks import Bar, GoalTrack

    return GoalTrack(
        label=f"goal {report.number}",
        begin=report.sent if report.accepted is None else report.accepted,
        end=report.ended,
        outcome=report.status,
        states=[Bar(span.state, span.begin, span.end) for span in report.spans],
        recoveries=[Bar(r.name, r.begin, r.end, r.outcome == "failed") for r in report.recoveries],
        plans=report.plan_times.tolist(),
        failed_plans=[t for t, _ in report.failed_plans],
        failed_commands=[t for t, _ in report.failed_commands],
        times=report.times,
        distance=report.distance,
        remaining=report.remaining,
        velocity=report.velocity,
    )
