"""A diagnosis of a robot: what `navstack check` and the passages of a map say, three drives, and what each fix changes in them.

A possible cause comes with the parameters that would remove it. Each is measured: the same drives with these parameters.
The best fix is kept, and the others that helped are measured on top of it, until none helps further.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from navstack.core import Footprint, InputError, OccupancyGrid, ParameterError, Pose2D
from navstack.costmap import InflationLayer
from navstack.explain import PassageReport, find_passages
from navstack.parameters import Configuration, CostmapConfiguration, load_configuration, parameters_of, value_text
from navstack.plugins import Layer, Plugin
from navstack.scenario import Places, Run, RunResult, Scenario, run_scenario
from navstack.studies.jobs import Job, JobResult, SerialExecutor
from navstack.studies.planners import costmap_of, reachable_pairs
from navstack.studies.task import run_jobs

DRIVES: Final = 3
LEAST_LIMIT_S: Final = 60.0
LIMIT_FACTOR: Final = 6.0
"""A drive may take this many times the time along the straight line at full speed, but at least LEAST_LIMIT_S more."""
SHORTER: Final = 0.9
"""A fix helps if more goals are reached, if the drives take at most this share of the time, or .."""
LEAST_IDLE_S: Final = 10.0
""".. if they turn in place or stand for half the time, for at least this much less (s), and take .."""
LONGER: Final = 1.1
""".. at most this many times as long."""
SHORT_WINDOW_M: Final = 1.0
"""A plan that DWB sees this far ahead hardly leads around the end of a wall."""
MOST_FIXES: Final = 3
PAIRS_TRIED: Final = 60
SHORTEST_M: Final = 3.0
"""Random drives on maps without places are at least this long, if the map has such."""


@dataclass(frozen=True, slots=True)
class Cause:
    """A possible cause of bad drives."""

    name: str
    text: str
    """What is wrong, with the value."""
    settings: Mapping[str, Any]
    """Full names of parameters -> values that remove it."""

    @property
    def fix(self) -> str:
        """The settings in one line."""
        return ", ".join(f"{name}: {value_text(value)}" for name, value in self.settings.items())

    @property
    def overrides(self) -> tuple[str, ...]:
        """The settings as `--set` takes them."""
        return tuple(f"{name}={value_text(value)}" for name, value in self.settings.items())


@dataclass(frozen=True, slots=True)
class Drives:
    """What the same drives gave with some parameters."""

    rows: tuple[Mapping[str, Any], ...]
    """One drive each: state, time_s, length_m, turning_s, standing_s, collisions, reason."""
    limits: tuple[float, ...]

    @property
    def reached(self) -> int:
        """Number of drives that reached their goal."""
        return sum(bool(row["reached"]) for row in self.rows)

    @property
    def contacts(self) -> int:
        """Number of collisions."""
        return sum(int(row["collisions"]) for row in self.rows)

    @property
    def time_s(self) -> float:
        """Simulated time of all drives (s); a drive that failed counts with its time limit."""
        return math.fsum(
            row["time_s"] if row["reached"] else limit for row, limit in zip(self.rows, self.limits, strict=True)
        )

    @property
    def idle_s(self) -> float:
        """Time turning in place or standing (s)."""
        return math.fsum(row["turning_s"] + row["standing_s"] for row in self.rows)

    @property
    def order(self) -> tuple[float, ...]:
        """Less is better: contacts, missed goals, time in tens of seconds, time in place."""
        return (self.contacts, -self.reached, round(self.time_s / 10.0), self.idle_s)

    def better_than(self, other: Drives) -> bool:
        """Return True if these drives are clearly better: fewer contacts, more goals, less time or less of it in place."""
        if self.contacts != other.contacts or self.reached != other.reached:
            return self.order < other.order and self.reached >= other.reached and self.contacts <= other.contacts
        if self.time_s <= SHORTER * other.time_s:
            return True
        return (
            self.idle_s <= min(0.5 * other.idle_s, other.idle_s - LEAST_IDLE_S) and self.time_s <= LONGER * other.time_s
        )

    def effect(self, before: Drives) -> str:
        """Return the change in words."""
        count = len(self.rows)
        parts = [f"{before.reached} of {count} -> {self.reached} of {count} goals"]
        parts.append(f"{before.time_s:.0f} s -> {self.time_s:.0f} s")
        parts.append(f"turning in place or standing {before.idle_s:.0f} s -> {self.idle_s:.0f} s")
        if before.contacts or self.contacts:
            parts.append(f"contacts {before.contacts} -> {self.contacts}")
        return ", ".join(parts)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            "reached": self.reached,
            "contacts": self.contacts,
            "time_s": round(self.time_s, 3),
            "idle_s": round(self.idle_s, 3),
            "drives": [dict(row) for row in self.rows],
        }


@dataclass(frozen=True, slots=True)
class Tried:
    """A possible cause whose fix was measured."""

    cause: Cause
    before: Drives
    after: Drives

    @property
    def helps(self) -> bool:
        """True if the drives are clearly better with the fix."""
        return self.after.better_than(self.before)

    @property
    def effect(self) -> str:
        """The measured effect in words."""
        return self.after.effect(self.before)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            "cause": self.cause.name,
            "text": self.cause.text,
            "settings": dict(self.cause.settings),
            "helps": self.helps,
            "effect": self.effect,
            "before": self.before.as_dict(),
            "after": self.after.as_dict(),
        }


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The result."""

    drives: Drives
    """Without a fix."""
    passages: PassageReport
    ranked: tuple[Tried, ...]
    """Each possible cause alone, the most effective one first."""
    chosen: tuple[Tried, ...]
    """The fixes to make, each measured on top of those before it."""

    @property
    def settings(self) -> dict[str, Any]:
        """Full names -> values of all fixes to make."""
        return {name: value for tried in self.chosen for name, value in tried.cause.settings.items()}

    @property
    def after(self) -> Drives:
        """The drives with all fixes."""
        return self.chosen[-1].after if self.chosen else self.drives

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            "drives": self.drives.as_dict(),
            "passages": {rating: self.passages.count(rating) for rating in ("free", "costly", "blocked")},
            "ranked": [tried.as_dict() for tried in self.ranked],
            "chosen": [tried.as_dict() for tried in self.chosen],
            "settings": self.settings,
            "after": self.after.as_dict(),
        }


# --- possible causes --------------------------------------------------------------------------------------------------


def possible_causes(configuration: Configuration, passages: PassageReport) -> list[Cause]:
    """Return what may slow, stop or turn this robot, from its parameters and the passages of the map."""
    return [
        *_misspelt(configuration),
        *_scoring(configuration),
        *_inflation(configuration, passages),
        *_planner_values(configuration),
    ]


def _misspelt(configuration: Configuration) -> Iterator[Cause]:
    """Yield the keys without effect of which only one other can be meant, as one cause."""
    given = configuration.tree.as_dict()
    settings: dict[str, Any] = {}
    names: list[str] = []
    for found in configuration.findings:
        value = _value_at(given, found.key)
        if found.rule == "unknown" and found.replacement and isinstance(value, bool | int | float | str):
            parent = found.key.rpartition("/")[0]
            settings[f"{parent}/{found.replacement}".lstrip("/")] = value
            names.append(found.key)
    if names:
        verb = "is not a parameter and has" if len(names) == 1 else "are not parameters and have"
        yield Cause("misspelt", f"{', '.join(names)} {verb} no effect", settings)


def _value_at(tree: Mapping[str, Any], name: str) -> Any:
    at: Any = tree
    for part in name.split("/"):
        at = at.get(part) if isinstance(at, Mapping) else None
    return at


def _scoring(configuration: Configuration) -> Iterator[Cause]:
    """Yield the other scale of the weights, and lighter obstacles where `navstack check` finds them too heavy."""
    planner = configuration.local_planner
    if planner.name == "dwa" or getattr(planner.params, "meter_scoring", False):
        distro = configuration.navstack.ros_distro
        other = "noetic" if distro == "indigo" else "indigo"
        meant = "before 2018 (weights per cell)" if other == "indigo" else "after 2018 (weights per meter)"
        text = f"the weights of {planner.namespace} may be meant for the scoring of releases {meant}: ros_distro is {distro}"
        yield Cause("scoring-scale", text, {"navstack/ros_distro": other})
    ahead = getattr(planner.params, "forward_prune_distance", 0.0)
    if getattr(planner.params, "until_kilted", False) and not 0.0 <= ahead <= SHORT_WINDOW_M:
        name = f"{planner.namespace}/forward_prune_distance"
        text = (
            f"{name} = {ahead:g} m: the plan in the local window may end behind a wall, and GoalDist and GoalAlign measure "
            "through obstacles, so that the robot waits before it"
        )
        yield Cause("pulled-through-walls", text, {name: SHORT_WINDOW_M})
    heavy = next((f for f in configuration.findings if f.rule == "scoring-scale"), None)
    if heavy is not None and heavy.suggestion is not None:
        yield Cause("heavy-obstacles", heavy.message, {f"{planner.namespace}/occdist_scale": float(heavy.suggestion)})


def _inflation(configuration: Configuration, passages: PassageReport) -> Iterator[Cause]:
    """Yield inflation that does not cover the robot, and inflation that makes passages costly which the robot fits."""
    footprint = configuration.global_costmap.footprint
    layers = [
        found
        for costmap in (configuration.global_costmap, configuration.local_costmap)
        if (found := _inflation_of(costmap)) is not None
    ]
    if not layers:
        return
    least = min(float(layer.params.inflation_radius) for layer in layers)
    around = round(footprint.circumscribed_radius + 0.05, 2)
    if least < around:
        text = f"inflation_radius = {least:g} m does not cover the robot (circumscribed radius {around - 0.05:.2f} m)"
        yield Cause("thin-inflation", text, {f"{layer.namespace}/inflation_radius": around for layer in layers})
    steep = next((f for f in configuration.findings if f.rule == "steep-inflation"), None)
    if steep is not None and steep.suggestion is not None:
        settings = {f"{layer.namespace}/cost_scaling_factor": float(steep.suggestion) for layer in layers}
        yield Cause("steep-inflation", steep.message, settings)
    tight = [p for p in passages.passages if p.fits and p.rating != "free"]
    if tight:
        steep = {
            f"{layer.namespace}/cost_scaling_factor": 3.0 * float(layer.params.cost_scaling_factor) for layer in layers
        }
        count = "1 passage" if len(tight) == 1 else f"{len(tight)} passages"
        text = f"inflation makes {count} costly that the robot fits"
        yield Cause("flat-inflation", text, steep)
        narrow = _narrow_radius(footprint, passages)
        if narrow < least:
            settings = {f"{layer.namespace}/inflation_radius": narrow for layer in layers}
            yield Cause("wide-inflation", f"{text}: inflation_radius = {least:g} m", settings)


def _inflation_of(costmap: CostmapConfiguration) -> Plugin[Layer] | None:
    return next((x for x in costmap.layers if issubclass(x.cls, InflationLayer) and x.params.enabled), None)


def _narrow_radius(footprint: Footprint, passages: PassageReport) -> float:
    return round(footprint.inscribed_radius + 2.0 * passages.costmap.geometry.resolution, 3)


@dataclass(frozen=True, slots=True)
class _Suspect:
    """A value of the local planner or of move_base that is often the cause."""

    parameter: str
    wrong: Callable[[Any], bool]
    better: Any
    why: str
    of_planner: bool = True


_SUSPECTS: Final = (
    _Suspect("sim_time", lambda v: v < 1.5, 2.0, "trajectories are too short to see the way around a corner"),
    _Suspect(
        "sim_time", lambda v: v > 2.5, 1.7, "trajectories are so long that few of them are free where it is narrow"
    ),
    _Suspect("vx_samples", lambda v: v < 6, 10, "few speeds are tried"),
    _Suspect("vth_samples", lambda v: v < 15, 20, "few turn rates are tried"),
    _Suspect("vtheta_samples", lambda v: v < 15, 20, "few turn rates are tried"),
    _Suspect("yaw_goal_tolerance", lambda v: v < 0.2, 0.3, "the robot turns about the goal's heading"),
    _Suspect("xy_goal_tolerance", lambda v: v < 0.15, 0.25, "the robot circles around the goal"),
    _Suspect("latch_xy_goal_tolerance", lambda v: v is False, True, "a turn at the goal may leave the tolerance again"),
    _Suspect("controller_frequency", lambda v: v < 8.0, 10.0, "commands are rare", of_planner=False),
    _Suspect("planner_frequency", lambda v: v <= 0.0, 1.0, "the path is planned once", of_planner=False),
)


def _planner_values(configuration: Configuration) -> Iterator[Cause]:
    known = {p.name: p.value for p in parameters_of(configuration)}
    named = {
        "coarse-speeds": f"{configuration.local_planner.namespace}/vx_samples",
        "heavy-path": f"{configuration.local_planner.namespace}/path_distance_bias",
        "standing-sample": f"{configuration.local_planner.namespace}/min_vel_x",
        "slow-turn": "oscillation_timeout",
    }
    for found in configuration.findings:
        if found.rule in named and found.suggestion is not None:
            yield Cause(found.rule, found.message, {named[found.rule]: float(found.suggestion)})
    for suspect in _SUSPECTS:
        prefix = f"{configuration.local_planner.namespace}/" if suspect.of_planner else ""
        name = prefix + suspect.parameter
        value = known.get(name)
        if isinstance(value, bool | int | float) and suspect.wrong(value):
            yield Cause(suspect.parameter, f"{name} = {value_text(value)}: {suspect.why}", {name: suspect.better})


# --- drives -----------------------------------------------------------------------------------------------------------


def make_drives(
    grid: OccupancyGrid, configuration: Configuration, places: Places | None, *, seed: int = 0
) -> list[Scenario]:
    """Return up to DRIVES drives of one goal each, from place to place or, without places, between random poses.

    The robot stands free at both ends. Raises InputError if the map has no room for it.
    """
    stations = [] if places is None else [places.start, *places.goals]
    ends = [pair for pair in pairwise(stations) if all(_has_room(grid, configuration, pose) for pose in pair)]
    if len(ends) < DRIVES:
        found = reachable_pairs(costmap_of(configuration, grid), PAIRS_TRIED, seed)
        found.sort(key=lambda pair: pair[0].distance_to(pair[1]) < SHORTEST_M)
        ends += [pair for pair in found if all(_has_room(grid, configuration, pose) for pose in pair)]
    if not ends:
        raise InputError("the map has no two free poses that this robot can drive between; give another map")
    speed = max(0.05, float(getattr(configuration.local_planner.params, "max_vel_x", 0.5)))
    return [
        Scenario(
            map=grid,
            configuration=configuration,
            start=start,
            goals=(goal,),
            seed=seed,
            time_limit_s=round(LEAST_LIMIT_S + LIMIT_FACTOR * start.distance_to(goal) / speed, 1),
            stop_on_failure=True,
        )
        for start, goal in ends[:DRIVES]
    ]


def _has_room(grid: OccupancyGrid, configuration: Configuration, pose: Pose2D) -> bool:
    scenario = Scenario(map=grid, configuration=configuration, start=pose, goals=())
    world = scenario.world()
    if not world.contains(pose):
        return False
    footprint = configuration.global_costmap.true_footprint
    return bool((world.clearances(np.array([pose]), footprint, world.solids_at(0.0)) > 0.0).all())


def drive(scenario: Scenario) -> dict[str, Any]:
    """Return the figures of one drive: a job."""
    return _figures(run_scenario(scenario, record=False))


def _figures(result: RunResult) -> dict[str, Any]:
    goal, metrics = result.goals[0], result.metrics
    return {
        "reached": goal.succeeded,
        "state": goal.state,
        "time_s": round(goal.time_s, 3),
        "length_m": round(goal.path_length_m, 3),
        "turning_s": round(metrics.turning_s, 3),
        "standing_s": round(metrics.standing_s, 3),
        "collisions": result.collisions,
        "reason": "" if goal.succeeded else f"{goal.error_name} ({goal.error_code}): {goal.message}",
    }


def _row(result: JobResult) -> dict[str, Any]:
    """Return the figures of a finished job; a drive that could not start has failed."""
    if result.error is None:
        return result.value
    nothing = {"time_s": 0.0, "length_m": 0.0, "turning_s": 0.0, "standing_s": 0.0, "collisions": 0}
    return {"reached": False, "state": "refused", **nothing, "reason": str(result.error.get("message", ""))}


# --- the diagnosis ----------------------------------------------------------------------------------------------------


def diagnose(
    configuration: Configuration,
    grid: OccupancyGrid,
    drives: Sequence[Scenario],
    *,
    processes: int | None = None,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> Diagnosis:
    """Search for the cause of bad drives, in parallel processes; `progress(what, done, total)` follows it."""
    passages = find_passages(configuration, grid)
    causes = possible_causes(configuration, passages)
    limits = tuple(scenario.time_limit_s for scenario in drives)

    def measure(what: str, candidates: Sequence[tuple[Cause, ...]]) -> list[Drives]:
        """Drive all scenarios with each combination of fixes."""
        jobs: list[Job] = []
        for number, combined in enumerate(candidates):
            changed = with_settings(configuration, combined)
            jobs += [Job(f"{what} {number} {k}", replace(s, configuration=changed)) for k, s in enumerate(drives)]
        done = 0

        def count(result: JobResult) -> None:
            nonlocal done
            done += 1
            progress(what, done, len(jobs))

        executor = SerialExecutor(drive) if processes == 1 else None
        results = run_jobs(drive, jobs, processes=processes, executor=executor, on_result=count)
        rows = [_row(result) for result in results]
        return [Drives(tuple(rows[i : i + len(drives)]), limits) for i in range(0, len(rows), len(drives))]

    (base,) = measure("drives", [()])
    usable = [cause for cause in causes if _is_valid(configuration, cause)]
    alone = [Tried(c, base, after) for c, after in zip(usable, measure("fixes", [(c,) for c in usable]), strict=True)]
    ranked = tuple(sorted(alone, key=lambda tried: tried.after.order))
    chosen = [tried for tried in ranked if tried.helps][:1]
    # of two causes, the fix of the second may help on top of that of the first only
    failing = bool(chosen) and chosen[0].after.reached < len(drives)
    left = [tried.cause for tried in ranked if tried not in chosen and (tried.helps or failing)]
    while chosen and left and len(chosen) < MOST_FIXES:
        before = chosen[-1].after
        kept = tuple(tried.cause for tried in chosen)
        more = [
            Tried(cause, before, after)
            for cause, after in zip(left, measure("further fixes", [(*kept, c) for c in left]), strict=True)
        ]
        best = min(more, key=lambda tried: tried.after.order)
        if not best.helps:
            break
        chosen.append(best)
        failing = best.after.reached < len(drives)
        left = [tried.cause for tried in more if tried is not best and (tried.helps or failing)]
    return Diagnosis(base, passages, ranked, tuple(chosen))


def with_settings(configuration: Configuration, causes: Sequence[Cause]) -> Configuration:
    """Return the parameters with the fixes of these causes. Raises ParameterError."""
    overrides = [text for cause in causes for text in cause.overrides]
    return load_configuration([configuration.tree.as_dict()], overrides=overrides) if overrides else configuration


def _is_valid(configuration: Configuration, cause: Cause) -> bool:
    try:
        with_settings(configuration, [cause])
    except ParameterError:
        return False
    return True


def record_of(scenario: Scenario, causes: Sequence[Cause] = ()) -> Any:
    """Return the record of a drive with these fixes, to draw it."""
    run = Run(replace(scenario, configuration=with_settings(scenario.configuration, causes)))
    while run.step():
        pass
    assert run.recorder is not None
    return run.recorder.record()
