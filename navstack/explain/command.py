"""Why the local planner chose its command: all velocity samples of a control cycle, with the scores of the critics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, Twist2D
from navstack.core.errors import RecordError
from navstack.explain.command_by_hand import driven_by_hand
from navstack.explain.command_chain import command_after
from navstack.explain.command_summary import average_summary, count_rejections, summary_of
from navstack.explain.replay import Replay, replay, time_in
from navstack.explain.samples import SampleReport, rank_samples
from navstack.explain.steering import SteeringReport, steering_after
from navstack.interfaces import ControlDiagnostics, LocalPlan
from navstack.local_planner.path_follower import PathFollower
from navstack.record import Record
from navstack.record.commands import RecordedCommand


@dataclass(frozen=True, slots=True, eq=False)
class CommandReport:
    """One control cycle with K samples of at most T points. Poses and costmap are in the local costmap's frame."""

    time: float
    """Time of the cycle (s): the last one until the requested time."""
    requested: float
    """The requested time (s)."""
    planner: str
    state: str
    """State of the goal manager after the cycle."""
    summary: str
    """Why this command was chosen, in one or two sentences."""
    plan: LocalPlan
    """The command, with the table of samples."""
    samples: tuple[SampleReport, ...]
    """Legal samples by rank, then rejected ones in the order of the table."""
    rejections: str
    """Number of rejected samples by critic."""
    costmap: Costmap
    footprint: Footprint
    """Footprint of the critics, with padding."""
    robot: Pose2D
    poses: NDArray[np.float64] | None
    """(K, T, 3); None for a planner without rollouts."""
    counts: NDArray[np.int64] | None
    """(K,) number of valid points."""
    chain: RecordedCommand | None = None
    """What multiplexer, velocity smoother and collision monitor made of the command; None without them."""

    steering: SteeringReport | None = None
    """What the command asks of the steering; None for a base that is not steered."""

    @property
    def legal(self) -> tuple[SampleReport, ...]:
        """Samples that no critic rejected, by rank."""
        return tuple(s for s in self.samples if s.rank is not None)

    def as_dict(self) -> dict[str, Any]:
        """Returns the report for JSON, without costmap and rollouts."""
        plan = self.plan
        scales = plan.scales.tolist() if plan.scales is not None else []
        return {
            "time": self.time,
            "requested": self.requested,
            "planner": self.planner,
            "state": self.state,
            "summary": self.summary,
            "rejections": self.rejections,
            "mode": plan.mode,
            "command": list(plan.command),
            "best": plan.best if plan.best >= 0 else None,
            "robot": list(self.robot),
            "frame": self.costmap.frame,
            "scales": dict(zip(plan.critics, scales)),
            "samples": [sample.as_dict() for sample in self.samples],
            "notes": list(plan.notes),
            "chain": self.chain.as_dict() if self.chain is not None else None,
            "steering": self.steering.as_dict() if self.steering is not None else None,
        }


@dataclass(frozen=True, slots=True)
class _Cycle:
    """A replayed control cycle."""

    replayed: Replay
    planner: str
    plan: LocalPlan
    details: ControlDiagnostics | None = None
    """None if the local planner has no diagnostics of this cycle."""
    reasons: str = ""
    """Why a motion, or a controller without samples, gave its command; empty for one with samples."""


def explain_command(record: Record, time: float | None = None) -> CommandReport:
    """Explains the last command until `time` (s; default: the end of the run). Replays the run up to it.

    Raises InputError for a time outside the run, RecordError for a run without commands until then, and as `replay` does.
    """
    requested = time_in(record, time)
    cycle = _replay_cycle(record, requested)
    replayed, plan, details = cycle.replayed, cycle.plan, cycle.details
    costmap = replayed.costmap("local")
    samples = rank_samples(plan, details.samples if details else None)
    rejections = details.rejections if details else count_rejections(samples)
    return CommandReport(
        time=replayed.time,
        requested=requested,
        planner=cycle.planner,
        state=str(record.states[record.index_at(replayed.time)]),
        summary=cycle.reasons or _summary(cycle, samples, rejections),
        plan=plan,
        samples=samples,
        rejections=rejections,
        costmap=details.costmap if details else costmap.master,
        footprint=details.footprint if details else costmap.footprint,
        robot=costmap.robot_pose(replayed.time),
        poses=details.rollouts.poses if details else None,
        counts=details.rollouts.counts if details else None,
        chain=command_after(record, replayed.time),
        steering=steering_after(record, replayed.time, plan.command),
    )


def _summary(cycle: _Cycle, samples: tuple[SampleReport, ...], rejections: str) -> str:
    details = cycle.details
    if details is not None and details.averages and cycle.plan.mode == "follow":
        return average_summary(cycle.plan, samples, rejections, details.rule)
    return summary_of(cycle.planner, cycle.plan, samples, rejections, details.rule if details else "")


def _replay_cycle(record: Record, requested: float) -> _Cycle:
    key = driven_by_hand(record, requested)
    if key is not None and (key.is_held or not _searched_after(record, key.time, requested)):
        return _Cycle(replay(record, requested), "teleop", key.plan, reasons=key.reason)
    replayed = replay(record, _last_search(record, requested))
    if replayed.run.move_base.motions.running is not None:
        return _motion_cycle(record, replayed)
    planner = replayed.run.move_base.local_planner
    name = type(planner).__name__
    details = planner.diagnostics()
    if details is not None:
        return _Cycle(replayed, name, details.plan, details)
    recorded = record.local_plan_at(replayed.time)
    if recorded is not None and recorded.t == replayed.time and recorded.plan.samples is None and recorded.plan.notes:
        # a controller without samples says what limited its command
        return _Cycle(replayed, name, replace(recorded.plan, notes=()), reasons="; ".join(recorded.plan.notes))
    failure = _failure_at(record, replayed.time)
    if failure and isinstance(planner, PathFollower):
        return _Cycle(replayed, name, LocalPlan(Twist2D(), "failed"), reasons=f"no command: {failure[2:-1]}")
    if recorded is None or recorded.t != replayed.time or recorded.plan.samples is None:
        raise RecordError(
            f"{name} evaluated no samples at {replayed.time:.3f} s{failure}; give an earlier or later --time",
            time=replayed.time,
        )
    return _Cycle(replayed, name, recorded.plan)


def _motion_cycle(record: Record, replayed: Replay) -> _Cycle:
    """The cycle of a motion: its reasons are the notes of its command."""
    recorded = record.local_plan_at(replayed.time)
    assert recorded is not None
    plan = replace(recorded.plan, notes=())
    return _Cycle(replayed, f"motion {plan.mode}", plan, reasons="; ".join(recorded.plan.notes))


def _searched_after(record: Record, since: float, until: float) -> bool:
    """True if the local planner or a motion computed a command after `since`, until `until` (s)."""
    times = record.local_plan_times
    return bool(((times > since) & (times <= until + 1e-9)).any())


def _last_search(record: Record, time: float) -> float:
    """Time of the last search of the local planner until `time` (s)."""
    searches = [*record.local_plan_times.tolist(), *(event.time for event in record.events_of("control_failed"))]
    before = [t for t in searches if t <= time + 1e-9]
    if not before:
        first = f"the first is at {min(searches):.3f} s" if searches else "the run has none"
        raise RecordError(f"no command was computed until {time:.3f} s; {first}; give another --time", time=time)
    return max(before)


def _failure_at(record: Record, time: float) -> str:
    failed = [event for event in record.events_of("control_failed") if event.time == time]
    return f" ({failed[-1].text})" if failed else ""
