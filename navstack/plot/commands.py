"""Commands that the velocity smoother and the collision monitor changed: marks on the map, and curves over time."""

from __future__ import annotations

import os
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.core.geometry import Transform2D
from navstack.plot import canvas, colors
from navstack.record import Record

ACTIONS: Final[dict[str, tuple[str, str]]] = {
    "stop": (colors.VERMILLION, "s"),
    "approach": (colors.ORANGE, "o"),
    "slowdown": (colors.YELLOW, "^"),
    "limit": (colors.PURPLE, "D"),
}
"""Colour and mark of each action of the collision monitor."""
MOST_OUTLINES: Final = 6
"""Number of places at which a picture shows the zones."""
_CHANGED: Final = 1e-6
_WIDTH, _HEIGHT = 10.0, 5.6
_PANELS = ((3.0, 1.75), (0.55, 1.95))
_AXES = ("vx", "wz")
_LABELS = ("forward (m/s)", "turn (rad/s)")


def draw_changed_commands(axes: Any, record: Record, entries: list[tuple[Any, str]]) -> None:
    """Draws a mark where the collision monitor changed a command, and its zones where an action began."""
    rows = record.command_steps
    if not len(rows) or not len(record.times):
        return
    for action, (color, marker) in ACTIONS.items():
        of_action = rows[(rows["action"] == action) & (rows["changed_by"] == "collision_monitor")]
        if not len(of_action):
            continue
        times: NDArray[np.float64] = of_action["t"]
        at = np.array([record.pose_at(float(t)) for t in times], np.float64).reshape(-1, 3)
        (marks,) = axes.plot(
            at[:, 0], at[:, 1], marker, ms=4.5, color=color, mec=colors.INK, mew=0.5, ls="none", zorder=7.5
        )
        entries.append((marks, f"collision monitor: {action} ({len(of_action)} commands)"))
    _draw_zones(axes, record, rows, entries)


def _draw_zones(axes: Any, record: Record, rows: NDArray[np.void], entries: list[tuple[Any, str]]) -> None:
    """Draws the outline of a zone at the first places where it began to act."""
    begins = [i for i in range(len(rows)) if rows["zone"][i] and (i == 0 or rows["zone"][i - 1] != rows["zone"][i])]
    outlines = {name: corners for name, _, corners in record.zones if len(corners)}
    handle: Any = None
    for i in begins[:: max(1, -(-len(begins) // MOST_OUTLINES))]:
        if str(rows["zone"][i]) not in outlines:
            continue
        corners = outlines[str(rows["zone"][i])]
        placed = Transform2D(*record.pose_at(float(rows["t"][i]))).apply_points(np.vstack((corners, corners[:1])))
        (handle,) = axes.plot(placed[:, 0], placed[:, 1], color=colors.INK, lw=1.0, ls=(0, (3, 1.5)), zorder=6.5)
    if handle is not None:
        entries.append((handle, "zone where it began to act"))


def plot_commands(
    record: Record,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str = "commands on their way to the robot",
    dpi: float = 130.0,
) -> Any:
    """Draws requested, smoothed and sent velocities over time, with the actions of the collision monitor as bands.

    To a .png, .svg or .pdf, into two axes `ax`, or a new figure. Returns the file; without a path the axes. Raises OutputError,
    and InputError for a run without a chain.
    """
    canvas.check_target(path, ax)
    rows = record.command_steps
    if not len(rows):
        raise InputError(
            "the run has no record of changed commands; write a section velocity_smoother, collision_monitor or twist_mux "
            "into the parameters and run it again"
        )
    with canvas.style():
        if ax is not None:
            panels = canvas.stacked_axes(ax, [height for _, height in _PANELS])
            panels[0].set_title(title, fontsize=9.0)
            _draw(panels, rows)
            panels[0].legend(fontsize=7, loc="upper right")
            return panels
        figure = canvas.figure_for(path, _WIDTH, _HEIGHT)
        left, right = 0.72 / _WIDTH, 7.6 / _WIDTH
        figure.text(left, 1.0 - 0.3 / _HEIGHT, title, fontsize=12, fontweight="bold", va="baseline")
        figure.text(left, 1.0 - 0.53 / _HEIGHT, _summary(rows), fontsize=8.5, color="#666666", va="baseline")
        panels = [figure.add_axes((left, b / _HEIGHT, right - left, h / _HEIGHT)) for b, h in _PANELS]
        _draw(panels, rows)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="upper left", bbox_to_anchor=(right + 0.012, 0.87), fontsize=8, frameon=False
        )
        return canvas.finish(figure, panels, path, dpi)


def _summary(rows: NDArray[np.void]) -> str:
    changed = {who: int((rows["changed_by"] == who).sum()) for who in ("velocity_smoother", "collision_monitor")}
    parts = [f"{count} last changed by the {who.replace('_', ' ')}" for who, count in changed.items() if count]
    return f"{len(rows)} commands, " + (", ".join(parts) if parts else "none of them changed")


def _draw(panels: list[Any], rows: NDArray[np.void]) -> None:
    times: NDArray[np.float64] = rows["t"]
    for axes, axis, label in zip(panels, _AXES, _LABELS, strict=True):
        axes.set_xlim(times[0], max(float(times[-1]), float(times[0]) + 1.0))
        axes.grid(axis="x", color="#E3E3E3", lw=0.6)
        axes.set_axisbelow(True)
        _draw_bands(axes, rows)
        axes.plot(
            times, rows[f"requested_{axis}"], color=colors.FAINT, lw=1.2, drawstyle="steps-post", label="requested"
        )
        axes.plot(
            times,
            rows[f"smoothed_{axis}"],
            color=colors.SKY,
            lw=1.4,
            ls=(0, (4, 1.5)),
            drawstyle="steps-post",
            label="after the velocity smoother",
        )
        axes.plot(
            times, rows[f"sent_{axis}"], color=colors.BLUE, lw=1.7, drawstyle="steps-post", label="sent to the robot"
        )
        axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
        axes.set_ylabel(label)
    panels[-1].set_xlabel("time (s)")


def _draw_bands(axes: Any, rows: NDArray[np.void]) -> None:
    """Shades the times at which the collision monitor changed commands, in the colour of the action."""
    times: NDArray[np.float64] = rows["t"]
    ends = np.append(times[1:], times[-1] + 0.05)
    for action, (color, _) in ACTIONS.items():
        label: str | None = f"collision monitor: {action}"
        acting = (rows["action"] == action) & (rows["changed_by"] == "collision_monitor")
        edges = np.flatnonzero(np.diff(np.concatenate(([0], acting.astype(np.int8), [0]))))
        for begin, end in edges.reshape(-1, 2).tolist():
            axes.axvspan(times[begin], ends[end - 1], color=color, alpha=0.28, lw=0, zorder=0, label=label)
            label = None
