"""Parameters of the simulator: the `navstack: sim:` section of the YAML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import field_validator, model_validator

from navstack.core.parameters import ParamModel, param

ODOMETRY_LIMIT = 1.0


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

    @model_validator(mode="after")
    def _some_range(self) -> LidarParams:
        if self.range_min >= self.range_max:
            raise ValueError(
                f"range_min = {self.range_min:g} leaves nothing to measure below range_max = {self.range_max:g}; "
                "give a range_min under range_max"
            )
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


class SimParams(ParamModel):
    """The simulated robot and its sensors.

    The defaults are those of the simulator that the C++ stack was measured in: the base follows every command at once, at
    50 Hz, with one forward-looking lidar, true odometry, and odom equal to map.
    """

    CHILD_FIELD: ClassVar[str | None] = "sensors"

    kinematics: Literal["differential", "holonomic"] = param(
        "differential", "differential: never moves sideways; holonomic: in every direction"
    )
    physics_frequency: float = param(50.0, "steps of the body per second", unit="Hz", gt=0.0, le=10_000.0)
    acc_lim_x: float | None = param(
        None, "greatest change of the forward velocity; none: follows the command at once", unit="m/s²", gt=0.0
    )
    acc_lim_y: float | None = param(None, "the same, sideways", unit="m/s²", gt=0.0)
    acc_lim_theta: float | None = param(None, "the same, turning", unit="rad/s²", gt=0.0)
    command_timeout: float | None = param(
        None, "a command older than this stops the base; none: it is driven until the next", unit="s", gt=0.0
    )
    command_delay: float = param(0.0, "dead time between a command and the base", unit="s", ge=0.0)
    velocity_lag: float = param(0.0, "time constant of the base's velocity controller", unit="s", ge=0.0)
    wheel_slip: float = param(
        0.0,
        "standard deviation of the true motion against that of the wheels, relative, over a metre or a radian",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    odometry_noise: float = param(
        0.0,
        "standard deviation of the odometry against the true motion, relative, over a metre or a radian",
        ge=0.0,
        le=ODOMETRY_LIMIT,
    )
    localization: Literal["truth", "odometry"] = param(
        "truth",
        "truth: map -> odom makes up for the drift of the odometry, as fake_localization does; odometry: it stays as it was",
    )
    map_to_odom: list[float] = param([0.0, 0.0, 0.0], "pose [x, y, yaw] of the odometry frame in the map at the start")
    lasers: list[str] = param(["laser"], "names of the lidars; each has its parameters in a namespace of that name")
    bumpers: list[str] = param(["bumper"], "names of the bumpers, likewise")
    sensors: dict[str, LidarParams | BumperParams] = param({}, "the parameters of each lidar and bumper, by name")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """A `LidarParams` for every name in `lasers`, a `BumperParams` for every one in `bumpers`."""
        models: dict[str, type[ParamModel]] = {}
        for key, default, model in (("bumpers", "bumper", BumperParams), ("lasers", "laser", LidarParams)):
            names = values.get(key, [default])
            if isinstance(names, list):
                models |= {name: model for name in names if isinstance(name, str)}
        return models

    @field_validator("map_to_odom")
    @classmethod
    def _three_numbers(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError(f"map_to_odom is [x, y, yaw] in m, m, rad, not {value}")
        return value

    @field_validator("lasers", "bumpers")
    @classmethod
    def _named_once(cls, value: list[str]) -> list[str]:
        twice = sorted({name for name in value if value.count(name) > 1})
        if twice:
            raise ValueError(f"each sensor needs a name of its own; named twice: {', '.join(twice)}")
        return value

    @model_validator(mode="after")
    def _one_kind_each(self) -> SimParams:
        both = [name for name in self.lasers if name in self.bumpers]
        if both:
            raise ValueError(f"{', '.join(both)} cannot be both a lidar and a bumper; give one of them another name")
        return self

    @property
    def lidars(self) -> dict[str, LidarParams]:
        """The parameters of those lidars that have a namespace, by name."""
        return {name: p for name, p in self.sensors.items() if isinstance(p, LidarParams)}

    def lidar(self, name: str) -> LidarParams:
        """The parameters of one lidar; the defaults where it has no namespace."""
        found = self.sensors.get(name)
        return found if isinstance(found, LidarParams) else LidarParams()

    def bumper(self, name: str) -> BumperParams:
        """The parameters of one bumper; the defaults where it has no namespace."""
        found = self.sensors.get(name)
        return found if isinstance(found, BumperParams) else BumperParams()
