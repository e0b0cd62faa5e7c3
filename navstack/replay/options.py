"""Options of a replay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from navstack.core import Pose2D


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """Options of a replay."""

    start: float | None = None
    """First time (s since the first message); None: the beginning."""
    end: float | None = None
    topics: Mapping[str, str] = field(default_factory=dict[str, str])
    """Topic of the parameters -> topic of the log."""
    goals: tuple[tuple[float, Pose2D], ...] = ()
    """Goals (time, pose in the global frame) in addition to those of the log."""
    initial_pose: Pose2D | None = None
    """Pose of the robot in the map at the start, for logs without a localization."""
    mountings: Mapping[str, tuple[str, tuple[float, ...]]] = field(
        default_factory=dict[str, tuple[str, tuple[float, ...]]]
    )
    """Frame -> parent and x, y, z, yaw, for frames that are not in the log."""
    scans: bool = True
    """Record the scans."""

    def as_dict(self) -> dict[str, Any]:
        """Return the options as JSON data."""
        return {
            "start": self.start,
            "end": self.end,
            "topics": dict(self.topics),
            "goals": [[time, *pose] for time, pose in self.goals],
            "initial_pose": None if self.initial_pose is None else list(self.initial_pose),
            "mountings": {frame: [parent, *values] for frame, (parent, values) in self.mountings.items()},
            "scans": self.scans,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ReplayOptions:
        """Restore the options. Raises KeyError, TypeError or ValueError for other data."""
        pose = data["initial_pose"]
        return cls(
            data["start"],
            data["end"],
            {str(name): str(topic) for name, topic in data["topics"].items()},
            tuple((float(goal[0]), Pose2D(*map(float, goal[1:]))) for goal in data["goals"]),
            None if pose is None else Pose2D(*map(float, pose)),
            {str(frame): (str(value[0]), tuple(map(float, value[1:]))) for frame, value in data["mountings"].items()},
            bool(data["scans"]),
        )
