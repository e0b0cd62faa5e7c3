"""Pictures of maps, costmaps, plans and runs. matplotlib is imported with the first picture, not with this package."""

from navstack.plot.animate import animate_run
from navstack.plot.costmap import plot_costmap
from navstack.plot.map import plot_map
from navstack.plot.plan import plot_plan
from navstack.plot.run import plot_run

__all__ = ["animate_run", "plot_costmap", "plot_map", "plot_plan", "plot_run"]
