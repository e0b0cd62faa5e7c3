"""Scenario files: YAML that says what is driven, where, by which robot, and what counts as success.

    name: narrow door                     # every key but `map` may be left out where the map's places say enough
    description: Through a door of 0.9 m.
    map: office                           # a packaged map, or a file relative to this one
    params: [turtlebot, mine.yaml]        # as `--params`; turtlebot if left out
    set: {DWAPlannerROS/max_vel_x: 0.4}   # parameters that are changed
    sim: {odometry_noise: 0.02}           # body, sensors and noise: the parameters of `navstack: sim:`
    start: corridor_west                  # [x, y, yaw] (m, rad), or a place of the map
    goals: [office_2, [16.9, 9.6, 1.57]]  # or tour: {places: [..], order: given | sorted | random, loops: 1}
    shapes:
      - {radius: 0.2, pose: [3.0, 7.4]}
      - {radius: 0.25, motion: {kind: track, points: [[5, 6], [5, 9]], speed: 0.5}}
    seed: 1
    time_limit: 120                       # simulated seconds for a goal
    success: {goals: SUCCEEDED, max_collisions: 0, max_time: 100, min_clearance: 0.02}

For many processes: send the path (or a `ScenarioSpec`, a few kB when pickled) and the arguments of `load_scenario`, and
load it there, which takes about 10 ms; or send the `Scenario` itself (its map's cells and about 50 kB).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from navstack.core import OccupancyGrid, Pose2D
from navstack.core.errors import InputError, MapError, ScenarioError
from navstack.core.files import is_file
from navstack.map_io import load_map
from navstack.parameters.configuration import Configuration, check_parameters, load_configuration
from navstack.parameters.findings import Finding, finding, in_order
from navstack.parameters.sources import Source
from navstack.parameters.yaml_reader import read_yaml
from navstack.places import visit_order
from navstack.scenario.file.models import Settings, Success
from navstack.scenario.file.reader import Parts, ScenarioReader
from navstack.scenario.file.start import touched_at_start
from navstack.scenario.run import Scenario
from navstack.scenario.success import SuccessConditions
from navstack.sim import Shape
from navstack.sim.world import OCCUPIED

__all__ = [
    "Parts",
    "ScenarioSpec",
    "Settings",
    "Success",
    "check_names",
    "check_scenario",
    "is_scenario_file",
    "load_scenario",
    "read_scenario",
    "scenarios_in",
]


_ENDINGS = (".yaml", ".yml")


@dataclass(frozen=True, slots=True, eq=False)
class ScenarioSpec:
    """A scenario before its parameters are chosen: a file that was read, or one of a suite; `build` makes the scenario, as
    often as wanted. A few kB when pickled, where the map is a file.
    """

    parts: Parts
    path: Path | None = None
    """The file it was read from."""

    @property
    def name(self) -> str:
        """What the scenario calls itself, or its file's name."""
        return self.parts.settings.name or (self.path.stem if self.path is not None else "scenario")

    @property
    def over(self) -> tuple[Source, ...]:
        """What the scenario lays over whatever parameters it is run with: its `set:` and its `sim:`."""
        return tuple(self.parts.over)

    @property
    def description(self) -> str:
        """What it shows."""
        return self.parts.settings.description

    def map(self) -> OccupancyGrid:
        """Its map, which must not be written to: scenarios on one map share it. Raises MapError."""
        if self.parts.grid is not None:
            return self.parts.grid
        assert self.parts.map_file is not None
        return _map(self.parts.map_file)

    def build(
        self,
        *,
        params: Sequence[Source] | None = None,
        overrides: Sequence[str] = (),
        distro: str | None = None,
        allow_missing: bool = False,
        seed: int | None = None,
        time_limit_s: float | None = None,
        start: Pose2D | None = None,
        goals: Sequence[Pose2D] | None = None,
        obstacles: Sequence[tuple[float, float, float]] = (),
        shapes: Sequence[Shape] = (),
    ) -> Scenario:
        """The scenario, with whatever is given here in the place of what the file says.

        `params` replace the file's `params:`; its `set:` and `sim:` still lie over them, and `overrides` (`NAME=VALUE`)
        over all. `obstacles` (x, y, radius in m) and `shapes` come in addition. `seed` also shuffles a tour of random
        order. `allow_missing` leaves out layers and plugins that are not here, as the file's own may.

        Raises MapError, ParameterError or InputError.
        """
        if goals is not None and not goals:
            raise InputError("a scenario needs a goal: give one at least, or none to keep its own (`goals=None`)")
        if time_limit_s is not None and not time_limit_s > 0.0:
            raise InputError(f"the time limit must be above 0 s, not {time_limit_s:g}", time_limit_s=time_limit_s)
        parts = self.parts
        settings = parts.settings
        seed = settings.seed if seed is None else seed
        assert parts.start is not None
        sources = [*(parts.sources if params is None else params), *self.over]
        configuration = load_configuration(
            sources,
            overrides=overrides,
            distro=distro or settings.distro,
            allow_missing=allow_missing or settings.allow_missing,
        )
        names, poses = parts.goal_names, parts.goals
        if parts.tour is not None:
            names = visit_order(parts.tour_names, parts.tour.order, loops=parts.tour.loops, seed=seed)
            poses = tuple(parts.places[name] for name in names)
        if goals is not None:
            names, poses = (), tuple(goals)
        told: dict[str, Any] = {
            "scenario": self.path.name if self.path is not None else self.name,
            "map": self.name if parts.map_file is None else parts.map_file.name,
            "params": [Path(s).name for s in sources if isinstance(s, (str, Path))],
            "overrides": list(overrides),
        }
        if any(names):
            told["places"] = [name or None for name in names]
        return Scenario(
            map=self.map(),
            configuration=configuration,
            start=start or parts.start,
            goals=poses,
            obstacles=tuple(obstacles),
            shapes=(*parts.shapes, *shapes),
            seed=seed,
            time_limit_s=settings.time_limit if time_limit_s is None else time_limit_s,
            rest_s=settings.rest,
            stop_on_failure=settings.stop_on_failure,
            success=_conditions(parts.success),
            name=self.name,
            names=told,
        )

    def check_start(self, scenario: Scenario) -> None:
        """Raises ScenarioError, which names the file's line, when that robot cannot stand at the file's start."""
        parts = self.parts
        if scenario.start == parts.start:
            wrong = _start_on_map(parts, scenario.map) or _at_start(parts, scenario.map, scenario.configuration)
            if wrong:
                raise scenario_error(wrong)


def is_scenario_file(path: Path) -> bool:
    """True for a YAML file that says what is driven, and not how a map or a robot is; looks at its top keys only."""
    if path.suffix not in _ENDINGS or not is_file(path):
        return False
    keys = read_yaml(path).root.items.keys()
    if {"image", "resolution"} & keys:
        return False
    return "map" in keys or len({"start", "goals", "tour", "shapes", "success", "time_limit", "params"} & keys) >= 2


def scenarios_in(folder: Path) -> list[ScenarioSpec]:
    """The scenario files that lie in a folder, in the order of their names; none for a folder without any.

    Other YAML files (maps, places, parameters) are passed over. Raises ScenarioError for a scenario that cannot be used,
    and for a file that is not YAML, since nobody can tell what it would have been.
    """
    found: list[ScenarioSpec] = []
    for file in sorted(folder.iterdir()):
        if file.suffix not in _ENDINGS or not file.is_file():
            continue
        broken = [f for f in in_order(read_yaml(file).findings) if f.severity == "error"]
        if broken:
            raise scenario_error(broken)
        if is_scenario_file(file):
            found.append(read_scenario(file))
    return found


def check_names(names: Sequence[str]) -> None:
    """Raises InputError where two scenarios have one name: tables and results are by name."""
    twice = [name for name, many in Counter(names).items() if many > 1]
    if twice:
        raise InputError(f'two scenarios are called "{twice[0]}"; give one of them another `name:`', name=twice[0])


def read_scenario(path: str | Path, shown: str | None = None) -> ScenarioSpec:
    """Reads a scenario file.

    Raises ScenarioError when it cannot be used: its message has a line per error, its `data["findings"]` everything that
    was found. The parameters it names are looked at by `build`.
    """
    reader = ScenarioReader(Path(path), shown)
    parts = reader.read()
    errors = [f for f in in_order(reader.findings) if f.severity == "error"]
    if errors:
        raise scenario_error(errors)
    return ScenarioSpec(parts, Path(path))


def load_scenario(path: str | Path, **overrides: Any) -> Scenario:
    """The scenario of a file; `overrides` are those of `ScenarioSpec.build` (`seed=3, overrides=["a/b=1"]`).

    Raises ScenarioError for the file, ParameterError for the parameters, MapError for the map.
    """
    return read_scenario(path).build(**overrides)


def check_scenario(
    path: str | Path, *, overrides: Sequence[str] = (), distro: str | None = None, allow_missing: bool = False
) -> list[Finding]:
    """Everything there is to say about a scenario file and the parameters it names, by file and line."""
    reader = ScenarioReader(Path(path))
    parts = reader.read()
    findings = list(reader.findings)
    if parts.sources and reader.readable:
        findings += check_parameters(
            [*parts.sources, *parts.over],
            overrides=overrides,
            distro=distro or parts.settings.distro,
            allow_missing=allow_missing or parts.settings.allow_missing,
        )
    if parts.map_file is not None and reader.readable:
        findings += _on_map(reader, parts)
        if not any(f.severity == "error" for f in findings):
            configuration = load_configuration(
                [*parts.sources, *parts.over],
                overrides=overrides,
                distro=distro or parts.settings.distro,
                allow_missing=allow_missing or parts.settings.allow_missing,
            )
            findings += _at_start(parts, _map(parts.map_file), configuration)
    return in_order(findings)


def scenario_error(errors: Sequence[Finding]) -> ScenarioError:
    """The error that says why a scenario cannot be used."""
    many = "the scenario cannot be used" + ("" if len(errors) == 1 else f" ({len(errors)} errors)")
    lines = "\n".join(f"{f.location}: {f.message}" for f in errors)
    return ScenarioError(f"{many}:\n{lines}", findings=[f.as_dict() for f in errors])


def _on_map(reader: ScenarioReader, parts: Parts) -> list[Finding]:
    """What the map says about start and goals: a start that cannot be is an error, a goal may be meant to fail."""
    assert parts.map_file is not None
    at = reader.root.items["map"][1].at
    try:
        grid = _map(parts.map_file)
    except MapError as exc:
        return [finding("error", "map", at, "map", exc.message)]
    said = _start_on_map(parts, grid)
    expected = parts.success.goals
    for i, (goal, there) in enumerate(zip(parts.goals, parts.goals_at)):
        wanted = expected if isinstance(expected, str) else expected[i] if i < len(expected) else "any"
        where = _where(grid, goal)
        if where is not None and wanted == "SUCCEEDED":
            message = (
                f"goal {i + 1} ({goal.x:g}, {goal.y:g}) {where}, so it cannot be reached; move it, or expect "
                "ABORTED under `success: goals:`"
            )
            said.append(finding("warning", "goal", there, "goals", message))
    return said


def _start_on_map(parts: Parts, grid: OccupancyGrid) -> list[Finding]:
    """The error of a start outside the map or in a wall."""
    where = None if parts.start is None else _where(grid, parts.start)
    if parts.start is None or where is None:
        return []
    message = f"the start ({parts.start.x:g}, {parts.start.y:g}) {where}; move it"
    return [finding("error", "start", parts.start_at, "start", message)]


def _at_start(parts: Parts, grid: OccupancyGrid, configuration: Configuration) -> list[Finding]:
    """The error of a start where the robot's outline touches something."""
    if parts.start is None:
        return []
    touched = touched_at_start(configuration.local_costmap.true_footprint, parts.start, grid, parts.shapes)
    if touched is None:
        return []
    x, y, yaw = parts.start
    message = (
        f"the robot does not fit at the start ({x:g}, {y:g}, {yaw:g}): its outline touches {touched}; move the start"
    )
    return [finding("error", "start", parts.start_at, "start", message)]


def _where(grid: OccupancyGrid, pose: Pose2D) -> str | None:
    """What is wrong with a place on the map, None when nothing is."""
    geometry = grid.geometry
    # a turned map is looked up as it lay before it was turned about its corner
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = pose.x - geometry.origin_x, pose.y - geometry.origin_y
    cell = geometry.world_to_cell(geometry.origin_x + c * dx + s * dy, geometry.origin_y + c * dy - s * dx)
    if cell is None:
        left, right, bottom, top = geometry.extent
        turned = f", turned by {grid.origin_yaw:g} rad about its first corner" if grid.origin_yaw != 0.0 else ""
        return f"lies outside the map, which covers x {left:g} .. {right:g}, y {bottom:g} .. {top:g} m{turned}"
    return "lies in a wall of the map" if grid.data[cell[1], cell[0]] >= OCCUPIED else None


def _map(path: Path) -> OccupancyGrid:
    """A map, read once per process for all scenarios on it."""
    try:
        changed_ns = path.stat().st_mtime_ns
    except OSError:
        changed_ns = 0
    return _map_as_of(str(path), changed_ns)


@lru_cache(maxsize=16)
def _map_as_of(path: str, changed_ns: int) -> OccupancyGrid:
    del changed_ns
    grid = load_map(Path(path))
    grid.data.setflags(write=False)
    return grid


def _conditions(told: Success) -> SuccessConditions:
    return SuccessConditions(
        goals=told.goals if isinstance(told.goals, str) else tuple(told.goals),
        max_collisions=told.max_collisions,
        max_time_s=told.max_time,
        min_clearance_m=told.min_clearance,
        max_length_m=told.max_length,
        max_recoveries=told.max_recoveries,
    )
