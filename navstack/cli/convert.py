"""`navstack params convert`: a move_base robot's parameters for Nav2, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.output import print_json, print_note, stdout
from navstack.core import InputError, resolved
from navstack.parameters import nearest, to_move_base, to_nav2

if TYPE_CHECKING:
    from navstack.parameters import Conversion

TARGETS: Final = ("nav2", "move_base")
DEFAULT_DISTRO: Final = "jazzy"
SUITE: Final = "office"
_LISTED: Final = 12
"""Keys of a kind that are printed."""
_FEW: Final = 6
"""Scenarios below which an interval is wide."""


class Verification(NamedTuple):
    """The drives with the files before and after."""

    verify: Annotated[
        bool, typer.Option("--verify", help="Drive a suite with both, and print what differs beyond the noise.")
    ] = False
    suite: Annotated[
        str,
        typer.Option(
            "--suite",
            metavar="NAME",
            help="Suite for --verify: office, narrow, crowd, warehouse, circle_crossing or shipped.",
        ),
    ] = SUITE
    scenarios: Annotated[
        int | None, typer.Option("--count", metavar="N", min=1, help="Number of scenarios of the suite.")
    ] = None
    seeds: Annotated[int, typer.Option("--seeds", metavar="N", min=1, help="Runs per scenario and side.")] = 1
    processes: Annotated[
        int | None,
        typer.Option("--processes", metavar="N", min=1, help="Number of parallel runs; all cores by default."),
    ] = None


@options.with_options(verification=Verification)
def convert(
    params: options.ParamsArgument,
    to: Annotated[str, typer.Option("--to", metavar="nav2|move_base", help="What the files are for.")],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="New folder for the files.", callback=options.folder_only),
    ],
    distro: Annotated[
        str | None,
        typer.Option(
            "--distro",
            metavar="NAME",
            help="Distribution of Nav2: foxy to lyrical. [default: to nav2: jazzy; to move_base: found from the keys]",
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace the files of an earlier conversion in --out.")
    ] = False,
    set_: options.Set = [],
    allow_missing: options.AllowMissing = False,
    json_: options.Json = False,
    *,
    verification: Verification,
) -> int:
    """Convert a robot's parameters from move_base to Nav2 or back: YAML, behavior tree, and a report of every key.

    With --verify, exit code 1 means that a run of the verification gave no result.
    """
    if to not in TARGETS:
        close = nearest(to, TARGETS)
        hint = f"did you mean {close}?" if close else f"known: {', '.join(TARGETS)}"
        raise InputError(f'--to "{to}" is no target; {hint}', argument="--to", value=to)
    if to == "nav2":
        folder = resolved(out)
        made = to_nav2(params, distro or DEFAULT_DISTRO, str(folder), overrides=set_, allow_missing=allow_missing)
    else:
        made = to_move_base(params, distro=distro, overrides=set_, allow_missing=allow_missing)
    files = made.save(out, force=force)
    if json_ and not verification.verify:
        print_json(
            {"target": made.target, "changes": [c.as_dict() for c in made.changes], "files": [str(f) for f in files]}
        )
        return 0
    if not json_:
        _print(made, files)
    return _verify(made, params, set_, out, verification, json_=json_) if verification.verify else 0


def _print(made: Conversion, files: Sequence[Path]) -> None:
    out = stdout()
    out.print(f"{made.target}: {made.counts()}", markup=False)
    for kind, title in (("nearest", "replaced by the nearest"), ("no counterpart", "without counterpart")):
        found = made.of_kind(kind)  # type: ignore[arg-type]
        if found:
            out.print(f"[bold]{title}[/]")
        for c in found[:_LISTED]:
            target = f" -> {c.target}" if c.target else ""
            out.print(f"  {escape(f'{c.origin}: {c.source}{target}: {c.note}')}", soft_wrap=True, highlight=False)
        if len(found) > _LISTED:
            out.print(f"  and {len(found) - _LISTED} more, all of them in conversion.md")
    for file in files:
        out.print(str(file), markup=False, soft_wrap=True)


def _verify(
    made: Conversion, params: Sequence[str], set_: Sequence[str], out: Path, wanted: Verification, *, json_: bool
) -> int:
    """Drive the suite with the user's files (A) and with the written ones (B); the exit code."""
    from navstack.cli.bench.execution import BenchOutput
    from navstack.studies import CompareTask, ParameterSet, for_workers, read_scenarios

    sets = {
        "A": ParameterSet(tuple(for_workers(p) for p in params), tuple(set_)),
        "B": ParameterSet(tuple(str(resolved(out / name)) for name in made.params)),
    }
    task = CompareTask(sets, tuple(read_scenarios([], wanted.suite, wanted.scenarios)), wanted.seeds)
    code, report = BenchOutput(json_=json_).reported(task, processes=wanted.processes)
    for note in verification_notes(report.document["runs"], report.document["measures"].rows):
        print_note(note)
    return code


def verification_notes(runs: Sequence[Mapping[str, Any]], rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what a comparison of the user's robot (A) with the converted one (B) shows.

    `runs` have a scenario and for both robots whether they succeeded, `rows` are measures with their difference. A rank test
    shows nothing with fewer than six scenarios; here a difference missed is worse than one too many, so intervals decide.
    """
    notes: list[str] = []
    failed = sum(run["A"]["success"] and not run["B"]["success"] for run in runs)
    gained = sum(run["B"]["success"] and not run["A"]["success"] for run in runs)
    changed = [_change_of(row) for row in rows if row["difference"].excludes_zero]
    if failed:
        also = f", and succeeds in {gained} in which it fails" if gained else ""
        notes.append(
            f"the converted robot fails in {failed} of {len(runs)} drives in which the original succeeds{also}"
        )
    elif gained:
        notes.append(f"the converted robot succeeds in {gained} of {len(runs)} drives in which the original fails")
    if changed:
        notes.append(f"the conversion changes the drive beyond the noise: {'; '.join(changed)}")
    elif not failed and not gained:
        few = len({run["scenario"] for run in runs}) < _FEW
        hint = f"; with fewer than {_FEW} scenarios only large differences show, so give --count" if few else ""
        notes.append(f"no measure of the drive differs beyond the noise{hint}")
    return notes


def _change_of(row: Mapping[str, Any]) -> str:
    """A measure with its difference and the interval; three digits also where the last ones are 0."""
    difference = row["difference"].interval
    before, after = (f"{row[side].value:#.3g}".rstrip(".") for side in "ab")
    return f"{row['measure']} {before} -> {after} (by {difference.text(3)})"
