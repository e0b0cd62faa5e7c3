"""Pictures of maps, costmaps, plans and runs. matplotlib is imported with the first picture, not with this package."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.plot.benchmarks import plot_controllers as plot_controllers
    from navstack.plot.benchmarks import plot_pairs as plot_pairs
    from navstack.plot.benchmarks import plot_success as plot_success
    from navstack.plot.benchmarks import plot_times as plot_times
    from navstack.plot.canvas import FORMATS as FORMATS
    from navstack.plot.canvas import paper_style as paper_style
    from navstack.plot.commands import plot_commands as plot_commands
    from navstack.plot.commands import plot_replay as plot_replay
    from navstack.plot.commands import plot_steering as plot_steering
    from navstack.plot.coverage import plot_coverage as plot_coverage
    from navstack.plot.docking import plot_docking as plot_docking
    from navstack.plot.fan import plot_command as plot_command
    from navstack.plot.film import animate_run as animate_run
    from navstack.plot.fleet import animate_fleet as animate_fleet
    from navstack.plot.fleet import fleet_records as fleet_records
    from navstack.plot.fleet import plot_fleet as plot_fleet
    from navstack.plot.goals import plot_goal_reports as plot_goal_reports
    from navstack.plot.inflation import plot_inflation_curves as plot_inflation_curves
    from navstack.plot.lattice import plot_lattice as plot_lattice
    from navstack.plot.localization import animate_track as animate_track
    from navstack.plot.localization import plot_estimate as plot_estimate
    from navstack.plot.localization import plot_starts as plot_starts
    from navstack.plot.localization import plot_track as plot_track
    from navstack.plot.localization import plot_track_errors as plot_track_errors
    from navstack.plot.maps import plot_costmap as plot_costmap
    from navstack.plot.maps import plot_costmap_at as plot_costmap_at
    from navstack.plot.maps import plot_map as plot_map
    from navstack.plot.passages import plot_passage_report as plot_passage_report
    from navstack.plot.plan import plot_plan as plot_plan
    from navstack.plot.routes import plot_graph as plot_graph
    from navstack.plot.run import circumstances as circumstances
    from navstack.plot.run import headline as headline
    from navstack.plot.run import plot_run as plot_run
    from navstack.plot.states import plot_states as plot_states
    from navstack.plot.tracking import plot_tracking as plot_tracking
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
