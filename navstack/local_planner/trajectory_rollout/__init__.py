"""Trajectory rollout: TrajectoryPlannerROS of base_local_planner."""

from navstack.local_planner.trajectory_rollout.planner import TrajectoryPlanner, TrajectoryPlannerParams

__all__ = ["TrajectoryPlanner", "TrajectoryPlannerParams"]
