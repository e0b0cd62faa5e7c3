"""The picture of inflation curves: cost against distance to an obstacle."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.plot import canvas, colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from navstack.explain import InflationCurve

_COLORS: Final = (colors.BLUE, colors.VERMILLION)
_PANEL, _ABOVE, _BELOW = 3.7, 0.4, 0.55
"""Height of a panel with its texts, of the title, and of the texts below a panel, inches."""


def plot_inflation_curves(
    curves: Sequence[InflationCurve],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | Sequence[Axes] | None = None,
    title: str = "inflation",
    dpi: float = 130.0,
) -> Any:
    """Draw cost against distance, a panel per curve; `curves` are the results of `inflation_curves(configuration)`.

    To a .png, .svg or .pdf, into the axes `ax` (one, or one per curve), or a new figure. Raises OutputError, and InputError for
    another number of axes. Returns the file; without a path the list of the panels' axes.
    """
    canvas.check_target(path, ax)
    reach = max(float(_distances(curve)[-1]) for curve in curves)
    below = [(len(curves) - 1 - i) * _PANEL + _BELOW for i in range(len(curves))]
    with canvas.style():
        panels = canvas.Panels(
            path,
            ax,
            [(bottom, _PANEL - _BELOW - 0.3) for bottom in below],
            title=title,
            size=(9.2, _ABOVE + len(curves) * _PANEL),
            left=0.69,
            right=6.762,
        )
        for i, (axes, curve) in enumerate(zip(panels.axes, curves, strict=True)):
            _draw_curve(axes, curve, _COLORS[i % len(_COLORS)], reach)
            name = f"{' and '.join(curve.costmaps)} costmap{'s' if len(curve.costmaps) > 1 else ''}"
            if not panels.is_own:
                axes.set_title(f"{title}\n{name}" if i == 0 else name, fontsize=9.0)
                axes.legend(loc="upper right", fontsize=7)
                continue
            subtitle = f"cost_scaling_factor {curve.cost_scaling_factor:g} / m   cells of {curve.resolution:g} m"
            axes.set_title(f"{name}   {subtitle}", fontsize=8.5, fontweight="normal", color=canvas.SUBTITLE, pad=6)
            axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, labelspacing=0.8)
        return panels.finish(dpi)


def _distances(curve: InflationCurve) -> NDArray[np.float64]:
    """Distances at which the formula is drawn (m)."""
    reach = max(curve.cells[-1], curve.circumscribed_radius + curve.resolution)
    return np.linspace(0.0, 1.05 * reach, 1200)


def _draw_curve(axes: Axes, curve: InflationCurve, color: str, reach: float) -> None:
    distances = _distances(curve)
    axes.set_xlim(0.0, reach)
    axes.set_ylim(-6.0, 268.0)
    axes.set_yticks([0, 50, 100, 126, 150, 200, 253])
    axes.set_xlabel("distance to the nearest obstacle cell, center to center (m)")
    axes.set_ylabel("cost")
    axes.axhspan(253.0, 268.0, color=colors.hex_of(colors.INSCRIBED_RGB), alpha=0.35, lw=0)
    axes.axvspan(0.0, curve.inscribed_radius, color=colors.hex_of(colors.INSCRIBED_RGB), alpha=0.16, lw=0)
    axes.plot(distances, curve.at(distances).astype(np.float64), color=color, lw=1.8, label="formula", zorder=4)
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
        (curve.inscribed_radius, "inscribed radius", colors.BLACK, "-"),
        (curve.circumscribed_radius, "circumscribed radius", colors.PURPLE, (0, (5, 2))),
        (curve.inflation_radius, "inflation radius", colors.GREEN, (0, (2, 1.5))),
    )
    for at, name, ink, dashes in marks:
        axes.axvline(at, color=ink, lw=1.4, ls=dashes, zorder=2, label=f"{name} {at:.3f} m")
    axes.axhline(126.0, color=colors.FAINT, lw=0.9, ls=(0, (1, 2)), label="high cost from 126")
