"""The options of `navstack move`, `turn`, `follow` and `teleop` that choose the world and the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.core import Pose2D
    from navstack.motion.steps import Step
    from navstack.scenario import Scenario

TIME_LIMIT_S = 3600.0
"""Time limit of a motion, besides its own (simulated s)."""

World = Annotated[
    str,
    typer.Argument(
        metavar="[MAP|SCENARIO]",
        help="Scenario file or map_server YAML file, or name of a packaged scenario or map.",
        show_default="office",
    ),
]


class MotionOptions(NamedTuple):
    """A map with a start, or a scenario file, of which goals and interactions are not used."""

    start: options.Start = None
    params: options.ParamsOrScenario = []
    set_: options.Set = []
    distro: options.Distro = None
    seed: Annotated[
        int | None, typer.Option("--seed", help="Random seed of the simulated noise. [default: 0]", min=0)
    ] = None
    obstacle: options.Obstacles = []

    def build(self, world: str, steps: tuple[Step, ...], *, start: Pose2D | None = None) -> Scenario:
        """Returns a scenario with these steps instead of goals; `start` counts if `--start` is not given.

        Prints the warnings of the parameters. Raises InputError, MapError, ParameterError or ScenarioError.
        """
        from navstack.cli.arguments import parse_pose, scenario_file
        from navstack.core.errors import InputError
        from navstack.scenario import SuccessConditions

        if world.startswith("-"):  # negative numbers are allowed as arguments, so unknown options arrive here
            raise InputError(f'there is no option "{world}"; `--help` lists the options', argument=world)
        begin = parse_pose(self.start, "--start") if self.start is not None else start
        file = scenario_file(world)
        scenario = self._from_map(world, begin) if file is None else self._from_file(file, begin)
        return replace(scenario, goals=(), steps=steps, interactions=(), success=SuccessConditions())

    def _from_file(self, file: Path, start: Pose2D | None) -> Scenario:
        from navstack.cli.arguments import parse_obstacles
        from navstack.cli.output import print_warnings
        from navstack.scenario import read_scenario

        obstacles, shapes = parse_obstacles(self.obstacle)
        scenario = read_scenario(file).build(
            params=self.params or None,
            overrides=self.set_,
            distro=self.distro,
            seed=self.seed,
            start=start,
            time_limit_s=TIME_LIMIT_S,
            obstacles=obstacles,
            shapes=shapes,
        )
        print_warnings(scenario.configuration)
        return scenario

    def _from_map(self, name: str, start: Pose2D | None) -> Scenario:
        from navstack.cli.arguments import extent_text, map_of, note_off_the_map, parse_obstacles
        from navstack.cli.output import print_warnings
        from navstack.core.errors import InputError
        from navstack.map_io import map_names
        from navstack.parameters.configuration import load_configuration
        from navstack.parameters.sources import short_name
        from navstack.places import load_places
        from navstack.scenario import Scenario, shipped_scenarios

        path, grid = map_of(name, others=shipped_scenarios(), what="scenario")
        if start is None and name in map_names():
            start = load_places(name).start
        if start is None:
            raise InputError(
                f"{path.name} defines no start; give --start x,y[,yaw] (m, rad); the map covers {extent_text(grid)}",
                argument="--start",
            )
        params = self.params or ["turtlebot"]
        configuration = load_configuration(params, overrides=self.set_, distro=self.distro)
        print_warnings(configuration)
        note_off_the_map(grid, start, ())
        obstacles, shapes = parse_obstacles(self.obstacle)
        return Scenario(
            map=grid,
            configuration=configuration,
            start=start,
            goals=(),
            obstacles=obstacles,
            shapes=shapes,
            seed=self.seed or 0,
            time_limit_s=TIME_LIMIT_S,
            names={"map": path.name, "params": [short_name(p) for p in params], "overrides": list(self.set_)},
        )
