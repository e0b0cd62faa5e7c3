"""`python -m tests.global_planner.check_smoothed 1000 [SEED]`: smoothers after random plans, checked by shapely and closed forms.

Random maps with blocks and walls, four footprints, radii of 0.3 to 1 m, and all kinds of planners: Dubins, Reeds-Shepp, with and
without the planner's own smoothing, lattices, grids. Prints per smoother how many paths changed,
what that does to length, curvature, clearance and bending, the time, and every fault.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navstack.core import Costmap, Footprint, Path, PlanningError, Pose2D
from navstack.global_planner.smoothers import SmoothedPlanner
from navstack.plugins import GLOBAL_PLANNERS, SMOOTHERS, GlobalPlanner, Plan, Smoother
from tests.global_planner.pose_referee import inflated

CELL = 0.05
SHAPES: dict[str, Footprint] = {
    "box": Footprint(np.array([[0.35, 0.2], [-0.25, 0.2], [-0.25, -0.2], [0.35, -0.2]])),
    "long": Footprint(np.array([[0.9, 0.25], [-0.3, 0.25], [-0.3, -0.25], [0.9, -0.25]])),
    "wedge": Footprint(np.array([[0.4, 0.0], [-0.2, 0.25], [-0.3, -0.2]])),
    "round": Footprint.from_radius(0.22),
}
PLANNERS: dict[str, dict[str, Any]] = {
    "navfn": {},
    "astar": {},
    "theta_star": {},
    "smac_2d": {},
    "smac_hybrid": {"motion_model_for_search": "DUBIN"},
    "smac_hybrid raw": {"motion_model_for_search": "DUBIN", "smooth_path": False},
    "smac_hybrid RS": {"motion_model_for_search": "REEDS_SHEPP"},
    "smac_hybrid RS raw": {"motion_model_for_search": "REEDS_SHEPP", "smooth_path": False},
    "smac_lattice": {"allow_reverse_expansion": True},
}


@dataclass
class Case:
    """A plan on a random map."""

    planner: str
    shape: str
    radius: float
    """Turning radius (m) for the smoother; 0 = none."""
    costmap: Costmap
    plan: Plan

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """The plan's, with headings along the path if it has none."""
        return self.smoothed(_Nothing(None))

    def smoothed(self, smoother: Smoother) -> NDArray[np.float64]:
        """The poses of the smoothed plan."""
        ends = self.plan.path[0], self.plan.path[-1]
        planner = SmoothedPlanner(_Made(self.plan), smoother)
        return planner.make_plan(self.costmap, *ends, footprint=self.checked).path.poses

    @property
    def checked(self) -> Footprint | None:
        """The footprint that planners and smoothers get: a round robot is checked by inscribed cells."""
        return None if self.shape == "round" else self.footprint

    @property
    def footprint(self) -> Footprint:
        """The robot's."""
        return SHAPES[self.shape]

    @property
    def follows_headings(self) -> bool:
        """Whether the planner plans headings."""
        return self.planner.startswith(("smac_hybrid", "smac_lattice"))

    @cached_property
    def cells(self) -> tuple[NDArray[Any], shapely.STRtree]:
        """The lethal cells."""
        iy, ix = np.nonzero(self.costmap.data == 254)
        boxes = np.asarray(shapely.box(ix * CELL, iy * CELL, (ix + 1) * CELL, (iy + 1) * CELL))
        return boxes, shapely.STRtree(boxes)

    def overlap_m2(self, poses: NDArray[np.float64]) -> float:
        """Largest area of a lethal cell under the footprint on the way; of a round robot, 1 if it enters an inscribed cell."""
        p = between(poses)
        if self.shape == "round":
            near = [
                self.costmap.data[((p[:, 1] + dy) / CELL).astype(int), ((p[:, 0] + dx) / CELL).astype(int)] >= 253
                for dx, dy in ((-1e-9, -1e-9), (1e-9, 1e-9))
            ]
            return float((near[0] & near[1]).any())
        c, s = np.cos(p[:, 2, None]), np.sin(p[:, 2, None])
        x, y = self.footprint.vertices.T
        robots: NDArray[Any] = np.asarray(
            shapely.polygons(np.stack((p[:, :1] + c * x - s * y, p[:, 1:2] + s * x + c * y), -1))
        )
        lethal, tree = self.cells
        i, j = tree.query(robots, predicate="intersects")
        return float(shapely.area(shapely.intersection(robots[i], lethal[j])).max(initial=0.0))

    def clearance_m(self, poses: NDArray[np.float64]) -> float:
        """Mean distance of the poses, a quarter of a cell apart, from the nearest lethal cell."""
        p = between(poses)
        ix, iy = (p[:, 0] / CELL).astype(int), (p[:, 1] / CELL).astype(int)
        return float(self.distances[iy, ix].mean())

    @cached_property
    def distances(self) -> NDArray[np.float64]:
        """Distance of each cell from the nearest lethal one (m)."""
        return np.asarray(distance_transform_edt(self.costmap.data != 254)) * CELL


def between(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses at most an eighth of a cell apart on the arcs between the given ones; on lines where it turns by over 0.5 rad."""
    out = [poses[:1]]
    for a, b in pairwise(poses):
        turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
        n = math.ceil((1.1 * math.hypot(b[0] - a[0], b[1] - a[1]) + 0.4 * abs(turn)) / (CELL / 8.0)) + 1
        k = np.arange(1, n + 1) / n
        out.append(np.column_stack((a[0] + k * (b[0] - a[0]), a[1] + k * (b[1] - a[1]), a[2] + k * turn)))
        if 1e-9 < abs(turn) < 0.5:
            part = np.sin(0.5 * turn * k) / math.sin(0.5 * turn)
            chord = complex(b[0] - a[0], b[1] - a[1]) * part * np.exp(-0.5j * turn * (1.0 - k))
            out[-1][:, :2] = a[:2] + np.column_stack((chord.real, chord.imag))
    return np.concatenate(out)


def turns(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (rad) by which the heading changes between successive poses."""
    return np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi


def bends(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turns between two headings (1/m), over the longer of the step and the mean of the step and the next one."""
    length = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    length = np.maximum(length, 0.5 * (length + np.append(length[1:], 0.0)))
    return np.where(length > 1e-4, 2.0 * np.sin(0.5 * np.abs(turns(poses))) / np.maximum(length, 1e-9), 0.0)


def circles(poses: NDArray[np.float64], folds: bool = False) -> NDArray[np.float64]:
    """Curvatures (1/m) of the circles through three successive points; 0 at cusps unless `folds`."""
    a, b = poses[1:-1, :2] - poses[:-2, :2], poses[2:, :2] - poses[1:-1, :2]
    on = folds | ((a * b).sum(axis=1) > 0.0)
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    sides = np.hypot(*a.T) * np.hypot(*b.T) * np.hypot(*(a + b).T)
    return np.where(on & (sides > 1e-9), 2.0 * area / np.maximum(sides, 1e-12), 0.0)


def slips(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (rad) by which each heading, or its opposite, is outside those between the steps before and after the pose."""
    steps = np.diff(poses[:, :2], axis=0)
    moves = np.hypot(*steps.T) > 2e-4
    course = np.arctan2(steps[:, 1], steps[:, 0])

    def off(angle: NDArray[np.float64], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(moves, np.remainder(yaw - angle + 0.5 * np.pi, np.pi) - 0.5 * np.pi, 0.0)

    last, following = off(course, poses[1:, 2]), off(course, poses[:-1, 2])
    out = np.abs(np.concatenate((following[:1], np.zeros(len(poses) - 2), last[-1:])))
    a, b = last[:-1], following[1:]
    out[1:-1] = np.where(a * b <= 0.0, 0.0, np.minimum(np.abs(a), np.abs(b)))
    return out


def roughness(poses: NDArray[np.float64]) -> float:
    """Integral of the squared curvature (1/m) by the headings of steps, cusps left out."""
    steps = np.diff(poses[:, :2], axis=0)
    steps = steps[np.hypot(*steps.T) > 1e-6]
    length = np.hypot(*steps.T)
    a, b = steps[:-1], steps[1:]
    angle = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))
    on = np.abs(angle) < 0.5 * math.pi
    return float((angle[on] ** 2 / (0.5 * (length[:-1] + length[1:]))[on]).sum())


def faults(case: Case, after: NDArray[np.float64]) -> list[str]:
    """What is wrong with a smoothed plan."""
    before = case.poses
    found: list[str] = []
    if not np.isfinite(after).all():
        return ["a pose is not finite"]
    planned = 3 if case.follows_headings else 2  # a plan over cells begins with any heading
    if np.abs(after[0] - before[0])[:planned].max() > 1e-9 or np.abs(after[-1] - before[-1]).max() > 1e-9:
        found.append("its ends moved")
    if case.overlap_m2(before) == 0.0 and (area := case.overlap_m2(after)) > 1e-9:
        found.append(f"it overlaps an obstacle by {area:.2g} m2")
    if case.follows_headings and Path(after).cusps != Path(before).cusps:
        found.append(f"{Path(after).cusps} cusps instead of {Path(before).cusps}")
    inner = slice(None) if case.follows_headings else slice(1, -1)  # grid plans may begin and end with a fold
    curves = partial(circles, folds=not case.follows_headings)
    if case.radius > 0.0:
        for name, measure, slack in (("circles", curves, 1e-3), ("headings", bends, 0.021)):
            limit = max(1.0 / case.radius, measure(before).max(initial=0.0)) * (1.0 + slack)
            if (value := measure(after)[inner].max(initial=0.0)) > limit:
                found.append(f"curvature {value:.3f} by {name}, limit {limit:.3f} 1/m")
        if case.follows_headings:
            leaves = [2.0 * math.sin(slips(p)[0]) / math.hypot(*(p[1] - p[0])[:2]) for p in (before, after)]
            if leaves[1] > max(1.0 / case.radius, leaves[0]) * 1.021:
                found.append(f"it leaves the start with a curvature of {leaves[1]:.3f} 1/m")
    off, was = slips(after), slips(before)
    limits = np.full(len(after), max(0.15, was[1:-1].max(initial=0.0))) + 1e-5
    limits[[0, -1]] = np.maximum(0.15, was[[0, -1]]) + 1e-5  # those of start and goal stay, wherever the path leads
    if not case.follows_headings:
        limits[0] = math.inf
    if (off > limits).any():
        k = int(np.argmax(off - limits))
        found.append(f"heading {k} of {len(after)} is {off[k]:.3f} rad off the path, {limits[k]:.3f} allowed")
    if (turn := float(np.abs(turns(after)).max(initial=0.0))) > max(0.25 * math.pi, np.abs(turns(before)).max()) + 1e-5:
        found.append(f"the heading jumps by {turn:.3f} rad")
    return found


def random_cases(count: int, seed: int, names: Sequence[str] = tuple(PLANNERS)) -> Iterator[Case]:
    """Plans on random maps of 4.5 x 3.5 m; grid planners get a radius every other time, and headings along the path."""
    rng = np.random.default_rng(seed)
    shapes = list(SHAPES)
    made = 0
    while made < count:
        name, shape = names[int(rng.integers(len(names)))], shapes[int(rng.integers(len(shapes)))]
        grid = np.zeros((70, 90), bool)
        size = int(rng.integers(2, 12))
        for y, x, h, w in rng.integers([5, 5, 1, 1], [65, 85, size, size], (int(rng.integers(2, 9)), 4)):
            grid[y : y + h, x : x + w] = True
        grid[:, [0, -1]] = grid[[0, -1]] = True
        costmap = inflated(grid, CELL, SHAPES[shape].inscribed_radius)
        radius = float(rng.choice([0.3, 0.5, 1.0]))
        values = dict(PLANNERS[name])
        if "smac_hybrid" in name:
            values["minimum_turning_radius"] = radius
        if name == "smac_lattice":
            radius = 0.5  # that of its default primitives
        planner = GLOBAL_PLANNERS.get(name.split()[0])
        ends = [Pose2D(*rng.uniform([0.6, 0.6, -3.0], [3.9, 2.9, 3.0])) for _ in range(2)]
        footprint = None if shape == "round" else SHAPES[shape]
        try:
            plan = planner.cls(planner.cls.Params(**values)).make_plan(costmap, *ends, footprint=footprint)
        except PlanningError:
            continue
        if "hybrid" not in name and "lattice" not in name and rng.random() < 0.5:
            radius = 0.0
        made += 1
        yield Case(name, shape, radius, costmap, plan)


class _Nothing(Smoother):
    """A smoother that changes nothing."""

    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        del costmap, footprint
        return path


class _Made(GlobalPlanner):
    """A planner that has planned."""

    def __init__(self, plan: Plan) -> None:
        super().__init__(None)
        self.plan = plan

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        del costmap, start, goal, footprint, keep_potential
        return self.plan


@dataclass
class Tally:
    """What a smoother did."""

    paths: int = 0
    changed: int = 0
    better: int = 0
    """Paths whose bending energy fell by a tenth or more."""
    time_s: float = 0.0
    ratios: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Length, largest curvature, bending energy and clearance of the changed paths, over those before."""

    def line(self) -> str:
        """A row of the table."""
        means = np.exp(np.log(np.array(self.ratios)).mean(axis=0)) if self.ratios else np.full(4, np.nan)
        return (
            f"changed {self.changed:4} of {self.paths:4}, rounder {self.better:4}; length x{means[0]:.4f}, "
            f"curvature x{means[1]:.3f}, bending x{means[2]:.3f}, clearance x{means[3]:.3f}; "
            f"{1e3 * self.time_s / max(1, self.paths):.1f} ms each"
        )


def check(cases: Iterable[Case]) -> tuple[dict[str, Tally], list[str]]:
    """Smooth every plan with every smoother; return what they did, by smoother and group of planners, and the faults."""
    tallies: dict[str, Tally] = {}
    found: list[str] = []
    for number, case in enumerate(cases):
        for entry in SMOOTHERS:
            values: dict[str, Any] = {"minimum_turning_radius": case.radius}
            smoother = entry.cls(entry.cls.Params(**values))
            began = time.thread_time()
            after = case.smoothed(smoother)
            spent = time.thread_time() - began
            group = "poses" if case.follows_headings else "grid, radius" if case.radius > 0.0 else "grid"
            for key in (entry.name, f"{entry.name}: {group}"):
                tally = tallies.setdefault(key, Tally())
                tally.paths += 1
                tally.time_s += spent
                if len(after) != len(case.poses) or np.abs(after - case.poses).max() > 1e-6:
                    tally.changed += 1
                    now, was = (
                        (
                            Path(p).length,
                            max(float(circles(p).max(initial=0.0)), 0.1),
                            max(roughness(p), 1e-3),
                            case.clearance_m(p),
                        )
                        for p in (after, case.poses)
                    )
                    tally.better += now[2] < 0.9 * was[2]
                    tally.ratios.append(tuple(a / b for a, b in zip(now, was, strict=True)))  # type: ignore[arg-type]
            found += [
                f"plan {number}: {case.planner}, {case.shape}, R {case.radius}, {entry.name}: {fault}"
                for fault in faults(case, after)
            ]
    return tallies, found


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    tallies, found = check(random_cases(count, seed))
    for name in sorted(tallies):
        print(f"{name:30} {tallies[name].line()}")
    print(f"faults: {len(found)}")
    for fault in found:
        print("   ", fault)


if __name__ == "__main__":
    main()
