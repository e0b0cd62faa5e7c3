"""A picture of a docking: what the robot drove in each state, the dock, and how far it was from it over time."""

from __future__ import annotations

import math
import os
from typing import Any, Final

import numpy as np

from navstack.core import InputError, Pose2D
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import Entries, Picture, area_of, disc_handle
from navstack.plot.run import circumstances, draw_map, draw_obstacles
from navstack.record import Record

STATE_COLORS: Final = {
    "NAV_TO_STAGING_POSE": colors.BLUE,
    "INITIAL_PERCEPTION": colors.ORANGE,
    "CONTROLLING": colors.GREEN,
    "WAIT_FOR_CHARGE": colors.BLACK,
    "RETRY": colors.PURPLE,
}
"""State of docking -> color of the path driven in it."""
AROUND_M: Final = 1.3
"""Distance around the dock that the picture shows at least."""


def plot_docking(
    record: Record,
    path: str | os.PathLike[str] | None = None,
    *,
    docking: int = 1,
    ax: Any = None,
    whole: bool = False,
    dpi: float = 130.0,
) -> Any:
    """Draw docking number `docking` (from 1) of a record, near the dock or the `whole` way, to a .png, .svg or .pdf.

    Below the map a strip shows the distance to the dock over time. Draws into the axes `ax`, without the strip, or a new figure.
    Raises InputError for a record without that docking, and OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    ends = [event for event in record.events if event.kind == "docking" and "parts" in event.data]
    if not 1 <= docking <= len(ends):
        raise InputError(f"docking {docking}: this run has {len(ends)} of them", docking=docking)
    data = ends[docking - 1].data
    visits = data["states"]
    rows = [_rows(record, visit["begin"], visit["end"]) for visit in visits]
    dock = _dock_pose(record, data)
    near = [pose for part in rows for pose in record.poses[part]]
    kept = [pose for pose in near if whole or math.hypot(pose[0] - dock.x, pose[1] - dock.y) <= AROUND_M]
    corners = np.array([[dock.x - 0.5, dock.y - 0.5, 0.0], [dock.x + 0.5, dock.y + 0.5, 0.0]])
    with canvas.style():
        name, status = data.get("dock", "dock"), data["status"]
        verb = "undocking from" if data.get("kind") == "undock" else "docking at"
        retries = data.get("num_retries", 0)
        again = f", {retries} {'retry' if retries == 1 else 'retries'}" if retries else ""
        picture = Picture(
            area_of([corners, np.array(kept)]) if kept else area_of([corners]),
            title=f"{verb} {name}: {status}{again}",
            subtitle=str(data.get("message") or circumstances(record))[:150],
            ax=ax,
            managed=path is None,
        )
        draw_map(picture.axes, record, picture.area)
        entries: Entries = []
        used: set[str] = set()
        for visit, part in zip(visits, rows):
            state = str(visit["state"])
            color = STATE_COLORS.get(state, colors.INK)
            back = state == "RETRY"  # a wide line below that of the next attempt, which covers the same way
            width, zorder = (11.0, 4) if back else (2.4, 5)
            line = drawing.draw_line(
                picture.axes,
                record.poses[part],
                color,
                width=width,
                casing=not back,
                zorder=zorder,
                alpha=0.7 if back else 1.0,
            )
            if state not in used:
                entries.append((line, state))
                used.add(state)
        entries += draw_obstacles(picture.axes, record)
        last = rows[-1].stop - 1 if rows else len(record.times) - 1
        if len(record.times):
            at = drawing.pose_of(record.poses[min(max(last, 0), len(record.poses) - 1)])
            entries.append((drawing.draw_footprint(picture.axes, record.footprint, at), "robot at the end"))
        drawing.draw_heading(picture.axes, dock, colors.VERMILLION, picture.points_per_m)
        entries.append((disc_handle(colors.VERMILLION), "pose in the dock"))
        strip = 1.7 if ax is None else 0.0
        picture.legend(entries, extra_in=strip)
        if strip:
            _draw_distance(picture.figure, record, visits, dock, strip)
        return picture.finish(path, dpi)


def _rows(record: Record, begin: float, end: float) -> slice:
    """Return the samples of a time span, with one at each end."""
    first, last = np.searchsorted(record.times, (begin - 1e-6, end + 1e-6)).tolist()
    return slice(max(0, first - 1), max(last, first + 1))


def _dock_pose(record: Record, data: Any) -> Pose2D:
    """Return the true pose in the dock if the scenario has it, otherwise that of the approach."""
    stored = record.scenario.get("parameters")
    sim: Any = stored.get("navstack", {}).get("sim", {}) if isinstance(stored, dict) else {}
    dock = sim.get(data.get("dock"), {})
    if isinstance(dock, dict) and isinstance(dock.get("pose"), list):
        return Pose2D(*(float(value) for value in dock["pose"]))
    ids = {str(part) for part in data["parts"][-1:]}
    for event in record.events:
        if event.kind == "goal" and str(event.data.get("id")) in ids:
            return Pose2D(*(float(value) for value in event.data["pose"]))
    return drawing.pose_of(record.poses[-1])


def _draw_distance(figure: Any, record: Record, visits: Any, dock: Pose2D, height_in: float) -> None:
    """Draw the distance to the dock over time at the bottom of the figure, by state."""
    wide, high = figure.get_size_inches()
    axes = figure.add_axes((0.62 / wide, 0.5 / high, (wide - 0.9) / wide, (height_in - 0.75) / high), facecolor="white")
    for visit in visits:
        part = _rows(record, visit["begin"], visit["end"])
        away = np.hypot(record.poses[part, 0] - dock.x, record.poses[part, 1] - dock.y)
        axes.plot(record.times[part], away, color=STATE_COLORS.get(str(visit["state"]), colors.INK), linewidth=1.8)
        if visit.get("error_code"):
            axes.plot([visit["end"]], [away[-1]], "x", color=colors.VERMILLION, ms=6, mew=1.8)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("to the dock (m)")
    axes.set_ylim(bottom=0.0)
    axes.grid(visible=True, linewidth=0.4, alpha=0.5)
