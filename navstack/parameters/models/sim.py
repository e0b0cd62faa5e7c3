"""Parameters of the simulator: the `navstack: sim:` section of the YAML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, TypeVar

from pydantic import field_validator, model_validator

from navstack.core.parameters import ParamModel, param

S = TypeVar("S", bound=ParamModel)

ODOMETRY_LIMIT = 1.0
"""No error of the odometry or the wheels is greater than this share of the motion (rad/m: of the turning)."""


def _some_range(range_min: float, range_max: float) -> None:
    if range_min >= range_max:
        raise ValueError(
            f"range_min = {range_min:g} leaves nothing to measure below range_max = {range_max:g}; "
            "give a range_min under range_max"
        )


class LidarParams(ParamModel):
    """A planar range finder. The defaults are the turtlebot's depth camera seen as a laser."""

    topic: str = param("scan", "topic of its scans, as named by an observation source")
    frame: str = param("base_laser_link", "frame of its scans; a child of the base frame")
    x: float = param(0.1, "mounting position ahead of the robot's centre", unit="m")
    y: float = param(0.0, "mounting position to the left of the robot's centre", unit="m")
    yaw: float = param(0.0, "mounting direction of the middle beam", unit="rad")
    height: float = param(0.3, "height above the ground", unit="m", ge=0.0)
    beams: int = param(640, "rays per scan", ge=1, le=100_000)
    fov: float = param(
        1.0,
        "angle from the first beam to the last; a full circle (2 pi) is divided by the number of beams, so that no "
        "direction is measured twice",
        unit="rad",
        gt=0.0,
        le=6.283185307179587,
    )
    range_min: float = param(0.45, "nearer hits are reported as -inf (REP 117)", unit="m", ge=0.0)
    range_max: float = param(6.0, "beams without a hit up to here are reported as +inf", unit="m", gt=0.0)
    frequency: float = param(10.0, "scans per second", unit="Hz", gt=0.0)
    range_noise: float = param(0.0, "standard deviation of the ranges", unit="m", ge=0.0)
    dropout: float = param(0.0, "share of beams lost in each scan, reported as NaN", ge=0.0, le=1.0)
    no_return: Literal["inf", "max"] = param(
        "inf", "what a beam without a hit reports: inf: +inf (REP 117); max: range_max itself, as older drivers do"
    )

    @model_validator(mode="after")
    def _reaches_somewhere(self) -> LidarParams:
        _some_range(self.range_min, self.range_max)
        return self

    @property
    def angle_increment(self) -> float:
        """Angle between two neighbouring beams, rad."""
        if self.beams == 1:
            return self.fov
        full_circle = self.fov > 2.0 * math.pi - 1e-6
        return self.fov / (self.beams if full_circle else self.beams - 1)

    @property
    def angle_min(self) -> float:
        """Direction of the first beam in the lidar's frame, rad."""
        return -0.5 * self.angle_increment * (self.beams - 1)


class BumperParams(ParamModel):
    """Contact sensors around the body, as points where they are pressed. The defaults are the Kobuki's.

    Its zones are those of its simulator (kobuki_gazebo): left, centre, right, none behind. kobuki_bumper2pc puts a point
    in front of each pressed zone, at 0.25 m for a body of 0.1755 m, so that the cell it marks is not freed with the
    footprint, and a last cloud without near points tells the release.
    """

    topic: str = param(
        "mobile_base/sensors/bumper_pointcloud", "topic of its clouds, as named by an observation source"
    )
    frame: str = param("bumper_link", "frame of its points, at the robot's centre; a child of the base frame")
    zones: list[list[float]] = param(
        [[0.5236, 1.5708], [-0.5236, 0.5236], [-1.5708, -0.5236]],
        "[from, to] of each sector that feels, counterclockwise from straight ahead",
        unit="rad",
    )
    height: float = param(0.04, "height of the points above the ground", unit="m", ge=0.0)
    distance: float = param(
        0.075,
        "how far off the outline the points lie; less than the footprint's padding and a cell, and the mark is freed with "
        "the robot's own cells",
        unit="m",
        ge=0.0,
    )
    point: Literal["contact", "zone"] = param(
        "contact", "contact: the point lies where the zone is touched; zone: in its middle, which is all a Kobuki knows"
    )
    frequency: float = param(50.0, "clouds per second while it is pressed; none otherwise", unit="Hz", gt=0.0)

    @field_validator("zones")
    @classmethod
    def _sectors(cls, value: list[list[float]]) -> list[list[float]]:
        for zone in value:
            if len(zone) != 2 or not 0.0 < zone[1] - zone[0] <= 2.0 * math.pi + 1e-6:
                raise ValueError(f"a zone is [from, to] in rad with from below to, a full circle at most, not {zone}")
        return value


class SonarParams(ParamModel):
    """A sonar or infrared sensor: the nearest thing in a cone, as one distance, for the range sensor layer."""

    topic: str = param("sonar", "topic of its readings, as named by the range sensor layer")
    frame: str = param("sonar_link", "frame of its readings; a child of the base frame, of its own for every sonar")
    x: float = param(0.1, "mounting position ahead of the robot's centre", unit="m")
    y: float = param(0.0, "mounting position to the left of the robot's centre", unit="m")
    yaw: float = param(0.0, "mounting direction of the cone's axis", unit="rad")
    height: float = param(0.2, "height above the ground", unit="m", ge=0.0)
    fov: float = param(0.5, "opening angle of the cone", unit="rad", gt=0.0, le=3.14159)
    beams: int = param(31, "rays whose nearest hit is the reading", ge=1, le=10_000)
    range_min: float = param(0.02, "nearer things are reported at this distance", unit="m", ge=0.0)
    range_max: float = param(3.0, "reach", unit="m", gt=0.0)
    frequency: float = param(10.0, "readings per second", unit="Hz", gt=0.0)
    range_noise: float = param(0.0, "standard deviation of the readings", unit="m", ge=0.0)
    dropout: float = param(0.0, "share of readings that miss what is there", ge=0.0, le=1.0)
    no_return: Literal["inf", "max"] = param(
        "max", "what is reported when nothing is in reach: max: range_max, as sonars do; inf: +inf (REP 117)"
    )

    @model_validator(mode="after")
    def _reaches_somewhere(self) -> SonarParams:
        _some_range(self.range_min, self.range_max)
        return self


class ImuParams(ParamModel):
    """An inertial measurement unit of a planar robot: orientation as a quaternion, and the rate of turning."""

    topic: str = param("imu", "topic of its readings")
    frame: str = param("imu_link", "frame of its readings; a child of the base frame")
    x: float = param(0.0, "mounting position ahead of the robot's centre", unit="m")
    y: float = param(0.0, "mounting position to the left of the robot's centre", unit="m")
    yaw: float = param(0.0, "mounting direction", unit="rad")
    frequency: float = param(50.0, "readings per second, one per physics step at most", unit="Hz", gt=0.0)
    orientation_noise: float = param(0.0, "standard deviation of the yaw, reading by reading", unit="rad", ge=0.0)
    yaw_rate_noise: float = param(0.0, "standard deviation of the rate, reading by reading", unit="rad/s", ge=0.0)
    yaw_rate_bias: float = param(
        0.0, "constant error of the rate; the yaw, which is its sum, drifts with it", unit="rad/s"
    )
    yaw_rate_drift: float = param(
        0.0, "how far the bias wanders (a random walk): standard deviation after one second", unit="rad/s", ge=0.0
    )


class SimParams(ParamModel):
    """The simulated robot and its sensors.

    The defaults are those of the simulator that the C++ stack was measured in: the base follows every command at once, at
    50 Hz, with one forward-looking lidar, true odometry, and odom equal to map.
    """

    CHILD_FIELD: ClassVar[str | None] = "sensors"

    kinematics: Literal["differential", "holonomic", "ackermann"] = param(
        "differential",
        "differential: never moves sideways; holonomic: in every direction; ackermann: a car, whose centre is that of its "
        "rear axle: a command's turning rate becomes a steering angle, and it cannot turn where it stands",
    )
    physics_frequency: float = param(50.0, "steps of the body per second", unit="Hz", gt=0.0, le=10_000.0)
    acc_lim_x: float | None = param(
        None, "greatest change of the forward velocity; none: follows the command at once", unit="m/s²", gt=0.0
    )
    acc_lim_y: float | None = param(None, "the same, sideways", unit="m/s²", gt=0.0)
    acc_lim_theta: float | None = param(None, "the same, turning", unit="rad/s²", gt=0.0)
    jerk_lim_x: float | None = param(
        None,
        "greatest change of the forward acceleration; none: it changes at once. Keeps to it where the command allows, and "
        "never overshoots one that stands still",
        unit="m/s³",
        gt=0.0,
    )
    jerk_lim_y: float | None = param(None, "the same, sideways", unit="m/s³", gt=0.0)
    jerk_lim_theta: float | None = param(None, "the same, turning; ackermann has none", unit="rad/s³", gt=0.0)
    wheelbase: float = param(0.5, "ackermann: from the rear axle to the front one", unit="m", gt=0.0)
    max_steering_angle: float = param(
        0.6, "ackermann: of the (middle) front wheel, to either side", unit="rad", gt=0.0, lt=1.5707963267948966
    )
    max_steering_rate: float | None = param(
        None, "ackermann: greatest change of the steering angle; none: it turns at once", unit="rad/s", gt=0.0
    )
    min_turning_radius: float = param(
        0.0,
        "ackermann: of the rear axle's centre, where the steering angle alone would allow a smaller one "
        "(wheelbase / tan(max_steering_angle))",
        unit="m",
        ge=0.0,
    )
    steering_command: Literal["yaw_rate", "angle"] = param(
        "yaw_rate",
        "ackermann: what the angular part of a command means. yaw_rate: the turning rate, from which follows the angle "
        "atan(wheelbase * w / v); a car that stands keeps its wheels as they are. angle: the steering angle itself",
    )
    command_timeout: float | None = param(
        None, "a command older than this stops the base; none: it is driven until the next", unit="s", gt=0.0
    )
    command_delay: float = param(0.0, "dead time between a command and the base", unit="s", ge=0.0)
    velocity_lag: float = param(0.0, "time constant of the base's velocity controller", unit="s", ge=0.0)
    wheel_slip: float = param(
        0.0,
        "standard deviation of the true motion against that of the wheels, relative, over a second of driving",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    odometry_noise: float = param(
        0.0,
        "standard deviation of the odometry against that of the wheels, relative, over a second of driving",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    wheel_slip_turn: float = param(
        0.0,
        "standard deviation of the heading that slip adds over a metre of driving, straight ahead too; over n metres √n "
        "times as much",
        unit="rad/√m",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    odometry_noise_turn: float = param(
        0.0,
        "the same of the odometry's heading against that of the wheels",
        unit="rad/√m",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    odometry_scale: float = param(
        0.0,
        "systematic error of the odometry, relative: 0.01 says 1.01 m for every metre, as worn wheels do",
        ge=-ODOMETRY_LIMIT,
        le=ODOMETRY_LIMIT,
    )
    odometry_turn: float = param(
        0.0,
        "systematic error of the odometry: turns so much too far to the left for every metre ahead, as unequal wheels do",
        unit="rad/m",
        ge=-ODOMETRY_LIMIT,
        le=ODOMETRY_LIMIT,
    )
    localization: Literal["truth", "odometry"] = param(
        "truth",
        "truth: map -> odom makes up for the drift of the odometry, as fake_localization does, with the errors below; "
        "odometry: it stays as it was",
    )
    localization_noise: float = param(
        0.0, "standard deviation of the localized position in x and in y, drawn at each update", unit="m", ge=0.0
    )
    localization_yaw_noise: float = param(
        0.0, "standard deviation of the localized yaw, drawn at each update", unit="rad", ge=0.0
    )
    localization_delay: float = param(
        0.0, "from the moment a pose is true to the one map -> odom follows from it", unit="s", ge=0.0
    )
    localization_frequency: float | None = param(
        None, "updates of map -> odom per second; none: at every physics step", unit="Hz", gt=0.0
    )
    delta_x: float = param(
        0.0, "x of the localization's map in that of the simulator, as fake_localization has it", unit="m"
    )
    delta_y: float = param(0.0, "y, likewise", unit="m")
    delta_yaw: float = param(0.0, "yaw, likewise", unit="rad")
    map_to_odom: list[float] = param([0.0, 0.0, 0.0], "pose [x, y, yaw] of the odometry frame in the map at the start")
    lasers: list[str] = param(["laser"], "names of the lidars; each has its parameters in a namespace of that name")
    bumpers: list[str] = param(["bumper"], "names of the bumpers, likewise")
    sonars: list[str] = param([], "names of the sonars, likewise")
    imus: list[str] = param([], "names of the inertial measurement units, likewise")
    sensors: dict[str, LidarParams | BumperParams | SonarParams | ImuParams] = param(
        {}, "the parameters of each sensor, by name"
    )

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """A `LidarParams` for every name in `lasers`, a `BumperParams` for every one in `bumpers`, and so on."""
        models: dict[str, type[ParamModel]] = {}
        for key, model in (
            ("imus", ImuParams),
            ("sonars", SonarParams),
            ("bumpers", BumperParams),
            ("lasers", LidarParams),
        ):
            names = values.get(key, cls.model_fields[key].default)
            if isinstance(names, list):
                models |= {name: model for name in names if isinstance(name, str)}
        return models

    @field_validator("map_to_odom")
    @classmethod
    def _three_numbers(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError(f"map_to_odom is [x, y, yaw] in m, m, rad, not {value}")
        return value

    @field_validator("lasers", "bumpers", "sonars", "imus")
    @classmethod
    def _named_once(cls, value: list[str]) -> list[str]:
        twice = sorted({name for name in value if value.count(name) > 1})
        if twice:
            raise ValueError(f"each sensor needs a name of its own; named twice: {', '.join(twice)}")
        return value

    @model_validator(mode="after")
    def _one_kind_each(self) -> SimParams:
        kinds = {"a lidar": self.lasers, "a bumper": self.bumpers, "a sonar": self.sonars, "an IMU": self.imus}
        for number, (kind, names) in enumerate(kinds.items()):
            for other, others in list(kinds.items())[number + 1 :]:
                both = [name for name in names if name in others]
                if both:
                    raise ValueError(
                        f"{', '.join(both)} cannot be both {kind} and {other}; give one of them another name"
                    )
        return self

    @property
    def steering_limit(self) -> float:
        """Greatest steering angle of a car (rad), from `max_steering_angle` and `min_turning_radius`."""
        if self.min_turning_radius <= 0.0:
            return self.max_steering_angle
        return min(self.max_steering_angle, math.atan(self.wheelbase / self.min_turning_radius))

    @property
    def turning_radius(self) -> float:
        """Smallest circle of a car's rear axle (m); 0 for a base that turns where it stands."""
        return self.wheelbase / math.tan(self.steering_limit) if self.kinematics == "ackermann" else 0.0

    @property
    def lidars(self) -> dict[str, LidarParams]:
        """The parameters of those lidars that have a namespace, by name."""
        return {name: p for name, p in self.sensors.items() if isinstance(p, LidarParams)}

    def _sensor(self, name: str, kind: type[S]) -> S:
        found = self.sensors.get(name)
        return found if isinstance(found, kind) else kind()

    def lidar(self, name: str) -> LidarParams:
        """The parameters of one lidar; the defaults where it has no namespace."""
        return self._sensor(name, LidarParams)

    def bumper(self, name: str) -> BumperParams:
        """The parameters of one bumper; the defaults where it has no namespace."""
        return self._sensor(name, BumperParams)

    def sonar(self, name: str) -> SonarParams:
        """The parameters of one sonar; the defaults where it has no namespace."""
        return self._sensor(name, SonarParams)

    def imu(self, name: str) -> ImuParams:
        """The parameters of one IMU; the defaults where it has no namespace."""
        return self._sensor(name, ImuParams)
