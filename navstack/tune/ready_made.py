"""Ranges worth searching, by plugin: what a person who tunes by hand would try, and where to begin.

What a model says of a parameter is what is allowed, often everything from 0 on; here is what makes sense. Speeds and
accelerations are the robot's: they are searched up to what the YAML has now, or up to ROS's default where that is more.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple


class Range(NamedTuple):
    """A range to search; `start` is where someone with experience would begin."""

    low: float
    high: float
    start: float
    log: bool = False
    robot: bool = False
    """A limit of the robot itself: the range ends at the present value if that is above `high`, and `high` is ROS's default."""
    ties: tuple[tuple[str, float], ...] = ()
    """Other parameters of the same namespace that go with it: name, factor."""


class Choice(NamedTuple):
    """Values to choose from; `start` is one of them."""

    values: tuple[bool | str, ...]
    start: bool | str


_DWA: Final[Mapping[str, Range | Choice]] = {
    "sim_time": Range(0.6, 4.0, 1.7),
    "path_distance_bias": Range(0.1, 100.0, 32.0, log=True),
    "goal_distance_bias": Range(0.1, 100.0, 24.0, log=True),
    "occdist_scale": Range(0.0005, 2.0, 0.02, log=True),
    "vx_samples": Range(3, 20, 8),
    "vth_samples": Range(8, 40, 20),
    "forward_point_distance": Range(0.05, 0.6, 0.325),
    "max_vel_x": Range(0.1, 0.55, 0.5, robot=True, ties=(("max_vel_trans", 1.0),)),
    "min_vel_x": Range(-0.1, 0.1, 0.0),
    "max_vel_theta": Range(0.4, 1.0, 1.0, robot=True),
    "acc_lim_x": Range(0.3, 2.5, 2.5, robot=True),
    "acc_lim_theta": Range(0.5, 3.2, 3.2, robot=True),
}
_ROLLOUT: Final[Mapping[str, Range | Choice]] = {
    "sim_time": Range(0.6, 4.0, 1.7),
    "path_distance_bias": Range(0.05, 5.0, 0.6, log=True),
    "goal_distance_bias": Range(0.05, 5.0, 0.8, log=True),
    "occdist_scale": Range(0.0005, 1.0, 0.01, log=True),
    "vx_samples": Range(3, 20, 8),
    "vtheta_samples": Range(8, 40, 20),
    "dwa": Choice((False, True), True),
    "max_vel_x": Range(0.1, 0.55, 0.5, robot=True),
    "min_vel_x": Range(0.0, 0.2, 0.1),
    "max_vel_theta": Range(0.4, 1.0, 1.0, robot=True, ties=(("min_vel_theta", -1.0),)),
    "acc_lim_x": Range(0.3, 2.5, 2.5, robot=True),
    "acc_lim_theta": Range(0.5, 3.2, 3.2, robot=True),
}
_INFLATION: Final[Mapping[str, Range | Choice]] = {
    # from the inscribed radius on, which the search adds: below it, plans lead through walls
    "inflation_radius": Range(0.0, 1.2, 0.5),
    "cost_scaling_factor": Range(1.0, 20.0, 5.0, log=True),
}
_GLOBAL_PLANNER: Final[Mapping[str, Range | Choice]] = {
    "cost_factor": Range(0.1, 5.0, 0.55, log=True),
    "neutral_cost": Range(10, 100, 66),
}

LOCAL_PLANNERS: Final[Mapping[str, Mapping[str, Range | Choice]]] = {"dwa": _DWA, "trajectory_rollout": _ROLLOUT}
"""By registered name."""
GLOBAL_PLANNERS: Final[Mapping[str, Mapping[str, Range | Choice]]] = {"global_planner": _GLOBAL_PLANNER}
LAYERS: Final[Mapping[str, Mapping[str, Range | Choice]]] = {"inflation": _INFLATION}

SPACES: Final = ("auto", "local_planner", "global_planner", "costmaps")
"""Names that `--space` takes: everything, or one part."""
