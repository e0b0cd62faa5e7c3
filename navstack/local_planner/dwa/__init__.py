"""The dynamic window approach: DWAPlannerROS of dwa_local_planner."""

from navstack.local_planner.dwa.params import DWAParams
from navstack.local_planner.dwa.planner import DWAPlanner

__all__ = ["DWAParams", "DWAPlanner"]
