"""A global planner whose plans are smoothed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from navstack.core import Costmap, Footprint, Path, Pose2D
from navstack.interfaces import GlobalPlanner, Plan, Smoother
from navstack.plugins import PluginChoice


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
        path = plan.path if plan.for_footprint else _with_headings(plan.path)
        return replace(plan, path=self.smoother.smooth(path, costmap, footprint=footprint))


def _with_headings(path: Path) -> Path:
    """Return a path with headings along it if it has none: those of navfn are 0, except for the goal's, as in ROS.

    To a smoother, a path to the west with such headings is driven backward.
    """
    poses = path.poses.copy()
    steps = np.diff(poses[:, :2], axis=0)
    if len(steps) == 0 or poses[:-1, 2].any():
        return path
    moved = np.maximum.accumulate(np.where(steps.any(axis=1), np.arange(len(steps)), 0))  # the last step of a length
    poses[:-1, 2] = np.arctan2(steps[moved, 1], steps[moved, 0])
    return Path(poses, path.frame)


def smoothed(planner: GlobalPlanner, choice: PluginChoice[Smoother] | None) -> GlobalPlanner:
    """Return a planner with the chosen smoother behind it, or the planner itself."""
    return planner if choice is None else SmoothedPlanner(planner, choice.cls(choice.params))


def unsmoothed(planner: GlobalPlanner) -> GlobalPlanner:
    """Return the planner before the smoother."""
    return planner.planner if isinstance(planner, SmoothedPlanner) else planner


def is_smoothed_by(planner: GlobalPlanner, choice: PluginChoice[Smoother] | None) -> bool:
    """Return True if the smoother behind a planner is the chosen one with the same parameters, or both are none."""
    if not isinstance(planner, SmoothedPlanner) or choice is None:
        return not isinstance(planner, SmoothedPlanner) and choice is None
    return type(planner.smoother) is choice.cls and planner.smoother.params == choice.params
