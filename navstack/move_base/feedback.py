"""Feedback on the active goal, computed on request."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navstack.core import Path, Pose2D
from navstack.move_base.state_machine import Mode


@dataclass(frozen=True, slots=True)
class Feedback:
    """Where the robot stands with its goal."""

    pose: Pose2D | None
    """The robot in the global costmap's frame; None when it is not known."""
    mode: Mode
    distance_remaining: float
    """m along the plan, from the point of it nearest to the robot; straight to the goal without a plan."""
    navigation_time: float
    """s since the goal was accepted."""
    estimated_time_remaining: float | None
    """s at the mean speed so far; None while that says nothing."""
    recoveries: int


def distance_remaining(pose: Pose2D | None, path: Path | None, goal: Pose2D | None) -> float:
    """M along `path` from the point of it nearest to `pose`; straight to `goal` without one; inf when that is not known."""
    if pose is None:
        return math.inf
    if path is None:
        return pose.distance_to(goal) if goal is not None else math.inf
    points = path.poses[:, :2]
    away = np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y)
    nearest = int(np.argmin(away))
    rest = np.diff(points[nearest:], axis=0)
    return float(away[nearest] + np.hypot(rest[:, 0], rest[:, 1]).sum())
