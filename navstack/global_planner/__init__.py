"""Global planners, and the parts of which a planner can be composed in one file.

A planner that searches derives from `SearchPlanner` and passes it a search:

- `WaveSearch`: `WaveCosts` x `Propagation` x `Traceback`, as navfn and global_planner;
- `CellSearch`: `CellCosts` x a function that expands cells and returns a `CellPath`, as astar and theta_star;
- or its own `Search`, which turns a `Query` into a `Route`.

The frame handles start policy, goal tolerance, errors, headings and the cached plan.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.global_planner._curves import dubins_curve as dubins_curve
    from navstack.global_planner._curves import reeds_shepp_curve as reeds_shepp_curve
    from navstack.global_planner._lattice import Lattice as Lattice
    from navstack.global_planner._lattice import sample as sample
    from navstack.global_planner._lattice_file import read_lattice as read_lattice
    from navstack.global_planner._lattice_file import write_lattice as write_lattice
    from navstack.global_planner._lattice_generate import generate_lattice as generate_lattice
    from navstack.global_planner._search.base import Query as Query
    from navstack.global_planner._search.base import Route as Route
    from navstack.global_planner._search.base import Search as Search
    from navstack.global_planner._search.base import SearchParams as SearchParams
    from navstack.global_planner._search.base import SearchPlanner as SearchPlanner
    from navstack.global_planner._search.base import Unreachable as Unreachable
    from navstack.global_planner._search.best_first import BestFirst as BestFirst
    from navstack.global_planner._search.cell_search import CellPath as CellPath
    from navstack.global_planner._search.cell_search import CellPlanner as CellPlanner
    from navstack.global_planner._search.cell_search import CellPlannerParams as CellPlannerParams
    from navstack.global_planner._search.cell_search import CellSearch as CellSearch
    from navstack.global_planner._search.cells import CellCosts as CellCosts
    from navstack.global_planner._search.cells import CostInterpreter as CostInterpreter
    from navstack.global_planner._search.cells import WaveCosts as WaveCosts
    from navstack.global_planner._search.cells import cell_costs as cell_costs
    from navstack.global_planner._search.cells import global_planner_costs as global_planner_costs
    from navstack.global_planner._search.cells import navfn_costs as navfn_costs
    from navstack.global_planner._search.cells import wave_costs as wave_costs
    from navstack.global_planner._search.orientation_filter import OrientationFilter as OrientationFilter
    from navstack.global_planner._search.orientation_filter import OrientationMode as OrientationMode
    from navstack.global_planner._search.propagation import NavfnPropagation as NavfnPropagation
    from navstack.global_planner._search.propagation import Propagation as Propagation
    from navstack.global_planner._search.propagation import SubcellPropagation as SubcellPropagation
    from navstack.global_planner._search.traceback import GradientTraceback as GradientTraceback
    from navstack.global_planner._search.traceback import GridTraceback as GridTraceback
    from navstack.global_planner._search.traceback import NavfnTraceback as NavfnTraceback
    from navstack.global_planner._search.traceback import Traceback as Traceback
    from navstack.global_planner._search.wave_search import WaveSearch as WaveSearch
    from navstack.global_planner.astar import AStarParams as AStarParams
    from navstack.global_planner.astar import AStarPlanner as AStarPlanner
    from navstack.global_planner.carrot import CarrotPlanner as CarrotPlanner
    from navstack.global_planner.carrot import CarrotPlannerParams as CarrotPlannerParams
    from navstack.global_planner.given_path import GivenPath as GivenPath
    from navstack.global_planner.given_path import GivenPathParams as GivenPathParams
    from navstack.global_planner.global_planner import GlobalPlannerParams as GlobalPlannerParams
    from navstack.global_planner.global_planner import GlobalPlannerROS as GlobalPlannerROS
    from navstack.global_planner.navfn import Nav2NavfnParams as Nav2NavfnParams
    from navstack.global_planner.navfn import Nav2NavfnPlanner as Nav2NavfnPlanner
    from navstack.global_planner.navfn import NavfnParams as NavfnParams
    from navstack.global_planner.navfn import NavfnROS as NavfnROS
    from navstack.global_planner.smac_2d import Smac2DParams as Smac2DParams
    from navstack.global_planner.smac_2d import Smac2DPlanner as Smac2DPlanner
    from navstack.global_planner.smac_hybrid import SmacHybridParams as SmacHybridParams
    from navstack.global_planner.smac_hybrid import SmacHybridPlanner as SmacHybridPlanner
    from navstack.global_planner.smac_lattice import SmacLatticeParams as SmacLatticeParams
    from navstack.global_planner.smac_lattice import SmacLatticePlanner as SmacLatticePlanner
    from navstack.global_planner.smoothers.smoothed_planner import SmoothedPlanner as SmoothedPlanner
    from navstack.global_planner.smoothers.smoothed_planner import is_smoothed_by as is_smoothed_by
    from navstack.global_planner.smoothers.smoothed_planner import smooth_path as smooth_path
    from navstack.global_planner.smoothers.smoothed_planner import smoothed as smoothed
    from navstack.global_planner.smoothers.smoothed_planner import unsmoothed as unsmoothed
    from navstack.global_planner.theta_star import Nav2ThetaStarParams as Nav2ThetaStarParams
    from navstack.global_planner.theta_star import Nav2ThetaStarPlanner as Nav2ThetaStarPlanner
    from navstack.global_planner.theta_star import ThetaStarParams as ThetaStarParams
    from navstack.global_planner.theta_star import ThetaStarPlanner as ThetaStarPlanner
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
