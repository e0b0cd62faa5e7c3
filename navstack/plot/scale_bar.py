"""The colours of trajectory costs, and the bar that explains them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class CostScale:
    """Maps costs to colours: dark blue for `low`, yellow from `high` on. Suitable for colour-blind readers."""

    low: float
    high: float
    clipped: bool
    """True if some costs exceed `high`."""

    @classmethod
    def of(cls, totals: NDArray[np.float64]) -> CostScale:
        """Returns the scale of these costs; outliers exceed its upper end."""
        if not len(totals):
            return cls(0.0, 0.0, False)
        low, median, top = float(totals.min()), float(np.median(totals)), float(totals.max())
        high = min(top, low + 4.0 * (median - low)) if median > low else top
        return cls(low, high, bool((totals > high).any()))

    def color(self, cost: float) -> Any:
        """Returns the RGBA of a cost."""
        return _rgba((min(cost, self.high) - self.low) / (self.high - self.low) if self.high > self.low else 0.0)


def _rgba(share: float) -> Any:
    from matplotlib import colormaps

    return colormaps["cividis"](0.92 * float(share))


def draw_scale_bar(picture: Any, legend: Any, scale: CostScale) -> None:
    """Draws a bar with the colours and their costs below the legend."""
    picture.canvas.draw()
    figure = picture.figure
    box = legend.get_window_extent().transformed(figure.transFigure.inverted())
    height = 0.13 / figure.get_figheight()
    bar = figure.add_axes(
        (box.x0 + 0.01, max(box.y0 - 3.2 * height, 0.02 + 1.2 * height), 1.7 / figure.get_figwidth(), height)
    )
    rgba = np.array([[_rgba(share) for share in np.linspace(0.0, 1.0, 128)]])
    bar.imshow(rgba[..., :3], aspect="auto", extent=(0.0, 1.0, 0.0, 1.0))
    bar.set_yticks([])
    low = f"{scale.low:.4g}"
    if math.isclose(scale.low, scale.high, rel_tol=1e-12):
        bar.set_xticks([0.0], [low])
    else:
        bar.set_xticks([0.0, 1.0], [low, f"{scale.high:.4g}{' or more' if scale.clipped else ''}"])
    bar.tick_params(length=0, labelsize=8)
    bar.set_title("cost of legal samples", fontsize=8.5, fontweight="normal", pad=3)
