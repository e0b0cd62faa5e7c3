# pyright: basic
"""Scoring of rollouts: every critic in order, with a table of their scores, and a report of why samples were rejected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import InternalError, NavError, plain_kernel
from navstack.plugins import (
    ControlDiagnostics,
    Critic,
    LocalPlan,
    RejectionDetail,
    Rollouts,
    ScoringContext,
    broken_contract,
    plugin_error,
)

OUTSIDE_LIMITS = -2
"""`rejected_by` of a velocity sample without a trajectory: below the lowest or above the highest speed."""
FLOAT64 = np.dtype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class ScoreTable:
    """Scores of K rollouts by C critics: see the fields of LocalPlan."""

    costs: NDArray[np.float64]
    scales: NDArray[np.float64]
    totals: NDArray[np.float64]
    rejected_by: NDArray[np.int8]
    best: int
    """Index of the lowest total (the first of equals); -1 if every rollout was rejected."""


def score(critics: Sequence[Critic], context: ScoringContext, rollouts: Rollouts) -> ScoreTable:
    """Prepare the critics and add up their weighted scores; the first negative score rejects a rollout.

    A critic with weight 0 is skipped. Raises InternalError for a critic that returns an array of the wrong shape or type.
    """
    k = len(rollouts.counts)
    alive = rollouts.alive
    costs, scales = np.empty((k, len(critics))), np.empty(len(critics))
    totals, rejected_by = np.empty(k), np.empty(k, np.int8)
    best = begin_table(rollouts.counts, alive, costs, totals, rejected_by)
    for i, critic in enumerate(critics):
        scale = scales[i] = prepared_scale(critic, context)
        if scale != 0.0:
            scores = checked_scores(critic, rollouts)
            best = add_scores(scores, scale, i, alive, costs, totals, rejected_by)
    return ScoreTable(costs, scales, totals, rejected_by, best)


def prepared_scale(critic: Critic, context: ScoringContext) -> float:
    """Prepare a critic for a cycle, and return its weight. Raises PluginError if it fails."""
    try:
        critic.prepare(context)
        return float(critic.scale)
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(critic, exc) from exc


def checked_scores(critic: Critic, rollouts: Rollouts) -> NDArray[np.float64]:
    """(K,) scores of a prepared critic.

    Raises InternalError for an array of the wrong shape or type, PluginError if the critic fails or writes into the commands.
    """
    k = len(rollouts.counts)
    foreign = not type(critic).__module__.startswith("navstack.")
    before = rollouts.commands.copy() if foreign else rollouts.commands
    try:
        scores = critic.score(rollouts)
    except NavError:
        raise
    except Exception as exc:
        raise plugin_error(critic, exc) from exc
    if not isinstance(scores, np.ndarray) or scores.shape != (k,) or scores.dtype != FLOAT64:
        is_array = isinstance(scores, np.ndarray)
        what = f"{scores.dtype} of shape {scores.shape}" if is_array else type(scores).__name__
        raise InternalError(f'critic "{critic.name}" must return {k} float64 scores, not {what}', critic=critic.name)
    if foreign and not np.array_equal(rollouts.commands, before, equal_nan=True):
        raise broken_contract(critic, "wrote into rollouts.commands, which are what the robot is commanded")
    # another layout would compile another version of the kernel
    return scores if scores.flags.c_contiguous else scores.copy()


@plain_kernel
def begin_table(counts, alive, costs, totals, rejected_by):
    """Initialize the table: rollouts without points are OUTSIDE_LIMITS, all others are alive. Returns their first, or -1."""
    first = -1
    for k in range(len(counts)):
        alive[k] = counts[k] > 0
        totals[k] = 0.0 if alive[k] else np.nan
        rejected_by[k] = -1 if alive[k] else OUTSIDE_LIMITS
        for critic in range(costs.shape[1]):
            costs[k, critic] = np.nan
        if first < 0 and alive[k]:
            first = k
    return first


@plain_kernel
def add_scores(scores, scale, critic, alive, costs, totals, rejected_by):
    """Add one critic's scores to the totals of the rollouts that are alive; a negative score (or NaN) rejects.

    Writes `costs` (K, C), `totals`, `rejected_by` and `alive` (K,). Returns the index of the lowest total (the first of
    equals), -1 if no rollout is alive.
    """
    best = -1
    for k in range(len(scores)):
        if not alive[k]:
            continue
        score = scores[k]
        costs[k, critic] = score
        if score >= 0.0:
            totals[k] += score * scale
            if best < 0 or totals[k] < totals[best]:
                best = k
        else:
            totals[k] = score
            rejected_by[k] = critic
            alive[k] = False
    return best


def control_diagnostics(
    plan: LocalPlan,
    context: ScoringContext,
    rollouts: Rollouts,
    table: ScoreTable,
    critics: Sequence[Critic],
    rule: str,
    *,
    rejecting: Sequence[Critic] | None = None,
) -> ControlDiagnostics:
    """How a cycle selected its sample. `rejecting`: the critics of the table, if they are not all `critics`."""
    used = critics if rejecting is None else rejecting
    samples = plan.samples if plan.samples is not None else rollouts.commands
    grids = {critic.name: critic.grid_values() for critic in critics}
    return ControlDiagnostics(
        plan=plan,
        rollouts=Rollouts(rollouts.commands.copy(), rollouts.poses.copy(), rollouts.counts.copy()),
        costmap=context.costmap,
        footprint=context.footprint,
        rejections=rejection_report(table, used, samples)[0],
        samples=rejection_details(table, used),
        rule=rule,
        grids={name: grid for name, grid in grids.items() if grid is not None},
        critic_states={critic.name: critic.state() for critic in critics},
    )


# --- why samples were rejected --------------------------------------------------------------------------------------

SPEED_LIMITS = "too slow or too fast"
"""Reason for samples that were not simulated."""


def count_rejections(table: ScoreTable, critics: Sequence[Critic]) -> dict[str, int]:
    """Number of samples rejected by each critic and by the speed limits, highest first."""
    by_code = np.bincount(table.rejected_by - OUTSIDE_LIMITS, minlength=len(critics) + 2).tolist()
    counted = {critic.name: by_code[i - OUTSIDE_LIMITS] for i, critic in enumerate(critics)}
    counted[SPEED_LIMITS] = by_code[0]
    return {name: n for name, n in sorted(counted.items(), key=lambda item: -item[1]) if n}


def rejection_report(
    table: ScoreTable, critics: Sequence[Critic], samples: NDArray[np.float64]
) -> tuple[str, dict[str, Any]]:
    """Sentence and data of a NoValidControlError. `samples` (K, 3): the velocity samples."""
    counted = count_rejections(table, critics)
    data: dict[str, Any] = {"samples": len(table.totals), "rejected": counted}
    parts: list[str] = []
    for name, number in counted.items():
        words = ""
        index = next((i for i, critic in enumerate(critics) if critic.name == name), None)
        if index is not None:
            critic, rows = critics[index], np.flatnonzero(table.rejected_by == index)
            row = critic.nearest_rejection(rows)
            detail = critic.explain(row)
            words = _describe(detail) or _reasons(critic, table.totals[rows])
            if detail.step is not None:
                place = detail.as_dict()
                del place["reason"]
                data["collision"] = {**place, "sample": samples[row].tolist()}
        parts.append(f"{number} {name} ({words})" if words else f"{number} {name}")
    total = f"{sum(counted.values())} of {len(table.totals)} rejected"
    return f"{total}: {', '.join(parts)}" if parts else total, data


def rejection_details(table: ScoreTable, critics: Sequence[Critic]) -> tuple[tuple[str | None, RejectionDetail], ...]:
    """For each sample the critic that rejected it (`limits`: not simulated, None: legal) and why."""
    details: list[tuple[str | None, RejectionDetail]] = []
    for row, (by, total) in enumerate(zip(table.rejected_by.tolist(), table.totals.tolist())):
        if by == -1:
            details.append((None, RejectionDetail()))
        elif by == OUTSIDE_LIMITS:
            details.append(("limits", RejectionDetail(SPEED_LIMITS)))
        else:
            critic = critics[by]
            detail = critic.explain(row)
            if not detail.reason and np.isfinite(total):
                detail = RejectionDetail(critic.CODES.get(int(total), ""))
            details.append((critic.name, detail))
    return tuple(details)


def _describe(detail: RejectionDetail) -> str:
    if detail.ahead_m is None:
        return detail.reason
    return (
        f"{detail.reason} {detail.ahead_m:.2f} m ahead"
        if detail.ahead_m > 0.0
        else f"{detail.reason} at its current pose"
    )


def _reasons(critic: Critic, totals: NDArray[np.float64]) -> str:
    codes = sorted({int(code) for code in totals[np.isfinite(totals)]})
    return "; ".join(critic.CODES[code] for code in codes if code in critic.CODES)
