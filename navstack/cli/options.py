"""Options that several commands share, and groups of options that a command takes as one argument."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from navstack.cli.out_path import file_in, folder_only


def _starting_with(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def complete_params(incomplete: str) -> list[str]:
    """Packaged parameter sets, for shell completion; other words are completed as files by the shell."""
    from navstack.parameters import packaged_sets

    return _starting_with(packaged_sets(), incomplete)


def complete_map(incomplete: str) -> list[str]:
    """Packaged maps, for shell completion."""
    from navstack.map_io import map_names

    return _starting_with(map_names(), incomplete)


PARAMS_HELP = "Packaged set, folder, or files in loading order (repeatable)."

# parameters
Params = Annotated[
    list[str],
    typer.Option("--params", metavar="NAME|DIR|FILE", help=PARAMS_HELP, autocompletion=complete_params),
]
ParamsOrScenario = Annotated[
    list[str],
    typer.Option(
        "--params",
        metavar="NAME|DIR|FILE",
        help=f"{PARAMS_HELP} [default: turtlebot, or those of the scenario]",
        show_default=False,
        autocompletion=complete_params,
    ),
]
ParamsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="PARAMS..", help="Packaged set, folder, or files in loading order.", autocompletion=complete_params
    ),
]
Set = Annotated[list[str], typer.Option("--set", metavar="KEY=VALUE", help="Override a parameter (repeatable).")]
Distro = Annotated[
    str | None,
    typer.Option(
        "--distro",
        metavar="noetic|indigo",
        help="DWA cost scaling: as in noetic, or as in indigo (releases before 2018). [default: ros_distro of the parameters]",
    ),
]
AllowMissing = Annotated[bool, typer.Option("--allow-missing", help="Skip layers and plugins that are not installed.")]

# maps and poses
Map = Annotated[
    str,
    typer.Argument(
        metavar="MAP.yaml", help="map_server YAML file, or name of a packaged map.", autocompletion=complete_map
    ),
]
Start = Annotated[
    str | None, typer.Option("--start", metavar="X,Y[,YAW]", help="Start pose in the map frame (m, rad).")
]
Footprint = Annotated[
    str | None,
    typer.Option(
        "--footprint",
        metavar="LENGTHxWIDTH|POINTS",
        help="Footprint (m): a box such as 1.2x0.7 around the centre, or points [[x,y],..]. [default: of the parameters]",
    ),
]
Obstacles = Annotated[
    list[str],
    typer.Option(
        "--obstacle",
        metavar="X,Y,R[,low]",
        help="Add a round obstacle that is not on the map (m); `low`: only bumpers and low lidars detect it (repeatable).",
    ),
]

# records
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a recorded run, or its run.npz.")]
Time = Annotated[
    float | None, typer.Option("--time", metavar="T", help="Time in the run (s). [default: the end of the run]")
]
CostmapName = Annotated[str, typer.Option("--costmap", metavar="global|local", help="Costmap to use: global or local.")]

# output
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document to stdout.")]
RunOutput = Annotated[
    Path,
    typer.Option("--out", metavar="DIR", help="Output folder: record, log, summary and picture.", callback=folder_only),
]


def picture_file(default: str) -> Any:
    """`--out` of a command that draws a picture; in a folder it is called `default`."""
    return typer.Option(
        "--out",
        metavar="FILE|DIR",
        help=f"Write a picture (.png, .svg or .pdf); in a folder: {default}.",
        callback=file_in(default),
    )


def text_file(default: str) -> Any:
    """`--out` of a command that writes a text; in a folder the file is called `default`."""
    return typer.Option(
        "--out",
        metavar="FILE|DIR",
        help=f"Write to this file; in a folder: {default}. [default: print to stdout]",
        callback=file_in(default),
    )


def both_files(picture: str, document: str) -> Any:
    """`--out` of a command that writes a picture and a document: one of them, or both in a folder."""
    return typer.Option(
        "--out",
        metavar="DIR|FILE",
        help=f"Folder for {picture} and {document}; or one file: a picture (.png, .svg, .pdf) or the document (.json).",
    )


def with_options(**groups: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Adds the options of NamedTuple classes to a command.

    Each keyword names an argument of the command, its value the class. typer sees one option per field of the class, in
    the place of the argument; the command receives an instance. Fields are annotated as parameters of a command are:
    `json_: options.Json = False`.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        expanded: list[inspect.Parameter] = []
        for parameter in inspect.signature(command, eval_str=True).parameters.values():
            group = groups.get(parameter.name)
            if group is None:
                expanded.append(parameter)
                continue
            hints = get_type_hints(group, include_extras=True)
            expanded += [p.replace(annotation=hints[p.name]) for p in inspect.signature(group).parameters.values()]

        @functools.wraps(command)
        def combined(**values: Any) -> Any:
            made = {
                name: group(**{field: values.pop(field) for field in group._fields}) for name, group in groups.items()
            }
            return command(**made, **values)

        parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in expanded]
        combined.__dict__["__signature__"] = inspect.Signature(parameters)
        combined.__annotations__ = {p.name: p.annotation for p in parameters}
        return combined

    return decorate
