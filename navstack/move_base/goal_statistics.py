"""Statistics of one goal: plans, commands, failures and recoveries."""

from __future__ import annotations

from typing import Any

from navstack.core import Pose2D
from navstack.core.errors import NavError


class GoalStatistics:
    """Counters of one goal, and its last failures."""

    def __init__(self) -> None:
        self.plans = 0
        """Plans found."""
        self.failed_plans = 0
        self.commands = 0
        """Commands computed."""
        self.failed_commands = 0
        self.stale_cycles = 0
        """Control cycles with a stale local costmap."""
        self.recoveries: list[str] = []
        """Names of the recovery behaviors that ran, in order."""
        self.by_name: dict[str, int] = {}
        """Number of failures by the name of the error."""
        self.last_planning: NavError | None = None
        self.last_control: NavError | None = None
        self.last: NavError | None = None
        self.last_at: float | None = None
        """Time of the last failure (s)."""
        self.pose: Pose2D | None = None
        """Last known pose of the robot, in the global costmap's frame."""

    def add_failure(self, error: NavError, now: float) -> None:
        """Count a failure at `now` (s)."""
        self.last = error
        self.last_at = now
        self.by_name[error.name] = self.by_name.get(error.name, 0) + 1

    def add_failed_plan(self, error: NavError, now: float) -> None:
        """Count a failed plan request at `now` (s)."""
        self.failed_plans += 1
        self.last_planning = error
        self.add_failure(error, now)

    def add_failed_command(self, error: NavError, now: float) -> None:
        """Count a failed command at `now` (s)."""
        self.failed_commands += 1
        self.last_control = error
        self.add_failure(error, now)

    def as_data(self) -> dict[str, Any]:
        """Return the statistics for `GoalResult.data`."""
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
