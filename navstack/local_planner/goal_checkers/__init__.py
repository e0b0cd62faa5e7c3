"""Goal checkers, one file each. Importing this package registers them."""

from navstack.local_planner.goal_checkers.adaptive import AdaptiveToleranceGoalChecker
from navstack.local_planner.goal_checkers.axis import AxisGoalChecker
from navstack.local_planner.goal_checkers.position import PositionGoalChecker
from navstack.local_planner.goal_checkers.simple import SimpleGoalChecker
from navstack.local_planner.goal_checkers.stopped import StoppedGoalChecker

__all__ = [
    "AdaptiveToleranceGoalChecker",
    "AxisGoalChecker",
    "PositionGoalChecker",
    "SimpleGoalChecker",
    "StoppedGoalChecker",
]
