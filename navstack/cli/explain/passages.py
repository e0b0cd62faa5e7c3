"""`navstack explain passages`: the doors and corridors that a robot can pass."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from navstack.cli import options
from navstack.cli.arguments import footprint_overrides, map_of, parse_costmap_name
from navstack.cli.options import chosen_files
from navstack.cli.output import counting_bar, print_files, print_json, print_note, stdout
from navstack.core import write_json
from navstack.explain import find_passages, print_passages
from navstack.parameters import load_configuration
from navstack.plot import plot_passage_report
from navstack.record import RUN_FILE, Record
from navstack.scenario import Scenario

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid
    from navstack.explain import PassageReport
    from navstack.parameters import Configuration

MOSTLY_UNKNOWN = 0.9
"""Share of unknown cells on the border of free space above which the walls of a map are considered unknown."""


class PassageOptions(NamedTuple):
    """Map, robot and the passages to find."""

    map_: Annotated[
        str,
        typer.Argument(
            metavar="MAP.yaml|RUN",
            help="map_server YAML file, name of a packaged map, or recorded run: its map and parameters.",
            autocompletion=options.complete_map,
        ),
    ]
    params: options.Params = []
    set_: options.Set = []
    footprint: options.Footprint = None
    turning_radius: Annotated[
        float | None,
        typer.Option(
            "--turning-radius",
            metavar="M",
            help="Search ways through for a robot with this turning radius (m). [default: that of base and controller]",
            min=0.0,
        ),
    ] = None
    costmap: options.CostmapName = "global"
    narrowest: Annotated[
        float | None,
        typer.Option(
            "--narrowest", metavar="M", help="Least width to report (m). [default: the inscribed radius]", min=0.0
        ),
    ] = None
    widest: Annotated[
        float | None,
        typer.Option(
            "--widest",
            metavar="M",
            help="Largest width to report (m). [default: where inflation ends, at least 1.25 m and 1.5 times the turning width]",
            min=0.0,
        ),
    ] = None
    smallest_obstacle: Annotated[
        float,
        typer.Option(
            "--smallest-obstacle",
            metavar="M",
            help="Leave out gaps next to smaller free-standing obstacles (m), which the robot can drive around.",
            min=0.0,
        ),
    ] = 0.0
    unknown: Annotated[
        bool, typer.Option("--unknown", help="Treat unknown space as walls, for maps whose walls are unknown cells.")
    ] = False


@options.with_options(chosen=PassageOptions)
def passages(
    chosen: PassageOptions,
    out: Annotated[Path | None, options.both_files("passages.png", "passages.json")] = None,
    json_: options.Json = False,
) -> None:
    """List the doors, corridors and gaps between obstacles of a map: passable, passable at high cost, or not passable.

    For a robot that is not round: at which headings it passes, and, with a turning radius, with how many changes of direction.
    """
    name = parse_costmap_name(chosen.costmap)
    path, grid, configuration = _opened(chosen)
    with counting_bar("openings", quiet=json_) as progress:
        report = find_passages(
            configuration,
            grid,
            costmap=name,
            narrowest=chosen.narrowest,
            widest=chosen.widest,
            smallest_obstacle=chosen.smallest_obstacle,
            unknown_is_wall=chosen.unknown,
            turning_radius=chosen.turning_radius,
            progress=progress,
        )
    document = _document(report, path.name)
    if out is not None:
        document["files"] = _write(report, document, path.stem, out)
    if not chosen.unknown:
        _note_unknown_walls(report, path.name)
    if json_:
        print_json(document)
    else:
        print_passages(stdout(), report, path.name)
        print_files(document.get("files", {}))


def _opened(chosen: PassageOptions) -> tuple[Path, OccupancyGrid, Configuration]:
    """Return file, map and parameters, for a run those of its record."""
    overrides = [*chosen.set_, *footprint_overrides(chosen.footprint)]
    path = Path(chosen.map_)
    if path.suffix != ".npz" and not path.joinpath(RUN_FILE).is_file():
        path, grid = map_of(chosen.map_)
        return path, grid, load_configuration(chosen.params or ["turtlebot"], overrides=overrides)
    scenario = Scenario.from_record(Record.load(path))
    recorded = scenario.configuration
    if chosen.params or overrides:
        sources = chosen.params or [recorded.tree.as_dict()]
        return path, scenario.map, load_configuration(sources, overrides=overrides)
    return path, scenario.map, recorded


def _document(report: PassageReport, name: str) -> dict[str, Any]:
    document: dict[str, Any] = {"map": name, **report.as_dict()}
    for number, entry in enumerate(document["passages"], 1):
        entry["number"] = number
    return document


def _write(report: PassageReport, document: dict[str, Any], name: str, out: Path) -> dict[str, str]:
    """Writes picture and document, or the one that is asked for; returns the names of the files."""
    chosen = chosen_files(out, {"picture": "passages.png", "passages": "passages.json"})
    files = {what: str(file) for what, file in chosen.items()}
    if "picture" in chosen:
        plot_passage_report(report, chosen["picture"], name=name)
    if "passages" in chosen:
        write_json(chosen["passages"], {**document, "files": files})
    return files


def _note_unknown_walls(report: PassageReport, name: str) -> None:
    if report.unknown_border > MOSTLY_UNKNOWN:
        print_note(
            f"{100.0 * report.unknown_border:.0f} % of the cells that border free space in {name} are unknown, not "
            "occupied, so no layer inflates them; --unknown treats them as walls"
        )
