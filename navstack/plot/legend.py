"""Legend handles: cost bands, map cells, marks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.plot import colors


class Ramp:
    """Handle for the costs between free and inscribed."""


def handlers() -> dict[Any, Any]:
    """Returns the legend handlers of the handles in this module."""
    from navstack.plot.ramp_handler import RampHandler

    return {Ramp: RampHandler()}


def swatch(rgb: tuple[int, int, int]) -> Any:
    """Handle: a box of one colour."""
    from matplotlib.patches import Patch

    return Patch(facecolor=colors.hex_of(rgb), edgecolor=colors.FAINT, linewidth=0.5)


def translucent(color: str) -> Any:
    """Handle: a box of a translucent colour."""
    from matplotlib.patches import Patch

    return Patch(facecolor=color, edgecolor=color, alpha=0.5, linewidth=0.6)


def cost_legend(costs: NDArray[np.uint8] | None) -> tuple[list[Any], list[str]]:
    """Returns handles and labels of the cost bands: those that occur in `costs`, or all."""
    bands = (
        (swatch(colors.FREE_RGB), "free (0)", (0, 0)),
        (Ramp(), "inflated (1 to 252)", (1, 252)),
        (swatch(colors.INSCRIBED_RGB), "inscribed (253)", (253, 253)),
        (swatch(colors.LETHAL_RGB), "lethal (254)", (254, 254)),
        (swatch(colors.UNKNOWN_RGB), "unknown (255)", (255, 255)),
    )
    present = np.ones(256, bool) if costs is None else np.bincount(costs.ravel(), minlength=256) > 0
    kept = [(handle, label) for handle, label, (low, high) in bands if present[low : high + 1].any()]
    return [handle for handle, _ in kept], [label for _, label in kept]


def occupancy_legend() -> tuple[list[Any], list[str]]:
    """Returns handles and labels of the cells of an occupancy grid."""
    return (
        [swatch(colors.FREE_RGB), swatch(colors.LETHAL_RGB), swatch(colors.UNKNOWN_RGB)],
        ["free", "occupied", "unknown"],
    )


def disc(color: str, *, hollow: bool = False) -> Any:
    """Handle: the disc of a start or goal."""
    from matplotlib.lines import Line2D

    face, edge = ("white", color) if hollow else (color, "white")
    return Line2D([], [], ls="none", marker="o", ms=9, color=face, mec=edge, mew=1.4 if hollow else 1.0)


def frame_handle() -> Any:
    """Handle: the dashed border of a rolling window."""
    from matplotlib.patches import Patch

    return Patch(facecolor="none", edgecolor=colors.INK, linestyle=(0, (3, 2)), linewidth=1.0)
