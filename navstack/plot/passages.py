"""The picture of a map with its passages: passable, at high cost, not passable."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint
from navstack.plot import areas, canvas, colors, drawing, legend
from navstack.plot.openings import Opening, draw_openings
from navstack.plot.picture import Picture


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar across a passage, with its number."""

    number: int
    ends: tuple[tuple[float, float], tuple[float, float]]
    """End points (m), in the frame of the costmap."""
    kind: str
    """A key of `KINDS`, or of `SHAPE_KINDS`."""


@dataclass(frozen=True, slots=True)
class _Kind:
    label: str
    color: str
    marker: str
    size: float


KINDS: Final = {
    "free": _Kind("passable", colors.BLUE, "o", 5.0),
    "costly": _Kind("at high cost", colors.ORANGE, "D", 5.0),
    "blocked": _Kind("not passable", colors.VERMILLION, "X", 6.5),
}
"""Style of each rating: ratings differ by colour and by marker."""
SHAPE_KINDS: Final = {
    "free": _Kind("passable", colors.BLUE, "o", 5.0),
    "turns": _Kind("with changes of direction", colors.PURPLE, "s", 5.0),
    "fits": _Kind("the robot fits", colors.BLUE, "o", 5.0),
    "stuck": _Kind("fits, no way found", colors.ORANGE, "D", 5.0),
    "blocked": _Kind("not passable", colors.VERMILLION, "X", 6.5),
}
"""The same for what passages mean for a footprint."""

_LABEL_PT = 6.5
_ROOMY = 28.0
"""Scale (points per metre) from which on bars and markers have their full size."""


def plot_passages(
    costmap: Costmap,
    bars: Sequence[Bar],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str,
    subtitle: str = "",
    area: Bounds | None = None,
    openings: Sequence[Opening] = (),
    footprint: Footprint | None = None,
    dpi: float = 170.0,
) -> Any:
    """Draws the costmap to a .png, .svg or .pdf with a bar across every passage, cut to the known part or to `area` (m).

    With a `footprint`, the bars are of `SHAPE_KINDS`, and `openings` show how it passes.
    Draws into the axes `ax`, or a new figure. Raises OutputError.
    Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    shown = areas.shaped(_area(costmap, bars) if area is None else area, least=3.0)
    with canvas.style():
        picture = Picture(shown, title=title, subtitle=subtitle, width_in=11.0, ax=ax, managed=path is None)
        axes = picture.axes
        drawing.draw_grid(axes, costmap.data, colors.COSTS, costmap.geometry, area=picture.area)
        handles: list[Any] = []
        labels: list[str] = []
        scale = min(1.0, max(0.8, picture.points_per_m / _ROOMY))
        for name, kind in (KINDS if footprint is None else SHAPE_KINDS).items():
            mine = [bar for bar in bars if bar.kind == name]
            if mine:
                handles.append(_draw(axes, mine, kind, scale))
                labels.append(f"{kind.label} ({len(mine)})")
        if footprint is not None:
            for handle, text in draw_openings(axes, openings, footprint):
                handles.append(handle)
                labels.append(text)
        _number(axes, bars, picture.points_per_m, scale)
        bands, texts = legend.cost_legend(costmap.data[costmap.geometry.window_of(picture.area).slices])
        picture.legend(handles + bands, labels + texts)
        return picture.finish(path, dpi)


def _area(costmap: Costmap, bars: Sequence[Bar]) -> Bounds:
    """The part of the costmap that differs from the most frequent cost on its border."""
    g = costmap.geometry
    data = costmap.data
    edge = np.bincount(np.concatenate((data[0], data[-1], data[:, 0], data[:, -1])), minlength=256).argmax()
    rows, columns = np.flatnonzero((data != edge).any(axis=1)), np.flatnonzero((data != edge).any(axis=0))
    if not len(rows):
        return areas.area_of_grid(g)
    x0, y0 = g.cell_to_world(int(columns[0]), int(rows[0]))
    x1, y1 = g.cell_to_world(int(columns[-1]), int(rows[-1]))
    area = Bounds(x0, y0, x1, y1).union(areas.area_of([np.array(bar.ends) for bar in bars]))
    return area.grown(0.02 * max(g.width_m, g.height_m))


def _draw(axes: Any, bars: Sequence[Bar], kind: _Kind, scale: float) -> Any:
    from matplotlib.lines import Line2D

    for bar in bars:
        drawing.draw_line(axes, np.array(bar.ends), kind.color, width=2.2 * scale, casing=True, zorder=5)
    middles = np.array([bar.ends for bar in bars]).mean(axis=1)
    style: dict[str, Any] = {"marker": kind.marker, "color": kind.color, "mec": "white", "mew": 0.8}
    axes.plot(middles[:, 0], middles[:, 1], ls="none", zorder=6, ms=kind.size * scale, **style)
    return Line2D([], [], lw=2.2, ms=kind.size, **style)


def _number(axes: Any, bars: Sequence[Bar], points_per_m: float, scale: float) -> None:
    """Draws the numbers beside their bars, each where it overlaps least with marks and other numbers."""
    from matplotlib.patheffects import withStroke

    size = _LABEL_PT * scale
    ends = np.array([bar.ends for bar in bars], np.float64).reshape(-1, 2, 2) * points_per_m
    middles = ends.mean(axis=1)
    marks = np.concatenate((middles, ends.reshape(-1, 2)))
    placed = np.empty((0, 2))
    for i, bar in enumerate(bars):
        along = ends[i, 1] - ends[i, 0]
        along = along / max(float(np.hypot(*along)), 1e-9)
        half = np.array([0.33 * size * len(str(bar.number)) + 0.5, 0.45 * size])
        spots: list[NDArray[np.float64]] = []
        for c, s in ((1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1), (0, 2), (0, -2)):
            side = np.array([c * -along[1] + s * along[0], c * along[0] + s * along[1]])
            side = side / float(np.hypot(*side))
            start = middles[i] if abs(s) < 2 else ends[i, 0 if s < 0 else 1]
            spots.append(start + side * (3.0 * scale + 1.0 + float(np.abs(side) @ half)))
        others = np.delete(marks, [i, len(bars) + 2 * i, len(bars) + 2 * i + 1], axis=0)
        room = [_room(spot, placed, 2.0 * half) + 0.7 * _room(spot, others, half + 3.0 * scale) for spot in spots]
        # ties go to the first position, beside the middle of the bar
        best = max(range(len(spots)), key=lambda k: (round(room[k], 3), -k))
        placed = np.concatenate((placed, spots[best][None]))
        axes.annotate(
            str(bar.number),
            tuple(spots[best] / points_per_m),
            color=colors.BLACK,
            fontsize=size,
            fontweight="bold",
            ha="center",
            va="center_baseline",
            zorder=9,
            path_effects=[withStroke(linewidth=1.6, foreground="white")],
            annotation_clip=True,
        )


def _room(spot: NDArray[np.float64], points: NDArray[np.float64], half: NDArray[np.float64]) -> float:
    """Returns 1 if the box of half sizes `half` around `spot` contains no point, down to 0 for a point in its centre."""
    if not len(points):
        return 1.0
    return min(1.0, float((np.abs(points - spot) / half).max(axis=1).min()))
