"""navfn: the planner that move_base runs by default.

Source of the method: navfn/src/navfn.cpp and navfn_ros.cpp (K. Konolige); algorithms.md 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path, Pose2D
from navstack.core.parameters import ParamModel, param
from navstack.global_planner import _trace_kernels as trace
from navstack.global_planner import ends
from navstack.global_planner.cost_rule import NAVFN_NEUTRAL, CostRule, navfn_rule
from navstack.global_planner.guide import CoarseGuide, astar
from navstack.global_planner.replanning import GoalField, Memory, Request
from navstack.global_planner.wavefront import Guide, Wavefront
from navstack.interfaces import GlobalPlanner, Plan
from navstack.plugins import GLOBAL_PLANNERS

_FIRST_THRESHOLD = 254.0  # navfn.h, COST_OBS
RISE = 2.0 * NAVFN_NEUTRAL  # navfn.cpp, priInc
_PATIENCE = 40  # C++ bounces for up to 20 points and then comes through: as it does


class NavfnParams(ParamModel):
    """Parameters of NavfnROS, and ours."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "planner_window_x": "read by NavfnROS, never used",
        "planner_window_y": "read by NavfnROS, never used",
    }

    allow_unknown: bool = param(True, "whether paths may cross unknown cells (at the cost of 253)")
    default_tolerance: float = param(
        0.0,
        "half the side of the square around the goal in which the nearest reachable point will do",
        unit="m",
        ge=0.0,
    )
    visualize_potential: bool = param(False, "keep the potential in every plan, to be drawn")
    use_astar: bool = param(
        False,
        "A* instead of Dijkstra: fewer cells for a path of the same cost (within 1 %)",
        ros_differs="C++ navfn has an A* that NavfnROS cannot reach; it gives paths up to 20 % costlier and fails on large maps",
    )


def spread(
    wave: Wavefront,
    costmap: Costmap,
    rule: CostRule,
    *,
    root: ends.Cell,
    target: ends.Cell,
    stop: bool = True,
    guide: Guide | None = None,
    limit: float = math.inf,
) -> None:
    """Runs the wave from cell `root` until it reaches `target`, with `stop` false over everything (calcNavFnDijkstra)."""
    x, y = root
    nx = costmap.data.shape[1]
    wave.begin(
        costmap,
        rule,
        seeds=[(y * nx + x, 0.0)],
        fronts=[(x + 1, y), (x - 1, y), (x, y - 1), (x, y + 1)],
        target=target,
        threshold=_FIRST_THRESHOLD,
        rise=RISE,
    )
    wave.run(target[1] * nx + target[0] if stop else -1, guide=guide, limit=limit)


def descend(wave: Wavefront, cell: ends.Cell, *, root: ends.Cell) -> NDArray[np.float32]:
    """The path (n, 2) of cells, with fractions, from `cell` down to the root of navfn's wave (calcPath)."""
    points, n = trace.gradient_path(
        wave.pot,
        wave.nx,
        wave.ny,
        cell[1] * wave.nx + cell[0],
        np.float32(0.0),
        np.float32(0.0),
        np.float32(root[0]),
        np.float32(root[1]),
        np.float32(NAVFN_NEUTRAL),
        np.float32(-1.0),
        _PATIENCE,
    )
    return points[:n]


@GLOBAL_PLANNERS.register("navfn", aliases=("navfn/NavfnROS",))
class NavfnROS(GlobalPlanner):
    """navfn: Dijkstra's wavefront from the start, gradient descent from the goal.

    As NavfnROS: the outermost ring of cells is blocked; the start's own cell counts as free; path points lie on cell
    corners with yaw 0 and are followed by the goal pose; with `default_tolerance` the nearest reachable point of a lattice
    around the goal will do. `Plan.cost` is the potential where the plan ends: 50 per free cell, up to 253 near obstacles.

    # ROS differs: no cap on rounds, on cells waiting, or on path points (parity 4, 5, 6); A* is right (parity 7); the
    # costmap is never written to (C++ frees the start's cell in it).
    """

    Params = NavfnParams

    def __init__(self, params: NavfnParams | None = None) -> None:
        super().__init__(params or NavfnParams())
        self._wave = Wavefront()
        self._coarse = CoarseGuide()
        self._field = GoalField()
        self._memory = Memory()

    def forget(self) -> None:
        """The next plan is made from scratch."""
        self._field = GoalField()
        self._memory = Memory()

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """A plan between two poses in the costmap's frame.

        Raises StartOutsideMapError, GoalOutsideMapError, StartOccupiedError, GoalOccupiedError, NoValidPathError, and
        InputError for a pose that is not finite. `potential` is 0 at the start.
        """
        del footprint
        params = cast("NavfnParams", self.params)
        rule = navfn_rule(params.allow_unknown)
        start_cell, goal_cell = ends.cells_of(costmap, start, goal)
        keep_potential = keep_potential or params.visualize_potential
        request = Request(start, goal, costmap.geometry, costmap.frame, keep_potential)
        known = self._memory.recall(costmap, request)
        if known is not None:
            return known
        candidates = ends.goal_candidates(costmap, goal, params.default_tolerance)
        free = [c for c in candidates if c[1] == start_cell or not ends.is_blocked(costmap, rule, c[1])]
        if not free:
            raise ends.goal_occupied(costmap, rule, goal, goal_cell, params.default_tolerance)
        wave = self._wave
        target = free[0][1]

        guided = False

        def attempt(guide: Guide | None, limit: float) -> float:
            nonlocal guided
            guided = guide is not None
            spread(wave, costmap, rule, root=start_cell, target=target, guide=guide, limit=limit)
            if guided:
                wave.settle(target, guide, limit)
            return wave.potential_of(*target)

        def first() -> object:
            if params.use_astar:
                return astar(self._coarse, costmap, rule, start_cell, target, RISE, attempt)
            return attempt(None, math.inf)

        self._field.search(costmap, rule, start_cell, target, RISE, attempt, lambda: wave.expanded, first)
        reached = next((c for c in free if wave.potential_of(*c[1]) < math.inf), None)
        if reached is None:
            if wave.expanded == 0 and ends.is_blocked(costmap, rule, start_cell):
                raise ends.start_occupied(costmap, rule, start, start_cell)
            nearest = wave.nearest_reached(*goal_cell)
            raise ends.no_path(costmap, rule, start, goal, (start_cell, goal_cell), nearest, wave.expanded)
        used, cell = reached
        cells = descend(wave, cell, root=start_cell).astype(np.float64)
        poses = np.zeros((len(cells) + 1, 3))
        poses[:-1, 0] = costmap.geometry.origin_x + cells[::-1, 0] * costmap.geometry.resolution
        poses[:-1, 1] = costmap.geometry.origin_y + cells[::-1, 1] * costmap.geometry.resolution
        poses[-1] = used
        notes: list[str] = []
        if ends.is_blocked(costmap, rule, start_cell):
            notes.append("the start lies in a blocked cell, which was taken for free, as ROS does")
        moved = goal.distance_to(used)
        if moved > 0.0:
            notes.append(f"the goal cannot be reached; the plan ends {moved:.2f} m from it (default_tolerance)")
        plan = Plan(
            path=Path(poses, costmap.frame),
            cost=wave.potential_of(*cell),
            goal=used,
            goal_moved_m=moved,
            cells_expanded=wave.expanded,
            potential=wave.full_potential() if keep_potential else None,
            notes=tuple(notes),
        )
        # without a guide a wave looks at every cell that could matter; with one, others may come to matter
        everything = guided or params.default_tolerance > 0.0
        whole = (0, 0, costmap.geometry.nx, costmap.geometry.ny)
        self._memory.remember(costmap, request, plan, whole if everything else wave.rectangle)
        return plan
