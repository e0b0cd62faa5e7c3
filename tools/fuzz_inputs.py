"""Mutate maps, records, scenarios, parameters and launch files, and read them: no traceback, no hang, little memory.

    python tools/fuzz_inputs.py [--count N] [--seed S] [--kind KIND ..] [--keep FOLDER]

Each input is a valid file with one to eight seeded changes: bytes and lines replaced, removed, repeated or exchanged, values
replaced by hostile ones, members of a record replaced and packed again. It is read in this process by the reader that the
commands use. Anything but a result or a NavError counts as a traceback. Also counted: reads over 5 s, and growth of the
process's memory beyond 1 GB. `--keep` stores the offending inputs. Exit code 1 if there is any.
"""

from __future__ import annotations

import argparse
import io
import json
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from navstack.core import Footprint, GridGeometry, OccupancyGrid, Pose2D, RobotState, Transform2D, Twist2D
from navstack.core.errors import NavError
from navstack.map_io import load_map
from navstack.parameters.configuration import check_parameters
from navstack.parameters.sources import packaged_folder, read_sources
from navstack.record import Record, RunRecorder
from navstack.scenario import Scenario, read_scenario, shipped_scenarios

KINDS = ("map", "record", "scenario", "parameters", "launch")
MAX_SECONDS = 5.0
MAX_BYTES = 1_000_000_000
_FULL_CHECK = 50
"""Every 50th parameter input is checked completely, the others are read and merged."""

_HOSTILE = (
    *(
        "1e308",
        "-1e308",
        ".nan",
        ".inf",
        "-.inf",
        "1e-320",
        "9" * 400,
        "0x" + "f" * 300,
        "-1",
        "0",
        "2147483648",
        "true",
    ),
    *(
        "~",
        "''",
        '"\\0"',
        "[]",
        "{}",
        "[[[[[[[[]]]]]]]]",
        "*a",
        "&a [*a]",
        "!!python/object:os.system x",
        "!!binary aGk=",
        "<<: *a",
    ),
    *(
        "deg(1e400)",
        "rad(9**9**9)",
        "/dev/zero",
        "/dev/null",
        "..",
        "\x7f",
        "\u2028",
        "\U0001f916",
        "$(arg x)",
        "$(find x)/y",
    ),
    *(
        "$(eval 1)",
        "$(env HOME)",
        "- - - -",
        "? a",
        "%YAML 9.9",
        "---",
        "...",
        "\t",
        "1:30:00",
        "2020-01-01",
        "0o17",
        "1_000_000",
    ),
)


@dataclass
class Counts:
    """What the inputs led to."""

    inputs: int = 0
    accepted: int = 0
    tracebacks: list[str] = field(default_factory=list[str])
    slow: list[str] = field(default_factory=list[str])
    large: list[str] = field(default_factory=list[str])

    @property
    def failures(self) -> list[str]:
        """One text per offending input."""
        return self.tracebacks + self.slow + self.large


# --- mutations ----------------------------------------------------------------------------------------------------------


def mutated_text(data: bytes, rng: random.Random) -> bytes:
    """Changes bytes, lines or values of a text."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        lines = data.split(b"\n")
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(9):
            case 0:
                data = _mutated_bytes(data, rng)
            case 1:
                del lines[i]
                data = b"\n".join(lines)
            case 2:
                lines[i], lines[j] = lines[j], lines[i]
                data = b"\n".join(lines)
            case 3:
                lines[i:i] = [lines[j]] * rng.choice((1, 2, 50))
                data = b"\n".join(lines)
            case 4:
                lines[i] = b" " * rng.randrange(9) + lines[i].lstrip() if rng.random() < 0.8 else b"\t" + lines[i]
                data = b"\n".join(lines)
            case _:
                data = _with_hostile_value(data, rng)
    return data


def _with_hostile_value(data: bytes, rng: random.Random) -> bytes:
    """Replaces what is between two separators by a hostile value."""
    marks = [i for i, byte in enumerate(data) if byte in b": ,[]{}\"'\n"]
    if not marks:
        return data
    at = rng.randrange(len(marks))
    end = marks[min(at + rng.choice((1, 1, 2, 3)), len(marks) - 1)]
    return data[: marks[at] + 1] + rng.choice(_HOSTILE).encode() + data[end:]


def _mutated_bytes(data: bytes, rng: random.Random) -> bytes:
    if not data:
        return bytes([rng.randrange(256)])
    i = rng.randrange(len(data))
    j = min(len(data), i + rng.choice((1, 1, 4, 64, 4096)))
    match rng.randrange(5):
        case 0:
            return data[:i] + bytes([rng.randrange(256)]) + data[i + 1 :]
        case 1:
            return data[:i] + data[j:]
        case 2:
            return data[:j] + data[i:j] * rng.choice((1, 3)) + data[j:]
        case 3:
            return data[:i]
        case _:
            return data[:i] + rng.choice((b"\xff" * 4, b"\x00" * 8, b"\x7f\xff\xff\xff", rng.randbytes(4))) + data[j:]


def _mutated_json(value: Any, rng: random.Random) -> Any:
    """Replaces one value somewhere in a document."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        return {**value, key: _mutated_json(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.9:
        i = rng.randrange(len(value))
        return [*value[:i], _mutated_json(value[i], rng), *value[i + 1 :]]
    return rng.choice(
        (None, "x", -1, 0, 1e308, 10**400, True, [], {}, [[]], "\0", [value] * 3, {"x": value}, 2**63, -0.5, "9" * 300)
    )


def mutated_record(members: Mapping[str, bytes], rng: random.Random) -> bytes:
    """Changes members of a record and packs it again, or changes bytes of the file."""
    changed = dict(members)
    for _ in range(rng.choice((1, 1, 2, 3))):
        name = rng.choice(list(changed))
        if name == "meta.json" or rng.random() < 0.5:
            changed["meta.json"] = json.dumps(_mutated_json(json.loads(members["meta.json"]), rng)).encode()
        elif name.endswith(".npy") and rng.random() < 0.5:
            head = changed[name][:128]  # the header states shape and type
            changed[name] = mutated_text(head, rng) + changed[name][128:]
        else:
            changed[name] = _mutated_bytes(changed[name], rng)
    if rng.random() < 0.1:
        del changed[rng.choice(list(changed))]
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in changed.items():
            archive.writestr(name, content)
    return _mutated_bytes(out.getvalue(), rng) if rng.random() < 0.2 else out.getvalue()


# --- readers ------------------------------------------------------------------------------------------------------------


class Inputs:
    """The valid files, and how the inputs of a kind are written and read."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        Image.fromarray(np.full((8, 12), 254, np.uint8)).save(folder / "small.png")
        keys = "resolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
        self.map = f"image: small.png\nmode: trinary\n{keys}".encode()
        (folder / "small.yaml").write_bytes(self.map)
        self.images = [
            self._image("PNG"),
            self._image("PPM"),
            self._image("BMP"),
            self._image("GIF"),
            self._image("TIFF"),
        ]
        self.scenarios = [path.read_bytes() for path in shipped_scenarios().values()]
        self.parameters = [path.read_bytes() for path in sorted(packaged_folder("turtlebot").glob("*.yaml"))]
        self.members = self._record()
        files = "".join(
            f'<rosparam file="{p.name}" command="load" />\n' for p in packaged_folder("turtlebot").glob("*.yaml")
        )
        for path in packaged_folder("turtlebot").glob("*.yaml"):
            (folder / path.name).write_bytes(path.read_bytes())
        self.launch = (
            '<launch>\n<arg name="f" default="odom"/>\n<include file="$(find x)/y.launch"><arg name="a" value="1"/></include>\n'
            f'<group ns="g" if="false"/>\n<node pkg="move_base" type="move_base" name="move_base">\n{files}'
            '<param name="controller_frequency" value="5.0" type="double"/>\n<rosparam>\nplanner_patience: 5.0\n</rosparam>\n'
            '<param name="local_costmap/global_frame" value="$(arg f)"/>\n<remap from="scan" to="/s"/>\n</node>\n</launch>\n'
        ).encode()
        self._number = 0

    @staticmethod
    def _image(kind: str) -> bytes:
        out = io.BytesIO()
        Image.fromarray(np.arange(96, dtype=np.uint8).reshape(8, 12)).save(out, kind)
        return out.getvalue()

    @staticmethod
    def _record() -> dict[str, bytes]:
        """A short record, with a scenario that can be run again."""
        from navstack.parameters.configuration import load_configuration

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
            pose = Pose2D(0.5 + 0.1 * i, 0.5, 0.0)
            state = RobotState(pose, Twist2D(), 0.1 * i)
            recorder.sample(
                0.1 * i,
                pose=pose,
                odom=state,
                map_to_odom=Transform2D(),
                command=Twist2D(),
                state="CONTROLLING",
                goal_index=0,
            )
        recorder.plan(0.0, np.zeros((4, 3)), "map")
        recorder.finish([])
        with tempfile.TemporaryDirectory() as name, zipfile.ZipFile(recorder.save(Path(name))["record"]) as archive:
            return {member: archive.read(member) for member in archive.namelist()}

    def make(self, kind: str, rng: random.Random) -> tuple[Path, Callable[[], object]]:
        """Writes one mutated input; returns its file and what reads it."""
        self._number += 1
        match kind:
            case "map":
                if rng.random() < 0.3:
                    data = rng.choice(self.images)
                    for _ in range(rng.choice((1, 2, 5))):
                        data = _mutated_bytes(data, rng)
                    (self.folder / "mutated.png").write_bytes(data)
                    path = self._write("map.yaml", self.map.replace(b"small.png", b"mutated.png"))
                else:
                    path = self._write("map.yaml", mutated_text(self.map, rng))
                return path, lambda: load_map(path)
            case "record":
                path = self._write("run.npz", mutated_record(self.members, rng))
                return path, lambda: _use_record(path, again=rng.random() < 0.05)
            case "scenario":
                path = self._write("scenario.yaml", mutated_text(rng.choice(self.scenarios), rng))
                return path, lambda: read_scenario(path)
            case "parameters":
                path = self._write("fuzzed.yaml", mutated_text(rng.choice(self.parameters), rng))
            case _:
                path = self._write("fuzzed.launch", mutated_text(self.launch, rng))
        if self._number % _FULL_CHECK == 0:
            return path, lambda: check_parameters(["turtlebot", str(path)])
        return path, lambda: read_sources([str(path)])

    def _write(self, name: str, data: bytes) -> Path:
        path = self.folder / name
        path.write_bytes(data)
        return path


def _use_record(path: Path, *, again: bool) -> None:
    record = Record.load(path)
    assert record.poses.shape[1] == 3
    _ = record.plans, record.scans, record.goals, record.collisions, record.path_length
    if again:
        Scenario.from_record(record).world()


# --- the run ------------------------------------------------------------------------------------------------------------


def fuzz(count: int, seed: int, kinds: tuple[str, ...] = KINDS, *, keep: Path | None = None) -> Counts:
    """Reads `count` mutated inputs, the kinds in turn; input i depends only on the seed and i."""
    counts = Counts()
    with tempfile.TemporaryDirectory(prefix="navstack_fuzz_") as name, warnings.catch_warnings():
        warnings.simplefilter("error")
        inputs = Inputs(Path(name))
        before = _peak_bytes()
        for i in range(count):
            kind = kinds[i % len(kinds)]
            path, read = inputs.make(kind, random.Random(f"{seed}/{i}"))
            failed = len(counts.failures)
            started = time.perf_counter()
            try:
                read()
                counts.accepted += 1
            except NavError:
                pass
            except Exception as exc:
                at = traceback.extract_tb(exc.__traceback__)[-1]
                counts.tracebacks.append(
                    f"{kind} {i}: {type(exc).__name__}: {str(exc)[:200]} ({at.filename}:{at.lineno})"
                )
            if time.perf_counter() - started > MAX_SECONDS:
                counts.slow.append(f"{kind} {i}: {time.perf_counter() - started:.1f} s")
            grown = _peak_bytes()
            if grown - before > MAX_BYTES:
                counts.large.append(f"{kind} {i}: {(grown - before) / 1e6:.0f} MB")
                before = grown
            counts.inputs += 1
            if keep is not None and len(counts.failures) > failed:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{i}_{path.name}").write_bytes(path.read_bytes())
    return counts


def _peak_bytes() -> int:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def main() -> int:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--keep", type=Path)
    arguments = parser.parse_args()
    counts = fuzz(arguments.count, arguments.seed, tuple(arguments.kind or KINDS), keep=arguments.keep)
    for text in counts.failures[:50]:
        print(text)
    print(
        f"{counts.inputs} inputs, {counts.accepted} accepted; {len(counts.tracebacks)} tracebacks, {len(counts.slow)} over "
        f"{MAX_SECONDS:g} s, {len(counts.large)} over {MAX_BYTES / 1e9:g} GB"
    )
    return 1 if counts.failures else 0


if __name__ == "__main__":
    sys.exit(main())
