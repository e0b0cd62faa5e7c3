"""The colours of all pictures. Told apart by colour-blind people: Okabe and Ito's palette (2008) for what is drawn, and for
the costmap under it a ramp of lightness, with unknown space on the blue-yellow axis that nearly everybody sees.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, INSCRIBED, LETHAL, UNKNOWN

BLACK: Final = "#000000"
ORANGE: Final = "#E69F00"
SKY: Final = "#56B4E9"
GREEN: Final = "#009E73"
YELLOW: Final = "#F0E442"
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"

DRIVEN: Final = BLUE
PLAN: Final = ORANGE
FOOTPRINT: Final = SKY
START: Final = GREEN
GOAL: Final = VERMILLION
RECOVERY: Final = PURPLE
COLLISION: Final = YELLOW
OBSTACLE: Final = "#6B6B6B"
MOVING: Final = "#A85C00"
INK: Final = "#333333"
FAINT: Final = "#8A8A8A"

PLANS: Final = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, BLACK, SKY)
"""For several plans side by side, in this order."""

FREE_RGB: Final = (255, 255, 255)
LOW_RGB: Final = (240, 236, 249)
HIGH_RGB: Final = (186, 171, 220)
INSCRIBED_RGB: Final = (133, 112, 184)
LETHAL_RGB: Final = (36, 31, 49)
UNKNOWN_RGB: Final = (228, 221, 203)


def cost_colors() -> NDArray[np.uint8]:
    """(256, 3) RGB of every cost."""
    table = np.empty((256, 3), np.uint8)
    share = np.linspace(0.0, 1.0, INSCRIBED - 1)[:, None]
    table[FREE] = FREE_RGB
    table[FREE + 1 : INSCRIBED] = np.round((1.0 - share) * np.array(LOW_RGB) + share * np.array(HIGH_RGB))
    table[INSCRIBED] = INSCRIBED_RGB
    table[LETHAL] = LETHAL_RGB
    table[UNKNOWN] = UNKNOWN_RGB
    return table


class Paint:
    """Colours for the cells of a grid of bytes, and which of several cells shows when they have to share a pixel.

    A wall one cell wide must not fade away on a map of a whole campus: the cell of the highest rank wins.
    """

    def __init__(self, order: NDArray[np.uint8], rgb: NDArray[np.uint8]) -> None:
        """`order` (256,): every value of a cell, the least conspicuous first; `rgb` (256, 3): colour of every value."""
        self._rank = np.empty(256, np.uint8)
        self._rank[order] = np.arange(256, dtype=np.uint8)
        opaque = np.full((256, 1), 255, np.uint8)
        self._rgba = np.concatenate((rgb, opaque), axis=1)[order]

    def __call__(
        self, cells: NDArray[np.uint8] | NDArray[np.int8], *, block: int = 1, clear: int | None = None
    ) -> NDArray[np.uint8]:
        """(ny, nx, 4) RGBA of cells (ny, nx); with `block`, one for every block x block cells (fewer at the far edges).

        Cells of the value `clear` are transparent.
        """
        rank = self._rank[cells.view(np.uint8)]
        if block > 1:
            for axis in (0, 1):
                rank = np.maximum.reduceat(rank, np.arange(0, rank.shape[axis], block), axis=axis)
        rgba = self._rgba
        if clear is not None:
            rgba = rgba.copy()
            rgba[self._rank[clear], 3] = 0
        return rgba[rank]


def _occupancy_colors() -> NDArray[np.uint8]:
    share = np.minimum(np.arange(256), 100)[:, None] / 100.0
    rgb = np.round((1.0 - share) * np.array(FREE_RGB) + share * np.array(LETHAL_RGB)).astype(np.uint8)
    rgb[128:] = UNKNOWN_RGB
    return rgb


# unknown space is more than nothing, and less than anything seen
COSTS: Final = Paint(np.array([FREE, UNKNOWN, *range(1, 255)], np.uint8), cost_colors())
"""For costmaps."""
OCCUPANCY: Final = Paint(np.array([0, *range(128, 256), *range(1, 128)], np.uint8), _occupancy_colors())
"""For the int8 cells of an occupancy grid: free white, occupied dark, between by share, unknown sand."""


def hex_of(rgb: tuple[int, int, int]) -> str:
    """`#rrggbb`, as matplotlib takes it."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def exact_colors() -> NDArray[np.uint8]:
    """(n, 3) RGB of everything that carries a meaning, a few dozen: what a palette of 256 must not blur."""
    drawn = (BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, PURPLE, OBSTACLE, MOVING, INK, FAINT)
    rgb = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in drawn], np.uint8)
    return np.unique(np.concatenate((rgb, cost_colors())), axis=0)
