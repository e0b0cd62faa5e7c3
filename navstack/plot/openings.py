"""Openings for a robot with a shape, in the picture of a map's passages: headings, a footprint, and the way through."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, Path, Pose2D
from navstack.plot import colors, drawing

_ARROW_M = 0.8
"""Length of the wedge of headings, in circumscribed radii."""


@dataclass(frozen=True, slots=True)
class Opening:
    """What is drawn of an opening that the robot fits into."""

    pose: Pose2D
    """In the opening."""
    headings: tuple[tuple[float, float], ...]
    """Ranges of headings (rad)."""
    path: NDArray[np.float64] | None
    """(n, 3) the way through."""


def draw_openings(axes: Any, openings: Sequence[Opening], footprint: Footprint) -> list[tuple[Any, str]]:
    """Draws footprints, wedges of headings and ways; returns the entries of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch, Wedge

    if not openings:
        return []
    radius = _ARROW_M * footprint.circumscribed_radius
    turns: list[NDArray[np.float64]] = []
    for opening in openings:
        x, y, yaw = opening.pose
        drawing.draw_footprint(axes, footprint, opening.pose, zorder=4.2)
        for low, high in opening.headings:
            wedge = Wedge((x, y), radius, math.degrees(low), math.degrees(high))
            wedge.set(facecolor=colors.GREEN, alpha=0.35, lw=0.0, zorder=4.4)
            axes.add_patch(wedge)
        axes.plot(
            [x, x + radius * math.cos(yaw)], [y, y + radius * math.sin(yaw)], color=colors.GREEN, lw=1.0, zorder=4.6
        )
        if opening.path is not None:
            axes.plot(opening.path[:, 0], opening.path[:, 1], color=colors.BLACK, lw=0.9, zorder=4.5)
            signs = Path(opening.path).directions
            turns.append(opening.path[np.flatnonzero(signs[1:] * signs[:-1] < 0) + 1])
    entries: list[tuple[Any, str]] = [
        (Patch(facecolor=colors.FOOTPRINT + "40", edgecolor=colors.BLUE), "footprint in the opening"),
        (Patch(facecolor=colors.GREEN, alpha=0.35), "headings at which it fits"),
    ]
    if turns:
        entries.append((Line2D([], [], color=colors.BLACK, lw=0.9), "way through"))
        at = np.concatenate(turns)
        if len(at):
            (mark,) = axes.plot(at[:, 0], at[:, 1], "D", ms=3.5, color=colors.BLACK, mec="white", mew=0.5, zorder=7)
            entries.append((mark, "change of direction"))
    return entries
