"""Parameters of the node: from the parameter server, as move_base reads them, with files on top."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from navstack.parameters.configuration import Configuration, load_configuration
from navstack.parameters.findings import Location
from navstack.parameters.sources import to_node
from navstack.parameters.yaml_reader import DictNode
from navstack.ros1 import ros

SEARCHED: Final = (
    "footprint",
    "robot_radius",
    "obstacle_range",
    "raytrace_range",
    "controller_frequency",
)
"""Parameters that are looked up in the enclosing namespaces (searchParam)."""
NOT_OURS: Final = (
    *("actionlib_status_frequency", "actionlib_server_pub_queue_size", "actionlib_server_sub_queue_size"),
    *("status_list_timeout", "status_frequency", "footprint_topic", "published_footprint_topic"),
)
"""Parameters of the node's topics, not of the goal manager."""

WRITTEN: Final = "navstack_written"
"""Parameter `~` that shows a later start that the node has written its parameters to the server."""


def load(sources: Sequence[str] = (), overrides: Sequence[str] = (), *, distro: str | None = None) -> Configuration:
    """Return the configuration of the node's private namespace, overlaid by the sources (`--params`).

    Raises ParameterError.
    """
    rospy = ros.rospy()
    tree: Any = rospy.get_param("~", {})
    values: dict[str, Any] = dict(tree) if isinstance(tree, dict) else {}
    private = str(rospy.resolve_name("~"))
    for name in SEARCHED:
        found = rospy.search_param(name)
        if name not in values and found is not None and not str(found).startswith(private):
            values[name] = rospy.get_param(found)
    if values.pop(WRITTEN, False):
        rospy.logwarn(
            "the parameters in %s are those that an earlier start has left, with its defaults and changes; as in ROS they count "
            "as set: rosparam delete %s removes them",
            private,
            private.rstrip("/"),
        )
    for name in NOT_OURS:
        values.pop(name, None)
    node = to_node(values, Location(f"the parameter server, {private}"))
    assert isinstance(node, DictNode)
    return load_configuration([node, *sources], overrides=overrides, distro=distro)
