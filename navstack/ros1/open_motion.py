"""Runs single motions on a robot that publishes tf and follows a velocity topic: no costmaps, no planner."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any, Final, cast

from navstack.behaviors import BehaviorRunner, Motion, MotionLimits, MotionTimeoutError, Move, TimedBehavior, Turn
from navstack.core import FrameError, NavError, Pose2D, RecoveryError, RobotState, Twist2D, clean_frame
from navstack.parameters import MotionParams
from navstack.plugins import BehaviorContext, BehaviorStep
from navstack.ros1 import parameters, ros
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import Inbox, NodeClock, RosRobot

VELOCITY_TOPIC: Final = "/mobile_base/mobile_base_controller/cmd_vel"
"""Default of `~vel_topic`."""
SILENCE_S: Final = 1.0
"""A motion fails if no newer transform comes for this time (s, wall)."""
CONNECTION_S: Final = 1.0
"""Longest wait for a subscriber of the velocity (s, wall)."""
MOST_DAMPING: Final = 16.0
"""Largest factor of the time in which the way left is driven."""
POLL_S: Final = 0.005
"""Time between two looks at the clock (s, wall)."""
NO_CONTEXT: Final = cast("BehaviorContext", None)
"""An `OpenMotion` has no costmaps and no planner to act on."""


class OpenMotion(Motion):
    """A motion by the odometry alone: there are no costmaps and no planner, so no limits of them, and no collision checks."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.damping = Damping()

    @property
    def limits(self) -> MotionLimits:
        """No limits but the speed of the parameters."""
        return MotionLimits()

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start from the pose of the first step; `context` is not used."""
        TimedBehavior.start(self, context, now)
        self.damping = Damping()

    def cycle(self, now: float) -> float:
        """Return the time (s) in which the way left is driven: a cycle, longer after reversals."""
        del now
        return self.damping.factor / self.params.frequency

    def checked(self, step: BehaviorStep, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the step."""
        self.damping.commanded(step.twist)
        return step

    def within_allowance(self) -> str:
        """Return the end of the message of a time-out."""
        return f"within {self.allowance:.1f} s"


class OpenMove(OpenMotion, Move):
    """`Move` without acceleration limits and collision checks. As the known node it does not steer."""

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step."""
        step = super().command(pose, state, now)
        return replace(step, twist=Twist2D(step.twist.vx, 0.0, 0.0))


class OpenTurn(OpenMotion, Turn):
    """`Turn` without acceleration limits and collision checks."""


@dataclass(frozen=True, slots=True)
class Settings:
    """The parameters that the nodes for motions share."""

    tolerance: float
    """m or rad."""
    speed: float
    """m/s or rad/s."""
    rate: float
    """Hz."""
    topic: str
    base_frame: str
    odom_frame: str

    @classmethod
    def read(cls, tolerance: float, speed_name: str, speed: float) -> Settings:
        """Read them from the parameter server; the arguments are defaults. Raises InputError."""
        return cls(
            parameters.number("tolerance", tolerance, positive=True),
            parameters.number(speed_name, speed, positive=True),
            parameters.number("velocity_pub_rate", 10.0, low=1.0, high=1000.0),
            parameters.text("vel_topic", VELOCITY_TOPIC),
            clean_frame(parameters.text("base_frame", "/base_link")),
            clean_frame(parameters.text("odom_frame", "/odom")),
        )

    def move(self, distance: float) -> OpenMove:
        """Return a motion by `distance` (m). A distance within the tolerance is driven too, to half of it."""
        tolerance = self._within(abs(distance))
        params = MotionParams(
            frequency=self.rate, speed_linear=self.speed, tolerance=tolerance, disable_collision_checks=True
        )
        return OpenMove(distance, params, "LinearMove")

    def turn(self, angle: float, *, direct: bool) -> OpenTurn:
        """Return a turn by `angle` (rad): the shorter way to that heading, or, if `direct`, by all of it."""
        tolerance = self._within(abs(angle))
        params = MotionParams(
            frequency=self.rate, speed_radian=self.speed, tolerance_radian=tolerance, disable_collision_checks=True
        )
        return OpenTurn(angle if direct or not math.isfinite(angle) else shorter(angle), params, "RadianTurn")

    def _within(self, size: float) -> float:
        return 0.5 * size if 0.0 < size <= self.tolerance else self.tolerance


def shorter(angle: float) -> float:
    """Return the turn (rad) of at most half a turn to the same heading; half a turn keeps its direction."""
    rest = math.copysign(math.fmod(abs(angle), 2.0 * math.pi), angle)
    return rest if abs(rest) <= math.pi else rest - math.copysign(2.0 * math.pi, rest)


class OpenMotionRunner:
    """Publishes the commands of motions, by the transform from the odometry to the base."""

    def __init__(self, settings: Settings) -> None:
        rospy = self._rospy = ros.rospy()
        self.settings = settings
        self.inbox = Inbox()
        self._clock = NodeClock(ros.now_ns)
        self._build = MessageBuilder(ros.MessageTypes(), ros1=True)
        self._out = rospy.Publisher(settings.topic, ros.message("geometry_msgs/Twist"), queue_size=5)
        self._robot = RosRobot(self._clock, self.publish, self._report)
        tf, later = ros.message("tf2_msgs/TFMessage"), self.inbox.poster
        rospy.Subscriber("/tf_static", tf, later(self._robot.receive_transforms, static=True), queue_size=100)
        rospy.Subscriber("/tf", tf, later(self._robot.receive_transforms, static=False), queue_size=100)

    def publish(self, twist: Twist2D) -> None:
        """Publish a velocity."""
        self._out.publish(self._build.twist(twist))

    def wait_for_transform(self, timeout_s: float) -> None:
        """Wait up to `timeout_s` (s, wall) for the transform. Raises FrameError."""
        end = time.monotonic() + timeout_s
        while not ros.is_stopping():
            self.inbox.run(0.05, self._report)
            if self._pose() is not None:
                return
            if time.monotonic() > end:
                raise FrameError(
                    f"no transform from {self.settings.odom_frame} to {self.settings.base_frame} within {timeout_s:g} s; "
                    "set ~odom_frame and ~base_frame to the frames of the robot",
                    odom_frame=self.settings.odom_frame,
                    base_frame=self.settings.base_frame,
                )

    def run(self, motion: OpenMotion) -> str:
        """Run a motion to its end, then publish zero; return what was done.

        Raises a RecoveryError if it takes too long, if the transform stops, or if the node is shut down; an InputError for a
        motion that is not finite.
        """
        try:
            return self._run(motion)
        finally:
            if not self._rospy.is_shutdown():
                self.publish(Twist2D())

    def _run(self, motion: OpenMotion) -> str:
        self.wait_for_transform(SILENCE_S)
        self._wait_for_subscriber()
        if isinstance(motion, Turn):
            self.publish(Twist2D())  # as the known node: the robot stops first
        motion.frame = self.settings.odom_frame
        jumps, heard = self._clock.jumps, _Heard()
        runner = BehaviorRunner(_Pace)
        runner.start(motion, NO_CONTEXT, self._clock.now(), self.settings.rate)
        while not ros.is_stopping():
            self.inbox.run(POLL_S, self._report)
            found, now = self._pose(), self._clock.now()
            if self._clock.jumps != jumps:
                self._robot.forget()
                raise RecoveryError(f"{motion.summary()}: the clock jumped back")
            if found is None or heard.is_silent(found[1]):
                raise RecoveryError(f"{motion.summary()}: no transform to {self.settings.base_frame} any more")
            if not runner.is_due(now):
                continue
            state = RobotState(found[0], Twist2D(), found[1], self.settings.odom_frame)
            step = runner.step(lambda _, state=state: state, now)
            if not isinstance(step, BehaviorStep):
                if step.error is not None:
                    raise self._explained(step.error)
                return step.text
            self.publish(step.twist)
            runner.advance(now)
        raise RecoveryError(f"{motion.summary()}: the node was shut down")

    def _wait_for_subscriber(self) -> None:
        """Wait for a subscriber, because the first messages of a new publisher are lost."""
        end = time.monotonic() + CONNECTION_S
        while self._out.get_num_connections() == 0 and time.monotonic() < end and not ros.is_stopping():
            self.inbox.run(0.02, self._report)

    def _explained(self, error: NavError) -> NavError:
        """Return the error; of a motion that takes too long because nobody listens, with that reason."""
        if not isinstance(error, MotionTimeoutError) or self._out.get_num_connections() > 0:
            return error
        hint = f"no node subscribes to {self.settings.topic}: set ~vel_topic to the robot's topic"
        return MotionTimeoutError(f"{error.message}; {hint}", **error.data)

    def _pose(self) -> tuple[Pose2D, float] | None:
        """Return the newest pose of the base in the odometry's frame, and its time (s)."""
        frames, s = self._robot.frames, self.settings
        try:
            at = frames.lookup(s.odom_frame, s.base_frame)
            return Pose2D(*at), frames.latest_stamp(s.odom_frame, s.base_frame)
        except FrameError:
            return None

    def _report(self, error: NavError) -> None:
        self._rospy.logwarn("%s", error.message)


class Damping:
    """Slows a robot that has passed its target: with late odometry it would swing about it at full speed.

    The speed near the target is the way left over a time, at first that of one cycle; `factor` doubles it with each reversal.
    """

    def __init__(self) -> None:
        self.factor = 1.0
        self._sign = 0.0

    def commanded(self, twist: Twist2D) -> None:
        """Note a command."""
        value = twist.vx or twist.wz
        if value == 0.0:
            return
        sign = math.copysign(1.0, value)
        if self._sign not in (0.0, sign):
            self.factor = min(2.0 * self.factor, MOST_DAMPING)
        self._sign = sign


class _Pace:
    """Steps at a rate from the first one on; one that is late by more than a period is not made up for."""

    def __init__(self, frequency: float, now: float) -> None:
        del now
        self._period = 1.0 / frequency
        self.due = -math.inf

    def is_due(self, now: float) -> bool:
        """Return True at and after the due time (s)."""
        return now >= self.due

    def advance(self, now: float) -> None:
        """Set the next due time, for a step at `now` (s)."""
        last = now if self.due == -math.inf else self.due
        self.due = max(last + self._period, now - self._period)


class _Heard:
    """When the last new transform came."""

    def __init__(self) -> None:
        self._stamp: Any = None
        self._at = time.monotonic()

    def is_silent(self, stamp: float) -> bool:
        """Return True if the stamp (s) has not changed for `SILENCE_S`."""
        now = time.monotonic()
        if stamp != self._stamp:
            self._stamp, self._at = stamp, now
        return now - self._at > SILENCE_S
