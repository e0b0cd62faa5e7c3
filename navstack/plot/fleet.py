"""The picture and the film of a fleet: the paths of all robots on one map, from their records."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Footprint, InputError, atomic_write, ensure_directory
from navstack.plot import canvas, colors, drawing
from navstack.plot.encoders import find_ffmpeg, write_gif, write_mp4
from navstack.plot.picture import Entries, Picture, area_of, disc_handle, occupancy_legend, shaped
from navstack.plot.run import area_of_run, draw_map, obstacle_patches, obstacles_moved
from navstack.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_NAMES: Final = 10
"""A legend names the robots of a fleet up to this size; the marks name those of a larger one."""
_TAIL_S: Final = 12.0
"""Length of the path behind a robot in a film (s)."""


def fleet_records(folder: str | os.PathLike[str]) -> dict[str, Record]:
    """Return the records of the robots of a fleet by name: those in the folders of `folder`; none if it has none."""
    files = sorted(Path(folder).glob("*/run.npz"))
    records = [Record.load(file) for file in files]
    return {str(r.scenario["robot"]): r for r in records if "fleet" in r.scenario}


def plot_fleet(
    records: Mapping[str, Record],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    title: str | None = None,
    area: Bounds | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw the paths, starts and goals of all robots to a .png, .svg or .pdf; arguments as of `plot_run`.

    Where two robots touched each other is marked. Raises OutputError, and InputError without records.
    """
    canvas.check_target(path, ax)
    first = _first(records)
    with canvas.style():
        picture = Picture(
            area or _area(records),
            title=title or _headline(records),
            subtitle=_subtitle(records),
            ax=ax,
            managed=path is None,
        )
        draw_map(picture.axes, first, picture.area)
        entries = _draw_obstacles(picture.axes, first)
        marks: list[drawing.Mark] = []
        contacts: list[NDArray[np.float64]] = []
        for number, (name, record) in enumerate(records.items()):
            color = _color(number)
            line = drawing.draw_line(picture.axes, record.poses, color, width=2.0, casing=True, zorder=5)
            if len(records) <= _MOST_NAMES:
                entries.append((line, name))
            _draw_body(picture.axes, record.footprint, drawing.pose_of(record.poses[-1]), color)
            marks.append(drawing.Mark(drawing.pose_of(record.poses[0]), str(number + 1), color, hollow=True))
            marks += [drawing.Mark(drawing.pose_of(goal), str(number + 1), color) for goal in record.goals]
            contacts.append(record.collisions)
        drawing.draw_marks(picture.axes, marks, picture.points_per_m)
        touched = np.concatenate([np.empty((0, 3)), *contacts])
        if len(touched):
            (cross,) = picture.axes.plot(
                *touched[:, :2].T, "X", ms=11, color=colors.COLLISION, mec="black", mew=1.1, ls="none", zorder=9
            )
            entries.append((cross, "contact"))
        entries += [(disc_handle(colors.INK, hollow=True), "start"), (disc_handle(colors.INK), "goal")]
        picture.legend(entries + ([] if first.map is None else occupancy_legend(first.map)))
        return picture.finish(path, dpi)


class FleetFilm:
    """Draws all robots at any time as pixels (h, w, 3) uint8: bodies, the last part of their paths, their plans and goals."""

    def __init__(self, records: Mapping[str, Record], title: str, dpi: float) -> None:
        self._records = list(records.values())
        first = _first(records)
        self._picture = Picture(_area(records), title=title, subtitle=" ")
        self._picture.figure.set_dpi(dpi)
        axes: Axes = self._picture.axes
        draw_map(axes, first, self._picture.area)
        entries = _draw_obstacles(axes, first)
        empty = np.empty((0, 2))
        options: dict[str, Any] = {"animated": True}
        self._plans: list[Any] = []
        self._tails: list[Any] = []
        self._bodies: list[Any] = []
        self._headings: list[Any] = []
        for number, (name, record) in enumerate(records.items()):
            color = _color(number)
            self._plans.append(
                drawing.draw_line(axes, empty, color, width=1.0, linestyle=(0, (4, 2)), zorder=4, **options)
            )
            self._tails.append(drawing.draw_line(axes, empty, color, width=2.2, zorder=5, **options))
            body = _draw_body(axes, record.footprint, drawing.pose_of(record.poses[0]), color)
            body.set_animated(True)
            self._bodies.append(body)
            self._headings.append(drawing.draw_line(axes, empty, colors.BLACK, width=1.4, zorder=6.1, **options))
            if len(records) <= _MOST_NAMES:
                entries.append((body, name))
        box = self._picture.legend(entries + ([] if first.map is None else occupancy_legend(first.map)))
        for handle in box.legend_handles:
            handle.set_animated(False)
        self._status = self._picture.subtitle
        self._status.set_animated(True)
        surface = self._picture.canvas
        surface.draw()
        self._background = surface.copy_from_bbox(self._picture.figure.bbox)

    def frame(self, t: float) -> NDArray[np.uint8]:
        """Return the pixels of the fleet at time `t` (s)."""
        busy = 0
        for number, record in enumerate(self._records):
            i = record.index_at(t)
            pose = drawing.pose_of(record.poses[i])
            tail = record.poses[record.index_at(max(t - _TAIL_S, float(record.times[0]))) : i + 1]
            self._tails[number].set_data(*tail[:, :2].T)
            driving = t <= float(record.times[-1])
            busy += driving
            plan = record.plan_at(t) if driving else None
            points = np.empty((0, 3)) if plan is None else record.to_global(plan.frame, plan.t).apply_poses(plan.poses)
            self._plans[number].set_data(*points[:, :2].T)
            self._bodies[number].set_xy(record.footprint.at(pose))
            reach = record.footprint.circumscribed_radius
            tip = pose.x + reach * np.cos(pose.yaw), pose.y + reach * np.sin(pose.yaw)
            self._headings[number].set_data([pose.x, tip[0]], [pose.y, tip[1]])
        self._status.set_text(f"{t:.1f} s    {busy} of {len(self._records)} robots on their way")
        surface, axes = self._picture.canvas, self._picture.axes
        surface.restore_region(self._background)
        for artist in (*self._plans, *self._tails, *self._bodies, *self._headings):
            axes.draw_artist(artist)
        self._picture.figure.draw_artist(self._status)
        return np.asarray(surface.buffer_rgba())[:, :, :3].copy()


def animate_fleet(
    records: Mapping[str, Record],
    path: str | os.PathLike[str],
    *,
    fps: float = 10.0,
    speed: float = 4.0,
    title: str | None = None,
    dpi: float = 90.0,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a fleet as .gif or .mp4; arguments and errors as of `animate_run`."""
    out = Path(path)
    canvas.check_format(out, (".gif", ".mp4"))
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be a positive number, not {value}", **{name: value})
    _first(records)
    ffmpeg = find_ffmpeg(out) if out.suffix.lower() == ".mp4" else None
    ensure_directory(out.parent)
    with canvas.style():
        film = FleetFilm(records, title or _subtitle(records) or "fleet", dpi)
        end = max(float(record.times[-1]) for record in records.values())
        times: NDArray[np.float64] = np.minimum(np.arange(int(np.ceil(end * fps / speed)) + 1) * (speed / fps), end)
        with atomic_write(out) as partial:
            if ffmpeg is None:
                write_gif(film.frame, times, fps, partial, progress)
            else:
                write_mp4(film.frame, times, fps, partial, progress, ffmpeg)
    return out


# --- parts ------------------------------------------------------------------------------------------------------------


def _first(records: Mapping[str, Record]) -> Record:
    for record in records.values():
        if len(record.times):
            return record
    raise InputError("there is no record of a robot of a fleet; record one with: navstack simulate FLEET.yaml")


def _color(number: int) -> str:
    return colors.PLANS[number % len(colors.PLANS)]


def _area(records: Mapping[str, Record]) -> Bounds:
    areas = [area_of_run(record) for record in records.values()]
    corners = np.array([[(a.min_x, a.min_y), (a.max_x, a.max_y)] for a in areas], np.float64).reshape(-1, 2)
    return shaped(area_of([corners]))


def _draw_obstacles(axes: Axes, record: Record) -> Entries:
    """Draw what stands in the world besides the map and the robots."""
    still, _ = obstacle_patches(record, 0.0)
    others = len(record.scenario["fleet"]["robots"]) - 1
    fixed = [k for k, moved in enumerate(obstacles_moved(record)) if not moved]
    known = len(obstacles_moved(record)) - others
    shown = [patch for patch, k in zip(still, fixed, strict=True) if k < known]
    for patch in shown:
        axes.add_patch(patch)
    return [(shown[0], "obstacle, not on the map")] if shown else []


def _draw_body(axes: Axes, footprint: Footprint, pose: Any, color: str) -> Any:
    patch = drawing.draw_footprint(axes, footprint, pose, zorder=6)
    patch.set(facecolor=color, edgecolor=colors.INK, linewidth=0.8, alpha=0.9)
    return patch


def _headline(records: Mapping[str, Record]) -> str:
    results = [result for record in records.values() for result in record.results]
    reached = sum(result.get("state") == "SUCCEEDED" for result in results)
    end = max(float(record.times[-1]) for record in records.values() if len(record.times))
    robots = "1 robot" if len(records) == 1 else f"{len(records)} robots"
    # a record does not name the other robot: the number of contacts is not known here
    touched = sum(len(record.collision_times) > 0 for record in records.values())
    hit = f", {touched} robot{'s' * (touched != 1)} with contacts" if touched else ""
    tasks = _first(records).scenario["fleet"].get("tasks")
    done = f"{reached} of {len(results)} goals reached" if not tasks else f"{len(tasks['tasks'])} tasks"
    return f"{robots}: {done} in {end:.1f} s{hit}"


def _subtitle(records: Mapping[str, Record]) -> str:
    scenario = _first(records).scenario
    fleet = scenario["fleet"]
    rule = fleet["traffic"].get("rule", "none")
    parts = [
        fleet["name"],
        f"map {Path(str(scenario.get('map', ''))).stem}",
        f"traffic {rule}",
        f"seed {fleet['seed']}",
    ]
    return "   ".join(part for part in parts if part)
