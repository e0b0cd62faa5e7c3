"""Says why: why a cell costs what it costs, which doors a robot passes, what inflation charges.

Everything here looks; nothing here changes a run. A record is explained by driving it once more (`replay`).
"""

from navstack.explain.cell import CellExplanation, explain_cell_at
from navstack.explain.command import CommandExplanation, explain_command
from navstack.explain.inflation import InflationCurve, inflation_curves
from navstack.explain.passages import Passage, PassageReport, find_passages
from navstack.explain.replay import Replay, replay

__all__ = [
    "CellExplanation",
    "CommandExplanation",
    "InflationCurve",
    "Passage",
    "PassageReport",
    "Replay",
    "explain_cell_at",
    "explain_command",
    "find_passages",
    "inflation_curves",
    "replay",
]
