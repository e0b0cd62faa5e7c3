"""The warnings of a run, for its summary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from navstack.core import Event


@dataclass(frozen=True, slots=True)
class RunWarning:
    """A warning about sensors, transforms or odometry, which may have been repeated during the run."""

    text: str
    time: float
    """Time of the first occurrence (s)."""
    count: int
    """Number of occurrences."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {"text": self.text, "time": self.time, "count": self.count}


class WarningCollector:
    """Listens for the warnings that an error caused. Repetitions by the same sensor share an entry with the first text."""

    hears_feedback = False

    def __init__(self) -> None:
        self._found: dict[tuple[object, ...], RunWarning] = {}

    def on_event(self, event: Event) -> None:
        """Keep a warning."""
        data = event.data
        if event.kind != "warning" or "code" not in data:
            return
        costmap = event.text.partition(":")[0]
        key = (costmap, data["topic"], data.get("source")) if "topic" in data else (event.text,)
        first = self._found.get(key)
        if first is None:
            self._found[key] = RunWarning(event.text, event.time, 1)
        else:
            self._found[key] = RunWarning(first.text, first.time, first.count + 1)

    def warnings(self) -> tuple[RunWarning, ...]:
        """Return the warnings in the order of their first occurrence."""
        return tuple(self._found.values())
