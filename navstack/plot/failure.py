"""Why there is no plan, in the picture of a plan: gaps that are too narrow, what blocks the goal, how far the search came."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, Pose2D
from navstack.plot import colors, drawing


def points_of(failure: Mapping[str, Any]) -> NDArray[np.float64]:
    """The places (n, 2) that the data of a planning error names."""
    near, furthest = failure.get("nearest_reachable"), failure.get("furthest")
    found = [(spot["x"], spot["y"]) for spot in failure.get("narrow", [])]
    found += _blocking(failure)
    found += [tuple(place[:2]) for place in (near, furthest) if place is not None]
    return np.array(found, np.float64).reshape(-1, 2)


def draw_failure(axes: Any, failure: Mapping[str, Any], footprint: Footprint | None) -> list[tuple[Any, str]]:
    """Draws what the data of a planning error says; returns the entries of the legend."""
    entries: list[tuple[Any, str]] = []
    for i, spot in enumerate(failure.get("narrow", [])):
        entries += _draw_gap(axes, spot, footprint)[: 2 if i == 0 else 0]
    blocking = np.array(_blocking(failure), np.float64).reshape(-1, 2)
    if len(blocking):
        entries.append((_draw_points(axes, blocking, "X", colors.VERMILLION), "what blocks the way"))
    if failure.get("furthest") is not None and footprint is not None:
        outline = drawing.draw_footprint(axes, footprint, Pose2D(*failure["furthest"]), zorder=5.2)
        outline.set(edgecolor=colors.ORANGE, facecolor="none", lw=1.8)
        entries.append((outline, "it cannot go on from here"))
    if failure.get("nearest_reachable") is not None:
        near = np.array([failure["nearest_reachable"]], np.float64)
        entries.append((_draw_points(axes, near, "s", colors.ORANGE), "nearest place reached"))
    return entries


def _blocking(failure: Mapping[str, Any]) -> list[tuple[float, float]]:
    """The obstacles named as stretches of a route, or the one under the footprint at the goal."""
    blocked = failure.get("blocked_by") or []
    if blocked and not isinstance(blocked[0], Mapping):
        return [(blocked[0], blocked[1])]
    return [(spot["x"], spot["y"]) for spot in blocked]


def _draw_gap(axes: Any, spot: Mapping[str, float], footprint: Footprint | None) -> list[tuple[Any, str]]:
    """A bar across a gap, and the footprint in it at the heading of the gap."""
    x, y, heading = spot["x"], spot["y"], spot["heading"]
    across = 0.5 * spot["width_m"] * np.array([-math.sin(heading), math.cos(heading)])
    bar = np.array([[x, y] - across, [x, y] + across])
    line = drawing.draw_line(axes, bar, colors.VERMILLION, width=2.6, casing=True, zorder=6)
    entries: list[tuple[Any, str]] = [(line, "too narrow for the footprint")]
    if footprint is not None:
        outline = drawing.draw_footprint(axes, footprint, Pose2D(x, y, heading), zorder=5.2)
        outline.set(edgecolor=colors.VERMILLION, facecolor="none", lw=1.8)
        entries.append((outline, "footprint at its heading"))
    return entries


def _draw_points(axes: Any, points: NDArray[np.float64], marker: str, color: str) -> Any:
    (marks,) = axes.plot(points[:, 0], points[:, 1], marker, ls="none", ms=8, color=color, mec="white", zorder=9)
    return marks
