"""Abstract base classes of all kinds of plugins, and the values that they exchange.

Parameters are passed to the constructor, data as arguments, failures as exceptions (`navstack.core.errors`).
"""

from navstack.interfaces.cell_explanation import CellExplanation, CellProvenance, LayerShare
from navstack.interfaces.costmap import CostmapServer, Inflation, Layer, LayerContext
from navstack.interfaces.critic import Critic, DistanceGrid, RejectionDetail, ScoringContext
from navstack.interfaces.global_planner import GlobalPlanner, Plan
from navstack.interfaces.local_planner import ControlDiagnostics, ControlInput, LocalPlan, LocalPlanner
from navstack.interfaces.localization import LocalizationStatus, Localizer, OdometryFilter, PoseEstimate
from navstack.interfaces.motion import Motion
from navstack.interfaces.path_following import (
    Approach,
    GoalChecker,
    LocalPath,
    PathHandler,
    PluginSection,
    ProgressChecker,
)
from navstack.interfaces.recovery import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.interfaces.robot import Robot
from navstack.interfaces.rollouts import RolloutCells, Rollouts, TrajectoryGenerator, VelocityLimits
from navstack.interfaces.smoother import Smoother

__all__ = [
    "Approach",
    "CellExplanation",
    "CellProvenance",
    "ControlDiagnostics",
    "ControlInput",
    "CostmapServer",
    "Critic",
    "DistanceGrid",
    "GlobalPlanner",
    "GoalChecker",
    "Inflation",
    "Layer",
    "LayerContext",
    "LayerShare",
    "LocalPath",
    "LocalPlan",
    "LocalPlanner",
    "LocalizationStatus",
    "Localizer",
    "Motion",
    "OdometryFilter",
    "PathHandler",
    "Plan",
    "PluginSection",
    "PoseEstimate",
    "ProgressChecker",
    "RecoveryBehavior",
    "RecoveryContext",
    "RecoveryStatus",
    "RecoveryStep",
    "RejectionDetail",
    "Robot",
    "RolloutCells",
    "Rollouts",
    "ScoringContext",
    "Smoother",
    "TrajectoryGenerator",
    "VelocityLimits",
]
