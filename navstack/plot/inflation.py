"""The picture of inflation curves: cost against distance to an obstacle."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.plot import canvas, colors


@dataclass(frozen=True, slots=True)
class Curve:
    """Costs against distance in one costmap, or in several with equal costs. Lengths in metres."""

    label: str
    distances: NDArray[np.float64]
    """(n,)"""
    costs: NDArray[np.float64]
    """(n,) costs at these distances by the formula of the layer."""
    cells: NDArray[np.float64]
    """(k,) distances of whole cells."""
    cell_costs: NDArray[np.float64]
    """(k,) costs that the layer writes at these distances."""
    inscribed: float
    circumscribed: float
    inflation: float
    subtitle: str


_COLORS = (colors.BLUE, colors.VERMILLION)


def plot_inflation(
    curves: Sequence[Curve],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str,
    dpi: float = 130.0,
) -> Any:
    """Draws cost against distance to a .png, .svg or .pdf, with one panel per curve and lines at the radii.

    Draws into the axes `ax` (one, or one per curve), or a new figure. Raises OutputError, and InputError for another number of
    axes. Returns the file; without a path the list of the panels' axes.
    """
    canvas.check_target(path, ax)
    reach = max(float(curve.distances[-1]) for curve in curves)
    with canvas.style():
        if ax is not None:
            panels = canvas.stacked_axes(ax, [1.0] * len(curves))
            for i, (axes, curve) in enumerate(zip(panels, curves, strict=True)):
                _panel(axes, curve, _COLORS[i % len(_COLORS)], reach)
                axes.set_title(f"{title}\n{curve.label}" if i == 0 else curve.label, fontsize=9.0)
                axes.legend(loc="upper right", fontsize=7)
            return panels
        panels: list[Any] = []
        panel, above, below = 3.7, 0.4, 0.55
        height = above + len(curves) * panel
        figure = canvas.figure_for(path, 9.2, height)
        figure.text(0.075, 1.0 - 0.3 / height, title, fontsize=12, fontweight="bold", va="baseline")
        for i, curve in enumerate(curves):
            bottom = (len(curves) - 1 - i) * panel + below
            axes: Any = figure.add_axes((0.075, bottom / height, 0.66, (panel - below - 0.3) / height))
            _panel(axes, curve, _COLORS[i % len(_COLORS)], reach)
            axes.set_title(
                f"{curve.label}   {curve.subtitle}", fontsize=8.5, fontweight="normal", color="#666666", pad=6
            )
            axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, labelspacing=0.8)
            panels.append(axes)
        return canvas.finish(figure, panels, path, dpi)


def _panel(axes: Any, curve: Curve, color: str, reach: float) -> None:
    axes.set_xlim(0.0, reach)
    axes.set_ylim(-6.0, 268.0)
    axes.set_yticks([0, 50, 100, 126, 150, 200, 253])
    axes.set_xlabel("distance to the nearest obstacle cell, centre to centre (m)")
    axes.set_ylabel("cost")
    axes.axhspan(253.0, 268.0, color=colors.hex_of(colors.INSCRIBED_RGB), alpha=0.35, lw=0)
    axes.axvspan(0.0, curve.inscribed, color=colors.hex_of(colors.INSCRIBED_RGB), alpha=0.16, lw=0)
    axes.plot(curve.distances, curve.costs, color=color, lw=1.8, label="formula", zorder=4)
    axes.step(
        curve.cells, curve.cell_costs, where="mid", color=color, lw=0.9, alpha=0.55, zorder=3, label="rounded to cells"
    )
    axes.plot(
        curve.cells,
        curve.cell_costs,
        "o",
        ms=4.5,
        color=color,
        mec="white",
        mew=0.7,
        zorder=5,
        label="whole cells",
    )
    marks = (
        (curve.inscribed, "inscribed radius", colors.BLACK, "-"),
        (curve.circumscribed, "circumscribed radius", colors.PURPLE, (0, (5, 2))),
        (curve.inflation, "inflation radius", colors.GREEN, (0, (2, 1.5))),
    )
    for at, name, ink, dashes in marks:
        axes.axvline(at, color=ink, lw=1.4, ls=dashes, zorder=2, label=f"{name} {at:.3f} m")
    axes.axhline(126.0, color=colors.FAINT, lw=0.9, ls=(0, (1, 2)), label="high cost from 126")
