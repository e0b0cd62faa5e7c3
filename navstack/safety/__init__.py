"""What stands between the sources of commands and the wheels: multiplexer, velocity smoother, collision monitor."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.safety.chain import NAVIGATION as NAVIGATION
    from navstack.safety.chain import CommandChain as CommandChain
    from navstack.safety.chain import CommandStep as CommandStep
    from navstack.safety.monitor import CollisionDetector as CollisionDetector
    from navstack.safety.monitor import CollisionMonitor as CollisionMonitor
    from navstack.safety.monitor import Detections as Detections
    from navstack.safety.monitor import MonitorDecision as MonitorDecision
    from navstack.safety.multiplexer import CommandMultiplexer as CommandMultiplexer
    from navstack.safety.sources import CostmapObservation as CostmapObservation
    from navstack.safety.sources import PolygonObservation as PolygonObservation
    from navstack.safety.velocity_smoother import SmoothedCommand as SmoothedCommand
    from navstack.safety.velocity_smoother import VelocitySmoother as VelocitySmoother
    from navstack.safety.zones import Shape as Shape
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
