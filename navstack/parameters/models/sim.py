"""Parameters of the simulator: the `navstack: sim:` section of the YAML."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self, TypeVar

from pydantic import field_validator, model_validator

from navstack.core import InputError
from navstack.plugins import ParamModel, param

# ----------------------------------------------------------------------------------------------------------------------
# Parameters of the body of the simulated robot: kinematics and limits.


MAX_CAR_ANGLE = 0.5 * math.pi - 1e-6
"""Steering angles above this (rad) count as a quarter turn: only a base driven at its steered wheel moves then."""


class BodyParams(ParamModel):
    """The body of the simulated robot: kinematics, and limits of velocity and steering."""

    kinematics: Literal["differential", "holonomic", "ackermann", "tricycle"] = param(
        "differential",
        "differential: no sideways motion; holonomic: motion in every direction; ackermann: a car, driven at its rear axle, "
        "which is its center: the yaw rate of a command sets the steering angle, and it cannot turn in place; tricycle: "
        "steered and driven at its single front wheel, its center on the rear axle",
    )
    physics_frequency: float = param(
        50.0, "frequency of the simulation steps of the body", unit="Hz", gt=0.0, le=10_000.0
    )
    body_height: float | None = param(
        None,
        "a lidar or sonar of another robot that is mounted higher does not see it; none: always seen",
        unit="m",
        gt=0.0,
    )
    acc_lim_x: float | None = param(
        None, "maximum forward acceleration (tricycle: of the front wheel); none: unlimited", unit="m/s²", gt=0.0
    )
    acc_lim_y: float | None = param(None, "maximum sideways acceleration; none: unlimited", unit="m/s²", gt=0.0)
    acc_lim_theta: float | None = param(None, "maximum angular acceleration; none: unlimited", unit="rad/s²", gt=0.0)
    jerk_lim_x: float | None = param(
        None,
        "maximum forward jerk; none: unlimited. Observed where the command allows; the velocity does not overshoot a constant "
        "command",
        unit="m/s³",
        gt=0.0,
    )
    jerk_lim_y: float | None = param(None, "maximum sideways jerk; none: unlimited", unit="m/s³", gt=0.0)
    jerk_lim_theta: float | None = param(
        None, "maximum angular jerk; none: unlimited; not used by ackermann and tricycle", unit="rad/s³", gt=0.0
    )
    wheelbase: float = param(
        0.5, "ackermann, tricycle: distance from the rear axle to the front wheels", unit="m", gt=0.0
    )
    max_steering_angle: float = param(
        0.6,
        "ackermann, tricycle: maximum angle of the (center) front wheel, in both directions; a tricycle whose wheel turns by "
        "pi / 2 can turn in place",
        unit="rad",
        gt=0.0,
        le=0.5 * math.pi,
    )
    max_steering_rate: float | None = param(
        None, "ackermann, tricycle: maximum rate of the steering angle; none: unlimited", unit="rad/s", gt=0.0
    )
    steering_lag: float | None = param(
        None,
        "ackermann, tricycle: time constant of the controller of the steering angle; none: velocity_lag",
        unit="s",
        ge=0.0,
    )
    min_turning_radius: float = param(
        0.0,
        "ackermann, tricycle: minimum turning radius of the rear axle's center, if larger than wheelbase / "
        "tan(max_steering_angle)",
        unit="m",
        ge=0.0,
    )
    steering_command: Literal["yaw_rate", "angle"] = param(
        "yaw_rate",
        "ackermann, tricycle: meaning of the angular part of a command. yaw_rate: the yaw rate w, which gives the steering "
        "angle atan(wheelbase * w / v); a stopped base keeps its steering angle. angle: the steering angle; the "
        "linear part is then the velocity of the driven wheels",
    )

    @model_validator(mode="after")
    def _check_steering(self) -> Self:
        if self.kinematics == "ackermann" and self.max_steering_angle > MAX_CAR_ANGLE:
            raise ValueError(
                f"max_steering_angle = {self.max_steering_angle:g} rad of kinematics ackermann must be less than pi / 2: a car "
                "is driven at its rear axle; use tricycle for a base that is driven at its steered wheel"
            )
        return self

    @property
    def is_steered(self) -> bool:
        """True for a base with a steering angle: `ackermann` and `tricycle`."""
        return self.kinematics in ("ackermann", "tricycle")

    @property
    def steering_limit(self) -> float:
        """Maximum steering angle of a steered base (rad), from `max_steering_angle` and `min_turning_radius`."""
        if self.min_turning_radius <= 0.0:
            return self.max_steering_angle
        return min(self.max_steering_angle, math.atan(self.wheelbase / self.min_turning_radius))

    @property
    def turning_radius(self) -> float:
        """Minimum turning radius of a steered base's rear axle (m); 0 for a base that can turn in place."""
        limit = self.steering_limit
        return self.wheelbase / math.tan(limit) if self.is_steered and limit <= MAX_CAR_ANGLE else 0.0


# ----------------------------------------------------------------------------------------------------------------------
# Parameters of the wheels of the simulated robot: `navstack: sim: wheels:`.


MAX_WHEELS = 4


class WheelParams(ParamModel):
    """The wheels of the base: their limits, their encoders, and the odometry made of them.

    Without `drive`, the base has no wheels of its own: it executes velocities, and its odometry is continuous. The defaults are
    those of a Kobuki.
    """

    drive: Literal["none", "differential", "omni", "mecanum"] = param(
        "none",
        "none: no wheels; differential: two on one axle (kinematics: differential); omni: on a circle; mecanum: four with "
        "rollers at 45 degrees (both with kinematics: holonomic)",
    )
    separation: float = param(0.23, "differential, mecanum: distance between left and right wheels", unit="m", gt=0.0)
    wheelbase: float = param(0.3, "mecanum: distance between the axles", unit="m", gt=0.0)
    circle_radius: float = param(0.15, "omni: radius of the circle on which the wheels are", unit="m", gt=0.0)
    angles: list[float] = param(
        [1.0471975511965976, 3.141592653589793, -1.0471975511965976],
        "omni: positions of the 3 or 4 wheels on that circle, from straight ahead",
        unit="rad",
    )
    radius: float = param(0.035, "radius of the wheels", unit="m", gt=0.0)
    max_speed: float | None = param(
        None,
        "maximum speed of a wheel; a faster command is slowed down on its arc; none: unlimited",
        unit="rad/s",
        gt=0.0,
    )
    max_acceleration: float | None = param(
        None, "maximum acceleration of each wheel; none: unlimited", unit="rad/s²", gt=0.0
    )
    ticks_per_revolution: float | None = param(
        None, "counts of the encoders per revolution (Kobuki: 2578.33); none: continuous", gt=0.0, le=1e9
    )
    integration: Literal["exact", "rk2", "euler"] = param(
        "exact",
        "how the odometry integrates: along the arc, the heading at half of the step, or the heading at its start",
    )
    radius_errors: list[float] = param(
        [], "relative error of the true radius of each wheel (left, right; or in the order of the drive); none: 0"
    )

    @field_validator("angles")
    @classmethod
    def _check_angles(cls, value: list[float]) -> list[float]:
        distinct = {round(math.remainder(angle, 2.0 * math.pi), 9) for angle in value}
        if not 3 <= len(value) <= MAX_WHEELS or len(distinct) < len(value):
            raise ValueError(f"angles = {value} must be 3 or 4 different positions of omni wheels")
        return value

    @field_validator("radius_errors")
    @classmethod
    def _check_errors(cls, value: list[float]) -> list[float]:
        if len(value) > MAX_WHEELS or any(abs(error) > 0.5 for error in value):
            raise ValueError(f"radius_errors = {value} must be at most {MAX_WHEELS} numbers from -0.5 to 0.5")
        return value

    @property
    def count(self) -> int:
        """Number of wheels."""
        return {"none": 0, "differential": 2, "omni": len(self.angles), "mecanum": 4}[self.drive]

    @property
    def meters_per_tick(self) -> float:
        """Way of the rim per count of the encoder (m); 0 for continuous encoders."""
        ticks = self.ticks_per_revolution
        return 0.0 if ticks is None else 2.0 * math.pi * self.radius / ticks


S = TypeVar("S", bound=ParamModel)

ODOMETRY_LIMIT = 1.0
"""Maximum relative error of odometry and wheels (errors of the heading: rad/m)."""


def _check_range(range_min: float, range_max: float) -> None:
    if range_min >= range_max:
        raise ValueError(
            f"range_min = {range_min:g} is not less than range_max = {range_max:g}, so nothing can be measured; set it below "
            "range_max"
        )


class LidarParams(ParamModel):
    """A planar lidar. The defaults are the turtlebot's depth camera used as a laser scanner."""

    topic: str = param("scan", "topic of its scans, as named by an observation source")
    frame: str = param("base_laser_link", "frame of its scans; a child of the base frame")
    x: float = param(0.1, "mounting position ahead of the robot's center", unit="m")
    y: float = param(0.0, "mounting position to the left of the robot's center", unit="m")
    yaw: float = param(0.0, "mounting direction of the center beam", unit="rad")
    height: float = param(0.3, "height above the ground", unit="m", ge=0.0)
    beams: int = param(640, "beams per scan", ge=1, le=100_000)
    fov: float = param(
        1.0,
        "angle from the first to the last beam; a full circle (2 pi) is divided by the number of beams, so that no "
        "direction is measured twice",
        unit="rad",
        gt=0.0,
        le=6.283185307179587,
    )
    range_min: float = param(0.45, "shorter ranges are reported as -inf (REP 117)", unit="m", ge=0.0)
    range_max: float = param(6.0, "longer ranges are reported as +inf", unit="m", gt=0.0)
    frequency: float = param(10.0, "scans per second", unit="Hz", gt=0.0)
    delay: float = param(
        0.0, "time from a scan to its arrival; it keeps the stamp of its measurement", unit="s", ge=0.0, le=60.0
    )
    range_noise: float = param(0.0, "standard deviation of the ranges", unit="m", ge=0.0)
    dropout: float = param(0.0, "fraction of beams lost in each scan, reported as NaN", ge=0.0, le=1.0)
    no_return: Literal["inf", "max"] = param(
        "inf", "value of a beam without a return: inf: +inf (REP 117); max: range_max, as older drivers do"
    )
    message: Literal["LaserScan", "PointCloud2", "PointCloud"] = param(
        "LaserScan", "LaserScan: ranges; PointCloud2, PointCloud: the points that its beams hit, at its height"
    )

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        _check_range(self.range_min, self.range_max)
        return self

    @property
    def angle_increment(self) -> float:
        """Angle between adjacent beams (rad)."""
        if self.beams == 1:
            return self.fov
        full_circle = self.fov > 2.0 * math.pi - 1e-6
        return self.fov / (self.beams if full_circle else self.beams - 1)

    @property
    def angle_min(self) -> float:
        """Direction of the first beam in the frame of the lidar (rad)."""
        return -0.5 * self.angle_increment * (self.beams - 1)


class BumperParams(ParamModel):
    """Bumpers around the body, published as points at the pressed zones. The defaults are the Kobuki's.

    The zones are those of its simulator (kobuki_gazebo): left, center, right, none at the rear. kobuki_bumper2pc places a
    point in front of each pressed zone, at 0.25 m for a body of 0.1755 m, so that the marked cell is not cleared with the
    footprint. A last cloud without near points signals the release.
    """

    topic: str = param(
        "mobile_base/sensors/bumper_pointcloud", "topic of its clouds, as named by an observation source"
    )
    frame: str = param("bumper_link", "frame of its points, at the robot's center; a child of the base frame")
    zones: list[list[float]] = param(
        [[0.5236, 1.5708], [-0.5236, 0.5236], [-1.5708, -0.5236]],
        "[from, to] of each sensitive sector, counter-clockwise from straight ahead",
        unit="rad",
    )
    height: float = param(0.04, "height of the points above the ground", unit="m", ge=0.0)
    distance: float = param(
        0.075,
        "distance of the points from the footprint; if it is less than the footprint's padding plus one cell, the mark is "
        "cleared with the robot's own cells",
        unit="m",
        ge=0.0,
    )
    point: Literal["contact", "zone"] = param(
        "contact", "contact: the point is at the contact; zone: at the center of the zone, as on a Kobuki"
    )
    frequency: float = param(50.0, "frequency of clouds while a zone is pressed; none otherwise", unit="Hz", gt=0.0)

    @field_validator("zones")
    @classmethod
    def _check_zones(cls, value: list[list[float]]) -> list[list[float]]:
        for zone in value:
            if len(zone) != 2 or not 0.0 < zone[1] - zone[0] <= 2.0 * math.pi + 1e-6:
                raise ValueError(
                    f"zone {zone} is not valid; write [from, to] in rad, with from < to and at most a full circle"
                )
        return value


class SonarParams(ParamModel):
    """A sonar or infrared sensor: the shortest distance in a cone, for the range sensor layer."""

    topic: str = param("sonar", "topic of its readings, as named by the range sensor layer")
    frame: str = param("sonar_link", "frame of its readings; a child of the base frame, unique to each sonar")
    x: float = param(0.1, "mounting position ahead of the robot's center", unit="m")
    y: float = param(0.0, "mounting position to the left of the robot's center", unit="m")
    yaw: float = param(0.0, "mounting direction of the axis of the cone", unit="rad")
    height: float = param(0.2, "height above the ground", unit="m", ge=0.0)
    fov: float = param(0.5, "opening angle of the cone", unit="rad", gt=0.0, le=3.14159)
    beams: int = param(31, "rays of which the shortest is the reading", ge=1, le=10_000)
    range_min: float = param(0.02, "shorter distances are reported as this value", unit="m", ge=0.0)
    range_max: float = param(3.0, "maximum range", unit="m", gt=0.0)
    frequency: float = param(10.0, "frequency of readings", unit="Hz", gt=0.0)
    delay: float = param(
        0.0, "time from a reading to its arrival; it keeps the stamp of its measurement", unit="s", ge=0.0, le=60.0
    )
    range_noise: float = param(0.0, "standard deviation of the readings", unit="m", ge=0.0)
    dropout: float = param(0.0, "fraction of readings that miss an obstacle", ge=0.0, le=1.0)
    no_return: Literal["inf", "max"] = param(
        "max", "value without an obstacle in range: max: range_max, as sonars do; inf: +inf (REP 117)"
    )

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        _check_range(self.range_min, self.range_max)
        return self


class ImuParams(ParamModel):
    """An inertial measurement unit of a planar robot: orientation and yaw rate."""

    topic: str = param("imu", "topic of its readings")
    frame: str = param("imu_link", "frame of its readings; a child of the base frame")
    x: float = param(0.0, "mounting position ahead of the robot's center", unit="m")
    y: float = param(0.0, "mounting position to the left of the robot's center", unit="m")
    yaw: float = param(0.0, "mounting direction", unit="rad")
    frequency: float = param(50.0, "frequency of readings, at most one per physics step", unit="Hz", gt=0.0)
    orientation_noise: float = param(0.0, "standard deviation of the yaw, independent per reading", unit="rad", ge=0.0)
    yaw_rate_noise: float = param(
        0.0, "standard deviation of the yaw rate, independent per reading", unit="rad/s", ge=0.0
    )
    yaw_rate_bias: float = param(
        0.0, "constant error of the yaw rate; the yaw, its integral, drifts with it", unit="rad/s"
    )
    yaw_rate_drift: float = param(
        0.0, "random walk of the bias: standard deviation after one second", unit="rad/s", ge=0.0
    )


MAX_PIXELS = 4096
"""Maximum width and height of a picture (pixels)."""


class CameraParams(ParamModel):
    """A level color and depth camera. It takes pictures only when it is asked.

    The defaults are the turtlebot's Kinect: both images have the same pixels, a focal length of 554 pixels, and no distortion.
    """

    topic: str = param(
        "camera",
        "namespace of its topics: `rgb/image_raw` and `depth/image_raw`, each with a `camera_info` next to it",
    )
    frame: str = param(
        "camera",
        "beginning of the names of its frames: camera_link, camera_rgb_optical_frame, camera_depth_optical_frame",
    )
    x: float = param(0.1, "mounting position ahead of the robot's center", unit="m")
    y: float = param(0.0, "mounting position to the left of the robot's center", unit="m")
    z: float = param(0.3, "height above the ground", unit="m", gt=0.0)
    yaw: float = param(0.0, "mounting direction of the optical axis", unit="rad")
    horizontal_fov: float = param(
        1.0471975511965976,
        "angle from the left to the right border of the image; the pixels are square",
        unit="rad",
        gt=0.0,
        le=3.0,
    )
    width: int = param(640, "pixels per row", unit="px", ge=1, le=MAX_PIXELS)
    height: int = param(480, "rows", unit="px", ge=1, le=MAX_PIXELS)
    frequency: float = param(10.0, "pictures per second, at most", unit="Hz", gt=0.0)
    range_min: float = param(0.45, "smaller depths are reported as -inf (REP 118)", unit="m", ge=0.0)
    range_max: float = param(8.0, "larger depths are reported as +inf", unit="m", gt=0.0)
    depth_encoding: Literal["32FC1", "16UC1"] = param(
        "32FC1",
        "32FC1: depth in meters; 16UC1: in millimeters, 0 where there is none, as raw images of drivers (REP 118)",
    )
    wall_height: float = param(
        2.5, "height of the walls of the map, and of doors and segments without a height", unit="m", gt=0.0
    )
    person_height: float = param(1.75, "height of pedestrians without a height", unit="m", gt=0.0)
    obstacle_height: float = param(1.0, "height of other obstacles without a height", unit="m", gt=0.0)

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        _check_range(self.range_min, self.range_max)
        if self.z >= self.wall_height:
            raise ValueError(
                f"z = {self.z:g} is not less than wall_height = {self.wall_height:g}: a camera does not look over the walls of "
                "the map; raise wall_height"
            )
        return self

    def of_width(self, width: int) -> Self:
        """Return a camera with the same view and `width` pixels per row. Raises InputError for a width outside of 1 .. 4096."""
        if not 1 <= width <= MAX_PIXELS:
            raise InputError(f"the width of a picture is {width}; it must be from 1 to {MAX_PIXELS}", width=width)
        return self.model_copy(update={"width": width, "height": max(1, round(self.height * width / self.width))})

    @property
    def focal_length(self) -> float:
        """Focal length (pixels)."""
        return 0.5 * self.width / math.tan(0.5 * self.horizontal_fov)

    @property
    def image_center(self) -> tuple[float, float]:
        """Column and row of the optical axis (pixels); whole numbers are the centers of pixels."""
        return 0.5 * (self.width - 1), 0.5 * (self.height - 1)


class SimDockParams(ParamModel):
    """A dock of the simulated world: a body that lidars see, a marker that the dock camera sees, and two contacts.

    The battery is charged while the robot is at the contacts.
    """

    pose: list[float] = param(
        [0.0, 0.0, 0.0],
        "[x, y, yaw] in the map of the base of a robot whose contacts meet those of the dock; the x axis points into the dock",
        unit="m, m, rad",
    )
    contact_side: Literal["front", "back"] = param("front", "the end of the robot that has the contacts")
    body: Literal["none", "box", "v_reflector"] = param(
        "box", "none: no obstacle; box: a box behind the marker; v_reflector: two walls that meet in the marker"
    )
    marker_x: float = param(
        0.25, "distance from the docked base to the marker and the face of the body", unit="m", gt=0.0
    )
    width: float = param(0.3, "width of the box", unit="m", gt=0.0)
    depth: float = param(0.1, "depth of the box, and of the reflector behind its vertex", unit="m", gt=0.0)
    reflector_length: float = param(0.2, "length of each of the two walls", unit="m", gt=0.0)
    reflector_angle: float = param(
        2.36,
        "angle between the two walls on the side of the robot: below pi the vertex is the deepest point, above pi the nearest",
        unit="rad",
        gt=0.5,
        lt=5.8,
    )
    height: float | None = param(
        None, "a lidar mounted higher does not see the body; none: always seen", unit="m", gt=0.0
    )
    has_marker: bool = param(True, "the dock camera sees the dock")
    contact_depth: float = param(
        0.005, "travel of the springs of the contacts: error along the x axis at which they meet", unit="m", gt=0.0
    )
    contact_width: float = param(
        0.01, "half the width of the contacts: lateral error at which they meet", unit="m", gt=0.0
    )
    contact_angle: float = param(
        0.017, "error of the yaw at which both contacts meet (just below 1 degree)", unit="rad", gt=0.0
    )
    powered: bool = param(True, "false: the contacts carry no current")
    charging_current: float = param(4.0, "current from the contacts", unit="A", gt=0.0)
    charging_delay: float = param(0.5, "time from the contact to the current", unit="s", ge=0.0)

    @field_validator("pose")
    @classmethod
    def _check_pose(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError(f"pose = {value} is not a pose; write [x, y, yaw] (m, m, rad)")
        return value


class DockCameraParams(ParamModel):
    """What sees the markers of docks: a detector of tags behind a camera. It measures only in a world with docks."""

    frame: str = param("dock_camera", "frame of the detections")
    topic: str = param("detected_dock_pose", "topic of the detections")
    x: float = param(0.1, "position in the base frame", unit="m")
    y: float = param(0.0, "position in the base frame", unit="m")
    yaw: float = param(0.0, "viewing direction in the base frame", unit="rad")
    frequency: float = param(15.0, "rate of the detections", unit="Hz", gt=0.0)
    fov: float = param(1.2, "field of view", unit="rad", gt=0.0, le=2.0 * math.pi)
    range_min: float = param(0.1, "nearest marker", unit="m", ge=0.0)
    range_max: float = param(3.0, "farthest marker", unit="m", gt=0.0)
    max_obliqueness: float = param(
        1.2, "largest angle between the normal of the marker and the line of sight", unit="rad", gt=0.0
    )
    noise: float = param(0.0, "standard deviation of x and of y in a detection", unit="m", ge=0.0)
    yaw_noise: float = param(0.0, "standard deviation of the yaw in a detection", unit="rad", ge=0.0)
    dropout: float = param(0.0, "share of the detections that fail", ge=0.0, le=1.0)
    delay: float = param(0.0, "time from a measurement to its arrival", unit="s", ge=0.0)

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        _check_range(self.range_min, self.range_max)
        return self


class BatteryParams(ParamModel):
    """The battery of the simulated robot. At a charge of 0 the base no longer moves."""

    capacity: float | None = param(None, "charge of the full battery; none: it never changes", unit="Ah", gt=0.0)
    charge: float = param(1.0, "share of the capacity at the start", ge=0.0, le=1.0)
    voltage: float = param(14.8, "voltage", unit="V", gt=0.0)
    idle_current: float = param(1.0, "current of the robot at rest", unit="A", ge=0.0)
    drive_current: float = param(2.0, "further current at 1 m/s, in proportion to the speed", unit="A s/m", ge=0.0)


class SimParams(BodyParams):
    """The simulated robot and its sensors.

    The defaults are those of the simulator in which the C++ stack was measured: the base executes every command
    immediately, at 50 Hz, with one forward-looking lidar, exact odometry, and odom equal to map.
    """

    CHILD_FIELD: ClassVar[str | None] = "sensors"

    command_timeout: float | None = param(
        None, "a command older than this stops the base; none: it stays in effect until the next one", unit="s", gt=0.0
    )
    command_delay: float = param(0.0, "dead time between a command and the base", unit="s", ge=0.0)
    velocity_lag: float = param(0.0, "time constant of the base's velocity controller", unit="s", ge=0.0)
    wheel_slip: float = param(
        0.0,
        "relative standard deviation of the true motion from that of the wheels, over one second of driving",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    odometry_noise: float = param(
        0.0,
        "relative standard deviation of the odometry from the motion of the wheels, over one second of driving",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    wheel_slip_turn: float = param(
        0.0,
        "standard deviation of the heading error that slip adds over one meter of driving; it grows with the square root of "
        "the distance",
        unit="rad/√m",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    odometry_noise_turn: float = param(
        0.0,
        "standard deviation of the heading error of the odometry over one meter of driving",
        unit="rad/√m",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    odometry_scale: float = param(
        0.0,
        "systematic relative error of the odometry: 0.01 reports 1.01 m for every meter, as worn wheels do",
        ge=-ODOMETRY_LIMIT,
        le=ODOMETRY_LIMIT,
    )
    odometry_turn: float = param(
        0.0,
        "systematic error of the odometry: heading error to the left per meter, as with unequal wheels",
        unit="rad/m",
        ge=-ODOMETRY_LIMIT,
        le=ODOMETRY_LIMIT,
    )
    odometry: Literal["wheels", "ekf"] = param(
        "wheels", "wheels: the wheels alone; ekf: wheels and the first IMU through the filter of the section `ekf`"
    )
    localization: Literal["truth", "odometry", "amcl", "scan_matching"] = param(
        "truth",
        "truth: map -> odom corrects the drift of the odometry, as fake_localization does, with the errors below; odometry: "
        "map -> odom is constant; amcl: the particle filter of the section `amcl`; scan_matching: scans matched with the map",
    )
    initial_pose: Literal["given", "unknown"] = param(
        "given", "given: the localizer starts at the start pose; unknown: it must find out (amcl, scan_matching)"
    )
    initial_pose_error: list[float] = param(
        [0.0, 0.0, 0.0], "error of that pose: ahead, to the left, turn", unit="m, m, rad"
    )
    localization_noise: float = param(
        0.0, "standard deviation of the localized x and y, drawn at each update", unit="m", ge=0.0
    )
    localization_yaw_noise: float = param(
        0.0, "standard deviation of the localized yaw, drawn at each update", unit="rad", ge=0.0
    )
    localization_delay: float = param(
        0.0, "delay from a pose to the map -> odom transform computed from it", unit="s", ge=0.0
    )
    localization_frequency: float | None = param(
        None, "frequency of map -> odom updates; none: at every physics step", unit="Hz", gt=0.0
    )
    delta_x: float = param(0.0, "x of the localization map in the simulator's map, as in fake_localization", unit="m")
    delta_y: float = param(0.0, "y of the localization map in the simulator's map", unit="m")
    delta_yaw: float = param(0.0, "yaw of the localization map in the simulator's map", unit="rad")
    wheels: WheelParams = param(WheelParams(), "the wheels of the base, their encoders and limits")
    map_to_odom: list[float] = param([0.0, 0.0, 0.0], "initial pose [x, y, yaw] of the odometry frame in the map")
    lasers: list[str] = param(["laser"], "names of the lidars; the parameters of each are in the namespace of its name")
    bumpers: list[str] = param(["bumper"], "names of the bumpers")
    sonars: list[str] = param([], "names of the sonars")
    imus: list[str] = param([], "names of the inertial measurement units")
    cameras: list[str] = param(["camera"], "names of the cameras, which take pictures only when they are asked")
    docks: list[str] = param([], "names of the docks of the world")
    dock_camera: DockCameraParams = param(DockCameraParams(), "what sees the markers of the docks")
    battery: BatteryParams = param(BatteryParams(), "the battery, which docks charge")
    sensors: dict[str, LidarParams | BumperParams | SonarParams | ImuParams | CameraParams | SimDockParams] = param(
        {}, "parameters of each sensor and of each dock, by name"
    )

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the model of every sensor: `LidarParams` for the names in `lasers`, `BumperParams` for `bumpers`, and so on."""
        models: dict[str, type[ParamModel]] = {}
        for key, model in (
            ("docks", SimDockParams),
            ("cameras", CameraParams),
            ("imus", ImuParams),
            ("sonars", SonarParams),
            ("bumpers", BumperParams),
            ("lasers", LidarParams),
        ):
            names = values.get(key, cls.model_fields[key].default)
            if isinstance(names, list):
                models |= {name: model for name in names if isinstance(name, str)}
        return models

    @field_validator("map_to_odom", "initial_pose_error")
    @classmethod
    def _check_pose(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError(f"{value} is not a pose; write [x, y, yaw] (m, m, rad)")
        return value

    @field_validator("lasers", "bumpers", "sonars", "imus", "cameras", "docks")
    @classmethod
    def _check_unique(cls, value: list[str]) -> list[str]:
        twice = sorted({name for name in value if value.count(name) > 1})
        if twice:
            raise ValueError(f"the name {', '.join(twice)} is used twice; give each one a unique name")
        return value

    @model_validator(mode="after")
    def _check_one_kind_each(self) -> Self:
        kinds = {"a lidar": self.lasers, "a bumper": self.bumpers, "a sonar": self.sonars, "an IMU": self.imus}
        kinds["a dock"] = self.docks
        if "cameras" in self.model_fields_set:  # else a lidar may have the name of the camera that nobody asked for
            kinds["a camera"] = self.cameras
        for number, (kind, names) in enumerate(kinds.items()):
            for other, others in list(kinds.items())[number + 1 :]:
                both = [name for name in names if name in others]
                if both:
                    raise ValueError(
                        f"{', '.join(both)} is the name of {kind} and of {other}; give each one a unique name"
                    )
        return self

    @model_validator(mode="after")
    def _check_cameras(self) -> Self:
        cameras = [self.camera(name) for name in self.cameras]
        for key in ("topic", "frame"):
            values = [str(getattr(camera, key)) for camera in cameras]
            twice = sorted({value for value in values if values.count(value) > 1})
            if twice:
                raise ValueError(f"two cameras have the {key} {twice[0]}; give each camera its own {key}")
        return self

    @model_validator(mode="after")
    def _check_wheels(self) -> Self:
        needed = {"none": self.kinematics, "differential": "differential"}.get(self.wheels.drive, "holonomic")
        if self.kinematics != needed:
            raise ValueError(
                f"wheels: drive: {self.wheels.drive} moves a {needed} base, but kinematics is {self.kinematics}; set "
                f"kinematics to {needed}"
            )
        if self.wheels.count and len(self.wheels.radius_errors) not in (0, self.wheels.count):
            raise ValueError(
                f"wheels: radius_errors lists {len(self.wheels.radius_errors)} errors for {self.wheels.count} wheels"
            )
        return self

    @property
    def lidars(self) -> dict[str, LidarParams]:
        """Parameters of the lidars that have a namespace, by name."""
        return {name: p for name, p in self.sensors.items() if isinstance(p, LidarParams)}

    @property
    def written_frames(self) -> frozenset[str]:
        """Frames of the sensors that have a namespace."""
        return frozenset(p.frame for p in self.sensors.values() if not isinstance(p, SimDockParams))

    @property
    def scan_heights(self) -> dict[str, float]:
        """Height (m) of the frame of each lidar that publishes scans; the points of clouds are above the ground themselves."""
        lidars = [self.lidar(name) for name in self.lasers]
        return {lidar.frame: lidar.height for lidar in lidars if lidar.message == "LaserScan"}

    def _sensor(self, name: str, kind: type[S]) -> S:
        found = self.sensors.get(name)
        return found if isinstance(found, kind) else kind()

    def lidar(self, name: str) -> LidarParams:
        """Return the parameters of a lidar; the defaults if it has no namespace."""
        return self._sensor(name, LidarParams)

    def bumper(self, name: str) -> BumperParams:
        """Return the parameters of a bumper; the defaults if it has no namespace."""
        return self._sensor(name, BumperParams)

    def sonar(self, name: str) -> SonarParams:
        """Return the parameters of a sonar; the defaults if it has no namespace."""
        return self._sensor(name, SonarParams)

    def imu(self, name: str) -> ImuParams:
        """Return the parameters of an IMU; the defaults if it has no namespace."""
        return self._sensor(name, ImuParams)

    def camera(self, name: str) -> CameraParams:
        """Return the parameters of a camera; the defaults if it has no namespace."""
        return self._sensor(name, CameraParams)

    def dock(self, name: str) -> SimDockParams:
        """Return the parameters of a dock; the defaults if it has no namespace."""
        return self._sensor(name, SimDockParams)
