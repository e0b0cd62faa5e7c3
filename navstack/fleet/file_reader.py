"""Fleet files: scenario files with several robots.

    map: office                           # map, places, shapes and settings: as in a scenario file
    params: turtlebot                     # of every robot that has none of its own
    seed: 1
    robots:
      - {name: east, start: corridor_west, goals: [corridor_east]}
      - {name: west, start: corridor_east, goals: [corridor_west], params: jackal_dwa, priority: 2}
      - {name: guided, start: [6.0, 7.4, 0.0], route: [4, 17]}     # nodes of the graph, instead of goals or a tour
    traffic: {graph: lanes.geojson, rule: reservation, ahead: 4.0}
    communication: {delay: 0.1, dropout: 0.05}
    faults:
      - {time: 20.0, robot: west, kind: dies}                      # or lost, pushed, silent
    tasks: [{stops: [office_1, office_2]}]                         # for robots with nothing else to do, see `task_file`

A robot has the keys of a scenario that are its own; its `set` and `sim` override those of the file.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import shapely
from pydantic import ValidationError

from navstack.bringup import true_footprint
from navstack.core import NavError, short_repr
from navstack.fleet.fleet import FAULT, FAULT_KINDS, Fleet, FleetRobot, robot_seed
from navstack.fleet.recognition import shipped_fleets
from navstack.fleet.task_file import TaskSpec, read_tasks
from navstack.parameters import (
    Configuration,
    DictNode,
    Finding,
    ListNode,
    Location,
    Node,
    ScalarNode,
    Source,
    finding,
    in_order,
    load_configuration,
    nearest,
    plain,
)
from navstack.plugins import ParamModel, param
from navstack.routes import RouteGraph, load_graph
from navstack.scenario import ReadContext, Scenario, ScenarioSpec, check_start_on_map, read_part, scenario_error
from navstack.sim import PedestrianMotion
from navstack.traffic import RULES, TrafficParams

SHARED: Final = (
    *("name", "description", "map", "places", "params", "set", "sim", "shapes", "seed", "time_limit", "pause"),
    *("stop_on_failure", "pass_through", "distro", "allow_missing", "success", "low_battery"),
)
"""Keys of a fleet file that are those of a scenario."""
OWN: Final = (
    *("params", "set", "sim", "start", "goals", "tour", "time_limit", "pause", "stop_on_failure", "pass_through"),
    *("success", "low_battery"),
)
"""Keys of a robot that are those of a scenario."""
_ROBOT_KEYS: Final = ("name", *OWN, "route", "priority")
_KEYS: Final = (*SHARED, "robots", "traffic", "communication", "faults", "tasks")
_SYNONYMS: Final = {"obstacles": "shapes", "fleet": "robots", "agents": "robots", "rule": "traffic", "graph": "traffic"}
_ROBOT_SYNONYMS: Final = {"id": "name", "robot": "params", "goal": "goals", "pose": "start", "nodes": "route"}
_EXAMPLE: Final = "{name: robot_1, start: [1.0, 2.0, 0.0], goals: [[5.0, 2.0, 0.0]]}"


class _Communication(ParamModel):
    delay: float = param(0.0, "time that a message takes", unit="s", ge=0.0)
    dropout: float = param(0.0, "share of the messages that are lost", ge=0.0, le=1.0)


@dataclass(slots=True, eq=False)
class RobotSpec:
    """A robot of a fleet file."""

    name: str
    at: Location
    spec: ScenarioSpec
    priority: float = 0.0
    route: tuple[int, ...] = ()


@dataclass(slots=True, eq=False)
class FleetSpec:
    """A fleet whose parameters are still open: read from a file. `build` creates the fleet and may be called repeatedly."""

    path: Path
    name: str = ""
    description: str = ""
    seed: int = 0
    robots: list[RobotSpec] = field(default_factory=list[RobotSpec])
    traffic: dict[str, Any] = field(default_factory=dict[str, Any])
    graph: RouteGraph | None = None
    faults: tuple[Any, ...] = ()
    tasks: TaskSpec | None = None

    def build(
        self,
        *,
        params: Sequence[Source] | None = None,
        overrides: Sequence[str] = (),
        seed: int | None = None,
        time_limit_s: float | None = None,
        distro: str | None = None,
        allow_missing: bool = False,
    ) -> Fleet:
        """Build the fleet; the arguments replace the values of the file for all robots, as those of `ScenarioSpec.build`.

        Raises MapError, ParameterError, InputError, or ScenarioError for a robot in a wall and for starts that overlap.
        """
        seed = self.seed if seed is None else seed
        loaded: dict[str, Configuration] = {}
        made: list[Scenario] = []
        for robot in self.robots:
            sources = [*(robot.spec.sources if params is None else params), *robot.spec.overlays]
            key = repr([plain(s) if isinstance(s, (DictNode, ListNode, ScalarNode)) else s for s in sources])
            if key not in loaded:
                given = distro or robot.spec.distro, allow_missing or robot.spec.allow_missing
                options: dict[str, Any] = {"overrides": overrides, "distro": given[0], "allow_missing": given[1]}
                loaded[key] = load_configuration(sources, **options)
                chargers = None if self.tasks is None else self.tasks.charging_places(loaded[key], self.graph)
                if chargers is not None:
                    loaded[key] = load_configuration([*sources, chargers], **options)
            scenario = robot.spec.build(
                params=params,
                overrides=overrides,
                seed=robot_seed(seed, robot.name),
                time_limit_s=time_limit_s,
                configuration=loaded[key],
            )
            robot.spec.check_start(scenario)
            made.append(replace(scenario, name=robot.name))
        overlapping = self._overlaps(made)
        if overlapping:
            raise scenario_error(overlapping)
        robots = [
            FleetRobot(robot.name, scenario, robot.priority, robot.route)
            for robot, scenario in zip(self.robots, made, strict=True)
        ]
        tasks = None if self.tasks is None else self.tasks.build(seed, robots[0].scenario.configuration)
        return Fleet(tuple(robots), seed, self.name or self.path.stem, self.faults, self.traffic, self.graph, tasks)

    def _overlaps(self, scenarios: Sequence[Scenario]) -> list[Finding]:
        """Return an error for each robot that overlaps an earlier one at the start."""
        outlines = [shapely.Polygon(true_footprint(s.configuration).at(s.start)) for s in scenarios]
        found: list[Finding] = []
        for (a, one), (b, other) in itertools.combinations(zip(self.robots, outlines, strict=True), 2):
            if one.intersects(other):
                message = f"{b.name} overlaps {a.name} at the start; move one of them"
                found.append(finding("error", "start", b.spec.start_location, "start", message))
        return found


def read_fleet(path: str | Path, shown: str | None = None) -> FleetSpec:
    """Read a fleet file; `shown` is its name in messages.

    Raises ScenarioError for an invalid file: its message has one line per error, its `data["findings"]` lists all of them.
    """
    spec, findings = _read(Path(path), shown)
    errors = [f for f in in_order(findings) if f.severity == "error"]
    if errors:
        raise scenario_error(errors)
    return spec


def load_fleet(path: str | Path, **overrides: Any) -> Fleet:
    """Read a fleet file, or a packaged fleet by its name, and build it; `overrides`: the arguments of `FleetSpec.build`.

    Raises ScenarioError for the file, ParameterError for the parameters, MapError for the map.
    """
    file = shipped_fleets().get(str(path), Path(path))
    return read_fleet(file).build(**overrides)


def check_fleet(path: str | Path) -> list[Finding]:
    """Check a fleet file, the starts of its robots and their parameters; return all findings, ordered by file and line."""
    spec, findings = _read(Path(path), None)
    if not any(f.severity == "error" for f in findings):
        try:
            fleet = spec.build()
        except NavError as exc:
            found: Any = exc.data.get("findings")
            if not found:
                return in_order([*findings, finding("error", "fleet", Location(str(path)), "", exc.message)])
            return in_order([*findings, *(Finding(**f) for f in found)])
        for configuration in {id(r.scenario.configuration): r.scenario.configuration for r in fleet.robots}.values():
            findings += configuration.findings
    return in_order(_unique(findings))


# --- the file ---------------------------------------------------------------------------------------------------------


def _read(path: Path, shown: str | None) -> tuple[FleetSpec, list[Finding]]:
    context = ReadContext(path, shown)
    spec = FleetSpec(path)
    if not context.readable:
        return spec, context.findings
    root = context.root
    context.check_keys(root, _KEYS, "a fleet", _SYNONYMS)
    robots = context.section("robots")
    if not isinstance(robots, ListNode) or not robots.items:
        at = context.root.at if robots is None else robots.at
        context.error("wrong-type", at, "robots", f"robots is not a list of robots; write - {_EXAMPLE}")
        return spec, context.findings
    shared = {key: root.items[key] for key in SHARED if key in root.items}
    for number, node in enumerate(robots.items, 1):
        robot = _read_robot(context, node, number, shared)
        if robot is not None:
            spec.robots.append(robot)
    _check_names(context, spec.robots)
    if spec.robots:
        first = spec.robots[0].spec
        spec.seed, spec.description = first.values.get("seed", 0), first.description
        spec.name = str(first.values.get("name") or "")
        if any(isinstance(shape.motion, PedestrianMotion) for shape in first.shapes):
            message = "pedestrians walk among a single robot only; let them walk on tracks, or replay them"
            context.error("wrong-value", root.items["shapes"][0], "shapes", message)
    _read_traffic(context, spec)
    _read_faults(context, spec)
    if spec.robots:
        context.spec.places = spec.robots[0].spec.places
        spec.tasks = read_tasks(context, spec.graph, guided=spec.traffic.get("rule", "none") != "none")
    return spec, _unique(context.findings)


def _unique(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings without repetitions: every robot reads what it shares with the others."""
    return list({(str(f.location), f.message): f for f in findings}.values())


def _read_robot(
    context: ReadContext, node: Node, number: int, shared: Mapping[str, tuple[Location, Node]]
) -> RobotSpec | None:
    if not isinstance(node, DictNode):
        context.type_error(node, f"robot {number}", f"a mapping, for example {_EXAMPLE}")
        return None
    context.check_keys(node, _ROBOT_KEYS, f"robot {number}", _ROBOT_SYNONYMS)
    name = f"robot_{number}"
    if "name" in node.items:
        name = context.text(node.items["name"][1], "name", "the name of the robot") or name
    if Path(name).name != name or name in (".", ".."):
        message = f'the name "{name}" cannot be the name of a folder; use letters, digits, "_" and "-"'
        context.error("wrong-value", node.items["name"][1].at, "name", message)
    items = {**shared, **{key: node.items[key] for key in OWN if key in node.items}}
    for key in ("set", "sim"):
        both = [part.items[key][1] for part in (context.root, node) if key in part.items]
        if len(both) == 2 and all(isinstance(each, DictNode) for each in both):
            merged = {k: v for each in both if isinstance(each, DictNode) for k, v in each.items.items()}
            items[key] = node.items[key][0], DictNode(merged, both[1].at)
    part = read_part(context.path, context.shown, DictNode(items, node.at))
    context.findings += part.findings
    found = RobotSpec(name, node.at, part.spec)
    if part.spec.map_file is not None and not any(f.severity == "error" for f in part.findings):
        context.findings += check_start_on_map(part.spec, part.spec.map())
    if "priority" in node.items:
        value = plain(node.items["priority"][1])
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            context.type_error(node.items["priority"][1], "priority", "a number; higher goes first")
        else:
            found.priority = float(value)
    if "route" in node.items:
        found.route = _read_route(context, node)
    return found


def _read_route(context: ReadContext, node: DictNode) -> tuple[int, ...]:
    at, route = node.items["route"]
    others = [key for key in ("goals", "tour") if key in node.items]
    if others:
        context.error("wrong-value", at, "route", f"the robot has both a route and {others[0]}; remove one of them")
    nodes: Any = plain(route)
    if not isinstance(nodes, list) or not nodes or not all(type(n) is int for n in nodes):
        context.type_error(route, "route", "a list of node ids of the graph, for example [4, 17]")
        return ()
    return tuple(nodes)


def _check_names(context: ReadContext, robots: Sequence[RobotSpec]) -> None:
    seen = set[str]()
    for robot in robots:
        if robot.name in seen:
            context.error("duplicated", robot.at, "name", f'two robots have the name "{robot.name}"; give each its own')
        seen.add(robot.name)


def _read_traffic(context: ReadContext, spec: FleetSpec) -> None:
    node = context.mapping(
        "traffic", "graph: and rule: below it, for example {graph: lanes.geojson, rule: reservation}"
    )
    link = context.mapping("communication", "delay: and dropout: below it")
    routed = [robot for robot in spec.robots if robot.route]
    if node is None:
        if routed:
            message = f"{routed[0].name} has a route, but there is no graph; add `traffic: {{graph: FILE.geojson}}`"
            context.error("missing", routed[0].at, "route", message)
        return
    context.check_keys(node, ("graph", "rule", *TrafficParams.model_fields), "traffic")
    rule = "none"
    if "rule" in node.items:
        rule = context.text(node.items["rule"][1], "rule", f"one of {', '.join(RULES)}") or rule
        if rule not in RULES:
            close = nearest(rule, RULES)
            hint = f"did you mean {close}?" if close else f"rules: {', '.join(RULES)}"
            context.error("unknown", node.items["rule"][1].at, "rule", f'rule "{rule}" is unknown; {hint}', close)
            return
    others = {key: value for key, value in node.items.items() if key in TrafficParams.model_fields}
    params = context.bind(TrafficParams, DictNode(others, node.at), "traffic")
    spec.traffic = {"rule": rule, "params": {} if params is None else params.model_dump(mode="json")}
    if link is not None:
        context.check_keys(link, _Communication.model_fields, "communication")
        bound = context.bind(_Communication, link, "communication")
        if bound is not None:
            spec.traffic |= {"delay": bound.delay, "dropout": bound.dropout}
    if "graph" in node.items:
        spec.graph = _read_graph(context, node.items["graph"][1])
    elif rule != "none" or routed:
        context.error(
            "missing", node.at, "graph", "traffic has no graph; add `graph: FILE.geojson`, relative to this file"
        )
    for robot in spec.robots:
        if robot.route and spec.graph is not None:
            _check_route(context, robot, spec.graph)
        elif not robot.route and rule != "none" and (robot.spec.goals or robot.spec.steps):
            message = f"{robot.name} has goals, and the rule {rule} guides robots with a route; give it a route"
            context.error("wrong-value", robot.at, "route", message)


def _check_route(context: ReadContext, robot: RobotSpec, graph: RouteGraph) -> None:
    for node in robot.route:
        try:
            graph.node(node)
        except NavError as exc:
            context.error("unknown", robot.at, "route", f"the route of {robot.name}: {exc.message}")


def _read_graph(context: ReadContext, node: Node) -> RouteGraph | None:
    text = context.text(node, "graph", "the GeoJSON file of a route graph, relative to this file")
    if text is None:
        return None
    try:
        return load_graph(context.resolve(text))
    except NavError as exc:
        context.error("no-source", node.at, "graph", exc.message)
        return None


def _read_faults(context: ReadContext, spec: FleetSpec) -> None:
    node = context.section("faults")
    if node is None:
        return
    example = "{time: 10.0, robot: NAME, kind: dies}"
    if not isinstance(node, ListNode):
        context.type_error(node, "faults", f"a list, for example {example}")
        return
    names, made = [robot.name for robot in spec.robots], list[Any]()
    for number, item in enumerate(node.items, 1):
        if not isinstance(item, DictNode) or plain(item).get("kind") not in FAULT_KINDS:
            kinds = ", ".join(FAULT_KINDS)
            message = f"fault {number} has no known kind ({kinds}); write for example {example}"
            context.error("wrong-value", item.at, "faults", message)
            continue
        try:
            fault = FAULT.validate_python(plain(item))
        except ValidationError as exc:
            for error in exc.errors(include_url=False, include_context=False)[:5]:
                where = ".".join(str(step) for step in error["loc"][1:])
                what = f" = {short_repr(error['input'])}" if error["type"] != "missing" else ""
                context.error("wrong-value", item.at, "faults", f"fault {number}: {where}{what}: {error['msg']}")
            continue
        if fault.robot not in names:
            close = nearest(fault.robot, names)
            hint = f"did you mean {close}?" if close else f"robots: {', '.join(names)}"
            context.error(
                "unknown", item.at, "faults", f'fault {number}: there is no robot "{fault.robot}"; {hint}', close
            )
            continue
        made.append(fault)
    spec.faults = tuple(made)
