"""Exploration: the simulated robot drives to frontiers, by the whole stack, until nothing that it can reach is unknown."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from navstack.bringup import costmap_on_map
from navstack.core import INSCRIBED, Costmap, InputError, OccupancyGrid, Pose2D, Transform2D
from navstack.costmap import LayeredCostmap, StaticLayer
from navstack.mapping.frontiers import ExplorationParams, Frontier, find_frontiers, travel_costs
from navstack.mapping.online import OnlineMapper
from navstack.scenario import INTERACTION, Cancel, GoalOutcome, GoTo, Run, Scenario, Wait

_image: Any = ndimage  # its stubs do not know what most functions return
_UPDATE_S: Final = 1.0
"""Between two maps."""
_SAME_M: Final = 0.3
"""A frontier with a cell this near to the middle of one before is the same."""
_TRIES: Final = 2
"""Goals for one frontier before it is given up; the second one when there is no other frontier."""
_BACK_M: Final = 0.4
"""After a goal that failed, the robot first backs off by this much (m), out of a gap into which it has driven."""
GOAL_TIME_LIMIT_S: Final = 120.0
PADDING_M: Final = 0.1
"""`footprint_padding` of the global costmap (m)."""
_COMPLETE: Final = "nothing that the robot can reach is unknown"
_KNOWN_SHARE: Final = 0.99
"""Share of the space in reach from which a world is explored, though the robot did not get to some frontiers: they are corners
behind which hardly anything is, or noise at the edge of the map."""
_BELIEVED_SHARE: Final = 0.9
"""The same where it sees no way on: gaps that its padded footprint keeps out of are a small share. Of a map that is wrong, more
is missing."""


def overrides_for_exploration() -> list[str]:
    """Return the parameters that exploration needs, which those of the user may override.

    The robot makes its map, unknown space is known to be unknown, and plans keep out of gaps in which a controller may wedge the
    robot: its footprint in the global costmap is larger by PADDING_M.
    """
    return [
        "navstack.sim.localization=mapping",
        "global_costmap.track_unknown_space=true",
        f"global_costmap.footprint_padding={PADDING_M}",
    ]


@dataclass(frozen=True, slots=True)
class Visit:
    """A frontier that was driven to."""

    time: float
    """When it was chosen (s)."""
    frontier: Frontier
    outcome: str
    """`seen` if it vanished on the way, `blocked` if an obstacle took the goal, else how the goal ended."""
    reason: str = ""

    @property
    def failed(self) -> bool:
        """True if the robot neither saw the frontier nor reached the goal."""
        return self.outcome not in ("seen", "reached")


@dataclass(frozen=True, slots=True)
class Left:
    """A frontier that remains, and why."""

    x: float
    y: float
    size: float
    reason: str


class Exploration:
    """A run of a simulated robot that maps a world.

    The robot knows its first pose, its odometry and its scans; `scenario.map` is the world, which it does not see. The
    scenario's goals are ignored. Its global costmap is fed by the map as it grows.
    """

    def __init__(
        self,
        scenario: Scenario,
        params: ExplorationParams | None = None,
        *,
        record: bool = True,
        time_limit_s: float = 3600.0,
    ) -> None:
        """Raises InputError if the robot cannot start there."""
        self.params = params or ExplorationParams()
        self.scenario = replace(
            scenario, goals=(), steps=(), interactions=(), time_limit_s=min(scenario.time_limit_s, GOAL_TIME_LIMIT_S)
        )
        self.run = Run(self.scenario, record=record)
        mapper = self.run.robot.estimation.localizer
        if not isinstance(mapper, OnlineMapper):
            raise InputError("the robot of an exploration makes its map: set navstack.sim.localization to mapping")
        self.mapper = mapper
        self.run.interact(Wait(time=0.0, duration=time_limit_s))  # go on between goals
        costmap = self.run.move_base.global_costmap
        if (
            not isinstance(costmap, LayeredCostmap)
            or costmap.rolling_window
            or not any(isinstance(layer, StaticLayer) for layer in costmap.layers)
        ):
            raise InputError(
                "exploration needs a global costmap with the layer of the static map and without a rolling window, which the map "
                "can grow in; these parameters have none: add static_layer to global_costmap/plugins, and rolling_window: false"
            )
        self.time_limit_s = time_limit_s
        self.visits: list[Visit] = []
        self.areas: list[tuple[float, float, float]] = []
        """Time (s), distance driven (m) and free area known (m²), after each map."""
        self.frontiers: list[Frontier] = []
        """The frontiers of the last map."""
        self.ended = ""
        """Why the exploration ended; empty while it goes on."""
        self.is_exhausted = False
        """Whether it ended by itself: each frontier was seen, or tried as often as it is worth."""
        self._current: tuple[float, Frontier] | None = None
        self._tries: list[tuple[float, float, str, int]] = []
        """Frontiers (m) to which a goal failed or changed nothing, why, and for how many tries that counts."""
        self._due = 0.0
        self._grid: OccupancyGrid | None = None
        """The map that was looked at last."""

    @property
    def is_complete(self) -> bool:
        """True if nothing that the robot can reach is unknown."""
        return self.ended == _COMPLETE

    @property
    def believed(self) -> Pose2D:
        """The robot's pose by the mapper."""
        robot = self.run.robot
        return Pose2D(*robot.frames.lookup(robot.map_frame, robot.base_frame))

    def step(self) -> bool:
        """Run one control cycle, and choose the next frontier where it is time. Returns False at the end."""
        if self.ended:
            return False
        run = self.run
        before = run.robot.time
        going = run.step()
        if not going or run.robot.time > self.time_limit_s:
            self.stop(f"the time limit of {self.time_limit_s:g} s")
            return False
        if run.robot.time == before:
            return True  # goals are sent when time has passed
        idle = not run.goals.under_way
        if self.mapper.keyframes == 0 or run.known_map.data.max() < 0:
            if run.robot.time > 10.0:
                self.stop("no scan could be used in 10 s")
            return not self.ended
        if idle or run.robot.time >= self._due:
            self._due = run.robot.time + _UPDATE_S
            self._look(idle=idle)
        return not self.ended

    def final_map(self) -> OccupancyGrid:
        """Return the map after the last optimization, free where the robot has been."""
        self.mapper.mapper.finish()
        return self.mapper.map(radius=self.run.robot.footprint.inscribed_radius)

    def left(self) -> list[Left]:
        """Return the frontiers of the last map that remain, with the reason."""
        found: list[Left] = []
        for frontier in self.frontiers:
            tried = [reason for x, y, reason, _ in self._tries if frontier.is_near(x, y, _SAME_M)]
            reason = frontier.reason or (tried[-1] if tried else self.ended)
            found.append(Left(frontier.x, frontier.y, frontier.size, reason))
        return found

    # --- parts --------------------------------------------------------------------------------------------------------

    def _look(self, *, idle: bool) -> None:
        """Draw the map again if it has grown, and choose where to drive."""
        run = self.run
        changed = run.known_map is not self._grid
        self._grid = run.known_map
        if changed:
            area = float((self._grid.data == 0).sum()) * self._grid.geometry.resolution**2
            self.areas.append((run.robot.time, run.path_length, area))
        costmap = run.move_base.global_costmap
        if self._current is None and not idle:
            return  # the robot backs off, or brakes
        if idle and self._current is not None:
            if self._note_end(run.outcomes[-1]):
                back = {"kind": "step", "time": run.robot.time, "step": {"move": -_BACK_M}}
                run.interact(INTERACTION.validate_python(back))
                return
        elif self._is_blocked(costmap.master):
            self._note_failure("blocked", "obstacles stand where the robot would see it from")
        elif not (idle or changed):
            return
        turning = run.robot.footprint.circumscribed_radius + self._grid.geometry.resolution
        self.frontiers = find_frontiers(self._grid, costmap.master, self.believed, self.params, turning_radius=turning)
        if self._current is not None:
            _, target = self._current
            if any(f.is_near(target.x, target.y, _SAME_M) for f in self.frontiers):
                return  # still to be seen
            self._note("seen")
        reached = [(self._count(f), n, f) for n, f in enumerate(self.frontiers) if f.goal is not None]
        tries, _, following = min(reached, default=(_TRIES, 0, None))
        if following is None or tries >= _TRIES:
            if not run.goals.under_way:
                failed = sum(1 for _, _, f in reached if self._not_reached(f))
                self.is_exhausted = True
                remain = "1 frontier remains" if failed == 1 else f"{failed} frontiers remain"
                self.stop(f"{remain} that the robot did not get to" if failed else _COMPLETE)
            else:
                run.interact(Cancel(time=run.robot.time))
            return
        assert following.goal is not None
        self._current = (run.robot.time, following)
        run.interact(GoTo(time=run.robot.time, pose=list(following.goal)))

    def _count(self, frontier: Frontier) -> int:
        return sum(tries for x, y, _, tries in self._tries if frontier.is_near(x, y, _SAME_M))

    def _is_blocked(self, costmap: Costmap) -> bool:
        goal = None if self._current is None else self._current[1].goal
        cost = None if goal is None else costmap.cost_at(goal.x, goal.y)
        return cost is not None and cost >= INSCRIBED

    def _not_reached(self, frontier: Frontier) -> bool:
        """Return whether no goal of a frontier was reached, though there is a way."""
        tried = [tries for x, y, _, tries in self._tries if frontier.is_near(x, y, _SAME_M)]
        return not frontier.tight and _TRIES not in tried

    def _note_end(self, outcome: GoalOutcome) -> bool:
        """Note how a goal ended; return whether the robot should back off: it failed where the robot may be wedged."""
        if outcome.succeeded:
            self._note_failure("reached", "the robot was there, and it remains unknown", _TRIES)
            return False
        self._note_failure(outcome.state.lower(), outcome.message or outcome.text)
        return True

    def _note_failure(self, outcome: str, reason: str, tries: int = 1) -> None:
        assert self._current is not None
        target = self._current[1]
        self._tries.append((target.x, target.y, reason, tries))
        self._note(outcome, reason)

    def _note(self, outcome: str, reason: str = "") -> None:
        assert self._current is not None
        time, target = self._current
        self.visits.append(Visit(time, target, outcome, reason))
        self._current = None

    def stop(self, why: str) -> None:
        """End the exploration now; `why` stands in the report."""
        self.ended = why
        self.run.stop()


# ----------------------------------------------------------------------------------------------------------------------
# What came of it, compared with the world.


def exploration_report(exploration: Exploration, grid: OccupancyGrid) -> dict[str, Any]:
    """Return the figures of an exploration and of its map `grid`, for JSON."""
    run, world = exploration.run, exploration.scenario.map
    reachable = reachable_cells(exploration.scenario, world)
    iy, ix = np.nonzero(reachable)
    known = _values_at(grid, _centers(world, iy, ix)) == 0
    share = float(known.mean()) if len(iy) else math.nan
    walls = _centers(grid, *np.nonzero(grid.data == 100))
    distance = np.asarray(_image.distance_transform_edt(world.data != 100))
    at = _cells_of(world, walls)
    near = len(walls) > 0
    exact = float((distance[at[:, 1], at[:, 0]] <= 1.0 + 1e-9).mean()) if near else math.nan
    estimate, truth = exploration.believed, run.robot.pose
    visits = exploration.visits
    resolution = grid.geometry.resolution
    ended, off = exploration.ended, truth.distance_to(estimate)
    needed = _BELIEVED_SHARE if exploration.is_complete else _KNOWN_SHARE
    if exploration.is_complete and share < needed:
        ended = (
            f"the robot sees no way on, but {1.0 - share:.0%} of what is in reach is not in its map: the map is wrong (the pose "
            f"is off by {off:.2f} m), or its ways are too narrow for the robot"
        )
    return {
        "ended": ended,
        "complete": exploration.is_exhausted and share >= needed,
        "time_s": run.robot.time,
        "distance_m": run.path_length,
        "contacts": len(run.robot.collisions),
        "free_m2": float((grid.data == 0).sum()) * resolution**2,
        "reachable_m2": float(len(iy)) * world.geometry.resolution**2,
        "reachable_known": share,
        "walls_within_a_cell": exact,
        "position_error_m": off,
        "keyframes": exploration.mapper.keyframes,
        "loops_accepted": sum(1 for loop in exploration.mapper.mapper.loops if loop.accepted),
        "goals": len(visits),
        "goals_failed": sum(visit.failed for visit in visits),
        "visits": [
            {
                "time_s": v.time,
                "frontier": [v.frontier.x, v.frontier.y],
                "size_m": v.frontier.size,
                "goal": None if v.frontier.goal is None else list(v.frontier.goal),
                "outcome": v.outcome,
                "reason": v.reason,
            }
            for v in visits
        ],
        "left": [{"x": f.x, "y": f.y, "size_m": f.size, "reason": f.reason} for f in exploration.left()],
    }


def reachable_cells(scenario: Scenario, world: OccupancyGrid) -> NDArray[np.bool_]:
    """Return the cells (ny, nx) of a map that the robot's center can reach from the start."""
    costmap = costmap_on_map(scenario.configuration, world, scenario.start).master
    open_ = costmap.data < INSCRIBED
    cell = costmap.geometry.world_to_cell(scenario.start.x, scenario.start.y)
    labels, _ = _image.label(open_, np.ones((3, 3), bool))
    if cell is None or not labels[cell[1], cell[0]] or open_.shape != world.data.shape:
        return np.zeros(world.geometry.shape, bool)
    return np.asarray(labels == labels[cell[1], cell[0]])


def goals_on(
    scenario: Scenario, grid: OccupancyGrid, places: dict[str, Pose2D], count: int
) -> list[tuple[str, Pose2D]]:
    """Return goals that the robot reaches on a map: its places there, or `count` random poses by the scenario's seed."""
    costmap = costmap_on_map(scenario.configuration, grid, scenario.start).master
    costs = travel_costs(costmap, scenario.start)
    found: list[tuple[str, Pose2D]] = []
    for name, pose in places.items():
        cell = costmap.geometry.world_to_cell(pose.x, pose.y)
        if cell is not None and math.isfinite(costs[cell[1], cell[0]]):
            found.append((name, pose))
    if found or not count:
        return found
    iy, ix = np.nonzero(np.isfinite(costs) & (costmap.data < 0.3 * INSCRIBED))
    rng = np.random.default_rng(scenario.seed)
    for n in rng.choice(len(iy), min(count, len(iy)), replace=False).tolist():
        x, y = costmap.geometry.cell_to_world(int(ix[n]), int(iy[n]))
        found.append((f"{x:.2f}, {y:.2f}", Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))))
    return found


def drive_on(
    scenario: Scenario, grid: OccupancyGrid, goals: list[Pose2D], stop: Callable[[], bool] | None = None
) -> tuple[Run, bool]:
    """Drive to goals in the scenario's world with the map `grid`, until they have ended or `stop` says so.

    Returns the run, and whether it was stopped. The robot localizes itself on that map as its parameters say.
    """
    run = Run(replace(scenario, goals=tuple(goals), steps=()), known_map=grid)
    while run.step():
        if stop is not None and stop():
            run.stop()
            return run, True
    return run, False


def _centers(grid: OccupancyGrid, iy: NDArray[np.int64], ix: NDArray[np.int64]) -> NDArray[np.float64]:
    g = grid.geometry
    axes = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
    return axes.apply_points((np.column_stack((ix, iy)).astype(np.float64) + 0.5) * g.resolution)


def _cells_of(grid: OccupancyGrid, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cells (n, 2) ix, iy of points, moved into the map."""
    g = grid.geometry
    inside = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw).inverse().apply_points(points) / g.resolution
    return np.clip(np.floor(inside).astype(np.int64), 0, [g.nx - 1, g.ny - 1])


def _values_at(grid: OccupancyGrid, points: NDArray[np.float64]) -> NDArray[np.int8]:
    cells = _cells_of(grid, points)
    return grid.data[cells[:, 1], cells[:, 0]]
