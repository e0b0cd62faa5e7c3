"""Options that several commands share, and groups of options that a command takes as one argument."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, get_type_hints

import typer

from navstack.core import InputError, OutputError, check_writable, ensure_directory, is_dir
from navstack.map_io import map_names
from navstack.parameters import NAV2_DISTROS, packaged_sets
from navstack.plot import FORMATS, paper_style

# ----------------------------------------------------------------------------------------------------------------------
# The rule of `--out` in all commands: a name with a suffix is a file, otherwise a folder.


# a letter first: `runs/speed_0.5` and `results.v2.1` are folders
_SUFFIX: Final = re.compile(r"\.[A-Za-z][A-Za-z0-9]*\Z")


def names_a_file(out: Path) -> bool:
    """True for a name with a suffix that is not an existing folder."""
    return _SUFFIX.match(out.suffix) is not None and not is_dir(out)


def file_in(default: str) -> Callable[[Path | None], Path | None]:
    """Checks and completes `--out` of a command that writes one file: in a folder, the file is called `default`."""

    def complete(out: Path | None) -> Path | None:
        if out is None:
            return None
        return check_writable(out if names_a_file(out) else out / default)

    return complete


def folder_only(out: Path | None) -> Path | None:
    """Checks `--out` of a command that writes several files. Raises OutputError for the name of a file."""
    if out is not None and names_a_file(out):
        raise OutputError(
            f"--out {out} names a file, but the command writes several files; name a folder, without a suffix: "
            f"{out.with_suffix('')}",
            path=str(out),
        )
    return writable(out)


def writable(out: Path | None) -> Path | None:
    """Checks, before the work, that `--out` can be written. Raises OutputError."""
    return None if out is None else check_writable(out)


def chosen_files(out: Path, products: Mapping[str, str]) -> dict[str, Path]:
    """The files that `--out` asks for, of a command with several products (what -> default file name).

    In a folder: all of them. A name with a suffix asks for the product of that kind only. Raises OutputError for a suffix
    that no product has.
    """
    if not names_a_file(out):
        folder = ensure_directory(out)
        return {what: folder / name for what, name in products.items()}
    formats = {what: _formats(name) for what, name in products.items()}
    for what, suffixes in formats.items():
        if out.suffix.lower() in suffixes:
            ensure_directory(out.parent)
            return {what: out}
    known = "; ".join(f"{', '.join(suffixes)} for the {what}" for what, suffixes in formats.items())
    raise OutputError(
        f"cannot write {out.name}: the suffix must be {known}; a name without a suffix is a folder for all of them",
        path=str(out),
    )


def _formats(name: str) -> tuple[str, ...]:
    suffix = Path(name).suffix
    return FORMATS if suffix in FORMATS else (suffix,)


def _starting_with(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def complete_params(incomplete: str) -> list[str]:
    """Packaged parameter sets, for shell completion; other words are completed as files by the shell."""
    return _starting_with(packaged_sets(), incomplete)


def complete_map(incomplete: str) -> list[str]:
    """Packaged maps, for shell completion."""
    return _starting_with(map_names(), incomplete)


def complete_distro(incomplete: str) -> list[str]:
    """Distributions, for shell completion."""
    return _starting_with(["noetic", "indigo", *NAV2_DISTROS], incomplete)


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


def _set_texts(values: list[str]) -> list[str]:
    """Mark the values as those of `--set`, for messages."""
    from navstack.parameters import SetText

    return [SetText(value) for value in values]


Set = Annotated[
    list[str],
    typer.Option("--set", metavar="KEY=VALUE", help="Override a parameter (repeatable).", callback=_set_texts),
]
Distro = Annotated[
    str | None,
    typer.Option(
        "--distro",
        metavar="NAME",
        help="Distribution of the parameters. move_base: noetic, or indigo for DWA weights of releases before 2018. Nav2: "
        f"{', '.join(NAV2_DISTROS)}. [default: ros_distro of the parameters; Nav2: by the keys]",
        autocompletion=complete_distro,
    ),
]
AllowMissing = Annotated[
    bool,
    typer.Option(
        "--allow-missing",
        "--substitute",
        help="Skip layers and plugins that are not installed; for a controller or planner (TEB, SBPL, ..), another stands in.",
    ),
]

# maps and poses
Map = Annotated[
    str,
    typer.Argument(
        metavar="MAP.yaml", help="map_server YAML file, or name of a packaged map.", autocompletion=complete_map
    ),
]
Start = Annotated[
    str | None,
    typer.Option(
        "--start", metavar="X,Y[,YAW]|PLACE", help="Start pose in the map frame (m, rad), or a place of the map."
    ),
]
Footprint = Annotated[
    str | None,
    typer.Option(
        "--footprint",
        metavar="LENGTHxWIDTH|POINTS",
        help="Footprint (m): a box such as 1.2x0.7 around the center, or points [[x,y],..]. [default: of the parameters]",
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
def _last_run() -> Path:
    from navstack.cli.last_run import last_run

    return last_run()


RunFolder = Annotated[
    Path,
    typer.Argument(
        metavar="RUN",
        help="Folder of a recorded run, or its run.npz. [default: the last run]",
        default_factory=_last_run,
        show_default=False,
    ),
]
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


def _draw_in(context: typer.Context, style: str) -> str:
    """Let the command draw its pictures in a style, until it ends. Raises InputError for an unknown one."""
    if style not in ("screen", "paper"):
        raise InputError(f'--style "{style}": unknown style; choose screen or paper', argument="--style", value=style)
    if style == "paper":
        context.with_resource(paper_style())
    return style


Style = Annotated[
    str,
    typer.Option(
        "--style",
        metavar="screen|paper",
        help="Style of the picture; paper: one column wide (89 mm), white, small text, no title; best as .pdf or .svg.",
        callback=_draw_in,
    ),
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
        callback=writable,
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
