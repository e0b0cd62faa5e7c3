"""The report of a goal: its states, recoveries, plans, failures, curves and timeline. Times are seconds of the run."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D

TERMINAL = ("PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "RECALLED")
"""Terminal states of a goal in actionlib."""


@dataclass(frozen=True, slots=True)
class StateSpan:
    """A time span in one state of the goal manager."""

    state: str
    begin: float
    end: float


@dataclass(slots=True)
class RecoveryRun:
    """One execution of a recovery behavior."""

    name: str
    type: str
    """Class of the plugin; empty in old records."""
    number: int
    """Position in the list of recovery behaviors, from 1."""
    total: int
    """Length of that list."""
    trigger: str
    """PLANNING_R, CONTROLLING_R, OSCILLATION_R or LOST_R."""
    begin: float
    end: float
    outcome: str = "running"
    """done, failed, or running if it was interrupted."""
    text: str = ""
    """Final message."""
    cleared: int | None = None
    """Number of cleared cells; None for behaviors that clear nothing."""

    def as_dict(self) -> dict[str, Any]:
        """Returns the fields for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class TimelineEntry:
    """One line of the timeline; repeated events share a line."""

    begin: float
    end: float
    kind: str
    """goal, plan, plan_failed, control_failed, recovery, lost, stuck, collision, warning, info, cancel or end."""
    text: str
    count: int = 1
    """Number of events that the line stands for."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])

    def as_dict(self) -> dict[str, Any]:
        """Returns the fields for JSON."""
        return {name: getattr(self, name) for name in ("begin", "end", "kind", "text", "count", "data")}


@dataclass(frozen=True, slots=True, eq=False)
class GoalReport:
    """A goal from its arrival to its terminal state."""

    number: int
    """Position among the goals of the run, from 1."""
    id: str
    pose: Pose2D | None
    """Goal pose in the global frame; None if it could not be transformed."""
    sent: float
    accepted: float | None
    """None for a goal that was cancelled or replaced before it became active."""
    ended: float
    """Time of the terminal state; the end of the record for a goal without one."""
    status: str
    """Last goal state in the record, as in actionlib."""
    text: str
    """Status text, as in C++."""
    error_code: int
    error_name: str
    message: str
    summary: str
    """The outcome in one sentence."""
    spans: tuple[StateSpan, ...]
    recoveries: tuple[RecoveryRun, ...]
    timeline: tuple[TimelineEntry, ...]
    plan_times: NDArray[np.float64]
    """(p,) times of the plans found."""
    plan_lengths: NDArray[np.float64]
    """(p,) lengths of these plans (m)."""
    failed_plans: tuple[tuple[float, str], ...]
    """Time and error name of each failed planning request."""
    failed_commands: tuple[tuple[float, str], ...]
    """Time and error name of each control cycle without a command."""
    times: NDArray[np.float64]
    """(n,) times of the control cycles."""
    distance: NDArray[np.float64]
    """(n,) straight-line distance to the goal (m); NaN if the goal pose is unknown."""
    remaining: NDArray[np.float64]
    """(n,) remaining length of the current plan (m); NaN without a plan."""
    velocity: NDArray[np.float64]
    """(n, 3) vx, vy (m/s), wz (rad/s) from odometry."""
    expired_limit_s: float | None = None
    """Time limit of the run's goals (s) if the run cancelled the goal because it had expired; None otherwise."""

    @property
    def duration(self) -> float:
        """Time from arrival to terminal state (s)."""
        return self.ended - self.sent

    @property
    def ended_in_record(self) -> bool:
        """True if the record contains the terminal state."""
        return self.status in TERMINAL

    def seconds(self, state: str) -> float:
        """Total time in a state (s)."""
        return sum(span.end - span.begin for span in self.spans if span.state == state)

    def as_dict(self) -> dict[str, Any]:
        """Returns the report for JSON, without the curves, which the record contains."""
        return {
            "number": self.number,
            "id": self.id,
            "goal": None if self.pose is None else list(self.pose),
            "sent": self.sent,
            "accepted": self.accepted,
            "ended": self.ended,
            "status": self.status,
            "text": self.text,
            "error_code": self.error_code,
            "error_name": self.error_name,
            "message": self.message,
            "expired_limit_s": self.expired_limit_s,
            "summary": self.summary,
            "states": [{"state": s.state, "begin": s.begin, "end": s.end} for s in self.spans],
            "seconds": {s: self.seconds(s) for s in dict.fromkeys(span.state for span in self.spans)},
            "recoveries": [recovery.as_dict() for recovery in self.recoveries],
            "plans": [{"time": t, "length_m": m} for t, m in zip(self.plan_times.tolist(), self.plan_lengths.tolist())],
            "failures": dict(Counter(name for _, name in self.failed_plans + self.failed_commands)),
            "timeline": [entry.as_dict() for entry in self.timeline],
        }
