"""What navfn and global_planner share: the two ends, replanning, A*, and the plan around what the wave found."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, Footprint, GridGeometry, Path, Pose2D
from navstack.global_planner import ends
from navstack.global_planner.cost_rule import CostRule, careful
from navstack.global_planner.departure import depart
from navstack.global_planner.guide import CoarseGuide, astar
from navstack.global_planner.replanning import GoalField, Memory, Request
from navstack.global_planner.search_params import SearchParams
from navstack.global_planner.wavefront import Guide, Wavefront
from navstack.interfaces import GlobalPlanner, Plan


class WaveQuery(NamedTuple):
    """What a wave is to find."""

    grid: Costmap
    """The costs it runs over; outside of `make_plan`'s costmap by a ring, where the planner adds one."""
    rule: CostRule
    start: Pose2D
    start_cell: ends.Cell
    goal: Pose2D
    """The first of the goals that will do."""
    goal_cell: ends.Cell

    def rule_for(self, guide: Guide | None) -> CostRule:
        """The rule as C++ has it, or the one that no order of cells betters, as the guide says."""
        return careful(self.rule) if guide is not None and guide.careful else self.rule


class WavePlanner(GlobalPlanner):
    """A planner that spreads a potential from the start until it reaches the goal, and walks down from there."""

    def __init__(self, params: SearchParams) -> None:
        super().__init__(params)
        self._wave = Wavefront()
        self._coarse = CoarseGuide()
        self._field = GoalField()
        self._memory = Memory()

    def forget(self) -> None:
        """The next plan is made from scratch."""
        self._field = GoalField()
        self._memory = Memory()

    @abstractmethod
    def _rule(self) -> CostRule:
        """What entering a cell costs."""

    @abstractmethod
    def _rise(self) -> float:
        """What the wave's threshold grows by."""

    @abstractmethod
    def _is_guided(self) -> bool:
        """True for A*."""

    def _blocks_outline(self) -> bool:
        """True when the map's outermost cells are blocked."""
        return True

    @abstractmethod
    def _run(self, query: WaveQuery, guide: Guide | None, limit: float, keep: bool) -> NDArray[np.float32] | None:
        """Runs the wave from the start until it reaches the goal's cell; the potential (ny, nx) if it is to be kept."""

    @abstractmethod
    def _descend(self, query: WaveQuery, goal: Pose2D, cell: ends.Cell, loops: bool) -> NDArray[np.float64]:
        """(n, 2) points (m) from the start to `goal`, which may be left out, by the potential.

        `loops`: leave them in.
        """

    def _orient(self, poses: NDArray[np.float64], start_yaw: float) -> None:
        """Sets the headings of a path (n, 3) that ends with the goal's."""
        del poses, start_yaw

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

        Raises StartOutsideMapError, GoalOutsideMapError, StartOccupiedError, GoalOccupiedError, NoValidPathError,
        PlanningTimeoutError, and InputError for a pose that is not finite. `potential` is 0 at the start.
        """
        began = time.perf_counter()
        params = cast("SearchParams", self.params)
        rule = self._rule()
        start, goal = ends.with_yaw_in_range(start), ends.with_yaw_in_range(goal)
        # all cells are looked up before a ring is added: what lies on an edge might otherwise change sides by a rounding
        start_cell, goal_cell = ends.cells_of(costmap, start, goal)
        request = Request(start, goal, costmap.geometry, costmap.frame, keep_potential, footprint)
        known = self._memory.recall(costmap, request)
        if known is not None:
            return known
        outline = self._blocks_outline()
        departure = depart(costmap, rule, start, start_cell, footprint, params.start_policy, ring=outline)
        free = [
            c
            for c in ends.goal_candidates(costmap, goal, params.default_tolerance)
            if c[1] == departure.cell or not ends.is_blocked(departure.costmap, rule, c[1], ring=outline)
        ]
        if not free:
            raise ends.goal_occupied(costmap, rule, goal, goal_cell, params.default_tolerance, ring=outline)
        # a wave stays off the outermost cells: to have them crossed it gets one ring more
        ring = 0 if outline else 1
        grid = departure.costmap if outline else _with_ring(departure.costmap)
        free = [(pose, (ix + ring, iy + ring)) for pose, (ix, iy) in free]
        first = departure.cell[0] + ring, departure.cell[1] + ring

        def nearest() -> ends.Cell:
            ix, iy = wave.nearest_reached(goal_cell[0] + ring, goal_cell[1] + ring)
            return ix - ring, iy - ring

        wave = self._wave
        wave.most = params.most
        query = WaveQuery(grid, rule, departure.pose, first, *free[0])
        potential: NDArray[np.float32] | None = None
        guided = False

        def attempt(guide: Guide | None, limit: float) -> float:
            nonlocal potential, guided
            guided = guide is not None
            potential = self._run(query, guide, limit, keep_potential)
            found = wave.potential_of(*query.goal_cell)
            if found == math.inf and wave.is_exhausted:
                found = min(wave.potential_of(*c) for _, c in free)
                if found == math.inf:
                    raise ends.timeout(costmap, start, goal, nearest(), wave.expanded, params.most)
            return found

        def otherwise() -> object:
            if self._is_guided():
                return astar(self._coarse, grid, rule, first, query.goal_cell, self._rise(), attempt)
            return attempt(None, math.inf)

        self._field.search(grid, rule, first, query.goal_cell, self._rise(), attempt, lambda: wave.expanded, otherwise)
        reached = next((c for c in free if wave.potential_of(*c[1]) < math.inf), None)
        if reached is None:
            if wave.expanded == 0 and ends.is_blocked(grid, rule, first):
                raise ends.start_occupied(costmap, rule, start, start_cell, ring=outline)
            cells = departure.cell, goal_cell
            raise ends.no_path(departure.costmap, rule, start, goal, cells, nearest(), wave.expanded)
        used, cell = reached
        cost = wave.potential_of(*cell)
        if potential is not None:
            potential[cell[1], cell[0]] = cost
            if ring:
                potential = np.ascontiguousarray(potential[1:-1, 1:-1])
        # a potential that C++ has gives the path that C++ has, with its loops
        points = self._descend(query, used, cell, not guided)
        poses = np.zeros((len(departure.lead) + len(points) + 1, 3))
        poses[: len(departure.lead), :2] = departure.lead
        poses[len(departure.lead) : -1, :2] = points
        poses[-1] = used
        self._orient(poses, start.yaw)
        notes = [] if departure.note is None else [departure.note]
        moved = goal.distance_to(used)
        if moved > 0.0:
            notes.append(f"the goal cannot be reached; the plan ends {moved:.2f} m from it (default_tolerance)")
        plan = Plan(
            path=Path(poses, costmap.frame),
            cost=cost,
            goal=used,
            goal_moved_m=moved,
            cells_expanded=wave.expanded,
            potential=potential,
            notes=tuple(notes),
            took_s=time.perf_counter() - began,
        )
        whole = (0, 0, costmap.geometry.nx, costmap.geometry.ny)
        # without a guide a wave looks at every cell that could matter; with one, others may come to matter
        elsewhere = grid is not costmap or len(departure.lead) > 0
        everything = guided or elsewhere or params.default_tolerance > 0.0
        kept = self._field.kept if grid is costmap else None
        self._memory.remember(costmap, request, plan, whole if everything else wave.rectangle, kept)
        return plan


def _with_ring(costmap: Costmap) -> Costmap:
    """A copy with one more ring of lethal cells."""
    g = costmap.geometry
    larger = GridGeometry(g.nx + 2, g.ny + 2, g.resolution, g.origin_x - g.resolution, g.origin_y - g.resolution)
    return Costmap(larger, np.pad(costmap.data, 1, constant_values=LETHAL), costmap.frame)
