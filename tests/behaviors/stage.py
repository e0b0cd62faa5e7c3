"""A simulated robot without walls, on which motions run directly."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Footprint, Pose2D, Twist2D
from navstack.plugins import Behavior, BehaviorContext, BehaviorStatus, BehaviorStep, VelocityLimits
from navstack.sim import SimParams, SimulatedRobot, World
from navstack.testing.doubles import EmptyCostmap, IdealRobot, StopPlanner

START = Pose2D(0.3, -0.4, 0.7)
MOVING: dict[str, Any] = {"acc_lim_x": 1.0, "acc_lim_theta": 2.0}
"""A base with the acceleration limits that its planner knows."""


class Planner(StopPlanner):
    """The limits of a turtlebot: 0.5 m/s, 1 m/s², 5 rad/s, 2 rad/s²."""

    @property
    def limits(self) -> VelocityLimits:
        return super().limits._replace(acc_lim_x=1.0, acc_lim_theta=2.0, max_vel_theta=5.0)


class Stage:
    """A motion, a robot and two empty costmaps."""

    def __init__(self, motion: Behavior, *, start: Pose2D = START, seed: int = 0, **sim: Any) -> None:
        self.motion = motion
        params = SimParams(**({"physics_frequency": 100.0} | sim))
        self.robot = SimulatedRobot(
            params, World(), Footprint.from_radius(0.18), start, seed=seed, base_frame="base_link"
        )
        robot = cast("IdealRobot", self.robot)
        self.known, self.seen = (
            EmptyCostmap("global_costmap", "map", robot),
            EmptyCostmap("local_costmap", "odom", robot),
        )
        self.context = BehaviorContext(self.known, self.seen, Planner(), 20.0)
        self.steps: list[BehaviorStep] = []
        self.times: list[float] = []
        self.poses: list[Pose2D] = []
        """True poses at the steps."""

    def wall(self, x: float, y: float, *, known: bool = False) -> None:
        """Make a cell lethal (map frame, which is that of the odometry at the start)."""
        costmap = self.known if known else self.seen
        cell = costmap.master.geometry.world_to_cell(x, y)
        assert cell is not None
        costmap.master.data[cell[1], cell[0]] = LETHAL

    def run(self, longest_s: float = 400.0) -> BehaviorStep:
        """Run to the end of the motion and until the robot stands; return the last step."""
        robot, motion = self.robot, self.motion
        motion.start(self.context, robot.time)
        frequency, begin = motion.frequency or 20.0, robot.time
        try:
            for k in range(round(longest_s * frequency)):
                robot.advance_to(begin + k / frequency)
                step = motion.step(robot.state(), robot.time)
                self.steps.append(step)
                self.times.append(robot.time)
                self.poses.append(robot.pose)
                robot.command(step.twist)
                if step.status is not BehaviorStatus.RUNNING:
                    return step
        finally:
            robot.command(Twist2D())
            robot.advance_to(robot.time + 1.0)
        raise AssertionError("the motion does not end")

    @property
    def commands(self) -> NDArray[np.float64]:
        """(n, 3) commands."""
        return np.array([step.twist for step in self.steps])
