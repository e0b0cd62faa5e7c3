"""Bases whose wheel velocities are linear in the velocity of the base: differential, omnidirectional and mecanum.

Wheel velocities are those of the rims, in m/s, positive when they push the base forward; divided by the wheel's radius they are
rad/s. Sources: Siegwart, Nourbakhsh, Introduction to Autonomous Mobile Robots, chapter 3; Lynch, Park, Modern Robotics,
section 13.2 (omni and mecanum wheels).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, Pose2D, Twist2D, normalize_angle


class WheelDrive:
    """A base with n wheels: the wheel velocities are `matrix` times (vx, vy, wz).

    `limits` and the simulator need nothing else, so any base of this kind can be described by its matrix.
    """

    def __init__(self, matrix: NDArray[np.float64], names: Sequence[str], *, sideways: bool) -> None:
        """`matrix` (n, 3): velocity of each wheel's rim (m/s) per vx, vy (m/s) and wz (rad/s); `names` of the wheels.

        `sideways`: whether the base can move sideways. Raises InputError for a matrix that does not determine the motion.
        """
        self.matrix = np.array(matrix, np.float64)
        self.names = tuple(names)
        self.sideways = sideways
        moved = [0, 1, 2] if sideways else [0, 2]
        if self.matrix.shape != (len(self.names), 3) or not np.isfinite(self.matrix).all():
            raise InputError(f"the matrix of a base with {len(self.names)} wheels must be finite and (n, 3)")
        if np.linalg.matrix_rank(self.matrix[:, moved]) < len(moved):
            raise InputError("the wheels do not determine the motion of the base; check their positions and directions")
        self.inverse = np.zeros((3, len(self.names)))
        """(3, n): vx, vy, wz from the wheel velocities; least squares if there are more wheels than motions."""
        self.inverse[moved] = np.linalg.pinv(self.matrix[:, moved])

    def wheel_speeds(self, twist: Twist2D) -> NDArray[np.float64]:
        """Return the velocities (n,) of the wheels' rims (m/s) for a velocity of the base."""
        return self.matrix @ np.array(twist)

    def twist(self, speeds: Sequence[float] | NDArray[np.float64]) -> Twist2D:
        """Return the velocity of the base for velocities (n,) of the wheels' rims (m/s)."""
        vx, vy, wz = (float(v) for v in self.inverse @ np.asarray(speeds, np.float64))
        return Twist2D(vx, vy, wz)

    def limited(self, twist: Twist2D, max_wheel_speed: float) -> Twist2D:
        """Return the velocity with the direction of `twist` at which no wheel exceeds `max_wheel_speed` (m/s).

        One factor for all components: the base stays on its arc, only slower.
        """
        fastest = float(np.abs(self.wheel_speeds(twist)).max())
        if fastest <= max_wheel_speed:
            return twist
        factor = max_wheel_speed / fastest
        return Twist2D(factor * twist.vx, factor * twist.vy, factor * twist.wz)


class DifferentialDrive(WheelDrive):
    """Two driven wheels on one axle: vL = v - wz d / 2, vR = v + wz d / 2; v = (vR + vL) / 2, wz = (vR - vL) / d."""

    def __init__(self, wheel_separation: float) -> None:
        """`wheel_separation` d (m): distance between the contact points of the two wheels."""
        _require_positive("wheel_separation", wheel_separation)
        self.wheel_separation = wheel_separation
        half = 0.5 * wheel_separation
        super().__init__(np.array([[1.0, 0.0, -half], [1.0, 0.0, half]]), ("left", "right"), sideways=False)


class OmniDrive(WheelDrive):
    """Omni wheels on a circle around the center, each rolling along the tangent, counter-clockwise if positive."""

    def __init__(self, radius: float, angles: Sequence[float] = (math.pi / 3.0, math.pi, -math.pi / 3.0)) -> None:
        """`radius` (m) of the circle; `angles` (rad) of the wheels on it from straight ahead, by default three at 120 degrees."""
        _require_positive("radius", radius)
        at = np.asarray(angles, np.float64)
        matrix = np.stack((-np.sin(at), np.cos(at), np.full(len(at), radius)), axis=1)
        super().__init__(matrix, tuple(f"wheel_{i}" for i in range(len(at))), sideways=True)


class MecanumDrive(WheelDrive):
    """Four mecanum wheels with rollers at 45 degrees that form an X seen from above."""

    def __init__(self, wheelbase: float, track: float) -> None:
        """`wheelbase` (m) between the axles, `track` (m) between the wheels of an axle."""
        _require_positive("wheelbase", wheelbase)
        _require_positive("track", track)
        arm = 0.5 * (wheelbase + track)
        matrix = np.array([[1.0, -1.0, -arm], [1.0, 1.0, arm], [1.0, 1.0, -arm], [1.0, -1.0, arm]])
        super().__init__(matrix, ("front_left", "front_right", "rear_left", "rear_right"), sideways=True)


def _require_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{name} = {value:g} must be a positive length in meters", parameter=name, value=value)


Method = Literal["exact", "euler", "rk2"]
METHODS: Final[tuple[Method, ...]] = get_args(Method)
"""`exact`: along the arc; `rk2`: along the heading at half of the step; `euler`: along the heading at its start."""


_SMALL_RAD: Final = 1e-8
"""Below this angle sin(a) / a is 1 to the last bit; the quotient of denormal numbers is not."""


def integrate(pose: Pose2D, twist: Twist2D, dt: float, method: Method = "exact") -> Pose2D:
    """Return the pose after `dt` (s) at a constant velocity of the base.

    With a = wz dt: `exact` moves by the chord of the arc, sin(a / 2) / (a / 2) of its length, along yaw + a / 2. `rk2` (the
    midpoint rule) moves by the whole length in the same direction: its error is a² / 24 of the length. `euler` moves along yaw:
    its error is a / 2 of the length.
    """
    turn = twist.wz * dt
    half = 0.5 * turn
    heading, scale = pose.yaw + half, dt
    if method == "euler":
        heading = pose.yaw
    elif method == "exact" and abs(half) > _SMALL_RAD:
        scale = dt * math.sin(half) / half
    c, s = math.cos(heading), math.sin(heading)
    x = pose.x + scale * (c * twist.vx - s * twist.vy)
    y = pose.y + scale * (s * twist.vx + c * twist.vy)
    return Pose2D(x, y, normalize_angle(pose.yaw + turn))


class WheelOdometry:
    """The pose and velocity of a base from the counts of its wheel encoders.

    Its error is at most one tick per wheel for any number of updates, plus slip: counts are totals, so that no
    rounding adds up.
    """

    def __init__(
        self,
        drive: WheelDrive,
        meters_per_tick: float,
        start: Pose2D = Pose2D(0.0, 0.0),
        method: Method = "exact",
    ) -> None:
        """`meters_per_tick`: 2 pi wheel radius / ticks per revolution. Raises InputError."""
        if not (math.isfinite(meters_per_tick) and meters_per_tick > 0.0):
            raise InputError(f"meters_per_tick = {meters_per_tick:g} must be positive", value=meters_per_tick)
        if method not in METHODS:
            raise InputError(f'unknown method "{method}" of integration; use {", ".join(METHODS)}', method=method)
        self.drive = drive
        self.meters_per_tick = meters_per_tick
        self.method: Method = method
        self.pose = start
        """In the frame of the odometry (m, rad)."""
        self.velocity = Twist2D()
        """Mean velocity since the update before."""
        self._ticks: NDArray[np.int64] | None = None
        self._time = 0.0

    def update(self, ticks: Sequence[int] | NDArray[np.int64], time: float) -> Pose2D:
        """Return the pose for the total counts (n,) of the wheels at `time` (s). The first call sets the zero point.

        Raises InputError for a wrong number of counts, or a time before that of the last call.
        """
        counts = np.asarray(ticks, np.int64)
        if counts.shape != (len(self.drive.names),):
            raise InputError(f"{counts.size} counts for {len(self.drive.names)} wheels ({', '.join(self.drive.names)})")
        if self._ticks is not None:
            dt = time - self._time
            if dt < 0.0:
                raise InputError(f"the encoders' time {time:g} s is before the last one, {self._time:g} s", time=time)
            moved = self.drive.twist(self.meters_per_tick * (counts - self._ticks).astype(np.float64))
            self.pose = integrate(self.pose, moved, 1.0, self.method)
            if dt > 0.0:
                self.velocity = Twist2D(moved.vx / dt, moved.vy / dt, moved.wz / dt)
        self._ticks, self._time = counts.copy(), time
        return self.pose


class SteeringAngles(NamedTuple):
    """Steering angles (rad) of a car's front wheels, positive to the left."""

    center: float
    """Angle of the wheel in the middle of the axle that the two wheels replace."""
    left: float
    right: float


class AckermannDrive:
    """A car whose base frame is at the center of the rear axle: wz = v tan(steering) / wheelbase."""

    def __init__(self, wheelbase: float, track: float, max_steering_angle: float) -> None:
        """`wheelbase` and `track` in m; `max_steering_angle` (rad) of the (center) front wheel, below pi / 2."""
        if not (wheelbase > 0.0 and track >= 0.0 and 0.0 < max_steering_angle < 0.5 * math.pi):
            raise InputError(
                f"a car needs wheelbase > 0, track >= 0 and 0 < max_steering_angle < pi / 2, not {wheelbase:g} m, {track:g} m "
                f"and {max_steering_angle:g} rad"
            )
        self.wheelbase, self.track, self.max_steering_angle = wheelbase, track, max_steering_angle

    @property
    def turning_radius(self) -> float:
        """Minimum radius (m) of the circle that the center of the rear axle drives."""
        return self.wheelbase / math.tan(self.max_steering_angle)

    def steering(self, twist: Twist2D) -> float | None:
        """Return the steering angle (rad) for a velocity; None if the car cannot drive it.

        atan(wheelbase wz / v): it cannot turn in place, nor on a circle smaller than its turning radius.
        """
        if twist.vx == 0.0:
            return 0.0 if twist.wz == 0.0 else None
        angle = math.atan(self.wheelbase * twist.wz / twist.vx)
        return angle if abs(angle) <= self.max_steering_angle + 1e-12 else None

    def twist(self, speed: float, steering: float) -> Twist2D:
        """Return the velocity at `speed` (m/s) of the rear axle and a steering angle (rad)."""
        return Twist2D(speed, 0.0, speed * math.tan(steering) / self.wheelbase)

    def front_wheels(self, steering: float) -> SteeringAngles:
        """Return the angles of both front wheels, whose axes meet on the rear axle.

        cot(outer) - cot(inner) = track / wheelbase (Ackermann).
        """
        curvature = math.tan(steering) / self.wheelbase
        left, right = (
            math.atan(self.wheelbase * curvature / (1.0 - side * 0.5 * self.track * curvature)) for side in (1.0, -1.0)
        )
        return SteeringAngles(steering, left, right)

    def rear_wheel_speeds(self, twist: Twist2D) -> tuple[float, float]:
        """Return the velocities (m/s) of the left and right rear wheels' rims."""
        half = 0.5 * self.track
        return twist.vx - half * twist.wz, twist.vx + half * twist.wz

    def rear_axle(self) -> DifferentialDrive:
        """Return the rear axle as a differential drive, for odometry from its two wheels. Raises InputError for a track of 0."""
        return DifferentialDrive(self.track)
