"""`navstack lattice`: motion primitives for smac_lattice."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from navstack.cli import options
from navstack.cli.options import file_in
from navstack.cli.output import print_files, print_json
from navstack.global_planner import generate_lattice, read_lattice, write_lattice

if TYPE_CHECKING:
    from navstack.global_planner import Lattice

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode="markdown", help="Generate and check motion primitives for smac_lattice."
)

MotionModel = Literal["ackermann", "diff", "omni"]
Picture = Annotated[
    Path | None,
    typer.Option("--picture", metavar="FILE|DIR", help="Also draw the primitives.", callback=file_in("primitives.png")),
]


@app.command("generate")
def generate(
    radius: Annotated[float, typer.Option("--radius", help="Turning radius (m).")] = 0.5,
    resolution: Annotated[float, typer.Option("--resolution", help="Cells of the costmap (m).")] = 0.05,
    headings: Annotated[int, typer.Option("--headings", help="Number of headings, a multiple of 8.")] = 16,
    motion_model: Annotated[
        MotionModel,
        typer.Option("--motion-model", help="ackermann: arcs and lines; diff: also turns in place; omni: also slides."),
    ] = "ackermann",
    stopping_threshold: Annotated[
        int, typer.Option("--stopping-threshold", help="Squares without a new end point after which the search ends.")
    ] = 5,
    distinctness: Annotated[
        float,
        typer.Option(
            "--distinctness", help="Share of its length by which a primitive differs from others; 0 keeps all."
        ),
    ] = 0.9,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="FILE|DIR", help="File to write, in Nav2's format.", callback=file_in("primitives.json")
        ),
    ] = Path("primitives.json"),
    picture: Picture = None,
    json_: options.Json = False,
) -> None:
    """Generate the motion primitives of a turning radius: the shortest ones, of which others are composed.

    The sets are those of Nav2's generator, and more where a heading would have no turn to the left or to the right.
    smac_lattice reads the file: `lattice_filepath: primitives.json`.
    """
    lattice = generate_lattice(
        radius,
        resolution,
        headings=headings,
        motion_model=motion_model,
        stopping_threshold=stopping_threshold,
        distinctness_ratio=distinctness,
    )
    files = {"primitives": str(write_lattice(lattice, out))}
    _report(lattice, files, picture, json_=json_)


@app.command("check")
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Primitive file in Nav2's format (JSON).")],
    picture: Picture = None,
    json_: options.Json = False,
) -> None:
    """Check a primitive file: keys, ranges, ends on whole cells, arcs not below the turning radius. Prints what it contains.

    Warns of headings from which the robot cannot turn. Exit codes: 0 it can be used, 2 it cannot; the message has file and line.
    """
    _report(read_lattice(file), {}, picture, json_=json_)


def _report(lattice: Lattice, files: dict[str, str], picture: Path | None, *, json_: bool) -> None:
    if picture is not None:
        from navstack.plot import plot_lattice

        files["picture"] = str(plot_lattice(lattice, picture))
    driven = [p for p in lattice.primitives if p.length > 0.0]
    radii = [p.radius for p in driven if p.radius > 0.0]
    straight_on = [math.degrees(lattice.headings[k]) for k in lattice.headings_without_turns]
    facts = {
        "motion_model": lattice.motion_model,
        "turning_radius": lattice.turning_radius,
        "resolution": lattice.resolution,
        "headings": len(lattice.headings),
        "primitives": len(lattice.primitives),
        "turns_in_place": len(lattice.primitives) - len(driven),
        "shortest_m": min((p.length for p in driven), default=0.0),
        "longest_m": max((p.length for p in driven), default=0.0),
        "smallest_radius_m": min(radii, default=0.0),
        "headings_without_turns": straight_on,
    }
    if json_:
        print_json({**facts, "files": list(files.values())})
        return
    turns = f", {facts['turns_in_place']} of them turns in place" if facts["turns_in_place"] else ""
    arcs = f", arcs of {facts['smallest_radius_m']:.3f} m and more" if radii else ""
    print(
        f"{lattice.motion_model}, turning radius {lattice.turning_radius:g} m, cells of {lattice.resolution:g} m: "
        f"{len(lattice.primitives)} primitives from {len(lattice.headings)} headings{turns}; {facts['shortest_m']:.3f} to "
        f"{facts['longest_m']:.3f} m long{arcs}"
    )
    if straight_on:
        degrees = ", ".join(f"{yaw:.1f}" for yaw in straight_on)
        print(
            f"warning: from headings {degrees} degrees no primitive turns left, or none right; generate the file with "
            "`navstack lattice generate`, which goes on until there are some"
        )
    print_files(files)
