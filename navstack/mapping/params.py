"""Parameters of mapping. Where the meaning is that of slam_toolbox (Karto), so is the name."""

from __future__ import annotations

from navstack.plugins import ParamModel, param


class MapperParams(ParamModel):
    """How a map is made from scans."""

    resolution: float = param(0.05, "cells of the map", unit="m", ge=0.005, le=1.0)
    max_laser_range: float = param(30.0, "longer beams have no return", unit="m", gt=0.0, le=65.0)
    minimum_travel_distance: float = param(
        0.3,
        "distance to move before a scan becomes a keyframe; 0.5 leaves doors seen from few places",
        unit="m",
        ge=0.02,
    )
    minimum_travel_heading: float = param(0.3, "the same of the heading", unit="rad", ge=0.02)
    keyframes_per_place: int = param(
        10,
        "keyframes within 0.5 m and 0.4 rad of each other, from which on a scan that they explain does not become another; "
        "0: no limit",
        ge=0,
    )
    scan_buffer_size: int = param(12, "last keyframes that a scan is matched with", ge=1, le=100)
    correlation_search_space_dimension: float = param(
        0.5, "width of the search around the prediction; the odometry widens it", unit="m", gt=0.0, le=5.0
    )
    odometry_distance_error: float = param(0.1, "standard error of the odometry per distance", ge=0.001, le=1.0)
    odometry_heading_error: float = param(0.15, "standard error of the odometry per angle turned", ge=0.001, le=1.0)
    link_match_minimum_response_fine: float = param(
        0.3, "a match with a lower response does not correct the prediction", ge=0.0, le=1.0
    )
    do_loop_closing: bool = param(True, "recognize places")
    loop_search_maximum_distance: float = param(
        4.0, "places nearer than this, besides the drift, are compared", unit="m", gt=0.0
    )
    loop_search_space_dimension: float = param(
        8.0, "greatest width of the search for a place", unit="m", gt=0.0, le=40.0
    )
    loop_minimum_path: float = param(4.0, "path since a place was seen, to compare it again", unit="m", gt=0.0)
    loop_match_minimum_chain_size: int = param(10, "keyframes that make a place", ge=2, le=100)
    loop_match_minimum_response_coarse: float = param(0.35, "of the search", ge=0.0, le=1.0)
    loop_match_minimum_response_fine: float = param(0.55, "of the refined pose", ge=0.0, le=1.0)
    loop_match_maximum_runner_up: float = param(
        0.9, "response of another pose, relative to the best: above it the place is ambiguous", gt=0.0, le=1.0
    )
    loop_match_maximum_contradiction: float = param(
        0.1, "share of the points where the other scans have seen free space", ge=0.0, le=1.0
    )
    refinement_passes: int = param(
        2, "at the end, how often every keyframe is matched with all places near it; 0: not", ge=0, le=10
    )
