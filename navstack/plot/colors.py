"""The colors of all pictures, distinguishable for color-blind readers.

Lines and marks use the palette of Okabe and Ito (2008). Costmaps use a ramp of lightness, and a hue on the blue-yellow axis
for unknown space, which almost every reader distinguishes.
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
SCAN: Final = VERMILLION
RECOVERY: Final = PURPLE
COLLISION: Final = YELLOW
STALL: Final = BLACK
OBSTACLE: Final = "#6B6B6B"
MOVING: Final = "#A85C00"
INK: Final = "#333333"
FAINT: Final = "#8A8A8A"

PLANS: Final = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, BLACK, SKY)
"""Colors of several plans, in this order."""

FREE_RGB: Final = (255, 255, 255)
LOW_RGB: Final = (240, 236, 249)
HIGH_RGB: Final = (186, 171, 220)
INSCRIBED_RGB: Final = (133, 112, 184)
LETHAL_RGB: Final = (36, 31, 49)
UNKNOWN_RGB: Final = (228, 221, 203)


def cost_colors() -> NDArray[np.uint8]:
    """Return (256, 3) the RGB of every cost."""
    table = np.empty((256, 3), np.uint8)
    share = np.linspace(0.0, 1.0, INSCRIBED - 1)[:, None]
    table[FREE] = FREE_RGB
    table[FREE + 1 : INSCRIBED] = np.round((1.0 - share) * np.array(LOW_RGB) + share * np.array(HIGH_RGB))
    table[INSCRIBED] = INSCRIBED_RGB
    table[LETHAL] = LETHAL_RGB
    table[UNKNOWN] = UNKNOWN_RGB
    return table


class Paint:
    """Colors for the cells of a grid of bytes, and their ranks.

    Of the cells that share a pixel, the one of the highest rank is drawn: walls of one cell stay visible on large maps.
    """

    def __init__(self, order: NDArray[np.uint8], rgb: NDArray[np.uint8]) -> None:
        """`order` (256,): all values of a cell by rank, the lowest first; `rgb` (256, 3): color of every value."""
        self._rank = np.empty(256, np.uint8)
        self._rank[order] = np.arange(256, dtype=np.uint8)
        opaque = np.full((256, 1), 255, np.uint8)
        self._rgba = np.concatenate((rgb, opaque), axis=1)[order]

    def __call__(
        self, cells: NDArray[np.uint8] | NDArray[np.int8], *, block: int = 1, clear: int | None = None
    ) -> NDArray[np.uint8]:
        """Return (ny, nx, 4) the RGBA of cells (ny, nx), or of blocks of `block` x `block` cells.

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


# unknown ranks above free and below every other cost
COSTS: Final = Paint(np.array([FREE, UNKNOWN, *range(1, 255)], np.uint8), cost_colors())
"""For costmaps."""
OCCUPANCY: Final = Paint(np.array([0, *range(128, 256), *range(1, 128)], np.uint8), _occupancy_colors())
"""For the int8 cells of an occupancy grid: white (free) to dark (occupied) by probability, sand for unknown."""


def hex_of(rgb: tuple[int, int, int]) -> str:
    """Return `#rrggbb`, as used by matplotlib."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def exact_colors() -> NDArray[np.uint8]:
    """Return (n, 3) the RGB of all colors with a meaning, which a palette of 256 colors must contain exactly."""
    drawn = (BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, PURPLE, OBSTACLE, MOVING, INK, FAINT)
    rgb = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in drawn], np.uint8)
    return np.unique(np.concatenate((rgb, cost_colors())), axis=0)
