"""Prints the reports of this package to a console: the commands and the live page show the same text."""

from __future__ import annotations

import math

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from navstack.explain.cell import CellReport
from navstack.explain.command import CommandReport, SampleReport, chain_sentence, steering_sentence, velocity_text
from navstack.explain.crossing import VERDICT_TEXTS, ShapePassage
from navstack.explain.goal import GoalReport
from navstack.explain.passages import LABELS, RATINGS, PassageReport

SHOWN = 12
"""Rows of the table without --all."""
PIPE_WIDTH = 400
"""Width of the table if stdout is not a terminal (columns): wide enough for every number."""
_GOAL_STYLE = {
    "plan_failed": "yellow",
    "control_failed": "yellow",
    "recovery": "magenta",
    "warning": "yellow",
    "lost": "yellow",
    "stuck": "yellow",
    "collision": "bold red",
}

_PASSAGE_STYLE = {"free": "blue", "costly": "yellow", "blocked": "bold red"}
_SHAPE_STYLE = {"free": "blue", "turns": "blue", "fits": "blue", "stuck": "yellow", "blocked": "bold red"}


def print_cell(out: Console, report: CellReport) -> None:
    """Print why a cell has its cost."""
    found = report.provenance
    robot = report.robot
    out.print(
        f"{found.costmap} at {report.time:.3f} s: cell ({found.ix}, {found.iy}) at ({found.x:.3f}, {found.y:.3f}) in "
        f"{escape(report.frame)}; robot at ({robot.x:.2f}, {robot.y:.2f})"
    )
    out.print(f"[bold]{escape(report.summary)}[/]")
    table = Table("layer", "cost", "explanation", box=SIMPLE_HEAD, pad_edge=False)
    subjects = [("", found)] + ([("obstacle: ", found.obstacle)] if found.obstacle is not None else [])
    for prefix, subject in subjects:
        for i, share in enumerate(subject.layers):
            text = share.explanation.text if share.explanation is not None else "no explanation"
            change = f"{share.before} -> {share.after}" if share.after != share.before else str(share.after)
            last = i == len(subject.layers) - 1
            table.add_row(escape(prefix + share.layer), change, escape(text), end_section=last)
    out.print(table)


def print_goal(out: Console, report: GoalReport) -> None:
    """Print the timeline of a goal."""
    style = "green" if report.status == "SUCCEEDED" else "red"
    out.print(f"[bold]goal {report.number}:[/] [bold {style}]{escape(report.summary)}[/]")
    states = ("PLANNING", "CONTROLLING", "CLEARING")
    if any(span.state == "MOTION" for span in report.spans):
        states = ("MOTION",)  # a motion is not planned
    seconds = [(state, report.seconds(state)) for state in states]
    if report.spans:
        out.print("[dim]" + ", ".join(f"{state} {spent:.1f} s" for state, spent in seconds) + "[/]")
    table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(justify="right", no_wrap=True)
    table.add_column(overflow="fold")
    for line in report.timeline:
        when = f"{line.begin:.1f} s" if line.end - line.begin < 0.05 else f"{line.begin:.1f} to {line.end:.1f} s"
        table.add_row(
            when, escape(line.text), style=f"bold {style}" if line.kind == "end" else _GOAL_STYLE.get(line.kind)
        )
    # without soft wrapping, a pipe gets one line per entry
    out.print(table, soft_wrap=False)
    out.print()


def print_command(out: Console, report: CommandReport, *, everything: bool = False) -> None:
    """Print why a command was chosen, with the samples; `everything` prints all of them."""
    plan = report.plan
    requested = f" (requested {report.requested:.3f} s)" if report.requested - report.time > 1e-3 else ""
    out.print(
        f"{report.planner} at {report.time:.3f} s{requested}, {report.state}, robot at ({report.robot.x:.2f}, "
        f"{report.robot.y:.2f}, {report.robot.yaw:.2f}) in {escape(report.costmap.frame)}: "
        f"{plan.mode}, {velocity_text(plan.command)}"
    )
    out.print(f"[bold]{escape(report.summary)}[/]")
    if report.chain is not None:
        out.print(escape(chain_sentence(report.chain)))
    if report.steering is not None:
        out.print(escape(steering_sentence(report.steering)))
    for note in plan.notes:
        out.print(f"note: {escape(note)}")
    shown = _shown_samples(report, everything=everything)
    if shown:
        _print_samples(out, report, shown)


def _shown_samples(report: CommandReport, *, everything: bool) -> tuple[SampleReport, ...]:
    """Return the best samples and the chosen one, or all."""
    if everything:
        return report.samples
    shown = report.legal[:SHOWN] or report.samples[:SHOWN]
    if all(sample.index != report.plan.best for sample in shown):
        shown += tuple(sample for sample in report.legal if sample.index == report.plan.best)
    return shown


def _print_samples(out: Console, report: CommandReport, shown: tuple[SampleReport, ...]) -> None:

    plan = report.plan
    # critics whose cost is zero in every shown row get no column
    scored = [n for n in plan.critics if any(s.costs.get(n) for s in shown)]
    table = _sample_table(report, shown, scored)
    (out if out.is_terminal else Console(file=out.file, highlight=False, width=PIPE_WIDTH)).print(table)
    scales = dict(zip(plan.critics, plan.scales.tolist())) if plan.scales is not None else {}
    weights = ", ".join(f"{name} {scales[name]:.4g}" for name in scored if name in scales)
    hidden = len(report.samples) - len(shown)
    more = f"; {hidden} more with --all" if hidden else ""
    out.print(f"[dim]columns of critics: weighted cost (raw cost); weights: {weights}{more}[/]")


def _sample_table(report: CommandReport, shown: tuple[SampleReport, ...], scored: list[str]) -> Table:

    sideways = any(sample.velocity[1] for sample in report.samples)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("rank", "vx", *(["vy"] if sideways else []), "wz", "total", *scored):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("rejected by")
    for sample in shown:
        vx, vy, wz = (_velocity(v) for v in sample.velocity)
        table.add_row(
            str(sample.rank) if sample.rank is not None else "-",
            vx,
            *([vy] if sideways else []),
            wz,
            f"{sample.total:.4g}" if sample.total is not None else "-",
            *(_cost(sample, name) for name in scored),
            escape(_rejection(sample)),
            style="bold green" if sample.index == report.plan.best else "dim" if sample.rank is None else None,
        )
    return table


def _cost(sample: SampleReport, name: str) -> str:
    if name not in sample.costs:
        return "-"
    return f"{sample.weighted[name]:.4g} ({sample.costs[name]:.4g})"


def _rejection(sample: SampleReport) -> str:
    if sample.rejected_by is None:
        return ""
    collision = sample.collision
    where = ""
    if "ahead_m" in collision:
        where = f" {collision['ahead_m']:.2f} m ahead" if collision["ahead_m"] > 0.0 else " at the robot's pose"
        if collision.get("cell"):
            where += f", cell ({collision['cell'][0]}, {collision['cell'][1]})"
    return f"{sample.rejected_by}: {sample.reason}{where}" if sample.reason else sample.rejected_by


def _velocity(value: float) -> str:
    """Three digits, without the sign of -0.000: samples of DWA can be -1e-17."""
    text = f"{value:.3f}"
    return "0.000" if text == "-0.000" else text


def passage_counts(report: PassageReport) -> str:
    """Return the number of passages by rating, in words."""
    return ", ".join(f"{report.count(rating)} {LABELS[rating]}" for rating in RATINGS)


def print_passages(out: Console, report: PassageReport, name: str, *, only: int | None = None) -> None:
    """Print the passages of the map `name`, or only the one with this number (from 1)."""
    table = Table(title=f"passages of {escape(name)}", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("no.", "center (m)", "width", "cost"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("rating", no_wrap=True)
    table.add_column("centerline")
    for number, passage in enumerate(report.passages, 1):
        if only is not None and number != only:
            continue
        length = f"; {passage.length:.1f} m long" if passage.length >= 0.5 else ""
        table.add_row(
            str(number),
            f"{passage.x:.2f}, {passage.y:.2f}",
            f"{passage.width:.2f} m",
            str(passage.cost),
            f"[{_PASSAGE_STYLE[passage.rating]}]{LABELS[passage.rating]}[/]",
            escape(passage.reason + length),
        )
    if report.passages:
        out.print(table)
        if report.shapes is not None:
            _print_shapes(out, report, only)
    narrower = f"; {report.narrower} narrower (--narrowest 0 lists them)" if report.narrower else ""
    smaller = f" next to obstacles of {report.smallest_obstacle:g} m or more" if report.smallest_obstacle else ""
    if not report.passages:
        out.print(
            f"passages of {escape(name)}: none narrower than {report.widest:.2f} m{smaller}{narrower}", soft_wrap=True
        )
        _print_widths(out, report)
        return
    by_costs = "by the costs on their centerlines: " if report.shapes is not None else ""
    out.print(
        f"{by_costs}{passage_counts(report)}; searched widths {report.narrowest:.2f} to {report.widest:.2f} m{smaller}{narrower}",
        soft_wrap=True,
    )
    _print_widths(out, report)


def _print_widths(out: Console, report: PassageReport) -> None:
    w = report.widths
    less = " by the costs, less than the robot is wide: it may collide" if w.minimum < w.robot - 1e-9 else ""
    out.print(
        f"this robot: own width {w.robot:.2f} m, turning width {w.turning:.2f} m, low-cost width {w.low_cost:.2f} m, "
        f"minimum width {w.minimum:.2f} m{less}"
    )


def _print_shapes(out: Console, report: PassageReport, only: int | None) -> None:
    """Print what the passages mean for the footprint."""
    assert report.shapes is not None
    radius = f" and a turning radius of {report.turning_radius:g} m" if report.turning_radius else ""
    title = f"with this footprint{radius}"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("no.", justify="right", no_wrap=True)
    table.add_column("rating", no_wrap=True)
    table.add_column("headings at the opening (degrees)")
    for number, shape in enumerate(report.shapes, 1):
        if only is not None and number != only:
            continue
        detail = f" ({shape.changes})" if shape.changes else " (limit of the search)" if shape.limited else ""
        style = _SHAPE_STYLE[shape.verdict]
        table.add_row(str(number), f"[{style}]{VERDICT_TEXTS[shape.verdict]}{detail}[/]", heading_text(shape))
    out.print(table)
    counts = ", ".join(
        f"{number} {VERDICT_TEXTS[verdict]}" for verdict, number in report.shape_counts.items() if number
    )
    out.print(f"{counts or 'no openings'} {title}\n")


def heading_text(shape: ShapePassage) -> str:
    """Return the ranges of headings in degrees."""
    if not shape.headings:
        return "none"
    if shape.headings[0].high - shape.headings[0].low >= 2.0 * math.pi:
        return "any"
    return ", ".join(f"{math.degrees(r.low):.0f} to {math.degrees(r.high):.0f}" for r in shape.headings)
