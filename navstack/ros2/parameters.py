"""Parameters of the navigator: given by ROS at the start, declared, readable and settable while it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from navstack.bringup import reconfigure
from navstack.core import NavError
from navstack.move_base import MoveBase
from navstack.parameters import Configuration, DictNode, Location, Parameter, load_configuration, parameters_of, to_node
from navstack.ros2 import ros
from navstack.ros2.ros import RosNode, overrides_of
from navstack.ros_node import Inbox, line_of

OF_THE_NODE: Final = ("autostart", "enable_stamped_cmd_vel", "stop_on_failure", "odom_topic", "stamp_frame")
"""Parameters of the node's topics and actions, not of the stack."""


def load(node: RosNode, sources: Sequence[str], overrides: Sequence[str], *, distro: str | None) -> Configuration:
    """Return the configuration of the sources (`--params`), overlaid by the parameters that ROS gives to the node.

    `-p local_costmap.inflation_layer.inflation_radius:=0.4` is `local_costmap/inflation_layer/inflation_radius`. Raises
    ParameterError.
    """
    tree: dict[str, Any] = {}
    for name, value in overrides_of(node.handle).items():
        if name.partition(".")[0] not in OF_THE_NODE:
            set_in(tree, name, value)
    found = to_node(tree, Location("the parameters of ROS"))
    assert isinstance(found, DictNode)
    return load_configuration([*sources, found], overrides=overrides, distro=distro)


def set_in(tree: dict[str, Any], name: str, value: Any) -> None:
    """Set a value by its dotted name."""
    *parts, last = name.split(".")
    for part in parts:
        tree = tree.setdefault(part, {})
    tree[last] = list(value) if isinstance(value, (list, tuple)) or hasattr(value, "tolist") else value


def ros_value(parameter: Parameter) -> Any:
    """Return the value of a parameter as ROS holds it; None for one that ROS cannot hold."""
    value, is_float = parameter.value, "float" in str(parameter.info.annotation)
    if isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, float)):
        return float(value) if is_float else value
    if isinstance(value, (list, tuple)) and value:
        items = [float(v) if is_float and isinstance(v, int) and not isinstance(v, bool) else v for v in value]
        kinds = {type(v) for v in items}
        return items if len(kinds) == 1 and kinds <= {bool, int, float, str} else None
    return None


def reason_of(error: Exception) -> str:
    """Return why parameters are rejected, in one line: the values have no place in a file."""
    found: Any = error.data.get("findings", ()) if isinstance(error, NavError) else ()
    texts = [str(item["message"]) for item in found if item["severity"] == "error"]
    return "; ".join(texts) or line_of(getattr(error, "message", str(error)))


class LiveParameters:
    """The parameters of a running stack; a change is applied whole, or rejected with its reason."""

    def __init__(self, node: RosNode, configuration: Configuration, move_base: MoveBase, inbox: Inbox) -> None:
        self.configuration = configuration
        self._node, self._move_base, self._inbox = node, move_base, inbox
        self._names: set[str] = set()
        handle = node.handle
        descriptor = ros.message("rcl_interfaces/msg/ParameterDescriptor")
        for parameter in parameters_of(configuration):
            value, name = ros_value(parameter), parameter.name.replace("/", ".")
            if value is None:
                continue
            if handle.has_parameter(name):
                handle.undeclare_parameter(name)  # it may have another type: 1 for a number that may have decimals
            text = parameter.info.description or ""
            handle.declare_parameter(name, value, descriptor(description=text), ignore_override=True)
            self._names.add(name)
        handle.add_on_set_parameters_callback(self._on_set)

    def _on_set(self, parameters: Sequence[Any]) -> Any:
        """Apply changes of a client. Called in the thread of rclpy."""
        result = ros.message("rcl_interfaces/msg/SetParametersResult")(successful=True)
        fixed = next((item.name for item in parameters if item.name in OF_THE_NODE), None)
        if fixed is not None:
            result.successful = False
            result.reason = (
                f"{fixed} cannot change while the node runs; give it at the start: --ros-args -p {fixed}:=.."
            )
            return result
        changes = {item.name: item.value for item in parameters if item.name in self._names}
        if not changes:
            return result
        try:
            self._inbox.call(lambda: self.apply(changes))
        except (NavError, TimeoutError) as exc:
            result.successful = False
            result.reason = reason_of(exc)
        return result

    def apply(self, changes: Mapping[str, Any]) -> None:
        """Change parameters by their dotted names. Raises NavError, and nothing has changed."""
        overlay: dict[str, Any] = {}
        for name, value in changes.items():
            set_in(overlay, name, value)
        distro = self.configuration.navstack.ros_distro
        new = load_configuration([self.configuration.tree.as_dict(), overlay], distro=distro)
        reconfigure(self._move_base, new)
        self.configuration = new
