"""Abstract base classes of everything that can be plugged in, and the values they exchange.

Parameters come by constructor, data by argument, failures by exception (`navstack.core.errors`).
"""

from navstack.interfaces.costmap import CostmapServer, Layer, LayerContext, LayerSays
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
    "ControlInput",
    "CostmapServer",
    "Critic",
    "GlobalPlanner",
    "Layer",
    "LayerContext",
    "LayerSays",
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
