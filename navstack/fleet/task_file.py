"""`tasks:` of a fleet file: a list of tasks, or what draws them, and how they are given to robots.

    tasks:
      assignment: auction                 # or nearest
      list:
        - {goal: shelf_a}
        - {name: urgent, stops: [shelf_b, packing], release: 20.0, priority: 1, deadline: 90.0, handling: 4.0}
      generate: {count: 30, interval: 6.0, pickup: [shelf_a, shelf_b], dropoff: [packing], handling: 4.0}
      charging: {threshold: 0.25, resume: 0.9, places: [charger]}

A list alone, `tasks: [{goal: shelf_a}]`, is `list:`. Stops are places, poses or nodes of the route graph.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from navstack.core import NavError, Pose2D, Transform2D
from navstack.docking import DockDatabase
from navstack.fleet.assignment import Stop, Task
from navstack.fleet.tasks import Charger, ChargingParams, TaskParams, TaskPlan
from navstack.parameters import Configuration, DictNode, ListNode, Node, ScalarNode
from navstack.plugins import ParamModel, param
from navstack.routes import RouteGraph
from navstack.scenario import ReadContext

_STREAM: Final = 0x7A51
"""Random stream of the tasks."""
_PARTS: Final = ("list", "generate", "charging")
_EXAMPLE: Final = "{stops: [PICKUP, DROPOFF]}"
_STOP: Final = "a place, a pose [x, y, yaw] or a node of the route graph"
_SYNONYMS: Final = {"deadline_s": "deadline", "from": "pickup", "to": "dropoff", "goals": "stops", "drop": "dropoff"}
_REACH_M: Final = 0.3
"""A robot whose center is this near to a charging place is charged."""


class _Timing(ParamModel):
    priority: float = param(0.0, "higher goes first")
    deadline: float | None = param(None, "time allowed after the release; none: any", unit="s", gt=0.0)
    handling: float = param(0.0, "time that the robot stands at each stop", unit="s", ge=0.0, le=1e6)


class _TaskValues(_Timing):
    release: float = param(0.0, "time from which on the task may be given to a robot", unit="s", ge=0.0, le=1e7)


class _Generator(_Timing):
    count: int = param(..., "number of tasks", ge=1, le=10_000)
    interval: float = param(
        0.0, "mean time between two releases, drawn as of a Poisson process", unit="s", ge=0.0, le=1e6
    )
    begin: float = param(0.0, "release of the first task", unit="s", ge=0.0, le=1e7)


@dataclass(slots=True, eq=False)
class TaskSpec:
    """`tasks:` of a file; `build` draws what is drawn, by the seed."""

    listed: list[Task] = field(default_factory=list[Task])
    params: TaskParams = field(default_factory=TaskParams)
    charging: ChargingParams = field(default_factory=ChargingParams)
    chargers: list[Charger] = field(default_factory=list[Charger])
    generator: _Generator | None = None
    pickups: tuple[Stop, ...] = ()
    dropoffs: tuple[Stop, ...] = ()

    def build(self, seed: int, configuration: Configuration) -> TaskPlan:
        """Return the plan for a seed of the fleet; its docks are those of the configuration. Raises DockNotInDatabaseError."""
        docks = DockDatabase.of(configuration)
        chargers = (
            replace(charger, stop=docks.dock(charger.name).pose) if charger.dock else charger
            for charger in self.chargers
        )
        return TaskPlan((*self.listed, *self._drawn(seed)), self.params, self.charging, tuple(chargers))

    def _drawn(self, seed: int) -> list[Task]:
        made = self.generator
        if made is None:
            return []
        random = np.random.Generator(np.random.PCG64([seed, _STREAM]))
        release, tasks, digits = made.begin, list[Task](), len(str(made.count))
        for number in range(1, made.count + 1):
            pickup = self.pickups[int(random.integers(len(self.pickups)))]
            others = [stop for stop in self.dropoffs if stop != pickup] or list(self.dropoffs)
            stops = (pickup, others[int(random.integers(len(others)))]) if others else (pickup,)
            name = f"task_{number:0{digits}}"
            tasks.append(Task(name, stops, release, made.priority, made.deadline, made.handling))
            release += float(random.exponential(made.interval)) if made.interval > 0.0 else 0.0
        return tasks

    def charging_places(self, configuration: Configuration, graph: RouteGraph | None) -> dict[str, Any] | None:
        """Return the parameters of simulated chargers at the charging places that are no docks; None without any."""
        places = [charger for charger in self.chargers if not charger.dock]
        if not places:
            return None
        sim: dict[str, Any] = {"docks": [*configuration.navstack.sim.docks, *(place.name for place in places)]}
        depth = 0.4 * _REACH_M
        for place in places:
            stop = place.stop
            if not isinstance(stop, Pose2D):
                assert graph is not None
                x, y = graph.xy[graph.node(stop)].tolist()
                stop = Pose2D(x, y, 0.0)
            # contacts meet from one depth before to four behind the pose of a dock: moved back, as far before as behind
            at = Transform2D(*stop).apply(Pose2D(-1.5 * depth, 0.0, 0.0))
            contacts = {"contact_depth": depth, "contact_width": _REACH_M, "contact_angle": 4.0}
            sim[place.name] = {"pose": list(at), "body": "none", "has_marker": False, **contacts}
        return {"navstack": {"sim": sim}}


def read_tasks(context: ReadContext, graph: RouteGraph | None, *, guided: bool) -> TaskSpec | None:
    """Read `tasks:`; errors go into the findings. `guided`: a traffic rule drives the robots along the graph."""
    node = context.section("tasks")
    if node is None:
        return None
    if isinstance(node, ListNode):
        node = DictNode({"list": (node.at, node)}, node.at)
    if not isinstance(node, DictNode):
        context.type_error(node, "tasks", f"a list, for example [{_EXAMPLE}], or list: or generate: below it")
        return None
    reader = _Reader(context, graph, guided)
    context.check_keys(node, (*_PARTS, *TaskParams.model_fields), "tasks")
    others = {key: value for key, value in node.items.items() if key in TaskParams.model_fields}
    spec = TaskSpec()
    spec.params = context.bind(TaskParams, DictNode(others, node.at), "tasks") or spec.params
    if "list" in node.items:
        reader.read_list(node.items["list"][1], spec)
    if "generate" in node.items:
        reader.read_generator(node.items["generate"][1], spec)
    if "charging" in node.items:
        reader.read_charging(node.items["charging"][1], spec)
    if "list" not in node.items and "generate" not in node.items:
        message = "tasks has neither a list nor generate; add one, for example list: [" + _EXAMPLE + "]"
        context.error("missing", node.at, "tasks", message)
    return spec


class _Reader:
    """Reads the parts of `tasks:`."""

    def __init__(self, context: ReadContext, graph: RouteGraph | None, guided: bool) -> None:
        self._context, self._graph, self._guided = context, graph, guided

    def read_list(self, node: Node, spec: TaskSpec) -> None:
        if not isinstance(node, ListNode):
            self._context.type_error(node, "tasks", f"a list, for example [{_EXAMPLE}]")
            return
        seen: dict[str, int] = {}
        digits = len(str(len(node.items)))
        for number, item in enumerate(node.items, 1):
            task = self._task(item, number, f"task_{number:0{digits}}")
            if task is None:
                continue
            if task.name in seen:
                message = f'tasks {seen[task.name]} and {number} have the name "{task.name}"; give each its own'
                self._context.error("duplicated", item.at, "name", message)
            seen[task.name] = number
            spec.listed.append(task)

    def _task(self, node: Node, number: int, name: str) -> Task | None:
        context, owner = self._context, f"task {number}"
        if not isinstance(node, DictNode):
            context.type_error(node, owner, f"a mapping, for example {_EXAMPLE}")
            return None
        context.check_keys(node, ("name", "goal", "stops", *_TaskValues.model_fields), owner, _SYNONYMS)
        if "name" in node.items:
            name = context.text(node.items["name"][1], "name", "the name of the task") or name
        given = [key for key in ("goal", "stops") if key in node.items]
        if len(given) != 1:
            both = "both goal and stops; remove one of them" if given else "no stops; add goal: PLACE or stops: [..]"
            context.error("missing", node.at, owner, f"{owner} has {both}")
            return None
        at = node.items[given[0]][1]
        stops = self._stops(at, owner) if given[0] == "stops" else self._stops(ListNode([at], at.at), owner)
        values = {key: value for key, value in node.items.items() if key in _TaskValues.model_fields}
        bound = context.bind(_TaskValues, DictNode(values, node.at), owner)
        if bound is None or not stops:
            return None
        return Task(name, stops, bound.release, bound.priority, bound.deadline, bound.handling)

    def read_generator(self, node: Node, spec: TaskSpec) -> None:
        context = self._context
        if not isinstance(node, DictNode):
            context.type_error(node, "generate", "count:, interval:, pickup: and dropoff: below it")
            return
        context.check_keys(node, ("pickup", "dropoff", *_Generator.model_fields), "generate", _SYNONYMS)
        values = {key: value for key, value in node.items.items() if key in _Generator.model_fields}
        bound = context.bind(_Generator, DictNode(values, node.at), "generate")
        if "pickup" not in node.items:
            context.error("missing", node.at, "pickup", "generate has no pickup; add `pickup: [..]`, a list of places")
            return
        spec.pickups = self._stops(node.items["pickup"][1], "pickup")
        if "dropoff" in node.items:
            spec.dropoffs = self._stops(node.items["dropoff"][1], "dropoff")
        spec.generator = bound if spec.pickups else None

    def read_charging(self, node: Node, spec: TaskSpec) -> None:
        context = self._context
        if not isinstance(node, DictNode):
            context.type_error(node, "charging", "threshold:, resume: and places: or docks: below it")
            return
        context.check_keys(node, ("places", "docks", *ChargingParams.model_fields), "charging")
        values = {key: value for key, value in node.items.items() if key in ChargingParams.model_fields}
        bound = context.bind(ChargingParams, DictNode(values, node.at), "charging")
        spec.charging = bound or spec.charging
        if bound is not None and bound.resume <= bound.threshold:
            message = f"resume {bound.resume:g} is not above threshold {bound.threshold:g}; raise it"
            context.error("wrong-value", node.at, "charging", message)
        if "places" not in node.items and "docks" not in node.items:
            message = "charging has no chargers; add `places: [..]`, or `docks: [..]` of the docking server"
            context.error("missing", node.at, "charging", message)
        if "places" in node.items:
            at = node.items["places"][1]
            for number, stop in enumerate(self._stops(at, "charging place"), 1):
                spec.chargers.append(Charger(f"charger_{number}", stop))
        if "docks" in node.items:
            self._read_docks(node.items["docks"][1], spec)

    def _read_docks(self, node: Node, spec: TaskSpec) -> None:
        names = node.items if isinstance(node, ListNode) else [node]
        if self._guided:
            message = (
                "robots that a traffic rule guides leave the graph for no dock; name nodes of the graph under places"
            )
            self._context.error("wrong-value", node.at, "docks", message)
            return
        for item in names:
            name = self._context.text(item, "dock", "the name of a dock of the docking server")
            if name is not None:  # its pose is that of the robots' database, see `FleetSpec.build`
                spec.chargers.append(Charger(name, Pose2D(0.0, 0.0, 0.0), dock=True))

    def _stops(self, node: Node, owner: str) -> tuple[Stop, ...]:
        if not isinstance(node, ListNode) or not node.items:
            self._context.type_error(node, owner, f"a list of stops; each is {_STOP}")
            return ()
        stops = [self._stop(item, f"stop {number} of {owner}") for number, item in enumerate(node.items, 1)]
        return tuple(stop for stop in stops if stop is not None) if None not in stops else ()

    def _stop(self, node: Node, name: str) -> Stop | None:
        context = self._context
        if isinstance(node, ScalarNode) and type(node.value) is int:
            if self._graph is None:
                message = (
                    f"{name} is the node {node.value}, but there is no graph; add `traffic: {{graph: FILE.geojson}}`"
                )
                context.error("missing", node.at, name, message)
                return None
            try:
                self._graph.node(node.value)
            except NavError as exc:
                context.error("unknown", node.at, name, f"{name}: {exc.message}")
                return None
            return node.value
        pose = context.pose(node, name)
        if pose is not None and self._guided:
            message = (
                f"{name} is no node of the route graph, on which the traffic rule guides the robots; write its number"
            )
            context.error("wrong-value", node.at, name, message)
            return None
        return pose
