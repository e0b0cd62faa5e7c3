"""A fleet: the robots of one world, what each does, what goes wrong, and the rules of their traffic."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Final, Literal

from pydantic import Field, TypeAdapter, ValidationError

from navstack.core import InputError, RecordError, short_repr
from navstack.fleet.tasks import TaskPlan
from navstack.plugins import ParamModel, param
from navstack.record import Record
from navstack.routes import RouteGraph, graph_text, parse_graph
from navstack.scenario import Scenario
from navstack.sim import Shape, World

Numbers = Annotated[list[float], Field(min_length=3, max_length=3)]


class _Fault(ParamModel):
    time: float = param(..., "simulated time", unit="s", ge=0.0, le=1e7)
    robot: str = param(..., "name of the robot")


class Dies(_Fault):
    """The robot stops for good: it commands nothing, says nothing, and stands in the way."""

    kind: Literal["dies"] = param("dies", "the robot stops for good")


class LosesLocalization(_Fault):
    """The robot believes to be elsewhere than it is."""

    kind: Literal["lost"] = param("lost", "the robot believes to be elsewhere")
    offset: Numbers = param(..., "[x, y, yaw] from where it is to where it believes to be, in its frame", unit="m, rad")


class Pushed(_Fault):
    """The robot is pushed aside, as far as nothing is in the way; its odometry does not notice."""

    kind: Literal["pushed"] = param("pushed", "the robot is pushed aside")
    by: Numbers = param(..., "[x, y, yaw] in its frame", unit="m, rad")


class Silent(_Fault):
    """The robot neither sends nor receives messages of the traffic control."""

    kind: Literal["silent"] = param("silent", "the robot's messages are lost")
    until: float = param(..., "time at which they arrive again", unit="s", ge=0.0, le=1e7)


Fault = Annotated[Dies | LosesLocalization | Pushed | Silent, Field(discriminator="kind")]
FAULT: Final[TypeAdapter[Any]] = TypeAdapter(Fault)
FAULT_KINDS: Final = ("dies", "lost", "pushed", "silent")


@dataclass(frozen=True, slots=True)
class FleetRobot:
    """One robot of a fleet."""

    name: str
    scenario: Scenario
    """Its parameters, start and goals. Map and obstacles are those of the first robot."""
    priority: float = 0.0
    """Higher goes first, where a traffic rule decides."""
    route: tuple[int, ...] = ()
    """Ids of the nodes of the route graph to visit in order, instead of goals."""

    @property
    def seed(self) -> int:
        """The seed of its noise."""
        return self.scenario.seed


@dataclass(frozen=True, slots=True)
class Fleet:
    """Everything that determines a run of several robots in one world. The order of `robots` does not matter."""

    robots: tuple[FleetRobot, ...]
    seed: int = 0
    name: str = ""
    faults: tuple[Any, ...] = ()
    """Models of `Dies`, `LosesLocalization`, `Pushed` and `Silent`."""
    traffic: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """The rule of the traffic and its parameters: the section `traffic:` of a file without the graph."""
    graph: RouteGraph | None = None
    """What the robots with a route drive on."""
    tasks: TaskPlan | None = None
    """What is given to robots that have nothing else to do."""

    def __post_init__(self) -> None:
        """Check the names. Raises InputError."""
        if not self.robots:
            raise InputError("a fleet needs at least one robot")
        twice = [name for name, count in Counter(robot.name for robot in self.robots).items() if count > 1]
        if twice:
            raise InputError(f'two robots have the name "{twice[0]}"; give each its own', name=twice[0])
        unknown = [fault.robot for fault in self.faults if fault.robot not in {robot.name for robot in self.robots}]
        if unknown:
            raise InputError(f'a fault names the robot "{unknown[0]}", which is not there', robot=unknown[0])
        routed = [robot.name for robot in self.robots if robot.route]
        if routed and self.graph is None:
            raise InputError(f"{routed[0]} has a route, but the fleet has no route graph; give it one", robot=routed[0])
        if self.tasks is not None:
            self._check_tasks(self.tasks)

    def _check_tasks(self, plan: TaskPlan) -> None:
        twice = [name for name, count in Counter(task.name for task in plan.tasks).items() if count > 1]
        if twice:
            raise InputError(f'two tasks have the name "{twice[0]}"; give each its own', name=twice[0])
        stops = [(task.name, stop) for task in plan.tasks for stop in task.stops]
        stops += [(charger.name, charger.stop) for charger in plan.chargers]
        guided = self.traffic.get("rule", "none") != "none"
        for name, stop in stops:
            if isinstance(stop, int):
                if self.graph is None:
                    raise InputError(
                        f"{name} stops at node {stop}, but the fleet has no route graph; give it one", name=name
                    )
                self.graph.node(stop)
            elif guided:
                raise InputError(f"{name} stops beside the route graph, on which the traffic rule guides; name a node")
        if not all(task.stops for task in plan.tasks):
            raise InputError("a task has no stops; give it at least one")
        batteries = [robot.scenario.configuration.navstack.sim.battery.capacity for robot in self.robots]
        if plan.chargers and not any(batteries):
            raise InputError("charging needs batteries that run low; set navstack/sim/battery/capacity (Ah)")

    @property
    def sorted_robots(self) -> tuple[FleetRobot, ...]:
        """The robots by name, the order in which they are simulated."""
        return tuple(sorted(self.robots, key=lambda robot: robot.name))

    @property
    def scenarios(self) -> dict[str, Scenario]:
        """The scenarios of the robots, by name and in its order."""
        return {robot.name: robot.scenario for robot in self.sorted_robots}

    def world(self) -> World:
        """Return the world: map and obstacles of the first robot by name, and the docks of all."""
        robots = self.sorted_robots
        first, docks = robots[0].scenario, list[Shape]()
        for robot in robots:
            docks += [dock for dock in robot.scenario.dock_shapes if dock not in docks]
        return World(first.map, first.obstacles, shapes=(*first.shapes, *docks))

    def as_dict(self) -> dict[str, Any]:
        """Return the fleet as JSON data; with the map, `from_record` restores it from this."""
        trees, robots = list[Any](), list[dict[str, Any]]()
        for robot in self.sorted_robots:
            scenario = robot.scenario.as_dict()
            tree = scenario.pop("parameters")
            if tree not in trees:
                trees.append(tree)
            robots.append(
                {
                    "name": robot.name,
                    "priority": robot.priority,
                    "route": list(robot.route),
                    "scenario": scenario,
                    "parameters": trees.index(tree),
                }
            )
        graph = {} if self.graph is None else {"graph": graph_text(self.graph)}
        return {
            "name": self.name,
            "seed": self.seed,
            "robots": robots,
            "parameters": trees,
            "faults": [fault.model_dump(mode="json") for fault in self.faults],
            "traffic": dict(self.traffic),
            **graph,
            **({} if self.tasks is None else {"tasks": self.tasks.as_dict()}),
        }

    @classmethod
    def from_record(cls, record: Record) -> tuple[Fleet, str]:
        """Restore the fleet of a robot's record, and the name of that robot. Raises RecordError for a record without one."""
        try:
            data: Any = record.scenario["fleet"]
            robots = list[FleetRobot]()
            for entry in data["robots"]:
                scenario = {**entry["scenario"], "parameters": data["parameters"][entry["parameters"]]}
                made = Scenario.from_record(_Part(scenario, record))
                robots.append(FleetRobot(entry["name"], made, float(entry["priority"]), tuple(entry["route"])))
            return cls(
                tuple(robots),
                int(data["seed"]),
                str(data["name"]),
                tuple(FAULT.validate_python(fault) for fault in data["faults"]),
                dict(data["traffic"]),
                parse_graph(data["graph"]) if "graph" in data else None,
                TaskPlan.from_dict(data["tasks"]) if "tasks" in data else None,
            ), str(record.scenario["robot"])
        except (KeyError, TypeError, ValueError, IndexError, ValidationError) as exc:
            raise RecordError(f"the fleet of {record.path or 'the record'} is damaged; record the run again") from exc


class _Part(Record):
    """A record with the scenario of another robot, as `Scenario.from_record` reads it."""

    def __init__(self, scenario: Mapping[str, Any], whole: Record) -> None:
        super().__init__({**whole.meta, "scenario": scenario}, [], whole.arrays)
        self.path, self.map = whole.path, whole.map


def is_of_fleet(record: Record) -> bool:
    """Return True for the record of a robot of a fleet."""
    return "fleet" in record.scenario


def robot_seed(seed: int, name: str) -> int:
    """Return the seed of a robot's noise: it depends on the name, not on the place in the list or on other robots."""
    return int.from_bytes(hashlib.sha256(f"{seed}/{name}".encode()).digest()[:6], "big")


def make_fleet(
    scenarios: Mapping[str, Scenario],
    *,
    seed: int = 0,
    priorities: Mapping[str, float] | None = None,
    routes: Mapping[str, Sequence[int]] | None = None,
    graph: RouteGraph | None = None,
    traffic: Mapping[str, Any] | None = None,
    faults: Sequence[Any] = (),
    tasks: TaskPlan | None = None,
    name: str = "",
) -> Fleet:
    """Return a fleet of robots by name; the seed of each is that of the fleet with its name. Raises InputError.

    make_fleet({"a": scenario, "b": replace(scenario, start=Pose2D(4.0, 1.0, 0.0))})
    """
    for given in (*(priorities or {}), *(routes or {})):
        if given not in scenarios:
            raise InputError(f"there is no robot {short_repr(given)}; robots: {', '.join(scenarios)}", robot=given)
    robots = [
        FleetRobot(
            robot,
            replace(scenario, seed=robot_seed(seed, robot)),
            (priorities or {}).get(robot, 0.0),
            tuple((routes or {}).get(robot, ())),
        )
        for robot, scenario in scenarios.items()
    ]
    return Fleet(tuple(robots), seed, name, tuple(faults), traffic or {}, graph, tasks)
