"""Global search: all poses of a map from which a scan agrees with it, without a guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.localization._search_kernels import block_bounds, search_blocks
from navstack.localization.beams import Beams
from navstack.localization.match_map import MatchMap

MAX_BEAMS: Final = 255
"""A score is a sum of this many values of 8 bits in 16 bits."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """Poses found by a search, best first, in the grid frame."""

    poses: NDArray[np.float64]
    """(n, 3) x, y (m), yaw (rad): centres of cells, multiples of the angular step."""
    scores: NDArray[np.float64]
    """(n,) mean likelihood of the beams, 0 to 1."""
    blocks_searched: int
    complete: bool
    """True if no other bin of poses can have a higher score than the last one here; False if the budget ended the search."""


def search_scan(
    match_map: MatchMap,
    beams: Beams,
    *,
    keep: int = 200,
    beam_count: int = 180,
    angular_step: float = float(np.pi / 180.0),
    budget: int = 60_000,
    lowest: float = 0.3,
) -> SearchResult:
    """Search all positions in free space and all headings of the map for those that explain the scan.

    `keep`: number of bins (4 x 4 cells x 10 degrees) kept separate, each with its best pose; `beam_count`: beams used, at
    most 255; `budget`: blocks of poses that are searched at most; `lowest`: score from which a pose counts. Deterministic.
    """
    field = match_map.pyramid
    every = beams.points
    near = np.hypot(every[:, 0], every[:, 1]) < field.reach
    points = every[near]
    count = min(beam_count, MAX_BEAMS)
    if len(points) > count:
        points = points[np.linspace(0, len(points) - 1, count).astype(np.intp)]
    if len(points) == 0:
        return SearchResult(np.empty((0, 3)), np.empty(0), 0, True)
    points = np.ascontiguousarray(points)
    headings = angular_step * np.arange(max(1, round(2.0 * np.pi / angular_step)))
    bounds = block_bounds(field.phases, field.has_free, points, headings, field.resolution, field.pad)
    full = 255.0 * len(points)
    sector = max(1, round(np.pi / 18.0 / angular_step))
    settings = np.array([field.resolution, field.pad, keep, sector, budget, max(1.0, np.floor(lowest * full))])
    found, searched, complete = search_blocks(
        field.padded, field.free, field.has_free, bounds, points, headings, settings
    )
    order = np.lexsort((found[:, 3], found[:, 2], found[:, 1], -found[:, 0]))
    found = found[order]
    poses = np.empty((len(found), 3))
    poses[:, 0] = (found[:, 2] + 0.5) * field.resolution
    poses[:, 1] = (found[:, 1] + 0.5) * field.resolution
    poses[:, 2] = headings[found[:, 3]]
    return SearchResult(poses, found[:, 0] / full, int(searched), bool(complete))
