"""`navstack info`: list versions, plugins, maps, parameter sets and scenarios."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from navstack import __version__
from navstack.cli import options
from navstack.cli.output import print_files, print_json, print_note, stdout
from navstack.core import OutputError
from navstack.map_io import map_names
from navstack.parameters import packaged_sets
from navstack.plot import FORMATS
from navstack.plugins import REGISTRIES, unknown_groups
from navstack.scenario import shipped_scenarios, suite_names

_DEPENDENCIES = ("numpy", "numba", "scipy", "shapely", "matplotlib", "pydantic", "pillow", "pyyaml", "typer", "rich")


def collect() -> dict[str, Any]:
    """Versions, plugins by kind, packaged maps, parameter sets, scenarios and suites."""
    plugins = {
        registry.kind: [
            {"name": entry.name, "aliases": list(entry.aliases), "origin": entry.origin} for entry in registry
        ]
        for registry in REGISTRIES
    }
    return {
        "versions": _versions(),
        "plugins": plugins,
        "entry_points_without_effect": [text for _, text in unknown_groups()],
        "maps": list(map_names()),
        "parameters": packaged_sets(),
        "scenarios": list(shipped_scenarios()),
        "suites": suite_names(),
    }


def _versions() -> dict[str, str]:
    import platform

    versions = {"navstack": __version__, "python": platform.python_version()}
    for name in _DEPENDENCIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def info(
    json_: options.Json = False,
    states: Annotated[
        Path | None,
        typer.Option(
            "--states",
            metavar="FILE",
            help="Write only the goal manager's state machine: a picture (.png, .svg, .pdf) or a table (.md).",
        ),
    ] = None,
) -> None:
    """List versions, registered plugins with their ROS names, packaged maps, parameter sets, scenarios and suites."""
    if states is not None:
        _write_states(states)
        if json_:
            print_json({"states": str(states)})
        else:
            print_files({"states": str(states)})
        return
    found = collect()
    if json_:
        print_json(found)
    else:
        _print(found)


def _print(found: dict[str, Any]) -> None:
    out = stdout()
    out.print("  ".join(f"{name} {number}" for name, number in found["versions"].items()))
    table = Table("plugin", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("aliases", overflow="fold")
    for kind, entries in found["plugins"].items():
        table.add_row(f"[bold]{kind}[/]")
        for i, entry in enumerate(entries):
            foreign = [] if entry["origin"] == "navstack" else [f"(from {entry['origin']})"]
            names = "\n".join([*entry["aliases"], *foreign])
            table.add_row(f"  {entry['name']}", names, end_section=i == len(entries) - 1)
    out.print(table)
    for text in found["entry_points_without_effect"]:
        print_note(text)
    for what in ("maps", "parameters", "scenarios", "suites"):
        out.print(f"{'parameter sets' if what == 'parameters' else what}: {', '.join(found[what])}", markup=False)


def _write_states(file: Path) -> None:
    if file.suffix == ".md":
        from navstack.core import write_text
        from navstack.move_base import document_markdown

        write_text(file, document_markdown())
    elif file.suffix.lower() in FORMATS:
        from navstack.plot import plot_states

        plot_states(file)
    else:
        raise OutputError(
            f"cannot write {file.name}: the suffix must be one of {', '.join(FORMATS)} for a picture, or .md for a table",
            path=str(file),
        )
