"""The path along a route: poses at a distance, corners as arcs if wanted (nav2_route's path converter)."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from navstack.core import Path
from navstack.routes.route import Route, RouteParams

Points = NDArray[np.float64]


def route_path(route: Route, params: RouteParams, begun: tuple[int, tuple[float, float]] | None = None) -> Path:
    """Return the path along the edges of a route, in the frame of the graph; without edges its one node.

    Poses are at most `path_density` (m) apart and head for the next one, the last one along the last edge. `begun` is an edge
    that the robot is on, and the point on it where the path begins.
    """
    graph = route.graph
    xy = graph.xy.astype(np.float64)
    nodes = xy[list(route.nodes)]
    pieces: list[Points] = []
    if begun is not None:
        pieces.append(_between(np.array(begun[1]), xy[graph.ends[begun[0]]], params.path_density))
    start = nodes[0]
    for corner, after in pairwise(nodes[1:]):
        arc = _arc(start, corner, after, params) if params.smooth_corners else None
        if arc is None:
            pieces.append(_between(start, corner, params.path_density))
            start = corner
        else:
            pieces += [_between(start, arc[0], params.path_density), arc[:-1]]
            start = arc[-1]
    if len(nodes) > 1:
        pieces.append(_between(start, nodes[-1], params.path_density))
    points = np.concatenate([*pieces, nodes[-1:]])
    poses = np.zeros((len(points), 3))
    poses[:, :2] = points
    steps = np.diff(points, axis=0)
    poses[:-1, 2] = np.arctan2(steps[:, 1], steps[:, 0])
    if route.edges:
        along = graph.xy[graph.ends[route.edges[-1]]] - graph.xy[graph.starts[route.edges[-1]]]
        poses[-1, 2] = math.atan2(float(along[1]), float(along[0]))
    elif len(poses) > 1:  # Nav2 leaves 0 here
        poses[-1, 2] = poses[-2, 2]
    return Path(poses, graph.frame)


def _between(a: Points, b: Points, density: float) -> Points:
    """Return equidistant points from `a` to `b`, without `b`; none if they are the same."""
    # the number of points as float32 gives it: 1.0 m by 0.05 m are 20 steps, not 21
    length = np.float32(np.hypot(*(b - a)))
    count = math.ceil(length / np.float32(density))
    return a + (b - a) * (np.arange(count) / max(count, 1))[:, None]


def _arc(start: Points, corner: Points, end: Points, params: RouteParams) -> Points | None:
    """Return points of the arc that rounds a corner, ends included; None for a corner that stays.

    That is one straighter than `smoothing_angle_threshold`, a turn on the spot, or edges that are shorter than the tangents.
    """
    a, b, radius = start - corner, end - corner, params.smoothing_radius
    long_a, long_b = float(np.hypot(*a)), float(np.hypot(*b))
    if long_a == 0.0 or long_b == 0.0:
        return None
    a, b = a / long_a, b / long_b
    angle = math.acos(min(max(float(a @ b), -1.0), 1.0))
    if angle < 1e-6 or angle > params.smoothing_angle_threshold:
        return None
    tangent = radius / math.tan(0.5 * angle)
    if not (tangent < long_a and tangent < long_b):
        return None
    middle = a + b
    center = corner + middle / float(np.hypot(*middle)) * (radius / math.sin(0.5 * angle))
    first = corner + a * tangent
    r = first - center
    last = corner + b * tangent - center
    turn = math.atan2(r[0] * last[1] - r[1] * last[0], float(r @ last))
    count = max(1, math.ceil(abs(turn) / (params.path_density / radius)))
    at = np.arange(count) * (turn / count)
    c, s = np.cos(at), np.sin(at)
    around = center + np.column_stack([r[0] * c - r[1] * s, r[0] * s + r[1] * c])
    return np.vstack([around, corner + b * tangent])
