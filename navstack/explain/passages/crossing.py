"""How a robot with a turning radius gets through an opening: a motion from one side to the other, by smac_hybrid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from navstack.core import INSCRIBED, UNKNOWN, Costmap, Footprint, GridGeometry, Path, Pose2D
from navstack.core.errors import PlanningError
from navstack.explain.passages.headings import HeadingRange
from navstack.explain.passages.report import Passage
from navstack.global_planner.smac_hybrid import SmacHybridParams, SmacHybridPlanner

_CUSP_M: Final = 5.0
"""m: a change of direction is avoided if a detour of this length does."""
_STATES: Final = 20_000
_RANGES: Final = 4
_STARTS: Final = 4
"""Headings at which a way may begin beside the opening, one turn apart in all."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """A motion through an opening."""

    path: Path
    """From one side to the other, free for the whole footprint."""
    changes: int
    """Changes between driving forward and backward."""


class CrossingSearch:
    """Searches motions through openings of one costmap, for one footprint and turning radius (m)."""

    def __init__(self, costmap: Costmap, footprint: Footprint, radius: float) -> None:
        self.costmap, self.footprint = costmap, footprint
        self.reach = 2.0 * footprint.circumscribed_radius + 3.0 * radius
        turned = Footprint(-footprint.vertices).polygon
        self.symmetric = footprint.polygon.symmetric_difference(turned).area < 1e-9 * turned.area
        """Forward and backward are the same: a way is also one for the opposite headings."""
        self.planner = SmacHybridPlanner(
            SmacHybridParams(
                motion_model_for_search="REEDS_SHEPP",
                minimum_turning_radius=radius,
                goal_heading_mode="ALL_DIRECTION",
                max_iterations=_STATES,
                start_policy="refuse",
                cost_penalty=0.0,
                reverse_penalty=1.0,
                non_straight_penalty=1.0,
                cusp_penalty=_CUSP_M,
            )
        )
        self.free: NDArray[np.bool_] = (costmap.data < INSCRIBED) | (costmap.data == UNKNOWN)

    def through(self, passage: Passage, headings: tuple[HeadingRange, ...]) -> Crossing | None:
        """The way with the fewest changes of direction among those found; None if none is found."""
        window = self._window(passage)
        best: Crossing | None = None
        for path in self._ways(window, passage, headings):
            if best is None or path.cusps < best.changes:
                best = Crossing(path, path.cusps)
            if best.changes == 0:
                break
        return best

    def _ways(self, window: Costmap, passage: Passage, headings: tuple[HeadingRange, ...]) -> Iterator[Path]:
        """Ways between wide places on both sides, far and near: through the middle of a range of headings, then any."""
        for reach in (self.reach, self.footprint.circumscribed_radius):
            before, beyond = (self._target(window, passage, side, reach) for side in (-1.0, 1.0))
            if before is None or beyond is None:
                continue
            for chosen in self._distinct(headings)[:_RANGES]:
                first = self._leg(window, chosen.pose, before)
                second = self._leg(window, chosen.pose, beyond) if len(first) else first
                if _ends_beyond(first, passage, before) and _ends_beyond(second, passage, beyond):
                    # Reeds-Shepp motions can be reversed: in by the first leg, out by the second
                    yield Path(np.concatenate((first[::-1], second[1:])), window.frame)
            for k in range(_STARTS // 2 if self.symmetric else _STARTS):
                poses = self._leg(window, Pose2D(*before, 2.0 * math.pi * k / _STARTS), beyond)
                if len(crossings(poses, passage)) % 2:
                    yield Path(poses, window.frame)

    def _distinct(self, headings: tuple[HeadingRange, ...]) -> list[HeadingRange]:
        """The ranges without those that are, for a symmetric footprint, the opposite of an earlier one."""
        found: list[HeadingRange] = []
        for r in headings:
            if not (self.symmetric and any(abs(math.cos(r.pose.yaw - f.pose.yaw)) > 1.0 - 1e-9 for f in found)):
                found.append(r)
        return found

    def _window(self, passage: Passage) -> Costmap:
        """The costmap around a passage; the world ends at its border."""
        g = self.costmap.geometry
        half = math.ceil((self.reach + 0.5 * math.dist(*passage.ends)) / g.resolution)
        ix, iy = g.world_to_cell_unbounded(passage.x, passage.y)
        x0, y0, x1, y1 = max(0, ix - half), max(0, iy - half), min(g.nx, ix + half + 1), min(g.ny, iy + half + 1)
        x, y = g.origin_x + x0 * g.resolution, g.origin_y + y0 * g.resolution
        geometry = GridGeometry(x1 - x0, y1 - y0, g.resolution, x, y)
        self._here = np.ascontiguousarray(self.free[y0:y1, x0:x1])
        return Costmap(geometry, np.ascontiguousarray(self.costmap.data[y0:y1, x0:x1]), self.costmap.frame)

    def _target(self, window: Costmap, passage: Passage, side: float, reach: float) -> tuple[float, float] | None:
        """The widest place on one side of an opening that its middle leads to, at most `reach` (m) from its sides."""
        g = window.geometry
        x = g.origin_x + (np.arange(g.nx) + 0.5) * g.resolution
        y = g.origin_y + (np.arange(g.ny) + 0.5) * g.resolution
        beyond = self._here & (side * _across(passage, *np.meshgrid(x, y)) > 0.0)
        label: Any = ndimage.label
        labels, _ = label(beyond, np.ones((3, 3), int))
        near = np.hypot(x[None, :] - passage.x, y[:, None] - passage.y)
        at_bar = beyond & (near <= 0.5 * math.dist(*passage.ends) + g.resolution)
        if not at_bar.any():
            return None
        leads = np.unique(labels[at_bar])
        room: Any = ndimage.distance_transform_edt(np.pad(np.isin(labels, leads), 1))
        room = np.where(near <= reach + 0.5 * math.dist(*passage.ends), room[1:-1, 1:-1], 0.0)
        best = int(np.lexsort((near.ravel(), -np.round(room.ravel(), 6)))[0])
        iy, ix = divmod(best, g.nx)
        return float(x[ix]), float(y[iy])

    def _leg(self, window: Costmap, start: Pose2D, end: tuple[float, float]) -> NDArray[np.float64]:
        """The poses (n, 3) from a pose to a place at any heading, (0, 3) without a plan."""
        try:
            plan = self.planner.make_plan(window, start, Pose2D(*end, start.yaw), footprint=self.footprint)
        except PlanningError:
            return np.empty((0, 3))
        return plan.path.poses


def _across(passage: Passage, x: Any, y: Any) -> Any:
    """Signed distance (m) of points from the line through the ends of a passage."""
    (ax, ay), (bx, by) = passage.ends
    return ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / math.dist(*passage.ends)


def crossings(poses: NDArray[np.float64], passage: Passage) -> NDArray[np.int64]:
    """Indices i at which a path (n, 3) crosses the line between the ends of a passage between pose i and i + 1."""
    (ax, ay), (bx, by) = passage.ends
    side = _across(passage, poses[:, 0], poses[:, 1])
    share = ((poses[:, 0] - ax) * (bx - ax) + (poses[:, 1] - ay) * (by - ay)) / math.dist(*passage.ends) ** 2
    at = np.flatnonzero((side[1:] > 0.0) != (side[:-1] > 0.0))
    weight = side[at] / (side[at] - side[at + 1])
    where = share[at] + weight * (share[at + 1] - share[at])
    return at[(where >= 0.0) & (where <= 1.0)]


def _ends_beyond(poses: NDArray[np.float64], passage: Passage, end: tuple[float, float]) -> bool:
    """Whether a path from the opening ends on the side of `end` by way of the opening, and not around its obstacles."""
    side = _across(passage, poses[1:, 0], poses[1:, 1])
    away = np.flatnonzero(np.abs(side) > 1e-9)
    if not len(away):
        return False  # no plan, or no motion
    first = int(away[0])
    changes = len(crossings(poses[first + 1 :], passage))
    local = math.copysign(1.0, side[first]) * (-1.0) ** changes
    return local == math.copysign(1.0, float(_across(passage, *end)))
