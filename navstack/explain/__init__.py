"""Says why: what became of a goal, why a cell costs what it costs, which doors a robot passes, what inflation charges.

Everything here looks; nothing here changes a run. A record is explained by driving it once more (`replay`).
"""

from navstack.explain.cell import CellExplanation, explain_cell_at
from navstack.explain.command import CommandExplanation, explain_command
from navstack.explain.goal import GoalAccount, explain_goal, explain_goals
from navstack.explain.inflation import InflationCurve, inflation_curves
from navstack.explain.passages import Passage, PassageReport, find_passages
from navstack.explain.replay import Replay, replay

__all__ = [
    "CellExplanation",
    "CommandExplanation",
    "GoalAccount",
    "InflationCurve",
    "Passage",
    "PassageReport",
    "Replay",
    "explain_cell_at",
    "explain_command",
    "explain_goal",
    "explain_goals",
    "find_passages",
    "inflation_curves",
    "replay",
]
