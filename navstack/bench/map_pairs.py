"""Random reachable pairs on maps, for every planner that searches, and a referee that looks at where their paths go."""

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
"""Built-in planners that find every reachable goal; carrot_planner goes straight and may stop short."""
_PER_CELL: Final = 20


@dataclass(frozen=True, slots=True)
class PairResult:
    """What a planner made of one pair."""

    planner: str
    start: Pose2D
    goal: Pose2D
    error: str | None
    """Why there is no plan; None when there is one."""
    blocked: int
    """Points of the path that lie in blocked cells."""
    length_m: float = math.nan
    """As all below, of a plan only."""
    time_ms: float = math.nan
    cost: float = math.nan
    """In the planner's own unit."""
    clearance_m: float = math.nan
    expanded: int = 0


def costmap_of(configuration: Configuration, grid: OccupancyGrid) -> Costmap:
    """The global costmap of a robot that has seen nothing but the map."""
    frames = FrameTree()
    params = configuration.global_costmap.params
    frames.set_static(params.global_frame, params.robot_base_frame, Transform2D(0.0, 0.0, 0.0))
    costmap = build_costmap("global_costmap", configuration.global_costmap, frames, grid)
    costmap.update(0.0)
    return costmap.master


def reachable_pairs(costmap: Costmap, count: int, seed: int = 0) -> list[tuple[Pose2D, Pose2D]]:
    """Pairs of cells below 253 in one 4-connected region that keeps off the outermost ring; empty when no region has two.

    Poses are centres of cells (m, in the costmap's frame) of any yaw in -3 .. 3 rad; `seed` draws them.
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
    """How many points of the path, 20 to a cell and its corners, lie in cells of cost 253 or 254 or outside.

    `corners`: the path's points stand for the cell they are the lower left corner of, as navfn's. A point on the very
    edge of a cell lies in none.
    """
    g = costmap.geometry
    xy = (plan.path.poses[:, :2] - (g.origin_x, g.origin_y)) / g.resolution
    if corners:
        xy = xy[:-1] + 0.5  # the last is the goal itself
    pieces = [xy[:1]]
    for a, b in pairwise(xy):
        n = max(1, int(np.ceil(np.hypot(*(b - a)) * _PER_CELL)))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    points = np.concatenate(pieces)
    points = points[np.abs(points - np.rint(points)).min(axis=1) > 1e-6]
    cells = np.floor(points).astype(np.int64)
    inside = (cells >= 0).all(axis=1) & (cells < (g.nx, g.ny)).all(axis=1)
    costs = costmap.data[cells[inside, 1], cells[inside, 0]]
    return int((~inside).sum() + ((costs == INSCRIBED) | (costs == LETHAL)).sum())


def forget_plans(planner: GlobalPlanner) -> None:
    """Lets a planner that keeps something between plans forget it, so that the next plan is made from scratch."""
    forget = getattr(planner, "forget", None)
    if forget is not None:
        forget()


def run_pairs(
    planners: Mapping[str, GlobalPlanner],
    costmap: Costmap,
    pairs: Sequence[tuple[Pose2D, Pose2D]],
    *,
    footprint: Footprint | None = None,
) -> list[PairResult]:
    """Every pair by every planner, from scratch, one planner after the other.

    Kernels are compiled and arrays made before the first pair is timed; `time_ms` is wall time of `make_plan`.
    """
    results: list[PairResult] = []
    for name, planner in planners.items():
        for start, goal in pairs[:1]:  # allocates, and compiles on a first run: not to be timed
            with suppress(PlanningError):
                planner.make_plan(costmap, start, goal, footprint=footprint)
        for start, goal in pairs:
            forget_plans(planner)
            began = time.perf_counter()
            try:
                plan = planner.make_plan(costmap, start, goal, footprint=footprint)
            except PlanningError as error:
                results.append(PairResult(name, start, goal, str(error), 0))
                continue
            took = (time.perf_counter() - began) * 1e3
            results.append(
                PairResult(
                    planner=name,
                    start=start,
                    goal=goal,
                    error=None,
                    blocked=blocked_points(plan, costmap, corners=name == "navfn"),
                    length_m=plan.length_m,
                    time_ms=took,
                    cost=plan.cost,
                    clearance_m=plan.clearance_m(costmap),
                    expanded=plan.cells_expanded,
                )
            )
    return results
