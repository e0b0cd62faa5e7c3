"""Generation of a minimal set of motion primitives for a turning radius, headings, cells and a motion model.

The construction is that of Nav2's lattice generator (nav2_smac_planner/lattice_primitives), after M. Pivtoraiko, R. Knepper and
A. Kelly, "Differentially constrained mobile robot motion planning in state lattices" (2009): end points on growing squares around
the start are connected by a line, an arc and a line; a connection that passes the end of a shorter one is composed of
others and dropped.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError
from navstack.global_planner._lattice import (
    IN_PLACE,
    MOTION_MODELS,
    SLIDE,
    Connections,
    Lattice,
    MotionModel,
    Piece,
    Primitive,
    connect,
    connection_pieces,
    sample,
    scaled,
    wrapped,
)

STOPPING_THRESHOLD: Final = 5
DISTINCTNESS: Final = 0.9
_TURN_STEP: Final = math.radians(10.0)
_SAME: Final = 1e-9
_LARGEST: Final = 200
"""Cells: largest square that is looked at."""


class _Found(NamedTuple):
    """An end state (cells)."""

    start: int
    end: int
    x: int
    y: int


def lattice_headings(count: int) -> NDArray[np.float64]:
    """Return the headings (count,) in [0, 2 pi): directions to all points on the border of a square of count / 4 cells."""
    m = count // 8
    border = [(x, y) for x, y in product(range(-m, m + 1), repeat=2) if max(abs(x), abs(y)) == m]
    return np.sort([math.atan2(y, x) % (2.0 * math.pi) for x, y in border])


def generate_lattice(
    turning_radius: float = 0.5,
    resolution: float = 0.05,
    *,
    headings: int = 16,
    motion_model: MotionModel = "ackermann",
    stopping_threshold: int = STOPPING_THRESHOLD,
    distinctness_ratio: float = DISTINCTNESS,
) -> Lattice:
    """Return the primitives of a turning radius (m) on cells of `resolution` (m).

    `headings`: a multiple of 8. `motion_model`: ackermann (arcs and lines), diff (and turns in place), omni (and slides to the
    sides). The search for end points ends after `stopping_threshold` squares without a new one. `distinctness_ratio`: an end
    within this share of a connection's length of another one with the same heading is dropped; 0 keeps all.
    Raises InputError for values outside of their range.
    """
    _check(turning_radius, resolution, headings, motion_model, stopping_threshold, distinctness_ratio)
    return _generate(turning_radius, resolution, headings, motion_model, stopping_threshold, distinctness_ratio)


def _check(radius: float, resolution: float, headings: int, model: str, threshold: int, ratio: float) -> None:
    if not 1e-4 <= resolution <= 100.0:
        raise InputError(f"the resolution must be between 0.0001 and 100 m, not {resolution:g}", resolution=resolution)
    if headings % 8 != 0 or not 8 <= headings <= 64:
        raise InputError(
            f"the number of headings must be a multiple of 8 from 8 to 64, not {headings}", headings=headings
        )
    if model not in MOTION_MODELS:
        raise InputError(
            f"the motion model must be one of {', '.join(MOTION_MODELS)}, not {model!r}", motion_model=model
        )
    if not 2.0 <= radius / resolution <= 100.0:
        raise InputError(
            f"the turning radius must be between 2 and 100 cells, which is {2.0 * resolution:g} to {100.0 * resolution:g} m with "
            f"cells of {resolution:g} m, not {radius:g} m",
            turning_radius=radius,
            resolution=resolution,
        )
    if not 1 <= threshold <= 50:
        raise InputError(
            f"the stopping threshold must be between 1 and 50, not {threshold}", stopping_threshold=threshold
        )
    if not 0.0 <= ratio < 1.0:
        raise InputError(
            f"the distinctness ratio must be at least 0 and below 1, not {ratio:g}", distinctness_ratio=ratio
        )


@lru_cache(maxsize=16)
def _generate(
    radius: float, resolution: float, count: int, model: MotionModel, threshold: int, ratio: float
) -> Lattice:
    angles = lattice_headings(count)
    found = [f for k in range(count // 4 + 1) for f in _ends(k, angles, radius / resolution, threshold, ratio)]
    primitives = [_primitive(f, angles, resolution) for f in dict.fromkeys(_mirrored(found, count))]
    if model != "ackermann":
        primitives += [_turn_in_place(k, (k + side) % count, angles) for k in range(count) for side in (-1, 1)]
    if model == "omni":
        primitives += [
            _slide(p, angles, side) for p in primitives if p.radius == 0.0 and p.length > 0.0 for side in (-1, 1)
        ]
    primitives.sort(key=lambda p: (p.start, tuple(p.poses[-1])))
    return Lattice(model, radius, resolution, angles, tuple(primitives), threshold, ratio)


def _ends(start: int, angles: NDArray[np.float64], radius: float, threshold: int, ratio: float) -> list[_Found]:
    """The end states of a heading from 0 to 90 degrees, in the first quadrant (cells)."""
    near = wrapped(angles - angles[start])
    # nearest headings first; of two as near, the larger
    order = sorted(
        (k for k in range(len(angles)) if abs(near[k]) <= 0.5 * math.pi + 1e-9),
        key=lambda k: (round(abs(near[k]), 9), -k),
    )
    targets = np.array(order)
    gap = float(np.diff(np.append(angles, 2.0 * np.pi)).min())
    found: list[_Found] = []
    states = np.zeros((0, 3))
    empty, p = 0, max(1, round(radius * gap))
    while empty < threshold and p <= _LARGEST:
        ends, links = _connections(p, start, targets, angles, radius)
        before = len(found)
        for k in np.flatnonzero(~np.isnan(links.length)):
            end = ends[k]
            state = np.array([end.x, end.y, angles[end.end]])
            if _is_new(links, int(k), state, states, float(angles[start]), math.pi / len(angles), ratio):
                states = np.concatenate([states, state[None]])
                found.append(end)
        empty = empty + 1 if len(found) == before else 0
        p += 1
    # turns to the other side of 0 and 90 degrees are those of the mirrored headings
    for side in {0: (1,), len(angles) // 4: (-1,)}.get(start, (1, -1)):
        if not any(near[f.end] * side > _SAME for f in found):
            found += _first_turn(start, targets[near[targets] * side > _SAME], angles, radius)
    return found


def _first_turn(start: int, targets: NDArray[np.int64], angles: NDArray[np.float64], radius: float) -> list[_Found]:
    """The shortest connection to one of these headings that ends on the smallest square.

    # ROS differs: where all turns to a side pass the end of a straight line, Nav2's generator drops them; a robot at this
    # heading could never leave it.
    """
    for p in range(1, _LARGEST + 1):
        ends, links = _connections(p, start, targets, angles, radius)
        if not np.isnan(links.length).all():
            return [ends[int(np.nanargmin(links.length))]]
    return []


def _connections(
    p: int, start: int, targets: NDArray[np.int64], angles: NDArray[np.float64], radius: float
) -> tuple[list[_Found], Connections]:
    """Connections to all ends with these headings on the square of p cells in the first quadrant; those nearest first."""
    points = np.array([point for i in range(p) for point in ((p, i), (i, p))] + [(p, p)], np.float64)
    xs, ys = (np.repeat(points[:, i], len(targets)) for i in (0, 1))
    ends = np.tile(targets, len(points))
    links = connect(xs, ys, float(angles[start]), angles[ends], radius)
    found = [_Found(start, int(end), int(x), int(y)) for end, x, y in zip(ends, xs, ys, strict=True)]
    return found, links


def _is_new(
    links: Connections,
    k: int,
    state: NDArray[np.float64],
    states: NDArray[np.float64],
    yaw: float,
    least_turn: float,
    ratio: float,
) -> bool:
    """Whether a connection (cells) passes none of the states (n, 3) and ends far enough from those of its heading."""
    if len(states) == 0:
        return True
    length = float(links.length[k])
    if ratio > 0.0:
        same = states[np.abs(wrapped(states[:, 2] - state[2])) < 1e-9]
        if (np.hypot(same[:, 0] - state[0], same[:, 1] - state[1]) < ratio * length).any():
            return False
    count = max(2, round(10.0 * length))
    poses = np.concatenate([[[0.0, 0.0, yaw]], sample(connection_pieces(links, k), yaw, count)])
    a, step = poses[:-1, None, :2], np.diff(poses[:, :2], axis=0)[:, None, :]
    to = states[None, :, :2] - a
    share = np.clip((to * step).sum(axis=2) / (step**2).sum(axis=2), 0.0, 1.0)
    distance = np.hypot(*np.moveaxis(to - share[..., None] * step, 2, 0))
    turn = np.abs(wrapped(poses[:-1, None, 2] - states[None, :, 2]))
    return not ((distance < 0.5) & (turn < least_turn)).any()


def _mirrored(found: list[_Found], count: int) -> list[_Found]:
    """The end states of all headings: mirrored in both axes."""
    out: list[_Found] = []
    half = count // 2
    for f in found:
        out.append(f)
        out.append(_Found(-f.start % count, -f.end % count, f.x, -f.y))
        out.append(_Found((half - f.start) % count, (half - f.end) % count, -f.x, f.y))
        out.append(_Found((half + f.start) % count, (half + f.end) % count, -f.x, -f.y))
    return out


def _primitive(f: _Found, angles: NDArray[np.float64], resolution: float) -> Primitive:
    x, y = np.array([f.x], np.float64), np.array([f.y], np.float64)
    links = connect(x, y, float(angles[f.start]), angles[[f.end]], 0.0)
    pieces = scaled(connection_pieces(links, 0), resolution)
    arc = sum(p.size for p in pieces if p.curvature != 0.0)
    straight = sum(p.size for p in pieces if p.curvature == 0.0)
    curvature = next((p.curvature for p in pieces if p.curvature != 0.0), 0.0)
    poses = sample(list(pieces), float(angles[f.start]), max(1, round((arc + straight) / resolution)))
    poses[-1] = f.x * resolution, f.y * resolution, angles[f.end]
    poses[:, 2] = np.remainder(poses[:, 2], 2.0 * np.pi)
    radius = 0.0 if curvature == 0.0 else 1.0 / abs(curvature)
    return Primitive(f.start, f.end, curvature >= 0.0, radius, arc, straight, poses, pieces)


def _turn_in_place(start: int, end: int, angles: NDArray[np.float64]) -> Primitive:
    turn = float(wrapped(angles[end] - angles[start]))
    count = max(1, round(abs(turn) / _TURN_STEP))
    yaws = np.remainder(angles[start] + turn * np.arange(count + 1) / count, 2.0 * np.pi)
    yaws[-1] = angles[end]
    poses = np.column_stack((np.zeros(count + 1), np.zeros(count + 1), yaws))
    return Primitive(start, end, True, 0.0, 0.0, 0.0, poses, (Piece(IN_PLACE, turn),))


def _slide(straight: Primitive, angles: NDArray[np.float64], side: int) -> Primitive:
    """A straight primitive driven by a robot that looks a right angle to its side."""
    heading = (straight.start + side * len(angles) // 4) % len(angles)
    poses = straight.poses.copy()
    poses[:, 2] = angles[heading]
    direction = float(wrapped(angles[straight.start] - angles[heading]))
    pieces = (Piece(SLIDE, straight.straight_length, 0.0, direction),)
    return Primitive(heading, heading, True, 0.0, 0.0, straight.straight_length, poses, pieces)
