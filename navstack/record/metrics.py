"""What a run was like, in numbers: one table of definitions for every face of the product.

All of them come from the true poses at the control cycles, never from a clock, so that a record gives the numbers of the run
it was made from, to the bit. Between two cycles a velocity is the way made over the time taken.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.record.reader import Record

MOVING_M_S = 0.01
"""Slower than this is standing, or turning in place: no curvature, no speed while moving."""


@dataclass(frozen=True, slots=True)
class RunMetrics:
    """A run in numbers. Times are simulated."""

    goals: int
    """Goals that were sent."""
    succeeded: int
    """Goals that ended SUCCEEDED."""
    collisions: int
    """Collisions of the true footprint with something; one that lasts counts once."""
    recoveries: int
    """Recovery behaviours that were run, over all goals."""
    time_s: float
    """From the start to the end of the last goal."""
    length_m: float
    """Length of the way driven, over all goals: from each cycle's position to the next."""
    clearance_min_m: float
    """Least distance between the true footprint and an obstacle, at the control cycles; 0 after a collision, inf without
    obstacles, nan where nobody knew."""
    clearance_mean_m: float
    """Mean of that distance over the cycles; nan without obstacles or cycles."""
    speed_mean_m_s: float
    """Mean speed while the robot moves (0.01 m/s and more); 0 when it never does."""
    speed_max_m_s: float
    """Greatest mean speed of a cycle."""
    jerk_rms_m_s3: float
    """Root of the mean square of the second difference of the velocity (a vector in the map) over the time squared."""
    curvature_mean_1_m: float
    """Angle turned per metre driven, while moving."""
    turned_rad: float
    """Sum of all turning, in place and while moving."""
    turning_s: float
    """Time spent turning in place."""
    standing_s: float
    """Time spent neither moving nor turning."""
    state_s: Mapping[str, float]
    """Time in each state of the goal manager, by name."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        out: dict[str, Any] = {name: getattr(self, name) for name in self.__slots__ if name != "state_s"}
        out["state_s"] = {name: round(seconds, 6) for name, seconds in self.state_s.items()}
        for name in ("time_s", "turning_s", "standing_s"):
            out[name] = round(out[name], 6)
        return out


def compute_metrics(
    times: NDArray[np.float64],
    poses: NDArray[np.float64],
    states: Sequence[str],
    clearances: NDArray[np.float64],
    *,
    results: Sequence[Mapping[str, Any]],
    collisions: int,
) -> RunMetrics:
    """From the control cycles: times (n,) s, true poses (n, 3) x, y, yaw in the map, states (n,), clearances (n,) m.

    `results` are the goals' outcomes as the record keeps them (`state`, `path_length_m`, `recoveries`).
    """
    step = np.diff(times)
    # two cycles at one time make no interval
    real = step > 0.0
    duration = step[real]
    way = np.diff(poses, axis=0)[real]
    turned = np.abs(np.remainder(way[:, 2] + math.pi, 2.0 * math.pi) - math.pi)
    distance = np.hypot(way[:, 0], way[:, 1])
    speed = distance / duration
    moving = speed >= MOVING_M_S
    turning = ~moving & (turned / duration >= MOVING_M_S)
    standing = ~moving & ~turning
    moved = float(distance[moving].sum())
    at_state: dict[str, float] = {}
    for name, seconds in zip(np.asarray(states)[:-1][real].tolist() if len(step) else [], duration.tolist()):
        at_state[name] = at_state.get(name, 0.0) + seconds
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
        jerk_rms_m_s3=_jerk(way[:, :2] / duration[:, None], duration),
        curvature_mean_1_m=float(turned[moving].sum()) / moved if moved > 0.0 else 0.0,
        turned_rad=float(turned.sum()),
        turning_s=float(duration[turning].sum()),
        standing_s=float(duration[standing].sum()),
        state_s=dict(sorted(at_state.items())),
    )


def metrics_of(record: Record) -> RunMetrics:
    """The metrics of a recorded run: those that the run itself had, to the bit."""
    return compute_metrics(
        record.times,
        record.poses,
        record.states.tolist(),
        record.clearances,
        results=record.results,
        collisions=len(record.collisions),
    )


def _jerk(velocity: NDArray[np.float64], duration: NDArray[np.float64]) -> float:
    """Root mean square of the second derivative of (n, 2) velocities, each the mean over its `duration`."""
    if len(velocity) < 3:
        return 0.0
    between = 0.5 * (duration[1:] + duration[:-1])
    acceleration = np.diff(velocity, axis=0) / between[:, None]
    change = np.diff(acceleration, axis=0) / (0.5 * (between[1:] + between[:-1]))[:, None]
    return float(np.sqrt((change**2).sum(axis=1).mean()))
