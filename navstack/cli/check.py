"""`navstack check`: every finding about parameters, with file, line and column."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import typer

SEVERITY_STYLE = {"error": "bold red", "warning": "yellow", "info": "cyan"}


def check(
    params: list[str] = typer.Argument(
        ...,
        help="A packaged set, a folder, or files in the order of loading; or one scenario file, or the name of a shipped one.",
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter."),
    distro: str | None = typer.Option(None, "--distro", help="noetic or indigo: which scoring scale is meant."),
    strict: bool = typer.Option(False, "--strict", help="Warnings are errors."),
    allow_missing: bool = typer.Option(
        False, "--allow-missing", help="Leave out layers and plugins that are not here."
    ),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> int:
    """Load parameters, or a scenario file with its parameters, and say everything that can be said about them."""
    from navstack.cli.output import print_json, stdout
    from navstack.parameters.configuration import check_parameters
    from navstack.scenario.file.spec import check_scenario

    file = _scenario(params[0]) if len(params) == 1 else None
    if file is not None:
        findings = check_scenario(file, overrides=set_, distro=distro, allow_missing=allow_missing)
    else:
        findings = check_parameters(params, overrides=set_, distro=distro, allow_missing=allow_missing)
    if strict:
        findings = [replace(f, severity="error") if f.severity == "warning" else f for f in findings]
    errors = sum(f.severity == "error" for f in findings)
    if json_:
        print_json({"findings": [f.as_dict() for f in findings]})
        return 2 if errors else 0
    from rich.markup import escape

    out = stdout()
    for f in findings:
        style = SEVERITY_STYLE[f.severity]
        out.print(
            f"{escape(str(f.location))}: [{style}]{f.severity}[/]: {escape(f.message)} [dim]({escape(f.rule)})[/]"
        )
        if f.suggestion:
            out.print(f"    [dim]->[/] {escape(f.suggestion)}")
    warnings = sum(f.severity == "warning" for f in findings)
    counts = ((errors, "error"), (warnings, "warning"), (len(findings) - errors - warnings, "note"))
    out.print(", ".join(f"{n} {what}{'' if n == 1 else 's'}" for n, what in counts))
    return 2 if errors else 0


def _scenario(name: str) -> Path | None:
    """The scenario file of that path, or of that name among the shipped ones where nothing else has it; None: no scenario."""
    from navstack.core.files import exists
    from navstack.parameters.sources import packaged_sets
    from navstack.scenario.file.spec import is_scenario_file

    path = Path(name)
    if is_scenario_file(path):
        return path
    if exists(path) or name in packaged_sets():
        return None
    from navstack.scenario.suites.catalogue import shipped

    return shipped().get(name)
