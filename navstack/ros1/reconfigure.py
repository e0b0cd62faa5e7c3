"""dynamic_reconfigure: a server per namespace of parameters, as move_base's plugins have them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from navstack.bringup import reconfigure
from navstack.core import NavError
from navstack.costmap import FIXED
from navstack.move_base import MoveBase
from navstack.parameters import Configuration, Parameter, load_configuration, parameters_of
from navstack.ros1 import ros
from navstack.ros1.parameters import WRITTEN, renamed
from navstack.ros_node import Inbox

LARGEST: Final = 1e9
"""Range of a number without one: clients draw a slider."""
LARGEST_INT: Final = 2**31 - 1
RESTORE: Final = "restore_defaults"
_KINDS: Final = {bool: "bool", int: "int", float: "double", str: "str"}
_LISTS: Final = {"bool": "bools", "int": "ints", "double": "doubles", "str": "strs"}


def kind_of(parameter: Parameter) -> str:
    """Return the type of a parameter as dynamic_reconfigure names it; empty for lists and dictionaries."""
    value, annotation = parameter.value, str(parameter.info.annotation)
    if isinstance(value, int) and not isinstance(value, bool) and "float" in annotation:
        return "double"
    return _KINDS.get(type(value), "")


class ReconfigureServers:
    """The servers of a running goal manager; changes are applied in the thread of the node."""

    def __init__(self, configuration: Configuration, move_base: MoveBase, inbox: Inbox) -> None:
        self.configuration = configuration
        self._first = configuration
        self._move_base = move_base
        grouped: dict[str, list[Parameter]] = {}
        for parameter in parameters_of(configuration):
            namespace, _, name = parameter.name.rpartition("/")
            if kind_of(parameter) and _is_live(name) and not namespace.startswith("navstack"):
                grouped.setdefault(namespace, []).append(parameter)
        wanted = _namespaces(configuration)
        self.servers = {
            namespace: self._server(namespace, parameters, inbox)
            for namespace, parameters in grouped.items()
            if namespace in wanted
        }
        self._write_mark()

    def _server(self, namespace: str, parameters: list[Parameter], inbox: Inbox) -> ReconfigureServer:
        prefix = f"{namespace}/" if namespace else ""

        def present() -> dict[str, Any]:
            found = {p.name: p.value for p in parameters_of(self.configuration)}
            return {name.removeprefix(prefix): value for name, value in found.items() if name.startswith(prefix)}

        def apply(values: Mapping[str, Any]) -> None:
            self.apply(namespace, values)

        return ReconfigureServer(f"~{prefix}", parameters, present, apply, inbox)

    def apply(self, namespace: str, values: Mapping[str, Any]) -> None:
        """Change parameters of one namespace. Raises NavError, and nothing has changed."""
        prefix = f"{namespace}/" if namespace else ""
        if values.get(RESTORE) is True:
            first = {p.name: p.value for p in parameters_of(self._first)}
            names = self.servers[namespace].names
            values = {name: first[f"{prefix}{name}"] for name in names if f"{prefix}{name}" in first}
        overlay: dict[str, Any] = {}
        for name, value in values.items():
            if name == RESTORE:
                continue
            node = overlay
            for part in namespace.split("/") if namespace else ():
                node = node.setdefault(part, {})
            node[name] = value
        distro = self.configuration.navstack.ros_distro
        new = load_configuration([self.configuration.tree.as_dict(), overlay], distro=distro)
        reconfigure(self._move_base, new)
        self.configuration = new

    def write(self) -> None:
        """Publish every configuration and write it to the parameter server: it is that of a new master."""
        for server in self.servers.values():
            server.publish()
        self._write_mark()

    def _write_mark(self) -> None:
        ros.rospy().set_param(f"~{WRITTEN}", renamed(self._first) or True)

    def value(self, name: str) -> Any:
        """Return the current value of a parameter by its full name."""
        return next(p.value for p in parameters_of(self.configuration) if p.name == name)


def _is_live(name: str) -> bool:
    """Return False for parameters that a running node cannot change, and for topics, which it reads once."""
    return name not in FIXED and not name.endswith("_topic")


def _namespaces(configuration: Configuration) -> set[str]:
    """Return the namespaces that have a server in ROS: the node, costmaps, layers, planners."""
    costmaps = {"global_costmap": configuration.global_costmap, "local_costmap": configuration.local_costmap}
    layers = {layer.namespace for costmap in costmaps.values() for layer in costmap.layers}
    planners = {configuration.global_planner.namespace, configuration.local_planner.namespace}
    return {"", *costmaps, *layers, *planners}


class ReconfigureServer:
    """The topics and the service of one namespace."""

    def __init__(
        self,
        own: str,
        parameters: list[Parameter],
        present: Callable[[], Mapping[str, Any]],
        apply: Callable[[Mapping[str, Any]], None],
        inbox: Inbox,
    ) -> None:
        """`own` is the beginning of its names: `~` or `~namespace/`.

        `present` returns the values by their short names, `apply` changes some of them, in the thread of the node, or raises
        NavError.
        """
        rospy = self._rospy = ros.rospy()
        self._own, self._present, self._apply = own, present, apply
        self._parameters = {parameter.name.rpartition("/")[2]: parameter for parameter in parameters}
        self.names = tuple(self._parameters)
        description, config = (
            ros.message("dynamic_reconfigure/ConfigDescription"),
            ros.message("dynamic_reconfigure/Config"),
        )
        self._description = rospy.Publisher(f"{own}parameter_descriptions", description, queue_size=1, latch=True)
        self._updates = rospy.Publisher(f"{own}parameter_updates", config, queue_size=1, latch=True)
        self._description.publish(self._describe())
        self.publish()
        service = ros.message("dynamic_reconfigure/srv/Reconfigure")
        self._service = rospy.Service(f"{own}set_parameters", service, inbox.caller(self._on_set))

    def _on_set(self, request: Any) -> Any:
        """Change what the request names; the answer is the whole configuration. Wrong values change nothing."""
        values: dict[str, Any] = {}
        for items in (request.config.bools, request.config.ints, request.config.strs, request.config.doubles):
            for item in items:
                parameter = self._parameters.get(item.name)
                if item.name == RESTORE:
                    values[RESTORE] = bool(item.value)
                elif parameter is None:
                    self._rospy.logerr("%s%s is not a parameter that can be changed", self._own, item.name)
                else:
                    values[item.name] = _clamped(parameter, item.value)
        try:
            self._apply(values)
        except NavError as exc:
            self._rospy.logerr("%s: %s", self._own, exc.message)
        return ros.message("dynamic_reconfigure/srv/ReconfigureResponse")(config=self.publish())

    def publish(self) -> Any:
        """Publish the configuration, write it to the parameter server, and return it."""
        now = self._present()
        values = {name: now.get(name, parameter.value) for name, parameter in self._parameters.items()}
        config = self._config(lambda name, parameter: values[name])
        self._updates.publish(config)
        for name, value in values.items():
            if not (isinstance(value, int) and abs(value) > LARGEST_INT):
                self._rospy.set_param(f"{self._own}{name}", value)
        return config

    def _config(self, value_of: Callable[[str, Parameter], Any]) -> Any:
        config = ros.message("dynamic_reconfigure/Config")()
        config.groups = [ros.message("dynamic_reconfigure/GroupState")(name="Default", state=True, id=0, parent=0)]
        config.bools = [ros.message("dynamic_reconfigure/BoolParameter")(name=RESTORE, value=False)]
        types = {"bool": "BoolParameter", "int": "IntParameter", "double": "DoubleParameter", "str": "StrParameter"}
        for name, parameter in self._parameters.items():
            kind = kind_of(parameter)
            message = ros.message(f"dynamic_reconfigure/{types[kind]}")
            getattr(config, _LISTS[kind]).append(message(name=name, value=_cast(kind, value_of(name, parameter))))
        return config

    def _describe(self) -> Any:
        description = ros.message("dynamic_reconfigure/ConfigDescription")()
        group = ros.message("dynamic_reconfigure/Group")(name="Default", type="", parent=0, id=0)
        item = ros.message("dynamic_reconfigure/ParamDescription")
        text = "Restore to the original configuration"
        group.parameters = [item(name=RESTORE, type="bool", level=0, description=text, edit_method="")]
        for name, parameter in self._parameters.items():
            meaning = str(parameter.info.description or "")
            group.parameters.append(
                item(name=name, type=kind_of(parameter), level=0, description=meaning, edit_method="")
            )
        description.groups = [group]
        description.min = self._config(lambda _, parameter: bounds_of(parameter)[0])
        description.max = self._config(lambda _, parameter: bounds_of(parameter)[1])
        description.dflt = self._config(lambda _, parameter: parameter.info.get_default(call_default_factory=False))
        return description


def bounds_of(parameter: Parameter) -> tuple[Any, Any]:
    """Return the smallest and the largest value: False and True, two empty texts, or the range of a number."""
    kind = kind_of(parameter)
    if kind == "bool":
        return False, True
    if kind == "str":
        return "", ""
    low, high = (-LARGEST, LARGEST) if kind == "double" else (-LARGEST_INT, LARGEST_INT)
    for constraint in parameter.info.metadata:
        low = max(
            low, *(getattr(constraint, key) for key in ("ge", "gt") if getattr(constraint, key, None) is not None), low
        )
        high = min(
            high,
            *(getattr(constraint, key) for key in ("le", "lt") if getattr(constraint, key, None) is not None),
            high,
        )
    return low, high


def _clamped(parameter: Parameter, value: Any) -> Any:
    """Return a value of the parameter's type, within its range, as dynamic_reconfigure does."""
    kind = kind_of(parameter)
    if kind in ("bool", "str"):
        return _cast(kind, value)
    low, high = bounds_of(parameter)
    number = float(value)
    if math.isnan(number):
        return value
    return _cast(kind, min(max(number, low), high))


def _cast(kind: str, value: Any) -> Any:
    if kind == "double":
        number = float(value) if isinstance(value, (int, float)) else 0.0
        return number if math.isfinite(number) else math.copysign(LARGEST, number)
    if kind == "int":
        return max(-LARGEST_INT, min(LARGEST_INT, int(value))) if isinstance(value, (int, float)) else 0
    return bool(value) if kind == "bool" else str(value) if isinstance(value, str) else ""
