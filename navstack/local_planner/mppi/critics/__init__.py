"""Critics of MPPI, one file each, with the names of Nav2. Importing this package registers them."""

from navstack.local_planner.mppi.critics.constraint import ConstraintCritic
from navstack.local_planner.mppi.critics.cost import CostCritic
from navstack.local_planner.mppi.critics.goal import GoalCritic
from navstack.local_planner.mppi.critics.goal_angle import GoalAngleCritic
from navstack.local_planner.mppi.critics.obstacles import ObstaclesCritic
from navstack.local_planner.mppi.critics.path_align import PathAlignCritic, PathAlignLegacyCritic
from navstack.local_planner.mppi.critics.path_angle import PathAngleCritic
from navstack.local_planner.mppi.critics.path_follow import PathFollowCritic
from navstack.local_planner.mppi.critics.prefer_forward import PreferForwardCritic
from navstack.local_planner.mppi.critics.twirling import TwirlingCritic
from navstack.local_planner.mppi.critics.velocity_deadband import VelocityDeadbandCritic

__all__ = [
    "ConstraintCritic",
    "CostCritic",
    "GoalAngleCritic",
    "GoalCritic",
    "ObstaclesCritic",
    "PathAlignCritic",
    "PathAlignLegacyCritic",
    "PathAngleCritic",
    "PathFollowCritic",
    "PreferForwardCritic",
    "TwirlingCritic",
    "VelocityDeadbandCritic",
]
