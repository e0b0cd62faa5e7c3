"""A global planner whose plans are smoothed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from navstack.core import Costmap, Footprint, Path, Pose2D
from navstack.global_planner.smoothers.base import is_good
from navstack.plugins import GlobalPlanner, Plan, Plugin, Smoother


class SmoothedPlanner(GlobalPlanner):
    """Passes the plans of a planner through a smoother."""

    def __init__(self, planner: GlobalPlanner, smoother: Smoother) -> None:
        super().__init__(planner.params)
        self.planner = planner
        self.smoother = smoother

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Plan, and smooth the path; raises what the planner raises."""
        plan = self.planner.make_plan(costmap, start, goal, footprint=footprint, keep_potential=keep_potential)
        path = smooth_path(self.smoother, plan.path, costmap, footprint, has_headings=plan.for_footprint)
        return replace(plan, path=path)


def smooth_path(
    smoother: Smoother, path: Path, costmap: Costmap, footprint: Footprint | None, *, has_headings: bool = False
) -> Path:
    """Return a smoother path. One over cells, whose headings are 0, gets headings along it before, unless it `has_headings`."""
    has_headings = has_headings or len(path) < 3 or bool(path.poses[:-1, 2].any())
    path = smoother.smooth(path if has_headings else _with_headings(path), costmap, footprint=footprint)
    if not has_headings:
        along = _with_first_heading(path, 1)
        if is_good(path.poses[:2], along.poses[:2], costmap, footprint, 0.0):
            return along
    return path


_AHEAD: Final = 5
"""Poses from the first one to that which its heading points at: a smoothed path begins about there, not along the first step."""


def _with_headings(path: Path) -> Path:
    """Return a path over cells with headings along it: those of navfn are 0, except for the goal's, as in ROS.

    To a smoother, a path to the west with such headings is driven backward.
    """
    poses = path.poses.copy()
    steps = np.diff(poses[:, :2], axis=0)
    moved = np.maximum.accumulate(np.where(steps.any(axis=1), np.arange(len(steps)), 0))  # the last step of a length
    poses[:-1, 2] = np.arctan2(steps[moved, 1], steps[moved, 0])
    return _with_first_heading(Path(poses, path.frame), min(_AHEAD, len(poses) - 2))


def _with_first_heading(path: Path, ahead: int) -> Path:
    """Return a path over cells that begins with a heading toward a pose ahead: the planner planned none."""
    poses = path.poses.copy()
    dx, dy = poses[ahead, :2] - poses[0, :2]
    if dx != 0.0 or dy != 0.0:
        poses[0, 2] = math.atan2(dy, dx)
    return Path(poses, path.frame)


def smoothed(planner: GlobalPlanner, choice: Plugin[Smoother] | None) -> GlobalPlanner:
    """Return a planner with the chosen smoother behind it, or the planner itself."""
    return planner if choice is None else SmoothedPlanner(planner, choice.cls(choice.params))


def unsmoothed(planner: GlobalPlanner) -> GlobalPlanner:
    """Return the planner before the smoother."""
    return planner.planner if isinstance(planner, SmoothedPlanner) else planner


def is_smoothed_by(planner: GlobalPlanner, choice: Plugin[Smoother] | None) -> bool:
    """Return True if the smoother behind a planner is the chosen one with the same parameters, or both are none."""
    if not isinstance(planner, SmoothedPlanner) or choice is None:
        return not isinstance(planner, SmoothedPlanner) and choice is None
    return type(planner.smoother) is choice.cls and planner.smoother.params == choice.params
