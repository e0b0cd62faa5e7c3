"""Abstract base classes of all kinds of plugins, and the values that they exchange.

Parameters are passed to the constructor, data as arguments, failures as exceptions (`navstack.core.errors`).
"""

from navstack.interfaces.cell_explanation import CellExplanation, CellProvenance, LayerShare
from navstack.interfaces.costmap import CostmapServer, Layer, LayerContext
from navstack.interfaces.global_planner import GlobalPlanner, Plan
from navstack.interfaces.local_planner import (
    ControlInput,
    Critic,
    LocalPlan,
    LocalPlanner,
    Rollouts,
    ScoringContext,
    VelocityLimits,
)
from navstack.interfaces.recovery import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.interfaces.robot import Robot

__all__ = [
    "CellExplanation",
    "CellProvenance",
    "ControlInput",
    "CostmapServer",
    "Critic",
    "GlobalPlanner",
    "Layer",
    "LayerContext",
    "LayerShare",
    "LocalPlan",
    "LocalPlanner",
    "Plan",
    "RecoveryBehavior",
    "RecoveryContext",
    "RecoveryStatus",
    "RecoveryStep",
    "Robot",
    "Rollouts",
    "ScoringContext",
    "VelocityLimits",
]
