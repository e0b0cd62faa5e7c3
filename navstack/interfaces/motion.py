"""Motions: what a robot drives without a global plan."""

from __future__ import annotations

from typing import Any

from navstack.core import Path, Pose2D
from navstack.interfaces.local_planner import LocalPlan
from navstack.interfaces.recovery import RecoveryBehavior


class Motion(RecoveryBehavior):
    """A motion runs step by step as a recovery behavior does, and can describe what it follows.

    `start` and `step` are those of `RecoveryBehavior`; the attributes below are valid after the first step.
    """

    frame: str = ""
    """Frame of `target` and `reference`."""
    target: Pose2D | None = None
    """Pose at which the motion ends (m, rad); None if it does not move."""
    reference: Path | None = None
    """The path that the robot should drive."""
    local_plan: LocalPlan | None = None
    """The last command, with its reasons in sentences; its trajectory has the poses that were checked for collisions."""

    def describe(self) -> dict[str, Any]:
        """Return what to do, as JSON data for the record."""
        return {}
