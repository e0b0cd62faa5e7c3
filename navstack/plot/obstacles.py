"""Obstacles that are not on the map: fixed ones, and moving ones with their paths."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.plot import colors, drawing
from navstack.record import Record


def draw_obstacles(axes: Any, record: Record, *, moving: bool = True) -> list[tuple[Any, str]]:
    """Draws the obstacles that are not on the map; moving ones (if wanted) at their last place, with their paths dotted.

    Returns the entries of the legend.
    """
    still, movers = obstacle_patches(record, float(record.times[-1]) if len(record.times) else 0.0)
    if still or movers:
        movers = movers if moving else []
        for patch in still + movers:
            axes.add_patch(patch)
        for path in _paths(record) if moving else ():
            drawing.draw_line(axes, path, colors.MOVING, width=1.3, zorder=2.9, ls=":")
        entries: list[tuple[Any, str]] = [(still[0], "obstacle, not on the map")] if still else []
        return entries + ([(movers[0], "moving obstacle (at the end), its path")] if movers else [])
    return _draw_discs(axes, record)


def _draw_discs(axes: Any, record: Record) -> list[tuple[Any, str]]:
    """Draws the discs of the scenario, for records without recorded obstacles."""
    from matplotlib.patches import Circle

    handle: Any = None
    for obstacle in record.scenario.get("obstacles") or ():
        try:
            x, y, r = (float(v) for v in obstacle[:3])
        except (TypeError, ValueError, KeyError):
            continue
        handle = axes.add_patch(
            Circle((x, y), r, facecolor=colors.OBSTACLE, edgecolor="white", hatch="/////", lw=1.0, zorder=3)
        )
    return [(handle, "obstacle, not on the map")] if handle is not None else []


def obstacle_patches(record: Record, t: float) -> tuple[list[Any], list[Any]]:
    """Returns patches of the recorded discs and polygons at time `t` (s): fixed ones, and moving ones."""
    from matplotlib.patches import Circle, Polygon

    discs, polygons = record.solids_at(t, absent=True)
    moved = obstacles_moved(record)
    still: list[Any] = []
    moving: list[Any] = []
    for shape, moves in zip([*discs.tolist(), *polygons], moved, strict=True):
        style: dict[str, Any] = {"edgecolor": "white", "lw": 1.0, "zorder": 3, "facecolor": colors.OBSTACLE}
        style |= {"hatch": "....", "facecolor": colors.MOVING} if moves else {"hatch": "/////"}
        if isinstance(shape, list):
            x, y, r = shape
            made: Any = Circle((x, y), r, **style)
        else:
            made = Polygon(shape, **style)
        (moving if moves else still).append(made)
    return still, moving


def obstacles_moved(record: Record) -> list[bool]:
    """Returns, for the recorded discs and then the polygons, whether they ever moved."""
    discs, corners = record.arrays.get("solid_discs"), record.arrays.get("solid_corners")
    if discs is None or corners is None:
        return []
    first = record.arrays["solid_first"].tolist()
    return [bool((discs[:, k] != discs[0, k]).any()) for k in range(discs.shape[1])] + [
        bool((corners[:, a:b] != corners[0, a:b]).any()) for a, b in itertools.pairwise(first)
    ]


def _paths(record: Record) -> list[NDArray[np.float64]]:
    """The path (n, 2) of the centre of each obstacle that moved."""
    discs, corners = record.arrays["solid_discs"], record.arrays["solid_corners"]
    first = record.arrays["solid_first"].tolist()
    paths = [discs[:, k, :2] for k in range(discs.shape[1])]
    paths += [corners[:, a:b].mean(axis=1) for a, b in itertools.pairwise(first)]
    return [path.astype(np.float64) for path, moved in zip(paths, obstacles_moved(record), strict=True) if moved]
