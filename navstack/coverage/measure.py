"""How well a line covers an area: share, overlap, length, turns, and which parts stay uncovered and why."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import angle_between
from navstack.coverage._kernels import sweep
from navstack.coverage.area import Area, regions_of

LEFT: Final = -1e12
"""Distance (cells) at which the tool was last over a cell that it has not met."""
REASONS: Final = (
    "a pass would repeat more than it covers",
    "the tool passed beside it",
    "an obstacle was in the way",
    "the drive ended before it came there",
)
"""Why a part stays uncovered."""
TURN_RAD: Final = 0.35
"""A change of direction by more than this counts as a turn (rad)."""


@dataclass(frozen=True, slots=True)
class CoverageFigures:
    """What was covered. Areas in m², lengths in m."""

    reachable_m2: float
    covered_m2: float
    """Of the reachable area."""
    overlap: float
    """Area over which the tool passed again, in relation to the covered one: 0.1 is 10 %."""
    work_m: float
    """Length with the tool at work."""
    travel_m: float
    """Length with the tool off: turns between swaths, and ways to the next cell."""
    turns: int
    """Changes of direction by more than 20 degrees."""

    @property
    def share(self) -> float:
        """Covered share of what the tool can reach."""
        return self.covered_m2 / self.reachable_m2 if self.reachable_m2 else 0.0

    @property
    def length_m(self) -> float:
        """Length (m)."""
        return self.work_m + self.travel_m

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as JSON data."""
        return {**asdict(self), "share": self.share, "length_m": self.length_m}


def visits_of(area: Area, points: NDArray[np.float64], works: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return how often the tool passes over each cell of `area.grid`, on a polyline `points` (n, >= 2) (m).

    `works` (n,) or (n - 1,): whether the tool works from a point to the next one. To turn in place, or to pass on, is one
    visit; a second one counts after a way of more than the width of the tool without it.
    """
    visits = np.zeros(area.grid.shape, np.int32)
    if len(points) > 1:
        last = np.full(area.grid.shape, LEFT)
        radius = 0.5 * area.operation_width / area.grid.resolution
        sweep(area.to_grid(points), np.ascontiguousarray(works), radius, 0.5, visits, last, 0.0)
    return visits


def figures_of(
    area: Area, points: NDArray[np.float64], works: NDArray[np.bool_], visits: NDArray[np.int32] | None = None
) -> CoverageFigures:
    """Return the figures of a polyline; arguments as of `visits_of`."""
    if visits is None:
        visits = visits_of(area, points, works)
    inside = visits[area.reachable]
    covered, swept = int((inside > 0).sum()), int(inside.sum())
    lengths = np.hypot(*np.diff(points[:, :2], axis=0).T) if len(points) > 1 else np.zeros(0)
    at_work = works[: len(lengths)]
    return CoverageFigures(
        reachable_m2=area.reachable_m2,
        covered_m2=covered * area.cell_area,
        overlap=swept / covered - 1.0 if covered else 0.0,
        work_m=float(lengths[at_work].sum()),
        travel_m=float(lengths[~at_work].sum()),
        turns=turns_of(points),
    )


def turns_of(points: NDArray[np.float64]) -> int:
    """Return the number of corners of a polyline that exceed TURN_RAD."""
    steps = np.diff(points[:, :2], axis=0)
    steps = steps[np.hypot(*steps.T) > 1e-6] if len(steps) else steps
    headings = np.arctan2(steps[:, 1], steps[:, 0]) if len(steps) else np.zeros(0)
    return sum(abs(angle_between(a, b)) > TURN_RAD for a, b in zip(headings[:-1].tolist(), headings[1:].tolist()))


@dataclass(frozen=True, slots=True)
class LeftPart:
    """A connected part of the reachable area that the tool has not covered."""

    x: float
    """Its middle cell (m)."""
    y: float
    area_m2: float
    reason: str

    def as_dict(self) -> dict[str, Any]:
        """Return the part as JSON data."""
        return asdict(self)


def left_in(
    area: Area,
    visits: NDArray[np.int32],
    *,
    planned: NDArray[np.int32] | None = None,
    blocked: NDArray[np.bool_] | None = None,
    ahead: NDArray[np.int32] | None = None,
    least_m2: float = 0.0,
) -> list[LeftPart]:
    """Return what `visits` leave of the reachable area, the largest part first, with the reason of most of its cells.

    `planned`: the visits of the plan that was driven. `blocked` (as `area.reachable`): where an obstacle, which the map does not
    contain, was in the way. `ahead`: the visits of what was still to be driven. Parts below `least_m2` (m²) are left out.
    """
    from scipy import ndimage

    left = area.reachable & (visits == 0)
    labels, number = regions_of(left)
    if not number:
        return []
    kinds = np.zeros(left.shape, np.int8)
    if planned is not None:
        kinds[planned > 0] = 1
    if blocked is not None:
        kinds[blocked] = 2
    if ahead is not None:
        kinds[ahead > 0] = 3
    parts: list[LeftPart] = []
    for k, window in enumerate(ndimage.find_objects(labels), 1):
        inside = labels[window] == k
        size = int(inside.sum()) * area.cell_area
        if size < least_m2:
            continue
        ys, xs = np.nonzero(inside)
        middle = len(ys) // 2
        kind = int(np.bincount(kinds[window][inside], minlength=4).argmax())
        x, y = area.grid.cell_to_world(window[1].start + int(xs[middle]), window[0].start + int(ys[middle]))
        parts.append(LeftPart(x, y, size, REASONS[kind]))
    return sorted(parts, key=lambda part: (-part.area_m2, part.x, part.y))
