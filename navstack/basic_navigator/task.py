"""Result and progress of a task of the simple commander."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from navstack.core import Pose2D

POLL_S: Final = 0.1
"""Time that `isTaskComplete` advances (s), as in Nav2."""
PASSED_RADIUS_M: Final = 0.7
"""Distance at which an intermediate pose counts as passed (Nav2's RemovePassedGoals)."""
NO_ERROR: Final = (0, "")


class TaskResult(Enum):
    """Result of a task, with Nav2's numbers."""

    UNKNOWN = 0
    SUCCEEDED = 1
    CANCELED = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class TaskFeedback:
    """Progress of a task."""

    current_pose: Pose2D | None
    """In the global costmap's frame; None if unknown."""
    distance_remaining: float
    """m along the plan, then straight from pose to pose; for a behavior its remaining distance or angle (m, rad)."""
    navigation_time: float
    """s since the task started."""
    estimated_time_remaining: float | None
    """s at the mean speed so far; None if that is unknown."""
    number_of_recoveries: int
    number_of_poses_remaining: int
    """Including the present one."""
    current_waypoint: int
    """Index of the present pose."""
