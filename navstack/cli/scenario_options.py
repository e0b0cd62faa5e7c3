"""The options of `navstack simulate` that make up a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from navstack.cli import options
from navstack.cli.arguments import extent_text, map_of, note_off_the_map, parse_obstacles, parse_place, scenario_file
from navstack.cli.output import print_warnings
from navstack.core import InputError, is_file
from navstack.fleet import is_fleet_file, shipped_fleets
from navstack.map_io import map_names
from navstack.parameters import load_configuration, short_name
from navstack.scenario import Scenario, load_places, read_scenario, shipped_scenarios

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.fleet import Fleet

TIME_LIMIT_S = 600.0
"""Default time limit of a goal on a map without a scenario (simulated s)."""


def fleet_file(name: str) -> Path | None:
    """Return the path of a fleet file, or of the packaged fleet of that name; None if the name is neither."""
    path = Path(name)
    if is_fleet_file(path):
        return path
    return None if is_file(path) or name in map_names() else shipped_fleets().get(name)


class ScenarioOptions(NamedTuple):
    """A map with start and goals, or a scenario file with overrides."""

    map_: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO.yaml|MAP.yaml",
            help="Scenario file or map_server YAML file, or name of a packaged scenario (narrow_door, ..) or map.",
        ),
    ] = "office"
    start: options.Start = None
    goal: Annotated[
        list[str],
        typer.Option(
            "--goal", metavar="X,Y[,YAW]|PLACE", help="Goal pose in the map frame (m, rad), or a place; repeatable."
        ),
    ] = []
    params: options.ParamsOrScenario = []
    set_: options.Set = []
    distro: options.Distro = None
    allow_missing: options.AllowMissing = False
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed",
            help="Random seed of the simulated noise; equal seeds give equal runs. [default: 0, or that of the scenario]",
            min=0,
        ),
    ] = None
    obstacle: options.Obstacles = []
    time_limit: Annotated[
        float | None,
        typer.Option(
            "--time-limit",
            help=f"Time limit per goal (simulated s). [default: {TIME_LIMIT_S:g}, or that of the scenario]",
            min=0.1,
        ),
    ] = None

    def build(self, *, goals_needed: bool = True) -> Scenario:
        """Loads the scenario and prints the warnings of its parameters. A map may have no goals unless they are needed.

        Raises InputError, MapError, ParameterError or ScenarioError.
        """
        start = parse_place(self.start, "--start", self.map_) if self.start is not None else None
        goals = tuple(parse_place(goal, "--goal", self.map_) for goal in self.goal)
        file = scenario_file(self.map_)
        if file is not None:
            return self._from_file(file, start, goals)
        return self._from_map(start, goals, goals_needed)

    def fleet(self) -> Fleet | None:
        """Build the fleet of a fleet file or of a packaged fleet, with the warnings of its parameters; None for anything else.

        Raises InputError for options that are for one robot, MapError, ParameterError or ScenarioError.
        """
        file = fleet_file(self.map_)
        if file is None:
            return None
        for given, option in ((self.start, "--start"), (self.goal, "--goal"), (self.obstacle, "--obstacle")):
            if given:
                raise InputError(f"{option} is for one robot; write it into the fleet file {file}", argument=option)
        from navstack.fleet import read_fleet

        fleet = read_fleet(file).build(
            params=self.params or None,
            overrides=self.set_,
            distro=self.distro,
            allow_missing=self.allow_missing,
            seed=self.seed,
            time_limit_s=self.time_limit,
        )
        for configuration in {id(r.scenario.configuration): r.scenario.configuration for r in fleet.robots}.values():
            print_warnings(configuration, self.params or [str(file)], self.set_, distro=self.distro, simulated=True)
        return fleet

    def _from_file(self, file: Path, start: Pose2D | None, goals: tuple[Pose2D, ...]) -> Scenario:
        obstacles, shapes = parse_obstacles(self.obstacle)
        spec = read_scenario(file)
        scenario = spec.build(
            params=self.params or None,
            overrides=self.set_,
            distro=self.distro,
            allow_missing=self.allow_missing,
            seed=self.seed,
            time_limit_s=self.time_limit,
            start=start,
            goals=goals or None,
            obstacles=obstacles,
            shapes=shapes,
        )
        sources = self.params or [str(self.map_)]
        print_warnings(scenario.configuration, sources, self.set_, distro=self.distro, simulated=True)
        spec.check_start(scenario)
        return scenario

    def _from_map(self, start: Pose2D | None, goals: tuple[Pose2D, ...], goals_needed: bool) -> Scenario:
        obstacles, shapes = parse_obstacles(self.obstacle)
        path, grid = map_of(self.map_, {"scenario": shipped_scenarios(), "fleet": shipped_fleets()})
        if start is None or (not goals and (goals_needed or self.map_ in map_names())):
            start, goals = self._packaged_poses(path, grid, start, goals)
        params = self.params or ["turtlebot"]
        configuration = load_configuration(
            params, overrides=self.set_, distro=self.distro, allow_missing=self.allow_missing
        )
        print_warnings(configuration, params, self.set_, distro=self.distro, simulated=True)
        note_off_the_map(grid, start, goals)
        return Scenario(
            map=grid,
            configuration=configuration,
            start=start,
            goals=goals,
            obstacles=obstacles,
            shapes=shapes,
            seed=self.seed or 0,
            time_limit_s=TIME_LIMIT_S if self.time_limit is None else self.time_limit,
            names={
                "map": path.name,
                "params": [short_name(p) for p in params],
                "overrides": [str(text) for text in self.set_],
            },
        )

    def _packaged_poses(
        self, path: Path, grid: OccupancyGrid, start: Pose2D | None, goals: tuple[Pose2D, ...]
    ) -> tuple[Pose2D, tuple[Pose2D, ...]]:
        """Start and goals, completed from the places of a packaged map."""
        if self.map_ in map_names():
            packaged = load_places(self.map_)
            return start or packaged.start, goals or packaged.goals
        missing = [name for name, absent in (("--start", start is None), ("--goal", not goals)) if absent]
        raise InputError(
            f"{path.name} defines no start and no goals; give {' and '.join(f'{name} x,y[,yaw]' for name in missing)} "
            f"(m, rad); the map covers {extent_text(grid)}",
            argument=missing[0],
        )


class SimNodeOptions(NamedTuple):
    """How the simulated robot runs as a node of ROS."""

    speed: Annotated[
        float, typer.Option("--speed", help="Simulated seconds per second; not 1 needs --clock.", min=0.01, max=1000.0)
    ] = 1.0
    clock: Annotated[
        bool, typer.Option("--clock/--no-clock", help="Publish /clock for nodes with use_sim_time; start it first.")
    ] = False

    def check(self) -> None:
        """Raise InputError for a speed that the clock of the system does not have."""
        if self.speed != 1.0 and not self.clock:
            raise InputError(f"--speed {self.speed:g} needs simulated time; add --clock", argument="--speed")
