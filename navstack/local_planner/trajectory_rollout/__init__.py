"""Trajectory rollout: TrajectoryPlannerROS of base_local_planner."""

from navstack.local_planner.trajectory_rollout.params import TrajectoryPlannerParams
from navstack.local_planner.trajectory_rollout.planner import TrajectoryPlanner

__all__ = ["TrajectoryPlanner", "TrajectoryPlannerParams"]
