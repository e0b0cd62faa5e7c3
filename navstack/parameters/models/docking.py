"""The parameters of docking (Nav2: opennav_docking's docking_server); those of dock types stand beside the types."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

from pydantic import create_model, field_validator, model_validator

from navstack.parameters.sections import section_model
from navstack.plugins import DOCK_TYPES, ParamModel, param

DEFAULT_DOCK_TYPE = "simple_charging_dock"

# a keyword of Python cannot be declared as a field of a class
_FIELDS: dict[str, Any] = {"lambda": (float, param(2.0, "exponent of the curvature in the fall of the speed", gt=0.0))}
_WithLambda: type[ParamModel] = create_model("_WithLambda", __base__=ParamModel, **_FIELDS)


class DockControllerParams(_WithLambda):
    """The control law of the approach, that of the graceful controller."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "costmap_topic": "the local costmap is used",
        "footprint_topic": "the footprint of the local costmap is used",
        "transform_tolerance": "that of the costmaps counts",
    }

    k_phi: float = param(3.0, "how fast the heading turns to the dock's, compared with the approach", gt=0.0)
    k_delta: float = param(2.0, "how fast the robot turns onto the curve", gt=0.0)
    beta: float = param(0.4, "how much the speed falls with the curvature", ge=0.0)
    v_linear_min: float = param(0.1, "lowest speed", unit="m/s", gt=0.0)
    v_linear_max: float = param(0.25, "highest speed", unit="m/s", gt=0.0)
    v_angular_max: float = param(0.75, "highest turning speed", unit="rad/s", gt=0.0)
    slowdown_radius: float = param(0.25, "distance to the target below which the speed falls", unit="m", gt=0.0)
    deceleration_max: float = param(2.5, "deceleration with which the robot can stop", unit="m/s²", gt=0.0)
    use_collision_detection: bool = param(True, "check the way ahead on the local costmap")
    projection_time: float = param(5.0, "time ahead to check for collisions", unit="s", gt=0.0)
    simulation_time_step: float = param(0.1, "time between two checks", unit="s", gt=0.0)
    dock_collision_threshold: float = param(
        0.3,
        "distance to the dock below which collisions are not checked: the dock itself is an obstacle",
        unit="m",
        ge=0.0,
    )
    rotate_to_heading_angular_vel: float = param(1.0, "turning speed in place", unit="rad/s", gt=0.0)
    rotate_to_heading_max_angular_accel: float = param(
        3.2, "angular acceleration of turns in place", unit="rad/s²", gt=0.0
    )

    @model_validator(mode="after")
    def _check_speeds(self) -> Self:
        if self.v_linear_min > self.v_linear_max:
            raise ValueError(
                f"v_linear_min = {self.v_linear_min:g} is greater than v_linear_max = {self.v_linear_max:g}; lower it"
            )
        return self


class DockInstanceParams(ParamModel):
    """One dock: where it is."""

    type: str = param("", "name of its type, one of `dock_plugins`; none: the only one")
    frame: str = param("map", "frame of the pose")
    pose: list[float] = param(
        ..., "[x, y, yaw] of the base of a docked robot; the x axis points into the dock", unit="m, m, rad"
    )
    id: str = param("", "identifier of its marker")

    @field_validator("pose")
    @classmethod
    def _check_pose(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError(f"pose = {value} is not a pose; write [x, y, yaw] (m, m, rad)")
        return value


class DockingParams(ParamModel):
    """Namespace `docking_server`: drives the robot into docks and out of them."""

    CHILD_FIELD: ClassVar[str | None] = "sections"
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "odom_topic": "the robot's odometry is used",
        "odom_duration": "the robot's odometry is used",
        "navigator_bt_xml": "the goal manager drives to the staging pose",
        "enable_stamped_cmd_vel": "of ROS messages",
        "action_server_result_timeout": "of ROS actions",
        "dock_backwards": "write dock_direction: backward in the type of the dock",
    }

    controller_frequency: float = param(50.0, "rate of the commands", unit="Hz", ge=1.0, le=1000.0)
    initial_perception_timeout: float = param(5.0, "time in which the dock must be detected", unit="s", gt=0.0)
    wait_charge_timeout: float = param(5.0, "time in which charging must begin", unit="s", gt=0.0)
    dock_approach_timeout: float = param(30.0, "time limit of one approach, and of one way back", unit="s", gt=0.0)
    rotate_to_dock_timeout: float = param(10.0, "time limit of a turn before the dock", unit="s", gt=0.0)
    undock_linear_tolerance: float = param(
        0.05, "distance from the staging pose that counts as undocked", unit="m", gt=0.0
    )
    undock_angular_tolerance: float = param(
        0.05, "angle from the heading of the staging pose that counts as undocked", unit="rad", gt=0.0
    )
    rotation_angular_tolerance: float = param(0.05, "angle at which a turn before the dock ends", unit="rad", gt=0.0)
    max_retries: int = param(3, "how often a failed approach is repeated", ge=0)
    base_frame: str = param("base_link", "frame of the base; that of the local costmap is used")
    fixed_frame: str = param("odom", "frame in which the robot approaches the dock: that of one of the costmaps")
    dock_prestaging_tolerance: float = param(
        0.5, "distance from the staging pose within which the robot does not drive there first", unit="m", ge=0.0
    )
    dock_plugins: list[str] = param(
        [DEFAULT_DOCK_TYPE], "names of the types of docks; the parameters of each are in the namespace of its name"
    )
    docks: list[str] = param([], "names of docks; the pose of each is in the namespace of its name")
    dock_database: str = param("", "file of docks, relative to the file of this parameter; instead of `docks`")
    controller: DockControllerParams = param(DockControllerParams(), "the control law")
    sections: dict[str, Any] = param({}, "parameters of the types and poses of the docks, by name")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the models of the types of docks, by their plugins, and of the docks."""
        models: dict[str, type[ParamModel]] = {}
        for name in _names(values, "dock_plugins", [DEFAULT_DOCK_TYPE]):
            models[name] = section_model(DOCK_TYPES, values, name, DEFAULT_DOCK_TYPE)
        for name in _names(values, "docks", []):
            models[name] = DockInstanceParams
        return models

    @field_validator("dock_plugins")
    @classmethod
    def _check_types(cls, value: list[str]) -> list[str]:
        if not value:
            raise ValueError("dock_plugins is empty; name at least one type of dock")
        return value

    @property
    def dock_types(self) -> dict[str, ParamModel]:
        """Parameters of the types of docks, by name."""
        return {
            name: self.sections.get(name) or DOCK_TYPES.get(DEFAULT_DOCK_TYPE).cls.Params()
            for name in self.dock_plugins
        }


def _names(values: Mapping[str, Any], key: str, default: list[str]) -> list[str]:
    names = values.get(key, default)
    return [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
