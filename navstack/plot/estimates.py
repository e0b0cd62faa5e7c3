"""What a robot believed, in pictures of runs: believed path, covariance ellipses, particles, beams, likelihood field."""

from __future__ import annotations

import math
import os
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import InputError
from navstack.localization.distance_field import distance_field
from navstack.parameters.models.amcl import AmclParams
from navstack.plot import areas, canvas, colors, drawing
from navstack.plot.colors import Paint
from navstack.plot.legend import swatch
from navstack.plot.picture import Picture
from navstack.record import Record
from navstack.record.beliefs import (
    RecordedEstimate,
    believed_poses,
    estimate_at,
    estimates_of,
    moved,
    recorded_estimate,
)
from navstack.scenario import Scenario

Entries = list[tuple[Any, str]]
PARTICLES: Final = colors.PURPLE
BELIEVED: Final = colors.BLACK
_SHARE_95: Final = math.sqrt(-2.0 * math.log(0.05))
"""Half axes of the ellipse that contains 95 % of a normal distribution, in standard deviations."""
_MOST_ELLIPSES: Final = 25
_MOST_CLOUDS: Final = 12
_MOST_BEAMS: Final = 60
_HIT_RGB: Final = (230, 159, 0)
"""Of the likelihood field at an obstacle: orange."""
_EXPLAINED_M: Final = 0.3
"""A beam that ends farther from every obstacle of the map (m) is not explained by it."""


def likelihood_paint() -> Paint:
    """Return the colors of a likelihood field as bytes: white for 0, orange for 254, black for an occupied cell (255)."""
    share = np.linspace(0.0, 1.0, 255)[:, None]
    rgb = np.round(255.0 * (1.0 - share) + share * np.array(_HIT_RGB)).astype(np.uint8)
    return Paint(np.arange(256, dtype=np.uint8), np.vstack((rgb, np.array([colors.LETHAL_RGB], np.uint8))))


def ellipse(pose: Pose2D, covariance: NDArray[np.float64], points: int = 48) -> NDArray[np.float64]:
    """Return the outline (n, 2) that contains the position with 95 %, by the (3, 3) covariance."""
    values, axes = np.linalg.eigh(covariance[:2, :2])
    angles = np.linspace(0.0, 2.0 * math.pi, points)
    unit = np.column_stack((np.cos(angles), np.sin(angles)))
    return np.array([pose.x, pose.y]) + _SHARE_95 * (unit * np.sqrt(np.maximum(values, 0.0))) @ axes.T


def has_estimates(record: Record) -> bool:
    """Return whether a localizer ran."""
    return len(estimates_of(record)) > 0


def draw_estimates(axes: Any, record: Record, entries: Entries) -> None:
    """Draws the believed path, particles at a dozen places and ellipses at some more; nothing without a localizer."""
    table = estimates_of(record)
    if not len(table):
        return
    line = drawing.draw_line(
        axes, believed_poses(record), BELIEVED, width=1.1, linestyle=(0, (3, 1.6)), dash_capstyle="butt", zorder=5.4
    )
    entries.append((line, "believed path"))
    points = ring = None
    for row in _spread(len(table), _MOST_CLOUDS):
        cloud = recorded_estimate(record, row).particles
        (points,) = axes.plot(cloud[:, 0], cloud[:, 1], ".", color=PARTICLES, ms=2.2, alpha=0.6, zorder=4.6)
    for row in _spread(len(table), _MOST_ELLIPSES):
        found = recorded_estimate(record, row)
        ring = drawing.draw_line(axes, ellipse(found.pose, found.covariance), PARTICLES, width=1.0, zorder=4.7)
    entries += [(points, "particles"), (ring, "95 % ellipse")]
    lost = table[table["lost"] > 0]
    if len(lost):
        (cross,) = axes.plot(lost["x"], lost["y"], "x", color=colors.VERMILLION, ms=5.0, mew=1.4, zorder=6.5)
        entries.append((cross, "lost"))


def _spread(count: int, most: int) -> list[int]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int)).tolist()


class EstimateArtists:
    """Particles, ellipse, believed path and footprint, and the beams from the believed pose, in the frames of a film."""

    def __init__(self, axes: Any, record: Record) -> None:
        self._record = record
        self._believed = believed_poses(record)
        empty = np.empty((0, 2))
        style: dict[str, Any] = {"animated": True}
        (self._points,) = axes.plot([], [], ".", color=PARTICLES, ms=2.4, alpha=0.8, zorder=5.2, **style)
        self._ring = drawing.draw_line(axes, empty, PARTICLES, width=1.4, zorder=5.3, **style)
        self._path = drawing.draw_line(
            axes, empty, BELIEVED, width=1.1, linestyle=(0, (3, 1.6)), dash_capstyle="butt", zorder=5.4, **style
        )
        self._outline = drawing.draw_line(axes, empty, BELIEVED, width=1.2, zorder=6.2, **style)
        self._beams = drawing.draw_line(axes, empty, colors.SCAN, width=0.35, alpha=0.5, zorder=4.4, **style)
        self.below = (self._beams, self._path)
        self.above = (self._points, self._ring, self._outline)

    def entries(self) -> Entries:
        """Returns the entries of the legend."""
        from matplotlib.lines import Line2D

        named = ((self._path, "believed path"), (self._points, "particles"), (self._ring, "95 % ellipse"))
        beams = Line2D([], [], color=colors.SCAN, lw=1.0)
        return [*named, (self._outline, "believed pose"), (beams, "beams from there")]

    def move_to(self, t: float) -> None:
        """Sets the artists to their state at time `t` (s)."""
        record = self._record
        i = record.index_at(t)
        pose = drawing.pose_of(self._believed[i])
        self._path.set_data(*self._believed[: i + 1, :2].T)
        outline = record.footprint.at(pose)
        self._outline.set_data(*np.vstack((outline, outline[:1])).T)
        found = estimate_at(record, t)
        cloud, ring = np.empty((0, 4), np.float32), np.empty((0, 2))
        if found is not None:
            found = moved(record, found, t)
            cloud, ring = found.particles, _ring_of(found)
        self._points.set_data(*cloud[:, :2].T)
        self._ring.set_data(*ring.T)
        self._beams.set_data(*beams_from(record, t, pose).T)

    def status(self, t: float) -> str:
        """Returns the words of the status line."""
        record = self._record
        i = record.index_at(t)
        off = float(np.hypot(*(self._believed[i, :2] - record.poses[i, :2])))
        found = estimate_at(record, t)
        lost = "    lost" if found is not None and found.lost else ""
        return f"    believed {off:.2f} m off" + ("" if found is None else f"    particles {found.count}") + lost


def _ring_of(found: RecordedEstimate) -> NDArray[np.float64]:
    return ellipse(found.pose, found.covariance)


def beams_from(record: Record, t: float, pose: Pose2D) -> NDArray[np.float64]:
    """Returns a line (n, 2) along at most _MOST_BEAMS beams with a return of each lidar, and back to it."""
    at = Transform2D(*pose)
    parts = [np.empty((0, 2))]
    for scan in record.scans_at(t):
        ends = at.apply_points(scan.base_points)
        ends = ends[:: max(1, math.ceil(len(ends) / _MOST_BEAMS))]
        eye = np.array((at @ scan.mounting)[:2])
        line = np.empty((2 * len(ends) + 1, 2))
        line[0::2], line[1::2] = eye, ends
        parts += [line, np.full((1, 2), np.nan)]
    return np.concatenate(parts)


# --- the picture of a moment --------------------------------------------------------------------------------------------


def plot_estimate(
    record: Record,
    path: str | os.PathLike[str] | None = None,
    *,
    t: float | None = None,
    ax: Any = None,
    dpi: float = 130.0,
) -> Any:
    """Draws a moment of a run as its localizer saw it: likelihood field, beams, particles, ellipse, believed and true pose.

    The field is that of amcl's sensor model, by the parameters of the run: the likelihood of a beam that ends in a cell. Raises
    InputError for a run without a localizer or a map. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    table = estimates_of(record)
    if not len(table) or record.map is None:
        raise InputError(
            "the run has no localizer, so there is nothing to draw; simulate with `navstack: sim: localization: amcl`"
        )
    time = float(record.times[-1]) if t is None else t
    found = moved(record, estimate_at(record, time) or recorded_estimate(record, 0), time)
    i = record.index_at(time)
    true, believed = drawing.pose_of(record.poses[i]), drawing.pose_of(believed_poses(record)[i])
    off = math.hypot(true.x - believed.x, true.y - believed.y)
    turned = math.degrees(abs(math.remainder(believed.yaw - true.yaw, 2.0 * math.pi)))
    lost = "   lost" if found.lost else ""
    subtitle = f"particles {found.count}   believed pose {off:.2f} m and {turned:.1f}° off{lost}"
    with canvas.style():
        area = _area(record, found, true, believed, time)
        title = f"localization at {time:.1f} s"
        picture = Picture(area, title=title, subtitle=subtitle, ax=ax, managed=path is None)
        entries = _draw_field(picture.axes, record, record.map, picture.area)
        entries = _draw_beams(picture.axes, record, record.map, time, believed) + entries
        entries = _draw_poses(picture.axes, record, found, true, believed) + entries
        picture.legend([handle for handle, _ in entries], [label for _, label in entries])
        return picture.finish(path, dpi)


def _area(record: Record, found: RecordedEstimate, true: Pose2D, believed: Pose2D, t: float) -> Bounds:
    ends = [Transform2D(*believed).apply_points(scan.base_points) for scan in record.scans_at(t)]
    points = [np.array([true[:2], believed[:2]]), found.particles.astype(np.float64), *ends]
    return areas.shaped(areas.area_of(points).grown(1.0))


def _draw_field(axes: Any, record: Record, grid: OccupancyGrid, area: Bounds) -> Entries:
    """Draws the likelihood field of the map, by the parameters of the run."""
    params = Scenario.from_record(record).configuration.localization.amcl or AmclParams()
    distance = distance_field(grid, params.laser_likelihood_max_dist)
    likelihood = np.exp(-0.5 * np.square(distance / params.laser_sigma_hit))
    cells = np.round(254.0 * likelihood).astype(np.uint8)
    cells[grid.data == 100] = 255
    g = grid.geometry
    corner = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw) @ Transform2D(-g.origin_x, -g.origin_y, 0.0)
    drawing.draw_grid(axes, cells, likelihood_paint(), g, area=area, pose=corner)
    return [(swatch(colors.LETHAL_RGB), "occupied"), (swatch(_HIT_RGB), "likelihood of a beam's end")]


def _draw_beams(axes: Any, record: Record, grid: OccupancyGrid, t: float, believed: Pose2D) -> Entries:
    """Draws the beams from the believed pose: those that the map explains, and the others."""
    distance = distance_field(grid, 2.0 * _EXPLAINED_M)
    g = grid.geometry
    corner = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
    at = Transform2D(*believed)
    near: list[NDArray[np.float64]] = [np.empty((0, 2))]
    far: list[NDArray[np.float64]] = [np.empty((0, 2))]
    for scan in record.scans_at(t):
        ends = at.apply_points(scan.base_points)
        inside = np.floor(corner.inverse().apply_points(ends) / g.resolution).astype(int)
        ok = ((inside >= 0) & (inside < (g.nx, g.ny))).all(axis=1)
        explained = np.zeros(len(ends), np.bool_)
        explained[ok] = distance[inside[ok, 1], inside[ok, 0]] <= _EXPLAINED_M
        near.append(ends[explained])
        far.append(ends[~explained])
    drawing.draw_line(axes, beams_from(record, t, believed), colors.SKY, width=0.4, alpha=0.6, zorder=2.0)
    entries: Entries = []
    for points, color, marker, name in (
        (np.concatenate(near), colors.BLUE, "o", "beam that the map explains"),
        (np.concatenate(far), colors.VERMILLION, "X", "beam that it does not"),
    ):
        if len(points):
            (mark,) = axes.plot(
                points[:, 0], points[:, 1], marker, color=color, ms=2.6 if marker == "o" else 4.0, mew=0.0, zorder=3.0
            )
            entries.append((mark, name))
    return entries


def _draw_poses(axes: Any, record: Record, found: RecordedEstimate, true: Pose2D, believed: Pose2D) -> Entries:
    """Draws particles with their headings, the ellipse, and both footprints."""
    cloud = found.particles.astype(np.float64)
    length = 0.5 * max(record.footprint.circumscribed_radius, 0.1)
    ends = cloud[:, :2] + length * np.column_stack((np.cos(cloud[:, 2]), np.sin(cloud[:, 2])))
    lines = np.full((3 * len(cloud), 2), np.nan)
    lines[0::3], lines[1::3] = cloud[:, :2], ends
    drawing.draw_line(axes, lines, PARTICLES, width=0.5, alpha=0.6, zorder=4.0)
    (points,) = axes.plot(cloud[:, 0], cloud[:, 1], ".", color=PARTICLES, ms=3.0, zorder=4.1)
    ring = drawing.draw_line(axes, _ring_of(found), PARTICLES, width=1.6, casing=True, zorder=4.2)
    body = drawing.draw_footprint(axes, record.footprint, true, zorder=5.0)
    outline = record.footprint.at(believed)
    line = drawing.draw_line(axes, np.vstack((outline, outline[:1])), BELIEVED, width=1.3, zorder=5.2)
    for pose, color in ((true, colors.BLUE), (believed, BELIEVED)):
        reach = record.footprint.circumscribed_radius
        nose = np.array([[pose.x, pose.y], [pose.x + reach * math.cos(pose.yaw), pose.y + reach * math.sin(pose.yaw)]])
        drawing.draw_line(axes, nose, color, width=1.3, zorder=5.3)
    return [(body, "true pose"), (line, "believed pose"), (points, "particles"), (ring, "95 % ellipse")]
