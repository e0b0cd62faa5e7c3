"""`navstack explain goal`: the timeline of a goal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.output import print_advice, print_files, print_json, stdout
from navstack.explain import explain_goal, explain_goals, narrow_advice, print_goal
from navstack.plot import plot_goal_reports
from navstack.record import Record
from navstack.scenario import advice_of


def goal(
    run: options.RunFolder,
    number: Annotated[
        int | None, typer.Option("--goal", metavar="N", help="Number of the goal, from 1. [default: all goals]", min=1)
    ] = None,
    out: Annotated[Path | None, options.picture_file("goal.png")] = None,
    json_: options.Json = False,
) -> None:
    """Explain the outcome of a goal: states, plans, failures with their reasons, recoveries, times without progress."""
    record = Record.load(run)
    reports = explain_goals(record) if number is None else (explain_goal(record, number),)
    advice = (*advice_of(record), *narrow_advice(record))
    files: dict[str, str] = {}
    if out is not None:
        plot_goal_reports(reports, out, record=record)
        files["picture"] = str(out)
    if json_:
        document = {"goals": [report.as_dict() for report in reports], "advice": list(advice)}
        print_json(document | ({"files": files} if files else {}))
        return
    for report in reports:
        print_goal(stdout(), report)
    print_advice(advice)
    print_files(files)
