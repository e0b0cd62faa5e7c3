"""A small deterministic world for tests: a kinematic robot, empty costmaps and scripted plugins."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navstack.core import (
    Costmap,
    Event,
    Footprint,
    FrameTree,
    GoalOccupiedError,
    GridGeometry,
    NoValidControlError,
    Path,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    Window,
    angle_between,
    normalize_angle,
)
from navstack.move_base import GoalHandle, MoveBase, MoveBaseParams, Planning
from navstack.plugins import (
    ControlInput,
    GlobalPlanner,
    Layer,
    LayerContext,
    LocalPlan,
    LocalPlanner,
    ParamModel,
    Plan,
    RecoveryBehavior,
    RecoveryContext,
    RecoveryStatus,
    RecoveryStep,
    VelocityLimits,
)
from navstack.testing import doubles

NOTHING = object()
"""Result of `behave` for a plugin that returns None."""
LIMITS = VelocityLimits(0.5, 0.0, 0.0, 0.0, 0.5, 0.1, 1.0, 0.4, 2.5, 0.0, 3.2, 0.1)


class KinematicRobot:
    """Tracks commands exactly; map -> odom -> base_link; 0.02 s steps."""

    STEP = 0.02

    def __init__(self, start: Pose2D = Pose2D(0.0, 0.0, 0.0), map_to_odom: Transform2D = Transform2D()) -> None:
        self.time = 0.0
        self.frames = FrameTree()
        self.odom_pose = start
        self.twist = Twist2D()
        self.commands: list[tuple[float, Twist2D]] = []
        self.broken: Callable[[str], None] = lambda what: None
        self.deaf_since = math.inf
        self.frames.set_static("map", "odom", map_to_odom)
        self._publish()

    def _publish(self) -> None:
        if self.time < self.deaf_since:
            self.frames.set("odom", "base_link", Transform2D(*self.odom_pose), self.time)

    def advance_to(self, time: float) -> None:
        """Drive until `time` (s)."""
        while self.time < time - 1e-9:
            dt = min(self.STEP, time - self.time)
            x, y, yaw = self.odom_pose
            middle = yaw + 0.5 * self.twist.wz * dt
            self.odom_pose = Pose2D(
                x + self.twist.vx * math.cos(middle) * dt,
                y + self.twist.vx * math.sin(middle) * dt,
                normalize_angle(yaw + self.twist.wz * dt),
            )
            self.time += dt
            self._publish()
        self.time = max(self.time, time)

    def state(self) -> RobotState:
        self.broken("state")
        return RobotState(self.odom_pose, self.twist, self.time, "odom")

    def scans(self) -> Sequence[SensorData]:
        self.broken("scans")
        return ()

    def command(self, twist: Twist2D) -> None:
        self.broken("command")
        self.commands.append((self.time, twist))
        self.twist = twist


class EmptyLayer(Layer):
    """A layer without costs that records its resets."""

    Params = ParamModel

    def __init__(self, name: str, clearable: bool) -> None:
        super().__init__(None, LayerContext(name, "map", FrameTree(), Footprint.from_radius(0.2)))
        self._clearable = clearable
        self.resets: list[tuple[Any, bool]] = []

    def match_size(self, geometry: GridGeometry) -> None:
        del geometry

    def update_bounds(self, robot: Pose2D, now: float, bounds: Any) -> Any:
        del robot, now
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        del master, window

    @property
    def clearable(self) -> bool:
        return self._clearable

    def reset(self, region: Any = None, *, invert: bool = False) -> int:
        self.resets.append((region, invert))
        return 7


class EmptyCostmap(doubles.EmptyCostmap):
    """The empty costmap with a padded footprint and layers; its updates are recorded, stale or failing on demand."""

    def __init__(self, name: str, frame: str, robot: KinematicRobot) -> None:
        super().__init__(name, frame, robot)
        self.footprint = Footprint.from_radius(0.18, 0.01)
        self.layers = [EmptyLayer("static_layer", False), EmptyLayer("obstacle_layer", True)]
        self.updates: list[float] = []
        self.stale: Callable[[float], bool] = lambda now: False
        self.fails: Callable[[float], None] = lambda now: None

    def update(self, now: float) -> Window:
        self.fails(now)
        self.updates.append(now)
        return super().update(now)

    def is_current(self, now: float) -> bool:
        return not self.stale(now)

    def reset(self) -> int:
        return sum(layer.reset() for layer in self.layers)


class StraightPlanner(GlobalPlanner):
    """Plans a straight line; `behave(call number)` may return or raise something else."""

    Params = ParamModel

    def __init__(self, behave: Callable[[int], Any] = lambda n: None) -> None:
        super().__init__(None)
        self.behave = behave
        self.calls: list[Pose2D] = []

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Any:
        del footprint, keep_potential
        self.calls.append(goal)
        scripted = self.behave(len(self.calls) - 1)
        if scripted is not None:
            return None if scripted is NOTHING else scripted
        n = max(2, int(start.distance_to(goal) / 0.05) + 1)
        f = np.linspace(0.0, 1.0, n)
        heading = math.atan2(goal.y - start.y, goal.x - start.x)
        poses = np.column_stack(
            (start.x + f * (goal.x - start.x), start.y + f * (goal.y - start.y), np.full(n, heading))
        )
        poses[-1, 2] = goal.yaw
        return Plan(Path(poses, costmap.frame), start.distance_to(goal), goal)


def occupied(n: int) -> None:
    raise GoalOccupiedError("the goal is in a wall", call=n)


def no_control(n: int) -> None:
    raise NoValidControlError("every sample was rejected", call=n)


class TurnAndGo(LocalPlanner):
    """Turns towards the goal, drives, and turns to its heading; `behave(call number)` may return or raise something else."""

    Params = ParamModel

    def __init__(self, behave: Callable[[int], Any] = lambda n: None, limits: VelocityLimits = LIMITS) -> None:
        super().__init__(None)
        self.behave = behave
        self.calls = 0
        self.plans: list[Path] = []
        self.goal = Pose2D(0.0, 0.0)
        self._limits = limits
        self.limited: list[tuple[float | None, float | None]] = []
        self.refuse: Exception | None = None

    @staticmethod
    def halt(n: int) -> LocalPlan:
        del n
        return LocalPlan(Twist2D())

    @staticmethod
    def turn(speed: float) -> LocalPlan:
        return LocalPlan(Twist2D(0.0, 0.0, speed))

    @property
    def limits(self) -> VelocityLimits:
        return self._limits

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        self.limited.append((max_vel_trans, max_vel_theta))

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        if self.refuse is not None:
            raise self.refuse
        self.plans.append(plan)
        self.goal = goal

    def _offset(self, inputs: ControlInput) -> tuple[float, float, float]:
        goal = inputs.plan_to_costmap.apply(self.goal)
        pose = inputs.state.pose
        distance = pose.distance_to(goal)
        bearing = angle_between(pose.yaw, math.atan2(goal.y - pose.y, goal.x - pose.x)) if distance > 0.1 else 0.0
        return distance, bearing, angle_between(pose.yaw, goal.yaw)

    def compute_command(self, inputs: ControlInput) -> Any:
        self.calls += 1
        scripted = self.behave(self.calls - 1)
        if scripted is not None:
            return None if scripted is NOTHING else scripted
        distance, bearing, turn = self._offset(inputs)
        if distance > 0.1:
            speed = min(0.5, 2.0 * distance) if abs(bearing) < 0.5 else 0.0
            return LocalPlan(Twist2D(speed, 0.0, max(-1.0, min(1.0, 2.0 * bearing))))
        return LocalPlan(Twist2D(0.0, 0.0, max(-1.0, min(1.0, 2.0 * turn))))

    def goal_reached(self, inputs: ControlInput) -> bool:
        distance, _, turn = self._offset(inputs)
        return distance <= 0.1 and abs(turn) <= 0.1


class Waiting(RecoveryBehavior):
    """Turns for `lasts` seconds (0: one step); `behave(step number)` may return or raise something else."""

    Params = ParamModel

    def __init__(
        self,
        name: str = "waiting",
        lasts: float = 0.0,
        behave: Callable[[int], Any] = lambda n: None,
        frequency: float | None = None,
    ) -> None:
        super().__init__(name, None)
        self.lasts = lasts
        self.behave = behave
        self.steps = 0
        self.started: list[float] = []
        self._frequency = frequency

    @property
    def frequency(self) -> float | None:
        return self._frequency

    def start(self, context: RecoveryContext, now: float) -> None:
        self.started.append(now)
        self.steps = 0

    def step(self, state: RobotState, now: float) -> Any:
        del state
        self.steps += 1
        scripted = self.behave(self.steps - 1)
        if scripted is not None:
            return scripted
        if now - self.started[-1] >= self.lasts - 1e-6:
            return RecoveryStep(RecoveryStatus.DONE, text=f"{self.name} done")
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, 0.5))


@dataclass
class EventStore:
    """Stores the events."""

    events: list[Event] = field(default_factory=list)

    def on_event(self, event: Event) -> None:
        self.events.append(event)

    def of(self, kind: str) -> list[Event]:
        return [e for e in self.events if e.kind == kind]


class Bench:
    """A goal manager in the small world, by default with the frequencies of the turtlebot."""

    def __init__(
        self,
        *,
        planner: GlobalPlanner | None = None,
        driver: LocalPlanner | None = None,
        recoveries: Sequence[RecoveryBehavior] = (),
        planning: Planning | None = None,
        start: Pose2D = Pose2D(0.0, 0.0, 0.0),
        map_to_odom: Transform2D = Transform2D(),
        recovery_time_limit_s: float = 120.0,
        stopwatch: Callable[[], float] | None = None,
        **params: Any,
    ) -> None:
        defaults: dict[str, Any] = {
            "controller_frequency": 5.0,
            "planner_frequency": 1.0,
            "controller_patience": 3.0,
            "planner_patience": 5.0,
            "oscillation_timeout": 10.0,
            "oscillation_distance": 0.2,
        }
        self.robot = KinematicRobot(start, map_to_odom)
        self.stuck = 0
        self.global_costmap = EmptyCostmap("global_costmap", "map", self.robot)
        self.local_costmap = EmptyCostmap("local_costmap", "odom", self.robot)
        self.planner = planner or StraightPlanner()
        self.driver = driver or TurnAndGo()
        self.listener = EventStore()
        self.move_base = MoveBase(
            MoveBaseParams(**(defaults | params)),
            robot=self.robot,
            global_costmap=self.global_costmap,
            local_costmap=self.local_costmap,
            global_planner=self.planner,
            local_planner=self.driver,
            recoveries=recoveries,
            listeners=[self.listener],
            planning=planning,
            global_update_frequency=1.0,
            local_update_frequency=5.0,
            recovery_time_limit_s=recovery_time_limit_s,
            stopwatch=stopwatch,
        )

    def tick(self) -> float:
        """Execute the next tick when it is due."""
        before = self.robot.time
        self.robot.advance_to(self.move_base.next_due(before))
        self.move_base.tick(self.robot.time)
        self.stuck = self.stuck + 1 if self.robot.time == before else 0
        assert self.stuck < 50, "the time does not advance"
        return self.robot.time

    def run_to(self, time: float) -> None:
        """Execute every tick that is due up to `time` (s)."""
        while self.move_base.next_due(self.robot.time) <= time + 1e-9:
            self.tick()
        self.robot.advance_to(time)

    def run(self, handle: GoalHandle, limit: float = 200.0) -> GoalHandle:
        """Run until the goal ends."""
        end = self.robot.time + limit
        while not handle.is_done:
            self.tick()
            assert self.robot.time < end, f"the goal hangs in {self.move_base.state}"
        return handle
