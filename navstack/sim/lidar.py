"""Lidars and sonars: exact ranges of a world, with noise that depends only on the seed and the number of the scan."""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core import DeferredScan, LaserScan, PointCloud, Pose2D, RangeReading, Transform2D, kernel, plain_kernel
from navstack.parameters import LidarParams, SonarParams
from navstack.sim.solids import Solids, polygon_contains
from navstack.sim.world import World

# --- rays -------------------------------------------------------------------------------------------------------------
# Exact, without a step length. On the grid, a ray leaps to the far border of a free rectangle (`map_cells.free_rectangles`).
# For rectangles of one cell this is the step of Amanatides and Woo (A Fast Voxel Traversal Algorithm for Ray Tracing,
# Eurographics 1987), so the first occupied cell on the ray and the point where the ray enters it are the same as in a walk
# through every cell.


SCAN = np.dtype(
    [
        ("height", "f8"),  # of the sensor above the ground, m
        ("angle_min", "f8"),  # direction of the first beam, rad
        ("angle_increment", "f8"),  # between beams, rad
        ("range_min", "f8"),  # m
        ("range_max", "f8"),  # m
    ]
)
"""Element type of the settings of `sweep`."""


@plain_kernel
def enter_map(nx, ny, x, y, dx, dy):
    """Where a ray from outside enters the map: distance (cells), ix, iy of the first cell. The distance is inf if it misses."""
    tx0, tx1 = -math.inf, math.inf
    if dx != 0.0:
        tx0, tx1 = min(-x / dx, (nx - x) / dx), max(-x / dx, (nx - x) / dx)
    elif x < 0.0 or x >= nx:
        return math.inf, 0, 0
    ty0, ty1 = -math.inf, math.inf
    if dy != 0.0:
        ty0, ty1 = min(-y / dy, (ny - y) / dy), max(-y / dy, (ny - y) / dy)
    elif y < 0.0 or y >= ny:
        return math.inf, 0, 0
    t = max(tx0, ty0)
    if t < 0.0 or t > min(tx1, ty1):
        return math.inf, 0, 0
    if tx0 > ty0:
        return t, 0 if dx > 0.0 else nx - 1, min(max(math.floor(y + t * dy), 0), ny - 1)
    return t, min(max(math.floor(x + t * dx), 0), nx - 1), 0 if dy > 0.0 else ny - 1


@plain_kernel
def cast_ray(leaps, ny, nx, x, y, dx, dy, reach):
    """Distance (cells) from (x, y) (cells) along the unit vector (dx, dy) to the first occupied cell; inf beyond `reach`.

    `leaps`: the flattened table (`free_rectangles`) of a map of `ny` times `nx` cells.
    """
    t = 0.0
    ix, iy = 0, 0
    if 0.0 <= x < nx and 0.0 <= y < ny:
        ix, iy = int(x), int(y)
    else:
        t, ix, iy = enter_map(nx, ny, x, y, dx, dy)
        if t > reach:
            return math.inf
    right, up = dx >= 0.0, dy >= 0.0
    along_x = abs(dx) >= abs(dy)
    octant = (0 if right else 2) + (0 if up else 4) + (0 if along_x else 1)
    first = octant * ny * nx
    longer_x, longer_y = (2, 0) if along_x else (0, 2)
    per_x = 1.0 / dx if dx != 0.0 else math.inf
    per_y = 1.0 / dy if dy != 0.0 else math.inf
    while True:
        leap = np.int64(leaps[np.uint64(first + iy * nx + ix)])
        if leap == 0:
            return t
        w = (leap & 127) << (longer_x if leap > 127 else 0)
        h = (leap & 127) << (longer_y if leap > 127 else 0)
        tx = ((ix + w if right else ix + 1 - w) - x) * per_x
        ty = ((iy + h if up else iy + 1 - h) - y) * per_y
        # cross the nearer border; rounding must not push the ray out of the rectangle sideways
        if tx < ty:
            t = tx
            along = int(y + t * dy)
            iy = min(max(along, iy), iy + h - 1) if up else max(min(along, iy), iy - h + 1)
            ix = ix + w if right else ix - w
        else:
            t = ty
            along = int(x + t * dx)
            ix = min(max(along, ix), ix + w - 1) if right else max(min(along, ix), ix - w + 1)
            iy = iy + h if up else iy - h
        if t > reach or ix < 0 or iy < 0 or ix >= nx or iy >= ny:
            return math.inf


@plain_kernel
def see_edge(ranges, beams, ax, ay, bx, by, angle_min, angle_increment):
    """Shortens the `ranges` (n,) of the beams that intersect the segment from a to b, both in the sensor's frame (m)."""
    n = beams.shape[0]
    area = ax * by - ay * bx
    if area < 0.0:
        ax, ay, bx, by, area = bx, by, ax, ay, -area
    elif area == 0.0:
        return  # parallel to the beam: the neighboring edges share its ends
    begin = math.atan2(ay, ax)
    span = math.atan2(area, ax * bx + ay * by)
    for turn in range(-1, 2):
        first = (begin + 2.0 * math.pi * turn - angle_min) / angle_increment
        last = first + span / angle_increment
        if last < -1.0 or first > n:
            continue
        for i in range(max(0, math.floor(first)), min(n - 1, math.ceil(last)) + 1):
            dx, dy = beams[i, 0], beams[i, 1]
            after, before = ax * dy - ay * dx, dx * by - dy * bx
            if after >= 0.0 and before >= 0.0 and after + before > 0.0:
                ranges[i] = min(ranges[i], area / (after + before))


# largest error of `rough_angle`, rad
ROUGH = 2e-5
# largest value of (asin(q) - q) / q^3, at q = 1
ARCSINE = 0.5 * math.pi - 1.0


@plain_kernel
def rough_angle(x, y):
    """Angle (rad) of the vector (x, y), not zero, to within `ROUGH`: a third of the time of atan2.

    The polynomial is 4.4.49 of Abramowitz and Stegun, Handbook of Mathematical Functions; its error is at most 1e-5.
    """
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(ax, ay)
    q = t * t
    angle = t * (0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351))))
    if ay > ax:
        angle = 0.5 * math.pi - angle
    if x < 0.0:
        angle = math.pi - angle
    return angle if y >= 0.0 else -angle


@plain_kernel
def beams_towards(cx, cy, r, d2, scan):
    """First and last beam, as real numbers, of the window towards a circle around (cx, cy) (m, sensor's frame).

    `r`: its radius (m); `d2`: the square of its distance, not less than r^2. The window errs to the outside: the angles are
    rough, and asin(q) <= q + (pi / 2 - 1) q^3. It ends within the first turn; the same window follows in each further turn.
    """
    per_radian = 1.0 / scan.angle_increment
    turn = 2.0 * math.pi * per_radian
    q = r / math.sqrt(d2)
    half = (q + ARCSINE * q * q * q + ROUGH) * per_radian
    center = (rough_angle(cx, cy) - scan.angle_min) * per_radian
    center -= turn * np.floor((center + half) * (1.0 / turn))
    return center - half, center + half


@plain_kernel
def is_hidden(ranges, cx, cy, r, d2, scan):
    """True if all beams towards a circle end before it: what is inside cannot shorten them. Arguments: see `beams_towards`."""
    n = ranges.shape[0]
    first, last = beams_towards(cx, cy, r, d2, scan)
    turn = 2.0 * math.pi / scan.angle_increment
    nearest = math.sqrt(d2) - r
    while first <= n - 1:
        for i in range(max(0, math.ceil(first)), min(n - 1, math.floor(last)) + 1):
            if ranges[i] > nearest:
                return False
        first, last = first + turn, last + turn
    return True


@plain_kernel
def disc_windows(discs, eye, scan, windows):
    """Writes to `windows` (6, k) of each disc (k, 3) in the map (m): first and last beam (`beams_towards`), its center in the
    sensor's frame (m), its radius (m) and the square of its distance (m^2).
    """
    x, y = eye[0], eye[1]
    c, s = math.cos(eye[2]), math.sin(eye[2])
    number = np.uint64(discs.shape[0])
    # without branches, and along contiguous arrays, so that the loop is vectorized
    for k in range(number):
        windows[2, k], windows[3, k], windows[4, k] = discs[k, 0], discs[k, 1], discs[k, 2]
    for k in range(number):
        wx, wy, r = windows[2, k] - x, windows[3, k] - y, windows[4, k]
        d2 = wx * wx + wy * wy
        cx, cy = c * wx + s * wy, c * wy - s * wx
        windows[0, k], windows[1, k] = beams_towards(cx, cy, r, d2, scan)
        windows[2, k], windows[3, k], windows[5, k] = cx, cy, d2


@plain_kernel
def see_discs(ranges, beams, discs, tops, eye, scan, reach, windows, seen):
    """Shortens the `ranges` (n,) of the beams that hit one of the discs (k, 3) in the map (m), of the heights `tops`.

    The test of a beam is exact, and only the beams between the two tangents need it (`beams_towards`). All windows of beams are
    computed before any beam is tested: the processor cannot predict how many beams a disc has, and must not wait for an angle to
    find out. `windows` (6, k) and `seen` (k,) are scratch.
    """
    n = beams.shape[0]
    turn = 2.0 * math.pi / scan.angle_increment
    disc_windows(discs, eye, scan, windows)
    number, is_inside = 0, False
    for k in range(discs.shape[0]):
        r, d2, is_high = windows[4, k], windows[5, k], tops[k] >= scan.height
        is_inside |= is_high and d2 <= r * r
        seen[number] = k
        # False for a disc that is absent
        number += 1 if is_high and d2 <= (reach + r) * (reach + r) and windows[0, k] <= n - 1 else 0
    if is_inside:
        ranges[:] = 0.0
        return
    for j in range(number):
        k = seen[j]
        first, last, cx, cy = windows[0, k], windows[1, k], windows[2, k], windows[3, k]
        r, d2 = windows[4, k], windows[5, k]
        while first <= n - 1:
            for i in range(max(0, math.ceil(first)), min(n - 1, math.floor(last)) + 1):
                b = cx * beams[i, 0] + cy * beams[i, 1]
                h = r * r - (d2 - b * b)
                is_hit = (h >= 0.0) & (b > 0.0)  # without a branch, which nothing could predict at the edges of a disc
                hit = b - math.sqrt(h if is_hit else 0.0)
                ranges[i] = hit if is_hit & (hit < ranges[i]) else ranges[i]
            first, last = first + turn, last + turn


@kernel
def see_polygon(ranges, beams, corners, eye, angle_min, angle_increment):
    """Shortens the `ranges` (n,) of the beams that hit the polygon `corners` (m, 2) (map frame, m)."""
    x, y = eye[0], eye[1]
    c, s = math.cos(eye[2]), math.sin(eye[2])
    m = corners.shape[0]
    wx, wy = corners[m - 1, 0] - x, corners[m - 1, 1] - y
    ax, ay = c * wx + s * wy, c * wy - s * wx
    for j in range(m):
        wx, wy = corners[j, 0] - x, corners[j, 1] - y
        bx, by = c * wx + s * wy, c * wy - s * wx
        see_edge(ranges, beams, ax, ay, bx, by, angle_min, angle_increment)
        ax, ay = bx, by


@kernel
def measured_ranges(ranges, noise, range_min, range_max):
    """(n,) float32 ranges of a scan from the true ones: noise, lost beams and range limits (see `sweep`)."""
    n = ranges.shape[0]
    out = np.empty(n, np.float32)
    for i in range(n):
        measured = ranges[i]
        if noise.shape[0] > 0:
            measured += noise[0, i]
        if noise.shape[0] > 1 and noise[1, i] == 0.0:
            out[i] = np.float32(np.nan)
        elif measured > range_max:
            out[i] = np.float32(np.inf)
        elif measured < range_min:
            out[i] = np.float32(-np.inf)
        else:
            out[i] = np.float32(measured)
    return out


@kernel
def sweep(leaps, grid, discs, circles, corners, first, tops, eye, beams, settings, noise):
    """One scan (n,) float32 from the sensor's pose `eye` (x, y, yaw) in the map (m, rad), a tuple.

    `leaps`: table of the map (`free_rectangles`); `grid` = [origin x, origin y, origin yaw, resolution]; `discs` .. `tops` as in
    `Solids`; `beams` (n, 2) unit vectors in the sensor's frame at equal angular distances; `settings` (1,) of type `SCAN`;
    `noise` (0, n): none, (1, n): errors of the ranges (m), (2, n): in row 1, 0 marks a lost beam (NaN). Hits nearer
    than `range_min` give -inf, beams without a hit up to `range_max` +inf (REP 117).
    """
    scan = settings[0]
    height, angle_min, angle_increment = scan.height, scan.angle_min, scan.angle_increment
    x, y, yaw = eye[0], eye[1], eye[2]
    n = beams.shape[0]
    ranges = np.empty(n)
    reach = scan.range_max
    if noise.shape[0] > 0:
        for i in range(n):
            reach = max(reach, scan.range_max - noise[0, i])  # noise can bring a hit just beyond into the range
    resolution = grid[3]
    _, ny, nx = leaps.shape
    flat = leaps.ravel()
    c, s = math.cos(grid[2]), math.sin(grid[2])
    px = (c * (x - grid[0]) + s * (y - grid[1])) / resolution
    py = (c * (y - grid[1]) - s * (x - grid[0])) / resolution
    c, s = math.cos(yaw - grid[2]), math.sin(yaw - grid[2])
    has_map = nx * ny > 1 or flat[0] == 0  # a world without a map has one free cell
    for i in range(n):
        dx = c * beams[i, 0] - s * beams[i, 1]
        dy = s * beams[i, 0] + c * beams[i, 1]
        hit = cast_ray(flat, ny, nx, px, py, dx, dy, reach / resolution) if has_map else math.inf
        ranges[i] = resolution * hit
    count = discs.shape[0]
    see_discs(ranges, beams, discs, tops, eye, scan, reach, np.empty((6, count)), np.empty(count, np.int64))
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(circles.shape[0]):
        wx, wy, r = circles[k, 0] - x, circles[k, 1] - y, circles[k, 2]
        d2 = wx * wx + wy * wy
        if tops[discs.shape[0] + k] < height or d2 > (reach + r) * (reach + r):
            continue
        polygon = corners[first[k] : first[k + 1]]
        if d2 <= r * r and polygon_contains(polygon, x, y):
            ranges[:] = 0.0
            continue
        if d2 > r * r and is_hidden(ranges, c * wx + s * wy, c * wy - s * wx, r, d2, scan):
            continue
        see_polygon(ranges, beams, polygon, eye, angle_min, angle_increment)
    return measured_ranges(ranges, noise, scan.range_min, scan.range_max)


def scan_settings(
    height: float, angle_min: float, angle_increment: float, range_min: float, range_max: float
) -> NDArray[np.void]:
    """Returns the settings of a scan (m, rad) as an array (1,) of type `SCAN`."""
    return np.array([(height, angle_min, angle_increment, range_min, range_max)], SCAN)


class Lidar:
    """A planar range finder. Computes scans of a world from poses of the robot."""

    def __init__(self, params: LidarParams, *, seed: int, number: int) -> None:
        """`number` distinguishes the lidars of a robot: each has its own random stream."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        angles = params.angle_min + params.angle_increment * np.arange(params.beams)
        self._beams: NDArray[np.float64] = np.column_stack((np.cos(angles), np.sin(angles)))
        self._settings = scan_settings(
            params.height, params.angle_min, params.angle_increment, params.range_min, params.range_max
        )
        self._angle_min, self._angle_increment = params.angle_min, params.angle_increment
        self._no_noise = np.empty((0, params.beams))
        self._noisy = params.range_noise > 0.0 or params.dropout > 0.0
        self._seed = seed
        self._number = number

    def scan(
        self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None
    ) -> LaserScan | PointCloud:
        """Returns scan (or cloud) number `index`, with the robot's base at `base` (map frame) at `stamp` (s).

        `solids`: the obstacles at that time, if known. A pure function of its arguments and the seed: scans are independent of
        each other, and the ranges are computed when they are first read.
        """
        p = self.params
        solids_then = world.solids_at(stamp) if solids is None else solids
        if p.message != "LaserScan":
            ranges = self._ranges(world, base, index, solids_then)
            seen = np.isfinite(ranges) & (ranges < p.range_max)
            points = np.column_stack((self._beams[seen] * ranges[seen, None], np.full(int(seen.sum()), p.height)))
            return PointCloud(points.astype(np.float32), stamp, p.frame, p.topic)
        return DeferredScan(
            lambda: self._ranges(world, base, index, solids_then),
            self._angle_min,
            self._angle_increment,
            p.range_min,
            p.range_max,
            stamp,
            p.frame,
            p.topic,
            p.height,
        )

    def _ranges(self, world: World, base: Pose2D, index: int, solids: Solids) -> NDArray[np.float32]:
        p = self.params
        eye = tuple(Transform2D(base.x, base.y, base.yaw) @ self.mounting)
        noise = self._noise(index) if self._noisy else self._no_noise
        ranges = sweep(world.leaps, world.grid, *solids, eye, self._beams, self._settings, noise)
        if p.no_return == "max":
            ranges[np.isposinf(ranges)] = p.range_max
        return ranges

    def _noise(self, index: int) -> NDArray[np.float64]:
        """Returns the noise of scan number `index`, as `sweep` takes it."""
        p = self.params
        rng = np.random.Generator(np.random.PCG64([self._seed, 1 + self._number, index]))
        noise = np.zeros((2 if p.dropout > 0.0 else 1, p.beams))
        if p.range_noise > 0.0:
            noise[0] = p.range_noise * rng.standard_normal(p.beams)
        if p.dropout > 0.0:
            noise[1] = rng.random(p.beams) >= p.dropout
        return noise


class Sonar:
    """A sonar or infrared sensor: computes the distance to the nearest obstacle in a cone, from poses of the robot."""

    def __init__(self, params: SonarParams, *, seed: int, number: int) -> None:
        """`number` distinguishes the sonars of a robot: each has its own random stream."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        self._increment = params.fov / max(params.beams - 1, 1)
        self._angle_min = -0.5 * self._increment * (params.beams - 1)
        angles = self._angle_min + self._increment * np.arange(params.beams)
        self._beams = np.column_stack((np.cos(angles), np.sin(angles)))
        self._no_noise = np.empty((0, params.beams))
        self._stream = [seed, (1 << 21) + number]

    def scan(self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None) -> RangeReading:
        """Returns reading number `index`, with the robot's base at `base` (map frame) at `stamp` (s).

        `solids`: the obstacles at that time, if known. A pure function of its arguments and the seed.
        """
        p = self.params
        noise, missed = 0.0, False
        if p.range_noise > 0.0 or p.dropout > 0.0:
            rng = np.random.Generator(np.random.PCG64([*self._stream, index]))
            noise = p.range_noise * float(rng.standard_normal())
            missed = float(rng.random()) < p.dropout
        nearest = math.inf
        if not missed:
            # noise can bring a hit just beyond into the range
            reach = p.range_max + max(-noise, 0.0)
            settings = scan_settings(p.height, self._angle_min, self._increment, 0.0, reach)
            eye = tuple(Transform2D(base.x, base.y, base.yaw) @ self.mounting)
            there = world.solids_at(stamp) if solids is None else solids
            ranges = sweep(world.leaps, world.grid, *there, eye, self._beams, settings, self._no_noise)
            nearest = max(float(ranges.min()) + noise, p.range_min)
        nearest = float(np.float32(nearest))  # the precision of sensor_msgs/Range; limits are exact
        if nearest <= np.float32(p.range_min):
            nearest = p.range_min
        if nearest >= np.float32(p.range_max):
            nearest = p.range_max if p.no_return == "max" else math.inf
        return RangeReading(nearest, p.fov, p.range_min, p.range_max, stamp, p.frame, p.topic)
