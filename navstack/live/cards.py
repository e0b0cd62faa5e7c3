"""Explanations as the page draws them: cards with facts, bars and lines, and the trajectories of a control cycle on the map.

A card is a JSON object: `title`, `tone` (good, warn, bad or empty), `text`, `facts` (label, value), `bars` (label, value, share
of the longest, detail), `lines` (label, text, tone). The texts of the commands say the same in columns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from navstack.core import Pose2D, Transform2D, describe_cost
from navstack.explain import (
    CellReport,
    CommandReport,
    GoalReport,
    PassageReport,
    SampleReport,
    chain_sentence,
    steering_sentence,
)

Card = dict[str, Any]

MAX_SAMPLES: Final = 500
"""More trajectories than this are thinned out."""
FAN_POINTS: Final = 8
"""Points of a trajectory on the map."""
_TONES: Final = {
    "plan_failed": "warn",
    "control_failed": "warn",
    "recovery": "warn",
    "warning": "warn",
    "lost": "warn",
    "stuck": "warn",
    "collision": "bad",
}
_RATINGS: Final = {"free": "good", "turns": "good", "fits": "good", "costly": "warn", "stuck": "warn", "blocked": "bad"}


class Explanation(str):
    """The text of an explanation, as the command prints it, with what the page shows: `cards`, and `fan` for the map."""

    __slots__ = ("cards", "fan")

    def __new__(cls, text: str, cards: Sequence[Card] = (), fan: dict[str, Any] | None = None) -> Explanation:
        """Return the text with its cards."""
        made = super().__new__(cls, text)
        made.cards, made.fan = tuple(cards), fan
        return made

    @property
    def data(self) -> dict[str, Any]:
        """The cards and the fan for the page."""
        return {"cards": list(self.cards), "fan": self.fan}


class Bar(NamedTuple):
    """One bar: its label and value, its length as a share of the longest, and a detail."""

    label: str
    value: str
    share: float
    detail: str = ""


def card(
    title: str,
    text: str = "",
    *,
    tone: str = "",
    facts: Iterable[tuple[str, str]] = (),
    bars: Iterable[Bar] = (),
    lines: Iterable[tuple[str, str, str]] = (),
) -> Card:
    """Return a card; see the module for its parts."""
    parts = {"facts": list(facts), "bars": list(bars), "lines": list(lines)}
    return {
        "title": title,
        "tone": tone,
        "text": _sentence(text),
        **{name: part for name, part in parts.items() if part},
    }


def cell_cards(report: CellReport) -> list[Card]:
    """Return the cost of a cell, and what each layer did."""
    found = report.provenance
    facts = [("at", f"{report.point[0]:.2f}, {report.point[1]:.2f} m"), ("time", f"{report.time:.1f} s")]
    first = card(
        f"{found.costmap}: {describe_cost(found.cost)}", report.summary, tone=_cost_tone(found.cost), facts=facts
    )
    made = [first | {"cost": found.cost}]
    for title, subject in (("Layers", found), ("Layers at the obstacle", found.obstacle)):
        if subject is None:
            continue
        lines = [
            (
                f"{share.layer}: {share.before} → {share.after}" if share.before != share.after else share.layer,
                share.explanation.text if share.explanation is not None else "no explanation",
                "" if share.before == share.after else "accent",
            )
            for share in subject.layers
        ]
        made.append(card(title, lines=lines))
    return made


def command_cards(report: CommandReport) -> list[Card]:
    """Return the command, the costs of the chosen trajectory, all trajectories, and who rejected the others."""
    plan = report.plan
    vx, vy, wz = plan.command
    facts = [("drives", f"{_number(vx)} m/s"), ("turns", f"{_number(wz)} rad/s")]
    facts += [("sideways", f"{_number(vy)} m/s")] if vy else []
    facts += [("planner", report.planner), ("mode", plan.mode.replace("_", " ")), ("time", f"{report.time:.1f} s")]
    notes = [("", _sentence(note), "") for note in plan.notes]
    if report.steering is not None:
        notes.insert(0, ("", _sentence(steering_sentence(report.steering)), ""))
    if report.chain is not None:
        notes.insert(0, ("", _sentence(chain_sentence(report.chain)), "accent" if report.chain.changed_by else ""))
    tone = "" if plan.mode != "escape" and (plan.best >= 0 or not report.samples) else "warn"
    made = [card("Command", report.summary, tone=tone, facts=facts, lines=notes)]
    chosen = next((s for s in report.samples if s.index == plan.best), None)
    if chosen is not None and chosen.weighted:
        made.append(_costs("Costs of the chosen trajectory", chosen, plan.critics, plan.scales))
    if report.samples:
        made.append(card("Trajectories") | {"samples": [_row(s) for s in _thinned(report)]})
    rejected = Counter(s.rejected_by for s in report.samples if s.rejected_by is not None)
    if rejected:
        most = max(rejected.values())
        bars = [Bar(str(name), str(count), count / most) for name, count in rejected.most_common()]
        made.append(card(f"{sum(rejected.values())} of {len(report.samples)} rejected by", bars=bars))
    return made


def sample_cards(report: CommandReport, sample: SampleReport) -> list[Card]:
    """Return the scores of one trajectory, or who rejected it, and then the command of its cycle."""
    vx, vy, wz = (_number(value) for value in sample.velocity)
    facts = [
        ("drives", f"{vx} m/s"),
        ("turns", f"{wz} rad/s"),
        *([("sideways", f"{vy} m/s")] if sample.velocity[1] else []),
    ]
    if sample.rejected_by is not None:
        ahead = sample.collision.get("ahead_m")
        where = "" if ahead is None else f", {ahead:.2f} m ahead"
        first = card(
            "Rejected", f"{sample.rejected_by}: {sample.reason or 'no reason given'}{where}", tone="bad", facts=facts
        )
        return [first, *command_cards(report)]
    is_best = sample.index == report.plan.best
    text = "This one was chosen." if is_best else f"Rank {sample.rank} of {len(report.legal)}."
    made = [card(f"Total cost {sample.total:.4g}", text, tone="good" if is_best else "", facts=facts)]
    if sample.weighted:
        made.append(_costs("Its costs", sample, report.plan.critics, report.plan.scales))
    return [*made, *command_cards(report)]


def fan_of(report: CommandReport, at: Pose2D, sample: int | None = None) -> dict[str, Any] | None:
    """Return the trajectories of the cycle in the map frame.

    `at` is the robot's pose there, `sample` the trajectory that is asked about.
    """
    if report.poses is None or report.counts is None:
        return None
    to_map = Transform2D(*at) @ Transform2D(*report.robot).inverse()
    rows: list[list[Any]] = []
    for each in _thinned(report):
        count = int(report.counts[each.index])
        if count > 1:
            index = np.rint(np.linspace(0.0, count - 1, FAN_POINTS)).astype(np.int64)
            points = to_map.apply_points(report.poses[each.index, index, :2])
            rows.append([each.index, each.total, np.round(points, 3).ravel().tolist()])
    return {"rows": rows, "best": report.plan.best, "sample": sample, "time": report.time} if rows else None


def goal_cards(report: GoalReport, causes: Sequence[str] = ()) -> list[Card]:
    """Return the outcome of a goal, what may have caused it, and its timeline."""
    reached = report.status == "SUCCEEDED"
    tone = "good" if reached else "" if report.status in ("PENDING", "ACTIVE", "PREEMPTING") else "bad"
    states = ("PLANNING", "CONTROLLING", "CLEARING", "MOTION")
    facts = [(state.lower(), f"{spent:.1f} s") for state in states if (spent := report.seconds(state)) > 0.0]
    lines = [
        (
            f"{line.begin:.1f} s" if line.end - line.begin < 0.05 else f"{line.begin:.1f} to {line.end:.1f} s",
            line.text,
            tone if line.kind == "end" else _TONES.get(line.kind, ""),
        )
        for line in report.timeline
    ]
    made = [card(f"Goal {report.number}", report.summary, tone=tone, facts=facts)]
    if causes:
        made.append(card("Possible causes", tone="warn", lines=[("", cause, "warn") for cause in causes]))
    return [*made, card("What happened", lines=lines)]


def passage_cards(report: PassageReport, number: int) -> list[Card]:
    """Return whether the robot passes the opening with this number (from 1)."""
    passage, widths = report.passages[number - 1], report.widths
    verdicts = {
        "free": "The robot passes",
        "costly": "The robot passes, at high cost",
        "blocked": "The robot does not pass",
    }
    facts = [("width", f"{passage.width:.2f} m"), ("at", f"{passage.x:.2f}, {passage.y:.2f} m")]
    facts += [("cost", str(passage.cost))] + ([("length", f"{passage.length:.1f} m")] if passage.length >= 0.5 else [])
    compared = (("this opening", passage.width), ("minimum", widths.minimum), ("at low cost", widths.low_cost))
    compared += (("for a turn in place", widths.turning), ("own width", widths.robot))
    longest = max((width for _, width in compared if math.isfinite(width)), default=1.0)
    bars = [Bar(label, f"{width:.2f} m", min(1.0, width / longest)) for label, width in compared]
    return [
        card(verdicts[passage.rating], passage.reason, tone=_RATINGS[passage.rating], facts=facts),
        card("Widths", bars=bars),
    ]


def _costs(title: str, sample: SampleReport, critics: Sequence[str], scales: Any) -> Card:
    weights = dict(zip(critics, scales.tolist())) if scales is not None else {}
    scored = sorted(((n, v) for n, v in sample.weighted.items() if v), key=lambda item: -abs(item[1]))
    most = abs(scored[0][1]) if scored else 1.0
    bars = [
        Bar(name, f"{value:.4g}", abs(value) / most, f"{sample.costs[name]:.4g} × {weights.get(name, 1.0):.4g}")
        for name, value in scored
    ]
    free = ", ".join(name for name, value in sample.weighted.items() if not value)
    text = f"no cost from {free}" if free else ""
    return card(f"{title}: {sample.total:.4g}" if sample.total is not None else title, text, bars=bars)


def _thinned(report: CommandReport) -> list[SampleReport]:
    """The samples, legal ones by rank first; of many, every n-th, and the chosen one."""
    stride = max(1, -(-len(report.samples) // MAX_SAMPLES))
    return [s for place, s in enumerate(report.samples) if place % stride == 0 or s.index == report.plan.best]


def _row(sample: SampleReport) -> list[Any]:
    main = max(sample.weighted, key=lambda name: sample.weighted[name]) if sample.weighted else ""
    velocity = [_number(value) for value in sample.velocity]
    return [sample.index, sample.rank, *velocity, sample.total, sample.rejected_by or main]


def _cost_tone(cost: int) -> str:
    return "good" if cost == 0 else "bad" if cost in (253, 254) else "warn"


def _number(value: float) -> str:
    """Two digits, without the sign of -0.00."""
    text = f"{value:.2f}"
    return "0.00" if text == "-0.00" else text


def _sentence(text: str) -> str:
    """The text as a sentence of its own."""
    return text[:1].upper() + text[1:]
