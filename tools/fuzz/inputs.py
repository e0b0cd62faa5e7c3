"""The valid files, the mutated inputs made of them, and what reads each input."""

from __future__ import annotations

import os
import random
import socket
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from navstack.core import Footprint, GridGeometry, OccupancyGrid, Pose2D, RobotState, Transform2D, Twist2D
from navstack.map_io import load_map, load_mask
from navstack.parameters import check_parameters, load_configuration, packaged_folder, read_sources
from navstack.record import Record, RunRecorder
from navstack.scenario import Scenario, check_scenario, load_places, load_worlds, read_scenario, shipped_scenarios
from tools.fuzz.arrays import mutated_archive, packed
from tools.fuzz.images import mutated_image
from tools.fuzz.launch import mutated_launch
from tools.fuzz.logs import mutated_log, read_log, valid_logs
from tools.fuzz.mapping import build_map, mutated_scans, valid_scans
from tools.fuzz.text import mutated_yaml
from tools.fuzz.trees import mutated_tree, read_tree
from tools.fuzz.values import SPECIAL_FILES

KINDS: Final = ("map", "record", "scenario", "parameters", "nav2", "launch", "log", "tree")
SLOW_KINDS: Final = ("mapping",)
"""Kinds that take 100 times as long as the others, and so are made only where they are asked for."""
_SUFFIXES: Final = {
    "map": ".yaml",
    "record": ".npz",
    "scenario": ".yaml",
    "parameters": ".yaml",
    "nav2": ".yaml",
    "launch": ".launch",
    "log": ".bag",
    "mapping": ".clf",
    "tree": ".xml",
}
_SPECIAL_SHARE: Final = 0.01
_CHECK_SHARE: Final = 0.02
"""Share of the parameter inputs that are checked completely; the others are read and merged."""
_NAV2_CHECK_SHARE: Final = 0.2
"""The same of Nav2's files, most of which are rejected early."""

_NAV2: Final = Path(__file__).resolve().parents[2] / "tests" / "parameters" / "nav2_robot.yaml"
_NAV2_KEYS: Final = (
    b"plugin",
    b"ros__parameters",
    b"FollowPath",
    b"critics",
    b"observation_sources",
    b"/**",
    b"plugins",
)
"""Names that decide the structure of Nav2's files."""

_MAP: Final = (
    b"image: small.png\nmode: trinary\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
    b"occupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
_PLACES: Final = (
    b"places:\n  dock: [0.2, 0.1, 0.0]\n  desk: {x: 0.3, y: 0.2, yaw: 1.57}\n  door:\n    position: {x: 0.4, y: 0.1, z: 0.0}\n"
    b"    orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}\nstart: [0.2, 0.2, 0.0]\ngoals: [dock, desk]\n"
)
_SMALL_SCENARIO: Final = (
    b"map: small.yaml\nparams: turtlebot\nstart: [0.2, 0.2, 0.0]\ngoals:\n  - [0.4, 0.2, 0.0]\ntime_limit_s: 20\n"
    b"seed: 3\n"
)
_LAUNCH: Final = (
    '<launch>\n<arg name="f" default="odom"/>\n<include file="$(find x)/y.launch"><arg name="a" value="1"/></include>\n'
    '<group ns="g" if="false"/>\n<node pkg="move_base" type="move_base" name="move_base">\n'
    '<rosparam file="common.yaml" command="load" ns="local_costmap" />\n<rosparam file="planner.yaml" command="load" />\n'
    '<param name="controller_frequency" value="5.0" type="double"/>\n<rosparam>\nplanner_patience: 5.0\n</rosparam>\n'
    '<param name="local_costmap/global_frame" value="$(arg f)"/>\n<remap from="scan" to="/s"/>\n</node>\n</launch>\n'
)


class CommandError(Exception):
    """A command ended with the exit code of an internal error."""


@dataclass(frozen=True, slots=True)
class Input:
    """One input: its main file, what reads it, and the reader's name."""

    path: Path
    read: Callable[[], object]
    reader: str


class Inputs:
    """The valid files in a folder, and the inputs made of them. `commands`: share of inputs read by a whole command."""

    def __init__(self, folder: Path, *, commands: float = 0.0) -> None:
        self.folder = folder
        self.commands = commands
        self.map = _MAP
        Image.fromarray(np.full((8, 12), 254, np.uint8)).save(folder / "small.png")
        (folder / "small.yaml").write_bytes(_MAP)
        self.scenarios = [*(path.read_bytes() for path in shipped_scenarios().values()), _SMALL_SCENARIO]
        sets = sorted(packaged_folder("turtlebot").glob("*.yaml"))
        self.parameters = [path.read_bytes() for path in sets]
        self.nav2 = _NAV2.read_bytes()
        for path in sets:
            (folder / path.name).write_bytes(path.read_bytes())
        self.launch = _LAUNCH.format(
            files="".join(f'<rosparam file="{p.name}" command="load" />\n' for p in sets)
        ).encode()
        self.members = _record_members()
        self.worlds = _world_members()
        self.logs = valid_logs(folder)
        self.scans = valid_scans()
        _make_special_files(folder)

    def make(self, kind: str, rng: random.Random) -> Input:
        """Write one mutated input, and return what reads it; the same `rng` gives the same input."""
        if rng.random() < _SPECIAL_SHARE:
            path = self.folder / f"{rng.choice(SPECIAL_FILES[:7])}{_SUFFIXES[kind]}"
            return Input(path, self._readers(kind, path, rng), "special file")
        match kind:
            case "map":
                return self._map(rng)
            case "record":
                if rng.random() < 0.05:
                    path = self._write("worlds.npz", mutated_archive(self.worlds, rng))
                    return Input(path, lambda: load_worlds(path), "worlds")
                path = self._write("run.npz", mutated_archive(self.members, rng))
            case "scenario":
                path = self._write("scenario.yaml", mutated_yaml(rng.choice(self.scenarios), rng))
            case "log":
                name = rng.choice(sorted(self.logs))
                path = self._write(f"fuzzed.{name}", mutated_log(self.logs[name], rng))
            case "mapping":
                path = self._write("fuzzed.clf", mutated_scans(self.scans, rng))
            case "tree":
                path = self._write("fuzzed.xml", mutated_tree(rng))
            case "parameters":
                path = self._write("fuzzed.yaml", mutated_yaml(rng.choice(self.parameters), rng))
            case "nav2":
                data = mutated_yaml(self.nav2, rng)
                for _ in range(rng.randrange(3)):
                    data = data.replace(rng.choice(_NAV2_KEYS), rng.choice(_NAV2_KEYS), rng.randrange(1, 4))
                path = self._write("nav2.yaml", data)
            case _:
                path = self._write("fuzzed.launch", mutated_launch(self.launch, rng))
        return Input(path, self._readers(kind, path, rng), kind)

    def _map(self, rng: random.Random) -> Input:
        chance = rng.random()
        if chance < 0.1:
            path = self._write("places.yaml", mutated_yaml(_PLACES, rng))
            return Input(path, lambda: load_places(path), "places")
        if chance < 0.4:
            (self.folder / "mutated.png").write_bytes(mutated_image(rng))
            path = self._write("map.yaml", self.map.replace(b"small.png", b"mutated.png"))
            return Input(path, self._readers("map", path, rng), "image")
        path = self._write("map.yaml", mutated_yaml(self.map, rng))
        return Input(path, self._readers("map", path, rng), "map")

    def _readers(self, kind: str, path: Path, rng: random.Random) -> Callable[[], object]:
        """What reads a file of the kind: the reader that commands use, or a whole command."""
        chance, name = rng.random(), str(path)
        if rng.random() < self.commands and kind != "tree":
            return lambda: _command(_arguments(kind, name, chance))
        match kind:
            case "map":
                return lambda: _use_map(load_mask(path) if chance < 0.1 else load_map(path))
            case "record":
                return lambda: _use_record(path, again=chance < 0.05)
            case "tree":
                return lambda: read_tree(path)
            case "mapping":
                return lambda: build_map(path, rng)
            case "log":
                return lambda: read_log(path, partial=chance < 0.5)
            case "scenario":
                return lambda: check_scenario(path) if chance < _CHECK_SHARE else read_scenario(path)
            case "parameters" if chance < _CHECK_SHARE:
                return lambda: check_parameters(["turtlebot", name])
            case "nav2" if chance < _NAV2_CHECK_SHARE:
                return lambda: check_parameters([name], allow_missing=chance < 0.1)
            case "launch" if chance < _CHECK_SHARE:
                return lambda: check_parameters([name])
            case _:
                return lambda: read_sources([name])

    def _write(self, name: str, data: bytes) -> Path:
        path = self.folder / name
        path.write_bytes(data)
        return path


# --- readers --------------------------------------------------------------------------------------------------------------


def _use_map(grid: OccupancyGrid) -> None:
    geometry = grid.geometry
    assert grid.data.dtype == np.int8
    assert grid.data.shape == (geometry.ny, geometry.nx)
    _ = geometry.extent, geometry.world_to_cell(0.1, 0.1)


def _use_record(path: Path, *, again: bool) -> None:
    record = Record.load(path)
    assert record.poses.shape[1] == 3
    _ = record.plans, record.scans, record.goals, record.collisions, record.path_length
    if again:
        Scenario.from_record(record).world()


def _arguments(kind: str, name: str, chance: float) -> list[str]:
    match kind:
        case "map":
            return ["plan", name, "--start", "0.2,0.2", "--goal", "0.4,0.2", "--json"]
        case "record":
            return ["explain", "goal", name, "--json"]
        case "log":
            return ["bag", "info", name, "--partial", *(["--json"] if chance < 0.5 else [])]
        case "mapping":
            return ["map", "build", name, "--out", str(Path(name).with_name("built.yaml")), "--json"]
        case "parameters" if chance < 0.5:
            return ["check", "turtlebot", name, "--json"]
        case _:
            return ["check", name, *(["--json"] if chance < 0.5 else [])]


def _command(arguments: list[str]) -> None:
    """Run a whole command in this process. Raises CommandError if it ends with an internal error."""
    from navstack.cli.app import run

    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as errors:
        code = run(arguments)
    if code not in (0, 1, 2):
        raise CommandError(f"exit code {code}: {errors.getvalue()[-300:]}")


# --- valid files ------------------------------------------------------------------------------------------------------------


def _record_members() -> dict[str, bytes]:
    """A short record, with a scenario that can be run again."""
    grid = OccupancyGrid(np.zeros((20, 30), np.int8), GridGeometry(30, 20, 0.1, 0.0, 0.0))
    scenario = Scenario(
        map=grid,
        configuration=load_configuration(["turtlebot"]),
        start=Pose2D(0.5, 0.5, 0.0),
        goals=(Pose2D(2.0, 1.0, 0.0),),
        obstacles=((1.0, 1.0, 0.1),),
    )
    corners = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    recorder = RunRecorder(map=grid, footprint=Footprint(corners), scenario=scenario.as_dict())
    recorder.goal(0.0, scenario.goals[0])
    for i in range(5):
        pose, time = Pose2D(0.5 + 0.1 * i, 0.5, 0.0), 0.1 * i
        state = RobotState(pose, Twist2D(), time)
        still, known = Twist2D(), Transform2D()
        recorder.sample(
            time, pose=pose, odom=state, map_to_odom=known, command=still, state="CONTROLLING", goal_index=0
        )
    recorder.plan(0.0, np.zeros((4, 3)), "map")
    recorder.finish([])
    with tempfile.TemporaryDirectory() as name, zipfile.ZipFile(recorder.save(Path(name))["record"]) as archive:
        return {member: archive.read(member) for member in archive.namelist()}


def _world_members() -> dict[str, bytes]:
    out = BytesIO()
    np.savez(
        out,
        world=np.arange(2),
        cyl_xy=np.zeros((5, 2)),
        cyl_offset=np.array([0, 2, 5]),
        cyl_radius=np.float64(0.075),
        optimal_length_m=np.array([10.0, 11.0]),
    )
    with zipfile.ZipFile(out) as archive:
        return {member: archive.read(member) for member in archive.namelist()}


def valid_record(members: dict[str, bytes]) -> bytes:
    """Return the bytes of a record with these members."""
    return packed(members)


def _make_special_files(folder: Path) -> None:
    """Pipes, loops, devices, sockets and folders, under the names of inputs and under bare names."""
    for suffix in ("", *dict.fromkeys(_SUFFIXES.values())):
        with suppress(AttributeError, OSError):  # systems without pipes
            os.mkfifo(folder / f"pipe{suffix}")
        (folder / f"loop{suffix}").symlink_to(f"loop{suffix}")
        (folder / f"dangling{suffix}").symlink_to("nothing")
        (folder / f"folder{suffix}").mkdir()
        (folder / f"zero{suffix}").symlink_to("/dev/zero")
        (folder / f"empty{suffix}").touch()
        with suppress(AttributeError, OSError), socket.socket(socket.AF_UNIX) as made:
            made.bind(str(folder / f"socket{suffix}"))
    (folder / "self.yaml").write_text("map: self.yaml\nparams: [self.yaml]\nimage: self.yaml\n")
    (folder / "self.launch").write_text('<launch><include file="$(dirname)/self.launch"/></launch>')
