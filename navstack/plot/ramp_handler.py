"""The legend handler of a cost ramp. Imported with matplotlib, by the first legend."""

from __future__ import annotations

from typing import Any

from matplotlib.legend_handler import HandlerBase
from matplotlib.patches import Rectangle

from navstack.plot import colors

_STEPS = 32


class RampHandler(HandlerBase):
    """Draws a swatch with the colours of the costs from 1 to 252."""

    def create_artists(
        self,
        legend: Any,
        orig_handle: Any,
        xdescent: float,
        ydescent: float,
        width: float,
        height: float,
        fontsize: float,
        trans: Any,
    ) -> list[Any]:
        """Returns the artists of the swatch: rectangles of single colours in a frame."""
        table = colors.cost_colors() / 255.0
        step = width / _STEPS
        style: dict[str, Any] = {"edgecolor": "none", "transform": trans}
        parts = [
            Rectangle(
                (i * step - xdescent, -ydescent), 1.05 * step, height, facecolor=table[1 + round(251 * i / 31)], **style
            )
            for i in range(_STEPS)
        ]
        frame: dict[str, Any] = {"facecolor": "none", "edgecolor": colors.FAINT, "lw": 0.5, "transform": trans}
        return [*parts, Rectangle((-xdescent, -ydescent), width, height, **frame)]
