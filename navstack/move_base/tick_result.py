"""The result of one `MoveBase.tick`, for recorders."""

from __future__ import annotations

from dataclasses import dataclass

from navstack.core import SensorData, Twist2D, Window
from navstack.interfaces import LocalPlan, Plan


@dataclass(slots=True)
class TickResult:
    """What one tick received, updated and commanded."""

    time: float
    scans: tuple[SensorData, ...] = ()
    global_window: Window | None = None
    """The updated cells of the global costmap; None without an update."""
    local_window: Window | None = None
    plan: Plan | None = None
    """The plan received from the global planner."""
    local_plan: LocalPlan | None = None
    """The result of the local planner."""
    command: Twist2D | None = None
    """The last command sent."""
