"""The parameters of the collision monitor and the collision detector (Nav2: nav2_collision_monitor)."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal

import shapely
from pydantic import field_validator, model_validator

from navstack.parameters.models.velocity_smoother import ROS2_NO_EFFECT
from navstack.plugins import ParamModel, param

MIN_VERTICES: Final = 4
"""Fewest corners of a zone's polygon, as in Nav2."""

Points = str | list[float] | list[list[float]]
"""A polygon: the text "[[x, y], ..]", its numbers in a row, or a list of points."""


def parse_points(name: str, value: Points | None, least: int = MIN_VERTICES) -> tuple[tuple[float, float], ...]:
    """Return the corners (m) of a polygon as it is written, empty for none. Raises ValueError."""
    if value is None or value in ("", [], "[]"):
        return ()
    written: Any = value
    if isinstance(value, str):
        try:
            written = ast.literal_eval(value.strip())
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            written = None
    if isinstance(written, (list, tuple)) and written and all(_is_number(v) for v in written):
        pairs: list[Any] = [written[i : i + 2] for i in range(0, len(written), 2)]
    else:
        pairs = list(written) if isinstance(written, (list, tuple)) else []
    good = pairs and all(isinstance(p, (list, tuple)) and len(p) == 2 and all(map(_is_number, p)) for p in pairs)
    if not good:
        shown = repr(value)
        shown = shown if len(shown) <= 60 else shown[:59] + "…"
        raise ValueError(f'{name} = {shown} is not a polygon; write "[[x, y], [x, y], ..]" in meters')
    corners = tuple((float(x), float(y)) for x, y in pairs)
    if len(corners) < least:
        raise ValueError(f"{name} has {len(corners)} corners; give at least {least}")
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid or polygon.area <= 0.0:
        raise ValueError(f"the polygon of {name} crosses itself or has no area; list its corners in order")
    return corners


def _is_number(value: Any) -> bool:
    # not isfinite: an integer of any length is finite, but may be too large for a float
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= 1e15


def _names(values: Mapping[str, Any], key: str) -> list[str]:
    """The names that a list in the raw values holds."""
    listed = values.get(key)
    return [name for name in listed if isinstance(name, str) and name] if isinstance(listed, list) else []


def _check_unique(key: str, names: list[str]) -> list[str]:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{key} lists {', '.join(twice)} twice; list each name once")
    return names


class SubPolygonParams(ParamModel):
    """A polygon of a zone of type `velocity_polygon`, valid in a range of velocities."""

    points: Points = param("", "the polygon in the base frame, at least 4 corners", unit="m")
    linear_min: float = param(0.0, "lowest forward velocity; of a holonomic robot the lowest speed", unit="m/s")
    linear_max: float = param(0.0, "highest forward velocity; of a holonomic robot the highest speed", unit="m/s")
    theta_min: float = param(0.0, "lowest angular velocity", unit="rad/s")
    theta_max: float = param(0.0, "highest angular velocity", unit="rad/s")
    direction_start_angle: float = param(-math.pi, "holonomic robots: first direction of motion", unit="rad")
    direction_end_angle: float = param(math.pi, "holonomic robots: last direction of motion", unit="rad")

    @model_validator(mode="after")
    def _check(self) -> SubPolygonParams:
        if not self.corners:
            raise ValueError('points is missing; write "[[x, y], [x, y], ..]" in meters')
        for low, high in (("linear_min", "linear_max"), ("theta_min", "theta_max")):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low} is above {high}, so the polygon is never used; swap them")
        return self

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The corners (m) in the base frame."""
        return parse_points("points", self.points)


class ZoneParams(ParamModel):
    """A zone around the robot: an entry of `polygons`, with its parameters in the namespace of its name."""

    CHILD_FIELD: ClassVar[str | None] = "sub_polygons"

    type: Literal["polygon", "circle", "velocity_polygon"] = param("polygon", "shape of the zone")
    action_type: Literal["stop", "slowdown", "limit", "approach", "none"] = param(
        "none", "what happens while obstacles are in the zone; none is for the collision detector"
    )
    points: Points | None = param(None, "the polygon in the base frame, at least 4 corners", unit="m")
    radius: float | None = param(None, "radius of a circle around the base frame", unit="m", gt=0.0)
    polygon_sub_topic: str = param("", "topic of a polygon or radius that changes at run time")
    polygon_subscribe_transient_local: bool = param(False, "quality of service of that topic in ROS")
    footprint_topic: str = param(
        "local_costmap/published_footprint",
        "approach without points: the robot's footprint; navstack takes the padded one of that costmap",
    )
    min_points: int | None = param(None, "number of points in the zone from which on it acts; if not set, 4", ge=1)
    max_points: int | None = param(None, "previous way to set min_points, which is one more", ge=0)
    trigger_consecutive_points: int = param(1, "checks in a row with obstacles after which the zone acts", ge=1)
    release_consecutive_points: int = param(1, "checks in a row without obstacles after which it no longer acts", ge=1)
    slowdown_ratio: float = param(0.5, "slowdown: factor of the velocity", gt=0.0, le=1.0)
    linear_limit: float = param(0.5, "limit: highest speed", unit="m/s", gt=0.0)
    angular_limit: float = param(0.5, "limit: highest angular velocity", unit="rad/s", gt=0.0)
    time_before_collision: float = param(2.0, "approach: time to a collision that is kept", unit="s", gt=0.0)
    simulation_time_step: float = param(
        0.1,
        "approach: step of the simulated motion",
        unit="s",
        gt=0.0,
        ros_differs="the first contact is computed exactly, so the step has no effect without nav2_compatible",
    )
    sources_names: list[str] | None = param(None, "sources whose points count; if not set, all")
    enabled: bool = param(True, "the zone is checked")
    visualize: bool = param(False, "publish the zone in ROS; navstack draws every zone")
    polygon_pub_topic: str = param("", "topic of the published zone in ROS")
    velocity_polygons: list[str] = param([], "velocity_polygon: names of the polygons, the first one that fits is used")
    holonomic: bool = param(False, "velocity_polygon: speed and direction count instead of the forward velocity")
    allow_moving_away: bool = param(
        True, "stop and approach let commands pass that bring no obstacle nearer; not a parameter of Nav2"
    )
    sub_polygons: dict[str, SubPolygonParams] = param({}, "the polygons of `velocity_polygons`, by name")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the model of every name in `velocity_polygons`."""
        return dict.fromkeys(_names(values, "velocity_polygons"), SubPolygonParams)

    @field_validator("points")
    @classmethod
    def _check_points(cls, value: Points | None) -> Points | None:
        parse_points("points", value)
        return value

    @field_validator("velocity_polygons")
    @classmethod
    def _check_names(cls, value: list[str]) -> list[str]:
        return _check_unique("velocity_polygons", value)

    @model_validator(mode="after")
    def _check_shape(self) -> ZoneParams:
        if self.type == "velocity_polygon":
            if not self.velocity_polygons:
                raise ValueError("a velocity_polygon needs velocity_polygons, the names of its polygons; list them")
        elif self.type == "circle":
            if self.radius is None and not self.polygon_sub_topic:
                raise ValueError("a circle needs a radius or a polygon_sub_topic; set radius (m)")
        elif not self.corners and not self.polygon_sub_topic and self.action_type != "approach":
            raise ValueError('a polygon needs points or a polygon_sub_topic; write points: "[[x, y], [x, y], ..]" (m)')
        return self

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The corners (m) in the base frame, empty if the polygon comes from elsewhere."""
        return parse_points("points", self.points)

    @property
    def least_points(self) -> int:
        """Number of points in the zone from which on it acts."""
        if self.min_points is not None:
            return self.min_points
        return 4 if self.max_points is None else self.max_points + 1

    @property
    def takes_footprint(self) -> bool:
        """True if the zone is the robot's footprint."""
        return (
            self.type == "polygon"
            and self.action_type == "approach"
            and not self.corners
            and not self.polygon_sub_topic
        )


class ExclusionZoneParams(ParamModel):
    """An area in which a source's points are ignored: an entry of `exclusion_zones`."""

    type: Literal["polygon", "circle"] = param("polygon", "shape of the area")
    points: Points | None = param(None, "the polygon, at least 3 corners", unit="m")
    radius: float | None = param(None, "radius of a circle around the origin of the frame", unit="m", gt=0.0)
    frame_id: str = param("", "frame of the area; if empty, the base frame")
    enabled: bool = param(False, "points are ignored")
    min_height: float | None = param(None, "points below are kept; if not set, none", unit="m")
    max_height: float | None = param(None, "points above are kept; if not set, none", unit="m")
    frame_hold_timeout: float = param(0.0, "largest age of the frame", unit="s", ge=0.0)
    visualize: bool = param(False, "publish the area in ROS")
    polygon_pub_topic: str = param("", "topic of the published area in ROS")

    @model_validator(mode="after")
    def _check_shape(self) -> ExclusionZoneParams:
        if self.type == "circle" and self.radius is None:
            raise ValueError("a circle needs a radius; set radius (m)")
        if self.type == "polygon" and not self.corners:
            raise ValueError('a polygon needs points; write points: "[[x, y], [x, y], ..]" (m)')
        return self

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """The corners (m) in its frame."""
        return parse_points("points", self.points, 3)


class MonitorSourceParams(ParamModel):
    """A source of obstacle points: an entry of `observation_sources`."""

    CHILD_FIELD: ClassVar[str | None] = "exclusions"

    type: Literal["scan", "pointcloud", "range", "polygon", "costmap"] = param("scan", "kind of the data")
    topic: str = param("scan", "topic of the data")
    enabled: bool = param(True, "the source is used")
    source_timeout: float | None = param(
        None, "age of the data from which on they are stale; 0 = never; if not set, that of the node", unit="s", ge=0.0
    )
    exclusion_zones: list[str] = param([], "names of areas in which points are ignored")
    min_valid_share: float = param(
        0.1,
        "scan: share of the beams that must be valid, with a range of at least range_min or without a hit; with fewer, beams "
        "below range_min stop commands towards them, and a scan of NaN is no data; not a parameter of Nav2",
        ge=0.0,
        le=1.0,
    )
    min_height: float = param(0.05, "pointcloud: points below are ignored", unit="m")
    max_height: float = param(0.5, "pointcloud: points above are ignored", unit="m")
    min_range: float = param(0.0, "pointcloud: points closer to the sensor are ignored", unit="m", ge=0.0)
    use_global_height: bool = param(
        False, "pointcloud: heights of the cloud's own field; navstack's clouds have heights above the ground"
    )
    transport_type: str = param("raw", "pointcloud: transport in ROS")
    obstacles_angle: float = param(math.pi / 180.0, "range: angle between the points of the arc", unit="rad", gt=0.0)
    sampling_distance: float = param(0.1, "polygon: distance of the points on its edges", unit="m", gt=0.0)
    cost_threshold: int = param(253, "costmap: cells of this cost and more are obstacles", ge=0, le=255)
    treat_unknown_as_obstacle: bool = param(True, "costmap: unknown cells are obstacles")
    exclusions: dict[str, ExclusionZoneParams] = param({}, "the areas of `exclusion_zones`, by name")

    CLAMPED: ClassVar[frozenset[str]] = frozenset({"cost_threshold"})

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the model of every name in `exclusion_zones`."""
        return dict.fromkeys(_names(values, "exclusion_zones"), ExclusionZoneParams)

    @field_validator("exclusion_zones")
    @classmethod
    def _check_names(cls, value: list[str]) -> list[str]:
        return _check_unique("exclusion_zones", value)


class _MonitorBase(ParamModel):
    """What the collision monitor and the collision detector have in common."""

    CHILD_FIELD: ClassVar[str | None] = "blocks"

    base_frame_id: str | None = param(
        None,
        "frame of the robot's base; if not set, robot_base_frame of the local costmap",
        ros_differs="the default of Nav2 is base_footprint",
    )
    odom_frame_id: str | None = param(
        None, "frame of the odometry; if not set, that of the robot", ros_differs="the default of Nav2 is odom"
    )
    transform_tolerance: float = param(0.1, "largest age of a transform", unit="s", ge=0.0)
    source_timeout: float = param(2.0, "age of data from which on they are stale; 0 = never", unit="s", ge=0.0)
    base_shift_correction: bool = param(
        True, "points are moved by the robot's own motion since their time; needs the odometry frame"
    )
    polygons: list[str] = param([], "names of the zones, in the order in which they are checked")
    observation_sources: list[str] = param([], "names of the sources")
    blocks: dict[str, ZoneParams | MonitorSourceParams] = param({}, "zones and sources, by name")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return `ZoneParams` for the names in `polygons`, `MonitorSourceParams` for those in `observation_sources`."""
        zones: dict[str, type[ParamModel]] = dict.fromkeys(_names(values, "polygons"), ZoneParams)
        return zones | dict.fromkeys(_names(values, "observation_sources"), MonitorSourceParams)

    @field_validator("polygons", "observation_sources")
    @classmethod
    def _check_names(cls, value: list[str]) -> list[str]:
        return _check_unique("the list", value)

    @model_validator(mode="after")
    def _check_blocks(self) -> _MonitorBase:
        if not self.polygons:
            raise ValueError("polygons lists no zone, so nothing is checked; list a zone, or remove the section")
        if not self.observation_sources:
            raise ValueError("observation_sources lists no source, so no obstacle is seen; list a source")
        both = [name for name in self.polygons if name in self.observation_sources]
        if both:
            raise ValueError(f"{', '.join(both)} is the name of a zone and of a source; give each a unique name")
        for name, zone in self.zones.items():
            unknown = [s for s in zone.sources_names or () if s not in self.observation_sources]
            if unknown:
                raise ValueError(
                    f"sources_names of {name} lists {', '.join(unknown)}, which is not in observation_sources"
                )
        return self

    @property
    def zones(self) -> dict[str, ZoneParams]:
        """The zones by name, in their order."""
        return {n: z for n in self.polygons if isinstance(z := self.blocks.get(n), ZoneParams)}

    @property
    def sources(self) -> dict[str, MonitorSourceParams]:
        """The sources by name, in their order."""
        return {n: s for n in self.observation_sources if isinstance(s := self.blocks.get(n), MonitorSourceParams)}


class CollisionMonitorParams(_MonitorBase):
    """Namespace `collision_monitor`: stops or slows the robot down while obstacles are in zones around it."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = ROS2_NO_EFFECT

    cmd_vel_in_topic: str = param("cmd_vel_smoothed", "topic of the commands in ROS")
    cmd_vel_out_topic: str = param("cmd_vel", "topic of the output in ROS")
    state_topic: str = param("", "topic of the state in ROS")
    stop_pub_timeout: float = param(1.0, "how long zero velocities are sent", unit="s", ge=0.0)
    enabled: bool = param(True, "commands are checked")
    enable_stamped_cmd_vel: bool = param(True, "type of the commands in ROS; navstack's have the time of the call")
    collision_points_marker_3d: bool = param(False, "shape of the markers in ROS")
    check_frequency: float = param(
        20.0,
        "how often the last command is checked again while the robot drives; not a parameter of Nav2",
        unit="Hz",
        gt=0.0,
        le=1000.0,
    )
    max_decel: list[float] | None = param(
        None,
        "approach: decelerations [x, y, yaw] of the robot, at most 0; the robot must be able to stop before a collision; if "
        "not set, that of the velocity smoother; not a parameter of Nav2",
        unit="m/s², rad/s²",
    )
    reaction_time: float = param(
        0.1, "approach: dead time until the robot follows a command; not a parameter of Nav2", unit="s", ge=0.0, le=5.0
    )
    nav2_compatible: bool = param(
        False, "compute as Nav2 does, with the defects that the parity page lists; not a parameter of Nav2"
    )

    @field_validator("max_decel")
    @classmethod
    def _check_decel(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and (len(value) != 3 or any(v > 0.0 for v in value)):
            raise ValueError(f"max_decel = {value} is not [x, y, yaw] with elements of at most 0; correct it")
        return value

    @model_validator(mode="after")
    def _check_actions(self) -> CollisionMonitorParams:
        for name, zone in self.zones.items():
            if zone.action_type == "none":
                raise ValueError(
                    f"action_type of {name} is none, which is for the collision detector; set stop, slowdown, limit or approach"
                )
        return self


class CollisionDetectorParams(_MonitorBase):
    """Namespace `collision_detector`: reports in which zones obstacles are, without changing commands."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = ROS2_NO_EFFECT

    frequency: float = param(10.0, "frequency of the checks", unit="Hz", gt=0.0, le=1000.0)

    @model_validator(mode="after")
    def _check_actions(self) -> CollisionDetectorParams:
        for name, zone in self.zones.items():
            if zone.action_type != "none":
                raise ValueError(
                    f"action_type of {name} is {zone.action_type}, but the collision detector only reports; set none"
                )
        return self
