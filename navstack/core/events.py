"""Events of a run, and their listeners."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol


@dataclass(frozen=True, slots=True)
class Event:
    """An event at `time` (s).

    `kind` is one of: goal, status, feedback, plan, plan_failed, control_failed, state, recovery, warning, info,
    docking, task.
    `text` is for users, `data` for programs. `data` must be reproducible: no wall-clock times.
    """

    time: float
    kind: str
    text: str
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class Listener(Protocol):
    """A receiver of events: a record, a progress bar, a test.

    A listener with the attribute `hears_feedback = False` does not request the feedback events of every control cycle.
    One with the attribute `kinds`, a set, needs only events of these kinds: what no listener needs is not composed.
    """

    def on_event(self, event: Event) -> None:
        """Receive an event. Events arrive once each, in chronological order."""
        ...
