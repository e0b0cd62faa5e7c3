"""What happened to a goal and why: a timeline in words, made from the record alone."""

from navstack.explain.goal.explain import explain_goal, explain_goals
from navstack.explain.goal.report import GoalReport, RecoveryRun, StateSpan, TimelineEntry

__all__ = [
    "GoalReport",
    "RecoveryRun",
    "StateSpan",
    "TimelineEntry",
    "explain_goal",
    "explain_goals",
]
