"""ROS 2 nodes: Nav2's interface around the goal manager, and the simulated robot.

rclpy and the messages are those of the user's installation; they are imported only in this package.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.ros2.launch_advice import advise as advise
    from navstack.ros2.lifecycle import managed_node as managed_node
    from navstack.ros2.navigator import Navigator as Navigator
    from navstack.ros2.packages import install as install
    from navstack.ros2.parameters import load as load
    from navstack.ros2.ros import RosNode as RosNode
    from navstack.ros2.sim_node import simulate as simulate
    from navstack.ros2.sim_node import simulate_fleet as simulate_fleet
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
