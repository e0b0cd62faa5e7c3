"""navstack: move_base without ROS.

Everything a script needs is here; it is imported when it is first used.

    import navstack as nav

    grid = nav.load_map(nav.map_path("office"))
    robot_yaml = nav.load_configuration(["turtlebot"])
    start, goal = nav.load_places("office").start, nav.load_places("office").goals[0]
    print(nav.plan_on_map(robot_yaml, grid, start, goal).plan.path.length)

    robot = nav.simulated_robot(robot_yaml, grid, start)
    move_base = nav.build_move_base(robot_yaml, robot, static_map=grid)
    handle = move_base.send_goal(goal)
    while not handle.is_done:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
    print(handle.status.name, handle.text)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_WHERE = {
    "navstack.core": (
        "Costmap",
        "Event",
        "Footprint",
        "FrameTree",
        "GridGeometry",
        "LaserScan",
        "Listener",
        "OccupancyGrid",
        "Path",
        "PointCloud",
        "Pose2D",
        "RobotState",
        "Transform2D",
        "Twist2D",
    ),
    "navstack.core.errors": ("NavError",),
    "navstack.parameters.configuration": ("Configuration", "check_parameters", "load_configuration"),
    "navstack.costmap": ("LayeredCostmap",),
    "navstack.map_io": ("load_map", "map_names", "map_path", "save_map"),
    "navstack.places": ("load_places",),
    "navstack.move_base": ("GoalHandle", "GoalStatus", "MoveBase"),
    "navstack.bringup": ("build_costmap", "build_move_base", "simulated_robot"),
    "navstack.plan_once": ("plan", "plan_on_map"),
    "navstack.plugins": (
        "CRITICS",
        "GLOBAL_PLANNERS",
        "LAYERS",
        "LOCALIZERS",
        "LOCAL_PLANNERS",
        "RECOVERY_BEHAVIORS",
        "SMOOTHERS",
    ),
    "navstack.record": ("Record",),
    "navstack.scenario": ("RunResult", "Scenario", "run_scenario"),
    "navstack.sim": ("Shape", "SimulatedRobot", "World"),
}
_MODULE_OF = {name: module for module, names in _WHERE.items() for name in names}

if TYPE_CHECKING:
    from navstack import logs as logs
    from navstack.bringup import build_costmap, build_move_base, simulated_robot
    from navstack.core import (
        Costmap,
        Event,
        Footprint,
        FrameTree,
        GridGeometry,
        LaserScan,
        Listener,
        OccupancyGrid,
        Path,
        PointCloud,
        Pose2D,
        RobotState,
        Transform2D,
        Twist2D,
    )
    from navstack.core.errors import NavError
    from navstack.costmap import LayeredCostmap
    from navstack.map_io import load_map, map_names, map_path, save_map
    from navstack.move_base import GoalHandle, GoalStatus, MoveBase
    from navstack.parameters.configuration import Configuration, check_parameters, load_configuration
    from navstack.places import load_places
    from navstack.plan_once import plan, plan_on_map
    from navstack.plugins import (
        CRITICS,
        GLOBAL_PLANNERS,
        LAYERS,
        LOCAL_PLANNERS,
        LOCALIZERS,
        RECOVERY_BEHAVIORS,
        SMOOTHERS,
    )
    from navstack.record import Record
    from navstack.scenario import RunResult, Scenario, run_scenario
    from navstack.sim import Shape, SimulatedRobot, World

__all__ = [
    "CRITICS",
    "GLOBAL_PLANNERS",
    "LAYERS",
    "LOCALIZERS",
    "LOCAL_PLANNERS",
    "RECOVERY_BEHAVIORS",
    "SMOOTHERS",
    "Configuration",
    "Costmap",
    "Event",
    "Footprint",
    "FrameTree",
    "GoalHandle",
    "GoalStatus",
    "GridGeometry",
    "LaserScan",
    "LayeredCostmap",
    "Listener",
    "MoveBase",
    "NavError",
    "OccupancyGrid",
    "Path",
    "PointCloud",
    "Pose2D",
    "Record",
    "RobotState",
    "RunResult",
    "Scenario",
    "Shape",
    "SimulatedRobot",
    "Transform2D",
    "Twist2D",
    "World",
    "__version__",
    "build_costmap",
    "build_move_base",
    "check_parameters",
    "load_configuration",
    "load_map",
    "load_places",
    "map_names",
    "map_path",
    "plan",
    "plan_on_map",
    "run_scenario",
    "save_map",
    "simulated_robot",
]


def __getattr__(name: str) -> Any:
    if name == "logs":
        return importlib.import_module("navstack.logs")
    module = _MODULE_OF.get(name)
    if module is None:
        raise AttributeError(f"module 'navstack' has no attribute {name!r}")
    value = getattr(importlib.import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
