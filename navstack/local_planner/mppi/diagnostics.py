"""How MPPI found its command: every sample with the scores of the critics, and what the average made of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.local_planner.mppi.batch import Batch, Floats, TrajectoryContext
from navstack.local_planner.mppi.optimizer import Optimizer
from navstack.plugins import ControlDiagnostics, LocalPlan, RejectionDetail, Rollouts

STANDSTILL_M_S: Final = 0.01
"""A slower robot stands still."""
CONTROL_COST: Final = "control cost"
"""Column of the term gamma / sigma² * u * noise."""


def all_collide(optimizer: Optimizer, context: TrajectoryContext, problem: str) -> tuple[str, dict[str, Any]]:
    """Text and data of the error of a cycle without a command."""
    batch = optimizer.batch
    number = batch.number
    collided = int(batch.collided[:number].sum())
    name, detail = _nearest(optimizer)
    data: dict[str, Any] = {"samples": number, "rejected": {name: collided} if name else {}}
    if detail is None:
        return f"{problem}: {collided} of {number} samples collide", data
    place = detail.as_dict()
    del place["reason"]
    data["collision"] = place
    where = f"{detail.ahead_m:.2f} m ahead" if detail.ahead_m else "at its current pose"
    return f"{problem}: {collided} of {number} samples rejected by {name} (the nearest {detail.reason} {where})", data


def _nearest(optimizer: Optimizer) -> tuple[str, RejectionDetail | None]:
    """The obstacle critic, and the collision nearest to the robot among its trajectories."""
    batch = optimizer.batch
    rows = np.flatnonzero(batch.collided[: batch.number])
    critic = _obstacle_critic(optimizer)
    if critic is None or not len(rows):
        return "", None
    details = [optimizer.critics[critic].explain(int(row)) for row in rows[:: max(1, len(rows) // 100)]]
    return optimizer.critics[critic].name, min(details, key=lambda d: d.ahead_m if d.ahead_m is not None else np.inf)


def _obstacle_critic(optimizer: Optimizer) -> int | None:
    """Index of the first critic in use that finds collisions."""
    for index, critic in enumerate(optimizer.critics):
        if critic.params.enabled and hasattr(critic.params, "collision_cost"):
            return index
    return None


def diagnose(optimizer: Optimizer, context: TrajectoryContext, plan: LocalPlan) -> ControlDiagnostics:
    """Diagnostics of the last cycle: K samples, then the chosen sequence as row K, if there is one.

    The table has a column for each critic and one for the control cost. A sample that collides counts as rejected.
    """
    number = optimizer.batch.number
    names = (*(critic.name for critic in optimizer.critics), CONTROL_COST)
    rejecting = _obstacle_critic(optimizer)
    collided = optimizer.batch.collided[:number]
    details: list[tuple[str | None, RejectionDetail]] = [(None, RejectionDetail())] * number
    if rejecting is not None:
        critic = optimizer.critics[rejecting]
        for row in np.flatnonzero(collided).tolist():
            details[row] = critic.name, critic.explain(row)
    costs = np.zeros((number, len(names)))
    costs[:, :-1] = optimizer.scores[: len(optimizer.critics), :number].T
    costs[:, -1] = _control_costs(optimizer)[:number] if not optimizer.batch.all_collided else 0.0
    batch = optimizer.batch
    poses, commands = _trajectories(batch), batch.speeds[:, min(1, batch.speeds.shape[1] - 1), :number].T.astype(float)
    notes = list(plan.notes)
    best = -1
    if plan.trajectory is not None:
        notes += _lessons(optimizer, costs, names)
        row, chosen = _chosen(optimizer, context)
        costs, best = np.vstack([costs, row]), number
        poses = np.vstack([poses, chosen])
        commands = np.vstack([commands, plan.command])
        details.append((None, RejectionDetail()))
        collided = np.append(collided, False)
    scales = np.ones(len(names))
    totals = np.where(collided, -1.0, costs.sum(axis=1))
    rejected_by = np.where(collided, -1 if rejecting is None else rejecting, -1).astype(np.int8)
    table = replace(
        plan,
        samples=commands,
        critics=names,
        costs=costs,
        scales=scales,
        totals=totals,
        rejected_by=rejected_by,
        best=best,
        notes=tuple(notes),
    )
    rejected = int(collided.sum())
    where = "" if rejecting is None or not rejected else f": {rejected} {names[rejecting]}"
    return ControlDiagnostics(
        plan=table,
        rollouts=Rollouts(commands, poses, np.full(len(poses), poses.shape[1], np.int64)),
        costmap=context.costmap,
        footprint=context.footprint,
        rejections=f"{rejected} of {number} samples collide{where}",
        samples=tuple(details),
        rule=_rule(optimizer),
        averages=True,
        critic_states={
            critic.name: {"used": used} for critic, used in zip(optimizer.critics, optimizer.used, strict=True)
        },
    )


def _trajectories(batch: Batch) -> NDArray[np.float64]:
    """(K, T, 3) in the costmap's frame."""
    poses = batch.points[:, :, : batch.number].transpose(2, 1, 0).astype(np.float64)
    poses[:, :, :2] += batch.anchor
    return poses


def _control_costs(optimizer: Optimizer) -> Floats:
    """(K,) the control cost alone: the totals without the scores of the critics."""
    scores: Floats = optimizer.costs - optimizer.scores[: len(optimizer.critics)].sum(axis=0, dtype=np.float32)
    return scores


def _chosen(optimizer: Optimizer, context: TrajectoryContext) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(C + 1,) scores of the chosen sequence, and (1, T, 3) its trajectory."""
    batch = optimizer.batch
    one = Batch.empty(1, len(optimizer.optimal), batch.dt)
    one.anchor = batch.anchor
    one.speeds[:] = optimizer.sequence.T[:, :, None]
    one.points[:] = optimizer.optimal.T[:, :, None]
    row = np.zeros(len(optimizer.critics) + 1)
    for index, critic in enumerate(optimizer.critics):
        if optimizer.used[index]:
            out, totals = np.zeros((2, one.points.shape[2]), np.float32)
            critic.add_scores(one, out, totals)
            row[index] = out[0]
    return row, _trajectories(one)


def _effective(costs: NDArray[np.float64], temperature: float) -> float:
    """Effective sample size of the weights: 1 / sum of their squares."""
    weights = np.exp(-(costs - costs.min()) / temperature)
    return float(weights.sum() ** 2 / (weights**2).sum())


def _rule(optimizer: Optimizer) -> str:
    return (
        "the command is the average of all samples, weighted by exp(-total / temperature) with temperature "
        f"{optimizer.params.temperature:g}"
    )


def _average(optimizer: Optimizer, costs: NDArray[np.float64], temperature: float) -> NDArray[np.float64]:
    """(3,) the weighted average of the control that is sent, before filter and limits."""
    sent, number = optimizer.sent, optimizer.batch.number
    weights = np.exp(-(costs - costs.min()) / temperature)
    weights /= weights.sum()
    noise = optimizer.sampled[:, sent, :number].astype(np.float64)
    average: NDArray[np.float64] = optimizer.before[sent].astype(np.float64) + noise @ weights
    return average


def _lessons(optimizer: Optimizer, costs: NDArray[np.float64], names: tuple[str, ...]) -> list[str]:
    """What the average depends on: effective samples, temperature, each critic, and why the robot stands still."""
    temperature, number = optimizer.params.temperature, len(costs)
    totals = costs.sum(axis=1)
    count = _effective(totals, temperature)
    others = ", ".join(f"{_effective(totals, f * temperature):.0f} at {f * temperature:g}" for f in (0.5, 2.0))
    notes = [f"effective sample size {count:.0f} of {number} at temperature {temperature:g} ({others})"]
    if count < 0.01 * number:
        notes.append("fewer than 1 % of the samples decide: the command is noisy; raise temperature or batch_size")
    order = np.argsort(totals, kind="stable")
    part = max(1, min(1000, number // 2))
    best, worst = order[:part], order[-part:]
    gap = costs[worst].mean(axis=0) - costs[best].mean(axis=0)
    main = np.argsort(-gap)[:3]
    parts = ", ".join(f"{names[i]} {gap[i]:.3g}" for i in main if gap[i] > 0.0)
    notes.append(
        f"the worst {part} samples cost {totals[worst].mean():.4g} on average, the best {part} {totals[best].mean():.4g}"
        + (f"; the difference: {parts}" if parts else "")
    )
    chosen = _average(optimizer, totals, temperature)
    moves = [
        (names[i], _average(optimizer, totals - costs[:, i], temperature) - chosen)
        for i in range(len(names))
        if costs[:, i].any()
    ]
    axes = ("vx", "vy", "wz") if optimizer.omni else ("vx", "wz")
    index = (0, 1, 2) if optimizer.omni else (0, 2)
    texts = [
        f"{name} " + " ".join(f"{axis} {-change[k]:+.3f}" for axis, k in zip(axes, index, strict=True))
        for name, change in moves
    ]
    if texts:
        notes.append(f"what each critic changes in the average: {'; '.join(texts)}")
    return notes + _standstill(optimizer, moves, costs, names)


def _standstill(
    optimizer: Optimizer,
    moves: list[tuple[str, NDArray[np.float64]]],
    costs: NDArray[np.float64],
    names: tuple[str, ...],
) -> list[str]:
    """Why the chosen command is nearly 0, if it is."""
    command = np.array(optimizer.last)
    if np.hypot(command[0], command[1]) > STANDSTILL_M_S or abs(command[2]) > 10.0 * STANDSTILL_M_S:
        return []
    forward = np.flatnonzero(optimizer.batch.speeds[0, -1, : len(costs)] > 0.5 * optimizer.motion.vx_max)
    braking = [(name, float(change[0])) for name, change in moves if change[0] > 0.02]
    texts = [f"{name} holds it back by {speed:.2f} m/s" for name, speed in sorted(braking, key=lambda m: -m[1])]
    if len(forward):
        extra = costs[forward].mean(axis=0) - costs.mean(axis=0)
        worst = int(np.argmax(extra))
        if extra[worst] > 0.0:
            texts.append(f"samples that drive on cost {extra[worst]:.3g} more by {names[worst]}")
    return (
        [f"the robot stands still: {'; '.join(texts)}"]
        if texts
        else ["the robot stands still: no sample gains by moving"]
    )
