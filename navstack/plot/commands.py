"""Commands in pictures: what smoother and monitor made of them, those of a replayed log, and what a steered base made of them."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, Transform2D
from navstack.plot import canvas, colors
from navstack.plot.picture import Entries
from navstack.record import Record, SteeredBase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

ACTIONS: Final[dict[str, tuple[str, str]]] = {
    "stop": (colors.VERMILLION, "s"),
    "approach": (colors.ORANGE, "o"),
    "slowdown": (colors.YELLOW, "^"),
    "limit": (colors.PURPLE, "D"),
}
"""Color and mark of each action of the collision monitor."""
MOST_OUTLINES: Final = 6
"""Number of places at which a picture shows the zones."""
_PANELS: Final = ((3.0, 1.75), (0.55, 1.95))
"""Bottom and height of the panels, inches."""
_LABELS: Final = ("forward (m/s)", "turn (rad/s)")


def draw_changed_commands(axes: Axes, record: Record, entries: Entries) -> None:
    """Draw a mark where the collision monitor changed a command, and its zones where an action began."""
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


def _draw_zones(axes: Axes, record: Record, rows: NDArray[np.void], entries: Entries) -> None:
    """Draw the outline of a zone at the first places where it began to act."""
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
    ax: Axes | Sequence[Axes] | None = None,
    title: str = "commands on their way to the robot",
    dpi: float = 130.0,
) -> Any:
    """Draw requested, smoothed and sent velocities over time, with the actions of the collision monitor as bands.

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
        panels = canvas.Panels(path, ax, _PANELS, title=title, subtitle=_commands_text(rows))
        _draw_commands(panels, rows)
        panels.legend()
        return panels.finish(dpi)


def _commands_text(rows: NDArray[np.void]) -> str:
    changed = {who: int((rows["changed_by"] == who).sum()) for who in ("velocity_smoother", "collision_monitor")}
    parts = [f"{count} last changed by the {who.replace('_', ' ')}" for who, count in changed.items() if count]
    return f"{len(rows)} commands, " + (", ".join(parts) if parts else "none of them changed")


def _draw_commands(panels: canvas.Panels, rows: NDArray[np.void]) -> None:
    times: NDArray[np.float64] = rows["t"]
    panels.set_times(times[0], max(float(times[-1]), float(times[0]) + 1.0))
    for axes, axis, label in zip(panels.axes, ("vx", "wz"), _LABELS, strict=True):
        for action, (color, _) in ACTIONS.items():
            acting = (rows["action"] == action) & (rows["changed_by"] == "collision_monitor")
            canvas.shade(axes, times, acting, color, alpha=0.28, label=f"collision monitor: {action}")
        styles: tuple[tuple[str, str, dict[str, Any]], ...] = (
            ("requested", "requested", {"color": colors.FAINT, "lw": 1.2}),
            ("smoothed", "after the velocity smoother", {"color": colors.SKY, "lw": 1.4, "ls": (0, (4, 1.5))}),
            ("sent", "sent to the robot", {"color": colors.BLUE, "lw": 1.7}),
        )
        for stage, what, style in styles:
            axes.plot(times, rows[f"{stage}_{axis}"], drawstyle="steps-post", label=what, **style)
        axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
        axes.set_ylabel(label)


# --- a replay ---------------------------------------------------------------------------------------------------------


def plot_replay(
    times: NDArray[np.float64],
    commands: NDArray[np.float64],
    recorded: NDArray[np.float64],
    rejected: NDArray[np.bool_],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | Sequence[Axes] | None = None,
    title: str = "commands of a replay",
    first_difference: float | None = None,
    dpi: float = 130.0,
) -> Any:
    """Draw commands of navstack and of the log, (n, 3) vx, vy, wz at `times` (n,) s; NaN where there is none.

    `rejected` marks the cycles in which every sample was rejected. To a .png, .svg or .pdf, into two axes `ax`, or a new figure.
    Returns the file; without a path the axes. Raises OutputError, and InputError without cycles.
    """
    canvas.check_target(path, ax)
    if not len(times):
        raise InputError("the replay has no cycles: the log has no messages in the chosen part")
    with canvas.style():
        panels = canvas.Panels(path, ax, _PANELS, title=title)
        panels.set_times(times[0], max(float(times[-1]), float(times[0]) + 1.0), "time in the log (s)")
        for axes, column, label in zip(panels.axes, (0, 2), _LABELS, strict=True):
            canvas.shade(axes, times, rejected, colors.VERMILLION, alpha=0.25, label="no valid command")
            if first_difference is not None:
                axes.axvline(first_difference, color=colors.INK, lw=1.0, ls=(0, (2, 2)), label="first difference")
            axes.plot(
                times, recorded[:, column], color=colors.ORANGE, lw=1.6, drawstyle="steps-post", label="in the log"
            )
            axes.plot(times, commands[:, column], color=colors.BLUE, lw=1.3, drawstyle="steps-post", label="navstack")
            axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
            axes.set_ylabel(label)
        panels.legend()
        return panels.finish(dpi)


# --- a steered base ---------------------------------------------------------------------------------------------------


WHEEL_SHARE: Final = 0.25
"""Length of a drawn wheel as a share of the wheelbase."""


def wheel_lines(record: Record, row: int) -> NDArray[np.float64]:
    """Return (n, 2) the wheels of a steered base at a sample as one line in the global frame, NaN between two wheels."""
    base = record.steered_base
    assert base is not None
    width = float(np.ptp(record.footprint.vertices[:, 1]))
    half = 0.5 * WHEEL_SHARE * base.wheelbase
    ends: list[tuple[float, float]] = []
    for x, y, direction in base.wheels(width, float(record.steering[row])):
        dx, dy = half * math.cos(direction), half * math.sin(direction)
        ends += [(x - dx, y - dy), (x + dx, y + dy), (math.nan, math.nan)]
    return Transform2D(*record.poses[row].tolist()).apply_points(np.array(ends))


def plot_steering(
    record: Record,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | Sequence[Axes] | None = None,
    title: str = "speed and steering angle",
    dpi: float = 130.0,
) -> Any:
    """Draw speed and steering angle of a car or a tricycle over time, as commanded and as driven, with the limits.

    The commanded angle is atan(wheelbase * wz / vx). To a .png, .svg or .pdf, into two axes `ax`, or a new figure. Returns the
    file; without a path the axes. Raises OutputError, and InputError for a run of a base that is not steered.
    """
    canvas.check_target(path, ax)
    base = record.steered_base
    if base is None or not len(record.times):
        raise InputError(
            "the run has no steering angle: it is of a base that is not steered; set navstack/sim/kinematics to ackermann or "
            "tricycle and run it again"
        )
    with canvas.style():
        panels = canvas.Panels(path, ax, _PANELS, title=title, subtitle=_steering_text(record, base), right=7.9)
        _draw_steering(panels, record, base)
        panels.legend(1)
        return panels.finish(dpi)


def _steering_text(record: Record, base: SteeredBase) -> str:
    largest = float(np.abs(record.steering).max())
    rate = "" if base.max_rate is None else f", rate at most {base.max_rate:.3g} rad/s"
    return (
        f"{base.kinematics}, wheelbase {base.wheelbase:g} m; largest angle {largest:.2f} of {base.max_angle:.2f} rad, which is a "
        f"radius of {base.radius(base.max_angle):.2f} m{rate}"
    )


def _draw_steering(panels: canvas.Panels, record: Record, base: SteeredBase) -> None:
    times = record.times
    panels.set_times(times[0], max(float(times[-1]), float(times[0]) + 1.0))
    asked = np.clip(base.asked(record.commands), -0.5 * math.pi, 0.5 * math.pi)
    speed, angle = panels.axes
    for axes, commanded, driven, label in (
        (speed, record.commands[:, 0], record.velocities[:, 0], "speed (m/s)"),
        (angle, asked, record.steering, "steering angle (rad)"),
    ):
        axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
        axes.plot(times, commanded, color=colors.ORANGE, lw=1.3, drawstyle="steps-post", label="commanded")
        axes.plot(times, driven, color=colors.BLUE, lw=1.7, label="driven")
        canvas.shade(axes, times, record.velocities[:, 0] < -1e-3, colors.SKY, alpha=0.2, label="in reverse")
        axes.set_ylabel(label)
    for sign, label in ((1.0, "limit"), (-1.0, None)):
        angle.axhline(sign * base.max_angle, color=colors.VERMILLION, lw=1.1, ls=(0, (4, 2)), label=label)
    reach = 1.15 * max(base.max_angle, float(np.nanmax(np.abs(asked), initial=0.0)))
    angle.set_ylim(-reach, reach)
