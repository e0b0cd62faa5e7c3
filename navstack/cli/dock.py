"""`navstack dock`: dock a simulated robot, and show how it went."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.arguments import map_of, parse_obstacles, parse_place
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.output import (
    loading_kernels,
    print_files,
    print_json,
    print_warnings,
    reason_of,
    stdout,
    titled_table,
)
from navstack.core import InputError, locked_folder, write_json
from navstack.docking import DockDatabase
from navstack.parameters import load_configuration
from navstack.plot import plot_docking
from navstack.scenario import Scenario, load_places, read_step, run_scenario, warm_up
from navstack.sim import contact_error

if TYPE_CHECKING:
    from navstack.core import Pose2D
    from navstack.parameters import Configuration
    from navstack.scenario import RunResult

OFFICE_DOCK: Final = "2.0,7.45,3.14159"
"""Pose of the dock in the packaged office, for a robot without docks."""
NOISE_RAD_PER_M: Final = math.radians(1.0) / 0.01
"""Error of the yaw of a detection for an error of its position: 2 degrees at 2 cm."""
MARKER_M: Final = {"camera": 0.25, "reflector": 0.32, "none": 0.25}
"""Distance from the docked base to the marker, which leaves a gap to the body of the dock."""


class Detector(StrEnum):
    """What refines the pose of the dock."""

    camera = "camera"
    reflector = "reflector"
    none = "none"


class DockOptions(NamedTuple):
    """A map, a dock, a start."""

    map_: Annotated[
        str, typer.Argument(metavar="MAP.yaml", help="map_server YAML file, or name of a packaged map.")
    ] = "office"
    dock: Annotated[
        str | None,
        typer.Option(
            "--dock",
            metavar="NAME|X,Y,YAW",
            help="Name of a dock of the parameters, or the pose of a docked robot, which faces the dock. [default: the first "
            "dock of the parameters; in the office one in the corridor]",
        ),
    ] = None
    detector: Annotated[
        Detector,
        typer.Option(
            "--detector",
            help="What a dock given by its pose is detected by: a camera that sees a tag, a V-shaped reflector and the lidar, or "
            "nothing.",
        ),
    ] = Detector.camera
    noise: Annotated[
        float, typer.Option("--noise", help="Error of a detection (m, standard deviation); 1 degree per cm.", min=0.0)
    ] = 0.02
    undock: Annotated[bool, typer.Option("--undock", help="Undock afterwards.")] = False
    whole: Annotated[bool, typer.Option("--whole", help="Show the whole way in the picture.")] = False
    start: options.Start = None
    params: options.Params = ["turtlebot"]
    set_: options.Set = []
    distro: options.Distro = None
    seed: Annotated[int, typer.Option("--seed", help="Random seed of the simulated noise.", min=0)] = 0
    obstacle: options.Obstacles = []

    def build(self) -> tuple[Scenario, str]:
        """Return the scenario of the docking, and the name of the dock. Raises InputError, MapError or ParameterError."""
        path, grid = map_of(self.map_)
        base = load_configuration(self.params, distro=self.distro)
        name, overlay = self._overlay(base)
        configuration = load_configuration([*self.params, overlay], overrides=self.set_, distro=self.distro)
        print_warnings(configuration, self.params, self.set_, distro=self.distro, simulated=True)
        obstacles, shapes = parse_obstacles(self.obstacle)
        steps = [read_step({"dock": name}), *([read_step({"undock": True})] if self.undock else [])]
        scenario = Scenario(
            map=grid,
            configuration=configuration,
            start=self._start(path),
            goals=(),
            steps=tuple(steps),
            obstacles=obstacles,
            shapes=shapes,
            seed=self.seed,
            name=f"docking at {name}",
            names={
                "map": path.name,
                "params": [Path(str(one)).name for one in self.params],
                "overrides": list(self.set_),
            },
        )
        return scenario, name

    def _overlay(self, base: Configuration) -> tuple[str, dict[str, Any]]:
        """Return the name of the dock, and the parameters that add it to those of the robot."""
        known = DockDatabase.of(base)
        text = self.dock
        if text is None and known.docks:
            text = next(iter(known.docks))
        if text is None:
            if self.map_ != "office":
                text = "no dock is known; give --dock X,Y,YAW, or list it under docking_server/docks"
                raise InputError(text, argument="--dock")
            text = OFFICE_DOCK
        if "," not in text:
            dock = known.dock(text)
            if text in base.navstack.sim.docks:
                return text, {}
            return text, {
                "navstack": {"sim": {"docks": [*base.navstack.sim.docks, text], text: {"pose": list(dock.pose)}}}
            }
        pose = list(parse_place(text, "--dock", None))
        marker = MARKER_M[self.detector]
        by_lidar = self.detector is Detector.reflector
        dock_type: dict[str, Any] = {
            "plugin": "opennav_docking::SimpleChargingDock",
            "use_external_detection_pose": self.detector is not Detector.none,
            "external_detection_translation_x": -marker,
            "docking_threshold": 0.005,
            "filter_coef": 0.02,
            "detector": {"plugin": "v_reflector" if by_lidar else "pose_topic"},
        }
        camera = {"noise": self.noise, "yaw_noise": self.noise * NOISE_RAD_PER_M}
        body = {"pose": pose, "marker_x": marker, "body": "v_reflector" if by_lidar else "box"}
        sim: dict[str, Any] = {"docks": ["dock"], "dock": body, "dock_camera": camera}
        if by_lidar:  # a lidar that sees the reflector until the robot is docked
            sim["laser"] = {
                "fov": 4.7,
                "beams": 941,
                "range_min": 0.05,
                "range_max": 8.0,
                "range_noise": 0.5 * self.noise,
            }
        server = {"docks": ["dock"], "dock": {"pose": pose}, "simple_charging_dock": dock_type}
        return "dock", {"docking_server": server, "navstack": {"sim": sim}}

    def _start(self, path: Path) -> Pose2D:
        """Return the start: that of the options, or of the places of the map."""
        places = path.with_name(f"{path.stem}.places.yaml")
        if self.start is not None:
            return parse_place(self.start, "--start", path.stem, places if places.exists() else None)
        if self.map_ == "office" and self.dock is None:
            return parse_place("4.5,7.2,0.5", "--start", None)
        start = load_places(places).start_pose if places.exists() else None
        if start is None:
            raise InputError(f"{path.name} has no start pose; give --start X,Y[,YAW]", argument="--start")
        return start


@options.with_options(chosen=DockOptions)
def dock(chosen: DockOptions, out: options.RunOutput = Path("navstack_dock"), json_: options.Json = False) -> int:
    """Dock a simulated robot: drive to the staging pose, detect the dock, drive in, wait for the charging current.

    Without arguments, a turtlebot docks in a packaged office. Prints the states of every attempt and draws the approach.

    Exit codes: 0 docked, 1 not docked, 2 invalid input, 130 interrupted (143 by SIGTERM, 129 by SIGHUP).
    """
    scenario, name = chosen.build()
    with locked_folder(out), interrupt_flag() as interrupt:
        with loading_kernels(scenario.configuration.planner_names, quiet=json_):
            warm_up(scenario)
        result = run_scenario(scenario, stop=interrupt)
        assert result.recorder is not None
        files = save_record(result.recorder, out)
        record = result.recorder.record()
        count = sum(event.kind == "docking" and "parts" in event.data for event in record.events)
        for number, picture in zip(range(1, count + 1), ("dock.png", "undock.png")):
            files[picture.removesuffix(".png")] = str(
                plot_docking(record, out / picture, docking=number, whole=chosen.whole)
            )
        files["summary"] = str(out / "summary.json")
        error = _error(scenario, name, result)
        document = {**result.as_dict(), "error": error, "files": files}
        write_json(out / "summary.json", document)
        if json_:
            print_json(document)
        else:
            _print(result, error, files)
        if interrupt():
            return interrupt.exit_code
    return 0 if all(goal.succeeded for goal in result.goals) else 1


def _error(scenario: Scenario, name: str, result: RunResult) -> dict[str, float] | None:
    """Return how far the docked robot is from the contacts, by its true pose; None if it is not docked at the end."""
    assert result.recorder is not None
    poses = result.recorder.record().poses
    if not result.goals or not result.goals[0].succeeded or len(result.goals) > 1 or not len(poses):
        return None
    x, y, yaw = poses[-1].tolist()
    at = contact_error(scenario.configuration.navstack.sim.dock(name), type(scenario.start)(x, y, yaw))
    return {"x_m": at.x, "y_m": at.y, "yaw_rad": at.yaw}


def _print(result: RunResult, error: dict[str, float] | None, files: dict[str, str]) -> None:
    out = stdout()
    for goal in result.goals:
        docking = goal.figures.get("docking", {})
        table = titled_table(goal.step, left=("state",), right=("attempt", "from", "to", "to the dock"))
        for visit in docking.get("states", ()):
            mark = f" [bold red]{visit['error_code']}[/]" if visit["error_code"] else ""
            distance = visit["distance_m"]
            table.add_row(
                f"{visit['state']}{mark}",
                str(visit["attempt"]),
                f"{visit['begin']:.1f} s",
                f"{visit['end']:.1f} s",
                "" if distance is None else f"{distance:.2f} m",
            )
        out.print(table)
        style = "green" if goal.succeeded else "bold red"
        out.print(f"[{style}]{goal.state}[/]: {escape(goal.text if goal.succeeded else reason_of(goal))}")
    if error is not None:
        millimeters = 1000.0 * math.hypot(error["x_m"], error["y_m"])
        out.print(
            f"true error: {millimeters:.1f} mm, {math.degrees(error['yaw_rad']):+.2f} degrees; seed {result.seed}"
        )
    print_files(files)
