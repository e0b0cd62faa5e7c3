"""Pose graphs in the plane: least squares over relative poses, and the text format of g2o.

The sum to minimize is chi2 = sum of e' I e over the edges, without a factor 1/2, with e = z^-1 (x_i^-1 x_j) as in g2o.
Sources of the formulas: Grisetti et al. (A Tutorial on Graph-Based SLAM, IEEE ITS Magazine 2010); start from the rotations:
Carlone et al. (Initialization techniques for 3D SLAM, ICRA 2015), here for angles, which are linear but for whole turns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, LogError, Transform2D, atomic_write, normalize_angles, shortened
from navstack.logs import read_lines


class Edge(NamedTuple):
    """The measured pose of node `j` seen from node `i`; nodes are numbered from 0 in the order of the graph."""

    i: int
    j: int
    measured: Transform2D
    information: NDArray[np.float64]
    """(3, 3) inverse of the covariance of x, y (m), yaw (rad)."""
    is_loop: bool = False
    """Whether the robust kernel applies: a place was recognized, which may be wrong."""


@dataclass(slots=True, eq=False)
class PoseGraph:
    """Poses (n, 3) of x, y (m), yaw (rad), and the edges between them."""

    poses: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    edges: list[Edge] = field(default_factory=list[Edge])
    ids: list[int] = field(default_factory=list[int])
    """Name of each node in a file; empty: its number."""

    def __repr__(self) -> str:
        loops = sum(edge.is_loop for edge in self.edges)
        return f"PoseGraph({len(self.poses)} poses, {len(self.edges)} edges, {loops} of them loops)"

    def chi2(self, poses: NDArray[np.float64] | None = None) -> float:
        """Return the sum of the squared errors of the edges, weighted with their information."""
        return float(self.edge_chi2(poses).sum())

    def edge_chi2(self, poses: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Return (m,) e' I e of each edge, at the poses of the graph or at others."""
        return _chi2(_Arrays.of(self.edges), self.poses if poses is None else poses)


class Solution(NamedTuple):
    """What `solve` found."""

    poses: NDArray[np.float64]
    """(n, 3); the first pose is that of the graph."""
    chi2: float
    """Without the robust kernel."""
    edge_chi2: NDArray[np.float64]
    """(m,) of each edge."""
    iterations: int
    """Accepted steps, of the start that won."""
    start: str
    """Where it started: `poses`, `rotations` or `tree`."""
    converged: bool


@dataclass(frozen=True, slots=True)
class _Arrays:
    """The edges as arrays."""

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    measured: NDArray[np.float64]
    information: NDArray[np.float64]
    is_loop: NDArray[np.bool_]

    @classmethod
    def of(cls, edges: list[Edge]) -> _Arrays:
        m = len(edges)
        return cls(
            np.array([edge.i for edge in edges], np.int64),
            np.array([edge.j for edge in edges], np.int64),
            np.array([edge.measured for edge in edges], np.float64).reshape(m, 3),
            # many times as fast as an array of arrays
            np.concatenate([edge.information for edge in edges], dtype=np.float64).reshape(m, 3, 3)
            if edges
            else np.empty((0, 3, 3)),
            np.array([edge.is_loop for edge in edges], np.bool_),
        )


_CONVERGED: Final = 1e-9
"""Relative decrease of the cost at which the search ends: 1e-9 of the stated optima changes none of their digits."""
_GIVE_UP: Final = 1e12
"""Damping at which no step decreases the cost."""
_TURN_ROUNDS: Final = 10
"""Most rounds in which the whole turns of the linear rotations may change; the known graphs need 2 or 3."""


def solve(
    graph: PoseGraph,
    *,
    starts: Iterable[str] = ("rotations", "tree"),
    kernel_width: float | None = None,
    max_iterations: int = 100,
    least_step: float = 0.0,
) -> Solution:
    """Return the poses with the least chi2, by Levenberg-Marquardt from each of the `starts`; the best result counts.

    `starts`: `poses` (those of the graph), `tree` (a spanning tree of few edges), `rotations` (headings first, which are linear
    but for whole turns, then positions, which are linear given the headings). Far from the optimum the cost has local minima,
    and a start from rotations is the least likely to end in one. `kernel_width`: edges with `is_loop` have the cost of Cauchy
    with this width, in standard deviations, so that a wrong loop cannot bend the graph; None: every edge counts in full.
    `least_step` (m, rad): the search also ends when a step moves no pose by more; 0: at the optimum. The first pose stays.
    Raises InputError for a graph that is empty or in several pieces.
    """
    n = len(graph.poses)
    if n == 0 or (n > 1 and not graph.edges):
        raise InputError(f"the graph has {n} poses and {len(graph.edges)} edges, so there is nothing to solve")
    if n == 1:
        chi2 = graph.edge_chi2()
        return Solution(graph.poses.copy(), float(chi2.sum()), chi2, 0, "poses", True)
    arrays = _Arrays.of(graph.edges)
    best: tuple[float, Solution] | None = None
    for start in starts:
        if start == "poses":
            poses = graph.poses.copy()
        else:
            poses = _from_tree(graph, arrays)
            if start == "rotations":
                poses = _from_rotations(arrays, poses)
        cost, poses, count, converged = _descend(arrays, poses, kernel_width, max_iterations, least_step)
        poses[:, 2] = normalize_angles(poses[:, 2])
        if best is None or cost < best[0]:
            chi2 = _chi2(arrays, poses)
            best = cost, Solution(poses, float(chi2.sum()), chi2, count, start, converged)
    if best is None:
        raise InputError('give at least one start: "poses", "rotations" or "tree"', argument="starts")
    return best[1]


def _errors(arrays: _Arrays, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (m, 3) errors of the edges."""
    first, second, z = poses[arrays.i], poses[arrays.j], arrays.measured
    delta = _rotated(second[:, :2] - first[:, :2], -first[:, 2])
    out = np.empty((len(z), 3))
    out[:, :2] = _rotated(delta - z[:, :2], -z[:, 2])
    out[:, 2] = normalize_angles(second[:, 2] - first[:, 2] - z[:, 2])
    return out


def _chi2(arrays: _Arrays, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (m,) e' I e of each edge."""
    e = _errors(arrays, poses)
    return np.einsum("ma,mab,mb->m", e, arrays.information, e)


def _rotated(points: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    c, s = np.cos(angles), np.sin(angles)
    return np.column_stack((c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]))


def _jacobians(arrays: _Arrays, poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the derivatives (m, 3, 3) of the errors by the first and by the second pose of each edge."""
    first, second = poses[arrays.i], poses[arrays.j]
    angle = first[:, 2] + arrays.measured[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    m = len(angle)
    at_j = np.zeros((m, 3, 3))
    at_j[:, 0, 0], at_j[:, 0, 1], at_j[:, 1, 0], at_j[:, 1, 1] = c, s, -s, c
    at_j[:, 2, 2] = 1.0
    at_i = -at_j
    dx, dy = (second[:, :2] - first[:, :2]).T
    at_i[:, 0, 2], at_i[:, 1, 2] = -s * dx + c * dy, -c * dx - s * dy
    return at_i, at_j


def _cost(
    arrays: _Arrays, poses: NDArray[np.float64], width: float | None
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the cost, the errors (m, 3), and the weight (m,) that the kernel leaves each edge."""
    e = _errors(arrays, poses)
    square = np.einsum("ma,mab,mb->m", e, arrays.information, e)
    if width is None:
        return float(square.sum()), e, np.ones(len(square))
    ratio = square / width**2
    cost = np.where(arrays.is_loop, width**2 * np.log1p(ratio), square)
    return float(cost.sum()), e, np.where(arrays.is_loop, 1.0 / (1.0 + ratio), 1.0)


def _descend(
    arrays: _Arrays, poses: NDArray[np.float64], width: float | None, max_iterations: int, least_step: float
) -> tuple[float, NDArray[np.float64], int, bool]:
    """Return cost, poses, number of steps and whether they converged (Levenberg-Marquardt with Nielsen's damping)."""
    cost, e, weights = _cost(arrays, poses, width)
    damping, growth, steps = 1e-6, 2.0, 0
    while steps < max_iterations:
        at_i, at_j = _jacobians(arrays, poses)
        weighted = arrays.information * weights[:, None, None]
        hessian, gradient = _normal_equations(arrays, at_i, at_j, weighted, e, len(poses))
        diagonal = hessian.diagonal()
        while True:
            step = _solved(hessian, diagonal, damping, gradient)
            moved = poses.copy()
            moved[1:] += step.reshape(-1, 3)
            now, e_now, weights_now = _cost(arrays, moved, width)
            if now <= cost and np.isfinite(now):
                break
            damping, growth = damping * growth, growth * 2.0
            if damping > _GIVE_UP:
                return cost, poses, steps, True
        decrease = cost - now
        poses, cost, e, weights = moved, now, e_now, weights_now
        damping, growth, steps = max(damping / 10.0, 1e-12), 2.0, steps + 1
        if decrease <= _CONVERGED * (cost + 1e-12) or float(np.abs(step).max()) < least_step:
            return cost, poses, steps, True
    return cost, poses, steps, False


def _normal_equations(
    arrays: _Arrays,
    at_i: NDArray[np.float64],
    at_j: NDArray[np.float64],
    information: NDArray[np.float64],
    e: NDArray[np.float64],
    n: int,
) -> tuple[Any, NDArray[np.float64]]:
    """Return the sparse Hessian and the gradient, without the first pose."""
    from scipy.sparse import coo_matrix  # slow import

    nodes, parts = (arrays.i, arrays.j), (at_i, at_j)
    weighted = [np.einsum("mba,mbc->mac", part, information) for part in parts]
    gradient = np.zeros((n, 3))
    rows, columns, values = [], [], []
    three = np.arange(3)
    for a in range(2):
        np.add.at(gradient, nodes[a], np.einsum("mac,mc->ma", weighted[a], e))
        for b in range(2):
            block = np.einsum("mab,mbc->mac", weighted[a], parts[b])
            row, column = 3 * nodes[a][:, None, None] + three[:, None], 3 * nodes[b][:, None, None] + three[None, :]
            rows.append(np.broadcast_to(row, block.shape).ravel())
            columns.append(np.broadcast_to(column, block.shape).ravel())
            values.append(block.ravel())
    row, column, value = (np.concatenate(each) for each in (rows, columns, values))
    inside = (row >= 3) & (column >= 3)
    shape = (3 * n - 3, 3 * n - 3)
    hessian = coo_matrix((value[inside], (row[inside] - 3, column[inside] - 3)), shape).tocsc()
    return hessian, gradient.ravel()[3:]


def _solved(
    hessian: Any, diagonal: NDArray[np.float64], damping: float, gradient: NDArray[np.float64]
) -> NDArray[np.float64]:
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    matrix = (hessian + diags(damping * np.maximum(diagonal, 1e-9))).tocsc()
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return -factors.solve(gradient)


def _from_tree(graph: PoseGraph, arrays: _Arrays) -> NDArray[np.float64]:
    """Return poses that are composed along a spanning tree with the fewest edges to the first node."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order

    n = len(graph.poses)
    by_pair: dict[tuple[int, int], Transform2D] = {}
    for edge in graph.edges:
        by_pair.setdefault((edge.i, edge.j), edge.measured)
    ones = np.ones(len(arrays.i))
    links = coo_matrix((ones, (arrays.i, arrays.j)), (n, n)).tocsr()
    order, before = breadth_first_order(links, 0, directed=False)
    if len(order) < n:
        missing = int(np.setdiff1d(np.arange(n), order)[0])
        name = graph.ids[missing] if graph.ids else missing
        raise InputError(
            f"the graph is in pieces: pose {name} and {n - len(order) - 1} others are not connected with the first one; "
            "solve each piece on its own",
            node=name,
        )
    poses = graph.poses.copy()
    for k in order[1:].tolist():
        parent = int(before[k])
        step = by_pair.get((parent, k)) or by_pair[(k, parent)].inverse()
        poses[k] = Transform2D(*poses[parent].tolist()) @ step
    return poses


def _from_rotations(arrays: _Arrays, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses from headings that fit best by themselves, and the positions that fit best to these."""
    poses = start.copy()
    weight = np.maximum(arrays.information[:, 2, 2], 1e-9)
    n = len(poses)
    for _ in range(_TURN_ROUNDS):
        e = normalize_angles(poses[arrays.j, 2] - poses[arrays.i, 2] - arrays.measured[:, 2])
        poses[1:, 2] += _linear(arrays, n, weight[:, None, None], e[:, None])[:, 0]
        after = normalize_angles(poses[arrays.j, 2] - poses[arrays.i, 2] - arrays.measured[:, 2])
        if abs(float((weight * e * e).sum() - (weight * after * after).sum())) <= 1e-9 * float((weight * e * e).sum()):
            break
    # positions: the translation of an edge in the map is known, given the heading of its first node
    heading = poses[arrays.i, 2]
    c, s = np.cos(heading + arrays.measured[:, 2]), np.sin(heading + arrays.measured[:, 2])
    rotation = np.stack((np.stack((c, -s), axis=1), np.stack((s, c), axis=1)), axis=1)
    world = np.einsum("mab,mbc,mdc->mad", rotation, arrays.information[:, :2, :2], rotation)
    e = poses[arrays.j, :2] - poses[arrays.i, :2] - _rotated(arrays.measured[:, :2], heading)
    poses[1:, :2] += _linear(arrays, n, world, e)
    return poses


def _linear(arrays: _Arrays, n: int, information: NDArray[np.float64], e: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (n - 1, d) values that fit best to differences `-e` (m, d) with `information` (m, d, d); the first is 0."""
    from scipy.sparse import coo_matrix

    d = e.shape[1]
    steps = np.arange(d)
    rows, columns, values, gradient = [], [], [], np.zeros((n, d))
    pushed = np.einsum("mab,mb->ma", information, e)
    for a, sign_a in ((arrays.i, -1.0), (arrays.j, 1.0)):
        np.add.at(gradient, a, sign_a * pushed)
        for b, sign_b in ((arrays.i, -1.0), (arrays.j, 1.0)):
            shape = information.shape
            rows.append(np.broadcast_to(d * a[:, None, None] + steps[:, None], shape).ravel())
            columns.append(np.broadcast_to(d * b[:, None, None] + steps[None, :], shape).ravel())
            values.append((sign_a * sign_b * information).ravel())
    row, column, value = (np.concatenate(each) for each in (rows, columns, values))
    inside = (row >= d) & (column >= d)
    size = (n - 1) * d
    matrix: Any = coo_matrix((value[inside], (row[inside] - d, column[inside] - d)), (size, size)).tocsc()
    return _solved(matrix, matrix.diagonal(), 0.0, gradient.ravel()[d:]).reshape(-1, d)


# ----------------------------------------------------------------------------------------------------------------------
# The text format of g2o: VERTEX_SE2 id x y yaw; EDGE_SE2 i j dx dy dyaw I11 I12 I13 I22 I23 I33; FIX id.


_FIELDS: Final = {"VERTEX_SE2": 5, "EDGE_SE2": 12, "FIX": 2}


def read_g2o(path: str | Path) -> PoseGraph:
    """Read a graph in the plane, plain or compressed with gzip. Nodes that only edges name are placed by a spanning tree.

    Raises LogError with file and line for a line that is none of the format, and InputError for a graph in pieces.
    """
    file = Path(path)
    vertices: dict[int, tuple[float, ...]] = {}
    found: list[tuple[int, int, list[float]]] = []
    for number, text in read_lines(file):
        fields = text.partition("#")[0].split()
        if not fields:
            continue
        tag, wanted = fields[0], _FIELDS.get(fields[0])
        if wanted is None:
            raise _line_error(
                file, number, f"{shortened(tag, 30)} is not supported; lines begin with {', '.join(_FIELDS)}"
            )
        if len(fields) != wanted:
            raise _line_error(file, number, f"{tag} must be followed by {wanted - 1} numbers, not {len(fields) - 1}")
        count = 2 if tag == "EDGE_SE2" else 1
        try:
            names = [int(word) for word in fields[1 : 1 + count]]
            values = [float(word) for word in fields[1 + count :]]
        except ValueError:
            values = [math.nan]
            names = []
        if not all(map(math.isfinite, values)):
            raise _line_error(file, number, f'"{shortened(text.strip(), 80)}" has a field that is not a finite number')
        if tag == "VERTEX_SE2":
            vertices[names[0]] = tuple(values)
        elif tag == "EDGE_SE2":
            if names[0] == names[1]:
                raise _line_error(file, number, f"the edge connects pose {names[0]} with itself; remove the line")
            found.append((names[0], names[1], values))
    if not found:
        raise LogError(f"{file} has no EDGE_SE2 line, so there is no graph to solve", file=str(file))
    ids = sorted({*vertices, *(i for i, _, _ in found), *(j for _, j, _ in found)})
    place = {name: k for k, name in enumerate(ids)}
    edges = [Edge(place[i], place[j], Transform2D(*v[:3]), _symmetric(v[3:]), abs(i - j) > 1) for i, j, v in found]
    graph = PoseGraph(np.array([vertices.get(name, (0.0, 0.0, 0.0)) for name in ids], np.float64), edges, ids)
    if len(vertices) < len(ids):
        graph.poses = _from_tree(graph, _Arrays.of(edges))
    return graph


def write_g2o(graph: PoseGraph, path: str | Path) -> Path:
    """Write a graph; numbers have all digits, so that reading gives the same graph."""
    names = graph.ids or range(len(graph.poses))
    upper = np.triu_indices(3)
    with atomic_write(Path(path)) as out, out.open("w", encoding="utf-8") as file:
        for name, pose in zip(names, graph.poses.tolist(), strict=True):
            file.write(f"VERTEX_SE2 {name} {' '.join(map(repr, pose))}\n")
        file.write(f"FIX {names[0]}\n")
        for edge in graph.edges:
            numbers = [*map(float, edge.measured), *edge.information[upper].tolist()]
            file.write(f"EDGE_SE2 {names[edge.i]} {names[edge.j]} {' '.join(map(repr, numbers))}\n")
    return Path(path)


def _symmetric(values: list[float]) -> NDArray[np.float64]:
    a, b, c, d, e, f = values
    return np.array([[a, b, c], [b, d, e], [c, e, f]])


def _line_error(path: Path, number: int, problem: str) -> LogError:
    return LogError(f"{path}:{number}: {problem}", file=str(path), line=number)
