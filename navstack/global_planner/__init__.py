"""Floor 2: global planners. Importing the room registers them."""

from navstack.global_planner.astar import AStarParams, AStarPlanner
from navstack.global_planner.carrot import CarrotPlanner, CarrotPlannerParams
from navstack.global_planner.global_planner import GlobalPlannerParams, GlobalPlannerROS
from navstack.global_planner.navfn import NavfnParams, NavfnROS
from navstack.global_planner.theta_star import ThetaStarParams, ThetaStarPlanner

__all__ = [
    "AStarParams",
    "AStarPlanner",
    "CarrotPlanner",
    "CarrotPlannerParams",
    "GlobalPlannerParams",
    "GlobalPlannerROS",
    "NavfnParams",
    "NavfnROS",
    "ThetaStarParams",
    "ThetaStarPlanner",
]
