"""`navstack explain map`: which scans made a cell of a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.arguments import parse_numbers
from navstack.cli.output import loading_kernels, print_json
from navstack.core import LogError
from navstack.logs import MappingModel, cell_changes
from navstack.mapping import load_session

_SHOWN = 12


def map_(
    mapping: Annotated[
        Path, typer.Argument(metavar="MAP.mapping.npz|MAP.yaml", help="What `map build` wrote, or its map.")
    ],
    at: Annotated[str, typer.Option("--at", metavar="X,Y", help="Place in the map (m).")],
    json_: options.Json = False,
) -> None:
    """List the scans that made a cell of a map: which saw an obstacle there, which saw through it, when and from where."""
    x, y = parse_numbers(at, "--at", "x,y in meters", (2,))
    file = mapping.with_suffix(".mapping.npz") if mapping.suffix == ".yaml" else mapping
    mapper = load_session(file)
    if not len(mapper.keyframes):
        raise LogError(f"{file} has no keyframe, so there is no map to explain", file=str(file))
    model = MappingModel(max_range=mapper.params.max_laser_range)
    with loading_kernels(quiet=json_):
        grid = mapper.map()
        changes = list(cell_changes(mapper.frames(), grid, x, y, model))
    g = grid.geometry
    value = int(grid.data[int((y - g.origin_y) / g.resolution), int((x - g.origin_x) / g.resolution)])
    state = {-1: "unknown", 0: "free"}.get(value, "occupied")
    hits = sum(change.hit for change in changes)
    if json_:
        rows = [
            {
                "keyframe": change.frame.index,
                "stamp": change.frame.scan.stamp,
                "pose": None if change.frame.reference is None else list(change.frame.reference),
                "hit": change.hit,
                "occupancy": change.occupancy,
            }
            for change in changes
        ]
        print_json({"x": x, "y": y, "state": state, "hits": hits, "misses": len(changes) - hits, "scans": rows})
        return
    print(f"({x:g}, {y:g}) is {state}: {hits} scans saw an obstacle there, {len(changes) - hits} saw through it")
    for change in changes[:_SHOWN]:
        pose = change.frame.reference
        where = "" if pose is None else f" from ({pose.x:.2f}, {pose.y:.2f})"
        verb = "obstacle" if change.hit else "free    "
        print(f"  keyframe {change.frame.index:5d} at {change.frame.scan.stamp:.1f} s{where}: {verb} -> {change.occupancy:.2f}")
    if len(changes) > _SHOWN:
        print(f"  and {len(changes) - _SHOWN} more; all with --json")
