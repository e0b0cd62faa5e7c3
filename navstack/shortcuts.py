"""The Python interface of one line: simulate, plan and load by names or objects.

    import navstack as nav

    result = nav.simulate("office", robot="turtlebot", goals=["kitchen", "office_2"], seed=0)
    print(result)                                   # 2/2 goals, 61.2 s, 25.0 m, 0 collisions
    print(result.explain(goal=2)); result.plot("run.png")

Wherever a map, a robot, a place or a scenario is wanted, its packaged name, its file and the object itself work. A wrong name
raises InputError with a suggestion. Findings about parameters are `ParameterWarning`s, or errors with `strict=True`.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, overload

import numpy as np
from numpy.typing import ArrayLike
from rich.console import Console

from navstack import bringup, parameters
from navstack.bringup import PlannedPath, plan_on_map, pose_of
from navstack.core import Footprint, InputError, OccupancyGrid, ParameterError, Pose2D, Values
from navstack.explain import explain_goal, explain_goals, print_goal
from navstack.map_io import load_map, map_names
from navstack.parameters import Configuration, Finding, choose_global_planner, nearest, packaged_sets
from navstack.plot import plot_plan, plot_run
from navstack.plugins import Plan
from navstack.record import Record
from navstack.scenario import (
    Places,
    RunResult,
    Scenario,
    load_places,
    load_suite,
    read_scenario,
    run_scenario,
    shipped_scenarios,
    suite_names,
)
from navstack.studies import Column, Job, JobResult, Table, run_jobs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

World = str | Path | OccupancyGrid | Scenario
"""A packaged scenario or map by name, a scenario file or a map file, or the object."""
Robot = str | Path | Mapping[str, Any] | Sequence[str | Path | Mapping[str, Any]] | Configuration
"""A packaged parameter set by name, files or folders, a mapping of parameters, several of these, or a configuration."""
Place = str | Pose2D | tuple[float, ...]
"""A place of the map by name, a pose, or (x, y) or (x, y, yaw) in the map frame (m, rad)."""

DEFAULT_ROBOT: Final = "turtlebot"
"""Robot of a map, which names none."""


_TEXT_WIDTH: Final = 120
"""Width of explanations (columns)."""


class ParameterWarning(UserWarning):
    """A finding of `navstack check` about parameters that are used."""


# --- robots -----------------------------------------------------------------------------------------------------------


def load_configuration(
    sources: Sequence[Any],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
    strict: bool = False,
) -> Configuration:
    """Load the parameters of a robot.

    >>> import navstack as nav
    >>> nav.load_configuration(["turtlebot"], overrides=["DWAPlannerROS/sim_time=2.0"]).local_planner.params.sim_time
    2.0

    Args:
        sources: packaged sets, folders, files (`file@namespace`) or mappings; later ones override earlier ones.
        overrides: texts `NAME=VALUE`.
        distro: `noetic` or `indigo`, instead of the parameter `navstack/ros_distro`.
        allow_missing: leave out layers, critics and behaviors of an unknown type, with a warning.
        strict: raise ParameterError for findings that are otherwise a ParameterWarning.

    Raises:
        ParameterError: the parameters cannot be used; the message has file, line, column and the fix.
    """
    configuration = parameters.load_configuration(
        sources, overrides=overrides, distro=distro, allow_missing=allow_missing
    )
    _warn(configuration.findings, strict=strict)
    return configuration


def load_robot(robot: Robot = DEFAULT_ROBOT, *, strict: bool = False, **sections: Mapping[str, Any]) -> Configuration:
    """Load a robot, with parameters of single sections changed.

    >>> import navstack as nav
    >>> nav.load_robot("turtlebot", DWAPlannerROS={"sim_time": 2.0}).local_planner.params.sim_time
    2.0

    Args:
        robot: a packaged set by name, a folder, files, mappings, or several of these.
        strict: raise ParameterError for findings about the files, too, that are otherwise a ParameterWarning.
        sections: parameters by section, such as `DWAPlannerROS={"sim_time": 2.0}` or `local_costmap={"width": 6.0}`.

    Raises:
        InputError: there is no such robot.
        ParameterError: a parameter cannot be used, or one given here has no effect.
    """
    if isinstance(robot, Configuration):
        if sections:
            raise InputError("sections change a robot that is loaded here; give its name or files", argument="sections")
        return robot
    sources = _sources(robot)
    for name in sections:
        values: Any = sections[name]
        if not isinstance(values, Mapping):
            raise InputError(f"{name}={values!r} is not a dictionary of parameters", argument=name)
    configuration = parameters.load_configuration([*sources, dict(sections)] if sections else sources)
    given = {f"{section}/{key}" for section, values in sections.items() for key in values} | set(sections)
    ineffective = [f for f in configuration.findings if f.severity != "info" and f.key in given]
    if ineffective:
        raise ParameterError(_lines(ineffective), findings=[f.as_dict() for f in ineffective])
    _warn(configuration.findings, strict=strict)
    return configuration


def _sources(robot: Any) -> list[Any]:
    """Return the sources of a robot. Raises InputError for a name that is neither packaged nor a file."""
    sources: list[Any] = [robot] if isinstance(robot, str | Path | Mapping) else list(robot)
    for source in sources:
        if (
            isinstance(source, str)
            and "@" not in source
            and not Path(source).exists()
            and source not in packaged_sets()
        ):
            raise InputError(_unknown("robot", source, packaged_sets(), "a folder or file"), argument="robot")
    return [str(source) if isinstance(source, Path) else source for source in sources]


def _warn(findings: Sequence[Finding], *, strict: bool) -> None:
    found = [f for f in findings if f.severity == "warning"]
    if found and strict:
        raise ParameterError(_lines(found), findings=[f.as_dict() for f in found])
    for finding in found:
        warnings.warn(f"{finding.location}: {finding.message}", ParameterWarning, stacklevel=3)


def _lines(findings: Sequence[Finding]) -> str:
    return "\n".join(f"{f.location}: {f.message}" for f in findings)


def _unknown(kind: str, name: str, known: Sequence[str], other: str) -> str:
    near = nearest(name, known)
    hint = f'did you mean "{near}"?' if near else f"use {other}, or one of: {', '.join(sorted(known))}"
    return f'there is no {kind} "{name}"; {hint}'


# --- runs -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, repr=False)
class SimulationResult(RunResult):
    """How a simulated run ended, with its record: what happened, why, and a picture."""

    @property
    def record(self) -> Record:
        """The record of the run."""
        assert self.recorder is not None
        return self.recorder.record()

    def explain(self, goal: int | None = None) -> str:
        """Return what happened to a goal (from 1), or to all of them, as a text. Raises InputError for another number."""
        reports = explain_goals(self.record) if goal is None else (explain_goal(self.record, goal),)
        text = io.StringIO()
        for report in reports:
            print_goal(Console(file=text, width=_TEXT_WIDTH), report)
        return text.getvalue().rstrip("\n")

    def plot(self, file: str | Path | None = None, **options: Any) -> Any:
        """Draw the run, into a file or, without one, as matplotlib axes; see `navstack.plot.plot_run` for the options."""
        return plot_run(self.record, None if file is None else Path(file), **options)

    def _repr_png_(self) -> bytes:
        """Return the picture of the run: notebooks show it."""
        return _png(plot_run(self.record))


def simulate(
    world: World = "office",
    *,
    robot: Robot | None = None,
    start: Place | None = None,
    goals: Sequence[Place] | Place | None = None,
    seed: int | None = None,
    time_limit_s: float | None = None,
    strict: bool = False,
) -> SimulationResult:
    """Drive a simulated robot to its goals.

    >>> import navstack as nav
    >>> print(nav.simulate("office", goals=["kitchen"]))
    1/1 goals, ...

    Args:
        world: a packaged scenario or map by name, a scenario or map file, a map, or a scenario.
        robot: a packaged parameter set by name, a folder, files, a mapping or a configuration; by default that of the
            scenario, or a turtlebot.
        start: a place of the map by name, or a pose (m, rad); by default that of the scenario or of the map.
        goals: places or poses, or a single one; by default those of the scenario or of the map.
        seed: seed of the simulated noise; the same seed gives the same run to the bit.
        time_limit_s: simulated time allowed per goal (s).
        strict: raise ParameterError for findings about the parameters that are otherwise a ParameterWarning.

    Raises:
        InputError: a name or a pose that does not exist, with a suggestion.
        MapError, ParameterError, ScenarioError: a file that cannot be used, with line and column.
    """
    scenario = make_scenario(
        world, robot=robot, start=start, goals=goals, seed=seed, time_limit_s=time_limit_s, strict=strict
    )
    result = run_scenario(scenario)
    return SimulationResult(**{field.name: getattr(result, field.name) for field in fields(result)})


def make_scenario(
    world: World = "office",
    *,
    robot: Robot | None = None,
    start: Place | None = None,
    goals: Sequence[Place] | Place | None = None,
    seed: int | None = None,
    time_limit_s: float | None = None,
    strict: bool = False,
) -> Scenario:
    """Return the scenario that `simulate` runs, with the same arguments and errors."""
    if isinstance(world, Scenario):
        scenario = world
    else:
        file = _scenario_file(world)
        scenario = read_scenario(file).build() if file is not None else None
    if scenario is None:
        assert not isinstance(world, Scenario)
        grid = _map(world)
        places = _places(world)
        ends = (start, goals)
        if places is None and None in ends:
            raise InputError("the map names no start and no goals; give start and goals", argument="goals")
        scenario = Scenario(
            map=grid,
            configuration=load_robot(robot or DEFAULT_ROBOT, strict=strict),
            start=_pose(start, places, "start") if start is not None or places is None else places.start,
            goals=_poses(goals, places) if goals is not None or places is None else places.goals,
            names={"map": world if isinstance(world, str) else "", "params": [robot if isinstance(robot, str) else ""]},
        )
    else:
        places = None
        if robot is not None:
            scenario = replace(scenario, configuration=load_robot(robot, strict=strict))
        if start is not None:
            scenario = replace(scenario, start=_pose(start, places, "start"))
        if goals is not None:
            scenario = replace(scenario, goals=_poses(goals, places), steps=())
    if seed is not None:
        scenario = replace(scenario, seed=seed)
    return scenario if time_limit_s is None else replace(scenario, time_limit_s=time_limit_s)


def _scenario_file(world: str | Path | OccupancyGrid) -> Path | None:
    """Return the file of a scenario; None for a map. Raises InputError for an unknown name."""
    if isinstance(world, OccupancyGrid):
        return None
    if str(world) in shipped_scenarios():
        return shipped_scenarios()[str(world)]
    if str(world) in map_names():
        return None
    path = Path(world)
    if not path.exists():
        known = [*shipped_scenarios(), *map_names()]
        raise InputError(_unknown("scenario or map", str(world), known, "a file"), argument="world")
    with path.open(encoding="utf-8", errors="replace") as file:
        return None if any(line.startswith("image:") for line in file) else path


def _map(world: str | Path | OccupancyGrid) -> OccupancyGrid:
    return world if isinstance(world, OccupancyGrid) else load_map(world)


def _places(world: str | Path | OccupancyGrid) -> Places | None:
    return load_places(world) if isinstance(world, str) and world in map_names() else None


def _poses(goals: Any, places: Places | None) -> tuple[Pose2D, ...]:
    single = isinstance(goals, str | Pose2D) or (isinstance(goals, tuple) and all(np.isscalar(v) for v in goals))
    return tuple(_pose(goal, places, "goal") for goal in ([goals] if single else goals))


def _pose(place: Any, places: Places | None, what: str) -> Pose2D:
    """Return the pose of a place. Raises InputError for an unknown name and for numbers that are no pose."""
    if isinstance(place, str):
        known = {} if places is None else places.places
        if place not in known:
            raise InputError(_unknown("place", place, list(known), "a pose (x, y, yaw)"), argument=what)
        return known[place]
    return pose_of(what, place)


@dataclass(frozen=True, slots=True)
class ManyResults:
    """Many runs, a row each, in the order of the scenarios and seeds."""

    table: Table
    rows: list[dict[str, Any]]

    @property
    def success_rate(self) -> float:
        """The share of the runs that met their success conditions; NaN without runs."""
        return float(np.mean([row["succeeded"] for row in self.rows])) if self.rows else float("nan")

    def __str__(self) -> str:
        return self.table.markdown()

    def __repr__(self) -> str:
        return f"ManyResults({len(self.rows)} runs, success rate {self.success_rate:.2f})"

    def _repr_html_(self) -> str:
        """Return the table: notebooks show it."""
        return self.table.html()


_COLUMNS: Final = (
    Column("run", "run", looks="name"),
    Column("succeeded", "succeeded"),
    Column("goals", "goals", looks="number"),
    Column("time_s", "time (s)", 1),
    Column("length_m", "length (m)", 1),
    Column("collisions", "collisions"),
    Column("clearance_min_m", "clearance (m)"),
)


def simulate_many(
    worlds: World | Sequence[World] = "office",
    *,
    robot: Robot | None = None,
    count: int = 10,
    seed: int = 0,
    processes: int | None = None,
    progress: bool = False,
) -> ManyResults:
    """Drive many scenarios in parallel processes; the number of processes does not change the results.

    >>> import navstack as nav
    >>> nav.simulate_many("crowd", robot="jackal_dwa", count=2, processes=2).success_rate >= 0.0
    True

    Args:
        worlds: a suite by name (`crowd`, `warehouse`, ..), of which `count` scenarios are driven; or a scenario or a map, driven
            with `count` seeds; or a list of scenarios and maps, each driven once.
        robot: instead of the robots of the scenarios, as in `simulate`.
        count: number of runs.
        seed: seed of a suite's runs, or the first of the `count` seeds.
        processes: number of parallel runs; all usable cores by default.
        progress: show a bar on stderr.

    Raises:
        InputError: an unknown name, with a suggestion; errors of single runs are raised, too.
    """
    scenarios: list[tuple[str, Scenario]]
    if isinstance(worlds, str) and worlds in suite_names():
        scenarios = [(spec.name, spec.build(seed=seed)) for spec in load_suite(worlds, count=count)]
        if robot is not None:
            chosen = load_robot(robot)
            scenarios = [(name, replace(scenario, configuration=chosen)) for name, scenario in scenarios]
    elif isinstance(worlds, str | Path | OccupancyGrid | Scenario):
        single = make_scenario(worlds, robot=robot)
        scenarios = [(f"seed {s}", replace(single, seed=s)) for s in range(seed, seed + count)]
    else:
        scenarios = [(f"run {i}", make_scenario(world, robot=robot, seed=seed)) for i, world in enumerate(worlds)]
    results = run_jobs(
        _drive, [Job(name, scenario) for name, scenario in scenarios], processes=processes, progress=progress
    )
    rows = [_row(result) for result in results]
    return ManyResults(Table("runs", _COLUMNS, rows), rows)


def _drive(scenario: Scenario) -> dict[str, Any]:
    """Run one scenario in a worker process and return its figures."""
    result = run_scenario(scenario, record=False)
    return {
        "succeeded": result.succeeded,
        "goals": f"{sum(goal.succeeded for goal in result.goals)}/{len(result.goals)}",
        "time_s": result.metrics.time_s,
        "length_m": result.metrics.length_m,
        "collisions": result.collisions,
        "clearance_min_m": result.min_clearance_m,
    }


def _row(result: JobResult) -> dict[str, Any]:
    if result.error is not None:
        raise InputError(f"{result.key}: {result.error['message']}", argument="worlds")
    return {"run": result.key, **result.value}


# --- plans ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, repr=False)
class MapPlan(Plan):
    """A plan on a map, with what it was planned on."""

    planned: PlannedPath | None = None
    ends: tuple[Pose2D, Pose2D] | None = None
    """Start and goal that were asked for."""

    def plot(self, file: str | Path | None = None, **options: Any) -> Any:
        """Draw the plan on its costmap, into a file or, without one, as matplotlib axes; see `navstack.plot.plot_plan`."""
        assert self.planned is not None and self.ends is not None
        costmap = self.planned.costmap
        ends: dict[str, Any] = {"start": self.ends[0], "goal": self.ends[1], "footprint": costmap.footprint}
        return plot_plan(costmap.master, {self.planned.planner: self.planned.plan}, file, **ends, **options)

    def _repr_png_(self) -> bytes:
        """Return the picture of the plan: notebooks show it."""
        return _png(self.plot())


@overload
def plan(
    world: str | Path | OccupancyGrid,
    start: Place,
    goal: Place,
    /,
    *,
    robot: Robot = ...,
    planner: str | None = ...,
    strict: bool = ...,
) -> MapPlan: ...


@overload
def plan(
    world: ArrayLike,
    resolution: float,
    start: Pose2D | tuple[float, ...],
    goal: Pose2D | tuple[float, ...],
    /,
    *,
    planner: str = ...,
    parameters: Mapping[str, Any] | None = ...,
    values: Values | None = ...,
    unknown: Literal["occupied", "free"] = ...,
    robot_radius: float = ...,
    footprint: Footprint | Sequence[tuple[float, float]] | None = ...,
    origin: tuple[float, float] = ...,
) -> Plan: ...


def plan(*arguments: Any, **options: Any) -> Plan:
    """Plan once: on a map between places, or on an array.

    >>> import navstack as nav
    >>> round(nav.plan("office", "corridor_west", "kitchen", planner="astar").path.length)
    23

    On a map, `plan(map, start, goal, robot="turtlebot", planner=None)` uses the robot's global costmap and its planner, or
    another one with the robot's parameters. On an array, `plan(array, resolution, start, goal, ..)` is
    `navstack.bringup.plan`, with its arguments.

    Raises:
        InputError: an unknown name, with a suggestion, or an invalid argument.
        PlanningError: there is no plan; the error has a code, the reason, and data.
    """
    if arguments and isinstance(arguments[0], str | Path | OccupancyGrid):
        return _plan_on_map(*arguments, **options)
    return bringup.plan(*arguments, **options)


def _plan_on_map(
    world: str | Path | OccupancyGrid,
    start: Place,
    goal: Place,
    *,
    robot: Robot = DEFAULT_ROBOT,
    planner: str | None = None,
    strict: bool = False,
) -> MapPlan:
    grid, places = _map(world), _places(world)
    configuration = load_robot(robot, strict=strict)
    choice = None if planner is None else choose_global_planner(configuration, planner)
    ends = _pose(start, places, "start"), _pose(goal, places, "goal")
    planned = plan_on_map(configuration, grid, *ends, planner=choice)
    values = {field.name: getattr(planned.plan, field.name) for field in fields(planned.plan)}
    return MapPlan(**values, planned=planned, ends=ends)


def _png(axes: Axes) -> bytes:
    buffer = io.BytesIO()
    figure: Any = axes.figure
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
