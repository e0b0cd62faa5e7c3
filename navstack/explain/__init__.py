"""Diagnostics of runs and parameters: goals, commands, cell costs, passages, inflation.

A record is diagnosed by replaying its run (`replay`); nothing here changes a run.
"""

from navstack.explain.cell import CellReport, explain_cell
from navstack.explain.command import CommandReport, explain_command
from navstack.explain.goal import GoalReport, explain_goal, explain_goals
from navstack.explain.inflation import InflationCurve, inflation_curves
from navstack.explain.passages import Passage, PassageReport, find_passages
from navstack.explain.replay import Replay, Replayed, replay
from navstack.explain.tracking import TrackingReport, explain_tracking

__all__ = [
    "CellReport",
    "CommandReport",
    "GoalReport",
    "InflationCurve",
    "Passage",
    "PassageReport",
    "Replay",
    "Replayed",
    "TrackingReport",
    "explain_cell",
    "explain_command",
    "explain_goal",
    "explain_goals",
    "explain_tracking",
    "find_passages",
    "inflation_curves",
    "replay",
]
