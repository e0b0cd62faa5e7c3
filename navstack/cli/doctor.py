"""`navstack doctor`: why a robot drives badly, the fix, and what the fix changes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.arguments import map_of
from navstack.cli.output import counting_bar, loading_kernels, print_files, print_json, print_note, stdout, titled_table
from navstack.cli.search_options import Workers
from navstack.core import InputError, ensure_directory, write_json
from navstack.map_io import map_names
from navstack.parameters import load_configuration, overwrite, packaged_folder, packaged_sets, rewrite_parameters
from navstack.plot import plot_run
from navstack.scenario import load_places, warm_up
from navstack.studies import diagnose, make_drives, record_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from navstack.parameters import Configuration, RewrittenFiles
    from navstack.scenario import Scenario
    from navstack.studies import Diagnosis

_SHOWN = 5
"""Causes that are printed of those that do not help."""


def doctor(
    params: Annotated[
        str,
        typer.Argument(
            metavar="PARAMS",
            help="Packaged set, folder or file; several in loading order are separated by commas.",
            autocompletion=options.complete_params,
        ),
    ],
    map_: Annotated[
        str,
        typer.Argument(
            metavar="[MAP]",
            help="map_server YAML file, or name of a packaged map.",
            autocompletion=options.complete_map,
        ),
    ] = "office",
    set_: options.Set = [],
    distro: options.Distro = None,
    allow_missing: options.AllowMissing = False,
    seed: Annotated[
        int, typer.Option("--seed", help="Random seed of the noise, and of the drives on maps without places.", min=0)
    ] = 0,
    apply: Annotated[
        bool,
        typer.Option("--apply", help="Write the fix into the files; layout, key names and comments stay as they are."),
    ] = False,
    workers: Workers = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for the pictures, the diagnosis, and the parameters that your files cannot express.",
            callback=options.folder_only,
        ),
    ] = Path("navstack_doctor"),
    json_: options.Json = False,
) -> int:
    """Find out why a robot drives badly: check, passages, three drives, and the measured effect of each fix.

    Each possible cause is removed in turn, and the same drives are repeated. The fix that helps most is kept, and the others
    are measured on top of it.

    Exit codes: 0 every drive reached its goal without a contact, before or with the fix; 1 some did not; 2 invalid input.
    """
    sources = [part.strip() for part in params.split(",") if part.strip()]
    if not sources:
        raise InputError(f'PARAMS "{params}" names no parameters; give a name, a folder or a file', argument="PARAMS")
    if apply and (packaged := [name for name in sources if name in packaged_sets()]):
        raise InputError(
            f"--apply cannot change the packaged set {packaged[0]}; copy {packaged_folder(packaged[0])} and name the copy",
            argument="--apply",
        )
    path, grid = map_of(map_)
    configuration = load_configuration(sources, overrides=set_, distro=distro, allow_missing=allow_missing)
    places = load_places(map_) if map_ in map_names() else None
    drives = make_drives(grid, configuration, places, seed=seed)
    with loading_kernels(configuration.planner_names, quiet=json_):
        warm_up(drives[0])
    with counting_bar("drives", quiet=json_) as bar:
        found = diagnose(
            configuration, grid, drives, processes=workers, progress=lambda _what, done, total: bar(done, total)
        )
    files = _draw(found, drives, ensure_directory(out))
    if not json_:
        _print(found, configuration, sources, path.name)
    if found.settings:
        made = rewrite_parameters(sources, found.settings, overrides=set_, distro=distro, allow_missing=allow_missing)
        files |= _write(made, out, apply=apply, quiet=json_)
    elif apply:
        print_note("--apply: no fix helps, so nothing is written")
    files["diagnosis"] = str(out / "doctor.json")
    document = {"map": path.name, "params": sources, **found.as_dict(), "files": files}
    write_json(out / "doctor.json", document)
    if json_:
        print_json(document)
    else:
        print_files(files)
    return 0 if found.after.reached == len(drives) and not found.after.contacts else 1


def _draw(found: Diagnosis, drives: Sequence[Scenario], folder: Path) -> dict[str, str]:
    """Draw the worst drive as it is, and with the fixes."""
    rows = found.drives.rows
    worst = max(
        range(len(drives)), key=lambda k: (not rows[k]["reached"], rows[k]["turning_s"] + rows[k]["standing_s"])
    )
    if rows[worst]["state"] == "refused":
        return {}
    files = {"picture": str(plot_run(record_of(drives[worst]), folder / "before.png"))}
    if found.chosen:
        causes = [tried.cause for tried in found.chosen]
        files["picture with the fix"] = str(plot_run(record_of(drives[worst], causes), folder / "after.png"))
    return files


def _write(made: RewrittenFiles, folder: Path, *, apply: bool, quiet: bool) -> dict[str, str]:
    """Write the fixes into the user's files with `apply`, or else beside the pictures; return the files."""
    if apply and not made.overlay_reason:
        changed = made.changed_originals()
        overwrite(changed)
        return {f"changed {path.name}": str(path) for path in changed}
    saved = made.save(folder / "params")
    if not quiet:
        if apply:
            print_note(f"your files are not changed, because {made.overlay_reason}")
        stdout().print("with the fix: " + " ".join(f"--params {p}" for p in saved), markup=False)
    return {"parameters": str(folder / "params")}


# --- what is printed --------------------------------------------------------------------------------------------------


def _print(found: Diagnosis, configuration: Configuration, sources: Sequence[str], name: str) -> None:
    out = stdout()
    counts = [(sum(f.severity == s for f in configuration.findings), s) for s in ("error", "warning", "info")]
    shown = ", ".join(f"{n} {severity}{'' if n == 1 else 's'}" for n, severity in counts)
    out.print(f"check: {shown} (navstack check {' '.join(sources)} lists them)", markup=False)
    p = found.passages
    out.print(
        f"passages of {name}: {p.count('free')} passable, {p.count('costly')} at high cost, {p.count('blocked')} not "
        f"passable; the robot needs {p.widths.minimum:.2f} m",
        markup=False,
    )
    out.print(_drive_table(found.drives.rows))
    for number, row in enumerate(found.drives.rows, 1):
        if row["reason"]:
            out.print(f"drive {number}: {row['reason']}", markup=False)
    out.print()
    _print_diagnosis(out, found)


def _drive_table(rows: Sequence[Any]) -> Any:
    table = titled_table(
        "drives", left=("no.", "state"), right=("time", "driven", "turning in place", "standing", "contacts")
    )
    for number, row in enumerate(rows, 1):
        style = "green" if row["reached"] else "bold red"
        table.add_row(
            str(number),
            f"[{style}]{escape(row['state'])}[/]",
            f"{row['time_s']:.1f} s",
            f"{row['length_m']:.1f} m",
            f"{row['turning_s']:.1f} s",
            f"{row['standing_s']:.1f} s",
            str(row["collisions"]),
        )
    return table


def _print_diagnosis(out: Any, found: Diagnosis) -> None:
    if not found.chosen:
        count = len(found.ranked)
        fine = found.drives.reached == len(found.drives.rows) and not found.drives.contacts
        verdict = "every drive reached its goal" if fine else "the cause was not found"
        tried = f"none of {count} fixes" if count != 1 else "the only fix tried does not"
        out.print(f"[bold]diagnosis:[/] {verdict}, and {tried} makes the drives clearly better")
        if not fine:
            out.print("navstack tune --why shows the effect of every other parameter")
    for number, one in enumerate(found.chosen, 1):
        out.print(f"[bold]diagnosis {number}:[/] {escape(one.cause.text)}")
        out.print(f"  fix:    {one.cause.fix}", markup=False)
        out.print(f"  effect: {one.effect}", markup=False)
    made = [one.cause for one in found.chosen]
    others = [one for one in found.ranked if one.cause not in made]
    if others:
        out.print("[dim]also tried, each alone:[/]")
    for one in others[:_SHOWN]:
        out.print(f"  {one.cause.fix}: {one.effect}", markup=False, style="dim")
    if len(others) > _SHOWN:
        out.print(f"  and {len(others) - _SHOWN} with less effect", markup=False, style="dim")
