"""Global search: all poses of a map from which a scan agrees with it, without a guess."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, MapError, OccupancyGrid, Transform2D, kernel

# ----------------------------------------------------------------------------------------------------------------------
# Branch and bound over all poses of a map: scores of a scan, and their upper bounds for blocks of poses.
#
# Idea: Olson (Real-Time Correlative Scan Matching, ICRA 2009) and Hess et al. (Real-Time Loop Closure in 2D LIDAR SLAM, ICRA
# 2016). The score of a pose is the sum of the field (uint8) at the cells where the beams end. The bound of a block of
# `STRIDE` x `STRIDE` poses sums, for each beam, the largest value in the block of cells where it can end. The blocks' maxima are
# stored by phase: all blocks of one heading then see a beam at a constant distance in memory, and a heading is a sum of shifted
# arrays, which the processor adds 16 or 32 at a time.


# pyright: basic


STRIDE = 4
"""Cells per side of a block."""


@kernel
def block_maxima(padded):
    """Return (STRIDE, STRIDE, rows, columns) uint8: the largest value of each block of cells, by the phase of its corner.

    `padded` (rows * STRIDE, columns * STRIDE) uint8. Element [a, b, y, x] covers the cells from (STRIDE y + a, STRIDE x + b) on.
    """
    ny, nx = padded.shape
    along = padded.copy()
    for iy in range(ny):
        for ix in range(nx):
            best = padded[iy, ix]
            for k in range(1, min(STRIDE, nx - ix)):
                if padded[iy, ix + k] > best:
                    best = padded[iy, ix + k]
            along[iy, ix] = best
    phases = np.empty((STRIDE, STRIDE, ny // STRIDE, nx // STRIDE), np.uint8)
    for iy in range(ny):
        for ix in range(nx):
            best = along[iy, ix]
            for k in range(1, min(STRIDE, ny - iy)):
                if along[iy + k, ix] > best:
                    best = along[iy + k, ix]
            phases[iy % STRIDE, ix % STRIDE, iy // STRIDE, ix // STRIDE] = best
    return phases


@kernel
def beam_cells(points, yaw, resolution, pad, out):
    """Write the cells (n, 2) = y, x where the beams end, relative to the pose's cell and shifted by `pad`, at a heading."""
    c, s = math.cos(yaw) / resolution, math.sin(yaw) / resolution
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        out[i, 0] = math.floor(s * x + c * y + 0.5) + pad
        out[i, 1] = math.floor(c * x - s * y + 0.5) + pad


@kernel
def add_four(total, a, b, c, d):
    """Add four arrays (n,) uint8 to `total` (n,) uint16."""
    for k in range(total.shape[0]):
        total[k] += np.uint16(a[k]) + np.uint16(b[k]) + np.uint16(c[k]) + np.uint16(d[k])


@kernel
def add_one(total, a):
    """Add an array (n,) uint8 to `total` (n,) uint16."""
    for k in range(total.shape[0]):
        total[k] += np.uint16(a[k])


@kernel
def block_bounds(phases, has_free, points, headings, resolution, pad):
    """Return (headings, rows * columns) uint16: upper bounds of the scores in each block of poses, 0 for blocks without any.

    `phases`: of `block_maxima`, for a field with `pad` empty cells (a multiple of STRIDE) around it; `points` (n, 2): ends of
    the beams in the base frame (m), n <= 255, each nearer than pad - STRIDE cells; `has_free` (rows, ..) uint8: 1 for the blocks
    that contain free cells.
    """
    columns = phases.shape[3]
    rows = has_free.shape[0]
    mask = np.zeros(rows * columns, np.uint16)
    for j in range(rows):
        for i in range(has_free.shape[1]):
            mask[j * columns + i] = has_free[j, i]
    size = phases.shape[2] * columns
    flat = phases.ravel()
    n = points.shape[0]
    count = rows * columns - 2 * (pad // STRIDE)  # the blocks from the last pose on are beyond the map
    bounds = np.zeros((headings.shape[0], rows * columns), np.uint16)
    cells = np.empty((n, 2), np.int64)
    first = np.empty(n, np.int64)
    for h in range(headings.shape[0]):
        beam_cells(points, headings[h], resolution, pad, cells)
        for i in range(n):
            y, x = cells[i, 0], cells[i, 1]
            phase = (y % STRIDE) * STRIDE + x % STRIDE
            first[i] = phase * size + (y // STRIDE) * columns + x // STRIDE
        total = bounds[h, :count]
        i = 0
        while i + 4 <= n:
            a, b, c, d = first[i], first[i + 1], first[i + 2], first[i + 3]
            add_four(total, flat[a : a + count], flat[b : b + count], flat[c : c + count], flat[d : d + count])
            i += 4
        while i < n:
            add_one(total, flat[first[i] : first[i] + count])
            i += 1
        for k in range(count):
            total[k] *= mask[k]
    return bounds


@kernel
def best_in_block(padded, free, cells, row, column, sums):
    """Return (score, iy, ix) of the best pose in free space in a block; score -1 if it has none.

    `sums` (STRIDE * STRIDE,) uint16 is scratch space.
    """
    sums[:] = 0
    y0, x0 = row * STRIDE, column * STRIDE
    for i in range(cells.shape[0]):
        y, x = y0 + cells[i, 0], x0 + cells[i, 1]
        for a in range(STRIDE):
            line = padded[y + a, x : x + STRIDE]
            into = sums[a * STRIDE : (a + 1) * STRIDE]
            for b in range(STRIDE):
                into[b] += np.uint16(line[b])
    best, by, bx = np.int64(-1), 0, 0
    ny, nx = free.shape
    for a in range(min(STRIDE, ny - y0)):
        for b in range(min(STRIDE, nx - x0)):
            if free[y0 + a, x0 + b] != 0 and np.int64(sums[a * STRIDE + b]) > best:
                best, by, bx = np.int64(sums[a * STRIDE + b]), y0 + a, x0 + b
    return best, by, bx


@kernel
def order_by_bound(bounds, lowest, budget):
    """Return (order, floor): the flat indices of all bounds of at least `floor`, in descending order of the bounds.

    `floor` >= `lowest` is chosen from a sample such that there are about `budget` of them.
    """
    width = bounds.shape[1]
    counts = np.zeros(65537, np.int64)
    step = 7
    for h in range(bounds.shape[0]):
        for k in range(h % step, width, step):
            counts[bounds[h, k]] += step
    floor, above = np.int64(65535), np.int64(0)
    while floor > lowest and above + counts[floor] <= budget:
        above += counts[floor]
        floor -= 1
    floor = max(floor, lowest)
    counts[:] = 0
    n = 0
    for h in range(bounds.shape[0]):
        row = bounds[h]
        for k in range(width):
            if row[k] >= floor:
                n += 1
    chosen = np.empty(n, np.int64)
    n = 0
    for h in range(bounds.shape[0]):
        row = bounds[h]
        for k in range(width):
            if row[k] >= floor:
                chosen[n] = h * width + k
                n += 1
                counts[65536 - np.int64(row[k])] += 1
    for v in range(1, 65537):
        counts[v] += counts[v - 1]
    order = np.empty(n, np.int64)
    for i in range(n):
        at = 65535 - np.int64(bounds[chosen[i] // width, chosen[i] % width])
        order[counts[at]] = chosen[i]
        counts[at] += 1
    return order, floor


@kernel
def search_blocks(padded, free, has_free, bounds, points, headings, settings):
    """Return (found (m, 4), expanded, complete): the best pose in each of the `keep` best bins, rows score, iy, ix, heading.

    A bin is a block of positions and `sector` neighboring headings. Blocks are searched in the order of their bounds until no
    bound exceeds the score of the last bin that is kept, or until about `budget` blocks were searched (`complete` False).
    `settings` = [resolution, pad, keep, sector, budget, lowest].
    """
    resolution, pad = settings[0], np.int64(settings[1])
    keep, sector, budget = np.int64(settings[2]), np.int64(settings[3]), np.int64(settings[4])
    width = bounds.shape[1]
    rows, columns = has_free.shape
    stride = width // rows
    order, floor = order_by_bound(bounds, np.int64(settings[5]), budget)
    n_headings, n = headings.shape[0], points.shape[0]
    cells = np.empty((n_headings, n, 2), np.int64)
    for h in range(n_headings):
        beam_cells(points, headings[h], resolution, pad, cells[h])
    sectors = (n_headings + sector - 1) // sector
    best = np.zeros((sectors, rows * columns, 4), np.int64)
    at_least = np.zeros(65536, np.int64)  # number of bins by score
    threshold, above = np.int64(settings[5]), 0
    sums = np.empty(STRIDE * STRIDE, np.uint16)
    expanded = 0
    for i in range(order.shape[0]):
        h, k = order[i] // width, order[i] % width
        if np.int64(bounds[h, k]) < threshold:
            break
        expanded += 1
        row, column = k // stride, k % stride
        score, iy, ix = best_in_block(padded, free, cells[h], row, column, sums)
        entry = best[h // sector, row * columns + column]
        if score < threshold or score <= entry[0]:
            continue
        if entry[0] >= threshold and entry[0] > 0:
            at_least[entry[0]] -= 1
            above -= 1
        entry[0], entry[1], entry[2], entry[3] = score, iy, ix, h
        at_least[score] += 1
        above += 1
        while above - at_least[threshold] >= keep:
            above -= at_least[threshold]
            threshold += 1
    found = np.empty((max(above, 1), 4), np.int64)
    m = 0
    for a in range(sectors):
        for k in range(rows * columns):
            if best[a, k, 0] >= threshold and best[a, k, 0] > 0 and m < above:
                found[m] = best[a, k]
                m += 1
    return found[:m], expanded, threshold >= floor


# ----------------------------------------------------------------------------------------------------------------------
# A map prepared for matching scans: distance field, free cells, bounds of the global search.


OCCUPIED: Final = 65
"""From this occupancy on, a cell is an obstacle (map_server's occupied_thresh)."""

MAX_DISTANCE: Final = 2.0
"""The distance field ends here (m)."""


class MatchMap:
    """A map for matching. Poses and points are in the grid frame: x along the columns, origin in the corner of cell (0, 0)."""

    def __init__(self, grid: OccupancyGrid, *, search_resolution: float = 0.1, reach: float = 30.0) -> None:
        """`search_resolution`: cells of the global search, at least those of the map (m); `reach`: of its beams (m).

        Raises MapError for a map without obstacles or without free cells.
        """
        from scipy.ndimage import distance_transform_edt  # slow import

        g = grid.geometry
        occupied = np.asarray(grid.data >= OCCUPIED)
        self.free: NDArray[np.bool_] = np.asarray(grid.data == 0)
        for cells, name in ((occupied, "obstacle"), (self.free, "free cell")):
            if not cells.any():
                raise MapError(
                    f"the map has no {name}, so no scan can be matched with it; check negate and the thresholds of its YAML file"
                )
        self.grid = grid
        self.resolution = g.resolution
        self.frame = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
        """Pose of the grid frame in the map frame."""
        distance: Any = distance_transform_edt(~occupied)
        self.field: NDArray[np.float32] = np.minimum(distance * g.resolution, MAX_DISTANCE).astype(np.float32)
        """(ny, nx) distance of each cell to the nearest obstacle, center to center (m), at most MAX_DISTANCE."""
        self.reach = reach
        self._occupied = occupied
        self._factor = max(1, math.floor(search_resolution / g.resolution + 1e-6))

    def to_grid(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses (n, 3) of the map frame in the grid frame."""
        return self.frame.inverse().apply_poses(poses)

    def to_map(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses (n, 3) of the grid frame in the map frame."""
        return self.frame.apply_poses(poses)

    @cached_property
    def likely(self) -> NDArray[np.float32]:
        """(ny, nx) likelihood of a beam's end in each cell, 1 at an obstacle."""
        sigma = max(SIGMA_M, self.resolution)
        return np.exp(-0.5 * (self.field / np.float32(sigma)) ** 2)

    @cached_property
    def pyramid(self) -> SearchField:
        """The field of the global search."""
        n = self._factor
        return SearchField(_any(self._occupied, n), _any(self.free, n), n * self.resolution, self.reach)


class SearchField:
    """Likelihoods (uint8) at the resolution of the search, with empty cells around them, and their maxima by blocks."""

    def __init__(self, occupied: NDArray[np.bool_], free: NDArray[np.bool_], resolution: float, reach: float) -> None:
        """`occupied`, `free` (ny, nx): cells of `resolution` (m); `reach`: greatest length of a beam (m)."""
        from scipy.ndimage import distance_transform_edt  # slow import

        self.resolution = resolution
        sigma = max(SIGMA_M, self.resolution)
        distance: Any = distance_transform_edt(~occupied)
        field = np.round(255.0 * np.exp(-0.5 * (distance * self.resolution / sigma) ** 2)).astype(np.uint8)
        ny, nx = field.shape
        rows, columns = -(-ny // STRIDE), -(-nx // STRIDE)
        diagonal = math.hypot(*field.shape) * self.resolution
        self.reach = min(reach, diagonal)
        self.pad = (math.ceil(self.reach / self.resolution) // STRIDE + 3) * STRIDE
        self.padded: NDArray[np.uint8] = np.zeros(
            (rows * STRIDE + 2 * self.pad, columns * STRIDE + 2 * self.pad), np.uint8
        )
        self.padded[self.pad : self.pad + ny, self.pad : self.pad + nx] = field
        self.phases = block_maxima(self.padded)
        self.free = (free & ~occupied).astype(np.uint8)
        blocks = np.zeros((rows * STRIDE, columns * STRIDE), np.uint8)
        blocks[:ny, :nx] = self.free
        self.has_free: NDArray[np.uint8] = np.ascontiguousarray(
            blocks.reshape(rows, STRIDE, columns, STRIDE).max(axis=(1, 3))
        )


SIGMA_M: Final = 0.2
"""Width of the likelihood in the search (m): twice the cells of 0.1 m, so that a pose between two cells keeps its score."""


def _any(cells: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return the cells at a resolution coarser by `factor`: true where one of them is."""
    if factor == 1:
        return cells
    ny, nx = (-(-n // factor) for n in cells.shape)
    padded = np.zeros((ny * factor, nx * factor), np.bool_)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(np.any(padded.reshape(ny, factor, nx, factor), axis=(1, 3)))


# ----------------------------------------------------------------------------------------------------------------------
# The beams of a scan in the base frame, as the matching kernels take them.


FEWEST: Final = 10
"""With fewer beams in common, two scans are not compared."""


class Beams(NamedTuple):
    """Valid beams of a scan."""

    ends: NDArray[np.float64]
    """(m, 3) end in the base frame (m), and 1 for a return or 0 for none: then the end is where the range ends."""
    eye: NDArray[np.float64]
    """(2,) the sensor in the base frame (m)."""

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 2) ends of the beams with a return."""
        return np.ascontiguousarray(self.ends[self.ends[:, 2] > 0.0, :2])

    def thinned(self, count: int) -> Beams:
        """Return at most `count` of the beams, evenly spaced."""
        m = len(self.ends)
        if m <= count:
            return self
        return Beams(self.ends[np.linspace(0, m - 1, count).astype(np.intp)], self.eye)


def scan_beams(scan: LaserScan, sensor: Transform2D, reach: float = np.inf) -> Beams:
    """Return the beams of `scan` by a sensor at `sensor` in the base frame.

    Beams that end at `reach` (m) or the scan's `range_max` or beyond have no return; they end there. NaN, negative ranges and
    those below `range_min` are invalid and left out.
    """
    ranges = np.asarray(scan.ranges, np.float64)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges)) + sensor.yaw
    valid = (ranges >= scan.range_min) & (ranges > 0.0)
    limit = min(scan.range_max, reach)
    returned = ranges < limit
    length = np.where(returned, ranges, limit)[valid]
    if not np.isfinite(limit):
        keep = np.isfinite(length)
        valid[valid] = keep
        length = length[keep]
    ends = np.column_stack(
        (
            sensor.x + length * np.cos(angles[valid]),
            sensor.y + length * np.sin(angles[valid]),
            returned[valid].astype(np.float64),
        )
    )
    return Beams(ends, np.array([sensor.x, sensor.y]))


def continuity(before: Beams, now: Beams, step: Transform2D) -> float | None:
    """Return the share of the beams `now` that end where the scan `before` saw something, or saw as far.

    `step` is the motion between the scans, by the odometry: the base now in the base before. Ranges in the same direction are
    compared, with a tolerance of 0.2 m and 5 %; two directions next to a beam count, so that corners which the motion hides or
    shows agree. None if the scans have fewer than `FEWEST` directions in common.
    """
    if len(before.ends) < 2 or len(now.ends) == 0:
        return None
    seen = step.inverse().apply_points(np.ascontiguousarray(before.ends[:, :2])) - now.eye
    bearings, ranges = np.arctan2(seen[:, 1], seen[:, 0]), np.hypot(seen[:, 0], seen[:, 1])
    order = np.argsort(bearings, kind="stable")
    bearings, ranges = bearings[order], ranges[order]
    beams = now.ends[:, :2] - now.eye
    bearing, length = np.arctan2(beams[:, 1], beams[:, 0]), np.hypot(beams[:, 0], beams[:, 1])
    k = np.searchsorted(bearings, bearing)
    common = (k > 0) & (k < len(bearings))
    if int(common.sum()) < FEWEST:
        return None
    k, length = k[common], length[common]
    tolerance = 0.2 + 0.05 * length
    low, high = np.minimum(ranges[k - 1], ranges[k]), np.maximum(ranges[k - 1], ranges[k])
    return float(((length > low - tolerance) & (length < high + tolerance)).mean())


MAX_BEAMS: Final = 255
"""A score is a sum of this many values of 8 bits in 16 bits."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """Poses found by a search, best first, in the grid frame."""

    poses: NDArray[np.float64]
    """(n, 3) x, y (m), yaw (rad): centers of cells, multiples of the angular step."""
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
