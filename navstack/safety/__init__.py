"""What stands between the sources of commands and the wheels: multiplexer, velocity smoother, collision monitor."""

from __future__ import annotations

from navstack.safety.chain import CommandChain, CommandStep
from navstack.safety.detector import CollisionDetector, Detections
from navstack.safety.monitor import CollisionMonitor, MonitorDecision
from navstack.safety.multiplexer import CommandMultiplexer
from navstack.safety.sources import CostmapObservation, PolygonObservation
from navstack.safety.velocity_smoother import SmoothedCommand, VelocitySmoother
from navstack.safety.zones import Shape

__all__ = [
    "CollisionDetector",
    "CollisionMonitor",
    "CommandChain",
    "CommandMultiplexer",
    "CommandStep",
    "CostmapObservation",
    "Detections",
    "MonitorDecision",
    "PolygonObservation",
    "Shape",
    "SmoothedCommand",
    "VelocitySmoother",
]
