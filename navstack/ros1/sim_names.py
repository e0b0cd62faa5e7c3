"""Names of the simulated robot on the ROS graph: frames with a prefix, aliases of the base, topics of velocities."""

from __future__ import annotations

from typing import Any, Final

from navstack.core.errors import InputError
from navstack.core.frames import clean_frame
from navstack.ros1 import private, ros

ALIASES: Final = ("base_footprint", "base_link")
"""Names of the base that drivers publish; what the parameters do not use is published as well, at the same place."""
VELOCITY_TOPICS: Final = ("cmd_vel", "mobile_base/mobile_base_controller/cmd_vel")
"""Default of `~cmd_vel_topics`: ROS's usual name, and that of the HandsFree base."""


class SimNames:
    """The frames and topics of one simulated robot.

    `tf_prefix`, searched from the node's namespace upwards, is put before the frames of the robot, not before that of the map:
    `robot1/odom`. `~odom_frame_id`, `~base_frame_id` and `~global_frame_id` rename the three main frames.
    """

    def __init__(self, map_frame: str, odom_frame: str, base_frame: str) -> None:
        """The frames by the parameters of the robot. Raises InputError for parameters of another type."""
        rospy = ros.rospy()
        found = rospy.search_param("tf_prefix")
        prefix = rospy.get_param(found) if found is not None else ""
        if not isinstance(prefix, str):
            raise InputError(f"the parameter {found} is {prefix!r}, not a text", parameter=found)
        self.prefix = prefix.strip("/")
        self._known: dict[str, str] = {
            clean_frame(map_frame): clean_frame(private.text("global_frame_id", map_frame)),
            clean_frame(odom_frame): self._prefixed(private.text("odom_frame_id", odom_frame)),
            clean_frame(base_frame): self._prefixed(private.text("base_frame_id", base_frame)),
        }
        self.map, self.odom, self.base = self._known.values()
        self.aliases = [
            name
            for name in map(self._prefixed, private.texts("base_aliases", ALIASES))
            if name not in self._known.values()
        ]
        """Further frames at the place of the base."""
        self.velocity_topics = private.texts("cmd_vel_topics", VELOCITY_TOPICS)

    def frame(self, name: str) -> str:
        """Return the frame on the graph for a frame of the simulator."""
        found = self._known.get(name)
        if found is None:
            found = self._known[name] = self._prefixed(name)
        return found

    def _prefixed(self, name: str) -> str:
        name = clean_frame(name)
        return f"{self.prefix}/{name}" if self.prefix and not name.startswith(f"{self.prefix}/") else name

    def rename(self, message: Any) -> Any:
        """Return a sensor's message with the frame of the graph in its header."""
        message.header.frame_id = self.frame(message.header.frame_id)
        return message
