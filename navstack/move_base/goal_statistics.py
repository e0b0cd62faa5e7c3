"""What failed for one goal, how often, and where the robot stood."""

from __future__ import annotations

from typing import Any

from navstack.core import Pose2D
from navstack.core.errors import NavError


class GoalStatistics:
    """Counts per goal."""

    def __init__(self) -> None:
        self.plans = 0
        """Plans found."""
        self.failed_plans = 0
        self.commands = 0
        """Commands computed."""
        self.failed_commands = 0
        self.stale_cycles = 0
        self.recoveries: list[str] = []
        self.by_name: dict[str, int] = {}
        """Failures by the name of their error."""
        self.last_planning: NavError | None = None
        self.last_control: NavError | None = None
        self.last: NavError | None = None
        self.last_at: float | None = None
        self.pose: Pose2D | None = None
        """Where the robot was seen last, in the global costmap's frame."""

    def failed(self, error: NavError, now: float) -> None:
        """Takes down a failure at `now` (s)."""
        self.last = error
        self.last_at = now
        self.by_name[error.name] = self.by_name.get(error.name, 0) + 1

    def as_data(self) -> dict[str, Any]:
        """For `GoalResult.data`."""
        return {
            "plans": self.plans,
            "failed_plans": self.failed_plans,
            "commands": self.commands,
            "failed_commands": self.failed_commands,
            "stale_cycles": self.stale_cycles,
            "failures": dict(self.by_name),
            "last_failure": None if self.last is None else {**self.last.as_dict(), "time": self.last_at},
            "robot": None if self.pose is None else list(self.pose),
        }
