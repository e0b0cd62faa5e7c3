"""Parses a search space: `--param NAME=LOW:HIGH[:log]`, or a YAML file.

DWAPlannerROS:
  sim_time: [0.5, 4.0]                  # low, high
  occdist_scale: {low: 0.001, high: 1, log: true}
  use_dwa: {choices: [true, false]}
  vx_samples:                           # a range derived from the parameter's model
"*_costmap/inflation_layer/inflation_radius": [0.25, 1.0]   # sets all matches together
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from navstack.core import InputError, exists
from navstack.parameters import (
    Configuration,
    DictNode,
    ListNode,
    Location,
    Node,
    Parameter,
    ScalarNode,
    nearest,
    parameters_of,
    plain,
    read_yaml,
    scalar,
)
from navstack.plugins import ParamModel
from navstack.studies.search_space import (
    Dimension,
    SearchSpace,
    beyond_limit,
    from_metadata,
    tied,
    with_choices,
    with_range,
    without_range,
)

# --- default ranges ---------------------------------------------------------------------------------------------------
# The bounds of a parameter's model are often very wide; these ranges are the useful part. Limits of the robot (speeds and
# accelerations) are searched up to the current value: more only with a range that the user gives.


class Range(NamedTuple):
    """A range to search."""

    low: float
    high: float
    start: float
    """Recommended first value."""
    log: bool = False
    robot: bool = False
    """True for a limit of the robot: the range ends at the current value for any `high`."""
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
_DWB: Final[Mapping[str, Range | Choice]] = {
    "sim_time": Range(0.8, 3.0, 1.7),
    "vx_samples": Range(5, 30, 20),
    "vtheta_samples": Range(8, 40, 20),
    "PathDist/scale": Range(2.0, 200.0, 32.0, log=True),
    "GoalDist/scale": Range(2.0, 200.0, 24.0, log=True),
    "PathAlign/scale": Range(2.0, 200.0, 32.0, log=True),
    "GoalAlign/scale": Range(2.0, 200.0, 24.0, log=True),
    "PathAlign/forward_point_distance": Range(0.05, 0.6, 0.1),
    "GoalAlign/forward_point_distance": Range(0.05, 0.6, 0.1),
    "BaseObstacle/scale": Range(0.002, 2.0, 0.02, log=True),
    "ObstacleFootprint/scale": Range(0.002, 2.0, 0.02, log=True),
    "RotateToGoal/scale": Range(2.0, 200.0, 32.0, log=True),
    "RotateToGoal/slowing_factor": Range(1.0, 10.0, 5.0),
    "max_vel_x": Range(0.1, 0.5, 0.5, robot=True, ties=(("max_speed_xy", 1.0),)),
    "max_vel_theta": Range(0.4, 1.0, 1.0, robot=True),
    "acc_lim_x": Range(0.3, 2.5, 2.5, robot=True),
    "acc_lim_theta": Range(0.5, 3.2, 3.2, robot=True),
}
"""Critics that are not listed have no parameters and are left out."""
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
    "angular_disengage_threshold": Range(0.05, 0.4, 0.3925),
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
    "dwb": _DWB,
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
    """Return the default ranges of the planners and costmaps in use; `part` is one of `SPACES`."""
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
    """For a holonomic robot, the highest speed in all directions is independent of max_vel_x."""
    return default._replace(ties=()) if isinstance(default, Range) else default


def _limit(parameters: Mapping[str, Parameter], name: str, default: Range) -> float:
    """Return the largest value that exceeds neither the current value nor those of the parameters that are set with it."""
    path = name.rpartition("/")[0]
    tied_to = [abs(_number(parameters, f"{path}/{other}") / factor) for other, factor in default.ties]
    return min(v for v in (abs(_number(parameters, name)), *tied_to) if v > 0.0)


def _number(parameters: Mapping[str, Parameter], name: str) -> float:
    found = parameters.get(name)
    return float(found.value) if found is not None and isinstance(found.value, (int, float)) else 0.0


def _local_planner(configuration: Configuration, parameters: Mapping[str, Parameter]) -> Iterator[Dimension]:
    planner = configuration.local_planner
    holonomic = planner.name in ("dwa", "dwb") and planner.params.max_vel_y > 0.0
    for name, default in LOCAL_PLANNERS.get(planner.name, {}).items():
        full = f"{planner.namespace}/{name}"
        if full not in parameters:
            continue
        if isinstance(default, Range) and default.robot and _number(parameters, full) == 0.0:
            continue  # a limit of 0 is kept
        made = _dimension(parameters, full, _untied(default) if holonomic else default)
        yield made


def _inflation(configuration: Configuration, parameters: Mapping[str, Parameter]) -> Iterator[Dimension]:
    """The inflation of both costmaps, tied if the current values are equal."""
    namespaces = {
        name: layer.namespace
        for name, costmap in (("global", configuration.global_costmap), ("local", configuration.local_costmap))
        for layer in costmap.layers
        if layer.cls.__name__.endswith("InflationLayer")
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


# --- parameters by names and patterns ---------------------------------------------------------------------------------


class ParameterLookup:
    """The parameters of all components in use."""

    def __init__(self, configuration: Configuration) -> None:
        self._parameters = {p.name: p for p in parameters_of(configuration)}
        self._former = {
            f"{path}/{old}".lstrip("/"): f"{path}/{new}".lstrip("/")
            for path, model in _models(configuration)
            for old, new in model.RENAMED.items()
        }
        """Former full name -> current full name."""
        self._ids = configuration.nav2_ids

    def find(self, pattern: str, where: str) -> list[Parameter]:
        """Return the parameters with this full name, previous name or unique last part, or matching a pattern with * and ?.

        Raises InputError, with a suggestion, if there is none or if several share the last part; `where` starts the message.
        """
        name = "/".join(part for part in pattern.split("/") if part)
        name = self._former.get(name, name)
        if self._ids and name not in self._parameters:  # as Nav2 writes it: FollowPath.PathDist.scale
            first, slash, rest = name.removeprefix("controller_server.").replace(".", "/").partition("/")
            name = f"{self._ids.get(first, first)}{slash}{rest}"
        if name in self._parameters:
            found = [name]
        elif any(sign in name for sign in "*?["):
            found = self._matching(pattern, name, where)
        else:
            found = [self._by_last_part(pattern, name, where)]
        for one in found:
            remark = self._parameters[one].remark
            if remark:
                raise InputError(f"{where}: {one} cannot be searched: {remark}", parameter=one)
        return [self._parameters[n] for n in found]

    def _matching(self, pattern: str, name: str, where: str) -> list[str]:
        found = [p for p in self._parameters if fnmatch.fnmatchcase(p, name)]
        if not found:
            raise InputError(
                f'{where}: no parameter matches "{pattern}"; `navstack params show` lists all parameters',
                parameter=pattern,
            )
        return found

    def _by_last_part(self, pattern: str, name: str, where: str) -> str:
        found = [p for p in self._parameters if p.rpartition("/")[2] == name and "/" not in name]
        found = found or [new for old, new in self._former.items() if old.rpartition("/")[2] == name]
        if len(found) > 1:
            raise InputError(
                f'{where}: "{pattern}" is ambiguous: {", ".join(found)}; give a full name, or "*/{name}" to set all of them '
                "together",
                parameter=pattern,
                found=found,
            )
        if not found:
            raise self._unknown(pattern, name, where)
        return found[0]

    def _unknown(self, pattern: str, name: str, where: str) -> InputError:
        last = name.rpartition("/")[2]
        same = [p for p in self._parameters if p.rpartition("/")[2] == last]
        close = same[0] if same else nearest(name, self._parameters)
        if close is None:
            lasts = {p.rpartition("/")[2]: p for p in self._parameters}
            near = nearest(last, lasts)
            close = lasts[near] if near else None
        hint = f'did you mean "{close}"?' if close else "`navstack params show` lists all parameters"
        return InputError(f'{where}: no parameter in use is named "{pattern}"; {hint}', parameter=pattern, meant=close)


def _models(c: Configuration) -> Iterator[tuple[str, type[ParamModel]]]:
    """Namespace and model of every component in use."""
    yield "", type(c.move_base)
    for name, costmap in (("global_costmap", c.global_costmap), ("local_costmap", c.local_costmap)):
        yield name, type(costmap.params)
        yield from ((layer.namespace, type(layer.params)) for layer in costmap.layers)
    yield from ((p.namespace, type(p.params)) for p in (c.global_planner, c.local_planner))
    yield from ((r.namespace, type(r.params)) for r in c.recoveries)


_SYNTAX: Final = "NAME=LOW:HIGH, NAME=LOW:HIGH:log, NAME=A,B,C or NAME alone, such as DWAPlannerROS/sim_time=0.5:4.0"
_KEYS: Final = ("low", "high", "log", "choices")
_RANGE: Final = re.compile(r"[^,:]+:[^,:]+(?::[^,:]*)?\Z")


def parse_search_space(
    configuration: Configuration,
    *,
    space: str | None = None,
    params: Sequence[str] = (),
    keep: Sequence[str] = (),
    limit_factor: float = 1.0,
) -> SearchSpace:
    """Return the space given by `space`, with the dimensions of `params` added or replaced, without the parameters of `keep`.

    `space`: one of `default_ranges.SPACES`, or a YAML file; by default `auto`, or empty if `params` is given. Speeds and
    accelerations without a given range are searched up to `limit_factor` times their current values. Raises InputError.
    """
    lookup = ParameterLookup(configuration)
    found: dict[str, Dimension] = {}
    if space is None and not params:
        space = "auto"
    if space is not None:
        found = {dimension.name: dimension for dimension in _space(configuration, lookup, space)}
    for text in params:
        _replace(found, _from_text(lookup, text))
    for dimension in list(found.values()):
        if dimension.robot and limit_factor > 1.0:
            (parameter,) = lookup.find(dimension.name, "--limit-factor")
            found[dimension.name] = beyond_limit(dimension, parameter, limit_factor)
    for pattern in keep:
        for parameter in lookup.find(pattern, f'--keep "{pattern}"'):
            left = [_without(d, parameter.name) for d in found.values()]
            found = {d.name: d for d in left if d is not None}
    if not found:
        raise InputError(
            f"the search space is empty: there are no default ranges for the planners in use; add --param {_SYNTAX}"
        )
    _check_unique(list(found.values()))
    return SearchSpace(tuple(found.values()))


def _replace(found: dict[str, Dimension], dimension: Dimension) -> None:
    """Add a dimension in place of those of the same parameters."""
    for name in [n for n in found if n in dimension.names]:
        old = found.pop(name)
        if name == dimension.name and not dimension.ties:
            dimension = _with_ties(dimension, old)
    found[dimension.name] = dimension


def _without(dimension: Dimension, kept: str) -> Dimension | None:
    """Return the dimension without one of its parameters; None if nothing remains.

    Tied parameters of the same name (the inflation radius of both costmaps) remain; a parameter that only follows another one
    (`max_vel_trans` follows `max_vel_x`) is removed with it.
    """
    if kept != dimension.name:
        return replace(dimension, ties=tuple(tie for tie in dimension.ties if tie[0] != kept))
    last = kept.rpartition("/")[2]
    others = [tie for tie in dimension.ties if tie[0].rpartition("/")[2] == last]
    return replace(dimension, name=others[0][0], ties=tuple(others[1:])) if others else None


def _with_ties(dimension: Dimension, old: Dimension) -> Dimension:
    """Return a given range with the ties of the default one; the user confirms the upper end of a limit of the robot."""
    if old.kind != dimension.kind:
        return dimension
    return replace(dimension, ties=old.ties, start=dimension.high if old.robot else old.start, robot=False)


def _check_unique(dimensions: Sequence[Dimension]) -> None:
    seen: dict[str, str] = {}
    for d in dimensions:
        for name in d.names:
            if name in seen:
                raise InputError(
                    f"{name} is in two dimensions, {seen[name]} and {d.name}; remove one of them", parameter=name
                )
            seen[name] = d.name


# --- files ------------------------------------------------------------------------------------------------------------


def _space(configuration: Configuration, lookup: ParameterLookup, space: str) -> Iterator[Dimension]:
    if space in SPACES:
        yield from default_space(configuration, space)
        return
    path = Path(space)
    if not exists(path):
        close = nearest(space, SPACES)
        hint = f'; did you mean "{close}"?' if close else ""
        raise InputError(
            f'--space "{space}": there is no such file, and the default ranges are {", ".join(SPACES)}{hint}',
            space=space,
        )
    read = read_yaml(path)
    errors = [f for f in read.findings if f.severity == "error"]
    if errors:
        raise InputError(f"{errors[0].location}: {errors[0].message}", file=str(path))
    yield from _entries(lookup, read.root, "")


def _entries(lookup: ParameterLookup, node: DictNode, path: str) -> Iterator[Dimension]:
    for key, (at, value) in node.items.items():
        name = f"{path}/{key}" if path else key
        if isinstance(value, DictNode) and not (set(value.items) & set(_KEYS)):
            yield from _entries(lookup, value, name)
        else:
            yield _from_node(lookup, name, at, value)


def _from_node(lookup: ParameterLookup, name: str, at: Location, node: Node) -> Dimension:
    where = str(at)
    parameters = lookup.find(name, where)
    if isinstance(node, ScalarNode) and node.value is None:
        return tied([from_metadata(p, where) for p in parameters])
    syntax = f"write {name}: [LOW, HIGH] or {{low: .., high: .., log: true}} or {{choices: [..]}}"
    if isinstance(node, ListNode):
        low, high = _ends(node, syntax)
        return tied([with_range(p, low, high, False, f"{node.at}") for p in parameters])
    if not isinstance(node, DictNode):
        raise InputError(f"{node.at}: {name} is not a range; {syntax}", parameter=name)
    for key, (key_at, _) in node.items.items():
        if key not in _KEYS:
            raise InputError(f'{key_at}: unknown key "{key}"; a range takes {", ".join(_KEYS)}', parameter=name)
    values: dict[str, Any] = {key: plain(value) for key, (_, value) in node.items.items()}
    if "choices" in values:
        if not isinstance(values["choices"], list):
            raise InputError(f"{at}: the choices of {name} must be a list; {syntax}", parameter=name)
        return tied([with_choices(p, values["choices"], where) for p in parameters])
    log = values.get("log", False)
    if not isinstance(log, bool):
        raise InputError(f"{at}: log must be true or false; {syntax}", parameter=name)
    low, high = (_number_of_text(values.get(end), f"{at}: {end} of {name}", syntax) for end in ("low", "high"))
    return tied([with_range(p, low, high, log, where) for p in parameters])


def _ends(node: ListNode, syntax: str) -> tuple[float, float]:
    if len(node.items) != 2:
        raise InputError(f"{node.at}: a range needs two numbers, not {len(node.items)}; {syntax}")
    low, high = (_number_of_text(plain(item), f"{node.at}: an end of the range", syntax) for item in node.items)
    return low, high


def _number_of_text(value: Any, what: str, syntax: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        fault = "is missing" if value is None else f'is "{value}", not a number'
        raise InputError(f"{what} {fault}; {syntax}")
    return float(value)


# --- --param ----------------------------------------------------------------------------------------------------------


def _from_text(lookup: ParameterLookup, text: str) -> Dimension:
    where = f'--param "{text}"'
    name, equals, rest = text.partition("=")
    name, rest = name.strip(), rest.strip()
    if not name or (equals and not rest):
        raise InputError(f"{where}: give {_SYNTAX}", argument="--param", value=text)
    parameters = lookup.find(name, where)
    if not equals:
        return tied([from_metadata(p, where) for p in parameters])
    if _RANGE.match(rest):
        low_text, high_text, *scale = (part.strip() for part in rest.split(":"))
        if scale and scale[0] != "log":
            raise InputError(f'{where}: unknown scale "{scale[0]}"; write LOW:HIGH or LOW:HIGH:log', value=text)
        low, high = (
            _number_of_text(scalar(end), where + f': "{end}"', f"give {_SYNTAX}") for end in (low_text, high_text)
        )
        return tied([with_range(p, low, high, bool(scale), where) for p in parameters])
    choices: list[Any] = [scalar(part.strip()) for part in rest.split(",")]
    if None in choices:
        raise InputError(f"{where}: a value is missing; give {_SYNTAX}", argument="--param", value=text)
    return tied([with_choices(p, choices, where) for p in parameters])
