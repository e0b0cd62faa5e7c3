"""Pictures and animations of localization: estimates, reference and particles over the map."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import OccupancyGrid, Transform2D
from navstack.core.errors import InputError
from navstack.core.files import atomic_write, ensure_directory
from navstack.drives.follow import Track
from navstack.plot import areas, canvas, colors, drawing, legend
from navstack.plot.encoders import find_ffmpeg, write_gif, write_mp4
from navstack.plot.picture import Picture

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
    ax: Any = None,
    title: str = "localization",
    dpi: float = 130.0,
) -> Any:
    """Draws the estimates of one or two tracks by name, the reference, and the particles at a dozen scans, over the map.

    Draws into the axes `ax`, or a new figure (.png, .svg, .pdf). Raises OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    with canvas.style():
        picture, handles, labels = _background(tracks, grid, title, ax, path is None)
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
        picture.legend(handles, labels)
        return picture.finish(path, dpi)


def plot_track_errors(tracks: Mapping[str, Track], path: str | os.PathLike[str], *, dpi: float = 130.0) -> Any:
    """Draws distance to the reference, explained share and number of particles over the scans. Returns the file."""
    canvas.check_target(path, None)
    with canvas.style():
        figure = canvas.new_figure(9.2, 6.0, layout="constrained")
        axes: Any = figure.subplots(3, 1, sharex=True)
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
    """Writes the clouds of particles as .gif or .mp4, a frame for each that the track has kept. Returns the file."""
    out = Path(path)
    canvas.check_format(out, (".gif", ".mp4"))
    rows = sorted(track.clouds)
    if not rows:
        raise InputError("the track has no clouds of particles to animate")
    ffmpeg = find_ffmpeg(out) if out.suffix.lower() == ".mp4" else None
    ensure_directory(out.parent)
    with canvas.style():
        picture, handles, labels = _background({"estimate": track}, grid, title, None, False)
        picture.figure.set_dpi(dpi)
        picture.legend(handles, labels)
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
    tracks: Mapping[str, Track], grid: OccupancyGrid, title: str, ax: Any, managed: bool
) -> tuple[Picture, list[Any], list[str]]:
    """Return a picture with map and reference, and the entries of its legend."""
    from matplotlib.lines import Line2D

    first = next(iter(tracks.values()))
    points = [_drawable(track.poses)[:, :2] for track in tracks.values()]
    reference = _drawable(first.references)
    area = areas.area_of([p for p in (*points, reference[:, :2]) if len(p)])
    known = first.known
    subtitle = f"{len(first.indices)} scans"
    if known.any():
        rms = ", ".join(
            f"{name} {track.absolute().position.rms:.3f} m" for name, track in tracks.items() if track.known.any()
        )
        subtitle += f"   absolute error, root mean square: {rms}"
    picture = Picture(areas.shaped(area.grown(3.0)), title=title, subtitle=subtitle, ax=ax, managed=managed)
    g = grid.geometry
    corner = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw) @ Transform2D(-g.origin_x, -g.origin_y, 0.0)
    drawing.draw_grid(picture.axes, grid.data, colors.OCCUPANCY, g, area=picture.area, pose=corner)
    handles, labels = legend.occupancy_legend()
    if len(reference):
        drawing.draw_line(picture.axes, reference, colors.BLACK, width=0.8, zorder=3.5, linestyle=(0, (4, 2)))
        handles.insert(0, Line2D([], [], color=colors.BLACK, lw=0.8, linestyle=(0, (4, 2))))
        labels.insert(0, "reference")
    for (name, _), color in reversed(list(zip(tracks.items(), colors.PLANS, strict=False))):
        handles.insert(0, Line2D([], [], color=color, lw=1.6))
        labels.insert(0, name)
    if first.clouds:
        handles.append(Line2D([], [], marker=".", ls="", color=_PARTICLES))
        labels.append("particles")
    if first.lost.any():
        handles.append(Line2D([], [], marker="x", ls="", color=_LOST))
        labels.append("lost")
    return picture, handles, labels


def _draw_cloud(axes: Any, cloud: NDArray[np.float64]) -> None:
    shown = cloud[:: max(1, len(cloud) // _ARROWS)]
    axes.plot(shown[:, 0], shown[:, 1], ".", color=_PARTICLES, ms=2.5, alpha=0.6, zorder=5.0)


def _drawable(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return poses[np.isfinite(poses).all(axis=1)]
