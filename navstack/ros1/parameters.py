"""Parameters of the nodes: move_base's, from the parameter server with files on top, and private ones of helpers, checked."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Sequence
from typing import Any, Final, cast

from navstack.core import InputError, short_repr
from navstack.parameters import Configuration, DictNode, Location, load_configuration, to_node
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
"""Parameter `~` that shows a later start that the node has written its parameters to the server.

Its value lists the parameters that were read by a previous name: [path, previous name, current name, value] each.
"""


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
    written = values.pop(WRITTEN, False)
    if written:
        overlaid = bool(sources or overrides)
        _merge_renamed(values, written if isinstance(written, list) else [], overlaid=overlaid)
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


def renamed(configuration: Configuration) -> list[list[Any]]:
    """Return the parameters that were read by a previous name, as a list for `WRITTEN`."""
    found: list[list[Any]] = []
    for item in configuration.findings:
        if item.rule == "renamed" and item.severity == "info":
            path, _, old = item.key.rpartition("/")
            space = _namespace(configuration.tree.as_dict(), path)
            if space is not None and item.suggestion and old in space:
                found.append([path, old, item.suggestion, space[old]])
    return found


def _merge_renamed(values: dict[str, Any], written: list[Any], *, overlaid: bool) -> None:
    """Drop one of two names of a parameter: an earlier start has read the previous name, and written the current one.

    The previous name counts where it has been set again since, and where it is not on the server: then it was that of a file,
    which is read again if this start is `overlaid` by files. Both names of a parameter in a file are another matter: they are
    reported.
    """
    for path, old, new, value in written:
        space = _namespace(values, path)
        if space is None or new not in space:
            continue
        if old in space:
            del space[old if space[old] == value else new]
        elif overlaid:
            del space[new]


def _namespace(tree: dict[str, Any], path: str) -> dict[str, Any] | None:
    space: Any = tree
    for name in path.split("/") if path else ():
        space = space.get(name) if isinstance(space, dict) else None
    return space if isinstance(space, dict) else None


# --- private parameters (`~name`) of the helper nodes, checked --------------------------------------------------------


def number(name: str, default: float, *, positive: bool = False, low: float = -1e9, high: float = 1e9) -> float:
    """Return the number `~name` of `low` to `high`. Raises InputError for another value."""
    value = _value(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise _error(name, value, "a finite number")
    if positive and value <= 0.0:
        raise _error(name, value, "a positive number")
    if not low <= value <= high:
        raise _error(name, value, f"from {low:g} to {high:g}")
    return float(value)


def text(name: str, default: str) -> str:
    """Return the text `~name`. Raises InputError for another value, and for an empty one."""
    value = _value(name, default)
    if not isinstance(value, str) or not value.strip():
        raise _error(name, value, "a text")
    return value.strip()


def texts(name: str, default: Sequence[str]) -> list[str]:
    """Return the list of texts `~name`; one text counts as a list. Raises InputError for another value."""
    value = _value(name, list(default))
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list):
        raise _error(name, value, "a list of texts")
    listed = [str(item).strip() for item in cast("list[Any]", value) if isinstance(item, str)]
    if len(listed) != len(cast("list[Any]", value)) or not all(listed):
        raise _error(name, value, "a list of texts")
    return listed


def flag(name: str, default: bool) -> bool:
    """Return the switch `~name`. Raises InputError for another value."""
    value = _value(name, default)
    if not isinstance(value, (bool, int)):
        raise _error(name, value, "true or false")
    return bool(value)


def _value(name: str, default: Any) -> Any:
    """Return `~name`. A value that is on the server, but not on this command line, is named: it may be left over."""
    value = ros.rospy().get_param(f"~{name}", default)
    if value != default and not any(word.startswith(f"_{name}:=") for word in sys.argv):
        full = str(ros.rospy().resolve_name(f"~{name}"))
        logging.getLogger(ros.LOGGER).info(
            "%s is %s, not the default %s: a launch file or an earlier start has set it; rosparam delete %s removes it",
            full,
            short_repr(value),
            short_repr(default),
            full,
        )
    return value


def _error(name: str, value: Any, wanted: str) -> InputError:
    full = str(ros.rospy().resolve_name(f"~{name}"))
    return InputError(f"the parameter {full} is {short_repr(value)}, not {wanted}", parameter=full, value=value)
