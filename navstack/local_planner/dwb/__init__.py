"""DWB, the local planner of Nav2 until its release Iron: dwb_core::DWBLocalPlanner."""

from navstack.local_planner.dwb import critics, map_grid
from navstack.local_planner.dwb.planner import DWBParams, DWBPlanner

__all__ = ["DWBParams", "DWBPlanner", "critics", "map_grid"]
