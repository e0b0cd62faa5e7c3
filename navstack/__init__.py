"""navstack: move_base without ROS.

Everything a script needs is here; it is imported when it is first used.

    import navstack as nav

    result = nav.simulate("office", robot="turtlebot", goals=["kitchen"], seed=0)
    print(result)                                  # 1/1 goals, 36.4 s, 14.6 m, 0 collisions
    print(result.explain(goal=1)); result.plot("run.png")
    print(nav.plan("office", "corridor_west", "kitchen", planner="astar").path.length)

Wherever a map, a robot, a place or a scenario is wanted, its packaged name, its file and the object itself work. The parts
below, for other programs than the simulator:

    robot = nav.simulated_robot(nav.load_robot("turtlebot"), nav.load_map("office"), nav.load_places("office").start)
    move_base = nav.build_move_base(nav.load_robot("turtlebot"), robot, static_map=nav.load_map("office"))
    handle = move_base.send_goal(nav.load_places("office").goals[0])
    while not handle.is_done:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
    print(handle.status.name, handle.text)
"""

from navstack import _interrupts

if _interrupts.is_command():
    _interrupts.end_quietly()

from typing import TYPE_CHECKING

__version__ = "0.2.0"

if TYPE_CHECKING:
    from navstack import logs as logs
    from navstack.bringup import build_costmap as build_costmap
    from navstack.bringup import build_move_base as build_move_base
    from navstack.bringup import plan_on_map as plan_on_map
    from navstack.bringup import simulated_robot as simulated_robot
    from navstack.core import Costmap as Costmap
    from navstack.core import Event as Event
    from navstack.core import Footprint as Footprint
    from navstack.core import FrameTree as FrameTree
    from navstack.core import GridGeometry as GridGeometry
    from navstack.core import LaserScan as LaserScan
    from navstack.core import Listener as Listener
    from navstack.core import NavError as NavError
    from navstack.core import OccupancyGrid as OccupancyGrid
    from navstack.core import Path as Path
    from navstack.core import PointCloud as PointCloud
    from navstack.core import Pose2D as Pose2D
    from navstack.core import RobotState as RobotState
    from navstack.core import Transform2D as Transform2D
    from navstack.core import Twist2D as Twist2D
    from navstack.costmap import LayeredCostmap as LayeredCostmap
    from navstack.map_io import load_map as load_map
    from navstack.map_io import map_names as map_names
    from navstack.map_io import map_path as map_path
    from navstack.map_io import save_map as save_map
    from navstack.move_base import GoalHandle as GoalHandle
    from navstack.move_base import GoalStatus as GoalStatus
    from navstack.move_base import MoveBase as MoveBase
    from navstack.parameters import Configuration as Configuration
    from navstack.parameters import check_parameters as check_parameters
    from navstack.plugins import CRITICS as CRITICS
    from navstack.plugins import GLOBAL_PLANNERS as GLOBAL_PLANNERS
    from navstack.plugins import LAYERS as LAYERS
    from navstack.plugins import LOCAL_PLANNERS as LOCAL_PLANNERS
    from navstack.plugins import LOCALIZERS as LOCALIZERS
    from navstack.plugins import RECOVERY_BEHAVIORS as RECOVERY_BEHAVIORS
    from navstack.plugins import SMOOTHERS as SMOOTHERS
    from navstack.record import Record as Record
    from navstack.scenario import RunResult as RunResult
    from navstack.scenario import Scenario as Scenario
    from navstack.scenario import load_places as load_places
    from navstack.scenario import run_scenario as run_scenario
    from navstack.shortcuts import ParameterWarning as ParameterWarning
    from navstack.shortcuts import load_configuration as load_configuration
    from navstack.shortcuts import load_robot as load_robot
    from navstack.shortcuts import plan as plan
    from navstack.shortcuts import simulate as simulate
    from navstack.shortcuts import simulate_many as simulate_many
    from navstack.sim import Shape as Shape
    from navstack.sim import SimulatedRobot as SimulatedRobot
    from navstack.sim import World as World
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
    __all__.append("__version__")
