"""A level color and depth camera: pictures of the world that the lidars measure, by one ray per column."""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D, kernel
from navstack.parameters import CameraParams
from navstack.sim.lidar import cast_ray
from navstack.sim.shapes import DoorMotion
from navstack.sim.solids import Solids, polygon_contains
from navstack.sim.world import World

# Without pitch and roll, a column of the picture is a vertical plane: one ray in that plane gives the vertical faces in it, and
# the pinhole equation their rows. Solids are prisms on the floor; where they are lower than the camera, their tops are seen.

VIEW: Final = np.dtype(
    [
        ("focal", "f8"),  # pixels
        ("center_u", "f8"),  # column of the optical axis
        ("center_v", "f8"),  # row of the optical axis, which is the horizon
        ("z", "f8"),  # height of the camera, m
        ("wall_height", "f8"),  # m
    ]
)
"""Element type of the settings of `draw`."""

OBSTACLE: Final = 0
PERSON: Final = 1
WALL: Final = 2
"""Kinds of solids, by which they are colored. A solid that looks like a wall is a door or a segment."""

_COLORS: Final = np.array(
    [
        [226, 232, 238],  # what is far away fades into this
        [152, 184, 222],  # the sky at the top
        [158, 150, 138],  # the floor
        [228, 220, 204],  # walls
        [58, 64, 84],  # people: trousers, shirt, head
        [196, 84, 62],
        [232, 188, 156],
        [176, 128, 78],  # doors and segments
        [206, 160, 92],  # obstacles, in turn
        [104, 142, 116],
        [122, 128, 176],
        [186, 116, 104],
    ],
    np.float64,
)
_HAZE, _SKY, _FLOOR, _MAP_WALL, _TROUSERS, _SHIRT, _HEAD, _DOOR, _OBSTACLES = range(9)
"""Rows of `_COLORS`; that of the obstacles is their first."""
_BELT, _NECK = 0.48, 0.84
"""Ends of a person's trousers and shirt, as fractions of the height."""
_BASEBOARD_M: Final = 0.06
"""Height of the darker foot of a wall (m)."""
_FADE_M: Final = 18.0
"""Distance (m) over which colors fade to 1 / e."""
_NEAREST_M: Final = 1e-3
"""Smallest depth of a face (m): the camera may be inside of an obstacle."""


@kernel
def shaded(colors, row, light, distance):
    """The color (r, g, b) of row `row` of `colors` (n, 3) under a light from 0 to 1, seen from `distance` (m)."""
    clear = math.exp(-distance / _FADE_M)
    haze = 1.0 - clear
    return (
        np.uint8(clear * light * colors[row, 0] + haze * colors[_HAZE, 0] + 0.5),
        np.uint8(clear * light * colors[row, 1] + haze * colors[_HAZE, 1] + 0.5),
        np.uint8(clear * light * colors[row, 2] + haze * colors[_HAZE, 2] + 0.5),
    )


@kernel
def light_on(nx, ny):
    """The light from 0 to 1 on a vertical face with the normal (nx, ny) of any length, in the map."""
    length = math.hypot(nx, ny)
    return 0.8 + 0.2 * (0.45 * nx + 0.89 * ny) / length if length > 0.0 else 0.8


@kernel
def draw_background(rgb, depth, view, colors):
    """Fill the picture with the floor below the horizon and the sky above it."""
    rows, columns = depth.shape
    for v in range(rows):
        below = v - view.center_v
        z = view.focal * view.z / below if below > 0.0 else math.inf
        if below > 0.0:
            r, g, b = shaded(colors, _FLOOR, 1.0, z)
        else:
            up = min(-below / view.focal * 2.0, 1.0)
            r = np.uint8(colors[_HAZE, 0] + up * (colors[_SKY, 0] - colors[_HAZE, 0]))
            g = np.uint8(colors[_HAZE, 1] + up * (colors[_SKY, 1] - colors[_HAZE, 1]))
            b = np.uint8(colors[_HAZE, 2] + up * (colors[_SKY, 2] - colors[_HAZE, 2]))
        for u in range(columns):
            rgb[v, u, 0], rgb[v, u, 1], rgb[v, u, 2] = r, g, b
            depth[v, u] = z


@kernel
def row_at(view, height, z):
    """The row at which a point at a height (m) appears, at depth `z` (m); limited to what an integer holds."""
    return min(max(view.center_v + view.focal * (view.z - height) / z, -1e6), 1e6)


@kernel
def draw_face(rgb, depth, u, view, bottom, top, z, color):
    """Draw what column `u` sees of a vertical face at depth `z` from height `bottom` to `top` (m), where nothing is nearer."""
    z = max(z, _NEAREST_M)
    first = max(math.ceil(row_at(view, top, z)), 0)
    last = min(math.floor(row_at(view, bottom, z)), depth.shape[0] - 1)
    for v in range(first, last + 1):
        if z < depth[v, u]:
            depth[v, u] = z
            rgb[v, u, 0], rgb[v, u, 1], rgb[v, u, 2] = color


@kernel
def draw_top(rgb, depth, u, view, top, near, far, color):
    """Draw what column `u` sees of a level face at height `top` (m) from depth `near` to `far`, where nothing is nearer."""
    below = view.z - top
    first = max(math.ceil(row_at(view, top, far)), 0)
    last = min(math.floor(row_at(view, top, max(near, _NEAREST_M))), depth.shape[0] - 1)
    for v in range(first, last + 1):
        z = view.focal * below / (v - view.center_v)
        if z < depth[v, u]:
            depth[v, u] = z
            rgb[v, u, 0], rgb[v, u, 1], rgb[v, u, 2] = color


@kernel
def draw_solid(rgb, depth, u, view, kind, row, top, near, far, cosine, light, colors):
    """Draw a solid in column `u` between the distances `near` and `far` (m) along the ray; `row`: its color."""
    z = near * cosine
    if kind == PERSON:
        draw_face(rgb, depth, u, view, 0.0, _BELT * top, z, shaded(colors, _TROUSERS, light, near))
        draw_face(rgb, depth, u, view, _BELT * top, _NECK * top, z, shaded(colors, _SHIRT, light, near))
        draw_face(rgb, depth, u, view, _NECK * top, top, z, shaded(colors, _HEAD, light, near))
    else:
        draw_face(rgb, depth, u, view, 0.0, top, z, shaded(colors, row, light, near))
    if top < view.z:
        draw_top(rgb, depth, u, view, top, z, far * cosine, shaded(colors, row, 1.0, near))


@kernel
def draw_walls(rgb, depth, leaps, grid, eye, view, colors):
    """Draw the occupied cells of the map: in each column the nearest one, which hides all others, as walls have one height."""
    resolution = grid[3]
    _, ny, nx = leaps.shape
    flat = leaps.ravel()
    c, s = math.cos(grid[2]), math.sin(grid[2])
    x, y = eye[0] - grid[0], eye[1] - grid[1]
    px, py = (c * x + s * y) / resolution, (c * y - s * x) / resolution
    yaw = eye[2] - grid[2]
    for u in range(depth.shape[1]):
        aside = (view.center_u - u) / view.focal
        cosine = 1.0 / math.sqrt(1.0 + aside * aside)
        dx = cosine * (math.cos(yaw) - math.sin(yaw) * aside)
        dy = cosine * (math.sin(yaw) + math.cos(yaw) * aside)
        t = cast_ray(flat, ny, nx, px, py, dx, dy, math.inf)
        if t == math.inf:
            continue
        # the ray ends on a border of a cell, across x or across y
        hx, hy = px + t * dx, py + t * dy
        across_x = abs(hx - round(hx)) < abs(hy - round(hy))
        mx, my = (-math.copysign(1.0, dx), 0.0) if across_x else (0.0, -math.copysign(1.0, dy))
        light = light_on(c * mx - s * my, s * mx + c * my)
        t *= resolution
        foot = min(_BASEBOARD_M, view.wall_height)
        draw_face(rgb, depth, u, view, 0.0, foot, t * cosine, shaded(colors, _MAP_WALL, 0.62 * light, t))
        draw_face(rgb, depth, u, view, foot, view.wall_height, t * cosine, shaded(colors, _MAP_WALL, light, t))


@kernel
def columns_of(view, columns, x, y, r):
    """First and last column in which a disc at (x, y) in the camera's frame (m, x ahead, y to the left) may be seen."""
    d2 = x * x + y * y
    if d2 <= r * r:
        return 0, columns - 1
    center, half = math.atan2(y, x), math.asin(r / math.sqrt(d2))
    limit = math.atan2(max(view.center_u, columns - view.center_u) + 1.0, view.focal)
    if center - half > limit or center + half < -limit:
        return 0, -1
    left = view.center_u - view.focal * math.tan(min(center + half, limit))
    right = view.center_u - view.focal * math.tan(max(center - half, -limit))
    return max(math.floor(left), 0), min(math.ceil(right), columns - 1)


@kernel
def crossings(out, ways, corners, x, y, dx, dy):
    """Distances along a ray from (x, y) at which it crosses the polygon `corners` (m, 2), sorted; returns their number.

    Writes the distances ahead into `out` (m,), and the edges that are crossed into `ways` (m,).
    """
    count = 0
    m = corners.shape[0]
    ax, ay = corners[m - 1, 0] - x, corners[m - 1, 1] - y
    after = ax * dy - ay * dx
    for j in range(m):
        bx, by = corners[j, 0] - x, corners[j, 1] - y
        then = bx * dy - by * dx
        # a corner on the ray belongs to one of its two edges
        if (after > 0.0) != (then > 0.0):
            t = (ax * by - ay * bx) / (after - then)
            if t > 0.0:
                k = count
                while k > 0 and out[k - 1] > t:
                    out[k], ways[k] = out[k - 1], ways[k - 1]
                    k -= 1
                out[k], ways[k] = t, j
                count += 1
        ax, ay, after = bx, by, then
    return count


@kernel
def draw_disc(rgb, depth, disc, eye, view, kind, row, top, colors):
    """Draw a disc x, y, radius (m, map frame)."""
    c, s = math.cos(eye[2]), math.sin(eye[2])
    wx, wy, r = disc[0] - eye[0], disc[1] - eye[1], disc[2]
    x, y = c * wx + s * wy, c * wy - s * wx
    if math.isnan(x):
        return  # absent
    first, last = columns_of(view, depth.shape[1], x, y, r)
    for u in range(first, last + 1):
        aside = (view.center_u - u) / view.focal
        cosine = 1.0 / math.sqrt(1.0 + aside * aside)
        along = cosine * (x + aside * y)
        h = r * r - (x * x + y * y - along * along)
        if h < 0.0 or along + math.sqrt(h) <= 0.0:
            continue
        near = max(along - math.sqrt(h), 0.0)
        nx, ny = near * cosine - x, near * cosine * aside - y
        light = light_on(c * nx - s * ny, s * nx + c * ny) * (0.75 + 0.25 * math.sqrt(h) / r)
        draw_solid(rgb, depth, u, view, kind, row, top, near, along + math.sqrt(h), cosine, light, colors)


@kernel
def draw_polygon(rgb, depth, circle, corners, eye, view, kind, row, top, colors):
    """Draw the polygon `corners` (m, 2) with the bounding circle x, y, radius (m, map frame)."""
    c, s = math.cos(eye[2]), math.sin(eye[2])
    wx, wy = circle[0] - eye[0], circle[1] - eye[1]
    first, last = columns_of(view, depth.shape[1], c * wx + s * wy, c * wy - s * wx, circle[2])
    m = corners.shape[0]
    distances, edges = np.empty(m), np.empty(m, np.int64)
    inside = polygon_contains(corners, eye[0], eye[1])
    for u in range(first, last + 1):
        aside = (view.center_u - u) / view.focal
        cosine = 1.0 / math.sqrt(1.0 + aside * aside)
        dx, dy = cosine * (c - s * aside), cosine * (s + c * aside)
        count = crossings(distances, edges, corners, eye[0], eye[1], dx, dy)
        k = 0
        if inside and count > 0:
            draw_solid(rgb, depth, u, view, kind, row, top, 0.0, distances[0], cosine, 0.8, colors)
            k = 1
        while k + 1 < count:
            b = edges[k]
            a = b - 1 if b > 0 else m - 1
            nx, ny = corners[b, 1] - corners[a, 1], corners[a, 0] - corners[b, 0]
            if nx * dx + ny * dy > 0.0:
                nx, ny = -nx, -ny
            light = light_on(nx, ny)
            draw_solid(rgb, depth, u, view, kind, row, top, distances[k], distances[k + 1], cosine, light, colors)
            k += 2


@kernel
def draw(rgb, depth, leaps, grid, discs, circles, corners, first, looks, eye, settings, colors):
    """Draw what a camera at `eye` (x, y, yaw) in the map (m, rad), a tuple, sees into `rgb` (h, w, 3) u1 and `depth` (h, w) f4.

    `leaps`, `grid`, `discs` .. `first` as in `sweep`; `looks` (k + p, 2): top (m) and kind of each solid; `settings` (1,) of
    type `VIEW`; `colors` as `_COLORS`. The depth is along the optical axis (m), inf in the sky.
    """
    view = settings[0]
    draw_background(rgb, depth, view, colors)
    draw_walls(rgb, depth, leaps, grid, eye, view, colors)
    count = discs.shape[0]
    for k in range(count + circles.shape[0]):
        top, kind = looks[k, 0], int(looks[k, 1])
        row = _OBSTACLES + k % (colors.shape[0] - _OBSTACLES)
        if kind != OBSTACLE:
            row = _HEAD if kind == PERSON else _DOOR
        if k < count:
            draw_disc(rgb, depth, discs[k], eye, view, kind, row, top, colors)
        else:
            polygon = corners[first[k - count] : first[k - count + 1]]
            draw_polygon(rgb, depth, circles[k - count], polygon, eye, view, kind, row, top, colors)


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """What a camera sees at one moment: color and depth of the same pixels."""

    rgb: NDArray[np.uint8]
    """(height, width, 3) red, green, blue; row 0 is at the top."""
    depth: NDArray[np.float32]
    """(height, width) distance along the optical axis (m); nearer than `range_min` -inf, beyond `range_max` +inf (REP 118)."""
    stamp: float
    """Time (s)."""
    params: CameraParams

    @property
    def depth_mm(self) -> NDArray[np.uint16]:
        """The depth in millimeters, 0 where there is none: the encoding 16UC1."""
        found = np.isfinite(self.depth) & (self.depth < 65.5)
        return np.where(found, np.rint(1000.0 * np.where(found, self.depth, 0.0)), 0.0).astype(np.uint16)


class Camera:
    """A camera without state: a picture is a pure function of its parameters, the world and the pose of the robot."""

    def __init__(self, params: CameraParams) -> None:
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        view = (params.focal_length, *params.image_center, params.z, params.wall_height)
        self._settings: NDArray[np.void] = np.array([view], VIEW)

    def image(
        self, world: World, base: Pose2D, stamp: float, solids: Solids | None = None, people: int = 0
    ) -> CameraImage:
        """Return the picture with the robot's base at `base` (map frame) at `stamp` (s).

        `solids`: the obstacles at that time, if known; the last `people` of the discs are pedestrians.
        """
        p = self.params
        solids = world.solids_at(stamp) if solids is None else solids
        rgb = np.empty((p.height, p.width, 3), np.uint8)
        depth = np.empty((p.height, p.width), np.float32)
        looks = self._looks(world, solids, people)
        eye = tuple(Transform2D(base.x, base.y, base.yaw) @ self.mounting)
        draw(rgb, depth, world.leaps, world.grid, *solids.geometry, looks, eye, self._settings, _COLORS)
        depth[depth > p.range_max] = np.inf
        depth[depth < p.range_min] = -np.inf
        return CameraImage(rgb, depth, stamp, p)

    def _looks(self, world: World, solids: Solids, people: int) -> NDArray[np.float64]:
        """Return the finite height (m) of each solid, and its kind: (k + p, 2)."""
        p, discs = self.params, len(solids.discs)
        heights = np.full(len(solids.tops), p.obstacle_height)
        kinds = np.full(len(solids.tops), OBSTACLE)
        heights[discs - people : discs], kinds[discs - people : discs] = p.person_height, PERSON
        for k, shape in enumerate(world.polygons):
            if shape.segment is not None or isinstance(shape.motion, DoorMotion):
                heights[discs + k], kinds[discs + k] = p.wall_height, WALL
        return np.column_stack((np.where(np.isfinite(solids.tops), solids.tops, heights), kinds))
