"""Metrics of a run.

All of them are computed from the true poses at the control cycles, never from a clock, so a record gives the metrics of its run
to the bit. The velocity between two cycles is the displacement divided by the time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.move_base import TickResult
from navstack.record.reader import Record
from navstack.record.social import SocialMetrics, social_metrics

MOVING_M_S = 0.01
"""Minimum speed that counts as moving; slower is standing or turning in place (m/s, rad/s)."""


@dataclass(frozen=True, slots=True)
class RunMetrics:
    """The metrics of a run. Times are simulated."""

    goals: int
    """Number of goals sent."""
    succeeded: int
    """Number of goals that SUCCEEDED."""
    collisions: int
    """Number of collisions of the unpadded footprint; a lasting collision counts once."""
    recoveries: int
    """Number of recovery behaviors run, over all goals."""
    time_s: float
    """From the start to the end of the last goal."""
    length_m: float
    """Length of the path driven, over all goals: sum of the distances between consecutive cycles."""
    clearance_min_m: float
    """Minimum distance between the unpadded footprint and an obstacle, at the control cycles; 0 after a collision, inf without
    obstacles, nan if unknown."""
    clearance_mean_m: float
    """Mean of this distance over the cycles; nan without obstacles or cycles."""
    speed_mean_m_s: float
    """Mean speed while the robot moves (at least 0.01 m/s); 0 if it never moves."""
    speed_max_m_s: float
    """Maximum over the cycles of the mean speed."""
    jerk_rms_m_s3: float
    """Root mean square of the second difference of the velocity (a vector in the map) divided by the time squared."""
    curvature_mean_1_m: float
    """Angle turned per meter driven, while moving."""
    turned_rad: float
    """Sum of all rotation, in place and while moving."""
    turning_s: float
    """Time spent turning in place."""
    standing_s: float
    """Time spent neither moving nor turning."""
    state_s: Mapping[str, float]
    """Time in each state of the goal manager, by name."""
    social: SocialMetrics | None = None
    """Of a run among people; None for any other."""

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data."""
        out: dict[str, Any] = {
            name: getattr(self, name) for name in self.__slots__ if name not in ("state_s", "social")
        }
        out["state_s"] = {name: round(seconds, 6) for name, seconds in self.state_s.items()}
        for name in ("time_s", "turning_s", "standing_s"):
            out[name] = round(out[name], 6)
        if self.social is not None:
            out["social"] = self.social.as_dict()
        return out


def compute_metrics(
    times: NDArray[np.float64],
    poses: NDArray[np.float64],
    states: Sequence[str],
    clearances: NDArray[np.float64],
    *,
    results: Sequence[Mapping[str, Any]],
    collisions: int,
    social: SocialMetrics | None = None,
) -> RunMetrics:
    """Computes the metrics from the control cycles: times (n,) s, true poses (n, 3) in the map, states (n,), clearances (n,) m.

    `results` are the goals' outcomes as in the record (`state`, `path_length_m`, `recoveries`). `social`: those of a run among
    people (`social_metrics`).
    """
    step = np.diff(times)
    # two cycles at the same time have no interval between them
    real = step > 0.0
    duration = step[real]
    motion = np.diff(poses, axis=0)[real]
    turned = np.abs(np.remainder(motion[:, 2] + math.pi, 2.0 * math.pi) - math.pi)
    distance = np.hypot(motion[:, 0], motion[:, 1])
    speed = distance / duration
    moving = speed >= MOVING_M_S
    turning = ~moving & (turned / duration >= MOVING_M_S)
    standing = ~moving & ~turning
    moved = float(distance[moving].sum())
    in_state: dict[str, float] = {}
    for name, seconds in zip(np.asarray(states)[:-1][real].tolist() if len(step) else [], duration.tolist()):
        in_state[name] = in_state.get(name, 0.0) + seconds
    finite = clearances[np.isfinite(clearances)]
    nearest = float(finite.min()) if len(finite) else math.nan if np.isnan(clearances).any() else math.inf
    return RunMetrics(
        goals=len(results),
        succeeded=sum(result["state"] == "SUCCEEDED" for result in results),
        collisions=collisions,
        recoveries=sum(int(result["recoveries"]) for result in results),
        time_s=float(times[-1]) if len(times) else 0.0,
        length_m=float(sum(result["path_length_m"] for result in results)),
        clearance_min_m=0.0 if collisions else nearest,
        clearance_mean_m=float(finite.mean()) if len(finite) else math.nan,
        speed_mean_m_s=moved / float(duration[moving].sum()) if moving.any() else 0.0,
        speed_max_m_s=float(speed.max()) if len(speed) else 0.0,
        jerk_rms_m_s3=_jerk(motion[:, :2] / duration[:, None], duration),
        curvature_mean_1_m=float(turned[moving].sum()) / moved if moved > 0.0 else 0.0,
        turned_rad=float(turned.sum()),
        turning_s=float(duration[turning].sum()),
        standing_s=float(duration[standing].sum()),
        state_s=dict(sorted(in_state.items())),
        social=social,
    )


def metrics_of(record: Record) -> RunMetrics:
    """Returns the metrics of a recorded run, identical to the bit to those of the run itself."""
    return compute_metrics(
        record.times,
        record.poses,
        record.states.tolist(),
        record.clearances,
        results=record.results,
        collisions=len(record.collisions),
        social=_social_metrics_of(record),
    )


def _social_metrics_of(record: Record) -> SocialMetrics | None:
    people = record.people
    if people is None or not len(record.times):
        return None
    goals = np.array([*record.goals, (math.nan,) * 3], np.float64).reshape(-1, 3)
    plans: dict[int, NDArray[np.float64]] = {}
    for plan in record.plans:
        plans.setdefault(plan.goal, plan.poses)
    return social_metrics(
        record.times,
        record.poses,
        people,
        footprint=record.footprint,
        collisions=np.column_stack((record.collision_times, record.collisions)),
        targets=goals[record.goal_indices, :2],
        plans=plans,
        results=record.results,
    )


# --- stalls -----------------------------------------------------------------------------------------------------------


STALL_S: Final = 3.0
"""A robot that moves less than STALL_M for this time stalls (s)."""
STALL_M: Final = 0.1


@dataclass(frozen=True, slots=True)
class Stall:
    """A time in which a robot with a goal hardly moved."""

    begin: float
    end: float
    x: float
    y: float
    turned_rad: float
    """How much it turned meanwhile, in both directions together."""

    @property
    def duration(self) -> float:
        """Its length (s)."""
        return self.end - self.begin


def find_stalls(times: NDArray[np.float64], poses: NDArray[np.float64]) -> list[Stall]:
    """Return the stalls of a robot at `times` (n,) at `poses` (n, 3), which had a goal all the while."""
    found: list[Stall] = []
    k, count = 0, len(times)
    while k < count:
        after = int(np.searchsorted(times, times[k] + STALL_S))
        if after == count:
            break
        if math.hypot(poses[after, 0] - poses[k, 0], poses[after, 1] - poses[k, 1]) > STALL_M:
            k += 1
            continue
        away = np.hypot(poses[k:, 0] - poses[k, 0], poses[k:, 1] - poses[k, 1]) > STALL_M
        stop = k + int(away.argmax()) if away.any() else count
        if times[stop - 1] - times[k] < STALL_S:
            k += 1
            continue
        turned = float(np.abs(np.diff(np.unwrap(poses[k:stop, 2]))).sum())
        found.append(Stall(float(times[k]), float(times[stop - 1]), float(poses[k, 0]), float(poses[k, 1]), turned))
        k = stop
    return found


def resampled_jerk(times: NDArray[np.float64], poses: NDArray[np.float64], period: float) -> float:
    """Returns the jerk (m/s³) of the poses (n, 3) at `times` (n,), interpolated at every `period` (s).

    `RunMetrics.jerk_rms_m_s3` uses the control cycles, so it depends on the control frequency; this one does not.
    """
    if len(times) < 2:
        return 0.0
    at = np.arange(times[0], times[-1] + 1e-9, period)
    positions = np.column_stack([np.interp(at, times, poses[:, axis]) for axis in (0, 1)])
    return _jerk(np.diff(positions, axis=0) / period, np.full(max(len(at) - 1, 0), period))


def _jerk(velocity: NDArray[np.float64], duration: NDArray[np.float64]) -> float:
    """Root mean square of the second derivative of (n, 2) velocities, each the mean over its `duration`."""
    if len(velocity) < 3:
        return 0.0
    between = 0.5 * (duration[1:] + duration[:-1])
    acceleration = np.diff(velocity, axis=0) / between[:, None]
    change = np.diff(acceleration, axis=0) / (0.5 * (between[1:] + between[:-1]))[:, None]
    return float(np.sqrt((change**2).sum(axis=1).mean()))


# --- wall times -------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class Timings:
    """Seconds of each call of the planners, by default of the wall clock; they vary from run to run."""

    planning_s: list[float] = field(default_factory=list[float])
    """Calls of the global planner, failed ones included."""
    control_s: list[float] = field(default_factory=list[float])
    """Calls of the local planner."""
    clock: Callable[[], float] = time.perf_counter
    """Clock in seconds; `time.thread_time` counts processor time."""

    def add(self, tick: TickResult) -> None:
        """Add the calls of a tick of a goal manager with `clock` as its stopwatch."""
        if tick.planning_s is not None:
            self.planning_s.append(tick.planning_s)
        if tick.control_s is not None:
            self.control_s.append(tick.control_s)

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data: for each kind the count and the 50th, 95th and 99th percentile and maximum in ms."""
        return {"planning_ms": _percentiles(self.planning_s), "control_ms": _percentiles(self.control_s)}


def _percentiles(seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {"count": 0}
    p50, p95, p99 = (1e3 * np.percentile(seconds, (50, 95, 99))).tolist()
    return {"count": len(seconds), "p50": p50, "p95": p95, "p99": p99, "max": 1e3 * max(seconds)}
