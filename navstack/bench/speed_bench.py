"""Speed on this machine: the real-time factor of the whole stack, its share by stage, and single stages.

Shared machines change their speed. Therefore each figure comes with the calibration: the time of a fixed piece of work at the
same moment. Reference times (of the C++ stack, or of an earlier version) contain theirs, and ratios are scaled by both. Times
are CPU times of this thread, which excludes other processes; for the whole run, wall times are given as well.
"""

from __future__ import annotations

import gc
import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

from navstack.bench.calibration import CALIBRATION_RUNS, calibration_ms
from navstack.bench.stage_times import stage_times
from navstack.bench.table import Column, Table
from navstack.core.bounded_reading import read_bytes
from navstack.core.errors import InputError
from navstack.jobs import Job, JobResult
from navstack.scenario import Scenario, run_scenario

MAX_REFERENCE_BYTES: Final = 1_000_000
WHOLE_RUN, STAGES_OF_RUN = "whole run", "stages of a run"
_CALLS_PER_REPEAT: Final = 15
_WARM_UP_CALLS: Final = 5

_WHOLE_COLUMNS: Final = (
    Column("goals", "goals"),
    Column("simulated_s", "simulated (s)", 1),
    Column("runs", "runs"),
    Column("median", "median", 0),
    Column("best", "best", 0),
    Column("core_median", "median, CPU time", 0),
    Column("calibration_ms", "calibration (ms)", 1),
)
_STAGES_COLUMNS: Final = (
    Column("stage", "stage"),
    Column("percent", "share (%)", 1),
    Column("us_per_s", "us per simulated second", 0),
    Column("calls_per_s", "calls per second", 1),
    Column("us_per_call", "us per call", 1),
)
_SCENES_COLUMNS: Final = (
    Column("scene", "stage"),
    Column("ms", "median (ms)", 4),
    Column("calibration_ms", "calibration (ms)", 1),
)
_RATIO_COLUMN: Final = Column("ratio", "speed relative to the reference", 2)


@dataclass(frozen=True)
class SpeedTask:
    """Measures the whole run, its stages, or a single scene."""

    scenario: Scenario
    repeats: int
    """Number of runs; a scene is called 15 times as often."""

    def __call__(self, name: str) -> dict[str, Any]:
        """The times of the job of that name, with the calibration of that moment."""
        repeats = min(self.repeats, CALIBRATION_RUNS)
        before = calibration_ms(repeats)
        if name == WHOLE_RUN:
            times = self._whole_run()
        elif name == STAGES_OF_RUN:
            times = stage_times(self.scenario, self.repeats)
        else:
            times = {"ms": self._scene(name)}
        return {**times, "calibration_ms": min(before, calibration_ms(repeats))}

    def _whole_run(self) -> dict[str, Any]:
        run = run_scenario(self.scenario)
        factors: list[float] = []
        cpu_factors: list[float] = []
        for _ in range(self.repeats):
            start = time.thread_time()
            run = run_scenario(self.scenario)
            cpu_factors.append(run.simulated_s / (time.thread_time() - start))
            factors.append(run.real_time_factor)
        return {
            "simulated_s": run.simulated_s,
            "factors": factors,
            "factors_of_core_time": cpu_factors,
            "states": [goal.state for goal in run.goals],
        }

    def _scene(self, name: str) -> float:
        """Median CPU time of a call (ms)."""
        from navstack.bench.speed_scenes import SCENES

        work = SCENES[name]()
        times: list[float] = []
        gc.disable()
        try:
            for i in range(_CALLS_PER_REPEAT * self.repeats + _WARM_UP_CALLS):
                start = time.thread_time()
                work(i)
                times.append(time.thread_time() - start)
        finally:
            gc.enable()
        return 1e3 * median(times[_WARM_UP_CALLS:])


def speed_jobs() -> list[Job]:
    """The whole run, its stages, and the single scenes."""
    from navstack.bench.speed_scenes import SCENES

    return [Job(name, name) for name in (WHOLE_RUN, STAGES_OF_RUN, *SCENES)]


def read_reference(file: Path) -> dict[str, Any]:
    """Reference times: `{"calibration_ms": .., "cases": {name: {"ms": ..}}}`. Raises InputError."""
    try:
        document: Any = json.loads(read_bytes(file, MAX_REFERENCE_BYTES))
        calibration = float(document["calibration_ms"])
        cases = {str(name): float(case["ms"]) for name, case in document["cases"].items()}
        if not (calibration > 0.0 and all(ms > 0.0 for ms in cases.values())):
            raise ValueError("times must be above 0")
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc
    except (ValueError, KeyError, TypeError, AttributeError) as exc:
        raise InputError(
            f"{file} contains no reference times ({type(exc).__name__}: {exc}); the expected format is "
            '{"calibration_ms": 25.0, "cases": {"dwa_turtlebot": {"ms": 1.5}}}',
            file=str(file),
        ) from exc
    return {"calibration_ms": calibration, "cases": cases}


def speed_tables(results: Sequence[JobResult], reference: Mapping[str, Any] | None) -> list[Table]:
    """The real-time factor, the stages of a run, and the scenes, with ratios to the reference if there is one."""
    found = {r.key: r.value for r in results if not r.failed}
    tables: list[Table] = []
    if WHOLE_RUN in found:
        tables.append(_whole_table(found[WHOLE_RUN]))
    if STAGES_OF_RUN in found:
        tables.append(_stages_table(found[STAGES_OF_RUN]))
    rows = [
        {
            "scene": name,
            "ms": times["ms"],
            "calibration_ms": times["calibration_ms"],
            "ratio": _ratio(name, times, reference),
        }
        for name, times in found.items()
        if name not in (WHOLE_RUN, STAGES_OF_RUN)
    ]
    columns = _SCENES_COLUMNS if reference is None else (*_SCENES_COLUMNS, _RATIO_COLUMN)
    return [*tables, Table("single stages", columns, rows)]


def speed_document(results: Sequence[JobResult], reference: Mapping[str, Any] | None) -> dict[str, Any]:
    """For JSON; `--reference` reads `calibration_ms` and `cases`."""
    found = {r.key: r.value for r in results if not r.failed}
    scenes = {name: times for name, times in found.items() if name not in (WHOLE_RUN, STAGES_OF_RUN)}
    ratios = {name: _ratio(name, times, reference) for name, times in scenes.items()}
    return {
        "calibration_ms": min((times["calibration_ms"] for times in found.values()), default=None),
        "cases": {name: {"ms": times["ms"]} for name, times in scenes.items()},
        "measured": found,
        "ratios": ratios if reference is not None else None,
    }


def _ratio(name: str, times: Mapping[str, Any], reference: Mapping[str, Any] | None) -> float | None:
    """Reference time over measured time, both scaled by their calibrations."""
    if reference is None or name not in reference["cases"]:
        return None
    then = reference["cases"][name] * times["calibration_ms"] / reference["calibration_ms"]
    return then / times["ms"]


def _whole_table(whole: Mapping[str, Any]) -> Table:
    row = {
        "goals": " ".join(whole["states"]),
        "simulated_s": whole["simulated_s"],
        "runs": len(whole["factors"]),
        "median": median(whole["factors"]),
        "best": max(whole["factors"]),
        "core_median": median(whole["factors_of_core_time"]),
        "calibration_ms": whole["calibration_ms"],
    }
    return Table("real-time factor of the whole stack, with recording, on one core", _WHOLE_COLUMNS, [row])


def _stages_table(times: Mapping[str, Any]) -> Table:
    stages, simulated = times["stages"], times["simulated_s"]
    total = math.fsum(s["seconds"] for s in stages.values())
    rows = [
        {
            "stage": name,
            "percent": 100.0 * s["seconds"] / total,
            "us_per_s": 1e6 * s["seconds"] / simulated,
            "calls_per_s": s["calls"] / simulated,
            "us_per_call": 1e6 * s["seconds"] / s["calls"],
        }
        for name, s in sorted(stages.items(), key=lambda item: -item[1]["seconds"])
    ]
    rows.append({"stage": "all", "percent": 100.0, "us_per_s": 1e6 * total / simulated})
    title = f"time per simulated second by stage: real-time factor {simulated / total:.0f} without other load"
    return Table(title, _STAGES_COLUMNS, rows)
