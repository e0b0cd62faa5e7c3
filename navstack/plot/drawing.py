"""Drawing in meters: grids, paths, footprints, start and goal marks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Footprint, GridGeometry, OccupancyGrid, Pose2D, Transform2D
from navstack.plot import canvas, colors
from navstack.plot.colors import Paint

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARK_PT = 7.0
"""Radius of the discs of start and goals, in points (1/72 inch)."""
_MOST_TEXTS = 4
"""Texts of marks at one place that are listed; further ones are dots."""

MOST_CELLS = 1600
"""Largest number of cells along a side that are drawn one by one; finer grids are drawn in blocks."""


def visible(
    cells: NDArray[Any],
    paint: Paint,
    geometry: GridGeometry,
    area: Bounds,
    pose: Transform2D,
    *,
    clear: int | None = None,
) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """Return the RGBA of the cells inside `area` (m, frame of the picture) and their extent (m, frame of the grid).

    `pose` is the pose of the grid's frame in the picture's frame.
    """
    corners = np.array([(x, y) for x in (area.min_x, area.max_x) for y in (area.min_y, area.max_y)])
    seen = pose.inverse().apply_points(corners)
    (x0, y0), (x1, y1) = seen.min(axis=0).tolist(), seen.max(axis=0).tolist()
    window = geometry.window_of(Bounds(x0, y0, x1, y1))
    part = cells[window.slices]
    block = max(1, math.ceil(max(part.shape) / MOST_CELLS))
    rgba = paint(np.ascontiguousarray(part), block=block, clear=clear)
    r = geometry.resolution
    left, bottom = geometry.origin_x + window.x0 * r, geometry.origin_y + window.y0 * r
    return rgba, (left, left + rgba.shape[1] * block * r, bottom, bottom + rgba.shape[0] * block * r)


def draw_grid(
    axes: Axes,
    cells: NDArray[Any],
    paint: Paint,
    geometry: GridGeometry,
    *,
    area: Bounds,
    pose: Transform2D = Transform2D(),
    clear: int | None = None,
    zorder: float = 0.0,
) -> Any:
    """Draw the part of a grid inside `area`, see `visible`. Returns the image."""
    rgba, extent = visible(cells, paint, geometry, area, pose, clear=clear)
    limits = axes.get_xlim(), axes.get_ylim()
    image = axes.imshow(rgba, origin="lower", extent=extent, interpolation="antialiased", zorder=zorder, aspect="equal")
    if not pose.is_identity():
        image.set_transform(transform_of(pose) + axes.transData)
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])
    return image


def map_pose(grid: OccupancyGrid) -> Transform2D:
    """Return the pose of a map's cells in its frame: rotated about its corner by the yaw of its origin."""
    g = grid.geometry
    return Transform2D(g.origin_x, g.origin_y, grid.origin_yaw) @ Transform2D(-g.origin_x, -g.origin_y, 0.0)


def draw_occupancy(axes: Axes, grid: OccupancyGrid, *, area: Bounds) -> None:
    """Draw the part of a map inside `area`."""
    draw_grid(axes, grid.data, colors.OCCUPANCY, grid.geometry, area=area, pose=map_pose(grid))


def transform_of(pose: Transform2D) -> Any:
    """Return the transform as matplotlib's affine transform."""
    from matplotlib.transforms import Affine2D

    return Affine2D().rotate(pose.yaw).translate(pose.x, pose.y)


def draw_line(
    axes: Axes, poses: NDArray[np.float64], color: str, *, width: float, casing: bool = False, **options: Any
) -> Any:
    """Draw a line through poses (n, 2+); a white casing keeps it legible on any background. Returns the line."""
    from matplotlib.patheffects import Normal, Stroke

    effects = (
        [Stroke(linewidth=canvas.line_scale() * (width + 1.6), foreground="white", alpha=0.85), Normal()]
        if casing
        else None
    )
    options.setdefault("solid_capstyle", "round")
    (line,) = axes.plot(poses[:, 0], poses[:, 1], color=color, linewidth=width, path_effects=effects, **options)
    return line


@dataclass(frozen=True, slots=True)
class Mark:
    """A start or goal: a disc with a text and an arrow for the heading."""

    pose: Pose2D
    text: str
    color: str
    hollow: bool = False
    """White with a colored edge: a goal that was not reached."""


def draw_marks(axes: Axes, marks: Sequence[Mark], points_per_m: float, *, zorder: float = 8.0) -> None:
    """Draw marks. Marks that overlap share the disc of the first one, which lists their texts."""
    for group in _overlapping(marks, 1.5 * MARK_PT / points_per_m):
        _draw_group(axes, group, points_per_m, zorder)


def _overlapping(marks: Sequence[Mark], distance: float) -> list[list[Mark]]:
    """Groups the marks that are closer than `distance` (m) to the first mark of a group; drops those that are not finite."""
    groups: list[list[Mark]] = []
    for mark in marks:
        if not mark.pose.is_finite():
            continue
        for group in groups:
            if group[0].pose.distance_to(mark.pose) < distance:
                group.append(mark)
                break
        else:
            groups.append([mark])
    return groups


def _draw_group(axes: Axes, group: Sequence[Mark], points_per_m: float, zorder: float) -> None:
    at = group[0].pose
    for mark in group:
        _arrow(axes, at, mark.pose.yaw, mark.color, MARK_PT / points_per_m, zorder)
    color = group[0].color
    face, edge = ("white", color) if any(mark.hollow for mark in group) else (color, "white")
    texts = list(dict.fromkeys(mark.text for mark in group))
    label = ",".join(texts[:_MOST_TEXTS]) + ("..." if len(texts) > _MOST_TEXTS else "")
    size = MARK_PT * (1.0 + 0.22 * max(len(label) - 2, 0))
    axes.plot([at.x], [at.y], "o", ms=2 * size, color=face, mec=edge, mew=1.2, zorder=zorder + 0.1)
    axes.annotate(
        label,
        (at.x, at.y),
        color=edge,
        fontsize=8,
        fontweight="bold",
        ha="center",
        va="center_baseline",
        zorder=zorder + 0.2,
        annotation_clip=True,
    )


def draw_footprint(axes: Axes, footprint: Footprint, pose: Pose2D, *, zorder: float = 4.8) -> Any:
    """Draw the footprint at a pose. Returns the polygon."""
    (polygon,) = axes.fill(
        *footprint.at(pose).T, facecolor=colors.FOOTPRINT + "40", edgecolor=colors.BLUE, lw=0.8, zorder=zorder
    )
    return polygon


def draw_rings(axes: Axes, points: NDArray[np.float64], color: str, **options: Any) -> Any:
    """Draw diamonds (n, 2+) that leave visible what they surround: the robot, or the text of a mark."""
    from matplotlib.patheffects import withStroke

    style: dict[str, Any] = {"ms": 15, "mfc": "none", "mec": color, "mew": 2.4, "ls": "none", "zorder": 9} | options
    return axes.plot(
        points[:, 0],
        points[:, 1],
        "D",
        path_effects=[withStroke(linewidth=4.0 * canvas.line_scale(), foreground="white")],
        **style,
    )


def ring_handle(color: str) -> Any:
    """Handle of the legend: a small diamond."""
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="none", marker="D", ms=6.5, mfc="none", mec=color, mew=1.8)


def draw_heading(axes: Axes, pose: Pose2D, color: str, points_per_m: float) -> None:
    """Draw a small disc with an arrow for the heading."""
    _arrow(axes, pose, pose.yaw, color, 4.5 / points_per_m, 6.0)
    axes.plot([pose.x], [pose.y], "o", ms=5, color=color, mec="white", mew=0.8, zorder=6.1)


def _arrow(axes: Axes, at: Pose2D, yaw: float, color: str, radius: float, zorder: float) -> None:
    c, s = math.cos(yaw), math.sin(yaw)
    axes.annotate(
        "",
        xy=(at.x + 3.1 * radius * c, at.y + 3.1 * radius * s),
        xytext=(at.x, at.y),
        arrowprops={
            "arrowstyle": "-|>,head_length=0.5,head_width=0.28",
            "color": color,
            "lw": 2.0,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=zorder,
        annotation_clip=True,
    )


def pose_of(row: NDArray[np.float64]) -> Pose2D:
    """Return a row x, y, yaw as a pose."""
    x, y, yaw = (float(v) for v in row)
    return Pose2D(x, y, yaw)
