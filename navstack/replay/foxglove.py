"""A layout for Foxglove that shows an exported run: map, costmaps, scan, plans and robot, commands over time."""

from __future__ import annotations

from typing import Any


def foxglove_layout(*, is_ros1: bool) -> dict[str, Any]:
    """Return the layout as JSON data; the topics are those of `navstack bag export`."""
    prefix = "/move_base" if is_ros1 else ""
    grids = {
        "/map": {"visible": True, "colorMode": "map"},
        f"{prefix}/global_costmap/costmap": {"visible": True, "colorMode": "costmap", "alpha": 0.4},
        f"{prefix}/local_costmap/costmap": {"visible": True, "colorMode": "costmap", "alpha": 0.6},
    }
    lines = {
        f"{prefix}/local_costmap/footprint": {"visible": True, "color": "#0072b2ff"},
        "/scan": {"visible": True, "colorMode": "flat", "flatColor": "#d55e00ff", "pointSize": 4},
        "/navstack/trajectory": {"visible": True},
        "/goal_pose": {"visible": True},
    }
    plans = {f"{prefix}/{name}/plan": {"visible": True, "gradient": ["#009e73ff", "#009e73ff"]} for name in _PLANNERS}
    paths = plans if is_ros1 else {"/plan": {"visible": True}, "/local_plan": {"visible": True}}
    scene = {
        "cameraState": {"perspective": False, "distance": 20, "phi": 0, "thetaOffset": 0},
        "followMode": "follow-position",
        "followTf": "base_footprint",
        "topics": {**grids, **lines, **paths},
        "layers": {},
    }
    chart = {
        "title": "commands",
        "paths": [
            {"value": path, "enabled": True, "timestampMethod": "receiveTime", "label": label}
            for path, label in (
                ("/cmd_vel.linear.x", "commanded, m/s"),
                ("/odom.twist.twist.linear.x", "measured, m/s"),
                ("/cmd_vel.angular.z", "commanded, rad/s"),
                ("/odom.twist.twist.angular.z", "measured, rad/s"),
            )
        ],
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "xAxisVal": "timestamp",
    }
    return {
        "configById": {"3D!navstack": scene, "Plot!navstack": chart},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "column", "first": "3D!navstack", "second": "Plot!navstack", "splitPercentage": 70},
    }


_PLANNERS = ("NavfnROS", "GlobalPlanner")
