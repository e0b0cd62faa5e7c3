"""Messages of ROS 1 and ROS 2 as navstack's types and back, and the topics of a robot by their types; without ROS."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.ros_messages.builder import LINE_LIST as LINE_LIST
    from navstack.ros_messages.builder import SPHERE_LIST as SPHERE_LIST
    from navstack.ros_messages.builder import MessageBuilder as MessageBuilder
    from navstack.ros_messages.builder import published_costs as published_costs
    from navstack.ros_messages.messages import NS_PER_S as NS_PER_S
    from navstack.ros_messages.messages import Clock as Clock
    from navstack.ros_messages.messages import seconds as seconds
    from navstack.ros_messages.messages import time_ns as time_ns
    from navstack.ros_messages.topics import TRUTH as TRUTH
    from navstack.ros_messages.topics import TopicFinder as TopicFinder
    from navstack.ros_messages.topics import short_type as short_type
    from navstack.ros_messages.topics import topic_name as topic_name
    from navstack.ros_messages.transforms import LEVEL as LEVEL
    from navstack.ros_messages.transforms import Quaternion as Quaternion
    from navstack.ros_messages.transforms import StampedTransform as StampedTransform
    from navstack.ros_messages.transforms import Transform3D as Transform3D
    from navstack.ros_messages.transforms import TransformTree as TransformTree
    from navstack.ros_messages.transforms import multiply as multiply
    from navstack.ros_messages.transforms import quaternion_of_yaw as quaternion_of_yaw
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
