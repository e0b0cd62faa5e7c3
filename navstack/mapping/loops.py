"""Loops: whether a scan was made at a place that earlier scans have seen, and how sure that is.

A loop that is wrong bends the whole map, one that is missed costs some accuracy. So a match counts only if the refined pose
explains the scan, no other pose in the window nearly does, no wall stands where the other scans saw free space, the position is
determined in every direction (not along a corridor), and a second match from another keyframe asks for the same correction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Transform2D, normalize_angle
from navstack.mapping.matching import Surfaces
from navstack.mapping.params import MapperParams


@dataclass(slots=True, eq=False)
class Loop:
    """A place that was compared with a keyframe, accepted or rejected."""

    keyframe: int
    place: int
    """Keyframe in the middle of the earlier scans."""
    stamp: float
    seen_at: float
    """Stamp of the keyframe `place` (s)."""
    path: float
    """Shortest way in the graph from `place` to `keyframe` (m), at most that from which the search has its full width."""
    coarse: float
    """Mean likelihood of the best pose of the search."""
    runner_up: float
    """The same of the best pose that is another one."""
    response: float
    """Mean likelihood of the refined pose."""
    contradiction: float
    """Share of the points where the other side has seen free space; NaN if it was not asked."""
    rms: float
    """Of the points on surfaces (m)."""
    correction: tuple[float, float, float]
    """Forward, left (m) and turn (rad) from where the graph had the keyframe."""
    measured: Transform2D
    """Pose of `keyframe` seen from `place`."""
    information: NDArray[np.float64]
    in_graph: bool = False
    """Whether it was accepted while scans came."""
    decision: str = ""
    """Why, or why not."""
    residual: float = math.nan
    """Error of the edge after the graph was solved, in standard deviations; NaN for one that is not in the graph."""
    withdrawn: str = ""
    """Why the finished mapping does without it; empty if it does not."""

    @property
    def accepted(self) -> bool:
        """Whether the graph has it."""
        return self.in_graph and not self.withdrawn

    @property
    def reason(self) -> str:
        """Why it was accepted or rejected."""
        return self.withdrawn or self.decision

    def __str__(self) -> str:
        x, y, yaw = self.correction
        verdict = "accepted" if self.accepted else "rejected"
        residual = "" if math.isnan(self.residual) else f", residual {self.residual:.1f} sigma"
        return (
            f"{verdict}: keyframe {self.keyframe} ({self.stamp:.1f} s) at keyframe {self.place} ({self.seen_at:.1f} s), "
            f"{self.path:.0f} m of path: response {self.response:.2f}, search {self.coarse:.2f}, "
            f"runner-up {self.runner_up:.2f}, rms {self.rms:.3f} m, correction {math.hypot(x, y):.2f} m "
            f"{math.degrees(yaw):+.1f} degrees{residual}: {self.reason}"
        )


class Scene(NamedTuple):
    """What a scan contributes to a comparison."""

    surface: NDArray[np.float64]
    """(n, 4) points with normals in the base frame."""
    eye: NDArray[np.float64]
    """(2,) the sensor in the base frame."""
    pose: Transform2D
    """Of the base, by the graph."""
    scans: int = 1
    """Number of scans in it: their errors are not independent, so together they count as one."""


EDGE_FLOOR: Final = np.diag([0.01**2, 0.01**2, 0.002**2])
"""Covariance of a match that the Hessian does not contain: what of a scan moves, bends, or is not planar (m, rad)."""
LOOP_FLOOR: Final = np.diag([0.02**2, 0.02**2, 0.004**2])
"""The same of a loop: the earlier scans are not placed exactly among themselves."""
LEAST_INFORMATION: Final = 1.0 / 0.1**2
"""A loop must determine the position to 0.1 m in every direction."""
LEAST_SHARE: Final = 0.02
"""and the points must say this much about the direction that they know worst, relative to the best: a few points at the end of a
corridor can be anything."""
_OTHER_M, _OTHER_RAD = 0.6, 0.3
"""From here on, a pose is another one: wider than the likelihood around one maximum."""
_STAYS_SEEN, _STAYS_FREE = 0.2, 0.2
"""A scan also fits where it is if this share of it is on surfaces, and in free space at most this much of that. What nobody has
seen does not count: near the edge of what is known, the true pose explains less of a scan than a false one further inside."""
_SMALL_SHIFT_M, _FAR_ENOUGH_M = 0.3, 4.0


def edge_information(hessian: NDArray[np.float64], yaw: float, floor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the information of an edge, in the frame of its second node, from the Hessian of a match in the map."""
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    body = np.einsum("ba,bc,cd->ad", turn, hessian, turn) + np.diag([1e-4, 1e-4, 1e-4])
    return _inverse(_inverse(body) + floor)


def without_chance(hessian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Hessian (3, 3) of a match without what noise contributes to the direction of the position that it knows worst.

    The normals of noisy points along a corridor point a little along it. The Hessian then claims to know this direction, and
    what it claims is the pose that the match began at. `LEAST_SHARE` of the information about the best direction is subtracted.
    """
    least, most = position_information(hessian)
    angle = worst_direction(hessian)
    x, y = math.cos(angle), math.sin(angle)
    less = min(LEAST_SHARE * most, max(least, 0.0))
    return hessian - less * np.array([[x * x, x * y, 0.0], [x * y, y * y, 0.0], [0.0, 0.0, 0.0]])


def _inverse(m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of a symmetric (3, 3) matrix; written out, because no library then chooses the order of operations."""
    a, b, c, d, e, f = m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * aa + b * bb + c * cc
    dd, ee, ff = a * f - c * c, b * c - a * e, a * d - b * b
    return np.array([[aa, bb, cc], [bb, dd, ee], [cc, ee, ff]]) / det


def compare(
    scene: Scene, chain: list[Scene], place: Transform2D, drift: tuple[float, float], params: MapperParams
) -> tuple[dict[str, float], Transform2D, NDArray[np.float64], str]:
    """Compare a scan with the scans of a place: return the figures, its pose, its information, and why not (or "").

    `drift`: half widths of the search (m, rad).
    """
    surfaces = Surfaces([(each.surface, each.pose) for each in chain])
    half_m, half_rad = drift
    found, coarse = surfaces.search(scene.surface, scene.pose, half_m=half_m, half_rad=half_rad, step_rad=0.02)
    figures = {"coarse": coarse, "runner_up": math.nan, "response": 0.0, "contradiction": math.nan, "rms": math.nan}
    nothing = np.zeros((3, 3))
    if coarse < params.loop_match_minimum_response_coarse:
        return figures, found, nothing, f"the search found no pose: {coarse:.2f}"
    match = surfaces.align(scene.surface, found)
    figures["response"], figures["rms"] = match.response, match.rms
    pose = Transform2D(float(match.pose[0]), float(match.pose[1]), normalize_angle(float(match.pose[2])))
    if math.hypot(pose.x - scene.pose.x, pose.y - scene.pose.y) > half_m:
        return figures, pose, nothing, f"the correction is larger than the drift can be: {half_m:.1f} m"
    if match.response < params.loop_match_minimum_response_fine:
        return figures, pose, nothing, f"the scan does not fit: response {match.response:.2f}"
    hessian = match.hessian / scene.scans
    least, most = position_information(hessian)
    if least < max(LEAST_INFORMATION, LEAST_SHARE * most):
        return figures, pose, nothing, "the position is not determined in one direction, as along a corridor"
    other = (pose.x, pose.y, pose.yaw, _OTHER_M, _OTHER_RAD)
    second, figures["runner_up"] = surfaces.search(
        scene.surface, scene.pose, half_m=half_m + _OTHER_M, half_rad=half_rad, step_rad=0.02, other=other
    )
    runner = surfaces.align(scene.surface, second)
    if runner.response > params.loop_match_maximum_runner_up * match.response and _differ(runner.pose, match.pose):
        return figures, pose, nothing, f"ambiguous: another pose has response {runner.response:.2f}"
    seen = [
        (each.pose.apply_points(each.eye[None])[0], each.pose.apply_points(np.ascontiguousarray(each.surface[:, :2])))
        for each in chain
    ]
    points = np.ascontiguousarray(scene.surface[:, :2])
    _, figures["contradiction"] = surfaces.agreement(seen, pose.apply_points(points))
    if figures["contradiction"] > params.loop_match_maximum_contradiction:
        return figures, pose, nothing, f"{figures['contradiction']:.0%} of the points are in free space of the place"
    if _differ(np.array(pose), np.array(scene.pose)):
        stays, _ = surfaces.search(scene.surface, scene.pose, half_m=0.3 + 0.25 * half_m, half_rad=0.15, step_rad=0.02)
        here = surfaces.align(scene.surface, stays)
        near, free = surfaces.agreement(seen, Transform2D(*here.pose.tolist()).apply_points(points))
        if _differ(here.pose, match.pose) and near > _STAYS_SEEN and free < _STAYS_FREE * near:
            return figures, pose, nothing, f"ambiguous: the scan also fits where it is, {near:.0%} of it on surfaces"
    return figures, pose, edge_information(hessian, pose.yaw, LOOP_FLOOR), ""


def _differ(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    return math.hypot(a[0] - b[0], a[1] - b[1]) > 0.5 * _OTHER_M or abs(normalize_angle(float(a[2] - b[2]))) > 0.15


def position_information(hessian: NDArray[np.float64]) -> tuple[float, float]:
    """Return the information about the position in the directions that are known worst and best, whatever the heading is."""
    a, b, d = _of_position(hessian)
    half = 0.5 * (a + d)
    root = math.sqrt(max(half * half - (a * d - b * b), 0.0))
    return float(half - root), float(half + root)


def worst_direction(hessian: NDArray[np.float64]) -> float:
    """Return the angle of the direction in which the position is known worst, whatever the heading is."""
    a, b, d = _of_position(hessian)
    return 0.5 * math.atan2(2.0 * b, a - d) + 0.5 * math.pi


def _of_position(h: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return xx, xy and yy of the information about the position, with the heading unknown."""
    turn = max(float(h[2, 2]), 1e-9)
    return (
        float(h[0, 0] - h[0, 2] ** 2 / turn),
        float(h[0, 1] - h[0, 2] * h[1, 2] / turn),
        float(h[1, 1] - h[1, 2] ** 2 / turn),
    )


def agree(first: Loop, second: Loop, poses: NDArray[np.float64], travelled: float) -> bool:
    """Return whether two loops ask for the same correction of the later keyframe; `travelled` between them (m).

    For a large correction they must be as far apart: scans from nearly the same pose share their mistakes.
    """
    shift = max(math.hypot(*loop.correction[:2]) for loop in (first, second))
    if first.keyframe == second.keyframe or (shift > _SMALL_SHIFT_M and travelled < min(1.5 * shift, _FAR_ENOUGH_M)):
        return False
    corrections = []
    for loop in (first, second):
        place, keyframe = (Transform2D(*poses[k].tolist()) for k in (loop.place, loop.keyframe))
        corrections.append(place @ loop.measured @ keyframe.inverse())
    at = Transform2D(*poses[second.keyframe].tolist())
    a, b = (correction @ at for correction in corrections)
    tolerance = 0.15 + 0.02 * travelled
    return (
        math.hypot(a.x - b.x, a.y - b.y) < tolerance and abs(normalize_angle(a.yaw - b.yaw)) < 0.04 + 0.005 * travelled
    )
