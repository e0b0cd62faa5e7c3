"""Shared parts of the benchmarks: data folders, the calibration, the times of the C++ stack, and the scenario of the arguments.

The data are not in the repository. By default they are in `../shared`; NAVSTACK_BENCH, NAVSTACK_DATA and NAVSTACK_GOLDEN name
other folders. `bench` contains `calibrate.py` and `cpp_reference.json`: C++ times with the calibration of that moment.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from navstack.cli.arguments import map_of, parse_pose
from navstack.parameters import load_configuration
from navstack.scenario import Scenario, load_places

_SHARED = Path(__file__).resolve().parents[3] / "shared"


def data_folder(name: str) -> Path:
    """The folder `bench`, `data` or `golden`; it may not exist."""
    return Path(os.environ.get(f"NAVSTACK_{name.upper()}") or _SHARED / name)


class Reference:
    """The calibration and the C++ times of a folder, by default of `bench`."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or data_folder("bench")
        self._module: Any = None

    @property
    def available(self) -> bool:
        """True if the folder contains the calibration."""
        return (self._folder / "calibrate.py").is_file()

    def calibration_ms(self, *arguments: int) -> float:
        """The calibration now; an argument is the number of repeats. Exits if the folder does not contain it."""
        return self._calibrate().calibration_ms(*arguments)

    def use_processor_time(self) -> None:
        """Measure the calibration in processor time, in which other programs on the machine count less."""
        self._calibrate().time = SimpleNamespace(perf_counter=time.process_time)

    def speedup(self, case: str, ms: float, calibration_ms: float) -> float:
        """C++ time over `ms`, scaled by the calibrations; above 1, navstack is faster."""
        return self._calibrate().speedup(case, ms, calibration_ms)

    def scaled_ms(self, case: str, calibration_ms: float) -> float:
        """The C++ time of a case, scaled to this machine."""
        times = self._times()
        return times["cases"][case]["ms"] * calibration_ms / times["calibration_ms"]

    @property
    def calibration_then_ms(self) -> float:
        """The calibration of the C++ times."""
        return self._times()["calibration_ms"]

    def text(self) -> str:
        """The calibration for a line of output."""
        return f"calibration {self.calibration_ms():.1f} ms" if self.available else "no calibration: set NAVSTACK_BENCH"

    def _times(self) -> dict[str, Any]:
        return json.loads((self._folder / "cpp_reference.json").read_text())

    def _calibrate(self) -> Any:
        if self._module is None:
            file = self._folder / "calibrate.py"
            spec = importlib.util.spec_from_file_location("calibrate", file) if self.available else None
            if spec is None or spec.loader is None:
                raise SystemExit(f"{file} does not exist; give the folder of the reference times")
            self._module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(self._module)
        return self._module


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `scenario_of`."""
    parser.add_argument("--map", default="office")
    parser.add_argument("--params", nargs="+", default=["turtlebot"])
    parser.add_argument("--distro", default=None)
    parser.add_argument("--start", help="x,y,yaw; by default that of the map's places")
    parser.add_argument("--goal", nargs="+", help="x,y,yaw; by default those of the map's places")


def scenario_of(args: argparse.Namespace) -> Scenario:
    """The scenario that the arguments define."""
    _, grid = map_of(args.map)
    start = parse_pose(args.start, "--start") if args.start else load_places(args.map).start
    goals = tuple(parse_pose(g, "--goal") for g in args.goal) if args.goal else load_places(args.map).goals
    return Scenario(grid, load_configuration(args.params, distro=args.distro), start, goals)
