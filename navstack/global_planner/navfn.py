"""navfn: the default global planner of move_base, and the one of Nav2.

Source: navfn/src/navfn.cpp and navfn_ros.cpp (K. Konolige); algorithms.md 3. nav2_navfn_planner/src/navfn_planner.cpp.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import ClassVar, overload

import numpy as np

from navstack.core import (
    LETHAL,
    Costmap,
    Footprint,
    GridGeometry,
    NoValidPathError,
    Path,
    Pose2D,
)
from navstack.global_planner._search import planning_errors as errors
from navstack.global_planner._search.base import Route, SearchParams, SearchPlanner, Unreachable
from navstack.global_planner._search.best_first import UNLIMITED
from navstack.global_planner._search.cells import Cell, SearchSpace, navfn_costs
from navstack.global_planner._search.plan_cache import Request
from navstack.global_planner._search.propagation import NavfnPropagation, StraightAStarPropagation
from navstack.global_planner._search.start_goal import (
    SearchStart,
    StartPolicy,
    cells_of,
    goal_candidates,
    unknown_not_tracked,
    with_yaw_in_range,
)
from navstack.global_planner._search.traceback import NavfnTraceback
from navstack.global_planner._search.wave_search import WaveSearch
from navstack.plugins import GLOBAL_PLANNERS, CheckContext, Issue, ParamModel, Plan, param


class NavfnParams(SearchParams):
    """Parameters of NavfnROS, and additional ones."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "planner_window_x": "read by NavfnROS, never used",
        "planner_window_y": "read by NavfnROS, never used",
    }

    allow_unknown: bool = param(True, "whether paths may cross unknown cells, at cost 253")
    visualize_potential: bool = param(False, "return the potential with every plan, for visualization")
    use_astar: bool = param(
        False,
        "A* instead of Dijkstra: expands fewer cells for a path of the same cost (within 1 %)",
        ros_differs="C++ navfn has an A* that NavfnROS cannot use; its paths cost up to 20 % more and it fails on large maps",
    )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)


@GLOBAL_PLANNERS.register("navfn", aliases=("navfn/NavfnROS",))
class NavfnROS(SearchPlanner):
    """navfn: a Dijkstra wavefront from the start and gradient descent from the goal.

    As in NavfnROS, the outermost ring of cells is blocked, the start cell counts as free, and the path's points are on cell
    corners with yaw 0, followed by the goal pose. With `default_tolerance` the plan may end at the nearest reachable point
    of a lattice around the goal. `Plan.cost` is the potential at the end of the plan: 50 per free cell, up to 253 near
    obstacles.

    # ROS differs: there is no limit on rounds, queued cells or path points (parity 4, 5, 6); A* is correct (parity 7); the
    # costmap is never written to (C++ frees the start cell in it).
    """

    Params = NavfnParams

    def __init__(self, params: NavfnParams | None = None) -> None:
        p = params or NavfnParams()
        search = WaveSearch(
            navfn_costs(p.allow_unknown),
            NavfnPropagation(),
            NavfnTraceback(),
            use_astar=p.use_astar,
            max_expanded=p.expansion_limit,
            keep_potential=p.visualize_potential,
        )
        super().__init__(p, search)


class Nav2NavfnParams(ParamModel):
    """Parameters of Nav2's NavfnPlanner."""

    tolerance: float = param(
        0.5,
        "half the side of the square around the goal; if the goal is unreachable, the plan ends at the nearest reachable point "
        "in it",
        unit="m",
        ge=0.0,
    )
    use_astar: bool = param(
        False,
        "A* instead of Dijkstra: expands fewer cells, for a path that may cost more; `navfn` has an A* without that loss",
    )
    allow_unknown: bool = param(True, "whether paths may cross unknown cells, at cost 253")
    max_cycles_factor: int = param(
        4, "a path of more points than this times the longer side of the costmap (cells) is no path", ge=1
    )
    use_final_approach_orientation: bool = param(
        False, "whether the heading at the end is that of the last step, not the goal's"
    )

    start_policy: ClassVar[StartPolicy] = "clear_cell"
    expansion_limit: ClassVar[int] = UNLIMITED

    @property
    def default_tolerance(self) -> float:
        """`tolerance`, as the other planners call it."""
        return self.tolerance

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)


_SAME_PLACE_M2: float = 1e-6
"""Squared distance (m^2) below which Nav2 does not append the goal to a path."""
_SAME_POINT_M: float = 1e-4
"""The last step of a path that is shorter along both axes has no direction, to Nav2."""


@GLOBAL_PLANNERS.register("nav2_navfn", aliases=("nav2_navfn_planner/NavfnPlanner",))
class Nav2NavfnPlanner(SearchPlanner):
    """navfn as in Nav2: the wave and the descent of `navfn`, with Nav2's cells, tolerance, end of the path and A*.

    As in Nav2, the cell of a point is that of the nearest cell corner, so the path lies up to half a cell beside the cells of
    the costmap: `astar` and `theta_star` do not have that offset. Yaws are 0 but the last one.

    # Nav2 differs: there a start within the last half cell of the map becomes the first cell of the next row, and the number
    # of rounds and of queued cells is limited; the costmap is never written to (C++ frees the start cell in it).
    """

    Params = Nav2NavfnParams
    NAMESPACES: ClassVar[tuple[str, ...]] = ("GridBased",)
    params: Nav2NavfnParams
    tolerance_name = "tolerance"

    def __init__(self, params: Nav2NavfnParams | None = None) -> None:
        p = params or Nav2NavfnParams()
        search = WaveSearch(
            navfn_costs(p.allow_unknown),
            StraightAStarPropagation() if p.use_astar else NavfnPropagation(),
            NavfnTraceback(),
            guided=not p.use_astar,
        )
        super().__init__(p, search)  # pyright: ignore[reportArgumentType]

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Plan between two poses in the frame of the costmap; errors as `SearchPlanner.make_plan`.

        Raises GoalOccupiedError only with a tolerance of 0 and a goal in a lethal cell, as Nav2; a goal that is occupied or
        unreachable otherwise is a NoValidPathError.
        """
        p = self.params
        _, (ix, iy) = cells_of(costmap, start, goal)
        if p.tolerance == 0.0 and costmap.data[iy, ix] == LETHAL:
            space = SearchSpace(costmap, self._search.costs, self._search.border_blocked)
            raise errors.goal_occupied(space, goal, (ix, iy), p.tolerance)
        if start[:2] == goal[:2]:
            began = time.perf_counter()
            end = with_yaw_in_range(start if p.use_final_approach_orientation else goal)
            path = Path(np.array([end], np.float64), costmap.frame)
            return Plan(path=path, cost=0.0, goal=end, took_s=time.perf_counter() - began)
        return super().make_plan(costmap, start, goal, footprint=footprint, keep_potential=keep_potential)

    def _cells_of(self, costmap: Costmap, start: Pose2D, goal: Pose2D) -> tuple[Cell, Cell]:
        cells_of(costmap, start, goal)
        return _clipped(costmap.geometry, start), _clipped(costmap.geometry, goal)

    def _goals(self, begin: SearchStart, goal: Pose2D, tolerance: float) -> Sequence[tuple[Pose2D, Cell]]:
        # blocked ones, too: the wave runs until it reaches the goal's own cell
        return _Goals(begin.space.costmap, goal, tolerance)

    def _plan(self, request: Request, begin: SearchStart, route: Route, began: float) -> Plan:
        points, goal = route.points, route.goal
        longer = max(request.geometry.nx, request.geometry.ny)
        if len(points) > self.params.max_cycles_factor * longer:
            raise NoValidPathError(
                f"the path has {len(points)} points, more than max_cycles_factor = {self.params.max_cycles_factor} times the "
                f"longer side of the costmap, {longer} cells; increase max_cycles_factor",
                points=len(points),
            )
        if len(points) >= 2:
            (x1, y1), (x2, y2) = points[-2:].tolist()
            to_last = (x2 - x1) ** 2 + (y2 - y1) ** 2
            to_goal = (goal.x - x1) ** 2 + (goal.y - y1) ** 2
            if to_last > to_goal or (x2 - goal.x) ** 2 + (y2 - goal.y) ** 2 < _SAME_PLACE_M2:
                points = points[:-1]
        plan = super()._plan(request, begin, route._replace(points=points), began)
        if not self.params.use_final_approach_orientation:
            return plan
        poses = plan.path.poses.copy()
        step = poses[-1] - poses[-2]
        if len(poses) > 2 and abs(step[0]) < _SAME_POINT_M and abs(step[1]) < _SAME_POINT_M:
            step = poses[-1] - poses[-3]
        poses[-1, 2] = math.atan2(step[1], step[0])
        path = Path(poses, plan.path.frame)
        return replace(plan, path=path, goal=path[-1])

    def _error(
        self, space: SearchSpace, begin: SearchStart, request: Request, cells: tuple[Cell, Cell], result: Unreachable
    ) -> Exception:
        return errors.no_path(
            begin.space, request.start, request.goal, (begin.cell, cells[1]), result.nearest, expanded=result.expanded
        )


class _Goals(Sequence[tuple[Pose2D, Cell]]):
    """The goal, and the points around it, which are listed when the goal has not been reached: that takes half a millisecond."""

    def __init__(self, costmap: Costmap, goal: Pose2D, tolerance: float) -> None:
        self._costmap, self._tolerance = costmap, tolerance
        self._own = goal, _clipped(costmap.geometry, goal)

    @cached_property
    def _all(self) -> list[tuple[Pose2D, Cell]]:
        g, goal = self._costmap.geometry, self._own[0]
        around = goal_candidates(self._costmap, goal, self._tolerance, lambda x, y: _rounded_cell(g, x, y))
        return [self._own, *(candidate for candidate in around if candidate[0] is not goal)]

    @overload
    def __getitem__(self, index: int) -> tuple[Pose2D, Cell]: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[tuple[Pose2D, Cell]]: ...
    def __getitem__(self, index: int | slice) -> tuple[Pose2D, Cell] | Sequence[tuple[Pose2D, Cell]]:
        return self._own if index == 0 else self._all[index]

    def __len__(self) -> int:
        return len(self._all)

    def __bool__(self) -> bool:
        return True


def _rounded_cell(g: GridGeometry, x: float, y: float) -> Cell | None:
    """The cell whose lower corner is nearest to a point (m), halves upwards; None outside the map, as Nav2 has it."""
    if x < g.origin_x or y < g.origin_y:
        return None
    ix, iy = _round_half_up((x - g.origin_x) / g.resolution), _round_half_up((y - g.origin_y) / g.resolution)
    return (ix, iy) if ix < g.nx and iy < g.ny else None


def _clipped(g: GridGeometry, pose: Pose2D) -> Cell:
    """The cell of a pose in the map, that of the border in the last half cell of the map."""
    ix, iy = (pose.x - g.origin_x) / g.resolution, (pose.y - g.origin_y) / g.resolution
    return min(_round_half_up(ix), g.nx - 1), min(_round_half_up(iy), g.ny - 1)


def _round_half_up(value: float) -> int:
    """Round a value that is not negative; exact, unlike the floor of value + 0.5."""
    whole = math.floor(value)
    return whole + (value - whole >= 0.5)
