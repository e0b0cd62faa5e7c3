"""Pictures of maps, costmaps, plans and runs. matplotlib is imported with the first picture, not with this package."""

from navstack.plot.animate import animate_run
from navstack.plot.commands import plot_commands
from navstack.plot.costmap import plot_costmap
from navstack.plot.estimates import plot_estimate
from navstack.plot.map import plot_map
from navstack.plot.plan import plot_plan
from navstack.plot.recorded_costmap import plot_costmap_at
from navstack.plot.reports import plot_command, plot_goal_reports, plot_inflation_curves, plot_passage_report
from navstack.plot.run import plot_run
from navstack.plot.states import plot_states
from navstack.plot.steering import plot_steering

__all__ = [
    "animate_run",
    "plot_command",
    "plot_commands",
    "plot_costmap",
    "plot_costmap_at",
    "plot_estimate",
    "plot_goal_reports",
    "plot_inflation_curves",
    "plot_map",
    "plot_passage_report",
    "plot_plan",
    "plot_run",
    "plot_states",
    "plot_steering",
]
