"""`navstack explain goal`: the time line of a goal in words and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from navstack.explain.goal import GoalAccount
    from navstack.plot.goal import GoalTrack
    from navstack.record import Record

STYLE = {
    "plan_failed": "yellow",
    "control_failed": "yellow",
    "recovery": "magenta",
    "warning": "yellow",
    "held_up": "yellow",
    "contact": "bold red",
}


def goal(
    run: Path = typer.Argument(..., help="The folder of a run, or its run.npz."),
    number: int | None = typer.Option(
        None, "--goal", metavar="N", help="Which goal, from 1; every goal in turn if left out.", min=1
    ),
    out: Path | None = typer.Option(None, "--out", metavar="FILE", help="Draw it too (.png, .svg or .pdf)."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """What became of a goal, and why: states, plans, failures, recoveries, and how far it was at each moment."""
    from navstack.cli.output import print_json, stdout
    from navstack.explain.goal import explain_goal, explain_goals
    from navstack.record import Record

    record = Record.load(run)
    accounts = explain_goals(record) if number is None else (explain_goal(record, number),)
    files: dict[str, str] = {}
    if out is not None:
        draw(record, accounts, out)
        files["picture"] = str(out)
    if json_:
        document = {"goals": [account.as_dict() for account in accounts]}
        print_json(document | ({"files": files} if files else {}))
        return
    for account in accounts:
        _print(account)
    for what, file in files.items():
        stdout().print(f"{what}: {file}")


def _print(account: GoalAccount) -> None:
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout

    out = stdout()
    good = account.status == "SUCCEEDED"
    out.print(f"[bold]goal {account.number}:[/] [bold {'green' if good else 'red'}]{escape(account.verdict)}[/]")
    shares = [(s, account.seconds(s)) for s in ("PLANNING", "CONTROLLING", "CLEARING")]
    if account.spans:
        out.print("[dim]" + ", ".join(f"{state} {spent:.1f} s" for state, spent in shares) + "[/]")
    table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(justify="right", no_wrap=True)
    table.add_column(overflow="fold")
    for line in account.lines:
        when = f"{line.begin:.1f} s" if line.end - line.begin < 0.05 else f"{line.begin:.1f} to {line.end:.1f} s"
        style = STYLE.get(line.kind)
        if line.kind == "end":
            style = "bold green" if good else "bold red"
        table.add_row(when, escape(line.text), style=style)
    # wide output (a pipe) is one line each
    out.print(table, soft_wrap=False)
    out.print()


def draw(record: Record, accounts: tuple[GoalAccount, ...], out: Path) -> None:
    """The picture of these goals; raises OutputError."""
    from navstack.core.errors import OutputError
    from navstack.plot.goal import is_drawable, plot_goals
    from navstack.plot.run import circumstances

    tracks = [track for account in accounts if is_drawable(track := _track(account))]
    if not tracks:
        raise OutputError(
            f"there is nothing to draw: the goal was {accounts[0].status} before its turn came; leave out --out"
        )
    if len(accounts) == 1:
        (account,) = accounts
        title = f"goal {account.number}: {account.status} after {account.duration:.1f} s"
        if account.error_code:
            title += f", {account.error_name} ({account.error_code})"
        if account.recoveries:
            many = len(account.recoveries)
            title += f", {many} recover{'y' if many == 1 else 'ies'}"
    else:
        reached = sum(account.status == "SUCCEEDED" for account in accounts)
        title = f"{reached} of {len(accounts)} goals reached"
    plot_goals(tracks, out, title=title, subtitle=circumstances(record))


def _track(account: GoalAccount) -> GoalTrack:
    from navstack.plot.goal import Bar, GoalTrack

    return GoalTrack(
        label=f"goal {account.number}",
        begin=account.sent if account.accepted is None else account.accepted,
        end=account.ended,
        outcome=account.status,
        states=[Bar(span.state, span.begin, span.end) for span in account.spans],
        recoveries=[Bar(r.name, r.begin, r.end, r.outcome == "failed") for r in account.recoveries],
        plans=account.plan_times.tolist(),
        failed_plans=[t for t, _ in account.failed_plans],
        failed_commands=[t for t, _ in account.failed_commands],
        times=account.times,
        distance=account.distance,
        remaining=account.remaining,
        velocity=account.velocity,
    )
