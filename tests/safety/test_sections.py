"""The sections in YAML: of ROS 2 as they are, of navstack, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navstack.core import ParameterError
from navstack.parameters import check_parameters, load_configuration
from navstack.parameters.models.collision_monitor import parse_points

NAV2 = """\
velocity_smoother:
  ros__parameters:
    smoothing_frequency: 30.0
    scale_velocities: True
    feedback: "CLOSED_LOOP"
    max_velocity: [0.4, 0.1, 2.0]
    min_velocity: [-0.3, -0.1, -1.9]
    max_accel: [2.4, 0.2, 3.1]
    max_decel: [-2.3, -0.2, -3.0]
    odom_topic: "odometry"
    odom_duration: 0.2
    deadband_velocity: [0.01, 0.02, 0.03]
    velocity_timeout: 0.9
    use_realtime_priority: false
    enable_stamped_cmd_vel: true
collision_monitor:
  ros__parameters:
    base_frame_id: "base_footprint"
    odom_frame_id: "odom"
    cmd_vel_in_topic: "cmd_vel_a"
    cmd_vel_out_topic: "cmd_vel_b"
    state_topic: "state"
    transform_tolerance: 0.2
    source_timeout: 1.1
    base_shift_correction: False
    stop_pub_timeout: 2.0
    enabled: true
    collision_points_marker_3d: true
    polygons: ["Stop", "Slow", "Limit", "Footprint", "Moving"]
    Stop:
      type: "polygon"
      action_type: "stop"
      points: "[[0.3, 0.3], [0.3, -0.3], [0.0, -0.3], [0.0, 0.3]]"
      min_points: 5
      trigger_consecutive_points: 3
      release_consecutive_points: 2
      sources_names: ["scan"]
      enabled: false
      visualize: true
      polygon_pub_topic: "stop"
    Slow:
      type: "circle"
      action_type: "slowdown"
      radius: 0.7
      slowdown_ratio: 0.3
    Limit:
      type: "polygon"
      action_type: "limit"
      points: [0.5, 0.5, 0.5, -0.5, -0.5, -0.5, -0.5, 0.5]
      linear_limit: 0.4
      angular_limit: 0.6
      polygon_sub_topic: ""
      polygon_subscribe_transient_local: true
    Footprint:
      type: "polygon"
      action_type: "approach"
      footprint_topic: "/local_costmap/published_footprint"
      time_before_collision: 1.2
      simulation_time_step: 0.05
      max_points: 5
    Moving:
      type: "velocity_polygon"
      action_type: "stop"
      holonomic: true
      velocity_polygons: ["rotation", "forward"]
      rotation:
        points: "[[0.3, 0.3], [0.3, -0.3], [-0.3, -0.3], [-0.3, 0.3]]"
        linear_min: 0.0
        linear_max: 0.05
        theta_min: -1.0
        theta_max: 1.0
      forward:
        points: "[[0.6, 0.3], [0.6, -0.3], [-0.3, -0.3], [-0.3, 0.3]]"
        linear_min: 0.05
        linear_max: 0.5
        theta_min: -1.0
        theta_max: 1.0
        direction_start_angle: -1.5
        direction_end_angle: 1.5
    observation_sources: ["scan", "cloud", "sonar", "people", "costs"]
    scan:
      type: "scan"
      topic: "/scan"
      source_timeout: 0.3
      enabled: true
      exclusion_zones: ["box"]
      box:
        type: "polygon"
        points: "[[0.1, 0.1], [0.1, -0.1], [-0.1, 0.0]]"
        frame_id: "base_footprint"
        enabled: true
        min_height: 0.1
        max_height: 0.2
        frame_hold_timeout: 0.5
        visualize: false
    cloud:
      type: "pointcloud"
      topic: "points"
      min_height: 0.1
      max_height: 0.6
      min_range: 0.2
      use_global_height: false
      transport_type: "raw"
    sonar: {type: "range", topic: "sonar", obstacles_angle: 0.02}
    people: {type: "polygon", topic: "people", sampling_distance: 0.05}
    costs: {type: "costmap", topic: "local_costmap/costmap", cost_threshold: 250, treat_unknown_as_obstacle: false}
collision_detector:
  ros__parameters:
    frequency: 5.0
    base_frame_id: "base_footprint"
    odom_frame_id: "odom"
    transform_tolerance: 0.5
    source_timeout: 5.0
    base_shift_correction: true
    polygons: ["Front"]
    Front: {type: polygon, action_type: none, points: "[[0.3, 0.3], [0.3, -0.3], [0.0, -0.3], [0.0, 0.3]]"}
    observation_sources: ["scan"]
    scan: {type: scan, topic: scan}
twist_mux:
  ros__parameters:
    use_stamped: true
    topics:
      navigation: {topic: nav_vel, timeout: 0.5, priority: 10}
      joystick: {topic: joy_vel, timeout: 0.4, priority: 100}
    locks:
      pause: {topic: pause_navigation, timeout: 0.0, priority: 99}
"""


@pytest.fixture
def nav2(tmp_path: Path) -> Path:
    file = tmp_path / "nav2_params.yaml"
    file.write_text(NAV2, encoding="utf-8")
    return file


def test_every_parameter_of_a_nav2_file_is_read(nav2: Path) -> None:
    configuration = load_configuration(["turtlebot", str(nav2)])
    loud = [f for f in configuration.findings if "nav2_params" in str(f.location) and f.severity != "info"]
    # all of it is known; what the robot of turtlebot does not have is said
    assert {(f.rule, f.key) for f in loud} == {
        ("smoother-limits", "velocity_smoother/max_velocity"),
        ("smoother-limits", "velocity_smoother/min_velocity"),
        ("nothing-feeds-monitor", "collision_monitor/cloud/topic"),
        ("nothing-feeds-monitor", "collision_monitor/sonar/topic"),
        ("nothing-feeds-monitor", "collision_monitor/people/topic"),
    }
    safety = configuration.safety
    assert safety.velocity_smoother is not None
    assert safety.collision_monitor is not None
    assert safety.collision_detector is not None
    assert safety.twist_mux is not None
    # every value differs from its default or was written: the effective values are those of the file
    smoother = safety.velocity_smoother
    assert smoother.model_fields_set >= {
        *("smoothing_frequency", "scale_velocities", "feedback", "max_velocity", "min_velocity", "max_accel"),
        *("max_decel", "odom_topic", "odom_duration", "deadband_velocity", "velocity_timeout"),
    }
    assert smoother.planar("max_decel") == (-2.3, -0.2, -3.0)
    monitor = safety.collision_monitor
    assert monitor.source_timeout == 1.1
    assert list(monitor.zones) == ["Stop", "Slow", "Limit", "Footprint", "Moving"]
    zones = monitor.zones
    assert zones["Stop"].least_points == 5
    assert not zones["Stop"].enabled
    assert zones["Slow"].radius == 0.7
    assert zones["Limit"].corners == ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))
    assert zones["Footprint"].takes_footprint
    assert zones["Footprint"].least_points == 6
    assert zones["Moving"].sub_polygons["forward"].direction_end_angle == 1.5
    sources = monitor.sources
    assert sources["scan"].exclusions["box"].max_height == 0.2
    assert sources["costs"].cost_threshold == 250
    assert safety.collision_detector.frequency == 5.0
    assert [(t.name, t.timeout, t.priority) for t in safety.twist_mux.topics] == [
        ("navigation", 0.5, 10),
        ("joystick", 0.4, 100),
    ]
    assert safety.twist_mux.locks[0].priority == 99


def test_the_same_without_ros__parameters_and_in_ros_1_form(nav2: Path, tmp_path: Path) -> None:
    plain: dict[str, Any] = {
        "twist_mux": {
            "topics": [
                {"name": "navigation", "topic": "nav_vel", "timeout": 0.5, "priority": 10},
                {"name": "joystick", "topic": "joy_vel", "timeout": 0.4, "priority": 100},
            ],
            "locks": [{"name": "pause", "topic": "pause_navigation", "timeout": 0.0, "priority": 99}],
        }
    }
    one = load_configuration(["turtlebot", str(nav2)]).safety.twist_mux
    assert load_configuration(["turtlebot", plain]).safety.twist_mux == one
    # the sections other than move_base in a dump of the parameter server
    dump = tmp_path / "dump.yaml"
    dump.write_text(f"move_base:\n  controller_frequency: 5.0\n{NAV2}", encoding="utf-8")
    assert load_configuration(["turtlebot", str(dump)]).safety == load_configuration(["turtlebot", str(nav2)]).safety


def test_without_sections_nothing_is_in_use() -> None:
    assert not load_configuration(["turtlebot"]).safety.in_use


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "severity", "text", "line"),
    [
        ("velocity_timeout: 0.9", "velocity_timout: 0.9", "warning", "did you mean velocity_timeout?", 14),
        ("velocity_timeout: 0.9", "velocity_timeout: -1.0", "error", "must be at least 0", 14),
        ("max_decel: [-2.3, -0.2, -3.0]", "max_decel: [-2.3, -0.2, 3.0]", "error", "positive element", 10),
        ("max_accel: [2.4, 0.2, 3.1]", "max_accel: [2.4, 3.1]", "error", "different or wrong lengths", 1),
        ('feedback: "CLOSED_LOOP"', 'feedback: "LOOP"', "error", "OPEN_LOOP", 6),
        ("min_points: 5", "min_pionts: 5", "warning", "did you mean min_points?", 35),
        ("min_points: 5", "min_points: 0", "error", "at least 1", 35),
        ("slowdown_ratio: 0.3", "slowdown_ratio: 1.3", "error", "at most 1", 46),
        ("slowdown_ratio: 0.3", "slowdown_ratio: -0.3", "error", "greater than 0", 46),
        ("radius: 0.7", "visualize: true", "error", "a circle needs a radius", 42),
        ("time_before_collision: 1.2", "time_before_collision: 0.0", "error", "greater than 0", 59),
        ("simulation_time_step: 0.05", "simulation_time_step: 0.0", "error", "greater than 0", 60),
        (
            'points: "[[0.3, 0.3], [0.3, -0.3], [0.0, -0.3], [0.0, 0.3]]"',
            'points: "[[0.3, 0.3], [0.3, -0.3], [0.0, -0.3]]"',
            "error",
            "has 3 corners; give at least 4",
            34,
        ),
        (
            'points: "[[0.3, 0.3], [0.3, -0.3], [0.0, -0.3], [0.0, 0.3]]"',
            'points: "[[0.3, 0.3], [0.3, -0.3]"',
            "error",
            "is not a polygon",
            34,
        ),
        (
            'points: "[[0.3, 0.3], [0.3, -0.3], [0.0, -0.3], [0.0, 0.3]]"',
            'points: "[[0.3, 0.3], [0.0, -0.3], [0.3, -0.3], [0.0, 0.3]]"',
            "error",
            "crosses itself",
            34,
        ),
        ('action_type: "stop"', 'action_type: "none"', "error", "for the collision detector", 17),
        ('sources_names: ["scan"]', 'sources_names: ["scam"]', "error", "which is not in observation_sources", 17),
        ("joystick: {topic", "navigation: {topic", "warning", "set twice", 124),
        ("priority: 100}", "priority: 300}", "error", "at most 255", 124),
        ("priority: 100}", "priorty: 100}", "warning", "priorty has no effect", 124),
    ],
)
def test_findings(nav2: Path, old: str, new: str, severity: str, text: str, line: int) -> None:
    assert old in NAV2
    nav2.write_text(NAV2.replace(old, new, 1), encoding="utf-8")
    found = [
        f
        for f in check_parameters(["turtlebot", str(nav2)])
        if f.severity != "info" and "nav2_params" in f.location.file
    ]
    matching = [f for f in found if text in f.message]
    assert matching, [f.message for f in found]
    assert matching[0].severity == severity
    assert abs(matching[0].location.line - line) <= 1, matching[0].location
    if severity == "error":
        with pytest.raises(ParameterError):
            load_configuration(["turtlebot", str(nav2)])


@pytest.mark.parametrize("large", ["1" + 400 * "0", "-1" + 400 * "0", "1e400"])
def test_a_corner_too_large_for_a_float_is_no_polygon(large: str) -> None:
    with pytest.raises(ValueError, match=r"points = .* is not a polygon"):
        parse_points("points", f"[[0.3, 0.2], [{large}, -0.2], [-0.3, 0.0]]")
