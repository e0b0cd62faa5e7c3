"""Random reachable start and goal pairs on maps, planned by every search-based planner and checked for collisions."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.bringup import build_costmap
from navstack.core import INSCRIBED, LETHAL, Costmap, Footprint, FrameTree, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import PlanningError
from navstack.interfaces import GlobalPlanner, Plan
from navstack.parameters.configuration import Configuration

SEARCHING: Final = ("navfn", "global_planner", "astar", "theta_star")
"""Built-in planners that find every reachable goal; carrot_planner follows the straight line and may stop short."""
_POINTS_PER_CELL: Final = 20


@dataclass(frozen=True, slots=True)
class PairResult:
    """The plan of one planner for one pair. All numbers are NaN or 0 without a plan."""

    planner: str
    start: Pose2D
    goal: Pose2D
    error: str | None
    """Why planning failed; None if it succeeded."""
    blocked: int
    """Number of points of the path in blocked cells."""
    length_m: float = math.nan
    time_ms: float = math.nan
    cost: float = math.nan
    """In the unit of the planner."""
    clearance_m: float = math.nan
    expanded: int = 0


def costmap_of(configuration: Configuration, grid: OccupancyGrid) -> Costmap:
    """The global costmap without any sensor data: the map and its inflation."""
    frames = FrameTree()
    params = configuration.global_costmap.params
    frames.set_static(params.global_frame, params.robot_base_frame, Transform2D(0.0, 0.0, 0.0))
    costmap = build_costmap("global_costmap", configuration.global_costmap, frames, grid)
    costmap.update(0.0)
    return costmap.master


def reachable_pairs(costmap: Costmap, count: int, seed: int = 0) -> list[tuple[Pose2D, Pose2D]]:
    """Random pairs of cells with a cost below 253 in the same 4-connected region, the border cells excluded.

    Poses are cell centres (m, in the costmap's frame) with a yaw in -3 .. 3 rad. Empty if no region has two cells.
    """
    from scipy import ndimage

    free = costmap.data < INSCRIBED
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    regions: NDArray[np.int32]
    regions, _ = ndimage.label(free)  # pyright: ignore[reportGeneralTypeIssues, reportAssignmentType, reportUnknownMemberType]
    sizes = np.bincount(regions.reshape(-1))
    starts = np.flatnonzero((regions.reshape(-1) > 0) & (sizes[regions.reshape(-1)] > 1))
    if len(starts) == 0:
        return []
    rng = np.random.default_rng(seed)
    nx = costmap.geometry.nx
    pairs: list[tuple[Pose2D, Pose2D]] = []
    for _ in range(count):
        a = int(rng.choice(starts))
        b = int(rng.choice(np.flatnonzero(regions.reshape(-1) == regions.reshape(-1)[a])))
        start, goal = (
            Pose2D(*costmap.geometry.cell_to_world(k % nx, k // nx), float(rng.uniform(-3, 3))) for k in (a, b)
        )
        pairs.append((start, goal))
    return pairs


def blocked_points(plan: Plan, costmap: Costmap, *, corners: bool) -> int:
    """Number of points of the path, sampled 20 per cell, in cells of cost 253 or 254 or outside the costmap.

    `corners`: the poses are lower left corners of cells, as for navfn. Points on the edge between cells are ignored.
    """
    g = costmap.geometry
    xy = (plan.path.poses[:, :2] - (g.origin_x, g.origin_y)) / g.resolution
    if corners:
        xy = xy[:-1] + 0.5  # the last pose is the goal itself
    pieces = [xy[:1]]
    for a, b in pairwise(xy):
        n = max(1, int(np.ceil(np.hypot(*(b - a)) * _POINTS_PER_CELL)))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    points = np.concatenate(pieces)
    points = points[np.abs(points - np.rint(points)).min(axis=1) > 1e-6]
    cells = np.floor(points).astype(np.int64)
    inside = (cells >= 0).all(axis=1) & (cells < (g.nx, g.ny)).all(axis=1)
    costs = costmap.data[cells[inside, 1], cells[inside, 0]]
    return int((~inside).sum() + ((costs == INSCRIBED) | (costs == LETHAL)).sum())


def reset_planner(planner: GlobalPlanner) -> None:
    """Clears the caches of a planner, so that it makes the next plan from scratch."""
    reset = getattr(planner, "reset", None)
    if reset is not None:
        reset()


def run_pairs(
    planners: Mapping[str, GlobalPlanner],
    costmap: Costmap,
    pairs: Sequence[tuple[Pose2D, Pose2D]],
    *,
    footprint: Footprint | None = None,
) -> list[PairResult]:
    """Plans every pair with every planner, from scratch.

    `time_ms` is the wall time of `make_plan`, after an untimed first plan.
    """
    results: list[PairResult] = []
    for name, planner in planners.items():
        for start, goal in pairs[:1]:  # untimed: allocates, and compiles on the first run
            with suppress(PlanningError):
                planner.make_plan(costmap, start, goal, footprint=footprint)
        for start, goal in pairs:
            reset_planner(planner)
            started = time.perf_counter()
            try:
                plan = planner.make_plan(costmap, start, goal, footprint=footprint)
            except PlanningError as error:
                results.append(PairResult(name, start, goal, str(error), 0))
                continue
            elapsed = (time.perf_counter() - started) * 1e3
            results.append(
                PairResult(
                    planner=name,
                    start=start,
                    goal=goal,
                    error=None,
                    blocked=blocked_points(plan, costmap, corners=name == "navfn"),
                    length_m=plan.length_m,
                    time_ms=elapsed,
                    cost=plan.cost,
                    clearance_m=plan.clearance_m(costmap),
                    expanded=plan.cells_expanded,
                )
            )
    return results
