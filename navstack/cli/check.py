"""`navstack check`: report every problem of parameters or a scenario, with file, line and column."""

from __future__ import annotations

from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.output import print_json, print_note, stdout
from navstack.core import InputError, is_file
from navstack.fleet import is_fleet_file, shipped_fleets
from navstack.parameters import check_parameters, fix_keys, packaged_sets
from navstack.scenario import is_scenario_file, shipped_scenarios

if TYPE_CHECKING:
    from navstack.parameters import Finding, KeyFixes


class Severity(StrEnum):
    """Lowest severity that is printed."""

    error = "error"
    warning = "warning"
    info = "info"


_LARGEST_SOURCE = 10_000_000
"""Size of the largest file that is shown (bytes)."""
_EXCERPT = 100
"""Length of the part of a line that is shown (characters)."""
SEVERITY_STYLE = {"error": "bold red", "warning": "yellow", "info": "cyan"}


def check(
    params: Annotated[
        list[str],
        typer.Argument(
            metavar="PARAMS..|SCENARIO.yaml",
            help="Packaged set, folder, or files in loading order; or one scenario file, or the name of a packaged one.",
            autocompletion=options.complete_params,
        ),
    ],
    set_: options.Set = [],
    distro: options.Distro = None,
    strict: Annotated[bool, typer.Option("--strict", help="Treat warnings as errors.")] = False,
    severity: Annotated[
        Severity, typer.Option("--severity", help="Print findings of at least this severity.")
    ] = Severity.info,
    allow_missing: options.AllowMissing = False,
    fix: Annotated[
        bool,
        typer.Option(
            "--fix", help="Correct renamed and misspelt keys in the files; layout and comments stay as they are."
        ),
    ] = False,
    diff: Annotated[bool, typer.Option("--diff", help="Only show what --fix would change, as a unified diff.")] = False,
    json_: options.Json = False,
) -> int:
    """Check parameters or a scenario file, and report every finding with file, line and column.

    Exit codes: 0 no errors, 2 errors; with --fix those that remain.
    """
    document: dict[str, Any] = {}
    if fix or diff:
        fixes = _fixes(params, set_, distro, allow_missing)
        if not diff:
            fixes.save()
        findings = list(fixes.findings)
        document = _document(fixes)
        if not json_:
            _print_fixes(fixes, diff=diff)
    else:
        findings = _findings(params, set_, distro, allow_missing)
    if strict:
        findings = [replace(f, severity="error") if f.severity == "warning" else f for f in findings]
    ranks = list(SEVERITY_STYLE)
    shown = [f for f in findings if ranks.index(f.severity) <= ranks.index(severity.value)]
    if json_:
        print_json({**document, "findings": [f.as_dict() for f in shown]})
    elif not diff:
        _print(shown)
    return 2 if any(f.severity == "error" for f in findings) else 0


def _fixes(params: list[str], overrides: list[str], distro: str | None, allow_missing: bool) -> KeyFixes:
    if len(params) == 1 and _scenario(params[0]) is not None:
        raise InputError(f"--fix corrects parameter files, but {params[0]} is a scenario; name its parameters")
    return fix_keys(params, overrides=overrides, distro=distro, allow_missing=allow_missing)


def _document(fixes: KeyFixes) -> dict[str, Any]:
    return {"fixes": [asdict(f) for f in fixes.fixes], "kept": [asdict(k) for k in fixes.kept], "diff": fixes.diff()}


def _print_fixes(fixes: KeyFixes, *, diff: bool) -> None:
    """Prints the corrections (or the diff), and to stderr why other keys stay."""
    out = stdout()
    if diff:
        out.print(fixes.diff(), markup=False, end="")
        if not fixes.fixes:
            print_note("no key would be corrected; without --diff, check lists the findings")
    else:
        for one in fixes.fixes:
            out.print(one.text, markup=False)
        count, files = len(fixes.fixes), len(fixes.texts)
        out.print(f"{count} key{'' if count == 1 else 's'} corrected in {files} file{'' if files == 1 else 's'}")
    for key in fixes.kept:
        print_note(f"{key.file}:{key.line}: {key.old} is not changed: {key.reason}")


def _findings(params: list[str], overrides: list[str], distro: str | None, allow_missing: bool) -> list[Finding]:
    fleet = _fleet(params[0]) if len(params) == 1 else None
    if fleet is not None:
        from navstack.fleet import check_fleet

        return check_fleet(fleet)
    file = _scenario(params[0]) if len(params) == 1 else None
    if file is not None:
        from navstack.scenario import check_scenario  # takes 0.15 s: only for scenarios

        return check_scenario(file, overrides=overrides, distro=distro, allow_missing=allow_missing)
    return check_parameters(params, overrides=overrides, distro=distro, allow_missing=allow_missing)


def _print(findings: list[Finding]) -> None:
    out = stdout()
    for f in findings:
        style = SEVERITY_STYLE[f.severity]
        out.print(
            f"{escape(str(f.location))}: [{style}]{f.severity}[/]: {escape(f.message)} [dim]({escape(f.rule)})[/]"
        )
        for line in source_excerpt(f):
            out.print(line, markup=False, style="dim")
        if f.suggestion:
            out.print(f"    [dim]->[/] {escape(f.suggestion)}")
    counts = [(sum(f.severity == severity for f in findings), severity) for severity in SEVERITY_STYLE]
    out.print(", ".join(f"{n} {severity}{'' if n == 1 else 's'}" for n, severity in counts))


def _fleet(name: str) -> Path | None:
    """The fleet file of that path, or the packaged fleet of that name; None if the name means something else."""
    path = Path(name)
    if is_file(path):
        return path if is_fleet_file(path) else None
    return None if name in packaged_sets() else shipped_fleets().get(name)


def _scenario(name: str) -> Path | None:
    """The scenario file of that path, or the packaged scenario of that name; None if the name means parameters."""
    path = Path(name)
    if is_scenario_file(path):
        return path
    if is_file(path) or name in packaged_sets():
        return None

    return shipped_scenarios().get(name)


def source_excerpt(found: Finding) -> list[str]:
    """The line of a finding and a caret under its column; empty if the line cannot be read."""
    path = Path(found.file)
    if not found.line or not path.is_file() or path.stat().st_size > _LARGEST_SOURCE:
        return []
    lines = path.read_text("utf-8", errors="replace").splitlines()
    if found.line > len(lines):
        return []
    text = lines[found.line - 1]
    begin = max(0, found.column - 1 - _EXCERPT // 2)
    shown = "".join(c if c.isprintable() else " " for c in text[begin : begin + _EXCERPT])
    caret = [" " * (5 + max(0, found.column - 1 - begin)) + "^"] if found.column else []
    return [f"     {shown}", *caret]
