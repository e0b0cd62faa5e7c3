"""Local planners: a plan, a pose and a costmap into a velocity. Importing this package registers them and their critics."""

from navstack.local_planner import critics as _critics
from navstack.local_planner.dwa import DWAParams, DWAPlanner
from navstack.local_planner.trajectory_rollout import TrajectoryPlanner, TrajectoryPlannerParams

__all__ = ["DWAParams", "DWAPlanner", "TrajectoryPlanner", "TrajectoryPlannerParams"]
del _critics
