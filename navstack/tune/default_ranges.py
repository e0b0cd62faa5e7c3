"""Default search ranges by plugin, and recommended first values.

The bounds of a parameter's model are often very wide; these ranges are the useful part. Limits of the robot (speeds and
accelerations) are searched up to the present value: more only with a range that the user gives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final, NamedTuple

from navstack.parameters.configuration import Configuration
from navstack.parameters.report import Parameter, parameters_of
from navstack.tune.dimensions import tied, without_range
from navstack.tune.space import Dimension, SearchSpace


class Range(NamedTuple):
    """A range to search."""

    low: float
    high: float
    start: float
    """Recommended first value."""
    log: bool = False
    robot: bool = False
    """True for a limit of the robot: the range ends at the present value for any `high`."""
    ties: tuple[tuple[str, float], ...] = ()
    """Parameters of the same namespace that are set with it: (name, factor)."""


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
_MPPI: Final[Mapping[str, Range | Choice]] = {
    "temperature": Range(0.05, 1.5, 0.3, log=True),
    "gamma": Range(0.0005, 0.05, 0.015, log=True),
    "vx_std": Range(0.05, 0.6, 0.2, log=True),
    "wz_std": Range(0.1, 1.2, 0.4, log=True),
    "vx_max": Range(0.1, 0.5, 0.5, robot=True),
    "wz_max": Range(0.4, 1.9, 1.9, robot=True),
    "ax_max": Range(0.3, 3.0, 3.0, robot=True),
    "az_max": Range(0.5, 3.5, 3.5, robot=True),
    "CostCritic/cost_weight": Range(1.0, 12.0, 3.81, log=True),
    "PathAlignCritic/cost_weight": Range(2.0, 40.0, 14.0, log=True),
    "PathFollowCritic/cost_weight": Range(1.0, 20.0, 5.0, log=True),
    "PathFollowCritic/offset_from_furthest": Range(2, 25, 6),
    "PathAngleCritic/cost_weight": Range(0.5, 8.0, 2.2, log=True),
    "GoalCritic/cost_weight": Range(1.0, 20.0, 5.0, log=True),
    "GoalAngleCritic/threshold_to_consider": Range(0.1, 0.6, 0.25),
}
"""Critics that are not listed have no parameters and are left out."""
_PURSUIT: Final[Mapping[str, Range | Choice]] = {
    "lookahead_dist": Range(0.2, 1.2, 0.6, log=True),
    "rotate_to_heading_min_angle": Range(0.3, 1.5, 0.785),
    "rotate_to_heading_angular_vel": Range(0.4, 1.8, 1.8, robot=True),
    "max_linear_vel": Range(0.1, 0.5, 0.5, robot=True),
    "regulated_linear_scaling_min_radius": Range(0.2, 1.5, 0.9),
    "regulated_linear_scaling_min_speed": Range(0.05, 0.3, 0.25),
    "cost_scaling_dist": Range(0.1, 0.8, 0.6),
    "approach_velocity_scaling_dist": Range(0.2, 1.0, 0.6),
}
_SHIM: Final[Mapping[str, Range | Choice]] = {
    "angular_dist_threshold": Range(0.4, 1.5, 0.785),
    "angular_disengage_threshold": Range(0.05, 0.39, 0.3925),
    "forward_sampling_distance": Range(0.2, 1.0, 0.5),
    "rotate_to_heading_angular_vel": Range(0.4, 1.8, 1.8, robot=True),
    **{f"primary_controller/{name}": default for name, default in _PURSUIT.items() if "rotate" not in name},
}
"""Around regulated pure pursuit; parameters that another controller does not have are left out."""
_GRACEFUL: Final[Mapping[str, Range | Choice]] = {
    "max_lookahead": Range(0.3, 1.5, 1.0, log=True),
    "k_phi": Range(0.5, 5.0, 2.0, log=True),
    "k_delta": Range(0.3, 4.0, 1.0, log=True),
    "beta": Range(0.05, 1.5, 0.4, log=True),
    "slowdown_radius": Range(0.3, 2.0, 1.5),
    "initial_rotation_tolerance": Range(0.2, 1.5, 0.75),
    "v_linear_max": Range(0.1, 0.5, 0.5, robot=True),
    "v_angular_max": Range(0.4, 1.2, 1.0, robot=True),
}
_AMCL: Final[Mapping[str, Range | Choice]] = {
    "max_particles": Range(500, 5000, 2000, log=True),
    "kld_err": Range(0.01, 0.1, 0.05, log=True),
    "update_min_d": Range(0.05, 0.4, 0.2),
    "update_min_a": Range(0.05, 0.6, 0.2),
    "resample_interval": Range(1, 3, 1),
    "laser_max_beams": Range(20, 120, 60),
    "laser_model_type": Choice(("likelihood_field", "likelihood_field_prob"), "likelihood_field"),
    "laser_z_hit": Range(0.4, 0.95, 0.5),
    "laser_z_rand": Range(0.05, 0.5, 0.5),
    "laser_sigma_hit": Range(0.05, 0.4, 0.2, log=True),
    "odom_alpha1": Range(0.005, 0.5, 0.2, log=True),
    "odom_alpha2": Range(0.005, 0.5, 0.2, log=True),
    "odom_alpha3": Range(0.005, 0.5, 0.2, log=True),
    "odom_alpha4": Range(0.005, 0.5, 0.2, log=True),
}
INFLATION: Final[Mapping[str, Range]] = {
    # `_inflation` sets the lower end just above the inscribed radius: below it, plans cross walls
    "inflation_radius": Range(0.0, 1.2, 0.5),
    "cost_scaling_factor": Range(1.0, 20.0, 5.0, log=True),
}
_GLOBAL_PLANNER: Final[Mapping[str, Range | Choice]] = {
    "cost_factor": Range(0.1, 5.0, 0.55, log=True),
    "neutral_cost": Range(10, 100, 66),
}

LOCAL_PLANNERS: Final[Mapping[str, Mapping[str, Range | Choice]]] = {
    "dwa": _DWA,
    "trajectory_rollout": _ROLLOUT,
    "mppi": _MPPI,
    "regulated_pure_pursuit": _PURSUIT,
    "rotation_shim": _SHIM,
    "graceful": _GRACEFUL,
}
"""By registered name of the plugin."""
GLOBAL_PLANNERS: Final[Mapping[str, Mapping[str, Range | Choice]]] = {"global_planner": _GLOBAL_PLANNER}

SPACES: Final = ("auto", "local_planner", "global_planner", "costmaps", "localization")
"""Names for `--space`: everything that plans and drives, or one part; localization: amcl."""


def default_space(configuration: Configuration, part: str = "auto") -> SearchSpace:
    """The default ranges of the planners and costmaps in use; `part` is one of `SPACES`."""
    parameters = {p.name: p for p in parameters_of(configuration)}
    found: list[Dimension] = []
    if part in ("auto", "local_planner"):
        found += _local_planner(configuration, parameters)
    if part in ("auto", "global_planner"):
        planner = configuration.global_planner
        for name, default in GLOBAL_PLANNERS.get(planner.name, {}).items():
            found.append(_dimension(parameters, f"{planner.namespace}/{name}", default))
    if part in ("auto", "costmaps"):
        found += _inflation(configuration, parameters)
    if part == "localization" and configuration.localization.amcl is not None:
        found += [_dimension(parameters, f"amcl/{name}", default) for name, default in _AMCL.items()]
    return SearchSpace(tuple(found))


def _dimension(parameters: Mapping[str, Parameter], name: str, default: Range | Choice) -> Dimension:
    made = without_range(parameters[name], name)
    if isinstance(default, Choice):
        return replace(made, choices=default.values, start=default.start)
    path = name.rpartition("/")[0]
    high, start = default.high, default.start
    if default.robot:
        high = start = _limit(parameters, name, default)
    low = min(default.low, high / 2.0)
    if default.low < 0.0:  # reversing is a limit of the robot, too
        low = max(low, min(0.0, _number(parameters, name)))
    return replace(
        made,
        low=low,
        high=high,
        log=default.log,
        start=min(start, high),
        robot=default.robot,
        ties=tuple((f"{path}/{other}", factor) for other, factor in default.ties),
    )


def _untied(default: Range | Choice) -> Range | Choice:
    """For a holonomic robot, max_vel_trans is independent of max_vel_x."""
    return default._replace(ties=()) if isinstance(default, Range) else default


def _limit(parameters: Mapping[str, Parameter], name: str, default: Range) -> float:
    """The largest value that exceeds neither the present value nor those of the parameters that are set with it."""
    path = name.rpartition("/")[0]
    tied_to = [abs(_number(parameters, f"{path}/{other}") / factor) for other, factor in default.ties]
    return min(v for v in (abs(_number(parameters, name)), *tied_to) if v > 0.0)


def _number(parameters: Mapping[str, Parameter], name: str) -> float:
    found = parameters.get(name)
    return float(found.value) if found is not None and isinstance(found.value, (int, float)) else 0.0


def _local_planner(configuration: Configuration, parameters: Mapping[str, Parameter]) -> Iterator[Dimension]:
    planner = configuration.local_planner
    holonomic = planner.name == "dwa" and planner.params.max_vel_y > 0.0
    for name, default in LOCAL_PLANNERS.get(planner.name, {}).items():
        full = f"{planner.namespace}/{name}"
        if full not in parameters:
            continue
        if isinstance(default, Range) and default.robot and _number(parameters, full) == 0.0:
            continue  # a limit of 0 is kept
        made = _dimension(parameters, full, _untied(default) if holonomic else default)
        yield made


def _inflation(configuration: Configuration, parameters: Mapping[str, Parameter]) -> Iterator[Dimension]:
    """The inflation of both costmaps, tied if the present values are equal."""
    namespaces = {
        name: layer.namespace
        for name, costmap in (("global", configuration.global_costmap), ("local", configuration.local_costmap))
        for layer in costmap.layers
        if layer.cls.__name__ == "InflationLayer"
    }
    radius = configuration.local_costmap.footprint.inscribed_radius
    for name, default in INFLATION.items():
        if name == "inflation_radius":
            low = float(f"{radius + 0.01:.2g}")
            default = default._replace(low=low, high=max(default.high, 3.0 * low), start=max(default.start, 1.5 * low))
        made = [_dimension(parameters, f"{namespace}/{name}", default) for namespace in namespaces.values()]
        if len({d.present for d in made}) == 1:
            yield tied(made)
        else:
            yield from made
