"""`navstack info`: what is installed and what there is to choose from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer


def collect() -> dict[str, Any]:
    """Versions, plugins by kind, packaged maps, parameter sets, scenarios and suites."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from navstack import __version__
    from navstack.map_io import map_names
    from navstack.parameters import parameter_sets
    from navstack.plugins import REGISTRIES
    from navstack.scenario.suites.catalogue import shipped, suite_names

    versions = {"navstack": __version__, "python": platform.python_version()}
    for name in ("numpy", "numba", "scipy", "shapely", "matplotlib", "pydantic", "pillow", "pyyaml", "typer", "rich"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    plugins = {
        registry.kind: [
            {"name": entry.name, "aliases": list(entry.aliases), "origin": entry.origin} for entry in registry
        ]
        for registry in REGISTRIES
    }
    return {
        "versions": versions,
        "plugins": plugins,
        "maps": list(map_names()),
        "parameters": list(parameter_sets()),
        "scenarios": list(shipped()),
        "suites": suite_names(),
    }


def info(
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
    states: Path | None = typer.Option(
        None,
        "--states",
        metavar="FILE",
        help="Only this: the goal manager's state machine as a picture (.png, .svg, .pdf), or as a table (.md).",
    ),
) -> None:
    """Versions, registered plugins with their ROS names, packaged maps, parameter sets and scenarios."""
    from navstack.cli.output import print_json, stdout

    if states is not None:
        _write_states(states)
        document = {"states": str(states)}
        if json_:
            print_json(document)
        else:
            stdout().print(f"states: {states}", markup=False)
        return
    found = collect()
    if json_:
        print_json(found)
        return
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    out = stdout()
    out.print("  ".join(f"{name} {number}" for name, number in found["versions"].items()))
    table = Table("plugin", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("also known as", overflow="fold")
    for kind, entries in found["plugins"].items():
        table.add_row(f"[bold]{kind}[/]")
        for i, entry in enumerate(entries):
            foreign = [] if entry["origin"] == "navstack" else [f"(from {entry['origin']})"]
            names = "\n".join([*entry["aliases"], *foreign])
            table.add_row(f"  {entry['name']}", names, end_section=i == len(entries) - 1)
    out.print(table)
    for what in ("maps", "parameters", "scenarios", "suites"):
        out.print(f"{'parameter sets' if what == 'parameters' else what}: {', '.join(found[what])}", markup=False)


def _write_states(file: Path) -> None:
    from navstack.core.errors import OutputError
    from navstack.plot.canvas import FORMATS

    if file.suffix == ".md":
        from navstack.core.files import write_text
        from navstack.move_base.state_machine import document_markdown

        write_text(file, document_markdown())
    else:
        if file.suffix.lower() not in FORMATS:
            raise OutputError(
                f"cannot write {file.name}: its ending must be one of {', '.join(FORMATS)} for a picture, .md for a table",
                path=str(file),
            )
        from navstack.plot.states import plot_states

        plot_states(file)
