"""Critics, one file each. Importing this package registers them."""

from navstack.local_planner.critics.alignment import AlignmentCritic
from navstack.local_planner.critics.base_obstacle import BaseObstacleCritic
from navstack.local_planner.critics.goal import GoalCritic
from navstack.local_planner.critics.goal_front import GoalFrontCritic
from navstack.local_planner.critics.obstacle import ObstacleCritic
from navstack.local_planner.critics.oscillation import OscillationCritic
from navstack.local_planner.critics.path import PathCritic
from navstack.local_planner.critics.prefer_forward import PreferForwardCritic
from navstack.local_planner.critics.rotate_to_goal import RotateToGoalCritic
from navstack.local_planner.critics.twirling import TwirlingCritic

__all__ = [
    "AlignmentCritic",
    "BaseObstacleCritic",
    "GoalCritic",
    "GoalFrontCritic",
    "ObstacleCritic",
    "OscillationCritic",
    "PathCritic",
    "PreferForwardCritic",
    "RotateToGoalCritic",
    "TwirlingCritic",
]
