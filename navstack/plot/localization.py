"""Localization in pictures: estimates along a log, global starts, and what a robot believed during a run."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, InputError, OccupancyGrid, Pose2D, Transform2D, atomic_write, ensure_directory
from navstack.localization import distance_field
from navstack.parameters import AmclParams
from navstack.plot import canvas, colors, drawing
from navstack.plot.colors import Paint
from navstack.plot.encoders import find_ffmpeg, write_gif, write_mp4
from navstack.plot.picture import Entries, Picture, area_of, occupancy_legend, shaped, swatch
from navstack.record import (
    Record,
    RecordedEstimate,
    believed_poses,
    estimate_at,
    estimates_of,
    moved,
    recorded_estimate,
)
from navstack.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from navstack.localization import Starts, Track

_SHOWN_CLOUDS: Final = 12
_ARROWS: Final = 300
"""Particles of a cloud that are drawn."""
_LOST = colors.VERMILLION
_PARTICLES = colors.PURPLE


def plot_track(
    tracks: Mapping[str, Track],
    grid: OccupancyGrid,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    title: str = "localization",
    dpi: float = 130.0,
) -> Any:
    """Draw the estimates of one or two tracks by name, the reference, and the particles at a dozen scans, over the map.

    Draws into the axes `ax`, or a new figure (.png, .svg, .pdf). Raises OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    with canvas.style():
        picture, entries = _background(tracks, grid, title, ax, path is None)
        axes = picture.axes
        first = next(iter(tracks.values()))
        rows = sorted(first.clouds)
        for row in rows[:: max(1, len(rows) // _SHOWN_CLOUDS)]:
            _draw_cloud(axes, first.clouds[row])
        for (_, track), color in zip(tracks.items(), colors.PLANS, strict=False):
            drawing.draw_line(axes, _drawable(track.poses), color, width=1.4, casing=True, zorder=4.0)
        lost = first.poses[first.lost]
        if len(lost):
            axes.plot(lost[:, 0], lost[:, 1], "x", color=_LOST, ms=5.0, mew=1.5, zorder=6.0)
        picture.legend(entries)
        return picture.finish(path, dpi)


def plot_track_errors(tracks: Mapping[str, Track], path: str | os.PathLike[str], *, dpi: float = 130.0) -> Any:
    """Draw distance to the reference, explained share and number of particles over the scans. Returns the file."""
    canvas.check_target(path, None)
    with canvas.style():
        figure = canvas.new_figure(9.2, 6.0, layout="constrained")
        axes: Sequence[Axes] = figure.subplots(3, 1, sharex=True)
        for (name, track), color in zip(tracks.items(), colors.PLANS, strict=False):
            axes[0].plot(track.indices, track.errors, color=color, lw=1.2, label=name)
            axes[1].plot(track.indices, track.explained, color=color, lw=1.2)
            axes[2].plot(track.indices, track.particles, color=color, lw=1.2)
            lost = track.lost & np.isfinite(track.errors)
            axes[0].plot(
                track.indices[lost],
                track.errors[lost],
                "x",
                color=_LOST,
                ms=4.0,
                label=f"{name}: lost" if lost.any() else None,
            )
        axes[0].set_title("error, agreement and particles", fontweight="bold", loc="left")
        for axis, text in zip(axes, ("distance to the reference (m)", "explained share", "particles"), strict=True):
            axis.set_ylabel(text)
            axis.set_ylim(bottom=0.0)
        axes[2].set_xlabel("scan")
        axes[0].legend(loc="upper right", fontsize=8)
        return canvas.save(figure, Path(path), dpi)


def animate_track(
    track: Track,
    grid: OccupancyGrid,
    path: str | os.PathLike[str],
    *,
    title: str = "localization",
    fps: float = 10.0,
    dpi: float = 90.0,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the clouds of particles as .gif or .mp4, a frame for each that the track has kept. Returns the file."""
    out = Path(path)
    canvas.check_format(out, (".gif", ".mp4"))
    rows = sorted(track.clouds)
    if not rows:
        raise InputError("the track has no clouds of particles to animate")
    ffmpeg = find_ffmpeg(out) if out.suffix.lower() == ".mp4" else None
    ensure_directory(out.parent)
    with canvas.style():
        picture, entries = _background({"estimate": track}, grid, title, None, False)
        picture.figure.set_dpi(dpi)
        picture.legend(entries)
        axes = picture.axes
        (points,) = axes.plot([], [], ".", color=_PARTICLES, ms=3.0, zorder=5.0)
        (driven,) = axes.plot([], [], color=colors.PLANS[0], lw=1.4, zorder=4.0)
        (robot,) = axes.plot([], [], "o", color=colors.PLANS[0], ms=7.0, mec="white", zorder=7.0)

        def frame(t: float) -> NDArray[np.uint8]:
            row = rows[min(round(t), len(rows) - 1)]
            cloud = track.clouds[row]
            points.set_data(cloud[:, 0], cloud[:, 1])
            past = track.poses[: row + 1]
            driven.set_data(past[:, 0], past[:, 1])
            robot.set_data(past[-1:, 0], past[-1:, 1])
            robot.set_color(_LOST if track.lost[row] else colors.PLANS[0])
            state = "lost" if track.lost[row] else f"error {track.errors[row]:.2f} m"
            picture.subtitle.set_text(f"scan {track.indices[row]}   particles {len(cloud)}   {state}")
            picture.canvas.draw()
            return np.asarray(picture.canvas.buffer_rgba())[:, :, :3].copy()

        times = np.arange(len(rows), dtype=np.float64)
        with atomic_write(out) as partial:
            if ffmpeg is None:
                write_gif(frame, times, fps, partial, progress)
            else:
                write_mp4(frame, times, fps, partial, progress, ffmpeg)
    return out


def _background(
    tracks: Mapping[str, Track], grid: OccupancyGrid, title: str, ax: Axes | None, managed: bool
) -> tuple[Picture, Entries]:
    """Return a picture with map and reference, and the entries of its legend."""
    from matplotlib.lines import Line2D

    first = next(iter(tracks.values()))
    points = [_drawable(track.poses)[:, :2] for track in tracks.values()]
    reference = _drawable(first.references)
    area = area_of([p for p in (*points, reference[:, :2]) if len(p)])
    known = first.known
    subtitle = f"{len(first.indices)} scans"
    if known.any():
        rms = ", ".join(
            f"{name} {track.absolute().position.rms:.3f} m" for name, track in tracks.items() if track.known.any()
        )
        subtitle += f"   absolute error, root mean square: {rms}"
    picture = Picture(shaped(area.grown(3.0)), title=title, subtitle=subtitle, ax=ax, managed=managed)
    drawing.draw_occupancy(picture.axes, grid, area=picture.area)
    entries: Entries = [
        (Line2D([], [], color=color, lw=1.6), name) for name, color in zip(tracks, colors.PLANS, strict=False)
    ]
    if len(reference):
        entries.append(_draw_reference(picture.axes, reference))
    entries += occupancy_legend(grid)
    if first.clouds:
        entries.append((Line2D([], [], marker=".", ls="", color=_PARTICLES), "particles"))
    if first.lost.any():
        entries.append((Line2D([], [], marker="x", ls="", color=_LOST), "lost"))
    return picture, entries


def _draw_reference(axes: Axes, path: NDArray[np.float64]) -> tuple[Any, str]:
    """Draw where the robot was; the entry of the legend."""
    return drawing.draw_line(axes, path, colors.BLACK, width=0.8, zorder=3.5, linestyle=(0, (4, 2))), "reference"


def _draw_cloud(axes: Axes, cloud: NDArray[np.float64]) -> None:
    shown = cloud[:: max(1, len(cloud) // _ARROWS)]
    axes.plot(shown[:, 0], shown[:, 1], ".", color=_PARTICLES, ms=2.5, alpha=0.6, zorder=5.0)


def _drawable(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return poses[np.isfinite(poses).all(axis=1)]


# --- global starts ----------------------------------------------------------------------------------------------------


class _Kind(NamedTuple):
    label: str
    color: str
    marker: str
    size: float


_KINDS: Final = {
    "found": _Kind("found", colors.BLUE, "o", 5.5),
    "uncertain": _Kind("stayed uncertain", colors.ORANGE, "D", 6.0),
    "wrong": _Kind("certain of a wrong pose", colors.VERMILLION, "X", 7.5),
}
"""Outcomes differ by color and by marker."""
_HEADING: Final = 0.03
"""Length of the line that shows the heading at a start, as a share of the picture's width."""


def plot_starts(
    starts: Starts,
    grid: OccupancyGrid,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    title: str = "global starts",
    dpi: float = 130.0,
) -> Any:
    """Draw the true pose of each start with its outcome, and the path of the reference, over the map.

    Draws into the axes `ax`, or a new figure (.png, .svg, .pdf). Raises OutputError. Returns the file; without a path the axes.
    """
    from matplotlib.lines import Line2D

    canvas.check_target(path, ax)
    with canvas.style():
        driven = starts.path[np.isfinite(starts.path).all(axis=1)]
        area = shaped(area_of([driven[:, :2]]).grown(3.0))
        table = starts.table()
        subtitle = f"{len(starts.results)} starts, {len(starts.of('found'))} found"
        if len(table):
            scans, seconds, meters = np.median(table, axis=0).tolist()
            subtitle += f"   median {scans:.0f} scans, {seconds:.1f} s, {meters:.1f} m"
        picture = Picture(area, title=title, subtitle=subtitle, ax=ax, managed=path is None)
        drawing.draw_occupancy(picture.axes, grid, area=picture.area)
        entries = [_draw_reference(picture.axes, driven), *occupancy_legend(grid)]
        length = _HEADING * (picture.area.max_x - picture.area.min_x)
        for outcome, kind in reversed(_KINDS.items()):
            rows = np.array([result.pose for result in starts.of(outcome)]).reshape(-1, 3)
            if not len(rows):
                continue
            ends = rows[:, :2] + length * np.column_stack((np.cos(rows[:, 2]), np.sin(rows[:, 2])))
            for row, end in zip(rows, ends, strict=True):
                picture.axes.plot([row[0], end[0]], [row[1], end[1]], color=kind.color, lw=1.4, zorder=5.0)
            style: dict[str, Any] = {
                "ls": "",
                "marker": kind.marker,
                "color": kind.color,
                "ms": kind.size,
                "mec": "white",
            }
            picture.axes.plot(rows[:, 0], rows[:, 1], zorder=6.0, mew=0.6, **style)
            entries.insert(0, (Line2D([], [], **style), kind.label))
        picture.legend(entries)
        return picture.finish(path, dpi)


# --- what a robot believed during a run -------------------------------------------------------------------------------


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


def draw_estimates(axes: Axes, record: Record, entries: Entries) -> None:
    """Draw the believed path, particles at a dozen places and ellipses at some more; nothing without a localizer."""
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

    def __init__(self, axes: Axes, record: Record) -> None:
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
        """Return the entries of the legend."""
        from matplotlib.lines import Line2D

        named = ((self._path, "believed path"), (self._points, "particles"), (self._ring, "95 % ellipse"))
        beams = Line2D([], [], color=colors.SCAN, lw=1.0)
        return [*named, (self._outline, "believed pose"), (beams, "beams from there")]

    def move_to(self, t: float) -> None:
        """Set the artists to their state at time `t` (s)."""
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
        """Return the words of the status line."""
        record = self._record
        i = record.index_at(t)
        off = float(np.hypot(*(self._believed[i, :2] - record.poses[i, :2])))
        found = estimate_at(record, t)
        lost = "    lost" if found is not None and found.lost else ""
        return f"    believed {off:.2f} m off" + ("" if found is None else f"    particles {found.count}") + lost


def _ring_of(found: RecordedEstimate) -> NDArray[np.float64]:
    return ellipse(found.pose, found.covariance)


def beams_from(record: Record, t: float, pose: Pose2D) -> NDArray[np.float64]:
    """Return a line (n, 2) along at most _MOST_BEAMS beams with a return of each lidar, and back to it."""
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
    ax: Axes | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw a moment of a run as its localizer saw it: likelihood field, beams, particles, ellipse, believed and true pose.

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
        picture.legend(entries)
        return picture.finish(path, dpi)


def _area(record: Record, found: RecordedEstimate, true: Pose2D, believed: Pose2D, t: float) -> Bounds:
    ends = [Transform2D(*believed).apply_points(scan.base_points) for scan in record.scans_at(t)]
    points = [np.array([true[:2], believed[:2]]), found.particles.astype(np.float64), *ends]
    return shaped(area_of(points).grown(1.0))


def _draw_field(axes: Axes, record: Record, grid: OccupancyGrid, area: Bounds) -> Entries:
    """Draw the likelihood field of the map, by the parameters of the run."""
    params = Scenario.from_record(record).configuration.localization.amcl or AmclParams()
    distance = distance_field(grid, params.laser_likelihood_max_dist)
    likelihood = np.exp(-0.5 * np.square(distance / params.laser_sigma_hit))
    cells = np.round(254.0 * likelihood).astype(np.uint8)
    cells[grid.data == 100] = 255
    drawing.draw_grid(axes, cells, likelihood_paint(), grid.geometry, area=area, pose=drawing.map_pose(grid))
    return [(swatch(colors.LETHAL_RGB), "occupied"), (swatch(_HIT_RGB), "likelihood of a beam's end")]


def _draw_beams(axes: Axes, record: Record, grid: OccupancyGrid, t: float, believed: Pose2D) -> Entries:
    """Draw the beams from the believed pose: those that the map explains, and the others."""
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


def _draw_poses(axes: Axes, record: Record, found: RecordedEstimate, true: Pose2D, believed: Pose2D) -> Entries:
    """Draw particles with their headings, the ellipse, and both footprints."""
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
