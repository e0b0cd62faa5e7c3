"""Global planners, and the parts of which a planner can be composed in one file.

A planner that searches derives from `SearchPlanner` and passes it a search:

- `WaveSearch`: `WaveCosts` x `Propagation` x `Traceback`, as navfn and global_planner;
- `CellSearch`: `CellCosts` x a function that expands cells and returns a `CellPath`, as astar and theta_star;
- or its own `Search`, which turns a `Query` into a `Route`.

The frame handles start policy, goal tolerance, errors, headings and the cached plan.
"""

from navstack.global_planner._search.base import Query, Route, Search, SearchParams, SearchPlanner, Unreachable
from navstack.global_planner._search.best_first import BestFirst
from navstack.global_planner._search.cell_search import CellPath, CellPlanner, CellPlannerParams, CellSearch
from navstack.global_planner._search.cost_interpreter import (
    CellCosts,
    CostInterpreter,
    WaveCosts,
    cell_costs,
    global_planner_costs,
    navfn_costs,
    wave_costs,
)
from navstack.global_planner._search.orientation_filter import OrientationFilter, OrientationMode
from navstack.global_planner._search.propagation import NavfnPropagation, Propagation, SubcellPropagation
from navstack.global_planner._search.traceback import GradientTraceback, GridTraceback, NavfnTraceback, Traceback
from navstack.global_planner._search.wave_search import WaveSearch
from navstack.global_planner.astar import AStarParams, AStarPlanner
from navstack.global_planner.carrot import CarrotPlanner, CarrotPlannerParams
from navstack.global_planner.given_path import GivenPath, GivenPathParams
from navstack.global_planner.global_planner import GlobalPlannerParams, GlobalPlannerROS
from navstack.global_planner.navfn import NavfnParams, NavfnROS
from navstack.global_planner.smac_2d import Smac2DParams, Smac2DPlanner
from navstack.global_planner.smac_hybrid import SmacHybridParams, SmacHybridPlanner
from navstack.global_planner.smac_lattice import SmacLatticeParams, SmacLatticePlanner
from navstack.global_planner.theta_star import ThetaStarParams, ThetaStarPlanner

__all__ = [
    "AStarParams",
    "AStarPlanner",
    "BestFirst",
    "CarrotPlanner",
    "CarrotPlannerParams",
    "CellCosts",
    "CellPath",
    "CellPlanner",
    "CellPlannerParams",
    "CellSearch",
    "CostInterpreter",
    "GivenPath",
    "GivenPathParams",
    "GlobalPlannerParams",
    "GlobalPlannerROS",
    "GradientTraceback",
    "GridTraceback",
    "NavfnParams",
    "NavfnPropagation",
    "NavfnROS",
    "NavfnTraceback",
    "OrientationFilter",
    "OrientationMode",
    "Propagation",
    "Query",
    "Route",
    "Search",
    "SearchParams",
    "SearchPlanner",
    "Smac2DParams",
    "Smac2DPlanner",
    "SmacHybridParams",
    "SmacHybridPlanner",
    "SmacLatticeParams",
    "SmacLatticePlanner",
    "SubcellPropagation",
    "ThetaStarParams",
    "ThetaStarPlanner",
    "Traceback",
    "Unreachable",
    "WaveCosts",
    "WaveSearch",
    "cell_costs",
    "global_planner_costs",
    "navfn_costs",
    "wave_costs",
]
