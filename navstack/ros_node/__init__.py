"""What the nodes of ROS 1 and of ROS 2 share: inbox, clock, log, the robot of topics, the loop of the goal manager, records."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.ros_node.clock import NodeClock as NodeClock
    from navstack.ros_node.costmap_inputs import use_footprint as use_footprint
    from navstack.ros_node.costmap_inputs import use_map_update as use_map_update
    from navstack.ros_node.inbox import Inbox as Inbox
    from navstack.ros_node.live_record import RecordFolder as RecordFolder
    from navstack.ros_node.log import Log as Log
    from navstack.ros_node.log import NodeLog as NodeLog
    from navstack.ros_node.log import line_of as line_of
    from navstack.ros_node.loop_times import LoopTimes as LoopTimes
    from navstack.ros_node.node_state import OK as OK
    from navstack.ros_node.node_state import WARN as WARN
    from navstack.ros_node.node_state import NodeState as NodeState
    from navstack.ros_node.pace import ClockPace as ClockPace
    from navstack.ros_node.pace import Pace as Pace
    from navstack.ros_node.pace import WallPace as WallPace
    from navstack.ros_node.packages import write_packages as write_packages
    from navstack.ros_node.planner_copy import PlannerCopy as PlannerCopy
    from navstack.ros_node.robot import RECEIVERS as RECEIVERS
    from navstack.ros_node.robot import RosRobot as RosRobot
    from navstack.ros_node.sim_loop import ALIASES as ALIASES
    from navstack.ros_node.sim_loop import START_NS as START_NS
    from navstack.ros_node.sim_loop import SharedWorld as SharedWorld
    from navstack.ros_node.sim_loop import SimLoop as SimLoop
    from navstack.ros_node.sim_loop import SimNames as SimNames
    from navstack.ros_node.sim_loop import run_fleet as run_fleet
    from navstack.ros_node.sim_loop import with_imus as with_imus
    from navstack.ros_node.stack_node import MOST_ODOMETRY as MOST_ODOMETRY
    from navstack.ros_node.stack_node import MOST_SENSOR_DATA as MOST_SENSOR_DATA
    from navstack.ros_node.stack_node import MOST_TRANSFORMS as MOST_TRANSFORMS
    from navstack.ros_node.stack_node import StackNode as StackNode
    from navstack.ros_node.stack_node import layered_costmaps as layered_costmaps
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
