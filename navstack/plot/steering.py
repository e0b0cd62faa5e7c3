"""A steered base in pictures: its wheels on the map, and speed and steering angle over time."""

from __future__ import annotations

import math
import os
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.core.geometry import Transform2D
from navstack.plot import canvas, colors
from navstack.record import Record, SteeredBase

WHEEL_SHARE: Final = 0.25
"""Length of a drawn wheel as a share of the wheelbase."""
_WIDTH, _HEIGHT = 10.0, 5.6
_PANELS = ((3.0, 1.75), (0.55, 1.95))


def wheel_lines(record: Record, row: int) -> NDArray[np.float64]:
    """Returns (n, 2) the wheels of a steered base at a sample as one line in the global frame, NaN between two wheels."""
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
    ax: Any = None,
    title: str = "speed and steering angle",
    dpi: float = 130.0,
) -> Any:
    """Draws speed and steering angle of a car or a tricycle over time, as commanded and as driven, with the limits.

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
        if ax is not None:
            panels = canvas.stacked_axes(ax, [height for _, height in _PANELS])
            panels[0].set_title(title, fontsize=9.0)
            _draw(panels, record, base)
            panels[1].legend(fontsize=7, loc="upper right")
            return panels
        figure = canvas.figure_for(path, _WIDTH, _HEIGHT)
        left, right = 0.72 / _WIDTH, 7.9 / _WIDTH
        figure.text(left, 1.0 - 0.3 / _HEIGHT, title, fontsize=12, fontweight="bold", va="baseline")
        figure.text(left, 1.0 - 0.53 / _HEIGHT, _summary(record, base), fontsize=8.5, color="#666666", va="baseline")
        panels = [figure.add_axes((left, b / _HEIGHT, right - left, h / _HEIGHT)) for b, h in _PANELS]
        _draw(panels, record, base)
        handles, labels = panels[1].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="upper left", bbox_to_anchor=(right + 0.012, 0.87), fontsize=8, frameon=False
        )
        return canvas.finish(figure, panels, path, dpi)


def _summary(record: Record, base: SteeredBase) -> str:
    largest = float(np.abs(record.steering).max())
    rate = "" if base.max_rate is None else f", rate at most {base.max_rate:.3g} rad/s"
    return (
        f"{base.kinematics}, wheelbase {base.wheelbase:g} m; largest angle {largest:.2f} of {base.max_angle:.2f} rad, which is a "
        f"radius of {base.radius(base.max_angle):.2f} m{rate}"
    )


def _draw(panels: list[Any], record: Record, base: SteeredBase) -> None:
    times = record.times
    asked = np.clip(base.asked(record.commands), -0.5 * math.pi, 0.5 * math.pi)
    for axes, commanded, driven in (
        (panels[0], record.commands[:, 0], record.velocities[:, 0]),
        (panels[1], asked, record.steering),
    ):
        axes.set_xlim(times[0], max(float(times[-1]), float(times[0]) + 1.0))
        axes.grid(axis="x", color="#E3E3E3", lw=0.6)
        axes.set_axisbelow(True)
        axes.axhline(0.0, color=colors.FAINT, lw=0.6, zorder=1)
        axes.plot(times, commanded, color=colors.ORANGE, lw=1.3, drawstyle="steps-post", label="commanded")
        axes.plot(times, driven, color=colors.BLUE, lw=1.7, label="driven")
        backward = record.velocities[:, 0] < -1e-3
        edges = np.flatnonzero(np.diff(np.concatenate(([0], backward.astype(np.int8), [0]))))
        label: str | None = "in reverse"
        for begin, end in edges.reshape(-1, 2).tolist():
            axes.axvspan(times[begin], times[end - 1], color=colors.SKY, alpha=0.2, lw=0, zorder=0, label=label)
            label = None
    panels[0].set_ylabel("speed (m/s)")
    panels[1].set_ylabel("steering angle (rad)")
    for sign in (1.0, -1.0):
        panels[1].axhline(
            sign * base.max_angle,
            color=colors.VERMILLION,
            lw=1.1,
            ls=(0, (4, 2)),
            label="limit" if sign > 0.0 else None,
        )
    reach = 1.15 * max(base.max_angle, float(np.nanmax(np.abs(asked), initial=0.0)))
    panels[1].set_ylim(-reach, reach)
    panels[-1].set_xlabel("time (s)")
