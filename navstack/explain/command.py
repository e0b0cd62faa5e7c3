"""Why the robot got its command: all velocity samples of a control cycle with the scores of the critics, and what came after."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, RecordError, Twist2D
from navstack.explain.resimulation import Replay, replay, time_in
from navstack.local_planner import PathFollower
from navstack.plugins import ControlDiagnostics, LocalPlan, RejectionDetail
from navstack.record import Record, RecordedCommand, recorded_command

# --- samples, ranked by cost ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SampleReport:
    """One velocity sample with its scores."""

    index: int
    """Row in the planner's table."""
    rank: int | None
    """Rank by total cost among the legal samples, from 1; None for a rejected sample."""
    velocity: tuple[float, float, float]
    """vx, vy (m/s), wz (rad/s)."""
    total: float | None
    """Weighted sum of the costs; None for a rejected sample."""
    rejected_by: str | None
    """Name of the critic, or `limits` for a velocity outside the limits; None for a legal sample."""
    reason: str = ""
    costs: dict[str, float] = field(default_factory=dict[str, float])
    """Raw cost of each critic that scored the sample."""
    weighted: dict[str, float] = field(default_factory=dict[str, float])
    """Raw costs times the scales of the critics; their sum is the total."""
    collision: dict[str, Any] = field(default_factory=dict[str, Any])
    """step, pose, ahead_m, cell and cost of a collision; empty without one."""

    def as_dict(self) -> dict[str, Any]:
        """Return the sample for JSON."""
        return {
            "index": self.index,
            "rank": self.rank,
            "velocity": list(self.velocity),
            "total": self.total,
            "rejected_by": self.rejected_by,
            "reason": self.reason,
            "costs": self.costs,
            "weighted": self.weighted,
            **self.collision,
        }


def rank_samples(
    plan: LocalPlan, rejections: Sequence[tuple[str | None, RejectionDetail]] | None
) -> tuple[SampleReport, ...]:
    """Legal samples by total cost, then rejected ones by row.

    `rejections`: see `ControlDiagnostics.samples`; None for a planner without diagnostics.
    """
    if plan.samples is None or plan.totals is None:
        return ()
    details = rejections or _from_table(plan)
    k = len(plan.samples)
    legal = np.array([rejected_by is None for rejected_by, _ in details], np.bool_)
    order = np.lexsort((np.arange(k), np.where(legal, plan.totals, np.inf)))
    return tuple(_sample(plan, row, place, *details[row]) for place, row in enumerate(order.tolist(), 1))


def _from_table(plan: LocalPlan) -> list[tuple[str | None, RejectionDetail]]:
    """Return the rejections as far as the table has them."""
    assert plan.samples is not None
    by: list[int] = plan.rejected_by.tolist() if plan.rejected_by is not None else [-1] * len(plan.samples)
    names = {-1: None, -2: "limits"}
    return [(names[b] if b in names else plan.critics[b], RejectionDetail()) for b in by]


def _sample(plan: LocalPlan, row: int, place: int, rejected_by: str | None, detail: RejectionDetail) -> SampleReport:
    assert plan.samples is not None
    assert plan.totals is not None
    costs: dict[str, float] = {}
    weighted: dict[str, float] = {}
    if plan.costs is not None and plan.scales is not None:
        for name, cost, scale in zip(plan.critics, plan.costs[row].tolist(), plan.scales.tolist()):
            if np.isfinite(cost):
                costs[name], weighted[name] = cost, cost * scale
    vx, vy, wz = plan.samples[row].tolist()
    legal = rejected_by is None
    return SampleReport(
        index=row,
        rank=place if legal else None,
        velocity=(vx, vy, wz),
        total=float(plan.totals[row]) if legal else None,
        rejected_by=rejected_by,
        reason=detail.reason,
        costs=costs,
        weighted=weighted,
        collision={key: value for key, value in detail.as_dict().items() if key != "reason"},
    )


# --- why a sample won -------------------------------------------------------------------------------------------------


_FASTER_M_S = 0.05
"""A legal sample that is faster than the chosen one by this much is mentioned."""


def summary_of(planner: str, plan: LocalPlan, samples: Sequence[SampleReport], rejections: str, rule: str) -> str:
    """Return the summary of a cycle; `rule` describes how the planner chooses if it is not by the lowest total cost."""
    if plan.mode == "escape":
        return f"{rejections}; escape velocity {velocity_text(plan.command)}"
    if plan.mode != "follow":
        action = {"brake": "braking", "rotate_to_goal": "rotating"}.get(plan.mode, plan.mode)
        if plan.best >= 0:
            return f"at the goal position, {action}: {velocity_text(plan.command)}"
        return f"at the goal position, {action} is not possible: {rejections}"
    winner = next((s for s in samples if s.index == plan.best), None)
    if winner is None:
        return f"no legal sample: {rejections}"
    return f"{rejections}; {_choice(planner, samples, winner, rule)}"


def average_summary(plan: LocalPlan, samples: Sequence[SampleReport], rejections: str, rule: str) -> str:
    """Return the summary of a cycle whose command is an average of the samples."""
    chosen = next((s for s in samples if s.index == plan.best), None)
    if chosen is None:
        return f"no command: {rejections}"
    legal = [s for s in samples if s.rank is not None and s is not chosen]
    text = f"{rejections}; {velocity_text(plan.command)}: {rule}; it costs {_number(chosen.total)}{_main_cost(chosen)}"
    if not legal:
        return text
    cheaper = sum((s.total or 0.0) < (chosen.total or 0.0) for s in legal)
    return f"{text}; {cheaper} of {len(legal)} legal samples cost less, the best {_number(legal[0].total)}{_main_cost(legal[0])}"


def count_rejections(samples: Sequence[SampleReport]) -> str:
    """Return the rejections by critic, for planners without a report of their own."""
    counted = Counter(sample.rejected_by for sample in samples if sample.rejected_by is not None)
    total = f"{counted.total()} of {len(samples)} rejected"
    parts = ", ".join(f"{n} {name}" for name, n in counted.most_common())
    return f"{total}: {parts}" if parts else total


def velocity_text(velocity: tuple[float, float, float] | Twist2D) -> str:
    """`vx 0.50, wz -0.10`; vy is omitted if it is zero."""
    vx, vy, wz = (v + 0.0 if abs(v) >= 5e-4 else 0.0 for v in velocity)
    side = f", vy {vy:.2f}" if vy else ""
    return f"vx {vx:.2f}{side}, wz {wz:.2f}"


def _choice(planner: str, samples: Sequence[SampleReport], winner: SampleReport, rule: str) -> str:
    legal = [s for s in samples if s.rank is not None]
    lead = f"best legal sample {velocity_text(winner.velocity)}"
    if len(legal) == 1:
        return f"{lead} because it is the only one"
    rank = winner.rank or 0
    ties = [s for s in legal if s is not winner and _same_total(s, winner) and _differs(s, winner)]
    skipped = [s for s in legal if (s.rank or 0) < rank and s not in ties and _differs(s, winner)]
    next_ = next((s for s in legal if (s.rank or 0) > rank and not _same_total(s, winner)), None)
    because: list[str] = []
    if skipped:
        because.append(
            f"{planner} skipped {len(skipped)} of lower cost" + (f": {rule}" if rule else " by its own rule")
        )
    if next_ is not None:
        because.append(f"its total {_number(winner.total)} is {_comparison(winner, next_)}")
    if ties:
        tie = f"{len(ties)} other{'s have' if len(ties) > 1 else ' has'} the same total"
        because.append(tie if skipped else f"{tie} (ties go to the first sample)")
    sentence = f"{lead} because {'; '.join(because)}" if because else lead
    return sentence + _faster(legal, winner, next_)


def _faster(legal: Sequence[SampleReport], winner: SampleReport, mentioned: SampleReport | None) -> str:
    """Return a sentence about the fastest sample forward, unless it won or is `mentioned` already."""
    fast = max(legal, key=lambda s: (round(s.velocity[0], 9), -(s.total or 0.0)))
    if fast.velocity[0] <= winner.velocity[0] + _FASTER_M_S or fast is mentioned:
        return ""
    return (
        f". The fastest forward sample, {velocity_text(fast.velocity)}, costs {_number(fast.total)}{_main_cost(fast)}"
    )


def _number(value: float | None) -> str:
    return f"{value:.4g}" if value is not None else "-"


def _differs(a: SampleReport, b: SampleReport) -> bool:
    return any(abs(x - y) > 1e-9 for x, y in zip(a.velocity, b.velocity))


def _same_total(a: SampleReport, b: SampleReport) -> bool:
    """Equal up to rounding errors."""
    return math.isclose(a.total or 0.0, b.total or 0.0, rel_tol=1e-12, abs_tol=1e-12)


def _main_cost(sample: SampleReport) -> str:
    """Return the critic with the largest share of a total."""
    if not sample.weighted:
        return ""
    name, value = max(sample.weighted.items(), key=lambda item: item[1])
    return f", {_number(value)} of it from {name}" if value > 0.0 else ""


def _comparison(winner: SampleReport, other: SampleReport) -> str:
    """Return how much lower the winner's total is than that of another sample, and which critics make the difference."""
    total = (other.total or 0.0) - (winner.total or 0.0)
    changes = {name: other.weighted.get(name, 0.0) - value for name, value in winner.weighted.items()}
    small = 0.02 * max((abs(v) for v in changes.values()), default=0.0)
    better = sorted(((v, n) for n, v in changes.items() if v > small), reverse=True)
    worse = sorted((v, n) for n, v in changes.items() if v < -small)
    parts = [f"{n} {_number(v)} better" for v, n in better] + [f"{n} {_number(-v)} worse" for v, n in worse]
    detail = f" ({', '.join(parts)})" if parts else ""
    name = f"the next, {velocity_text(other.velocity)}"
    if total > 0.0:
        return f"{_number(total)} below {name}{detail}"
    return f"equal to that of {name}{detail}" if better else f"that of {name}{detail}"


# --- commands of a person ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class HandCommand:
    """A command of teleop and how it stood at the requested time."""

    time: float
    """When it was given (s)."""
    is_held: bool
    """False if it had ended by then: the robot stops."""
    plan: LocalPlan
    reason: str


def driven_by_hand(record: Record, time: float) -> HandCommand | None:
    """Return the last command of a person until `time` (s); None before the first."""
    given = [
        item
        for item in record.scenario.get("interactions", ())
        if item["kind"] == "teleop" and item["time"] <= time + 1e-9
    ]
    if not given:
        return None
    last = given[-1]
    begin, until, twist = float(last["time"]), float(last["until"]), Twist2D(*map(float, last["velocity"]))
    asked = f"{velocity_text(twist)}, requested by hand at {begin:.3f} s"
    if time < until:
        return HandCommand(begin, True, LocalPlan(twist, "teleop"), f"{asked}, is held until {until:.3f} s")
    return HandCommand(
        begin, False, LocalPlan(Twist2D(), "teleop"), f"{asked}, ended at {until:.3f} s; since then the robot stops"
    )


# --- the chain between planner and robot ------------------------------------------------------------------------------


_CLAUSE: Final = re.compile(r"; (?=(?:velocity_smoother|collision_monitor|release): )")
_LATEST_S: Final = 0.5
"""A command that reached the chain is passed on within this time (s)."""


def command_after(record: Record, time: float) -> RecordedCommand | None:
    """Return the first command that the chain passed on at `time` (s) or up to half a second later; None without a chain."""
    rows = record.command_steps
    after = rows[(rows["t"] >= time - 1e-9) & (rows["t"] <= time + _LATEST_S)]
    return recorded_command(after[0]) if len(after) else None


def chain_sentence(step: RecordedCommand) -> str:
    """Return one sentence: the command requested, what changed it and why, and the command that the robot got."""
    source = step.source or "no source"
    if not step.changed_by:
        return f"the command of {source} reached the robot unchanged"
    return (
        f"{source} requested {velocity_text(step.requested)}; the robot got {velocity_text(step.sent)} "
        f"({'; '.join(_parts(step))})"
    )


def _parts(step: RecordedCommand) -> list[str]:
    """Return the clauses of the reason, each with the part of the chain that made the change."""
    out: list[str] = []
    for clause in _CLAUSE.split(step.reason):
        part, _, reason = clause.partition(": ")
        if part == "velocity_smoother":
            out.append(f"{clause}: {_change(step.requested, step.smoothed)}")
        elif part == "release":
            out.append(f"velocity_smoother: {reason}")
        elif clause:
            out.append(clause)
    return out


def _change(before: Twist2D, after: Twist2D) -> str:
    return f"{velocity_text(before)} became {velocity_text(after)}"


# --- steering ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SteeringReport:
    """Steering of a base when a command was given."""

    kinematics: str
    angle: float
    """Steering angle at that time (rad)."""
    asked: float | None
    """Angle that the command asks for, not limited (rad); None if it does not drive, which leaves the wheel as it is."""
    max_angle: float
    """rad."""
    max_rate: float | None
    """rad/s."""
    turning_radius: float
    """Radius (m) of the tightest circle."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return asdict(self)


def steering_after(record: Record, time: float, command: Twist2D) -> SteeringReport | None:
    """Return the steering at `time` (s), when `command` was given; None for a base that is not steered."""
    base = record.steered_base
    if base is None:
        return None
    asked = float(base.asked(np.array([command], np.float64))[0])
    return SteeringReport(
        base.kinematics,
        float(record.steering[record.index_at(time)]),
        None if math.isnan(asked) else asked,
        base.max_angle,
        base.max_rate,
        base.radius(base.max_angle),
    )


def steering_sentence(report: SteeringReport) -> str:
    """Return the report in one sentence."""
    now = f"the wheel is at {report.angle:+.2f} rad"
    if report.asked is None:
        return f"steering ({report.kinematics}): {now} and stays there, for the command does not drive"
    # the angle that is asked for is a circle: wheelbase / tan = turning radius * tan(limit) / tan(angle)
    tangent = abs(math.tan(report.asked))
    wheelbase = report.turning_radius * math.tan(report.max_angle)
    circle = f"a radius of {wheelbase / tangent:.2f} m" if tangent > 1e-3 else "straight ahead"
    text = f"steering ({report.kinematics}): the command asks for {report.asked:+.2f} rad, {circle}; {now}"
    if abs(report.asked) > report.max_angle + 1e-6:
        text += (
            f"; its limit is {report.max_angle:.2f} rad, a radius of {report.turning_radius:.2f} m, so the base leaves the "
            "trajectory"
        )
    elif report.max_rate is not None and abs(report.asked - report.angle) > 1e-3:
        text += f", from where it turns at {report.max_rate:.3g} rad/s at most"
    return text


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
        """Return the report for JSON, without costmap and rollouts."""
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


ARRIVED: Final = "the robot is within the tolerances of the goal: it stops, and no trajectories are sampled"


def explain_command(record: Record, time: float | None = None) -> CommandReport:
    """Explain the last command until `time` (s; default: the end of the run). Replays the run up to it.

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
    if recorded is not None and recorded.t == replayed.time and recorded.plan.mode == "arrived":
        return _Cycle(
            replayed, name, recorded.plan, reasons=ARRIVED
        )  # the end of most runs: nothing is sampled any more
    failure = _failure_at(record, replayed.time)
    if failure and isinstance(planner, PathFollower):
        return _Cycle(replayed, name, LocalPlan(Twist2D(), "failed"), reasons=f"no command: {failure[2:-1]}")
    if recorded is None or recorded.t != replayed.time or recorded.plan.samples is None:
        raise RecordError(
            f"{name} evaluated no samples at {replayed.time:.3f} s{failure}; ask about an earlier or later time",
            time=replayed.time,
        )
    return _Cycle(replayed, name, recorded.plan)


def _motion_cycle(record: Record, replayed: Replay) -> _Cycle:
    """Return the cycle of a motion: its reasons are the notes of its command."""
    recorded = record.local_plan_at(replayed.time)
    assert recorded is not None
    plan = replace(recorded.plan, notes=())
    return _Cycle(replayed, f"motion {plan.mode}", plan, reasons="; ".join(recorded.plan.notes))


def _searched_after(record: Record, since: float, until: float) -> bool:
    """Return True if the local planner or a motion computed a command after `since`, until `until` (s)."""
    times = record.local_plan_times
    return bool(((times > since) & (times <= until + 1e-9)).any())


def _last_search(record: Record, time: float) -> float:
    """Return the time of the last search of the local planner until `time` (s)."""
    searches = [*record.local_plan_times.tolist(), *(event.time for event in record.events_of("control_failed"))]
    before = [t for t in searches if t <= time + 1e-9]
    if not before:
        first = "the local planner computed none in this run; navstack explain goal shows why"
        if searches:
            first = f"the first is at {min(searches):.3f} s; give a later --time"
        raise RecordError(f"no command was computed until {time:.3f} s; {first}", time=time)
    return max(before)


def _failure_at(record: Record, time: float) -> str:
    failed = [event for event in record.events_of("control_failed") if event.time == time]
    return f" ({failed[-1].text})" if failed else ""
