"""The parameters of the node amcl: those of the filter, and those of its topics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final, NamedTuple

from navstack.core.errors import ParameterError
from navstack.core.parameters import param
from navstack.parameters.binding import Binder
from navstack.parameters.configuration import load_configuration
from navstack.parameters.findings import Finding, Location
from navstack.parameters.models.amcl import AmclParams
from navstack.parameters.safety_sections import unwrap_ros2
from navstack.parameters.sources import to_node
from navstack.parameters.tree import Space
from navstack.parameters.yaml_reader import DictNode
from navstack.ros1 import ros

SECTION: Final = "amcl"
_TOPICS: Final = (
    *("use_map_topic", "first_map_only", "save_pose_rate", "tf_broadcast", "transform_tolerance"),
    *("std_warn_level_x", "std_warn_level_y", "std_warn_level_yaw"),
)


class AmclNodeParams(AmclParams):
    """`~` of the node amcl, with the names and defaults of noetic."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        name: reason for name, reason in AmclParams.NO_EFFECT.items() if name not in _TOPICS
    }

    use_map_topic: bool = param(
        False, "receive the map on the topic map instead of asking the service static_map for it"
    )
    first_map_only: bool = param(False, "later maps of the topic are ignored")
    save_pose_rate: float = param(
        0.5,
        "frequency of writing the pose to ~initial_pose_* and ~initial_cov_*; 0 or less = never",
        unit="Hz",
        le=10.0,
    )
    tf_broadcast: bool = param(True, "publish map -> odom")
    transform_tolerance: float = param(
        0.1, "time by which map -> odom is stamped ahead of its scan", unit="s", ge=0.0, le=2.0
    )
    std_warn_level_x: float = param(0.2, "standard deviation of x that is a warning on /diagnostics", unit="m", ge=0.0)
    std_warn_level_y: float = param(0.2, "standard deviation of y that is a warning on /diagnostics", unit="m", ge=0.0)
    std_warn_level_yaw: float = param(
        0.1, "standard deviation of the heading that is a warning on /diagnostics", unit="rad", ge=0.0
    )


class AmclConfiguration(NamedTuple):
    """The parameters, and what they were read from."""

    params: AmclNodeParams
    tree: Mapping[str, Any]
    """The values as written, below `amcl`."""
    findings: tuple[Finding, ...]
    """Warnings and infos."""


def load(sources: Sequence[Any] = (), overrides: Sequence[str] = ()) -> AmclConfiguration:
    """Return the parameters of the node's private namespace, overlaid by the section `amcl` of the sources (`--params`).

    Raises ParameterError.
    """
    rospy = ros.rospy()
    tree: Any = rospy.get_param("~", {})
    values = {name: value for name, value in tree.items() if name != SECTION} if isinstance(tree, dict) else {}
    return bind(values, str(rospy.resolve_name("~")), sources, overrides)


def bind(
    values: Mapping[str, Any], private: str = "~", sources: Sequence[Any] = (), overrides: Sequence[str] = ()
) -> AmclConfiguration:
    """Return the parameters of these values. Raises ParameterError."""
    node = to_node({SECTION: dict(values)}, Location(f"the parameter server, {private}"))
    assert isinstance(node, DictNode)
    whole = load_configuration([node, *sources], overrides=overrides)
    space = whole.tree.space(SECTION) or Space(SECTION, Location(""), whole.tree)
    findings: list[Finding] = []
    unwrap_ros2(space, findings)
    params = Binder(findings, {}).bind(AmclNodeParams, space)
    errors = [f"{item.location}: {item.message}" for item in findings if item.severity == "error"]
    if params is None or errors:
        raise ParameterError("the parameters of amcl cannot be used:\n" + "\n".join(errors))
    own = {f"{SECTION}/{name}" for name in _TOPICS}
    reported = tuple(item for item in whole.findings if item.key.startswith(f"{SECTION}/") and item.key not in own)
    assert isinstance(params, AmclNodeParams)
    return AmclConfiguration(params, space.as_dict(), reported)
