"""A scenario whose map and parameters are still to be loaded, and the checks of its start and goals against the map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import shapely

from navstack.core import Footprint, InputError, OccupancyGrid, Pose2D, ScenarioError
from navstack.map_io import load_map
from navstack.parameters import Configuration, Finding, Location, Source, finding, load_configuration
from navstack.plugins import ParamModel, param
from navstack.scenario.fields import described
from navstack.scenario.places import visit_order
from navstack.scenario.scenario import Scenario
from navstack.scenario.steps import Step
from navstack.scenario.success import SuccessConditions
from navstack.sim import OCCUPIED, PedestrianMotion, Shape, Still


class Tour(ParamModel):
    """`tour:` places to visit, by name."""

    places: list[str] | None = param(None, "names of places, in order; default: all places of the map")
    order: Literal["given", "sorted", "random"] = param("given", "as listed, by name, or shuffled with the seed")
    loops: int = param(1, "number of repetitions of the tour", ge=1, le=1000)


@dataclass(slots=True, eq=False)
class ScenarioSpec:
    """A scenario whose parameters are still open: read from a file, or one of a suite.

    `build` creates the scenario and may be called repeatedly. A few kB when pickled, if the map is a file.
    """

    values: dict[str, Any] = field(default_factory=dict[str, Any])
    """The fields of `Scenario` that it sets: start, goals, shapes, seed, .."""
    path: Path | None = None
    """The file it was read from."""
    map_file: Path | None = None
    grid: OccupancyGrid | None = None
    """The map itself, if it does not come from a file."""
    sources: list[Source] = field(default_factory=list[Source])
    """Parameter sources: `params:`."""
    overlays: list[Source] = field(default_factory=list[Source])
    """Parameters that override the sources: `set:`, then `sim:`."""
    description: Annotated[str, described("what the scenario shows, in one or two sentences")] = ""
    distro: Annotated[
        Literal["noetic", "indigo"] | None,
        described("ROS release whose DWA cost scaling is used; default: as the parameters say"),
    ] = None
    allow_missing: Annotated[
        bool, described("omit layers and plugins that are not installed instead of rejecting the file")
    ] = False
    goal_names: tuple[str, ...] = ()
    """Places of the goals, empty for a pose; motions in words."""
    tour: Tour | None = None
    tour_names: tuple[str, ...] = ()
    """Places of the tour as listed; `tour` has the order in which they are visited."""
    places: Mapping[str, Pose2D] = field(default_factory=dict[str, Pose2D])
    start_location: Location = Location("")
    goal_locations: tuple[Location, ...] = ()

    @property
    def name(self) -> str:
        """The name of the scenario; default: the name of its file."""
        return self.values.get("name") or (self.path.stem if self.path is not None else "scenario")

    @property
    def start(self) -> Pose2D | None:
        """The start; None in a file that could not be read."""
        return self.values.get("start")

    @property
    def goals(self) -> tuple[Pose2D, ...]:
        """The goals, in the order of the seed."""
        return self.values.get("goals", ())

    @property
    def steps(self) -> tuple[Step, ...]:
        """Goals and motions, if there are motions among the goals."""
        return self.values.get("steps", ())

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The obstacles that are not on the map."""
        return self.values.get("shapes", ())

    @property
    def success(self) -> SuccessConditions:
        """The conditions that a run must meet."""
        return self.values.get("success", SuccessConditions())

    def map(self) -> OccupancyGrid:
        """Returns the map. It is read-only: scenarios on the same map share it. Raises MapError."""
        if self.grid is not None:
            return self.grid
        assert self.map_file is not None
        return cached_map(self.map_file)

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
        configuration: Configuration | None = None,
    ) -> Scenario:
        """Builds the scenario; the arguments replace the values of the file.

        `params` replace the file's `params:`; its `set:` and `sim:` override them, and `overrides` (`NAME=VALUE`) override
        everything. `obstacles` (x, y, radius in m) and `shapes` are added to those of the file. `seed` also determines the
        order of a random tour. `allow_missing` omits layers and plugins that are not installed. `configuration`: the parameters,
        if they are loaded already.

        Raises MapError, ParameterError or InputError.
        """
        if goals is not None and not goals:
            raise InputError("goals is empty; give at least one goal, or goals=None for those of the scenario")
        if time_limit_s is not None and not time_limit_s > 0.0:
            raise InputError(f"time_limit_s is {time_limit_s:g} s; it must be above 0 s", time_limit_s=time_limit_s)
        assert self.start is not None
        sources = [*(self.sources if params is None else params), *self.overlays]
        if configuration is None:
            configuration = load_configuration(
                sources,
                overrides=overrides,
                distro=distro or self.distro,
                allow_missing=allow_missing or self.allow_missing,
            )
        values: dict[str, Any] = {**self.values, "name": self.name, "shapes": (*self.shapes, *shapes)}
        given: dict[str, Any] = {"seed": seed, "time_limit_s": time_limit_s, "start": start}
        values |= {name: value for name, value in given.items() if value is not None}
        names, values["goals"] = self._goals(values.get("seed", 0))
        if goals is not None:
            names, values["goals"], values["steps"] = (), tuple(goals), ()
        return Scenario(
            map=self.map(),
            configuration=configuration,
            obstacles=tuple(obstacles),
            names=self._source_names(sources, overrides, names),
            **values,
        )

    def _goals(self, seed: int) -> tuple[tuple[str, ...], tuple[Pose2D, ...]]:
        """Returns the names and the poses of the goals."""
        if self.steps:
            return self.goal_names, ()
        if self.tour is None:
            return self.goal_names, self.goals
        names = visit_order(self.tour_names, self.tour.order, loops=self.tour.loops, seed=seed)
        return names, tuple(self.places[name] for name in names)

    def _source_names(
        self, sources: Sequence[Source], overrides: Sequence[str], places: Sequence[str]
    ) -> dict[str, Any]:
        names: dict[str, Any] = {
            "scenario": self.path.name if self.path is not None else self.name,
            "map": self.name if self.map_file is None else self.map_file.name,
            "params": [Path(s).name for s in sources if isinstance(s, (str, Path))],
            "overrides": [str(text) for text in overrides],
        }
        if any(places):
            names["places"] = [name or None for name in places]
        return names

    def check_start(self, scenario: Scenario) -> None:
        """Raises ScenarioError, with the file's line, if the robot of `scenario` cannot be at the file's start."""
        if scenario.start == self.start:
            findings = check_start_on_map(self, scenario.map) or check_start_collision(
                self, scenario.map, scenario.configuration
            )
            if findings:
                raise scenario_error(findings)


def single_goal_spec(name: str, start: Pose2D, goal: Pose2D, time_limit_s: float, **others: Any) -> ScenarioSpec:
    """Returns a scenario with one goal and the parameter set `turtlebot`; `others` are further fields of `ScenarioSpec`.

    `shapes` among them are its obstacles.
    """
    values = {"name": name, "start": start, "goals": (goal,), "time_limit_s": time_limit_s}
    values["shapes"] = others.pop("shapes", ())
    return ScenarioSpec(values, sources=["turtlebot"], goal_names=("",), **others)


def scenario_error(errors: Sequence[Finding]) -> ScenarioError:
    """Returns the exception for a scenario with these errors."""
    count = "" if len(errors) == 1 else f" ({len(errors)} errors)"
    lines = "\n".join(f"{f.location}: {f.message}" for f in errors)
    return ScenarioError(f"invalid scenario{count}:\n{lines}", findings=[f.as_dict() for f in errors])


def check_start_on_map(spec: ScenarioSpec, grid: OccupancyGrid) -> list[Finding]:
    """Returns an error if the start is outside the map or in a wall."""
    problem = None if spec.start is None else _problem_on_map(grid, spec.start)
    if spec.start is None or problem is None:
        return []
    message = f"the start ({spec.start.x:g}, {spec.start.y:g}) {problem}; move it"
    return [finding("error", "start", spec.start_location, "start", message)]


def check_goals_on_map(spec: ScenarioSpec, grid: OccupancyGrid) -> list[Finding]:
    """Returns a warning for each goal outside the map or in a wall, unless the scenario expects it to fail."""
    findings: list[Finding] = []
    expected = spec.success.goals
    for i, (goal, at) in enumerate(zip(spec.goals, spec.goal_locations)):
        state = expected if isinstance(expected, str) else expected[i] if i < len(expected) else "any"
        problem = _problem_on_map(grid, goal)
        if problem is not None and state == "SUCCEEDED":
            message = (
                f"goal {i + 1} ({goal.x:g}, {goal.y:g}) {problem} and cannot be reached; move it, or expect ABORTED under "
                "`success: goals:`"
            )
            findings.append(finding("warning", "goal", at, "goals", message))
    return findings


def check_start_collision(spec: ScenarioSpec, grid: OccupancyGrid, configuration: Configuration) -> list[Finding]:
    """Returns an error if the robot's footprint collides with an obstacle at the start."""
    if spec.start is None:
        return []
    obstacle = collision_at_start(configuration.local_costmap.true_footprint, spec.start, grid, spec.shapes)
    if obstacle is None:
        return []
    x, y, yaw = spec.start
    message = f"the robot at the start ({x:g}, {y:g}, {yaw:g}) collides with {obstacle}; move the start"
    return [finding("error", "start", spec.start_location, "start", message)]


def collision_at_start(
    footprint: Footprint, start: Pose2D, grid: OccupancyGrid, shapes: Sequence[Shape] = ()
) -> str | None:
    """Describes what the footprint collides with at the start; None if it is free. Uses shapely: compiles no kernel.

    Checks static `shapes` and pedestrians; the simulation checks shapes on tracks and doors.
    """
    outline = shapely.Polygon(footprint.at(start))
    cell = _occupied_cell(footprint, start, grid)
    if cell is not None:
        return f"a wall of the map at ({cell[0]:.2f}, {cell[1]:.2f})"
    for number, shape in enumerate(shapes, 1):
        if not isinstance(shape.motion, (Still, PedestrianMotion)):
            continue
        x, y, yaw = shape.pose
        if shape.radius is not None:
            collides = outline.distance(shapely.Point(x, y)) < shape.radius
        else:
            c, s = math.cos(yaw), math.sin(yaw)
            collides = outline.intersects(
                shapely.Polygon([(x + c * u - s * v, y + s * u + c * v) for u, v in shape.outline()])
            )
        if collides:
            return f'shape {number} "{shape.name}"' if shape.name else f"shape {number}"
    return None


def _occupied_cell(footprint: Footprint, start: Pose2D, grid: OccupancyGrid) -> tuple[float, float] | None:
    """Returns the center (m, map) of an occupied cell that the footprint overlaps."""
    geometry = grid.geometry
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = start.x - geometry.origin_x, start.y - geometry.origin_y
    # the footprint in cells of the unrotated grid
    pose = Pose2D(c * dx + s * dy, c * dy - s * dx, start.yaw - grid.origin_yaw)
    outline = footprint.at(pose) / geometry.resolution
    last = np.array([geometry.nx - 1, geometry.ny - 1])
    low = np.clip(np.floor(outline.min(axis=0)), 0, last).astype(np.int64)
    high = np.clip(np.floor(outline.max(axis=0)), 0, last).astype(np.int64)
    iy, ix = np.nonzero(grid.data[low[1] : high[1] + 1, low[0] : high[0] + 1] >= OCCUPIED)
    ix, iy = ix + low[0], iy + low[1]
    cells = shapely.box(ix, iy, ix + 1, iy + 1)
    hit = np.nonzero(shapely.intersects(shapely.Polygon(outline), cells))[0]
    if not len(hit):
        return None
    u = (float(ix[hit[0]]) + 0.5) * geometry.resolution
    v = (float(iy[hit[0]]) + 0.5) * geometry.resolution
    return geometry.origin_x + c * u - s * v, geometry.origin_y + s * u + c * v


def _problem_on_map(grid: OccupancyGrid, pose: Pose2D) -> str | None:
    """Describes why the robot cannot be at a position of the map; None if it can."""
    geometry = grid.geometry
    # rotate the position back about the corner of a rotated map
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = pose.x - geometry.origin_x, pose.y - geometry.origin_y
    cell = geometry.world_to_cell(geometry.origin_x + c * dx + s * dy, geometry.origin_y + c * dy - s * dx)
    if cell is None:
        left, right, bottom, top = geometry.extent
        rotated = f", rotated by {grid.origin_yaw:g} rad about its origin" if grid.origin_yaw != 0.0 else ""
        return f"is outside the map, which covers x {left:g} .. {right:g}, y {bottom:g} .. {top:g} m{rotated}"
    return "is in a wall of the map" if grid.data[cell[1], cell[0]] >= OCCUPIED else None


def cached_map(path: Path) -> OccupancyGrid:
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
