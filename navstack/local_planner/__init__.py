"""Local planners: velocity commands from a plan, a pose and a costmap. Importing this package registers them and critics."""

from navstack.local_planner import goal_checkers, path_handlers, progress_checkers
from navstack.local_planner.dwa import DWAParams, DWAPlanner
from navstack.local_planner.graceful import GracefulController, GracefulParams
from navstack.local_planner.mppi import MPPIParams, MPPIPlanner
from navstack.local_planner.regulated_pure_pursuit import RegulatedPurePursuit, RegulatedPurePursuitParams
from navstack.local_planner.rotation_shim import RotationShim, RotationShimParams
from navstack.local_planner.trajectory_rollout import TrajectoryPlanner, TrajectoryPlannerParams

__all__ = [
    "DWAParams",
    "DWAPlanner",
    "GracefulController",
    "GracefulParams",
    "MPPIParams",
    "MPPIPlanner",
    "RegulatedPurePursuit",
    "RegulatedPurePursuitParams",
    "RotationShim",
    "RotationShimParams",
    "TrajectoryPlanner",
    "TrajectoryPlannerParams",
    "goal_checkers",
    "path_handlers",
    "progress_checkers",
]
