"""The film of a run: what the robot observed, planned and drove, frame by frame, as GIF or MP4.

The background is drawn once. Each frame restores it and draws a dozen artists over it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, Bounds, Costmap, InputError, Pose2D, Transform2D, atomic_write, ensure_directory
from navstack.plot import canvas, colors, drawing
from navstack.plot.commands import wheel_lines
from navstack.plot.encoders import find_ffmpeg, write_gif, write_mp4
from navstack.plot.localization import EstimateArtists, has_estimates
from navstack.plot.picture import Entries, Picture, cost_legend, frame_handle, occupancy_legend
from navstack.plot.run import (
    area_of_run,
    circumstances,
    draw_ends,
    draw_map,
    draw_obstacles,
    incidents,
    obstacle_patches,
    obstacles_moved,
)
from navstack.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# --- layers of a frame ------------------------------------------------------------------------------------------------


class Stamp:
    """Artists that never change, drawn once. Copying their pixels takes a tenth of the time of drawing them."""

    def __init__(self, surface: Any, axes: Axes, artists: list[Any]) -> None:
        surface.get_renderer().clear()
        for artist in artists:
            axes.draw_artist(artist)
        rgba = np.asarray(surface.buffer_rgba())
        self._at = np.nonzero(rgba[:, :, 3])
        ink = rgba[self._at].astype(np.float32)
        opacity = ink[:, 3:] / np.float32(255.0)
        self._color = ink[:, :3] * opacity
        self._through = np.float32(1.0) - opacity

    def press(self, surface: Any) -> None:
        """Blend the pixels into the canvas."""
        pixels = np.asarray(surface.buffer_rgba())[:, :, :3]
        pixels[self._at] = np.round(self._color + self._through * pixels[self._at]).astype(np.uint8)


class CostmapLayer:
    """A costmap over the map. Free cells are transparent; the local costmap has a border."""

    def __init__(self, axes: Axes, record: Record, name: str, area: Bounds) -> None:
        self.name = name
        self._area = area
        self._record = record
        self._axes = axes
        self._times = record.costmap_times(name)
        self._updates: Iterator[tuple[float, Costmap]] = iter(())
        self._next = 0
        self._image: Any = None
        self._border: Any = None
        self._drawn: Any = None

    def draw(self, t: float, picture: Picture) -> None:
        """Draw the costmap at time `t` (s); nothing before its first update."""
        wanted = int(np.searchsorted(self._times, t, side="right"))
        if wanted < self._next:
            self._image, self._next = None, 0
        if self._next == 0:
            self._updates = self._record.costmap_updates(self.name)
        costmap: Costmap | None = None
        while self._next < wanted:
            _, costmap = next(self._updates)
            self._next += 1
        if costmap is not None:
            self._show(costmap, t)
            self._drawn = None
        if self._drawn is not None:
            picture.canvas.restore_region(self._drawn)
        elif self._image is not None:
            self._axes.draw_artist(self._image)
            if self.name == "local":
                self._axes.draw_artist(self._border)
            else:
                # the global costmap is large and rarely changes; it is the first layer, so the canvas can be cached
                self._drawn = picture.canvas.copy_from_bbox(picture.figure.bbox)

    def _show(self, costmap: Costmap, t: float) -> None:
        pose = self._pose(costmap, t)
        x0, x1, y0, y1 = costmap.geometry.extent
        corners = pose.apply_points(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
        rgba, extent = drawing.visible(costmap.data, colors.COSTS, costmap.geometry, self._area, pose, clear=FREE)
        if self._image is None:
            self._image = self._axes.imshow(rgba, origin="lower", extent=extent, interpolation="nearest", animated=True)
            (self._border,) = self._axes.fill(*corners.T, fill=False, edgecolor=colors.INK, lw=1.0, ls=(0, (3, 2)))
            self._border.set_animated(True)
            self._axes.set_xlim(self._area.min_x, self._area.max_x)
            self._axes.set_ylim(self._area.min_y, self._area.max_y)
        self._image.set_data(rgba)
        self._image.set_extent(extent)
        self._image.set_transform(drawing.transform_of(pose) + self._axes.transData)
        self._border.set_xy(corners)

    def _pose(self, costmap: Costmap, t: float) -> Transform2D:
        return self._record.to_global(costmap.frame, t)


_CURRENT_S = 0.5
"""Largest age of a trajectory that is shown (s): some control cycles."""


class Film:
    """Draws the frame of any time as pixels (h, w, 3) uint8. Frames in the order of time are fastest."""

    def __init__(self, record: Record, title: str, dpi: float) -> None:
        self._record = record
        self._picture = Picture(area_of_run(record), title=title, subtitle=" ")
        self._picture.figure.set_dpi(dpi)
        axes: Axes = self._picture.axes
        draw_map(axes, record, self._picture.area)
        self._layers = [
            CostmapLayer(axes, record, name, self._picture.area)
            for name in ("global", "local")
            if len(record.costmap_times(name))
        ]
        before = set(map(id, axes.get_children()))
        obstacles = draw_obstacles(axes, record, moving=False)
        ends = draw_ends(axes, record, self._picture.points_per_m)
        marks = sorted((a for a in axes.get_children() if id(a) not in before), key=lambda a: a.get_zorder())
        for artist in marks:
            artist.set_animated(True)
        self._obstacles = _MovingObstacles(axes, record)
        self._robot = _RobotArtists(axes, record)
        self._incidents = _IncidentArtists(axes, record)
        self._beliefs = EstimateArtists(axes, record) if has_estimates(record) else None
        beliefs = [] if self._beliefs is None else self._beliefs.entries()
        self._add_legend(
            self._robot.entries() + beliefs + obstacles + self._obstacles.entries() + ends + self._incidents.entries()
        )
        self._status = self._picture.subtitle
        self._status.set_animated(True)
        surface = self._picture.canvas
        surface.draw()  # without animated artists: the background of every frame
        self._background = surface.copy_from_bbox(self._picture.figure.bbox)
        self._marks = Stamp(surface, axes, marks)

    def _add_legend(self, entries: Entries) -> None:
        grid = self._record.map
        ground = cost_legend(None) if self._layers else [] if grid is None else occupancy_legend(grid)
        if any(layer.name == "local" for layer in self._layers):
            entries = [*entries, (frame_handle(), "local costmap")]
        box = self._picture.legend(entries + ground)
        for handle in box.legend_handles:
            handle.set_animated(False)  # handles inherit it from the artists, and would not be part of the background

    def frame(self, t: float) -> NDArray[np.uint8]:
        """Return the pixels of the run at time `t` (s)."""
        axes = self._picture.axes
        self._robot.move_to(t)
        self._incidents.move_to(t)
        self._obstacles.move_to(t)
        below, above = (), ()
        if self._beliefs is not None:
            self._beliefs.move_to(t)
            below, above = self._beliefs.below, self._beliefs.above
        self._status.set_text(self._status_text(t))
        surface = self._picture.canvas
        surface.restore_region(self._background)
        for layer in self._layers:
            layer.draw(t, self._picture)
        for artist in (*self._obstacles.patches, *self._robot.paths, *below):
            axes.draw_artist(artist)
        self._marks.press(surface)
        incidents_, collisions = self._incidents.markers
        for artist in (*self._robot.body, *above, incidents_, collisions):
            axes.draw_artist(artist)
        self._picture.figure.draw_artist(self._status)
        return np.asarray(surface.buffer_rgba())[:, :, :3].copy()

    def _status_text(self, t: float) -> str:
        record = self._record
        i = record.index_at(t)
        v = record.velocities[i]
        goal = int(record.goal_indices[i])
        return (
            f"{t - float(record.times[0]):.1f} s    {record.states[i]}"
            + (f"    goal {goal + 1}" if goal >= 0 else "")
            + f"    {np.hypot(v[0], v[1]):.2f} m/s  {v[2]:+.2f} rad/s"
            + ("" if self._beliefs is None else self._beliefs.status(t))
            + ("" if record.steered_base is None else f"    steering {record.steering[i]:+.2f} rad")
        )


class _RobotArtists:
    """The robot with its driven path, plan and trajectory."""

    def __init__(self, axes: Axes, record: Record) -> None:
        self._record = record
        options: dict[str, Any] = {"animated": True}
        empty = np.empty((0, 2))
        self._plan = drawing.draw_line(axes, empty, colors.PLAN, width=1.8, zorder=4, **options)
        self._driven = drawing.draw_line(axes, empty, colors.DRIVEN, width=2.2, casing=True, zorder=5, **options)
        self._local = drawing.draw_line(axes, empty, colors.GREEN, width=4.0, casing=True, zorder=5.5, **options)
        self._footprint = drawing.draw_footprint(axes, record.footprint, Pose2D(0.0, 0.0), zorder=6)
        self._footprint.set(animated=True, facecolor=colors.FOOTPRINT, linewidth=1.4)
        self._heading = drawing.draw_line(axes, empty, colors.BLACK, width=1.6, zorder=6.1, **options)
        (self._scan,) = axes.plot([], [], ".", ms=3.0, color=colors.SCAN, ls="none", zorder=4.5, **options)
        self._wheels = drawing.draw_line(axes, empty, colors.INK, width=3.0, zorder=6.2, **options)
        self.paths = (self._scan, self._plan, self._driven, self._local)
        self.body = (self._footprint, self._heading, self._wheels)

    def entries(self) -> Entries:
        """Return the entries of the legend."""
        entries: Entries = [(self._driven, "driven path"), (self._plan, "plan")]
        if (self._record.arrays["local_plans"]["poses"] > 0).any():
            entries.append((self._local, "chosen trajectory"))
        if len(self._record.scans):
            entries.append((self._scan, "scan"))
        return [*entries, (self._footprint, "footprint")]

    def move_to(self, t: float) -> None:
        """Set the artists to their state at time `t` (s)."""
        record = self._record
        i = record.index_at(t)
        pose = drawing.pose_of(record.poses[i])
        self._driven.set_data(*record.poses[: i + 1, :2].T)
        plan = record.plan_at(t)
        points = np.empty((0, 3)) if plan is None else record.to_global(plan.frame, plan.t).apply_poses(plan.poses)
        self._plan.set_data(*points[:, :2].T)
        local = record.local_plan_at(t)
        # an older one is no longer driven: the robot plans, recovers or has arrived
        trajectory = None if local is None or t - local.t > _CURRENT_S else local.plan.trajectory
        points = np.empty((0, 3)) if trajectory is None else self._local_frame(t).apply_poses(trajectory)
        self._local.set_data(*points[:, :2].T)
        scans = [scan.points for scan in record.scans_at(t)]
        self._scan.set_data(*np.concatenate([np.empty((0, 2)), *scans]).T)
        self._footprint.set_xy(record.footprint.at(pose))
        if record.steered_base is not None:
            self._wheels.set_data(*wheel_lines(record, i).T)
        reach = record.footprint.circumscribed_radius
        self._heading.set_data([pose.x, pose.x + reach * np.cos(pose.yaw)], [pose.y, pose.y + reach * np.sin(pose.yaw)])

    def _local_frame(self, t: float) -> Transform2D:
        return self._record.to_global(self._record.costmap_frame("local"), t)


class _IncidentArtists:
    """Markers of recoveries and collisions."""

    def __init__(self, axes: Axes, record: Record) -> None:
        self._record = record
        self._times = np.array([event.time for event in incidents(record)])
        self._points = np.array([record.pose_at(t)[:2] for t in self._times]).reshape(-1, 2)
        options: dict[str, Any] = {"animated": True, "ls": "none"}
        (recoveries,) = drawing.draw_rings(axes, np.empty((0, 2)), colors.RECOVERY, animated=True)
        (collisions,) = axes.plot([], [], "X", ms=11, color=colors.COLLISION, mec="black", mew=1.1, **options)
        self.markers = (recoveries, collisions)

    def entries(self) -> Entries:
        """Return the entries of the legend."""
        occurred = (len(self._points) > 0, len(self._record.collisions) > 0)
        handles = (drawing.ring_handle(colors.RECOVERY), self.markers[1])
        named = zip(occurred, handles, ("recovery", "collision"), strict=True)
        return [(marker, name) for any_, marker, name in named if any_]

    def move_to(self, t: float) -> None:
        """Show the incidents until time `t` (s)."""
        record = self._record
        recoveries, collisions = self.markers
        recoveries.set_data(*self._points[self._times <= t].T)
        collisions.set_data(*record.collisions[record.collision_times <= t, :2].T)


class _MovingObstacles:
    """Patches of the obstacles that move during the run."""

    def __init__(self, axes: Axes, record: Record) -> None:
        self._record = record
        self._rows = [k for k, moved in enumerate(obstacles_moved(record)) if moved]
        _, self.patches = obstacle_patches(record, float(record.times[0]))
        for patch in self.patches:
            patch.set_animated(True)
            axes.add_patch(patch)

    def entries(self) -> Entries:
        """Return the entry of the legend; empty without moving obstacles."""
        return [(self.patches[0], "moving obstacle")] if self.patches else []

    def move_to(self, t: float) -> None:
        """Move the patches to their places at time `t` (s)."""
        discs, polygons = self._record.solids_at(t, absent=True)
        for patch, k in zip(self.patches, self._rows, strict=True):
            if k < len(discs):
                patch.set_center(discs[k, :2])
            else:
                patch.set_xy(polygons[k - len(discs)])


# --- the film of a run ------------------------------------------------------------------------------------------------


def animate_run(
    record: Record,
    path: str | os.PathLike[str],
    *,
    fps: float = 10.0,
    speed: float = 4.0,
    title: str | None = None,
    dpi: float = 90.0,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a run as .gif or .mp4, with `fps` frames per second and `speed` simulated seconds per second.

    `progress(done, total)` is called after every frame. Frames are encoded one by one, so that the memory does not grow with
    the run. Raises OutputError for another suffix, a missing ffmpeg (MP4) or an unwritable folder; InputError for `fps` or
    `speed` that are not positive, and for a run without samples. Returns the file.
    """
    out = Path(path)
    canvas.check_format(out, (".gif", ".mp4"))
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be a positive number, not {value}", **{name: value})
    if not len(record.times):
        raise InputError("the run has no samples to animate")
    ffmpeg = find_ffmpeg(out) if out.suffix.lower() == ".mp4" else None
    ensure_directory(out.parent)
    with canvas.style():
        film = Film(record, title or circumstances(record) or "run", dpi)
        times = _frame_times(record, fps, speed)
        with atomic_write(out) as partial:
            if ffmpeg is None:
                write_gif(film.frame, times, fps, partial, progress)
            else:
                write_mp4(film.frame, times, fps, partial, progress, ffmpeg)
    return out


def _frame_times(record: Record, fps: float, speed: float) -> NDArray[np.float64]:
    first, last = float(record.times[0]), float(record.times[-1])
    count = int(np.ceil((last - first) * fps / speed)) + 1
    return np.minimum(first + np.arange(count) * (speed / fps), last)
