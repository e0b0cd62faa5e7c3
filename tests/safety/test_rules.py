"""Rules across the sections between planner and wheels: each finds its own combination, with the numbers, and nothing else."""

from __future__ import annotations

from typing import Any

import pytest

from navstack.parameters import Finding, check_parameters, load_configuration
from navstack.plugins import LOCAL_PLANNERS
from tests.parameters.test_configuration import robot

ZONE: dict[str, Any] = {"type": "circle", "action_type": "stop", "radius": 0.6, "min_points": 4}
LASER: dict[str, Any] = {"beams": 360, "fov": 6.283185307179586, "x": 0.0, "range_min": 0.05, "range_max": 10.0}
SMOOTHER: dict[str, Any] = {
    "max_velocity": [0.55, 0.0, 3.2],
    "min_velocity": [-0.55, 0.0, -3.2],
    "max_accel": [2.5, 0.0, 3.2],
    "max_decel": [-2.5, 0.0, -3.2],
}


def monitor(zone: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    merged = {key: value for key, value in {**ZONE, **(zone or {})}.items() if value is not None}
    made = {"polygons": ["zone"], "observation_sources": ["scan"], "zone": merged, "scan": {}}
    return {"collision_monitor": {**made, **more}}


def findings(**sections: Any) -> list[Finding]:
    """Warnings and infos of the sections' rules for a small DWA robot (0.55 m/s, 2.5 m/s²) with a lidar of 1 degree."""
    sim = {"laser": LASER, **sections.pop("sim", {})}
    loaded = check_parameters([robot(navstack={"sim": sim}, **sections)])
    return [f for f in loaded if f.key.startswith(("velocity_smoother", "twist_mux", "collision_"))]


@pytest.mark.parametrize(
    "sections",
    [
        {"velocity_smoother": SMOOTHER},
        {"velocity_smoother": {**SMOOTHER, "feedback": "CLOSED_LOOP", "deadband_velocity": [0.1, 0.0, 0.1]}},
        {"twist_mux": {}},
        {"twist_mux": {"topics": [{"name": "planner", "topic": "/nav_vel", "timeout": 0.5}]}},
        monitor(),
        monitor({"action_type": "approach", "time_before_collision": 2.0}),
        monitor({"min_points": 9}),
        monitor(observation_sources=["cells"], cells={"type": "costmap", "topic": "/local_costmap/costmap"}),
        monitor(base_frame_id="base_link", odom_frame_id="odom"),
        monitor(odom_frame_id="nowhere", base_shift_correction=False),
    ],
)
def test_sections_without_findings(sections: dict[str, Any]) -> None:
    assert findings(**sections) == []


@pytest.mark.parametrize(
    ("sections", "rule", "severity", "key", "texts"),
    [
        (
            {"velocity_smoother": {**SMOOTHER, "max_velocity": [0.5, 0.0, 3.2]}},
            "smoother-limits",
            "warning",
            "velocity_smoother/max_velocity",
            ("x 0.5 (DWAPlannerROS/max_vel_x 0.55)", "write max_velocity: [0.55, 0.0, 3.2]"),
        ),
        (
            {"velocity_smoother": {**SMOOTHER, "max_decel": [-1.0, 0.0, -1.5]}},
            "smoother-limits",
            "warning",
            "velocity_smoother/max_decel",
            ("x -1 (DWAPlannerROS/acc_lim_x 2.5), yaw -1.5 (", "write max_decel: [-2.5, 0.0, -3.2]"),
        ),
        (
            {"velocity_smoother": SMOOTHER, "DWAPlannerROS": {"min_vel_x": -0.7}},
            "smoother-limits",
            "warning",
            "velocity_smoother/min_velocity",
            ("x -0.55 (DWAPlannerROS/min_vel_x -0.7)",),
        ),
        (
            {"velocity_smoother": {**SMOOTHER, "deadband_velocity": [0.6, 0.0, 0.0]}},
            "deadband-too-large",
            "warning",
            "velocity_smoother/deadband_velocity",
            ("0.6 of x is above the highest velocity 0.55",),
        ),
        (
            {"velocity_smoother": {**SMOOTHER, "deadband_velocity": [0.13, 0.0, 0.0], "feedback": "CLOSED_LOOP"}},
            "deadband-too-large",
            "info",
            "velocity_smoother/deadband_velocity",
            ("2.5 / smoothing_frequency 20 = 0.125", "Nav2's smoother never does"),
        ),
        (
            {
                "velocity_smoother": {
                    **SMOOTHER,
                    "deadband_velocity": [0.13, 0.0, 0.0],
                    "feedback": "CLOSED_LOOP",
                    "nav2_compatible": True,
                }
            },
            "deadband-too-large",
            "warning",
            "velocity_smoother/deadband_velocity",
            ("the robot never starts",),
        ),
        (
            {"velocity_smoother": {**SMOOTHER, "velocity_timeout": 0.04}},
            "timeout-too-short",
            "warning",
            "velocity_smoother/velocity_timeout",
            ("velocity_timeout = 0.04 s", "1 / controller_frequency = 0.05 s"),
        ),
        (
            {"twist_mux": {"topics": [{"name": "navigation", "timeout": 0.04}]}},
            "timeout-too-short",
            "warning",
            "twist_mux/topics",
            ("timeout 0.04 s of the input navigation",),
        ),
        (
            {"twist_mux": {"topics": [{"name": "navigation", "priority": 5}, {"name": "joy", "priority": 5}]}},
            "equal-priority",
            "warning",
            "twist_mux/topics",
            ("navigation and joy have the same priority 5",),
        ),
        (
            {"twist_mux": {"topics": [{"name": "joystick", "priority": 5}]}},
            "no-navigation-input",
            "warning",
            "twist_mux/topics",
            ("every goal is aborted (inputs: joystick)", "{name: navigation, priority: 10}"),
        ),
        (
            monitor(base_frame_id="base_footprint2"),
            "unknown-monitor-frame",
            "warning",
            "collision_monitor/base_frame_id",
            ("base_footprint2 is no frame of this robot (", "base_link"),
        ),
        (
            monitor(scan={"topic": "scan_front"}),
            "nothing-feeds-monitor",
            "warning",
            "collision_monitor/scan/topic",
            ("LaserScan on scan_front", "the robot stands in simulation", "(scans: scan)"),
        ),
        (
            monitor(scan={"topic": "scan_front", "source_timeout": 0.0}),
            "nothing-feeds-monitor",
            "warning",
            "collision_monitor/scan/topic",
            ("it sees nothing in simulation",),
        ),
        (
            monitor(scan={"type": "pointcloud", "topic": "points"}),
            "nothing-feeds-monitor",
            "warning",
            "collision_monitor/scan/topic",
            ("PointCloud2 on points",),
        ),
        (
            monitor(scan={"type": "range", "topic": "us"}),
            "nothing-feeds-monitor",
            "warning",
            "collision_monitor/scan/topic",
            ("sonars: [sonar], sonar: {topic: us}",),
        ),
        (
            monitor(scan={"type": "costmap", "topic": "costmap"}),
            "nothing-feeds-monitor",
            "warning",
            "collision_monitor/scan/topic",
            ("write topic: local_costmap/costmap",),
        ),
        (
            monitor({"sources_names": ["scan"]}, observation_sources=["scan", "more"], more={"topic": "more"}),
            "unused-source",
            "info",
            "collision_monitor/more/topic",
            ("no enabled zone uses the source more",),
        ),
        (
            monitor(source_timeout=0.05),
            "source-timeout",
            "warning",
            "collision_monitor/source_timeout",
            ("0.05 s is shorter than the time 0.1 s between two messages on scan",),
        ),
        (
            monitor({"radius": 0.15}),
            "zone-in-footprint",
            "warning",
            "collision_monitor/zone/radius",
            ("the zone zone is inside the footprint",),
        ),
        (
            # C15: 6 beams of 1 degree are 0.21 m wide at 2 m
            monitor({"radius": 2.0, "min_points": 6}),
            "min-points",
            "warning",
            "collision_monitor/zone/min_points",
            ("every 1 degrees are 0.21 m wide", "2 m from the lidar", "set min_points: 2"),
        ),
        (
            monitor({"radius": 2.0, "min_points": None, "max_points": 5}),
            "min-points",
            "warning",
            "collision_monitor/zone/max_points",
            ("6 points (min_points)",),
        ),
        (
            monitor({"action_type": "approach", "time_before_collision": 20.0}),
            "approach-horizon",
            "info",
            "collision_monitor/zone/time_before_collision",
            ("0.55 m/s the robot drives 11 m", "sees 10 m", "time_before_collision: 18.1"),
        ),
    ],
)
def test_findings(sections: dict[str, Any], rule: str, severity: str, key: str, texts: tuple[str, ...]) -> None:
    found = findings(**sections)
    assert [(f.rule, f.severity, f.key) for f in found] == [(rule, severity, key)], [f.message for f in found]
    for text in texts:
        assert text in found[0].message, found[0].message


@pytest.mark.parametrize(
    ("planner", "params", "texts"),
    [
        ("mppi", {"vx_max": 0.9, "vx_min": -0.1}, {"max_velocity": "vx_max 0.9"}),
        ("regulated_pure_pursuit", {"max_linear_vel": 0.8}, {"max_velocity": "max_linear_vel 0.8"}),
        ("graceful", {"v_linear_max": 0.7}, {"max_velocity": "v_linear_max 0.7"}),
        ("rotation_shim", {}, {"max_velocity": "primary_controller/max_vel_x 0.6"}),
        ("base_local_planner/TrajectoryPlannerROS", {"acc_lim_x": 4.0}, {"max_decel": "acc_lim_x 4"}),
    ],
)
def test_limits_of_other_planners(planner: str, params: dict[str, Any], texts: dict[str, str]) -> None:
    name = LOCAL_PLANNERS.get(planner).name
    section = planner.rpartition("/")[2]
    values = dict(params)
    if "shim" in planner:
        values = {"primary_controller": {"plugin": "dwa_local_planner/DWAPlannerROS", "max_vel_x": 0.6}}
    smoother = {
        **SMOOTHER,
        "max_accel": [5.0, 0.0, 5.0],
        "max_velocity": [0.55, 0.0, 5.0],
        "min_velocity": [-0.5, 0.0, -5.0],
    }
    smoother["max_decel"] = [-3.0, 0.0, -5.0]
    found = findings(base_local_planner=name, velocity_smoother=smoother, **{section: values})
    limits = {f.key.rpartition("/")[2]: f.message for f in found if f.rule == "smoother-limits"}
    assert limits.keys() == texts.keys(), limits
    for key, text in texts.items():
        assert text in limits[key]


def test_a_robot_without_scans_for_its_costmaps_has_a_lidar_for_its_monitor() -> None:
    """A camera for the costmaps, a lidar for the collision monitor: without data of it the robot would stand."""
    cloud = {"data_type": "PointCloud2", "topic": "points", "marking": True, "clearing": True}
    layer = {"observation_sources": "scan", "scan": cloud}
    costmaps = {"global_costmap__obstacle_layer": layer, "local_costmap__obstacle_layer": layer}
    configuration = load_configuration([robot(**costmaps, **monitor())])
    lidars = {lidar.topic: lidar.message for lidar in configuration.navstack.sim.lidars.values()}
    assert lidars == {"points": "PointCloud2", "scan": "LaserScan"}
    rules = {f.rule: f.key for f in configuration.findings}
    assert "nothing-feeds-monitor" not in rules
