"""Feedback on the active goal, computed on request."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navstack.core import Path, Pose2D
from navstack.move_base.navigation import Navigation
from navstack.move_base.states import Mode


@dataclass(frozen=True, slots=True)
class Feedback:
    """Progress of the active goal."""

    pose: Pose2D | None
    """The robot in the global costmap's frame; None if unknown."""
    mode: Mode
    distance_remaining: float
    """m along the plan, from its point nearest to the robot; the straight distance to the goal without a plan."""
    navigation_time: float
    """s since the goal was accepted."""
    estimated_time_remaining: float | None
    """s at the mean speed so far; None for a mean speed of at most 0.01 m/s."""
    recoveries: int
    """Recovery behaviors that ran for this goal."""


def feedback_of(navigation: Navigation, now: float) -> Feedback:
    """Return the feedback at `now` (s)."""
    goal, pose, mode = navigation.goal, navigation.pose, navigation.state.mode
    if goal is None:
        return Feedback(pose, mode, 0.0, 0.0, None, 0)
    plan = navigation.plan
    elapsed = goal.age(now)
    remaining = distance_remaining(pose, plan.path if plan is not None else None, goal.pose)
    speed = goal.driven_m / elapsed if elapsed > 0.0 else 0.0
    time_remaining = remaining / speed if speed > 0.01 else None
    return Feedback(pose, mode, remaining, elapsed, time_remaining, len(goal.statistics.recoveries))


def distance_remaining(pose: Pose2D | None, path: Path | None, goal: Pose2D | None) -> float:
    """Return the length (m) of `path` from its point nearest to `pose`.

    Without a path this is the straight distance to `goal`; without pose or goal it is inf.
    """
    if pose is None:
        return math.inf
    if path is None:
        return pose.distance_to(goal) if goal is not None else math.inf
    points = path.poses[:, :2]
    distances = np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y)
    nearest = int(np.argmin(distances))
    segments = np.diff(points[nearest:], axis=0)
    return float(distances[nearest] + np.hypot(segments[:, 0], segments[:, 1]).sum())
