"""The picture of a followed trajectory: the curve, and the errors and speeds over time."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navstack.plot import canvas, colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH, _HEIGHT = 11.0, 5.6
"""Size of the figure, inches."""

Curve = NDArray[np.float64]


def plot_tracking(
    path: str | os.PathLike[str],
    *,
    t: Curve,
    reference: Curve,
    poses: Curve,
    errors: tuple[Curve, Curve, Curve],
    speeds: tuple[Curve, Curve],
    title: str,
    subtitle: str = "",
    dpi: float = 130.0,
) -> Path:
    """Draw a followed trajectory to a .png, .svg or .pdf. Raises OutputError. Returns the file.

    `t` (n,) s; `reference` and `poses` (n, 3) m, rad in the global frame; `errors` along, across (m) and of the heading (rad);
    `speeds` of the reference and of the robot (m/s).
    """
    out = Path(path)
    canvas.check_format(out)
    with canvas.style():
        figure = canvas.new_figure(_WIDTH, _HEIGHT)
        canvas.write_title(figure, 0.62 / _WIDTH, title, subtitle)
        _draw_curve(_axes(figure, 0.62, 0.55, 4.3, 4.25), reference, poses)
        _draw_errors(_axes(figure, 5.75, 2.75, 5.05, 2.05), t, errors)
        _draw_speeds(_axes(figure, 5.75, 0.55, 5.05, 1.7), t, speeds)
        return canvas.save(figure, out, dpi)


def _axes(figure: Any, left: float, bottom: float, width: float, height: float) -> Any:
    axes = figure.add_axes((left / _WIDTH, bottom / _HEIGHT, width / _WIDTH, height / _HEIGHT))
    axes.grid(color=canvas.GRID, lw=0.6)
    axes.set_axisbelow(True)
    return axes


def _draw_curve(axes: Axes, reference: Curve, poses: Curve) -> None:
    axes.plot(*reference[:, :2].T, color=colors.PLAN, lw=3.4, alpha=0.75, label="trajectory")
    axes.plot(*poses[:, :2].T, color=colors.DRIVEN, lw=1.3, label="driven path")
    axes.plot(*poses[0, :2], "o", color=colors.START, ms=7, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.legend(loc="best", frameon=True, framealpha=0.85, edgecolor="none")


def _draw_errors(axes: Axes, t: Curve, errors: tuple[Curve, Curve, Curve]) -> None:
    along, across, heading = errors
    axes.plot(t, 100.0 * along, color=colors.BLUE, lw=1.3, label="along (cm)")
    axes.plot(t, 100.0 * across, color=colors.VERMILLION, lw=1.3, label="across (cm)")
    axes.plot(t, np.degrees(heading), color=colors.GREEN, lw=1.1, ls=(0, (4, 1.6)), label="heading (degrees)")
    axes.axhline(0.0, color=colors.FAINT, lw=0.8)
    size = max(1.0, 115.0 * float(np.hypot(along, across).max()), 1.15 * math.degrees(float(np.abs(heading).max())))
    axes.set_ylim(-size, size * 1.35)
    axes.set_xlim(0.0, max(float(t[-1]), 1e-3))
    axes.set_ylabel("error")
    axes.tick_params(labelbottom=False)
    axes.legend(loc="upper right", ncols=3, frameon=True, framealpha=0.85, edgecolor="none")


def _draw_speeds(axes: Axes, t: Curve, speeds: tuple[Curve, Curve]) -> None:
    axes.plot(t, speeds[0], color=colors.PLAN, lw=3.0, alpha=0.75, label="trajectory")
    axes.plot(t, speeds[1], color=colors.DRIVEN, lw=1.2, label="robot")
    axes.set_xlim(0.0, max(float(t[-1]), 1e-3))
    axes.set_ylim(0.0, 1.3 * max(float(max(speeds[0].max(), speeds[1].max())), 0.01))
    axes.set_xlabel("time on the trajectory (s)")
    axes.set_ylabel("speed (m/s)")
    axes.legend(loc="upper right", ncols=2, frameon=True, framealpha=0.85, edgecolor="none")
