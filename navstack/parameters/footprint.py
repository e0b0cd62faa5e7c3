"""The robot's footprint from parameters, in the order of costmap_2d/src/footprint.cpp (makeFootprintFromParams)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from navstack.core import Footprint
from navstack.core.errors import InputError
from navstack.parameters.findings import Finding, finding
from navstack.parameters.tree import Leaf, Space

DEFAULT_RADIUS = 0.46
_NUMBER = r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*"
_POINT = re.compile(rf"\[{_NUMBER},{_NUMBER}\]")
_POINTS = re.compile(rf"\s*\[\s*{_POINT.pattern}(?:\s*,\s*{_POINT.pattern})*\s*,?\s*\]\s*\Z")


@dataclass(frozen=True, slots=True)
class LoadedFootprint:
    """The footprint with and without padding, and the parameter it was read from (None: the default)."""

    padded: Footprint
    true: Footprint
    origin: Leaf | None


def parse_footprint(value: Any) -> list[list[float]]:
    """Convert `[[x, y], ..]` or its text to points; raise ValueError for anything else."""
    if isinstance(value, str):
        if not _POINTS.match(value):
            raise ValueError(f'footprint = "{value[:60]}" is not a list of points; write [[x, y], [x, y], [x, y], ..]')
        return [[float(n) for n in p.strip("[]").split(",")] for p in _POINT.findall(value)]
    if not isinstance(value, list):
        raise ValueError(f"footprint = {value!r} is not a list of points; write [[x, y], [x, y], [x, y], ..]")
    points: list[list[float]] = []
    for i, point in enumerate(value):
        numbers = isinstance(point, list) and all(
            isinstance(n, (int, float)) and not isinstance(n, bool) for n in point
        )
        if not numbers or len(point) != 2:
            raise ValueError(f"point {i + 1} of the footprint is {point!r}; write two numbers [x, y] in metres")
        points.append([float(n) for n in point])
    return points


def footprint_of(costmap: Space, padding: float, findings: list[Finding]) -> LoadedFootprint | None:
    """Return the footprint of a costmap, None after an error.

    The nearest `footprint` up the tree, otherwise the nearest `robot_radius`, otherwise 0.46 m.
    """
    leaf = costmap.search("footprint")
    if leaf is not None:
        leaf.used = True
        value = leaf.value
        if value is not None and value != [] and not (isinstance(value, str) and value.strip() in ("", "[]")):
            return _polygon(leaf, value, padding, findings)
    leaf = costmap.search("robot_radius")
    if leaf is None:
        return _load(lambda p: Footprint.from_radius(DEFAULT_RADIUS, p), padding, None, findings)
    leaf.used = True
    radius = leaf.value
    if isinstance(radius, bool) or not isinstance(radius, (int, float)) or radius < 0.0:
        return None  # reported with the costmap's other parameters
    if not radius > 0.0:
        message = f"robot_radius = {radius:g} is not positive; set it to the robot's radius in metres"
        findings.append(finding("error", "footprint", leaf.node.at, leaf.path, message))
        return None
    return _load(lambda p: Footprint.from_radius(float(radius), p), padding, leaf, findings)


def _polygon(leaf: Leaf, value: Any, padding: float, findings: list[Finding]) -> LoadedFootprint | None:
    try:
        points = parse_footprint(value)
    except ValueError as exc:
        findings.append(finding("error", "footprint", leaf.node.at, leaf.path, str(exc)))
        return None
    return _load(lambda p: Footprint(np.array(points, np.float64), p), padding, leaf, findings)


def _load(
    make: Callable[[float], Footprint], padding: float, leaf: Leaf | None, findings: list[Finding]
) -> LoadedFootprint | None:
    try:
        return LoadedFootprint(make(padding), make(0.0), leaf)
    except InputError as exc:
        if leaf is not None:
            findings.append(finding("error", "footprint", leaf.node.at, leaf.path, exc.message))
        return None
