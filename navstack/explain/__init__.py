"""Diagnostics of runs and parameters: goals, commands, cell costs, passages, inflation, migration.

A record is diagnosed by replaying its run (`replay`); nothing here changes a run.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.explain.cell import CellReport as CellReport
    from navstack.explain.cell import explain_cell as explain_cell
    from navstack.explain.command import CommandReport as CommandReport
    from navstack.explain.command import SampleReport as SampleReport
    from navstack.explain.command import chain_sentence as chain_sentence
    from navstack.explain.command import explain_command as explain_command
    from navstack.explain.command import steering_sentence as steering_sentence
    from navstack.explain.coverage import CoverageReport as CoverageReport
    from navstack.explain.coverage import explain_coverage as explain_coverage
    from navstack.explain.crossing import ShapePassage as ShapePassage
    from navstack.explain.goal import GoalReport as GoalReport
    from navstack.explain.goal import RecoveryRun as RecoveryRun
    from navstack.explain.goal import explain_goal as explain_goal
    from navstack.explain.goal import explain_goals as explain_goals
    from navstack.explain.inflation import InflationCurve as InflationCurve
    from navstack.explain.inflation import inflation_curves as inflation_curves
    from navstack.explain.migration import MigrationPoint as MigrationPoint
    from navstack.explain.migration import MigrationReport as MigrationReport
    from navstack.explain.migration import explain_migration as explain_migration
    from navstack.explain.migration import listed as listed
    from navstack.explain.passages import Passage as Passage
    from navstack.explain.passages import PassageReport as PassageReport
    from navstack.explain.passages import Rating as Rating
    from navstack.explain.passages import find_passages as find_passages
    from navstack.explain.passages import narrow_advice as narrow_advice
    from navstack.explain.printing import print_cell as print_cell
    from navstack.explain.printing import print_command as print_command
    from navstack.explain.printing import print_goal as print_goal
    from navstack.explain.printing import print_passages as print_passages
    from navstack.explain.resimulation import Replay as Replay
    from navstack.explain.resimulation import Replayed as Replayed
    from navstack.explain.resimulation import replay as replay
    from navstack.explain.resimulation import time_in as time_in
    from navstack.explain.tracking import TrackingReport as TrackingReport
    from navstack.explain.tracking import choose_tracking as choose_tracking
    from navstack.explain.tracking import explain_tracking as explain_tracking
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
