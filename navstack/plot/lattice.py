"""Motion primitives in pictures."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from navstack.global_planner import Lattice, sample
from navstack.plot import canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE: Final = 6.4
_COLORS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Of Okabe and Ito: distinguishable by people with color vision deficiency."""
_STYLES: Final = ("-", "--", ":", "-.")
"""Of the lines where there are more headings than colors."""


def plot_lattice(
    lattice: Lattice, path: str | os.PathLike[str] | None = None, *, ax: Axes | None = None, dpi: float = 130.0
) -> Any:
    """Draw the primitives of all headings, those of the headings from 0 to below 90 degrees in color.

    To a .png, .svg or .pdf, into `ax`, or a new figure. Returns the file; without a path the axes. Raises OutputError.
    """
    canvas.check_target(path, ax)
    with canvas.style():
        axes = canvas.chart_axes(path, ax, _SIZE, _SIZE)
        _draw(axes, lattice)
        return axes if path is None else canvas.save(axes.figure, Path(path), dpi)


def _draw(axes: Axes, lattice: Lattice) -> None:
    colored = [k for k, yaw in enumerate(lattice.headings) if yaw < 0.5 * math.pi - 1e-9]
    order = [k for k in range(len(lattice.headings)) if k not in colored] + colored
    for k in order:
        for number, primitive in enumerate(lattice.by_heading[k]):
            yaw = float(lattice.headings[k])
            poses = np.vstack([[0.0, 0.0, yaw], sample(list(primitive.pieces), yaw, 40)])
            if k in colored:
                color = _COLORS[colored.index(k) % len(_COLORS)]
                style = _STYLES[colored.index(k) // len(_COLORS) % len(_STYLES)]
                label = f"from {math.degrees(yaw):.1f}°" if number == 0 else None
                axes.plot(poses[:, 0], poses[:, 1], style, color=color, linewidth=1.4, label=label, zorder=3)
                slides = primitive.pieces[0].kind == "slide"
                face = "white" if slides else color
                axes.plot(
                    poses[-1, 0], poses[-1, 1], "o", color=color, mfc=face, markersize=4 if slides else 2.5, zorder=4
                )
            else:
                axes.plot(poses[:, 0], poses[:, 1], color="#bbbbbb", linewidth=0.7, zorder=2)
    reach = 1.1 * max((float(np.abs(p.poses[:, :2]).max()) for p in lattice.primitives), default=1.0)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    in_place = sum(p.length == 0.0 for p in lattice.primitives)
    turns = f" ({in_place} of them turns in place)" if in_place else ""
    if lattice.motion_model == "omni":
        axes.plot([], [], "o", color="black", mfc="white", markersize=4, label="end of a slide")
    axes.set_title(
        f"{len(lattice.primitives)} primitives{turns}\n{lattice.motion_model}, turning radius {lattice.turning_radius:g} m, "
        f"{len(lattice.headings)} headings",
        fontsize=10,
    )
    axes.legend(fontsize=7, loc="upper right")
