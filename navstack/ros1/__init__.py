"""ROS 1 nodes: move_base's interface around the goal manager, the simulated robot, and the tools around them.

rospy and the messages come from Debian's packages (`tools/install_ros1.sh`); they are imported only in this package.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.ros1.amcl_node import AmclNode as AmclNode
    from navstack.ros1.amcl_node import load_amcl as load_amcl
    from navstack.ros1.launch_advice import Advice as Advice
    from navstack.ros1.launch_advice import advise as advise
    from navstack.ros1.localization_node import FakeLocalization as FakeLocalization
    from navstack.ros1.map_nodes import check_thresholds as check_thresholds
    from navstack.ros1.map_nodes import load_image as load_image
    from navstack.ros1.map_nodes import receive_map as receive_map
    from navstack.ros1.map_nodes import serve_map as serve_map
    from navstack.ros1.mapping_node import MappingNode as MappingNode
    from navstack.ros1.mapping_node import read_mapping_params as read_mapping_params
    from navstack.ros1.packages import install as install
    from navstack.ros1.sim_node import simulate as simulate
    from navstack.ros1.sim_node import simulate_fleet as simulate_fleet
    from navstack.ros1.tour import Tour as Tour
    from navstack.ros1.trajectories import TrajectoryPublisher as TrajectoryPublisher
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
