"""Parameters of a costmap: `global_costmap:` and `local_costmap:` (costmap_2d/src/costmap_2d_ros.cpp, cfg/Costmap2D.cfg)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from navstack.core.parameters import ParamModel, PluginSpec, param


class CostmapParams(ParamModel):
    """Parameters of a costmap; each of its layers has its own namespace below."""

    global_frame: str = param("map", "frame of the costmap")
    robot_base_frame: str = param("base_link", "frame of the robot's centre")
    rolling_window: bool = param(False, "the costmap is a window that follows the robot")
    track_unknown_space: bool = param(False, "unobserved cells are unknown (255) instead of free (0)")
    always_send_full_costmap: bool = param(False, "publish the whole grid instead of the part that changed")
    plugins: list[PluginSpec] | None = param(None, "layers, in the order in which they write")
    footprint_topic: str = param("footprint", "topic on which a new footprint is received")
    published_footprint_topic: str = param("footprint", "topic on which the footprint is published")
    transform_tolerance: float = param(0.3, "maximum age of the robot's pose", unit="s", ge=0.0, le=10.0)
    update_frequency: float = param(5.0, "frequency of updates; 0 = never", unit="Hz", ge=0.0, le=100.0)
    publish_frequency: float = param(0.0, "frequency of publishing; 0 = never", unit="Hz", ge=0.0, le=100.0)
    width: float = param(
        10.0, "size along x; a static map overrides it", unit="m", ge=0.0, ros_differs="ROS reads an integer"
    )
    height: float = param(
        10.0, "size along y; a static map overrides it", unit="m", ge=0.0, ros_differs="ROS reads an integer"
    )
    resolution: float = param(
        0.05, "size of a cell; a static map overrides it", unit="m", gt=0.0, le=50.0, ros_differs="ROS accepts 0"
    )
    origin_x: float = param(0.0, "x of the lower left corner; a static map overrides it", unit="m")
    origin_y: float = param(0.0, "y of the lower left corner; a static map overrides it", unit="m")
    footprint: list[list[float]] | str = param("[]", "footprint of the robot, [[x, y], ..] with at least three points")
    robot_radius: float = param(
        0.46, "radius of a round robot, used if the footprint is empty", unit="m", ge=0.0, le=10.0
    )
    footprint_padding: float = param(0.01, "padding of the footprint along each axis", unit="m")

    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {"transform_tolerance", "update_frequency", "publish_frequency", "width", "height", "resolution"}
    )
    SEARCHED: ClassVar[frozenset[str]] = frozenset({"footprint", "robot_radius"})
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "static_map": "ignored because plugins is set; list a static layer instead",
        "map_type": "ignored because plugins is set; list an obstacle or voxel layer instead",
        "inscribed_radius": "computed from the footprint",
        "circumscribed_radius": "computed from the footprint",
    }
