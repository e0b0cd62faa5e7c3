"""A run as a film: what the robot knew, where it was told to go, and where it went, frame by frame.

The ground is drawn once; each frame restores it and draws a dozen artists over it, then goes to the encoder, so that
memory stays flat. GIF needs nothing but pillow; MP4 needs the program ffmpeg.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, Bounds, Costmap, Pose2D, Transform2D
from navstack.core.errors import InputError, OutputError
from navstack.core.files import ensure_directory, written_whole
from navstack.plot import canvas, colors
from navstack.plot.run import (
    area_of_run,
    draw_ends,
    draw_map,
    draw_obstacles,
    headline,
    incidents,
    solid_patches,
    solids_moved,
)
from navstack.record import Record

_HOLD_S = 2.0
"""How long the last frame stays, in seconds of the film."""


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
    """Writes a run as .gif or .mp4: `fps` frames a second, each second showing `speed` seconds of the run.

    `progress(done, total)` is called once per frame. Raises OutputError: an ending that is neither, no ffmpeg for MP4, a
    folder that cannot be written to; InputError for `fps` or `speed` that are not positive. Returns the file.
    """
    out = Path(path)
    canvas.check_format(out, (".gif", ".mp4"))
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be a positive number, not {value}", **{name: value})
    if not len(record.times):
        raise InputError("this run has no samples, so there is nothing to animate")
    encoder = _ffmpeg(out) if out.suffix.lower() == ".mp4" else None
    ensure_directory(out.parent)
    with canvas.style():
        film = _Film(record, title or headline(record), dpi)
        times = _frame_times(record, fps, speed)
        with written_whole(out) as beside:
            if encoder is None:
                _write_gif(film, times, fps, beside, progress)
            else:
                _write_mp4(film, times, fps, beside, progress, encoder)
    return out


def _frame_times(record: Record, fps: float, speed: float) -> NDArray[np.float64]:
    first, last = float(record.times[0]), float(record.times[-1])
    count = int(np.ceil((last - first) * fps / speed)) + 1
    return np.minimum(first + np.arange(count) * (speed / fps), last)


class _Film:
    """Draws the frame of any time as pixels (h, w, 3) uint8; fastest when times only grow."""

    def __init__(self, record: Record, title: str, dpi: float) -> None:
        self.record = record
        area = area_of_run(record)
        self.picture = canvas.Picture(area, title=title, subtitle=" ")
        self.picture.figure.set_dpi(dpi)
        axes: Any = self.picture.axes
        draw_map(axes, record, self.picture.area)
        entries: list[tuple[Any, str]] = []
        self._layers = [
            _Layer(axes, record, name, self.picture.area)
            for name in ("global", "local")
            if len(record.costmap_times(name))
        ]
        before = set(map(id, axes.get_children()))
        obstacles = draw_obstacles(axes, record, moving=False)
        ends = draw_ends(axes, record, self.picture.points_per_m)
        marks = sorted((a for a in axes.get_children() if id(a) not in before), key=lambda a: a.get_zorder())
        for artist in marks:
            artist.set_animated(True)
        self._moved = [k for k, moved in enumerate(solids_moved(record)) if moved]
        _, self._movers = solid_patches(record, float(record.times[0]))
        for patch in self._movers:
            patch.set_animated(True)
            axes.add_patch(patch)
        options: dict[str, Any] = {"animated": True}
        empty = np.empty((0, 2))
        self._plan = canvas.draw_line(axes, empty, colors.PLAN, width=1.8, zorder=4, **options)
        self._trail = canvas.draw_line(axes, empty, colors.DRIVEN, width=2.2, casing=True, zorder=5, **options)
        self._local = canvas.draw_line(axes, empty, colors.GREEN, width=2.2, zorder=5.5, **options)
        self._footprint = canvas.draw_footprint(axes, record.footprint, Pose2D(0.0, 0.0), zorder=6)
        self._footprint.set(animated=True, facecolor=colors.FOOTPRINT, linewidth=1.4)
        self._nose = canvas.draw_line(axes, empty, colors.BLACK, width=1.6, zorder=6.1, **options)
        options["ls"] = "none"
        (self._recoveries,) = axes.plot([], [], "D", ms=8, color=colors.RECOVERY, mec="white", mew=1.2, **options)
        (self._contacts,) = axes.plot([], [], "X", ms=11, color=colors.COLLISION, mec="black", mew=1.1, **options)
        entries += [(self._trail, "driven path"), (self._plan, "plan")]
        if (record.arrays["local_plans"]["poses"] > 0).any():
            entries.append((self._local, "chosen trajectory"))
        entries.append((self._footprint, "footprint"))
        entries += obstacles
        if self._movers:
            entries.append((self._movers[0], "what moves"))
        entries += ends
        self._incident_times = np.array([event.time for event in incidents(record)])
        self._incident_at = np.array([record.pose_at(t)[:2] for t in self._incident_times]).reshape(-1, 2)
        if len(self._incident_at):
            entries.append((self._recoveries, "recovery"))
        if len(record.collisions):
            entries.append((self._contacts, "collision"))
        bands, texts = canvas.cost_legend(None) if self._layers else canvas.occupancy_legend()
        if any(layer.name == "local" for layer in self._layers):
            entries.append((canvas.frame_handle(), "local costmap"))
        self.picture.legend([h for h, _ in entries] + bands, [label for _, label in entries] + texts)
        self._clock = self.picture.subtitle
        self._clock.set_animated(True)
        figure_canvas = self.picture.canvas
        # animated artists are left out of draw(): what is drawn now is the ground of every frame
        figure_canvas.draw()
        self._ground = figure_canvas.copy_from_bbox(self.picture.figure.bbox)
        self._marks = _Stamp(figure_canvas, axes, marks)

    def _local_pose(self, t: float) -> Transform2D:
        return self.record.to_global(self.record.costmap_frame("local"), t)

    def _move(self, t: float) -> None:
        """Puts what moves where it was at `t` (s)."""
        discs, polygons = self.record.solids_at(t)
        for patch, k in zip(self._movers, self._moved, strict=True):
            if k < len(discs):
                patch.set_center(discs[k, :2])
            else:
                patch.set_xy(polygons[k - len(discs)])

    def frame(self, t: float) -> NDArray[np.uint8]:
        """The pixels of the run at time `t` (s)."""
        record, axes = self.record, self.picture.axes
        i = record.index_at(t)
        pose = canvas.pose_of(record.poses[i])
        self._trail.set_data(*record.poses[: i + 1, :2].T)
        plan = record.plan_at(t)
        points = np.empty((0, 3)) if plan is None else record.to_global(plan.frame, plan.t).apply_poses(plan.poses)
        self._plan.set_data(*points[:, :2].T)
        local = record.local_plan_at(t)
        trajectory = None if local is None else local.plan.trajectory
        points = np.empty((0, 3)) if trajectory is None else self._local_pose(t).apply_poses(trajectory)
        self._local.set_data(*points[:, :2].T)
        self._footprint.set_xy(record.footprint.at(pose))
        reach = record.footprint.circumscribed_radius
        self._nose.set_data([pose.x, pose.x + reach * np.cos(pose.yaw)], [pose.y, pose.y + reach * np.sin(pose.yaw)])
        self._recoveries.set_data(*self._incident_at[self._incident_times <= t].T)
        self._contacts.set_data(*record.collisions[record.collision_times <= t, :2].T)
        v = record.velocities[i]
        goal = int(record.goal_indices[i])
        self._clock.set_text(
            f"{t - float(record.times[0]):.1f} s    {record.states[i]}"
            + (f"    goal {goal + 1}" if goal >= 0 else "")
            + f"    {np.hypot(v[0], v[1]):.2f} m/s  {v[2]:+.2f} rad/s"
        )
        surface = self.picture.canvas
        surface.restore_region(self._ground)
        for layer in self._layers:
            layer.draw(t, self.picture)
        self._move(t)
        for artist in (*self._movers, self._plan, self._trail, self._local):
            axes.draw_artist(artist)
        self._marks.press(surface)
        for artist in (self._recoveries, self._contacts, self._footprint, self._nose):
            axes.draw_artist(artist)
        self.picture.figure.draw_artist(self._clock)
        return np.asarray(surface.buffer_rgba())[:, :, :3].copy()


class _Stamp:
    """Artists that never change, drawn once: pressing their pixels onto a frame takes a tenth of drawing them."""

    def __init__(self, surface: Any, axes: Any, artists: list[Any]) -> None:
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
        """Onto what the canvas shows."""
        pixels = np.asarray(surface.buffer_rgba())[:, :, :3]
        pixels[self._at] = np.round(self._color + self._through * pixels[self._at]).astype(np.uint8)


class _Layer:
    """A costmap over the map: what is free stays clear, a rolling one gets a frame around it."""

    def __init__(self, axes: Any, record: Record, name: str, area: Bounds) -> None:
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

    def draw(self, t: float, picture: canvas.Picture) -> None:
        """Draws the state at time `t`; nothing before the first update."""
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
                # a map is large and changes once in many frames; it is the first layer, so the whole canvas can be kept
                self._drawn = picture.canvas.copy_from_bbox(picture.figure.bbox)

    def _show(self, costmap: Costmap, t: float) -> None:
        pose = self._pose(costmap, t)
        x0, x1, y0, y1 = costmap.geometry.extent
        corners = pose.apply_points(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
        rgba, extent = canvas.visible(costmap.data, colors.COSTS, costmap.geometry, self._area, pose, clear=FREE)
        if self._image is None:
            self._image = self._axes.imshow(rgba, origin="lower", extent=extent, interpolation="nearest", animated=True)
            (self._border,) = self._axes.fill(*corners.T, fill=False, edgecolor=colors.INK, lw=1.0, ls=(0, (3, 2)))
            self._border.set_animated(True)
            self._axes.set_xlim(self._area.min_x, self._area.max_x)
            self._axes.set_ylim(self._area.min_y, self._area.max_y)
        self._image.set_data(rgba)
        self._image.set_extent(extent)
        self._image.set_transform(canvas.transform_of(pose) + self._axes.transData)
        self._border.set_xy(corners)

    def _pose(self, costmap: Costmap, t: float) -> Transform2D:
        return self._record.to_global(costmap.frame, t)


# --- encoders ---------------------------------------------------------------------------------------------------------


def _write_gif(
    film: _Film, times: NDArray[np.float64], fps: float, path: Path, progress: Callable[[int, int], None] | None
) -> None:
    from PIL import Image

    palette = _Palette([film.frame(float(t)) for t in times[:: max(1, len(times) // 5)]])

    def frames() -> Iterator[Image.Image]:
        for done, t in enumerate(times[1:], 2):
            yield palette.paint(film.frame(float(t)))
            if progress is not None:
                progress(done, len(times))

    first = palette.paint(film.frame(float(times[0])))
    if progress is not None:
        progress(1, len(times))
    shown = [max(2, round(100.0 / fps)) * 10] * len(times)
    shown[-1] = int(_HOLD_S * 1000)
    # an open file: pillow would not close its own when a frame fails
    with path.open("wb") as out:
        first.save(
            out, format="GIF", save_all=True, append_images=frames(), duration=shown, loop=0, optimize=False, disposal=1
        )


class _Palette:
    """256 colours for the whole film: no flicker, and equal pixels stay equal, which keeps the file small.

    The colours that mean something are in it exactly; the shades between them share the rest.
    """

    def __init__(self, frames: list[NDArray[np.uint8]]) -> None:
        from PIL import Image

        exact = colors.exact_colors()
        shades = Image.fromarray(np.concatenate(frames)).quantize(256 - len(exact), method=Image.Quantize.MEDIANCUT)
        self._table = np.concatenate((exact, np.array(shades.getpalette("RGB"), np.uint8).reshape(-1, 3)))
        # entry of every colour there is, filled in as colours turn up
        self._entry = np.zeros(1 << 24, np.uint8)
        self._known = np.zeros(1 << 24, np.bool_)

    def paint(self, frame: NDArray[np.uint8]) -> Any:
        """The frame with every pixel in the nearest of the colours, as pillow's image."""
        from PIL import Image

        rgb = frame.astype(np.uint32)
        codes = (rgb[:, :, 0] << 16) | (rgb[:, :, 1] << 8) | rgb[:, :, 2]
        new = np.unique(codes[~self._known[codes]])
        for part in np.array_split(new, len(new) // 4096 + 1):
            split = np.stack((part >> 16, part >> 8 & 255, part & 255), axis=1).astype(np.int32)
            distance = ((split[:, None, :] - self._table.astype(np.int32)) ** 2).sum(axis=2)
            self._entry[part] = distance.argmin(axis=1)
            self._known[part] = True
        image = Image.fromarray(self._entry[codes], mode="P")
        image.putpalette(self._table.tobytes())
        return image


def _ffmpeg(path: Path) -> str:
    program = shutil.which("ffmpeg")
    if program is None:
        raise OutputError(
            f"cannot write {path.name}: MP4 needs the program ffmpeg, which is not installed; "
            f"install it or write {path.stem}.gif instead",
            path=str(path),
        )
    return program


def _write_mp4(
    film: _Film,
    times: NDArray[np.float64],
    fps: float,
    path: Path,
    progress: Callable[[int, int], None] | None,
    program: str,
) -> None:
    frame = film.frame(float(times[0]))
    # H.264 with 4:2:0 colours wants even sizes
    height, width = frame.shape[0] // 2 * 2, frame.shape[1] // 2 * 2
    command = [
        *(program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
        *("-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-", "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p"),
        *("-crf", "20", "-threads", "1", "-bitexact", "-map_metadata", "-1", "-movflags", "+faststart"),
        *("-f", "mp4", str(path)),
    ]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stderr is not None
    held = round(_HOLD_S * fps)
    try:
        for done, t in enumerate(times, 1):
            pixels = np.ascontiguousarray(film.frame(float(t))[:height, :width]).tobytes()
            for _ in range(1 + (held if done == len(times) else 0)):
                process.stdin.write(pixels)
            if progress is not None:
                progress(done, len(times))
    except BrokenPipeError:
        pass  # ffmpeg gave up: its own words say why
    except BaseException:
        process.kill()
        raise
    finally:
        _, errors = process.communicate()
    if process.returncode != 0:
        reason = errors.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise OutputError(f"ffmpeg could not write {path.name}: {reason[-1]}; write a .gif instead", path=str(path))
