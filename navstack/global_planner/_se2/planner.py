"""The frame of the planners over poses: input, start, goals, the search, and the plan or the reason why there is none."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    Costmap,
    Footprint,
    GridGeometry,
    Path,
    Pose2D,
    StartOccupiedError,
    Window,
    describe_cost,
    normalize_angle,
)
from navstack.global_planner._se2 import reasons
from navstack.global_planner._se2.both_ends import Motions, search_both_ends
from navstack.global_planner._se2.engine import UNLIMITED, PoseSearch, TimeLimit
from navstack.global_planner._se2.params import PosePlannerParams
from navstack.global_planner._se2.primitives import PrimitiveTable
from navstack.global_planner._se2.search import Outcome, Pose, poses_of
from navstack.global_planner._se2.shape import FINE, Shape, shape_of
from navstack.global_planner._search.cells import cell_coordinates
from navstack.global_planner._search.plan_cache import PlanCache, Request
from navstack.global_planner._search.start_goal import cells_of, with_yaw_in_range
from navstack.plugins import GlobalPlanner, Plan

# ----------------------------------------------------------------------------------------------------------------------
# What to do when the robot overlaps obstacles where it starts.


_NOTE = "the robot overlaps obstacles at the start; the cells under its footprint were treated as free"


def cleared_start(
    engine: PoseSearch,
    grid: Costmap,
    start: Pose2D,
    footprint: Footprint | None,
    shape: Shape,
    params: PosePlannerParams,
) -> tuple[Costmap, str | None]:
    """Prepare the search over `grid`, in which cells under a blocked start count as free; return it with a note.

    Raises StartOccupiedError if the policy does not allow that.
    """
    engine.place(grid.data, shape)
    x, y = cell_coordinates(grid.geometry, start)
    if fits(engine, footprint, grid.geometry.resolution, lambda: engine.pose_is_free(x, y, start.yaw)):
        return grid, None
    cost = int(grid.data[int(y), int(x)])
    if params.start_policy in ("refuse", "nearest_free"):
        raise StartOccupiedError(
            f"the robot overlaps obstacles at the start ({start.x:.3f}, {start.y:.3f}, {start.yaw:.3f}), where the cost of its "
            f"cell is {describe_cost(cost)}, and start_policy is {params.start_policy}; this planner can start at the pose of "
            "the robot only: move it, or set start_policy: clear_footprint",
            x=start.x,
            y=start.y,
            yaw=start.yaw,
            cost=cost,
        )
    copy = grid.copy()
    copy.data[int(y), int(x)] = FREE
    if params.start_policy == "clear_footprint" and footprint is not None:
        under = _under(copy, footprint, start)
        copy.data[under] = np.where(copy.data[under] >= INSCRIBED, FREE, copy.data[under])
    engine.place(copy.data, shape)
    if engine.pose_is_free(x, y, start.yaw):
        return copy, _NOTE
    raise StartOccupiedError(
        f"the robot overlaps obstacles or the outside of the map at the start ({start.x:.3f}, {start.y:.3f}, {start.yaw:.3f}), "
        f"which start_policy: {params.start_policy} does not clear; move it"
        + ("" if params.start_policy == "clear_footprint" else ", or set start_policy: clear_footprint"),
        x=start.x,
        y=start.y,
        yaw=start.yaw,
        cost=cost,
    )


def fits(engine: PoseSearch, footprint: Footprint | None, resolution: float, is_free: Callable[[], bool]) -> bool:
    """Whether `is_free` returns True with one of the fine paddings; the search continues with the first one of them."""
    if is_free():
        return True
    if engine.shape.corners == 0:
        return False
    before = engine.shape
    for fine in FINE[1:]:
        engine.use(shape_of(footprint, resolution, fine))
        if engine.shape.fine_step < before.fine_step and is_free():
            return True
    engine.use(before)
    return False


def _under(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> tuple[np.ndarray, np.ndarray]:
    """Indices (iy, ix) of the cells that the footprint overlaps, with the fine padding: no others may be driven over."""
    g = costmap.geometry
    polygon = shapely.Polygon(footprint.at(pose)).buffer(
        1.01 * FINE[0] * g.resolution, join_style="mitre", mitre_limit=3.0
    )
    left, low, right, high = polygon.bounds
    x0, y0 = g.world_to_cell_unbounded(left, low)
    x1, y1 = g.world_to_cell_unbounded(right, high)
    xs, ys = np.meshgrid(np.arange(max(x0, 0), min(x1 + 1, g.nx)), np.arange(max(y0, 0), min(y1 + 1, g.ny)))
    x, y = g.origin_x + xs * g.resolution, g.origin_y + ys * g.resolution
    inside = shapely.intersects(polygon, shapely.box(x, y, x + g.resolution, y + g.resolution))
    return ys[inside], xs[inside]


# ----------------------------------------------------------------------------------------------------------------------
# Straight ways into goals next to obstacles, where a curve to the goal itself would swing into them.


MARGIN: Final = 1.5
"""Cells: a goal is tight if an obstacle is this close to the footprint there."""
LENGTHS: Final = (1.0, 2.2)
"""Lengths of the ways that are tried, in circumscribed radii of the robot."""


def with_tails(
    engine: PoseSearch,
    goals: NDArray[np.float64],
    footprint: Footprint | None,
    resolution: float,
    *,
    reverse: bool,
) -> NDArray[np.float64]:
    """Return the goals (n, 4) with the lengths of the straight ways into tight ones that are free, signed; 0 for none."""
    signs = (1.0, -1.0) if reverse else (1.0,)
    rows = np.zeros((len(goals), 4 + len(signs) * len(LENGTHS)))
    rows[:, :4] = goals
    radius = 0.25 if footprint is None else footprint.circumscribed_radius
    for row in rows:
        x, y, yaw = (float(v) for v in row[:3])
        if not _tight(engine, footprint, resolution, x, y, yaw):
            continue
        lengths = [sign * share * radius / resolution for sign in signs for share in LENGTHS]
        for k, length in enumerate(lengths):
            from_x, from_y = x - length * math.cos(yaw), y - length * math.sin(yaw)
            if engine.line_is_free(from_x, from_y, yaw, length):
                row[4 + k] = length
    return rows


def _tight(engine: PoseSearch, footprint: Footprint | None, resolution: float, x: float, y: float, yaw: float) -> bool:
    if engine.shape.corners == 0:
        around = engine.costs[max(0, int(y) - 2) : int(y) + 3, max(0, int(x) - 2) : int(x) + 3]
        return bool((around >= 253).any())
    before = engine.shape
    engine.use(shape_of(footprint, resolution, MARGIN))
    free = engine.pose_is_free(x, y, yaw)
    engine.use(before)
    return not free


SPACING: Final = 1.0
"""Cells: largest distance between poses of a path."""
_MAX_CANDIDATES: Final = 2000
_FINER: Final = 50_000
"""States, those of the searches before included, up to which searches with finer headings go on: narrow places have few."""


class _Ends(NamedTuple):
    """Start and goals of a search, in cells."""

    start: Pose
    goals: NDArray[np.float64]
    """(n, 4 or more): x, y, yaw, room for the heading bin, straight ways into the goal."""
    notes: tuple[str, ...]


class PosePlanner(GlobalPlanner):
    """A planner that searches over poses: subclasses supply the primitives."""

    NAMESPACES: ClassVar[tuple[str, ...]] = ("GridBased",)
    """Further namespaces of the parameters: the name of the planner in Nav2's files."""
    params: Any
    """PosePlannerParams of the subclass."""

    def __init__(self, params: PosePlannerParams) -> None:
        super().__init__(params)
        self._cache = PlanCache()
        self._engines: dict[float, PoseSearch] = {}

    # --- what a subclass supplies

    @abstractmethod
    def settings(self, resolution: float) -> dict[str, Any]:
        """Return the settings of the search that depend on the subclass's parameters, for cells of `resolution` (m)."""

    @abstractmethod
    def table(self, resolution: float, shape: Shape, start_yaw: float, finer: int) -> tuple[PrimitiveTable, int]:
        """Return the primitives, for `finer` times as many headings as usual, and the heading bin of the start."""

    @abstractmethod
    def heading_bin(self, table: PrimitiveTable, yaw: float) -> int:
        """Return the bin nearest to a heading (rad)."""

    def goal_yaws(self, yaw: float) -> list[float]:
        """Return the headings accepted at the goal, the requested one first."""
        mode = self.params.goal_heading_mode
        if mode == "DEFAULT":
            return [yaw]
        if mode == "BIDIRECTIONAL":
            return [yaw, normalize_angle(yaw + math.pi)]
        bins = self.goal_headings()
        return [normalize_angle(yaw + 2.0 * math.pi * k / bins) for k in range(bins)]

    @abstractmethod
    def goal_headings(self) -> int:
        """Return how many headings ALL_DIRECTION stands for."""

    finer_headings: ClassVar[tuple[int, ...]] = ()
    """Where no path is found: how many times as many headings are tried, one after the other."""

    @property
    def shortest_in_the_open(self) -> bool:
        """Whether the shortest curve is the plan where it leads over cells of cost 0 only."""
        return True

    @property
    def downsampling(self) -> int:
        """Cells of the costmap per cell of the search."""
        return 1

    # --- planning

    @property
    def memory(self) -> dict[str, float]:
        """Bytes per visited state and states visited by the last search, per resolution searched (m)."""
        return {f"{resolution:g} m": engine.bytes_per_state for resolution, engine in self._engines.items()}

    def reset(self) -> None:
        """Discard the cached plan and the heuristics: the next plan is computed from scratch."""
        self._cache = PlanCache()
        self._engines = {}

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Plan between two poses in the frame of the costmap; the heading of a pose is that of the robot there.

        A polygon is free wherever it is swept, and the round robot of `robot_radius` keeps its center out of cells of cost 253
        and more. Raises StartOutsideMapError, GoalOutsideMapError, StartOccupiedError, GoalOccupiedError, NoValidPathError,
        PlanningTimeoutError, and InputError for a pose that is not finite.
        """
        began = time.perf_counter()
        start, goal = with_yaw_in_range(start), with_yaw_in_range(goal)
        cells_of(costmap, start, goal)
        request = Request(start, goal, costmap.geometry, costmap.frame, keep_potential, footprint)
        cached = self._cache.lookup(costmap, request)
        if cached is not None:
            return cached
        grid = self._grid(costmap)
        engine = self._engine(grid.geometry.resolution)
        shape = shape_of(footprint, grid.geometry.resolution)
        grid, start_note = cleared_start(engine, grid, start, footprint, shape, self.params)
        ends = self._ends(engine, grid, start, goal, footprint)
        plan = self._search(engine, grid, ends, request)
        notes = (*(() if start_note is None else (start_note,)), *ends.notes, *plan.notes)
        plan = replace(plan, notes=notes, for_footprint=True, took_s=time.perf_counter() - began)
        if plan.goal_moved_m == 0.0:  # otherwise it depends on why the goal cannot be reached, too
            self._cache.store(costmap, request, plan, self._window(engine, costmap))
        return plan

    def _window(self, engine: PoseSearch, costmap: Costmap) -> Window:
        """All cells of the costmap that the last plan depends on."""
        x0, y0, x1, y1 = (self.downsampling * side for side in engine.window)
        return Window(x0, y0, min(x1, costmap.geometry.nx), min(y1, costmap.geometry.ny))

    def _grid(self, costmap: Costmap) -> Costmap:
        """The costmap that is searched: with `downsampling`, the maximum of each block."""
        factor = self.downsampling
        data = np.ascontiguousarray(costmap.data)
        if factor == 1:
            return costmap if data is costmap.data else Costmap(costmap.geometry, data, costmap.frame)
        g = costmap.geometry
        rows, columns = np.arange(0, g.ny, factor), np.arange(0, g.nx, factor)

        def largest(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
            return np.maximum.reduceat(np.maximum.reduceat(values, rows, axis=0), columns, axis=1)

        small, known = largest(data), largest(np.where(data == UNKNOWN, FREE, data))
        # an unknown cell in a block must not hide what is in the others
        small = np.where(known >= (INSCRIBED if self.params.allow_unknown else LETHAL), known, small)
        geometry = GridGeometry(len(columns), len(rows), g.resolution * factor, g.origin_x, g.origin_y)
        return Costmap(geometry, small, costmap.frame)

    def _engine(self, resolution: float) -> PoseSearch:
        if resolution not in self._engines:
            self._engines[resolution] = PoseSearch({**self._settings(resolution), **self.settings(resolution)})
        return self._engines[resolution]

    def _settings(self, resolution: float) -> dict[str, Any]:
        p = self.params
        return {
            "unknown_blocked": not p.allow_unknown,
            "cost_penalty": p.cost_penalty,
            "base_cost": 1.0 - p.retrospective_penalty,
            "non_straight": p.non_straight_penalty,
            "change": p.change_penalty,
            "reverse": p.reverse_penalty,
            "cusp": p.cusp_penalty / resolution,
            "quadratic": p.use_quadratic_cost_penalty,
            "expansion_ratio": p.analytic_expansion_ratio,
            "expansion_length": p.analytic_expansion_max_length / resolution,
            "expansion_cost": p.analytic_expansion_max_cost,
            "expansion_override": p.analytic_expansion_max_cost_override,
            "coarse": p.coarse_search_resolution if p.goal_heading_mode == "ALL_DIRECTION" else 1,
            "factor": 2 if p.downsample_obstacle_heuristic else 1,
            "half": max(1, int(p.lookup_table_size / resolution) // 2),
            "weight": p.heuristic_weight,
            "slack": math.sqrt(p.heuristic_weight),
            "approach_limit": max(0, p.max_on_approach_iterations),
        }

    def _ends(
        self, engine: PoseSearch, grid: Costmap, start: Pose2D, goal: Pose2D, footprint: Footprint | None
    ) -> _Ends:
        from_cell, to_cell = cell_coordinates(grid.geometry, start), cell_coordinates(grid.geometry, goal)
        resolution = grid.geometry.resolution
        goals: list[Pose] = []

        def any_goal() -> bool:
            goals[:] = self._free_goals(engine, *to_cell, goal.yaw)
            return bool(goals)

        free = fits(engine, footprint, resolution, any_goal)
        notes: list[str] = []
        if free:
            engine.set_goal(*to_cell, from_cell, keep=self.params.cache_obstacle_heuristic)
            if len(goals) == 1 and self.params.goal_heading_mode != "DEFAULT":
                notes.append("the robot fits at one of the accepted goal headings only")
        if not free or engine.obstacle_cost(*from_cell) == math.inf:
            goals = self._goals_nearby(engine, from_cell, (*to_cell, goal.yaw), self.params.tolerance / resolution)
        if not goals:
            raise (
                reasons.no_connection(grid, start, goal, self.params.allow_unknown)
                if free
                else reasons.goal_occupied(engine, grid, goal, footprint, self.params.tolerance)
            )
        rows = np.array([(x, y, yaw, 0.0) for x, y, yaw in goals], np.float64)
        moved = math.hypot(goals[0][0] - to_cell[0], goals[0][1] - to_cell[1])
        engine.settings["tolerance"] = max(0.0, self.params.tolerance / resolution - moved)
        reverse = bool(engine.settings["reeds_shepp"][0])
        rows = with_tails(engine, rows, footprint, resolution, reverse=reverse)
        return _Ends((*from_cell, start.yaw), rows, tuple(notes))

    def _free_goals(self, engine: PoseSearch, x: float, y: float, yaw: float) -> list[Pose]:
        """The accepted goals for a goal (cells, rad) where the robot fits."""
        return [(x, y, accepted) for accepted in self.goal_yaws(yaw) if engine.pose_is_free(x, y, accepted)]

    def _goals_nearby(self, engine: PoseSearch, start: tuple[float, float], goal: Pose, reach: float) -> list[Pose]:
        """The nearest goals within `reach` of one out of reach where the robot fits and that cells connect with the start."""
        if reach < 1.0:
            return []
        n = min(math.ceil(reach), 40)
        offsets = np.array([(dx, dy) for dx in range(-n, n + 1) for dy in range(-n, n + 1)], np.float64)
        distance = np.hypot(offsets[:, 0], offsets[:, 1])
        order, flooded = np.argsort(distance, kind="stable"), False
        for k in order[distance[order] <= reach][:_MAX_CANDIDATES]:
            x, y = float(goal[0] + offsets[k, 0]), float(goal[1] + offsets[k, 1])
            goals = self._free_goals(engine, x, y, goal[2])
            # what is connected with a goal tried before is not connected with the start, either
            if not goals or (flooded and engine.obstacle_cost(x, y) < math.inf):
                continue
            engine.set_goal(x, y, start, keep=False)
            if engine.obstacle_cost(*start) < math.inf:
                return goals
            flooded = True
        return []

    def _search(self, engine: PoseSearch, grid: Costmap, ends: _Ends, request: Request) -> Plan:
        start, goal = request.start, request.goal
        moved = start.distance_to(goal)
        near = moved <= min(0.5 * grid.geometry.resolution, self.params.tolerance)
        if (near or moved == 0.0) and abs(normalize_angle(goal.yaw - start.yaw)) < 1e-3:
            notes = (
                () if moved == 0.0 else (f"the robot stands {moved:.3f} m from the goal; it need not move (tolerance)",)
            )
            poses = np.array([start, start], np.float64)
            return Plan(Path(poses, request.frame), 0.0, goal if moved == 0.0 else start, moved, notes=notes)
        outcome = engine.follow(ends.start, ends.goals)
        if outcome is None and self.shortest_in_the_open and self.params.analytic_expansion_max_length > 0.0:
            outcome = engine.open_curve(ends.start, ends.goals, shorten=self.params.smooth_path)
        if outcome is None:
            outcome = self._outcome(engine, grid.geometry.resolution, ends)
        engine.remember(outcome)
        if not outcome.found:
            x, y, yaw = (float(v) for v in ends.goals[0, :3])
            g = grid.geometry
            searched = Pose2D(x * g.resolution + g.origin_x, y * g.resolution + g.origin_y, yaw)
            moved_to = None if searched.distance_to(goal) < 1e-9 else searched
            raise reasons.no_path(engine, grid, (start, goal, moved_to), outcome, self.params)
        return self._plan(outcome, grid, request)

    def _outcome(self, engine: PoseSearch, resolution: float, ends: _Ends) -> Outcome:
        """Search; where no state is left and the goal itself was not reached, again with finer headings.

        With a weight above 1, which allows more expensive paths, long searches go on from both ends.

        All searches together expand `max_iterations` at most; those with finer headings end at 50,000.
        """
        budget = self.params.max_iterations if self.params.max_iterations > 0 else UNLIMITED
        engine.time_limit, goals, used = self._time_limit(), ends.goals.copy(), 0
        shorten = self.params.smooth_path
        # without curves, a search from the goal ends next to the start
        from_goal = self.params.heuristic_weight > 1.0 and self.params.analytic_expansion_max_length > 0.0
        motions = Motions(partial(self.table, resolution), self.heading_bin, self.finer_headings)
        first: Outcome | None = None
        for finer in (1, *self.finer_headings):
            allowed = budget if first is None else min(budget, _FINER) - used
            if allowed <= 0:
                break
            table, start_bin = self.table(resolution, engine.shape, ends.start[2], finer)
            goals[:, 3] = [self.heading_bin(table, float(yaw)) for yaw in goals[:, 2]]
            engine.settings["max_expansions"] = allowed
            engine.begin(table, ends.start, start_bin, goals)
            if first is None and len(goals) == 1 and from_goal:
                goal = float(goals[0, 0]), float(goals[0, 1]), float(goals[0, 2])
                outcome = search_both_ends(engine, ends.start, goal, motions, shorten=shorten)
            else:
                outcome = engine.search(shorten=shorten)
            used += outcome.expanded
            if outcome.reached:
                first = outcome
                break
            first = first or outcome
            if outcome.timed_out or outcome.impossible:
                break
        assert first is not None
        return replace(first, expanded=used)

    def _time_limit(self) -> TimeLimit | None:
        limit = self.params.max_planning_time
        return None if limit <= 0.0 else TimeLimit(time.monotonic() + limit, self.params.terminal_checking_interval)

    def _plan(self, outcome: Outcome, grid: Costmap, request: Request) -> Plan:
        g = grid.geometry
        poses = poses_of(outcome, SPACING)
        poses[:, 0] = poses[:, 0] * g.resolution + g.origin_x
        poses[:, 1] = poses[:, 1] * g.resolution + g.origin_y
        poses[:, 2] = _in_range(poses[:, 2])
        poses[0] = request.start
        end = Pose2D(*(float(v) for v in poses[-1]))
        goal = request.goal
        if end.distance_to(goal) < 1e-9 and abs(normalize_angle(end.yaw - goal.yaw)) < 1e-9:
            end = goal
            poses[-1] = goal
        moved = goal.distance_to(end)
        notes: list[str] = []
        if moved > 0.0 or (end != goal and not outcome.reached):
            turned = min(abs(normalize_angle(end.yaw - yaw)) for yaw in self.goal_yaws(goal.yaw))
            notes.append(
                f"the goal itself cannot be reached; the plan ends {moved:.2f} m and {turned:.2f} rad from it (tolerance)"
            )
        path = Path(poses, request.frame)
        changes = path.cusps
        if changes:
            notes.append(f"{changes} change{'s' if changes > 1 else ''} between driving forward and backward")
        return Plan(path, outcome.cost * g.resolution, end, moved, outcome.expanded, notes=tuple(notes))


def _in_range(yaws: NDArray[np.float64]) -> NDArray[np.float64]:
    wrapped = np.remainder(yaws + np.pi, 2.0 * np.pi) - np.pi
    return np.where(wrapped <= -np.pi, np.pi, wrapped)
