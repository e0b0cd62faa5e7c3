"""Floor 2: global planners. Importing the room registers them."""

from navstack.global_planner.carrot import CarrotPlanner, CarrotPlannerParams
from navstack.global_planner.global_planner import GlobalPlannerParams, GlobalPlannerROS
from navstack.global_planner.navfn import NavfnParams, NavfnROS

__all__ = [
    "CarrotPlanner",
    "CarrotPlannerParams",
    "GlobalPlannerParams",
    "GlobalPlannerROS",
    "NavfnParams",
    "NavfnROS",
]
