"""A robot with ideal kinematics and empty costmaps, for tests of planners and recovery behaviors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from navstack.core import (
    LETHAL,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    NavError,
    Path,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    Window,
    normalize_angle,
)
from navstack.plugins import ControlInput, Layer, LocalPlan, LocalPlanner, VelocityLimits

FOOTPRINT = Footprint.from_radius(0.18)


def driven(pose: Pose2D, command: Twist2D, seconds: float) -> Pose2D:
    """The pose after a command was held for some seconds: exact on the arc."""
    yaw = pose.yaw + 0.5 * command.wz * seconds
    straight = abs(command.wz) < 1e-9
    chord = seconds if straight else 2.0 * math.sin(0.5 * command.wz * seconds) / command.wz
    x = pose.x + chord * (command.vx * math.cos(yaw) - command.vy * math.sin(yaw))
    y = pose.y + chord * (command.vx * math.sin(yaw) + command.vy * math.cos(yaw))
    return Pose2D(x, y, normalize_angle(pose.yaw + command.wz * seconds))


def straight_path(start: Pose2D, goal: Pose2D, frame: str = "odom") -> Path:
    """Poses every 0.05 m on the line from `start` to `goal`."""
    n = max(2, math.ceil(start.distance_to(goal) / 0.05) + 1)
    yaw = math.atan2(goal.y - start.y, goal.x - start.x)
    poses = np.column_stack((np.linspace(start.x, goal.x, n), np.linspace(start.y, goal.y, n), np.full(n, yaw)))
    poses[-1, 2] = goal.yaw
    return Path(poses, frame)


def local_costmap(pose: Pose2D, lethal: Sequence[tuple[float, float]] = (), side_m: float = 4.0) -> Costmap:
    """A window around the robot at 0.05 m; lethal cells at points of the odometry frame."""
    n = round(side_m / 0.05)
    origin = [math.floor(v / 0.05) * 0.05 - side_m / 2 for v in pose[:2]]
    costmap = Costmap(GridGeometry(n, n, 0.05, *origin), frame="odom")
    for x, y in lethal:
        cell = costmap.geometry.world_to_cell(x, y)
        if cell is not None:
            costmap.data[cell[1], cell[0]] = LETHAL
    return costmap


def control_input(
    pose: Pose2D, velocity: Twist2D = Twist2D(), lethal: Sequence[tuple[float, float]] = ()
) -> ControlInput:
    """What a local planner is given at a pose with a velocity."""
    return ControlInput(RobotState(pose, velocity), local_costmap(pose, lethal), FOOTPRINT)


class IdealRobot:
    """Follows commands exactly. Frames: map, odom, base_link."""

    def __init__(self, start: Pose2D = Pose2D(0.0, 0.0, 0.0)) -> None:
        self.time = 0.0
        self.frames = FrameTree()
        self.pose = start
        self.twist = Twist2D()
        self.frames.set_static("map", "odom", Transform2D())
        self.frames.set("odom", "base_link", Transform2D(*start), 0.0)

    def advance_to(self, time: float) -> None:
        """Move with the last command until `time` (s)."""
        while self.time < time - 1e-9:
            period = min(0.02, time - self.time)
            self.pose = driven(self.pose, self.twist, period)
            self.time += period
            self.frames.set("odom", "base_link", Transform2D(*self.pose), self.time)

    def state(self) -> RobotState:
        """Pose in odom, velocity in base_link."""
        return RobotState(self.pose, self.twist, self.time, "odom")

    def scans(self) -> Sequence[SensorData]:
        """No sensors."""
        return ()

    def command(self, twist: Twist2D) -> None:
        """Set the velocity."""
        self.twist = twist


class HasFrames(Protocol):
    """A robot that publishes its frames."""

    frames: FrameTree


class EmptyCostmap:
    """A costmap of 10 m x 10 m without layers, obstacles or sensors."""

    limits_speed = False

    def __init__(self, name: str, frame: str, robot: HasFrames) -> None:
        self.name = name
        self.frame = frame
        self.robot_base_frame = "base_link"
        self.master = Costmap(GridGeometry(200, 200, 0.05, -5.0, -5.0), frame=frame)
        self.footprint = FOOTPRINT
        self.layers: Sequence[Layer] = ()
        self._robot = robot

    def observe(self, data: SensorData) -> None:
        """Ignored."""

    def robot_pose(self, now: float | None = None) -> Pose2D:
        """The robot in this costmap's frame; raises FrameError."""
        return Pose2D(*self._robot.frames.lookup(self.frame, self.robot_base_frame, now, 0.3))

    def update(self, now: float) -> Window:
        """Nothing changes."""
        del now
        return self.master.geometry.window

    def is_current(self, now: float) -> bool:
        """Always."""
        del now
        return True

    def problems(self) -> Sequence[NavError]:
        """None."""
        return ()

    def reset(self) -> int:
        """Nothing to clear."""
        return 0

    def explain(self, ix: int, iy: int) -> None:
        """Nothing to explain."""

    def speed_limit(self, x: float, y: float, max_speed: float) -> float | None:
        """No speed limit."""


class StopPlanner(LocalPlanner):
    """A local planner that always stops; it carries limits for recovery behaviors."""

    def __init__(self) -> None:
        super().__init__(None)

    @property
    def limits(self) -> VelocityLimits:
        """Those of a turtlebot."""
        return VelocityLimits(
            *(0.5, 0.0, 0.0, 0.0, 0.5, 0.1, 1.0, 0.4),
            acc_lim_x=2.5,
            acc_lim_y=0.0,
            acc_lim_theta=3.2,
            yaw_goal_tolerance=0.1,
        )

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Ignored."""

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Ignored."""

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """Stop."""
        return LocalPlan(Twist2D())

    def goal_reached(self, inputs: ControlInput) -> bool:
        """Never."""
        return False
