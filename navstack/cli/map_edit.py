"""`navstack map edit` and `navstack map merge`: change maps, and join two."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from navstack.behaviors import parse_angle
from navstack.cli import options
from navstack.cli.arguments import map_of, parse_numbers
from navstack.cli.options import file_in
from navstack.cli.output import print_files, print_json, print_note
from navstack.core import InputError, OccupancyGrid, Transform2D
from navstack.map_io import save_map
from navstack.mapping import (
    align,
    compare,
    crop,
    fill_holes,
    keepout_mask,
    merged,
    paint,
    remove_specks,
    rotate,
    wall_direction,
)

Out = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="FILE|DIR",
        help="Map to write: a YAML file, and a pgm image next to it; in a folder: map.yaml.",
        callback=file_in("map.yaml"),
    ),
]
Polygons = "(GeoJSON polygons in m, map frame; repeatable)."


def edit(
    map_: options.Map,
    out: Out,
    occupied: Annotated[
        list[Path], typer.Option("--occupied", metavar="FILE", help=f"Areas to make occupied {Polygons}")
    ] = [],
    free: Annotated[list[Path], typer.Option("--free", metavar="FILE", help=f"Areas to make free {Polygons}")] = [],
    unknown: Annotated[
        list[Path], typer.Option("--unknown", metavar="FILE", help=f"Areas to make unknown {Polygons}")
    ] = [],
    remove: Annotated[
        float | None,
        typer.Option("--remove-specks", metavar="M2", help="Remove groups of occupied cells smaller than this (m²)."),
    ] = None,
    fill: Annotated[
        float | None,
        typer.Option("--fill", metavar="M2", help="Fill unknown groups of cells smaller than this (m²)."),
    ] = None,
    turn: Annotated[
        str | None,
        typer.Option(
            "--rotate",
            metavar="walls|ANGLE",
            help="Turn until the walls lie along the axes, or by an angle (90deg, rad).",
        ),
    ] = None,
    box: Annotated[
        str | None,
        typer.Option("--crop", metavar="known|X0,Y0,X1,Y1", help="Keep what is known, or a box (m, after --rotate)."),
    ] = None,
    margin: Annotated[float, typer.Option("--margin", metavar="M", help="Grow the box of --crop (m).", min=0.0)] = 0.0,
    keepout: Annotated[
        list[Path],
        typer.Option(
            "--keepout",
            metavar="FILE",
            help=f"Areas of a keepout mask, written next to the map as NAME_keepout.yaml {Polygons}",
        ),
    ] = [],
    json_: options.Json = False,
) -> None:
    """Edit a map: draw areas, remove specks, fill holes, turn it to its walls, crop it, make a keepout mask; in this order.

    The YAML file keeps its fields: mode, negate, thresholds and others.
    """
    path, grid = map_of(map_)
    mask = keepout_mask(grid, keepout) if keepout else None
    done: dict[str, Any] = {}
    for name, files, value in (("occupied", occupied, 100), ("free", free, 0), ("unknown", unknown, -1)):
        for file in files:
            before, grid = grid, paint(grid, file, value)
            done.setdefault(name, 0)
            done[name] += int((before.data != grid.data).sum())
    if remove is not None:
        grid, done["specks"] = _checked(remove_specks, grid, remove, "--remove-specks")
    if fill is not None:
        grid, done["holes"] = _checked(fill_holes, grid, fill, "--fill")
    if turn is not None:
        angle = -wall_direction(grid) if turn.strip().lower() == "walls" else parse_angle(turn)
        grid, mask = rotate(grid, angle), None if mask is None else rotate(mask, angle)
        done["rotated_rad"] = angle
    if box is not None:
        known = box.strip().lower() == "known"
        corners = None if known else parse_numbers(box, "--crop", "X0,Y0,X1,Y1", (4,))
        limits = None if corners is None else (corners[0], corners[1], corners[2], corners[3])
        whole, grid = grid, crop(grid, limits, margin)
        done["cells_cut"] = whole.data.size - grid.data.size
        if mask is not None:
            mask = _cut_like(mask, grid)
    if not done and mask is None:
        raise InputError("there is nothing to do; give --crop, --rotate, --remove-specks, --fill, an area or --keepout")
    if mask is not None and turn is not None:
        mask = OccupancyGrid(np.maximum(mask.data, 0), mask.geometry, mask.origin_yaw, mask.frame)
    written = save_map(grid, out, like=path)
    files = {"map": str(written[0]), "image": str(written[1])}
    if mask is not None:
        files["keepout mask"] = str(save_map(mask, written[0].with_name(f"{written[0].stem}_keepout.yaml"))[0])
    g = grid.geometry
    if json_:
        origin = [g.origin_x, g.origin_y, grid.origin_yaw]
        print_json({"cells": [g.nx, g.ny], "origin": origin, "resolution": g.resolution, **done, "files": files})
        return
    print("; ".join((*_texts(done), f"{g.nx} x {g.ny} cells of {g.resolution:g} m")))
    if "rotated_rad" in done:
        print_note("places, masks and other poses of the old map must be turned by the same angle about (0, 0)")
    print_files(files)


def _checked(change: Any, grid: OccupancyGrid, area: float, option: str) -> Any:
    if not (math.isfinite(area) and area > 0.0):
        raise InputError(f"{option} {area:g} must be an area above 0 m², such as 0.05", argument=option)
    return change(grid, area)


def _cut_like(mask: OccupancyGrid, grid: OccupancyGrid) -> OccupancyGrid:
    """Return the part of the mask on the cells of a part of its map."""
    g, whole = grid.geometry, mask.geometry
    corner = Transform2D(whole.origin_x, whole.origin_y, mask.origin_yaw).inverse()
    at = corner.apply_points(np.array([[g.origin_x, g.origin_y]]))[0]
    x, y = np.rint(at / g.resolution).astype(int).tolist()
    return OccupancyGrid(np.ascontiguousarray(mask.data[y : y + g.ny, x : x + g.nx]), g, grid.origin_yaw, grid.frame)


def _texts(done: dict[str, Any]) -> list[str]:
    texts = [f"{done[name]} cells made {name}" for name in ("occupied", "free", "unknown") if name in done]
    texts += [
        f"{done[name]} {name} {verb}" for name, verb in (("specks", "removed"), ("holes", "filled")) if name in done
    ]
    if "rotated_rad" in done:
        texts.append(f"turned by {math.degrees(done['rotated_rad']):.2f}°")
    return [*texts, *([f"{done['cells_cut']} cells cut off"] if "cells_cut" in done else [])]


def merge_maps(
    first: options.Map,
    second: Annotated[
        str, typer.Argument(metavar="OTHER.yaml", help="Map to add.", autocompletion=options.complete_map)
    ],
    out: Out,
    transform: Annotated[
        str | None,
        typer.Option(
            "--transform",
            metavar="X,Y,YAW",
            help="Pose of the second map's frame in that of the first (m, rad). [default: found by a search]",
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Join two maps of one place in the frame of the first: occupied where either is, free where either is.

    Without --transform, the second map is searched for in all poses by its walls and free space; the runner-up is printed, and
    an alignment that is not clear is refused. Exit code 2 then: nothing is written.
    """
    path, one = map_of(first)
    _, other = map_of(second)
    if transform is None:
        search = align(one, other)
        best, rival = search.found[0], next(iter(search.found[1:]), None)
        if search.refusal:
            x, y, yaw = best.transform
            raise InputError(f"{search.refusal}; give the right one, such as --transform {x:.2f},{y:.2f},{yaw:.4f}")
    else:
        x, y, yaw = parse_numbers(transform, "--transform", "X,Y,YAW", (3,))
        best, rival = compare(one, other, Transform2D(x, y, yaw)), None
    joined = merged(one, other, best.transform)
    written = save_map(joined, out, like=path)
    files = {"map": str(written[0]), "image": str(written[1])}
    if json_:
        found = [
            {"transform": list(a.transform), "agree_m": a.agree_m, "contradict_m": a.contradict_m, "share": a.share}
            for a in (best, *(() if rival is None else (rival,)))
        ]
        g = joined.geometry
        print_json({"alignments": found, "cells": [g.nx, g.ny], "files": files})
        return
    print(f"second map {best.text()}")
    if rival is not None:
        print_note(f"the next best alignment: {rival.text()}")
    print_files(files)
