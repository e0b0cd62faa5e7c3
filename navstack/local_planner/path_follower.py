# pyright: basic
"""Base of the controllers that follow a path as Nav2's do: path handler, goal checker, and the order of a cycle."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from navstack.core import (
    OUTSIDE,
    ControlError,
    Costmap,
    Footprint,
    Path,
    Pose2D,
    RobotState,
    Twist2D,
    edge_cost,
    fastest_corner,
    kernel,
    overlapped_cost,
    place_footprint,
)
from navstack.local_planner.path_handlers import FeasiblePathHandlerParams, no_plan
from navstack.local_planner.sampling_planner import SAME_GOAL, control_period
from navstack.parameters import first_of, make_section, section_model
from navstack.plugins import (
    GOAL_CHECKERS,
    PATH_HANDLERS,
    Approach,
    CheckContext,
    ControlInput,
    GoalChecker,
    Inflation,
    Issue,
    LocalPath,
    LocalPlan,
    LocalPlanner,
    ParamModel,
    PathHandler,
    param,
)

GOAL_CHECKER = "nav2_controller::SimpleGoalChecker"
PATH_HANDLER = "feasible"
MOVED_TO_PATH_HANDLER = (
    "prune_distance",
    "max_robot_pose_search_dist",
    "enforce_path_inversion",
    "inversion_xy_tolerance",
    "inversion_yaw_tolerance",
)
"""Parameters of the path handler that Nav2 up to Kilted has in the controller's namespace."""


class PathFollowerParams(ParamModel):
    """Parameters that all controllers of this kind have.

    The namespaces `goal_checker` and `PathHandler` may stand in the controller's namespace or next to it, as in Nav2's
    controller_server.
    """

    SEARCHED: ClassVar[frozenset[str]] = frozenset(
        {"controller_frequency", "goal_checker_plugins", "path_handler_plugins"}
    )
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "plugin": "base_local_planner selects the controller",
        "transform_tolerance": "the transform_tolerance of the costmaps is used",
    }
    CHILD_FIELD: ClassVar[str | None] = "sections"

    controller_frequency: float = param(20.0, "control cycles per second; 0 counts as 20", unit="Hz", ge=0.0)
    goal_checker_plugins: list[str] = param(
        ["goal_checker"], "namespace of the goal checker; the first of the list is used"
    )
    path_handler_plugins: list[str] = param(
        ["PathHandler"], "namespace of the path handler; the first of the list is used"
    )
    prune_distance: float | None = param(None, "as PathHandler/prune_distance (Nav2 up to Kilted)", unit="m", gt=0.0)
    max_robot_pose_search_dist: float | None = param(
        None, "as PathHandler/max_robot_pose_search_dist (Nav2 up to Kilted)", unit="m"
    )
    enforce_path_inversion: bool | None = param(None, "as PathHandler/enforce_path_inversion (Nav2 up to Kilted)")
    inversion_xy_tolerance: float | None = param(
        None, "as PathHandler/inversion_xy_tolerance (Nav2 up to Kilted)", unit="m", ge=0.0
    )
    inversion_yaw_tolerance: float | None = param(
        None, "as PathHandler/inversion_yaw_tolerance (Nav2 up to Kilted)", unit="rad", ge=0.0
    )
    sections: dict[str, Any] = param({}, "parameters of goal checker and path handler, from their namespaces")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Models of the goal checker and the path handler, by namespace."""
        checker = first_of(values, "goal_checker_plugins", "goal_checker")
        handler = first_of(values, "path_handler_plugins", "PathHandler")
        return {
            checker: section_model(GOAL_CHECKERS, values, checker, GOAL_CHECKER),
            handler: section_model(PATH_HANDLERS, values, handler, PATH_HANDLER),
        }

    @classmethod
    def shared_children(cls, values: Mapping[str, Any]) -> frozenset[str]:
        """Goal checker and path handler may stand next to the controller."""
        return frozenset(PathFollowerParams.child_models(values))

    @property
    def turning_radius(self) -> float:
        """Radius (m) of the tightest curve that the controller commands; 0 if it turns in place, or has no limit."""
        return 0.0

    @property
    def drives_backward(self) -> bool:
        """True if the controller drives backward where the path does."""
        return False

    def make_goal_checker(self) -> GoalChecker:
        """The goal checker of these parameters."""
        name = first_of({"_": self.goal_checker_plugins}, "_", "goal_checker")
        return make_section(GOAL_CHECKERS, self.sections, name, GOAL_CHECKER)

    def make_path_handler(self) -> PathHandler:
        """The path handler of these parameters; what stands in the controller's namespace counts if it is not in its own."""
        name = first_of({"_": self.path_handler_plugins}, "_", "PathHandler")
        sections = dict(self.sections)
        own = sections.get(name) or FeasiblePathHandlerParams()
        if isinstance(own, FeasiblePathHandlerParams):
            moved = {n: getattr(self, n) for n in MOVED_TO_PATH_HANDLER if getattr(self, n) is not None}
            sections[name] = own.model_copy(update={n: v for n, v in moved.items() if n not in own.model_fields_set})
        return make_section(PATH_HANDLERS, sections, name, PATH_HANDLER)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the controller from its goal regardless of its commands."""
        for key in ("goal_checker_plugins", "path_handler_plugins"):
            listed = getattr(self, key)
            if len(listed) != 1:
                used = f'"{listed[0]}", the first, is used' if listed else "the default is used"
                message = f"{key} lists {len(listed)} plugins, but a controller has one: {used}; list one"
                yield Issue("warning", "one-plugin", (key,), message)
        tolerance = self.make_goal_checker().xy_tolerance
        resolution = context.local_costmap.resolution
        if tolerance < resolution:
            message = (
                f"the goal checker's tolerance of {tolerance:g} m is smaller than a cell of the local costmap "
                f"({resolution:g} m), so the robot may circle around its goal; set it to {resolution:g} m or more"
            )
            yield Issue("warning", "tolerance-under-cell", ("/goal_checker/xy_goal_tolerance",), message)


@dataclass(frozen=True, slots=True, eq=False)
class Following:
    """What a controller computes its command from. Poses are in the costmap's frame."""

    state: RobotState
    path: LocalPath
    goal: Pose2D
    """The final goal."""
    costmap: Costmap
    footprint: Footprint
    inflation: Inflation | None
    """The costs around obstacles; None if they are not inflated."""
    track_unknown_space: bool
    at_position: bool
    """True at the goal's position, by the goal checker."""
    new_goal: bool
    """True in the first cycle towards a goal."""
    new_plan: bool
    """True in the first cycle with a plan."""


class PathFollower(LocalPlanner):
    """A controller that is a function from state, path and costmap to a command: `follow`.

    State between cycles: the plan, the goal checker, and what the controller adds.
    """

    as_nav2: bool = False
    """True: the deliberate differences from Nav2 are off (parity pages), as far as the controller can."""
    may_turn: bool = False
    """True behind a rotation shim: it may turn in place, whatever its parameters say."""
    NAMESPACES: ClassVar[tuple[str, ...]] = ("FollowPath",)
    """Further namespaces of the parameters: the name of the controller in Nav2's files."""
    params: PathFollowerParams

    def __init__(self, params: PathFollowerParams) -> None:
        super().__init__(params)
        self.period = control_period(params.controller_frequency)
        """Seconds between two commands."""
        self.goal_checker = params.make_goal_checker()
        self.path_handler = params.make_path_handler()
        self._goal: Pose2D | None = None
        self._new_goal = self._new_plan = False
        self._seen: ControlInput | None = None
        self._approach: tuple[LocalPath, Approach, bool] | None = None

    # --- plan and goal ----------------------------------------------------------------------------------------------

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow `plan` to `goal`; with the same goal as before it is a replan, and a latched position remains latched."""
        if not goal.is_finite():
            raise ControlError(f"the goal {tuple(goal)} is not finite", goal=list(goal))
        self.path_handler.set_plan(plan)
        before, self._goal = self._goal, Pose2D(*goal)
        self._new_plan, self._seen = True, None
        # ROS differs: in Nav2 every replan releases the latch (parity 17)
        if before is None or any(abs(a - b) > SAME_GOAL for a, b in zip(before, goal)):
            self._new_goal = True
            self.goal_checker.reset()

    def reset(self) -> None:
        """Reset the previous goal, and with it a latched position."""
        self._goal = None

    def goal_reached(self, inputs: ControlInput) -> bool:
        """By the goal checker."""
        if self._goal is None:
            return False
        _, approach, at_position = self._look(inputs)
        checker = self.goal_checker
        return at_position and checker.at_heading(approach) and checker.stopped(approach.velocity)

    # --- the command ------------------------------------------------------------------------------------------------

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """Follow the path; stand still at the goal.

        Raises InvalidPathError if no part of the plan is near, and what `follow` raises.
        """
        state = inputs.state
        if not (state.pose.is_finite() and state.velocity.is_finite()):
            raise ControlError(
                f"the robot's pose {tuple(state.pose)} or velocity {tuple(state.velocity)} is not finite",
                pose=list(state.pose),
                velocity=list(state.velocity),
            )
        if self._goal is None:
            raise no_plan()
        path, approach, at_position = self._look(inputs)
        local_plan = Path(path.poses, inputs.costmap.frame)
        if at_position and self.goal_checker.at_heading(approach) and self.goal_checker.stopped(state.velocity):
            self.arrived()
            return LocalPlan(Twist2D(), "arrived", local_plan=local_plan)
        now = Following(
            state,
            path,
            approach.goal,
            inputs.costmap,
            inputs.footprint,
            inputs.inflation,
            inputs.track_unknown_space,
            at_position,
            self._new_goal,
            self._new_plan,
        )
        self._new_goal = self._new_plan = False
        return self.follow(now)

    @abstractmethod
    def follow(self, now: Following) -> LocalPlan:
        """Return the command, with the local path as its `local_plan`. Raises NoValidControlError."""

    def arrived(self) -> None:
        """Called when the robot is at its goal and is commanded to stand still."""

    def take_over(self, velocity: Twist2D) -> None:
        """Called when this controller follows after another one whose last command is `velocity`: start from there."""
        del velocity
        self.arrived()

    def _look(self, inputs: ControlInput) -> tuple[LocalPath, Approach, bool]:
        """Local path, what the goal checker sees, and its answer for the position: asked once per cycle."""
        if self._seen is inputs and self._approach is not None:
            return self._approach
        assert self._goal is not None
        state, transform = inputs.state, inputs.plan_to_costmap
        path = self.path_handler.local_path(state.pose, transform, inputs.costmap.geometry)
        approach = Approach(state.pose, transform.apply(self._goal), state.velocity, path.poses, path.remaining_m)
        self._seen, self._approach = inputs, (path, approach, self.goal_checker.at_position(approach))
        return self._approach


def check_speed(**limits: float | None) -> None:
    """Raise ControlError for a speed limit (m/s, rad/s) that is negative or not finite."""
    for name, value in limits.items():
        if value is not None and not (math.isfinite(value) and value >= 0.0):
            raise ControlError(f"{name} must be a finite speed of at least 0, not {value}", limit=name, value=value)


# ----------------------------------------------------------------------------------------------------------------------
# Points ahead on a path, and the collision check of the arc that a command drives.


# pyright: basic


SHORT_M = 1e-9
"""Segments up to this length have no direction (m)."""


@kernel
def passed_length(path, x, y, least):
    """Return how far along `path` (n, 3) the projection of (x, y) onto its first segment is (m).

    Negative before the first pose, at least `least`; at most the length of the segment.
    """
    for i in range(1, len(path)):
        dx, dy = path[i, 0] - path[0, 0], path[i, 1] - path[0, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length > SHORT_M:
            along = ((x - path[0, 0]) * dx + (y - path[0, 1]) * dy) / length
            return min(max(along, least), length)
    return 0.0


@kernel
def point_ahead(path, distance, beyond, out):
    """Write x, y and direction of the point `distance` (m) along `path` (n, 3) to `out` (3,). Returns the length to it (m).

    Interpolated linearly; the direction is that of the segment. A path that is shorter: its last pose, or with `beyond` the
    point on the prolonged last segment.
    """
    last = len(path) - 1
    passed = 0.0
    heading = path[last, 2]
    for i in range(last):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length <= SHORT_M:
            continue
        heading = math.atan2(dy, dx) if beyond else heading
        if passed + length >= distance:
            share = (distance - passed) / length
            out[0] = path[i, 0] + share * dx
            out[1] = path[i, 1] + share * dy
            out[2] = math.atan2(dy, dx)
            return distance
        passed += length
    out[0], out[1], out[2] = path[last, 0], path[last, 1], path[last, 2]
    if beyond and passed > 0.0:
        more = distance - passed
        out[0] += more * math.cos(heading)
        out[1] += more * math.sin(heading)
        out[2] = heading
        return distance
    return passed


@kernel
def arc_collision(costs, grid, vertices, unknown_blocks, interior, turns, start, twist, limits, out):
    """Check the footprint on the arc that a constant velocity drives. Returns (index of the colliding pose or -1, poses).

    `grid` (3,): origin x, y and resolution. `start` (3,): the robot's pose, which is checked, too. `twist` (3,): v, turning
    speed, circumscribed radius. `limits` (3,): duration (s), distance from the start (m), 1 for the arc up to the end of the
    duration, or once around, 0 for Euler steps that end before it (Nav2), of which a slow robot makes none. A step is a cell
    along the path; with `turns`, no corner moves by more than a cell in it.
    `interior`: cells inside the footprint count, and a center outside the grid collides; otherwise the edges alone, and such a
    pose is free (Nav2). `out` (m, 3) receives the poses; the check ends when it is full.
    """
    ny, nx = costs.shape
    resolution = grid[2]
    v, w = twist[0], twist[1]
    corners = vertices.T.copy()
    cells = np.empty(corners.shape, np.int32)
    placed = np.empty(corners.shape)
    if abs(v) < 0.01 and abs(w) > 0.01:
        dt = 2.0 * math.sin(0.5 * resolution / twist[2]) / abs(w)
    else:
        dt = resolution / abs(v) if v != 0.0 else np.inf
    fastest = fastest_corner(corners, v, 0.0, w) if turns else 0.0
    if fastest > 0.0:
        dt = min(dt, resolution / fastest)
    whole = limits[2] > 0.0
    duration = limits[0]
    if whole:
        duration = min(duration, 2.0 * math.pi / abs(w)) if w != 0.0 else duration
        dt = min(dt, duration)
    x, y, yaw = start[0], start[1], start[2]
    for i in range(len(out)):
        if i > 0:
            if not ((i - 1 if whole else i) * dt < duration):
                return -1, i
            step = min(dt, duration - (i - 1) * dt) if whole else dt
            heading = yaw + 0.5 * w * step if whole else yaw
            x += v * step * math.cos(heading)
            y += v * step * math.sin(heading)
            yaw += w * step
            if math.sqrt((x - start[0]) ** 2 + (y - start[1]) ** 2) > limits[1]:
                return -1, i
        out[i, 0], out[i, 1], out[i, 2] = x, y, yaw
        cx, cy = (x - grid[0]) / resolution, (y - grid[1]) / resolution
        if not (cx >= 0.0 and cy >= 0.0 and cx < nx and cy < ny):
            if interior:
                return i, i + 1
            continue
        cost = edge_cost(costs, grid[0], grid[1], resolution, corners, x, y, yaw, cells)
        if interior and cost != OUTSIDE:
            place_footprint(costs, grid[0], grid[1], resolution, corners, x, y, yaw, placed)
            cost = overlapped_cost(costs, placed, max(cost, np.int64(costs[int(cy), int(cx)])))
        if cost == 254 or cost == OUTSIDE or (cost == 255 and unknown_blocks):
            return i, i + 1
    return -1, len(out)


# ----------------------------------------------------------------------------------------------------------------------
# Turning in place as Nav2's controllers do: as fast as allowed, braking so that the turn ends at its target.


def turning_speed(error: float, speed: float, acceleration: float, last: float, period: float) -> float:
    """Return the turning speed (rad/s) of Nav2 for an `error` (rad) that is left, `period` (s) after the speed `last`.

    At most `speed`, within `acceleration` (rad/s²) of `last`, then at most sqrt(2 acceleration |error|), from which the turn can
    be stopped in time, even if the acceleration does not allow to brake that much.
    """
    wanted = speed if error > 0.0 else -speed
    change = acceleration * period
    wanted = min(max(wanted, last - change), last + change)
    highest = math.sqrt(2.0 * acceleration * abs(error))
    return min(max(wanted, -highest), highest)


def limited_turning_speed(error: float, speed: float, acceleration: float, last: float, period: float) -> float:
    """As `turning_speed`, but always within `acceleration` of `last`, and made for commands that last a whole period.

    From a speed w, commands that fall by acceleration * period each turn by w² / (2 acceleration) + w period / 2 (rad) until they
    are zero. The highest w for which that is at most `error` never has to brake harder.
    """
    half = 0.5 * period
    braking = acceleration * (math.sqrt(half * half + 2.0 * abs(error) / acceleration) - half)
    wanted = math.copysign(min(speed, braking, abs(error) / period), error)
    change = acceleration * period
    return min(max(wanted, last - change), last + change)
