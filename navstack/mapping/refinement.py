"""The last step of a mapping: every keyframe is matched with all places near it, before and after, and the graph solved again.

While a log is read, a scan is matched with those before it, and the odometry predicts where. What the scans leave open, as
along a corridor, then has the systematic errors of the odometry, and a lidar that sees little adds its noise scan by scan.
Here the odometry is calibrated by the solved graph, each of its steps is an edge with the noise that it turned out to have, and
each scan is matched with every submap that it overlaps but its own. Sources: Konolige et al. (Efficient Sparse Pose Adjustment
for 2D Mapping, IROS 2010) for submaps and neighbors; Censi et al. (Simultaneous calibration of odometry and sensor parameters
for mobile robots, T-RO 2013) for the model of the odometry.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Transform2D, normalize_angles
from navstack.mapping.loops import EDGE_FLOOR, edge_information, position_information, without_chance, worst_direction
from navstack.mapping.matching import WEAK, Match, Surfaces
from navstack.mapping.pose_graph import Edge, PoseGraph, solve

SUBMAP: Final = 6
"""Keyframes that follow each other and make a submap: little drift among them, and enough walls."""
NEIGHBORS: Final = 3
"""Submaps before and after its own that a scan is matched with,"""
OTHERS: Final = 3
"""and others near it, seen at other times,"""
NEAR_M: Final = 4.0
"""whose walls are nearer than this to those of the scan, on average,"""
PATH_M: Final = 20.0
"""and that a path in the graph shorter than this connects with it: farther ones may be off by more than a match corrects."""
POINTS: Final = 120
"""Points of a scan that are matched: more of them changes nothing."""
LEAST_RESPONSE: Final = 0.3
"""A scan of which a submap explains less does not match it."""
_ITERATIONS: Final = 6
_SHIFTS_M: Final = (-0.3, -0.15, 0.15, 0.3)
"""From where else a match begins, in the direction that it determines worst: after a slip in a corridor, the wrong corners of
niches are near."""
_GAIN: Final = 0.01
"""A match from elsewhere must explain this much more of the scan: corners are a small share of the walls of a corridor."""
_UNEVEN: Final = 0.05
"""Information in the worst direction, relative to the best, below which a match is tried from elsewhere."""
_FAR_M, _FARTHEST_M = 0.25, 0.6
"""A match that moves a scan farther does not count: with another time, and with its neighbors after a slip."""
_KERNEL_WIDTH: Final = 3.0
"""Edges with an error of more standard deviations lose weight: slips, and matches with the wrong wall."""
_BLIND_NOISE: Final = (0.05, 0.05, 0.03)
"""Standard deviations of a step without odometry, which only the match of its time tells (m, m, rad)."""
WINDOW: Final = 8
"""Steps over which the noise of the odometry is told from that of the poses: the one grows with the way, the other does not."""
_ROUNDS: Final = 5
"""Of the regression; its weights change little after three."""
_LEAST_STEPS: Final = 20
"""Fewer steps with odometry do not calibrate it."""
_LEAST_NOISE: Final = 0.01
"""Per meter (m/m, rad/m): no odometry is assumed to be better."""
_LEAST_TURN_NOISE: Final = 0.02
"""The same of the heading, per angle turned."""
_STEP_NOISE: Final = 0.002
"""Of a step of any length (m, rad)."""


class Calibration(NamedTuple):
    """Systematic and random errors of an odometry, by comparison with the poses of a graph."""

    scale: float
    """By which its distances are to be multiplied."""
    turn_scale: float
    """By which its turns are to be multiplied."""
    curve: float
    """Turn per distance to add (rad/m)."""
    noise: tuple[float, float, float]
    """Standard deviations of a step of mean length: forward, to the left (m) and of its turn (rad)."""
    mean_step: float
    """Mean length of the steps (m)."""
    steps: int
    """Number of steps that it is calibrated by; 0: they were too few, and it counts as free of systematic errors."""

    def deviations(self, steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviations (n, 3) of steps (n, 3): their variance grows with the way."""
        away = np.hypot(steps[:, 0], steps[:, 1])
        random = np.sqrt(away / self.mean_step)[:, None] * np.array(self.noise)
        least = _LEAST_NOISE * away[:, None] + np.abs(steps[:, 2:]) * np.array([0.0, 0.0, _LEAST_TURN_NOISE])
        return np.maximum(random, least) + _STEP_NOISE

    def corrected(self, steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return steps (n, 3) without the systematic errors."""
        out = steps * np.array([self.scale, self.scale, self.turn_scale])
        out[:, 2] += self.curve * steps[:, 0]
        # the step of an arc ends where half of the added turn points
        half = 0.5 * (out[:, 2] - steps[:, 2])
        c, s = np.cos(half), np.sin(half)
        out[:, 0], out[:, 1] = c * out[:, 0] - s * out[:, 1], s * out[:, 0] + c * out[:, 1]
        return out


UNCALIBRATED: Final = Calibration(1.0, 1.0, 0.0, (0.03, 0.03, 0.03), 0.3, 0)
"""An odometry about which nothing is known."""


def calibrate(odometry: NDArray[np.float64], poses: NDArray[np.float64], known: NDArray[np.bool_]) -> Calibration:
    """Compare the steps (n - 1, 3) of an odometry with the poses (n, 3) of a graph; `known` (n - 1,): the steps that count.

    Robust: slips of the wheels have little weight.
    """
    made, told = _relative(poses[:-1], poses[1:])[known], odometry[known]
    count = len(told)
    if count < _LEAST_STEPS:
        return UNCALIBRATED
    ahead, turn = told[:, 0], told[:, 2]
    weight_ahead, weight_turn = np.ones(count), np.ones(count)
    scale, turn_scale, curve = 1.0, 1.0, 0.0
    # a weak prior: a robot that never turns says nothing about its turns
    for _ in range(_ROUNDS):
        scale = (1e-3 + float((weight_ahead * ahead * made[:, 0]).sum())) / (
            1e-3 + float((weight_ahead * ahead * ahead).sum())
        )
        a = 0.1 + float((weight_turn * turn * turn).sum())
        b = float((weight_turn * turn * ahead).sum())
        d = 0.1 + float((weight_turn * ahead * ahead).sum())
        error = made[:, 2] - turn
        p, q = float((weight_turn * turn * error).sum()), float((weight_turn * ahead * error).sum())
        turn_scale, curve = 1.0 + (d * p - b * q) / (a * d - b * b), (a * q - b * p) / (a * d - b * b)
        weight_ahead = _cauchy(made[:, 0] - scale * ahead)
        weight_turn = _cauchy(error - (turn_scale - 1.0) * turn - curve * ahead)
    found = Calibration(
        scale, turn_scale, curve, (0.0, 0.0, 0.0), max(float(np.hypot(told[:, 0], told[:, 1]).mean()), 1e-3), count
    )
    rest = made - found.corrected(told)
    noise = []
    for k in range(3):
        sums = np.convolve(rest[:, k], np.ones(WINDOW), "valid")
        noise.append(math.sqrt(max(_spread(sums) ** 2 - _spread(rest[:, k]) ** 2, 0.0) / (WINDOW - 1)))
    return found._replace(noise=(noise[0], noise[1], noise[2]))


def _spread(values: NDArray[np.float64]) -> float:
    """Return the standard deviation of a normal distribution with the median deviation of the values."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def _cauchy(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    width = 2.0 * max(_spread(errors), 1e-6)
    return 1.0 / (1.0 + (errors / width) ** 2)


def _relative(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the second poses (n, 3) seen from the first."""
    d, c, s = second - first, np.cos(first[:, 2]), np.sin(first[:, 2])
    return np.column_stack((c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], normalize_angles(d[:, 2])))


class Refined(NamedTuple):
    """What `refine` found."""

    poses: NDArray[np.float64]
    """(n, 3)."""
    edges: list[Edge]
    """The edges that they are the solution of: n - 1 steps of the odometry, loops, matches."""
    calibration: Calibration


def refine(
    poses: NDArray[np.float64],
    surface: Callable[[int], NDArray[np.float64]],
    odometry: NDArray[np.float64],
    matched: NDArray[np.float64],
    loops: Sequence[Edge],
    passes: int,
    starts: Sequence[int] = (),
) -> Refined:
    """Match every keyframe with all submaps near it, and solve the graph again, `passes` times.

    Args:
        poses: (n, 3) of the keyframes.
        surface: returns the points with normals (m, 4) of a keyframe in its frame.
        odometry: (n - 1, 3) steps from keyframe to keyframe by the odometry,
        matched: and by the matches of their time; the same where there was no odometry.
        loops: edges between places that were recognized, and to the `starts`; they stay.
        passes: one finds slips, another what the first has brought near.
        starts: keyframes that do not follow the one before them, in order; the steps to them do not count.
    """
    n = len(poses)
    known = np.abs(odometry - matched).max(axis=1) > 0.0
    follows = np.ones(n - 1, np.bool_)
    follows[np.array(starts, np.int64) - 1] = False
    middles = np.array([surface(k)[:, :2].mean(axis=0) for k in range(n)])
    chains = [range(first, end) for first, end in itertools.pairwise((0, *starts, n))]
    submaps: list[range] = []
    chain_of: list[range] = []
    for chain in chains:
        parts = [range(first, min(first + SUBMAP, chain.stop)) for first in range(chain.start, chain.stop, SUBMAP)]
        if len(parts) > 1 and len(parts[-1]) < SUBMAP // 2:
            parts[-2:] = [range(parts[-2][0], chain.stop)]
        submaps += parts
        chain_of += [chain] * len(parts)
    edges: list[Edge] = []
    calibration = calibrate(odometry, poses, known & follows)
    for _ in range(passes):
        steps = _steps(calibration, odometry, matched, known)
        edges = [*(edge for edge, counts in zip(steps, follows.tolist(), strict=True) if counts), *loops]
        wanted = _pairs(poses, middles, submaps, chain_of, edges)
        for submap, chain, keyframes in zip(submaps, chain_of, wanted, strict=True):
            edges += _matches(poses, surface, submap, chain, keyframes)
        graph = PoseGraph(poses, edges)
        poses = solve(graph, starts=("poses",), kernel_width=_KERNEL_WIDTH, max_iterations=20).poses
        calibration = calibrate(odometry, poses, known & follows)
    return Refined(poses, edges, calibration)


def _steps(
    calibration: Calibration, odometry: NDArray[np.float64], matched: NDArray[np.float64], known: NDArray[np.bool_]
) -> list[Edge]:
    """Return an edge from each keyframe to the next, by the calibrated odometry."""
    steps = np.where(known[:, None], calibration.corrected(odometry), matched)
    sigma = np.where(known[:, None], calibration.deviations(odometry), np.array(_BLIND_NOISE))
    rows = zip(steps.tolist(), sigma, strict=True)
    return [Edge(k, k + 1, Transform2D(*step), np.diag(1.0 / each**2), True) for k, (step, each) in enumerate(rows)]


def _pairs(
    poses: NDArray[np.float64],
    middles: NDArray[np.float64],
    submaps: list[range],
    chains: list[range],
    edges: list[Edge],
) -> list[list[int]]:
    """Return the keyframes to match with each submap; `chains`: the keyframes that follow each other around each submap."""
    from scipy.sparse import coo_matrix  # slow imports
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import KDTree

    n = len(poses)
    own = np.repeat(np.arange(len(submaps)), [len(submap) for submap in submaps])
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + c * middles[:, 0] - s * middles[:, 1]
    y = poses[:, 1] + s * middles[:, 0] + c * middles[:, 1]
    places = np.column_stack((x, y))
    centers = np.array([places[submap.start : submap.stop].mean(axis=0) for submap in submaps])
    links = np.array([(edge.i, edge.j, math.hypot(edge.measured.x, edge.measured.y) + 1e-3) for edge in edges])
    ij = links[:, :2].astype(np.int64).T
    graph = coo_matrix((links[:, 2], (ij[0], ij[1])), (n, n)).tocsr()
    tree: Any = KDTree(centers)
    count = min(len(submaps), 2 * NEIGHBORS + 1 + 3 * OTHERS)
    away, nearest = tree.query(places, k=list(range(1, count + 1)), distance_upper_bound=NEAR_M)
    candidates: list[list[int]] = [[] for _ in submaps]
    for k, b in zip(*np.nonzero(np.isfinite(away)), strict=True):
        other = int(nearest[k, b])
        if abs(other - own[k]) > NEIGHBORS or k not in chains[other]:
            candidates[other].append(int(k))
    others = np.zeros(n, np.int64)
    wanted: list[list[int]] = []
    for b, submap in enumerate(submaps):
        first, last = submaps[max(b - NEIGHBORS, 0)].start, submaps[min(b + NEIGHBORS, len(submaps) - 1)].stop
        wanted.append([k for k in range(max(first, chains[b].start), min(last, chains[b].stop)) if own[k] != b])
        if candidates[b]:
            middle = submap[len(submap) // 2]
            path = np.asarray(dijkstra(graph, directed=False, indices=middle, limit=PATH_M))
            near = [k for k in candidates[b] if math.isfinite(path[k]) and others[k] < OTHERS]
            others[near] += 1
            wanted[b] += near
    return wanted


def _matches(
    poses: NDArray[np.float64],
    surface: Callable[[int], NDArray[np.float64]],
    submap: range,
    chain: range,
    keyframes: list[int],
) -> list[Edge]:
    """Return the edges from the middle of a submap to the keyframes that match it."""
    if not keyframes:
        return []
    placed = [Transform2D(*pose) for pose in poses[submap.start : submap.stop].tolist()]
    surfaces = Surfaces([(surface(k), pose) for k, pose in zip(submap, placed, strict=True)], searchable=False)
    middle = submap[len(submap) // 2]
    origin = placed[middle - submap.start].inverse()
    found: list[Edge] = []
    for k in keyframes:
        points = surface(k)
        thin = np.ascontiguousarray(points[:: -(-len(points) // POINTS)])
        start = Transform2D(*poses[k].tolist())
        is_neighbor = k in chain and abs(k - middle) < (NEIGHBORS + 1) * SUBMAP
        match = _best(surfaces, thin, start, elsewhere=is_neighbor)
        x, y, yaw = match.pose.tolist()
        far = math.hypot(x - start.x, y - start.y)
        if match.response < LEAST_RESPONSE or far > (_FARTHEST_M if is_neighbor else _FAR_M):
            continue
        hessian = (match.hessian - np.diag([WEAK, WEAK, WEAK])) * (len(points) / len(thin))
        information = edge_information(without_chance(hessian), yaw, EDGE_FLOOR)
        found.append(Edge(middle, k, origin @ Transform2D(x, y, yaw), information, True))
    return found


def _best(surfaces: Surfaces, points: NDArray[np.float64], start: Transform2D, *, elsewhere: bool) -> Match:
    """Return the match near a pose; `elsewhere`: or a better one that begins beside it, in a direction that is open."""
    first = surfaces.align(points, start, rounds=_ITERATIONS)
    if not elsewhere or first.response < LEAST_RESPONSE:
        return first
    least, most = position_information(first.hessian)
    if least >= _UNEVEN * most:
        return first
    direction = worst_direction(first.hessian)
    x, y, yaw = first.pose.tolist()
    c, s = math.cos(direction), math.sin(direction)
    others = [surfaces.align(points, Transform2D(x + m * c, y + m * s, yaw), rounds=_ITERATIONS) for m in _SHIFTS_M]
    moved = np.array([c * (match.pose[0] - x) + s * (match.pose[1] - y) for match in others])
    gain = np.array([match.response - first.response for match in others])
    slopes = [(gain[i] - gain[j]) / (moved[i] - moved[j]) for i, j in ((0, 3), (1, 2)) if moved[i] != moved[j]]
    # moved back, the part that only this scan has seen comes to where others have seen walls: a gain that grows steadily
    if slopes and min(slopes) * max(slopes) > 0.0:
        gain -= moved * min(slopes, key=abs)
    best = int(np.argmax(gain))
    return others[best] if gain[best] > _GAIN and others[best].response >= LEAST_RESPONSE else first
