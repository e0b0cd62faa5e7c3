"""Why a velocity sample won, in one or two sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from navstack.core import Twist2D
from navstack.explain.samples import SampleReport
from navstack.interfaces import LocalPlan

_FASTER_M_S = 0.05
"""A legal sample that is faster than the chosen one by this much is mentioned."""


def summary_of(planner: str, plan: LocalPlan, samples: Sequence[SampleReport], rejections: str, rule: str) -> str:
    """The summary of a cycle; `rule` describes how the planner chooses if it is not by the lowest total cost."""
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
    """The summary of a cycle whose command is an average of the samples."""
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
    """The rejections by critic, for planners without a report of their own."""
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
    """A sentence about the fastest sample forward, unless it won or is `mentioned` already."""
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
    """The critic with the largest share of a total."""
    if not sample.weighted:
        return ""
    name, value = max(sample.weighted.items(), key=lambda item: item[1])
    return f", {_number(value)} of it from {name}" if value > 0.0 else ""


def _comparison(winner: SampleReport, other: SampleReport) -> str:
    """How much lower the winner's total is than that of another sample, and which critics make the difference."""
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
