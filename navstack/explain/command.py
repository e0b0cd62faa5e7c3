"""Why the robot was commanded what it was: every sample of a control cycle, and what each critic said of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, Transform2D, Twist2D
from navstack.core.errors import RecordError
from navstack.explain.replay import Replay, replay, time_in
from navstack.interfaces import ControlInput, LocalPlan
from navstack.record import Record


@dataclass(frozen=True, slots=True)
class SampleAccount:
    """One sample of a cycle."""

    index: int
    """Row of the planner's table."""
    rank: int | None
    """1 = lowest total of the legal ones; None for a rejected one."""
    velocity: tuple[float, float, float]
    """vx, vy (m/s), wz (rad/s)."""
    total: float | None
    """Weighted sum, None for a rejected one."""
    rejected_by: str | None
    """The critic's name, `limits` for what is no trajectory, None for a legal one."""
    reason: str = ""
    costs: dict[str, float] = field(default_factory=dict[str, float])
    """Raw cost by critic, of those that scored it."""
    weighted: dict[str, float] = field(default_factory=dict[str, float])
    """The same times the critic's scale: they add up to the total."""
    where: dict[str, Any] = field(default_factory=dict[str, Any])
    """Of a collision: step, pose, ahead_m, cell, cost."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "index": self.index,
            "rank": self.rank,
            "velocity": list(self.velocity),
            "total": self.total,
            "rejected_by": self.rejected_by,
            "reason": self.reason,
            "costs": self.costs,
            "weighted": self.weighted,
            **self.where,
        }


@dataclass(frozen=True, slots=True, eq=False)
class CommandExplanation:
    """The account of one control cycle; K samples, T points. Poses and costmap in the local costmap's frame."""

    time: float
    """Of the cycle (s): the last one not later than asked for."""
    asked: float
    planner: str
    state: str
    """Of the goal manager after that cycle."""
    verdict: str
    """In one or two sentences."""
    plan: LocalPlan
    """The command with its table."""
    samples: tuple[SampleAccount, ...]
    """Legal ones by rank, then rejected ones in the planner's order."""
    rejections: str
    """How many were rejected, by whom and where first."""
    costmap: Costmap
    footprint: Footprint
    """As the critics saw it, padding included."""
    robot: Pose2D
    poses: NDArray[np.float64] | None
    """(K, T, 3); None for a planner that keeps no rollouts."""
    counts: NDArray[np.int64] | None
    """(K,) valid points."""

    @property
    def legal(self) -> tuple[SampleAccount, ...]:
        """Samples that nobody rejected, by rank."""
        return tuple(s for s in self.samples if s.rank is not None)

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: everything but the grids."""
        plan = self.plan
        scales = plan.scales.tolist() if plan.scales is not None else []
        return {
            "time": self.time,
            "asked": self.asked,
            "planner": self.planner,
            "state": self.state,
            "verdict": self.verdict,
            "rejections": self.rejections,
            "mode": plan.mode,
            "command": list(plan.command),
            "best": plan.best if plan.best >= 0 else None,
            "robot": list(self.robot),
            "frame": self.costmap.frame,
            "scales": dict(zip(plan.critics, scales)),
            "samples": [sample.as_dict() for sample in self.samples],
            "notes": list(plan.notes),
        }


def explain_command(record: Record, time: float | None = None) -> CommandExplanation:
    """The control cycle in force at `time` (s; the run's end when None): the run is driven once more up to it.

    Raises InputError for a time outside the run, RecordError for a run without commands until then and as `replay` does.
    """
    asked = time_in(record, time)
    replayed = replay(record, _cycle_before(record, asked))
    planner = replayed.run.move_base.local_planner
    told = planner.explain(_inputs(replayed))
    name = type(planner).__name__
    plan: Any = told.get("plan")
    if not isinstance(plan, LocalPlan):
        recorded = record.local_plan_at(replayed.time)
        if recorded is None or recorded.t != replayed.time or recorded.plan.samples is None:
            raise RecordError(
                f"{name} tried no samples at {replayed.time:.3f} s{_failure_at(record, replayed.time)}; "
                "ask for an earlier or later --time",
                time=replayed.time,
            )
        plan, told = recorded.plan, {}
    costmap = told.get("costmap", replayed.costmap("local").master)
    accounts = told.get("accounts") or _accounts(plan)
    samples = _samples(plan, accounts)
    rejections = told.get("rejections") or _counted(samples)
    return CommandExplanation(
        time=replayed.time,
        asked=asked,
        planner=name,
        state=str(record.states[record.index_at(replayed.time)]),
        verdict=_verdict(name, plan, samples, rejections, told.get("rule", "")),
        plan=plan,
        samples=samples,
        rejections=rejections,
        costmap=costmap,
        footprint=told.get("footprint", replayed.costmap("local").footprint),
        robot=replayed.costmap("local").robot_pose(replayed.time),
        poses=told.get("poses"),
        counts=told.get("counts"),
    )


def _cycle_before(record: Record, time: float) -> float:
    """When the local planner last searched, until `time`."""
    tried = [*record.local_plan_times.tolist(), *(event.time for event in record.events_of("control_failed"))]
    before = [t for t in tried if t <= time + 1e-9]
    if not before:
        first = f"; the first is at {min(tried):.3f} s" if tried else " in the whole run"
        raise RecordError(f"no command was computed until {time:.3f} s{first}: give another --time", time=time)
    return max(before)


def _failure_at(record: Record, time: float) -> str:
    failed = [event for event in record.events_of("control_failed") if event.time == time]
    return f" ({failed[-1].text})" if failed else ""


def _inputs(replayed: Replay) -> ControlInput:
    costmap = replayed.costmap("local")
    robot = replayed.run.robot
    to_costmap = replayed.to_map("local").inverse() if costmap.frame != robot.map_frame else Transform2D()
    return ControlInput(robot.state(), costmap.master, costmap.footprint, to_costmap)


def _accounts(plan: LocalPlan) -> list[dict[str, Any]]:
    """What the table alone says, for planners that say no more."""
    assert plan.samples is not None
    by: list[int] = plan.rejected_by.tolist() if plan.rejected_by is not None else [-1] * len(plan.samples)
    names = {-1: None, -2: "limits"}
    return [{"rejected_by": names[b] if b in names else plan.critics[b], "reason": ""} for b in by]


def _samples(plan: LocalPlan, accounts: list[dict[str, Any]]) -> tuple[SampleAccount, ...]:
    if plan.samples is None or plan.totals is None:
        return ()
    k = len(plan.samples)
    legal = np.array([account["rejected_by"] is None for account in accounts], np.bool_)
    order = np.lexsort((np.arange(k), np.where(legal, plan.totals, np.inf)))
    made: list[SampleAccount] = []
    for place, row in enumerate(order.tolist()):
        account = dict(accounts[row])
        by, reason = account.pop("rejected_by"), account.pop("reason", "")
        costs: dict[str, float] = {}
        weighted: dict[str, float] = {}
        if plan.costs is not None and plan.scales is not None:
            for name, cost, scale in zip(plan.critics, plan.costs[row].tolist(), plan.scales.tolist()):
                if np.isfinite(cost):
                    costs[name], weighted[name] = cost, cost * scale
        vx, vy, wz = plan.samples[row].tolist()
        made.append(
            SampleAccount(
                index=row,
                rank=place + 1 if by is None else None,
                velocity=(vx, vy, wz),
                total=float(plan.totals[row]) if by is None else None,
                rejected_by=by,
                reason=reason,
                costs=costs,
                weighted=weighted,
                where=account,
            )
        )
    return tuple(made)


# --- in words -----------------------------------------------------------------------------------------------------------


def _counted(samples: tuple[SampleAccount, ...]) -> str:
    """The rejections of a planner that does not put them in words."""
    counted: dict[str, int] = {}
    for sample in samples:
        if sample.rejected_by is not None:
            counted[sample.rejected_by] = counted.get(sample.rejected_by, 0) + 1
    total = f"{sum(counted.values())} of {len(samples)} rejected"
    parts = ", ".join(f"{n} {name}" for name, n in sorted(counted.items(), key=lambda item: -item[1]))
    return f"{total}: {parts}" if parts else total


def speed_of(velocity: tuple[float, float, float] | Twist2D) -> str:
    """`vx 0.50, wz -0.10`; vy only where there is one."""
    vx, vy, wz = (v + 0.0 if abs(v) >= 5e-4 else 0.0 for v in velocity)
    side = f", vy {vy:.2f}" if vy else ""
    return f"vx {vx:.2f}{side}, wz {wz:.2f}"


def _verdict(name: str, plan: LocalPlan, samples: tuple[SampleAccount, ...], rejections: str, rule: str) -> str:
    if plan.mode == "escape":
        return f"{rejections}; the last resort is to back out, {speed_of(plan.command)}"
    if plan.mode != "follow":
        doing = {"brake": "braking", "rotate_to_goal": "turning"}.get(plan.mode, plan.mode)
        if plan.best >= 0:
            return f"at the goal's position, {doing}: {speed_of(plan.command)}"
        return f"at the goal's position, {doing} is not possible: {rejections}"
    winner = next((s for s in samples if s.index == plan.best), None)
    if winner is None:
        return f"nothing is legal: {rejections}"
    legal = [s for s in samples if s.rank is not None]
    lead = f"{rejections}; best legal sample {speed_of(winner.velocity)}"
    if len(legal) == 1:
        return f"{lead} because it is the only one"
    because: list[str] = []
    level = [s for s in legal if s is not winner and _as_dear(s, winner) and _differs(s, winner)]
    passed = [s for s in legal if (s.rank or 0) < (winner.rank or 0) and s not in level and _differs(s, winner)]
    if passed:
        because.append(
            f"{name} passed over {len(passed)} of a lower total" + (f": {rule}" if rule else " by a rule of its own")
        )
    other = next((s for s in legal if (s.rank or 0) > (winner.rank or 0) and not _as_dear(s, winner)), None)
    if other is not None:
        because.append(
            f"its total {_number(winner.total)} is {_against(winner, other)} of the next, {speed_of(other.velocity)}"
        )
    if level:
        because.append(
            f"{len(level)} cost the same, and the first of equals wins" if not passed else f"{len(level)} cost the same"
        )
    sentence = f"{lead} because {'; '.join(because)}" if because else lead
    fast = max(legal, key=lambda s: (round(s.velocity[0], 9), -(s.total or 0.0)))
    if fast.velocity[0] > winner.velocity[0] + 0.05 and fast is not other:
        sentence += f". The fastest ahead, {speed_of(fast.velocity)}, costs {_number(fast.total)}{_mostly(fast)}"
    return sentence


def _number(value: float | None) -> str:
    return f"{value:.4g}" if value is not None else "-"


def _differs(a: SampleAccount, b: SampleAccount) -> bool:
    return any(abs(x - y) > 1e-9 for x, y in zip(a.velocity, b.velocity))


def _as_dear(a: SampleAccount, b: SampleAccount) -> bool:
    """Equal totals, but for the last digits."""
    return math.isclose(a.total or 0.0, b.total or 0.0, rel_tol=1e-12, abs_tol=1e-12)


def _mostly(sample: SampleAccount) -> str:
    """Which critic makes up most of a total."""
    if not sample.weighted:
        return ""
    name, value = max(sample.weighted.items(), key=lambda item: item[1])
    return f", {_number(value)} of it from {name}" if value > 0.0 else ""


def _against(winner: SampleAccount, other: SampleAccount) -> str:
    """How the winner's total compares with another's, and which critics make the difference."""
    total = (other.total or 0.0) - (winner.total or 0.0)
    changes = {name: other.weighted.get(name, 0.0) - value for name, value in winner.weighted.items()}
    small = 0.02 * max((abs(v) for v in changes.values()), default=0.0)
    better = sorted(((v, n) for n, v in changes.items() if v > small), reverse=True)
    worse = sorted((v, n) for n, v in changes.items() if v < -small)
    if total <= 0.0 and not better:
        return "that"
    words = ", ".join(f"{n} {_number(v)} better" for v, n in better)
    against = ", ".join(f"{n} {_number(-v)} worse" for v, n in worse)
    detail = f" ({words}{', ' if words and against else ''}{against})" if words or against else ""
    return f"{_number(total)} below that{detail}" if total > 0.0 else f"equal to that{detail}"
