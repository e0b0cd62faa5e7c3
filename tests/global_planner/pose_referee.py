"""An independent referee of plans for robots with a shape and a turning radius: shapely and closed forms, no kernels.

Poses are joined by arcs: two poses a chord c apart that differ by the angle d in heading lie on an arc of radius
c / (2 sin(d / 2)), and the chord has the mean of both headings, or the opposite direction when driven backward. So curvature,
continuity and direction are checked exactly between all poses, and the footprint at poses at most a quarter of a cell and one
degree apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, Path, PlanningError, Pose2D
from navstack.plugins import GlobalPlanner, Plan
from tests.global_planner import brute_force

TOLERANCE = 1e-6


def inflated(lethal: NDArray[np.bool_], resolution: float, inscribed: float) -> Costmap:
    """A costmap with inflation: radius 0.7 m, cost scaling factor 3."""
    from scipy.ndimage import distance_transform_edt

    ny, nx = lethal.shape
    distance = np.asarray(distance_transform_edt(~lethal)) * resolution if lethal.any() else np.full(lethal.shape, 9.0)
    costs = np.where(distance <= 0.7, np.trunc(252.0 * np.exp(-3.0 * (distance - inscribed))), 0.0)
    costs[distance <= inscribed] = 253
    costs[lethal] = 254
    return Costmap(GridGeometry(nx, ny, resolution), np.clip(costs, 0, 254).astype(np.uint8))


@dataclass
class Referee:
    """Checks plans on one costmap."""

    costmap: Costmap
    footprint: Footprint
    is_round: bool
    radius: float
    """Turning radius (m)."""
    may_reverse: bool
    tree: shapely.STRtree = field(init=False)

    def __post_init__(self) -> None:
        g = self.costmap.geometry
        iy, ix = np.nonzero(self.costmap.data == 254)
        x, y = g.origin_x + ix * g.resolution, g.origin_y + iy * g.resolution
        self.tree = shapely.STRtree(shapely.box(x, y, x + g.resolution, y + g.resolution))

    def faults(self, plan: Plan, start: Pose2D, goal: Pose2D) -> list[str]:
        """What is wrong with a plan, in sentences; empty if nothing is."""
        poses = plan.path.poses
        if not np.isfinite(poses).all():
            return ["a pose is not finite"]
        found: list[str] = []
        if np.abs(poses[0] - np.array(start)).max() > TOLERANCE:
            found.append(f"it begins at {poses[0]}, not at the start {tuple(start)}")
        stated = any("the goal itself cannot be reached" in note for note in plan.notes)
        if not stated and np.abs(poses[-1] - np.array(goal)).max() > TOLERANCE:
            found.append(f"it ends at {poses[-1]}, not at the goal {tuple(goal)}")
        if abs(plan.goal_moved_m - math.hypot(*(poses[-1, :2] - np.array(goal)[:2]))) > TOLERANCE:
            found.append(f"it ends {plan.goal_moved_m} m from the goal, as stated, but at {poses[-1]}")
        return found + self.faults_of_path(plan.path)

    def faults_of_path(self, path: Path) -> list[str]:
        """What is wrong with a path, wherever it begins and ends."""
        return self.motion_faults(path) + self.collisions(path)

    def motion_faults(self, path: Path) -> list[str]:
        """Where a path bends too sharply, deviates from its headings, or states wrong directions."""
        poses = path.poses
        step = np.diff(poses[:, :2], axis=0)
        chord = np.hypot(step[:, 0], step[:, 1])
        turn = np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi
        found: list[str] = []
        sharp = 2.0 * self.radius * np.sin(np.abs(turn) / 2.0) > chord + TOLERANCE
        if sharp.any():
            i = int(np.argmax(sharp))
            found.append(f"step {i} turns by {turn[i]:.4f} rad over {chord[i]:.4f} m")
        mean = poses[:-1, 2] + 0.5 * turn
        moving = chord > 1e-6
        off = np.abs(np.sin(np.arctan2(step[:, 1], step[:, 0]) - mean))
        if (off[moving] * chord[moving] > 1e-5).any():
            found.append(f"a step deviates from the heading by {float((off * chord)[moving].max()):.6f} m")
        signs = np.sign(step[:, 0] * np.cos(mean) + step[:, 1] * np.sin(mean))
        if not self.may_reverse and (signs[moving] < 0).any():
            found.append("it drives backward")
        stated = path.directions[:-1]
        if (stated[moving] != signs[moving]).any():
            found.append("the directions stated are not those of the steps")
        return found

    def collisions(self, path: Path) -> list[str]:
        """Where a path collides."""
        dense = self.dense(path.poses)
        g = self.costmap.geometry
        if self.is_round:
            ix = np.floor((dense[:, 0] - g.origin_x) / g.resolution).astype(int)
            iy = np.floor((dense[:, 1] - g.origin_y) / g.resolution).astype(int)
            # a path that touches the corner of a cell, or leaves the map, between two checks does so by a quarter of a cell
            inside = (ix >= 0) & (iy >= 0) & (ix < g.nx) & (iy < g.ny)
            blocked = ~inside
            blocked[inside] = np.isin(self.costmap.data[iy[inside], ix[inside]], (253, 254))
            hit = np.flatnonzero(blocked)
            deep = [k for k in hit if self._depth(dense[k], ix[k], iy[k]) > 0.25]
            return [f"its center is in an inscribed cell or outside the map at {dense[deep[0]]}"] if deep else []
        hit = self.overlaps(dense, 1.0 - 1e-6)
        return [f"its footprint overlaps an obstacle at {dense[np.argmax(hit)]}"] if hit.any() else []

    def overlaps(self, poses: NDArray[np.float64], scale: float) -> NDArray[np.bool_]:
        """Whether the footprint, `scale` times its size, overlaps an obstacle at each of the poses (n, 3)."""
        c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
        vx, vy = scale * self.footprint.vertices[:, 0], scale * self.footprint.vertices[:, 1]
        x, y = poses[:, 0:1] + c * vx - s * vy, poses[:, 1:2] + s * vx + c * vy
        hit = np.zeros(len(poses), np.bool_)
        hit[self.tree.query(shapely.polygons(np.stack((x, y), axis=-1)), predicate="intersects")[0]] = True
        return hit

    def can_leave(self, start: Pose2D, distance: float, scale: float, step: float = 0.004) -> bool:
        """Whether a robot that drives forward gets this far (m) away from a pose: all arcs and lines of `step` (m), tried.

        Poses closer than 0.7 steps, and that over the turning radius in heading, count as one.
        """
        bends = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])[:, None] * step / self.radius
        grain = 0.7 * step * np.array([1.0, 1.0, 1.0 / self.radius])
        front, seen = np.array([start], np.float64), set[tuple[int, ...]]()
        while len(front) and np.hypot(front[:, 0] - start.x, front[:, 1] - start.y).max() < distance:
            middle = front[:, 2] + 0.5 * bends
            chord = step * np.sinc(0.5 * bends / np.pi)
            reached = (front[:, 0] + chord * np.cos(middle), front[:, 1] + chord * np.sin(middle), front[:, 2] + bends)
            poses = np.stack([v.ravel() for v in reached], axis=-1)
            cells = np.floor(poses / grain).astype(np.int64)
            keep = [i for i in np.unique(cells, axis=0, return_index=True)[1] if tuple(cells[i]) not in seen]
            seen.update(tuple(cells[i]) for i in keep)
            front = poses[keep][~self.overlaps(poses[keep], scale)]
        return len(front) > 0

    def _depth(self, pose: NDArray[np.float64], ix: int, iy: int) -> float:
        """How deep a point is in its cell (cells)."""
        g = self.costmap.geometry
        fx, fy = (pose[0] - g.origin_x) / g.resolution - ix, (pose[1] - g.origin_y) / g.resolution - iy
        return float(min(fx, 1.0 - fx, fy, 1.0 - fy))

    def dense(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses along the arcs between `poses`, at most a quarter of a cell and one degree apart."""
        out = [poses[:1]]
        for a, b in pairwise(poses):
            turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
            chord = math.hypot(b[0] - a[0], b[1] - a[1])
            n = max(1, math.ceil(chord / (0.25 * self.costmap.geometry.resolution)), math.ceil(abs(turn) / 0.0175))
            k = np.arange(1, n + 1) / n
            if abs(turn) < 1e-9:
                xy = a[:2] + k[:, None] * (b[:2] - a[:2])
            else:
                direction = math.atan2(b[1] - a[1], b[0] - a[0])
                part = chord * np.sin(0.5 * turn * k) / math.sin(0.5 * turn)
                angle = direction - 0.5 * turn + 0.5 * turn * k
                xy = a[:2] + part[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
            out.append(np.column_stack((xy, a[2] + turn * k)))
        return np.concatenate(out)


def weighted_length(path: Path, backward: float) -> float:
    """Length (m) of a path, in which driving backward counts `backward` times."""
    step = np.hypot(*np.diff(path.poses[:, :2], axis=0).T)
    return float((step * np.where(path.directions[:-1] < 0, backward, 1.0)).sum())


def shortest_word(start: Pose2D, goal: Pose2D, radius: float, backward: float) -> float:
    """Length (m) of the shortest word of Reeds and Shepp by the same measure, by brute force; of Dubins if it is infinite."""
    there = complex(goal.x - start.x, goal.y - start.y) * np.exp(-1j * start.yaw) / radius
    x, y, yaw = (np.array([v]) for v in (there.real, there.imag, goal.yaw - start.yaw))
    if math.isinf(backward):
        return radius * float(brute_force.dubins(x, y, yaw)[0])
    return radius * float(brute_force.reeds_shepp(x, y, yaw, backward)[0])


def random_queries(
    planner: GlobalPlanner, referee: Referee, rng: np.random.Generator, count: int, reach: float
) -> tuple[int, int, list[str]]:
    """Plan between random free poses at most `reach` (m) apart; return plans found, failures with a reason, faults."""
    g = referee.costmap.geometry
    free = np.argwhere(referee.costmap.data < 200)
    found, failed, faults = 0, 0, []
    while found + failed < count:
        iy, ix = free[rng.integers(len(free))]
        start = Pose2D(*g.cell_to_world(int(ix), int(iy)), float(rng.uniform(-math.pi, math.pi)))
        near = free[np.hypot(free[:, 0] - iy, free[:, 1] - ix) < reach / g.resolution]
        jy, jx = near[rng.integers(len(near))]
        x, y = g.cell_to_world(int(jx), int(jy))
        goal = Pose2D(x + float(rng.uniform(-0.4, 0.4)) * g.resolution, y, float(rng.uniform(-math.pi, math.pi)))
        if any(
            referee.tree.query(shapely.Polygon(referee.footprint.at(p)), predicate="intersects").size
            for p in (start, goal)
        ):
            continue
        footprint = None if referee.is_round else referee.footprint
        try:
            plan = planner.make_plan(referee.costmap, start, goal, footprint=footprint)
        except PlanningError as error:
            failed += 1
            if len(error.message) < 40:
                faults.append(f"{start} {goal}: an error without a reason: {error.message}")
            continue
        found += 1
        faults += [f"{tuple(start)} to {tuple(goal)}: {fault}" for fault in referee.faults(plan, start, goal)]
    return found, failed, faults
