"""What happened, when, and why: the words of a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth telling at `time` (s).

    `kind` is one of: goal, status, feedback, plan, plan_failed, control_failed, state, recovery, warning, info.
    `text` is for people; `data` is for programs and must be reproducible (no wall-clock times in it).
    """

    time: float
    kind: str
    text: str
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class Listener(Protocol):
    """Whoever wants to know: a record, a progress bar, a test.

    One with an attribute `hears_feedback` that is False is not sent the feedback of every control cycle on its account.
    """

    def on_event(self, event: Event) -> None:
        """Called once per event, in order of time."""
        ...
