"""Metrics of a run among people: distances, intrusions, contacts, time to collision, disturbance.

Names and formulas: A. Francis et al., "Principles and Guidelines for Evaluating Social Robot Navigation" (arXiv 2306.16740), N.
Pérez-Higueras et al., HuNavSim (RA-L 2023), N. Tsoi et al., SEAN 2.0 (RA-L 2022), C. Chen et al., CrowdNav (ICRA 2019); zones: E.
Hall, The Hidden Dimension (1966). All of them are computed from the true positions at the control cycles; a value counts for the
time until the next cycle. The distance of a person is that of the centers minus the two radii; the robot's is the circumscribed
radius of its footprint. Velocities are displacements between cycles divided by the time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint

COMPLIANCE_M: Final = 0.5
"""Nearer than this is not compliant (m)."""
DISCOMFORT_M: Final = 0.2
"""CrowdNav's limit of discomfort (m)."""
CONTACT_M: Final = 0.02
"""Nearer than this is a contact (m)."""
ZONES: Final = {"intimate": 0.45, "personal": 1.2, "social": 3.6, "public": math.inf}
"""Hall's zones and their outer limits (m)."""
STALLED_M_S: Final = 0.05
PROGRESS_M: Final = 0.3
PROGRESS_S: Final = 20.0
"""A failure to progress: the distance to the goal does not fall by PROGRESS_M in this time."""
PERSONS: Final = np.dtype(
    [("radius", "<f8"), ("group", "<i4"), ("first_arrival", "<f8"), ("delay_s", "<f8"), ("delay_m", "<f8")]
)
"""Type of the array `persons` of a record."""
STILL: Final = (0.01, 0.02)
"""The robot does not move below this speed (m/s) and turning rate (rad/s)."""


@dataclass(frozen=True, slots=True, eq=False)
class PeopleTrack:
    """Where the people of a run were."""

    positions: NDArray[np.float64]
    """(n, p, 2) centers at the control cycles, map (m); NaN while a person is absent."""
    radii: NDArray[np.float64]
    """(p,) m."""
    groups: NDArray[np.int32]
    """(p,) number of each person's group, -1 without one."""
    walks: NDArray[np.float64]
    """(p, 3) time of the first arrival at a goal (s; inf: none), and how much longer the person took to its last goal than in the
    same run without the robot: time (s) and path (m); NaN if unknown."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Returns the arrays of the record."""
        persons = np.zeros(len(self.radii), PERSONS)
        persons["radius"], persons["group"] = self.radii, self.groups
        for k, name in enumerate(("first_arrival", "delay_s", "delay_m")):
            persons[name] = self.walks[:, k]
        return {"people": np.ascontiguousarray(self.positions, "<f8"), "persons": persons}

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> PeopleTrack | None:
        """Returns the people of a record's arrays; None for a run without people."""
        positions, persons = arrays.get("people"), arrays.get("persons")
        if positions is None or persons is None:
            return None
        walks = np.column_stack([persons[name] for name in ("first_arrival", "delay_s", "delay_m")])
        return cls(positions, persons["radius"].copy(), persons["group"].copy(), walks)


def check_people(arrays: Mapping[str, NDArray[Any]]) -> None:
    """Raises ValueError unless the arrays of people have the types and shapes of the format."""
    positions, persons = arrays.get("people"), arrays.get("persons")
    if (positions is None) != (persons is None):
        raise ValueError("one of people and persons is missing")
    if positions is None or persons is None:
        return
    if persons.dtype != PERSONS or persons.ndim != 1:
        raise ValueError(f"persons has the type {persons.dtype}")
    shape = (len(arrays["samples"]), len(persons), 2)
    if positions.dtype != np.dtype("<f8") or positions.shape != shape:
        raise ValueError("people does not have one position per sample and person")


@dataclass(frozen=True, slots=True)
class SocialMetrics:
    """Metrics of a run among people. Shares are of the time of the run."""

    people: int
    """Number of people."""
    distance_min_m: float
    """Minimum distance between the robot and a person; negative if they overlap, inf if nobody was there."""
    space_compliance: float
    """Share of the time with the nearest person nearer than 0.5 m: 0 is best."""
    discomfort: float
    """Share of the time with the nearest person nearer than 0.2 m."""
    intimate: float
    """Share of the time with the nearest person nearer than 0.45 m."""
    personal: float
    """From 0.45 to 1.2 m."""
    social: float
    """From 1.2 to 3.6 m."""
    public: float
    """Beyond 3.6 m, or nobody there."""
    group_intimate: float
    """Share of the time with the center of a group nearer than 0.45 m; NaN without groups."""
    group_personal: float
    """The same from 0.45 to 1.2 m."""
    time_to_collision_min_s: float
    """Minimum time until a collision with a person at constant velocities; 0 if they overlap, inf if none was coming."""
    contacts_by_robot: int
    """Contacts (nearer than 0.02 m) in which the robot was the one who moved towards the other faster."""
    contacts_by_people: int
    """Contacts in which the person was."""
    collisions_with_people: int
    """Collisions of the footprint in which it touched a person."""
    collisions_with_others: int
    """Collisions with the map, obstacles and other robots."""
    failures_to_progress: int
    """How often the distance to the goal did not fall by 0.3 m in 20 s."""
    stalled_s: float
    """Time slower than 0.05 m/s."""
    not_moving_s: float
    """Time slower than 0.01 m/s and 0.02 rad/s."""
    acceleration_mean_m_s2: float
    """Mean size of the acceleration."""
    acceleration_max_m_s2: float
    """Maximum size of the acceleration."""
    jerk_mean_m_s3: float
    """Mean size of the jerk."""
    jerk_max_m_s3: float
    """Maximum size of the jerk."""
    heading_change_rad: float
    """Cumulative heading change: sum of all rotation."""
    path_efficiency: float
    """Length driven divided by that of the first plan of each goal that was reached; 1 is best, NaN without one."""
    spl: float
    """Success weighted by path length: mean over goals of planned length / max(planned, driven), 0 without success."""
    path_irregularity_rad: float
    """Rotation of the path driven minus rotation of the first plans."""
    social_work: float
    """Integral over the time of the social forces on the robot and by it on people (m/s)."""
    disturbance_s: float
    """Mean over people of the time to their last goal with the robot minus without it; NaN if none reached a goal."""
    disturbance_m: float
    """The same for the path that they walked."""
    all_arrived_s: float
    """Time at which the robot and all people had reached a goal; inf if one did not."""

    def shown(self) -> tuple[tuple[str, str], ...]:
        """Returns the most important ones as names and rounded values with units, for reports."""

        def text(value: float, digits: int, unit: str) -> str:
            return f"{value:.{digits}f} {unit}" if math.isfinite(value) else "-"

        return (
            ("people", str(self.people)),
            ("minimum distance to a person", text(self.distance_min_m, 2, "m")),
            ("share of the time within 0.5 m of people", text(100.0 * self.space_compliance, 0, "%")),
            ("minimum time to collision", text(self.time_to_collision_min_s, 1, "s")),
            ("contacts by the robot", str(self.contacts_by_robot)),
            ("contacts by people", str(self.contacts_by_people)),
            ("mean delay of people", text(self.disturbance_s, 1, "s")),
            ("mean detour of people", text(self.disturbance_m, 2, "m")),
        )

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data."""
        return {name: getattr(self, name) for name in self.__slots__}


def social_metrics(
    times: NDArray[np.float64],
    poses: NDArray[np.float64],
    people: PeopleTrack,
    *,
    footprint: Footprint,
    collisions: NDArray[np.float64],
    targets: NDArray[np.float64],
    plans: Mapping[int, NDArray[np.float64]],
    results: Sequence[Mapping[str, Any]],
) -> SocialMetrics:
    """Computes the metrics from the control cycles: times (n,) s, true poses (n, 3) in the map.

    `footprint`: without padding; `collisions` (c, 4): time (s) and pose in the map (m, rad) of each collision; `targets` (n, 2):
    the goal at each cycle, NaN without one; `plans`: the first plan (k, 3) of each goal by its number; `results`: the goals'
    outcomes as in the record.
    """
    step = np.diff(times)
    real = np.flatnonzero(step > 0.0)
    duration = step[real]
    total = float(duration.sum())
    motion = np.diff(poses, axis=0)[real]
    turned = np.abs(np.remainder(motion[:, 2] + math.pi, 2.0 * math.pi) - math.pi)
    velocity = motion[:, :2] / duration[:, None]
    speed = np.hypot(*velocity.T)
    walked = np.diff(people.positions, axis=0)[real] / duration[:, None, None]
    offset = people.positions - poses[:, None, :2]
    radius = float(np.hypot(*footprint.vertices.T).max())
    reach = radius + people.radii
    away = np.hypot(offset[..., 0], offset[..., 1]) - reach
    nearest = _nearest(away)
    share = _Share(nearest[real], duration, total)
    groups = [np.flatnonzero(people.groups == group) for group in range(int(people.groups.max(initial=-1)) + 1)]
    to_groups = np.full(len(times), np.inf)
    if groups:
        centers = np.stack([people.positions[:, group].mean(axis=1) for group in groups], axis=1) - poses[:, None, :2]
        to_groups = _nearest(np.hypot(centers[..., 0], centers[..., 1]) - radius)
    of_groups = _Share(to_groups[real], duration, total) if groups else None
    relative = walked - velocity[:, None]
    by_robot, by_people = _contacts(away, offset, velocity, walked, real)
    touched = _collisions_with_people(times, people, footprint, collisions)
    acceleration, jerk = _derivatives(velocity, duration)
    efficiency, spl, planned_rotation = _paths(plans, results)
    first, extra_s, extra_m = people.walks.T
    done = results and all(result["state"] == "SUCCEEDED" for result in results)
    return SocialMetrics(
        people=len(people.radii),
        distance_min_m=float(nearest.min(initial=math.inf)),
        space_compliance=share.within(0.0, COMPLIANCE_M),
        discomfort=share.within(0.0, DISCOMFORT_M),
        intimate=share.within(0.0, ZONES["intimate"]),
        personal=share.within(ZONES["intimate"], ZONES["personal"]),
        social=share.within(ZONES["personal"], ZONES["social"]),
        public=share.within(ZONES["social"], math.inf),
        group_intimate=math.nan if of_groups is None else of_groups.within(0.0, ZONES["intimate"]),
        group_personal=math.nan if of_groups is None else of_groups.within(ZONES["intimate"], ZONES["personal"]),
        time_to_collision_min_s=float(times_to_collision(offset[real], relative, reach).min(initial=math.inf)),
        contacts_by_robot=by_robot,
        contacts_by_people=by_people,
        collisions_with_people=touched,
        collisions_with_others=len(collisions) - touched,
        failures_to_progress=_failures_to_progress(times, poses, targets),
        stalled_s=float(duration[speed < STALLED_M_S].sum()),
        not_moving_s=float(duration[(speed < STILL[0]) & (turned / duration < STILL[1])].sum()),
        acceleration_mean_m_s2=_mean(acceleration),
        acceleration_max_m_s2=float(acceleration.max(initial=0.0)),
        jerk_mean_m_s3=_mean(jerk),
        jerk_max_m_s3=float(jerk.max(initial=0.0)),
        heading_change_rad=float(turned.sum()),
        path_efficiency=efficiency,
        spl=spl,
        path_irregularity_rad=float(turned.sum()) - planned_rotation,
        social_work=float((_social_work(offset[real], velocity, walked) * duration).sum()),
        disturbance_s=_known_mean(extra_s),
        disturbance_m=_known_mean(extra_m),
        all_arrived_s=max(float(first.max(initial=0.0)), float(times[-1])) if done and len(times) else math.inf,
    )


def times_to_collision(
    offset: NDArray[np.float64], velocity: NDArray[np.float64], reach: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, p) smallest t > 0 (s) with |offset + velocity t| = reach, for offsets and relative velocities (n, p, 2), reach (p,).

    0 where they overlap, inf where they do not meet or a person is absent.
    """
    a = (velocity**2).sum(axis=2)
    b = (offset * velocity).sum(axis=2)
    c = (offset**2).sum(axis=2) - reach**2
    root = b * b - a * c
    meets = (root >= 0.0) & (b < 0.0) & (c > 0.0)
    # the smaller root, in the form that loses no digits: c / (-b + sqrt(root))
    found = np.where(meets, c / np.where(meets, np.sqrt(np.where(meets, root, 0.0)) - b, 1.0), math.inf)
    return np.where(c <= 0.0, 0.0, found)


def social_force(
    offset: NDArray[np.float64], velocity: NDArray[np.float64], other: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(.., 2) force (m/s²) on someone by another at `offset` (.., 2) (m), with their velocities (.., 2) (m/s); 0 if absent.

    M. Moussaïd et al., Proceedings of the Royal Society B 276 (2009), with the parameters of HuNavSim. HuNavSim's evaluator
    swaps the arguments of an arctangent; its numbers are no reference.
    """
    away = np.hypot(offset[..., 0], offset[..., 1])
    there = away > 0.0
    unit = offset / np.where(there, away, 1.0)[..., None]
    interaction = 2.0 * (velocity - other) + unit
    size = np.hypot(interaction[..., 0], interaction[..., 1])
    there &= size > 0.0
    along = interaction / np.where(there, size, 1.0)[..., None]
    angle = np.arctan2(unit[..., 1], unit[..., 0]) - np.arctan2(along[..., 1], along[..., 0])
    angle = np.remainder(angle + math.pi, 2.0 * math.pi) - math.pi
    reach = 0.35 * np.where(there, size, 1.0)
    slowing = np.exp(-away / reach - (3.0 * reach * angle) ** 2)
    turning = np.sign(angle) * np.exp(-away / reach - (2.0 * reach * angle) ** 2)
    left = np.stack((-along[..., 1], along[..., 0]), axis=-1)
    force = -2.1 * (slowing[..., None] * along + turning[..., None] * left)
    return np.where(there[..., None], force, 0.0)


class _Share:
    """Share of the time that a distance is between limits."""

    def __init__(self, distance: NDArray[np.float64], duration: NDArray[np.float64], total: float) -> None:
        self._distance, self._duration, self._total = distance, duration, total

    def within(self, low: float, high: float) -> float:
        """Returns the share from `low` to below `high`; everything below counts as 0, inf as the farthest."""
        least = -math.inf if low == 0.0 else low
        inside = (self._distance >= least) & ((self._distance < high) | (high == math.inf))
        return float(self._duration[inside].sum()) / self._total if self._total > 0.0 else 0.0


def _nearest(away: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) the smallest of (n, p) distances that are known; inf without one."""
    return np.where(np.isnan(away), math.inf, away).min(axis=1, initial=math.inf)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else 0.0


def _known_mean(values: NDArray[np.float64]) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else math.nan


def _contacts(
    away: NDArray[np.float64],
    offset: NDArray[np.float64],
    velocity: NDArray[np.float64],
    walked: NDArray[np.float64],
    real: NDArray[np.intp],
) -> tuple[int, int]:
    """How many contacts the robot and people caused: the one with the greater velocity towards the other before it."""
    touching = away[1:][real] < CONTACT_M
    before = np.vstack((away[:1] < CONTACT_M, touching[:-1])) if len(touching) else touching
    cycles, persons = np.nonzero(touching & ~before)
    by_robot = 0
    for cycle, person in zip(cycles.tolist(), persons.tolist(), strict=True):
        towards = offset[real[cycle], person]
        moved = walked[cycle, person]
        if np.isnan(moved).any():
            moved = np.zeros(2)
            towards = offset[real[cycle] + 1, person]
        by_robot += bool(float(velocity[cycle] @ towards) >= float(-moved @ towards))
    return by_robot, len(cycles) - by_robot


def _collisions_with_people(
    times: NDArray[np.float64], people: PeopleTrack, footprint: Footprint, collisions: NDArray[np.float64]
) -> int:
    """How many collisions were with a person, who walks straight between two cycles."""
    count = 0
    for time, x, y, yaw in collisions.tolist():
        after = min(int(np.searchsorted(times, time)), len(times) - 1)
        before = max(after - 1, 0)
        span = float(times[after] - times[before])
        share = min(max((time - float(times[before])) / span, 0.0), 1.0) if span > 0.0 else 1.0
        there = people.positions[before] + share * (people.positions[after] - people.positions[before])
        c, s = math.cos(yaw), math.sin(yaw)
        local = (there - (x, y)) @ np.array([[c, -s], [s, c]])
        known = np.isfinite(local[:, 0])
        away = shapely.distance(footprint.polygon, shapely.points(local[known])) - people.radii[known]
        count += bool((away < CONTACT_M).any())
    return count


def _derivatives(
    velocity: NDArray[np.float64], duration: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sizes of acceleration and jerk between intervals with these mean velocities (n, 2)."""
    if len(velocity) < 2:
        return np.empty(0), np.empty(0)
    between = 0.5 * (duration[1:] + duration[:-1])
    acceleration = np.diff(velocity, axis=0) / between[:, None]
    jerk = np.diff(acceleration, axis=0) / (0.5 * (between[1:] + between[:-1]))[:, None]
    return np.hypot(*acceleration.T), np.hypot(*jerk.T)


def _failures_to_progress(times: NDArray[np.float64], poses: NDArray[np.float64], targets: NDArray[np.float64]) -> int:
    """Count the times of PROGRESS_S without PROGRESS_M of progress; each begins after the one before, or with progress."""
    left = np.hypot(*(targets - poses[:, :2]).T).tolist()
    failures, begin, best, goal = 0, math.nan, math.inf, (math.nan, math.nan)
    for t, distance, target in zip(times.tolist(), left, map(tuple, targets.tolist()), strict=True):
        if math.isnan(distance):
            begin = math.nan
        elif math.isnan(begin) or target != goal or distance <= best - PROGRESS_M:
            begin, best, goal = t, distance, target
        elif t - begin >= PROGRESS_S:
            failures += 1
            begin, best = t, distance
    return failures


def _paths(
    plans: Mapping[int, NDArray[np.float64]], results: Sequence[Mapping[str, Any]]
) -> tuple[float, float, float]:
    """Efficiency, SPL and the rotation of the first plans (rad)."""
    driven = planned = weighted = rotation = 0.0
    count = 0
    for number, result in enumerate(results):
        plan, succeeded = plans.get(number), result["state"] == "SUCCEEDED"
        if plan is None:
            count += not succeeded  # without a plan it is a failure; a success without one has no planned length
            continue
        steps = np.diff(plan[:, :2], axis=0)
        sizes = np.hypot(*steps.T)
        length = float(sizes.sum())
        directions = np.arctan2(steps[:, 1], steps[:, 0])[sizes > 0.0]
        rotation += float(np.abs(np.remainder(np.diff(directions) + math.pi, 2.0 * math.pi) - math.pi).sum())
        count += 1
        way = float(result["path_length_m"])
        if succeeded and length > 0.0:
            driven, planned = driven + way, planned + length
            weighted += length / max(way, length)
    return driven / planned if planned > 0.0 else math.nan, weighted / count if count else math.nan, rotation


def _social_work(
    offset: NDArray[np.float64], velocity: NDArray[np.float64], walked: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n,) size of the sum of the forces on the robot, plus the sizes of its forces on people (m/s²)."""
    known = np.isfinite((offset + walked).sum(axis=2))
    there = np.where(known[..., None], offset, 1e6)  # so far away that there is no force
    moved = np.where(known[..., None], walked, 0.0)
    robot = np.broadcast_to(velocity[:, None], moved.shape)
    on_robot = social_force(there, robot, moved).sum(axis=1)
    on_people = social_force(-there, moved, robot)
    return np.hypot(*on_robot.T) + np.hypot(on_people[..., 0], on_people[..., 1]).sum(axis=1)
