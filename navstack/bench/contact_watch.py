"""The contacts of a run and their causes."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from navstack.bench.contact_causes import UNEXPLAINED, Braking, Cause, Moment, cause_of, sight_of
from navstack.core import LaserScan, Pose2D, Transform2D, Twist2D
from navstack.local_planner.sampling_planner import control_period
from navstack.scenario import Run

_REMEMBERED_S: Final = 3.0
"""Longer than any robot here takes to stop."""


class ContactWatch:
    """Keeps the last seconds of a run, and finds the cause of each contact. Call `look` after every step."""

    def __init__(self, run: Run) -> None:
        self.causes: list[Cause] = []
        """The cause of each contact of the robot, oldest first."""
        self._run = run
        robot = run.robot
        lidars = [robot.params.lidar(name) for name in robot.params.lasers]
        self._mounts = {lidar.frame: Pose2D(lidar.x, lidar.y, lidar.yaw) for lidar in lidars}
        self._braking = _braking(run)
        self._moments: deque[Moment] = deque()
        self._sight = sight_of(None, robot.pose, robot.solids)
        self._sent = Twist2D()

    def look(self) -> None:
        """Find the causes of the new contacts; remember the present state."""
        robot, tick = self._run.robot, self._run.move_base.last_tick
        if not robot.world.moves:  # the robot's motion alone is the cause
            self.causes = [UNEXPLAINED] * len(robot.collisions)
            return
        for collision in robot.collisions[len(self.causes) :]:
            before = [m for m in self._moments if m.time < collision.time - 1e-9]
            self.causes.append(cause_of(self._braking, before, collision) if before else UNEXPLAINED)
        scan = next((s for s in reversed(tick.scans) if isinstance(s, LaserScan) and s.frame in self._mounts), None)
        if scan is not None:
            sensor = Transform2D(*robot.pose).apply(self._mounts[scan.frame])
            self._sight = sight_of(scan, sensor, robot.solids)
        sent, now = self._run.move_base.command, robot.time
        moment = Moment(now, robot.pose, robot.state().velocity, self._sent, sent, robot.solids, self._sight)
        self._sent = sent
        self._moments.append(moment)
        while self._moments[0].time < now - _REMEMBERED_S:
            self._moments.popleft()


def _braking(run: Run) -> Braking:
    """How the robot of a run stops: within the accelerations of its controller."""
    robot, controller = run.robot, run.move_base.local_planner
    limits = controller.limits
    x, y, w = (a if a > 0.0 else math.inf for a in (limits.acc_lim_x, limits.acc_lim_y, limits.acc_lim_theta))
    period = control_period(run.scenario.configuration.move_base.controller_frequency)
    return Braking(
        robot.footprint,
        not robot.footprint.is_round,
        robot.params.kinematics == "holonomic",
        (x, y, w),
        robot.params.command_delay,
        period,
    )
