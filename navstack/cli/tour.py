"""`navstack tour`: drive to named places, one after another."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.arguments import map_of, parse_obstacles, parse_place
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.output import (
    Verbosity,
    counted,
    loading_kernels,
    print_advice,
    print_files,
    print_json,
    print_warnings,
    reason_of,
    stderr,
    stdout,
    titled_table,
    verbosity,
)
from navstack.core import InputError, locked_folder, write_json
from navstack.map_io import map_names, map_path
from navstack.parameters import load_configuration
from navstack.plot import plot_run
from navstack.scenario import (
    EXAMPLES,
    Scenario,
    drive_tour,
    load_places,
    read_step,
    step_text,
    visit_order,
    warm_up,
)

if TYPE_CHECKING:
    from navstack.cli.interrupts import Interrupt
    from navstack.core import Pose2D
    from navstack.scenario import GoalOutcome, Places, Step, TourResult, TourState

# ----------------------------------------------------------------------------------------------------------------------
# The options of `navstack tour` that make up a tour.


class TourOrder(StrEnum):
    """Order in which the places are visited."""

    given = "given"
    sorted = "sorted"
    random = "random"


class TourOptions(NamedTuple):
    """Places on a map, and how to visit them."""

    places: Annotated[
        str,
        typer.Argument(
            metavar="PLACES.yaml",
            help="File of places (.yaml, .csv with x,y,yaw, .geojson with points), or name of a packaged map.",
        ),
    ] = "office"
    map_: Annotated[
        str | None,
        typer.Argument(
            metavar="MAP.yaml",
            help="map_server YAML file, or name of a packaged map. [default: NAME.yaml next to NAME.places.yaml]",
        ),
    ] = None
    place: Annotated[
        list[str], typer.Option("--place", metavar="NAME", help="Visit only these places, in this order (repeatable).")
    ] = []
    every: Annotated[bool, typer.Option("--all", help="Visit every place of the file instead of its goals.")] = False
    step: Annotated[
        list[str],
        typer.Option(
            "--step",
            metavar="STEP",
            help="Do these steps instead, in this order (repeatable): kitchen, '{move: 0.5}', '{turn: 90 deg}', "
            "'{follow: heart}', '{wait: 2}', '{drive_to: [x, y, yaw]}'.",
        ),
    ] = []
    order: Annotated[
        TourOrder, typer.Option("--order", help="Order of the visits: as given, by name, or shuffled by the seed.")
    ] = TourOrder.given
    loops: Annotated[int, typer.Option("--loops", help="How often to drive the tour.", min=1, max=1000)] = 1
    goal_index: Annotated[
        int,
        typer.Option("--goal-index", help="Begin with this goal, counted from 0; later loops have all of them.", min=0),
    ] = 0
    through: Annotated[
        bool,
        typer.Option("--through/--stop", help="Pass places within 0.7 m without a stop; only the last one is reached."),
    ] = False
    rest: Annotated[float, typer.Option("--rest", help="Pause between two goals (simulated s).", min=0.0)] = 0.0
    time_limit: Annotated[float, typer.Option("--time-limit", help="Time limit per goal (simulated s).", min=0.1)] = (
        300.0
    )
    stop_on_failure: Annotated[
        bool,
        typer.Option("--stop-on-failure/--continue-on-failure", help="End the tour at a failed goal, or continue."),
    ] = False
    start: options.Start = None
    params: options.Params = ["turtlebot"]
    set_: options.Set = []
    distro: options.Distro = None
    seed: Annotated[
        int, typer.Option("--seed", help="Random seed of the simulated noise and of --order random.", min=0)
    ] = 0
    obstacle: options.Obstacles = []

    def build(self) -> tuple[Scenario, tuple[str, ...]]:
        """Loads the tour: its scenario, and the place name of every goal.

        Prints the warnings of the parameters. Raises InputError, MapError or ParameterError.
        """
        file, map_name = self._files()
        places = load_places(file)
        path, grid = map_of(map_name)
        steps = self._steps(places)
        names = tuple(step_text(step) for step in steps) or self._names(file, places)
        if self.goal_index >= len(names) // self.loops:
            last = len(names) // self.loops - 1
            raise InputError(
                f"--goal-index {self.goal_index}: the tour has the goals 0 to {last}", argument="--goal-index"
            )
        names, steps = names[self.goal_index :], steps[self.goal_index :]
        start = self._start(file, places)
        configuration = load_configuration(self.params, overrides=self.set_, distro=self.distro)
        print_warnings(configuration, self.params, self.set_, distro=self.distro, simulated=True)
        obstacles, shapes = parse_obstacles(self.obstacle)
        scenario = Scenario(
            map=grid,
            configuration=configuration,
            start=start,
            goals=() if steps else tuple(places.places[name] for name in names),
            steps=steps,
            obstacles=obstacles,
            shapes=shapes,
            seed=self.seed,
            time_limit_s=self.time_limit,
            pause_s=self.rest,
            pass_through=self.through,
            stop_on_failure=self.stop_on_failure,
            names={
                "map": path.name,
                "params": [Path(p).name for p in self.params],
                "overrides": [str(text) for text in self.set_],
                "places": list(names),
            },
        )
        return scenario, names

    def _steps(self, places: Places) -> tuple[Step, ...]:
        """The steps of `--step`, or those of the file, as often as `--loops`; empty for a tour of places only."""
        if self.step and (self.place or self.every):
            raise InputError("give either --step, or --place and --all", argument="--step")
        listed = tuple(_parsed_step(text, places) for text in self.step)
        if not listed and not self.place and not self.every:
            listed = places.steps
        if listed and self.order is not TourOrder.given:
            raise InputError(
                f"--order {self.order.value} is for tours of places only: the steps of this tour depend on their order",
                argument="--order",
            )
        return listed * self.loops

    def _files(self) -> tuple[Path, str]:
        """The file of the places, and the file or packaged name of their map."""
        file, map_name = Path(self.places), self.map_
        if not file.exists() and self.places in map_names():
            map_name = map_name or self.places
            file = map_path(self.places).with_name(f"{self.places}.places.yaml")
        if map_name is not None:
            return file, map_name
        beside = file.with_name(file.name.removesuffix(".places.yaml") + ".yaml")
        if file.exists() and (beside == file or not beside.exists()):
            raise InputError(
                f"no map is given for the places in {file.name}; add it after the file: "
                f"navstack tour {self.places} MAP.yaml",
                argument="MAP.yaml",
            )
        return file, str(beside)

    def _start(self, file: Path, places: Places) -> Pose2D:
        start = parse_place(self.start, "--start", file.name, file) if self.start is not None else places.start_pose
        if start is None:
            raise InputError(f"{file.name} defines no start pose; give --start x,y[,yaw]", argument="--start")
        return start

    def _names(self, file: Path, places: Places) -> tuple[str, ...]:
        """Names of the places in the order of the visits."""
        unknown = [name for name in self.place if name not in places.places]
        if unknown:
            raise InputError(
                f'--place "{unknown[0]}" is not in {file.name}; its places: {", ".join(places.places)}',
                argument="--place",
            )
        names = tuple(self.place) or (tuple(places.places) if self.every else places.goal_names)
        return visit_order(names, self.order.value, loops=self.loops, seed=self.seed)


def _parsed_step(text: str, places: Places) -> Step:
    """A step of the command line: the name of a place, or a mapping in YAML. Raises InputError."""
    import yaml

    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        value = None
    if isinstance(value, dict):
        return read_step({str(key): item for key, item in value.items()}, places=places.places)
    if value is None or isinstance(value, list):
        raise InputError(f'--step "{text}" is neither the name of a place nor a step: {EXAMPLES}', argument="--step")
    return read_step({"goto": text.strip()}, places=places.places)


@options.with_options(chosen=TourOptions)
def tour(
    chosen: TourOptions,
    out: options.RunOutput = Path("navstack_tour"),
    json_: options.Json = False,
) -> int:
    """Drive a simulated robot to named places. Ctrl-C, SIGTERM and SIGHUP stop the robot and keep record and log.

    Exit codes: 0 every goal SUCCEEDED, 1 some did not, 2 invalid input, 130 interrupted (143 by SIGTERM, 129 by SIGHUP).
    """
    scenario, names = chosen.build()
    with locked_folder(out), interrupt_flag() as interrupt:
        return _tour(scenario, names, out, interrupt, json_=json_)


def _tour(scenario: Scenario, names: tuple[str, ...], folder: Path, interrupt: Interrupt, *, json_: bool) -> int:
    with loading_kernels(scenario.configuration.planner_names, quiet=json_):
        warm_up(scenario)
    result = _drive(scenario, names, interrupt, quiet=json_)
    recorder = result.run.recorder
    assert recorder is not None
    files = save_record(recorder, folder)
    plot_run(recorder.record(), folder / "run.png")
    files |= {"picture": str(folder / "run.png"), "summary": str(folder / "summary.json")}
    document = {**result.as_dict(), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        _print(result, files)
    if result.interrupted:
        return interrupt.exit_code
    return 0 if result.succeeded else 1


def _drive(scenario: Scenario, names: tuple[str, ...], interrupt: Interrupt, *, quiet: bool) -> TourResult:
    """Drives the tour; prints each goal's outcome to stderr unless `quiet`, and shows the state on a terminal."""

    def print_outcome(name: str, outcome: GoalOutcome, state: TourState) -> None:
        if not quiet and verbosity() is not Verbosity.QUIET:
            why = "" if outcome.succeeded else f", {reason_of(outcome)}"
            stderr().print(f"{name}: {outcome.state} after {outcome.time_s:.1f} s{why}; {state}", markup=False)

    with stderr().status("starting") as line:
        if quiet or verbosity() is Verbosity.QUIET:
            line.stop()
        shown = -1.0

        def show(state: TourState) -> None:
            nonlocal shown
            if state.running_s - shown >= 1.0:
                shown = state.running_s
                line.update(f"{state.place or 'waiting'}: {state}")

        return drive_tour(scenario, names, on_goal=print_outcome, on_step=show, stop=interrupt)


def _print(result: TourResult, files: dict[str, str]) -> None:
    out = stdout()
    table = titled_table("tour", left=("place", "state"), right=("time", "driven", "recoveries"))
    for name, goal in zip(result.names, result.run.goals):
        style = "green" if goal.succeeded else "bold red"
        table.add_row(
            escape(name),
            f"[{style}]{goal.state}[/]",
            f"{goal.time_s:.1f} s",
            f"{goal.path_length_m:.2f} m",
            str(goal.recoveries),
        )
    out.print(table)
    for name, goal in zip(result.names, result.run.goals):
        if not goal.succeeded:
            out.print(escape(f"{name}: {reason_of(goal)}"))
    print_advice(result.run.advice)
    out.print(_totals(result))
    print_files(files)


def _totals(result: TourResult) -> str:
    rate = result.state.success_rate
    success = "no goal has ended" if rate is None else f"success rate {100.0 * rate:.0f} %"
    left = len(result.names) - len(result.run.goals)
    return (
        f"{success} ({result.state.succeeded} of {result.state.done}), {result.state.running_s:.1f} s, "
        f"{result.state.distance_m:.2f} m driven, {counted(result.run.collisions, 'collision')}"
        + (f"; {counted(left, 'goal')} skipped" if left else "")
        + ("; interrupted" if result.interrupted else "")
    )
