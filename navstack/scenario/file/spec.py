"""Scenario files: YAML that defines the robot, the world, the goals and the success conditions of a run.

    name: narrow door                     # only `map` is required if the map's places have a start and goals
    description: Through a door of 0.9 m.
    map: office                           # a packaged map, or a file relative to this file
    params: [turtlebot, mine.yaml]        # as `--params`; default: turtlebot
    set: {DWAPlannerROS/max_vel_x: 0.4}   # changed parameters
    sim: {odometry_noise: 0.02}           # body, sensors and noise: the parameters of `navstack: sim:`
    start: corridor_west                  # [x, y, yaw] (m, rad), or a place of the map
    goals: [office_2, [16.9, 9.6, 1.57]]  # or tour: {places: [..], order: given | sorted | random, loops: 1}
    shapes:
      - {radius: 0.2, pose: [3.0, 7.4]}
      - {radius: 0.25, motion: {kind: track, points: [[5, 6], [5, 9]], speed: 0.5}}
    interactions:                         # what a person does during the run, see navstack.scenario.interactions
      - {time: 5.0, kind: put, shape: {name: box, box: [0.5, 0.4], pose: [6.0, 7.5, 0.0]}}
    seed: 1
    time_limit: 120                       # simulated seconds per goal
    success: {goals: SUCCEEDED, max_collisions: 0, max_time: 100, min_clearance: 0.02}

To run scenarios in other processes, send the path (or a `ScenarioSpec`, a few kB when pickled) and the arguments of
`load_scenario`, and load it there (about 10 ms); or send the `Scenario` itself (about 50 kB plus the map's cells).
"""

from __future__ import annotations

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
from navstack.parameters.configuration import check_parameters, load_configuration
from navstack.parameters.findings import Finding, finding, in_order
from navstack.parameters.sources import Source
from navstack.parameters.yaml_reader import read_yaml
from navstack.places import visit_order
from navstack.scenario.file.models import Parts
from navstack.scenario.file.reader import read_file
from navstack.scenario.file.start_check import check_goals_on_map, check_start_collision, check_start_on_map
from navstack.scenario.scenario import Scenario
from navstack.sim import Shape

_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True, slots=True, eq=False)
class ScenarioSpec:
    """A scenario whose parameters are still open: read from a file, or one of a suite.

    `build` creates the scenario and may be called repeatedly. A few kB when pickled, if the map is a file.
    """

    parts: Parts
    path: Path | None = None
    """The file it was read from."""

    @property
    def name(self) -> str:
        """The name of the scenario; default: the name of its file."""
        return self.parts.settings.name or (self.path.stem if self.path is not None else "scenario")

    @property
    def overlays(self) -> tuple[Source, ...]:
        """The `set:` and `sim:` of the scenario: they override the parameters it is built with."""
        return tuple(self.parts.overlays)

    @property
    def description(self) -> str:
        """The description in the file."""
        return self.parts.settings.description

    def map(self) -> OccupancyGrid:
        """Returns the map. It is read-only: scenarios on the same map share it. Raises MapError."""
        if self.parts.grid is not None:
            return self.parts.grid
        assert self.parts.map_file is not None
        return _cached_map(self.parts.map_file)

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
        """Builds the scenario; the arguments replace the values of the file.

        `params` replace the file's `params:`; its `set:` and `sim:` override them, and `overrides` (`NAME=VALUE`) override
        everything. `obstacles` (x, y, radius in m) and `shapes` are added to those of the file. `seed` also determines the
        order of a random tour. `allow_missing` omits layers and plugins that are not installed.

        Raises MapError, ParameterError or InputError.
        """
        if goals is not None and not goals:
            raise InputError("goals is empty; give at least one goal, or goals=None for those of the scenario")
        if time_limit_s is not None and not time_limit_s > 0.0:
            raise InputError(f"time_limit_s is {time_limit_s:g} s; it must be above 0 s", time_limit_s=time_limit_s)
        parts = self.parts
        settings = parts.settings
        seed = settings.seed if seed is None else seed
        assert parts.start is not None
        sources = [*(parts.sources if params is None else params), *self.overlays]
        configuration = load_configuration(
            sources,
            overrides=overrides,
            distro=distro or settings.distro,
            allow_missing=allow_missing or settings.allow_missing,
        )
        names, poses = self._goals(seed) if goals is None else ((), tuple(goals))
        return Scenario(
            map=self.map(),
            configuration=configuration,
            start=start or parts.start,
            goals=poses,
            steps=parts.steps if goals is None else (),
            obstacles=tuple(obstacles),
            shapes=(*parts.shapes, *shapes),
            interactions=parts.interactions,
            seed=seed,
            time_limit_s=settings.time_limit if time_limit_s is None else time_limit_s,
            pause_s=settings.pause,
            stop_on_failure=settings.stop_on_failure,
            success=parts.success.conditions(),
            name=self.name,
            names=self._source_names(sources, overrides, names),
        )

    def _goals(self, seed: int) -> tuple[tuple[str, ...], tuple[Pose2D, ...]]:
        """Returns the names and the poses of the goals."""
        parts = self.parts
        if parts.steps:
            return parts.goal_names, ()
        if parts.tour is None:
            return parts.goal_names, parts.goals
        names = visit_order(parts.tour_names, parts.tour.order, loops=parts.tour.loops, seed=seed)
        return names, tuple(parts.places[name] for name in names)

    def _source_names(
        self, sources: Sequence[Source], overrides: Sequence[str], places: Sequence[str]
    ) -> dict[str, Any]:
        names: dict[str, Any] = {
            "scenario": self.path.name if self.path is not None else self.name,
            "map": self.name if self.parts.map_file is None else self.parts.map_file.name,
            "params": [Path(s).name for s in sources if isinstance(s, (str, Path))],
            "overrides": list(overrides),
        }
        if any(places):
            names["places"] = [name or None for name in places]
        return names

    def check_start(self, scenario: Scenario) -> None:
        """Raises ScenarioError, with the file's line, if the robot of `scenario` cannot be at the file's start."""
        parts = self.parts
        if scenario.start == parts.start:
            findings = check_start_on_map(parts, scenario.map) or check_start_collision(
                parts, scenario.map, scenario.configuration
            )
            if findings:
                raise scenario_error(findings)


def is_scenario_file(path: Path) -> bool:
    """True for a YAML file with the keys of a scenario, as opposed to a map or parameters. Reads the top level only."""
    if path.suffix not in _SUFFIXES or not is_file(path):
        return False
    keys = read_yaml(path).root.items.keys()
    if {"image", "resolution"} & keys:
        return False
    return "map" in keys or len({"start", "goals", "tour", "shapes", "success", "time_limit", "params"} & keys) >= 2


def scenarios_in(folder: Path) -> list[ScenarioSpec]:
    """Reads the scenario files in a folder, ordered by file name; an empty list if there are none.

    Ignores other YAML files (maps, places, parameters). Raises ScenarioError for an invalid scenario, and for a file that is
    not valid YAML, because its kind cannot be determined.
    """
    found: list[ScenarioSpec] = []
    for file in sorted(folder.iterdir()):
        if file.suffix not in _SUFFIXES or not file.is_file():
            continue
        errors = [f for f in in_order(read_yaml(file).findings) if f.severity == "error"]
        if errors:
            raise scenario_error(errors)
        if is_scenario_file(file):
            found.append(read_scenario(file))
    return found


def check_unique_names(names: Sequence[str]) -> None:
    """Raises InputError if two scenarios have the same name, which identifies them in tables and results."""
    duplicates = [name for name, count in Counter(names).items() if count > 1]
    if duplicates:
        raise InputError(
            f'two scenarios have the name "{duplicates[0]}"; set `name:` in one of them', name=duplicates[0]
        )


def read_scenario(path: str | Path, shown: str | None = None) -> ScenarioSpec:
    """Reads a scenario file; `shown` is its name in messages.

    Raises ScenarioError for an invalid file: its message has one line per error, its `data["findings"]` lists all of them.
    `build` checks the parameters.
    """
    context = read_file(Path(path), shown)
    errors = [f for f in in_order(context.findings) if f.severity == "error"]
    if errors:
        raise scenario_error(errors)
    return ScenarioSpec(context.parts, Path(path))


def load_scenario(path: str | Path, **overrides: Any) -> Scenario:
    """Reads a scenario file and builds it; `overrides` are the arguments of `ScenarioSpec.build` (`seed=3`).

    Raises ScenarioError for the file, ParameterError for the parameters, MapError for the map.
    """
    return read_scenario(path).build(**overrides)


def check_scenario(
    path: str | Path, *, overrides: Sequence[str] = (), distro: str | None = None, allow_missing: bool = False
) -> list[Finding]:
    """Checks a scenario file and the parameters it names; returns all findings, ordered by file and line."""
    context = read_file(Path(path))
    parts = context.parts
    findings = list(context.findings)
    sources = [*parts.sources, *parts.overlays]
    options: dict[str, Any] = {
        "overrides": overrides,
        "distro": distro or parts.settings.distro,
        "allow_missing": allow_missing or parts.settings.allow_missing,
    }
    if parts.sources and context.readable:
        findings += check_parameters(sources, **options)
    if parts.map_file is not None and context.readable:
        try:
            grid = _cached_map(parts.map_file)
        except MapError as exc:
            at = context.root.items["map"][1].at
            return in_order([*findings, finding("error", "map", at, "map", exc.message)])
        findings += check_start_on_map(parts, grid) + check_goals_on_map(parts, grid)
        if not any(f.severity == "error" for f in findings):
            findings += check_start_collision(parts, grid, load_configuration(sources, **options))
    return in_order(findings)


def scenario_error(errors: Sequence[Finding]) -> ScenarioError:
    """Returns the exception for a scenario with these errors."""
    count = "" if len(errors) == 1 else f" ({len(errors)} errors)"
    lines = "\n".join(f"{f.location}: {f.message}" for f in errors)
    return ScenarioError(f"invalid scenario{count}:\n{lines}", findings=[f.as_dict() for f in errors])


def _cached_map(path: Path) -> OccupancyGrid:
    """Returns a map; each version of a file is read once per process."""
    try:
        modified_ns = path.stat().st_mtime_ns
    except OSError:
        modified_ns = 0
    return _load_cached(str(path), modified_ns)


@lru_cache(maxsize=16)
def _load_cached(path: str, modified_ns: int) -> OccupancyGrid:
    del modified_ns
    grid = load_map(Path(path))
    grid.data.setflags(write=False)
    return grid
