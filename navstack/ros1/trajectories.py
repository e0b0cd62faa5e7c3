"""Publishes timed trajectories (trajectory_msgs/MultiDOFJointTrajectory) on `command/trajectory`, again and again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from navstack.behaviors import Trajectory, as_message, figure_eight, heart, load_trajectory, poly_path
from navstack.core import InputError
from navstack.ros1 import parameters, ros

FIRST_S: Final = 2.0
"""Time before the first trajectory (s)."""
EVERY_S: Final = 10.0
"""Time between two trajectories (s)."""
EIGHT_CENTERS: Final = ((4.0, 0.0, 2.0), (6.0, 0.0, 2.0), (8.0, 0.0, 2.0), (6.0, 0.0, 2.0))
"""Centers of the figures of eight, in turn (m)."""
HEART_CENTER: Final = (8.0, 0.0, 2.0)
"""Center of the heart (m)."""
SHAPES: Final = ("figure_eight", "heart", "poly_path")


class TrajectoryPublisher:
    """The node."""

    def __init__(self, shape: str, points: Sequence[Sequence[float]], *, plane: str, ends: bool) -> None:
        """`shape` is one of `SHAPES` or a file; `points` (m) are those of poly_path; `plane` "xy" or "yz" that of the eight.

        `ends`: also publish the samples at corners and at the end, which the known node leaves out. Raises InputError and
        InvalidTrajectoryError.
        """
        rospy = self._rospy = ros.rospy()
        self._shape, self._points, self._plane, self._ends = shape, [list(p) for p in points], plane, ends
        self._dt = parameters.number("dt", 0.1, low=1e-3, high=10.0)
        self._velocity = parameters.number("velocity", 2.0, positive=True)
        self._frame = parameters.text("inertial_frame", "map")
        parameters.text("base_frame", "base_link")
        self._at: tuple[list[float], list[float]] | None = None
        self._sent = 0
        self._type = ros.message("trajectory_msgs/MultiDOFJointTrajectory")
        if shape == "poly_path" and len(self._points) < 1:
            raise InputError("poly_path needs points; add --point x,y,z for each corner", argument="--point")
        self._file = None if shape in SHAPES else load_trajectory(shape)
        self._out = rospy.Publisher("command/trajectory", self._type, queue_size=10)
        rospy.Subscriber("odometry", ros.message("nav_msgs/Odometry"), self._on_odometry, queue_size=1)

    def _on_odometry(self, message: Any) -> None:
        p, v = message.pose.pose.position, message.twist.twist.linear
        self._at = [float(p.x), float(p.y), float(p.z)], [float(v.x), float(v.y), float(v.z)]

    def spin(self, count: int | None = None) -> None:
        """Publish until the node is shut down, or `count` trajectories."""
        while self._now() == 0.0 and not ros.is_stopping():  # no clock yet
            ros.STOP.wait(0.05)
        due = self._now() + FIRST_S
        while not ros.is_stopping() and (count is None or self._sent < count):
            if self._now() < due:
                ros.STOP.wait(0.05)
                continue
            due += EVERY_S
            self._publish()
        ros.shut_down(lambda: None)

    def _publish(self) -> None:
        trajectory = self.trajectory()
        message = self._type()
        ros.load("genpy").message.fill_message_args(message, [as_message(trajectory)])
        message.header.stamp, message.header.frame_id = self._rospy.Time.now(), self._frame
        self._out.publish(message)
        self._sent += 1
        self._rospy.loginfo(
            "published %s: %d points, %.1f s, to %d subscribers",
            trajectory.name,
            len(message.points),
            trajectory.duration,
            self._out.get_num_connections(),
        )

    def trajectory(self) -> Trajectory:
        """Return the next trajectory."""
        if self._file is not None:
            return self._file
        if self._shape == "figure_eight":
            center = EIGHT_CENTERS[self._sent % len(EIGHT_CENTERS)]
            made = figure_eight(3.0, 2.0, 10.0, center=center, plane="xy" if self._plane == "xy" else "yz", dt=self._dt)
            return made if self._ends else without(made, [made.duration])
        if self._shape == "heart":
            made = heart(1.0, 10.0, center=HEART_CENTER, dt=self._dt)
            return made if self._ends else without(made, [made.duration])
        return self._poly_path()

    def _poly_path(self) -> Trajectory:
        """Return the path through the points, from where the robot is; from the first point before the first odometry."""
        points, velocity = self._points, [0.0, 0.0, 0.0]
        if self._at is not None:
            points, velocity = [self._at[0], *points], self._at[1]
        made = poly_path(points, self._velocity, start_velocity=velocity, dt=self._dt)
        if self._ends:
            return made
        at = np.array([[*p, 0.0][:3] for p in points])
        corners = np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1)) / self._velocity
        made = without(made, corners.tolist())
        made.acceleration[0] = 0.0
        return made

    def _now(self) -> float:
        return float(self._rospy.get_time())


def without(trajectory: Trajectory, times: Sequence[float]) -> Trajectory:
    """Return the trajectory without its samples at these times (s)."""
    keep = np.ones(len(trajectory), np.bool_)
    for time in times:
        keep &= np.abs(trajectory.t - time) > 1e-9 * max(1.0, time)
    t = trajectory
    return Trajectory(t.t[keep], t.position[keep], t.velocity[keep], t.acceleration[keep], t.frame, t.name)
