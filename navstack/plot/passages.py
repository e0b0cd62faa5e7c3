"""The picture of a map with its passages: passable, at high cost, not passable."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint
from navstack.plot import canvas, colors, drawing
from navstack.plot.picture import Entries, Picture, area_of, area_of_grid, cost_legend, shaped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from navstack.explain import PassageReport, Rating, ShapePassage

_ARROW_M: Final = 0.8
"""Length of the wedge of headings, in circumscribed radii."""


@dataclass(frozen=True, slots=True)
class _Bar:
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


KINDS: Final[dict[Rating, _Kind]] = {
    "free": _Kind("passable", colors.BLUE, "o", 5.0),
    "costly": _Kind("at high cost", colors.ORANGE, "D", 5.0),
    "blocked": _Kind("not passable", colors.VERMILLION, "X", 6.5),
}
"""Style of each rating: ratings differ by color and by marker."""
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
"""Scale (points per meter) from which on bars and markers have their full size."""


def plot_passage_report(
    report: PassageReport,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    name: str = "the map",
    dpi: float = 170.0,
) -> Any:
    """Draw a map with a bar across every passage; `report` is the result of `find_passages(configuration, grid)`.

    `name` is that of the map. The picture is cut to the known part. For a robot with a shape, the bars are of `SHAPE_KINDS`, and
    each opening shows how the footprint passes. To a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises
    OutputError. Returns the file; without a path the axes.
    """
    canvas.check_target(path, ax)
    costmap = report.costmap
    kinds: Mapping[str, _Kind] = {**KINDS} if report.shapes is None else SHAPE_KINDS
    ratings: list[str] = [p.rating for p in report.passages]
    if report.shapes is not None:
        ratings = [shape.verdict for shape in report.shapes]
    bars = [
        _Bar(i, passage.ends, kind) for i, (passage, kind) in enumerate(zip(report.passages, ratings, strict=True), 1)
    ]
    title, subtitle = _texts(report, name)
    shown = shaped(_area(costmap, bars), least=3.0)
    with canvas.style():
        picture = Picture(shown, title=title, subtitle=subtitle, width_in=11.0, ax=ax, managed=path is None)
        axes = picture.axes
        drawing.draw_grid(axes, costmap.data, colors.COSTS, costmap.geometry, area=picture.area)
        entries: Entries = []
        scale = min(1.0, max(0.8, picture.points_per_m / _ROOMY))
        for key, kind in kinds.items():
            mine = [bar for bar in bars if bar.kind == key]
            if mine:
                entries.append((_draw_bars(axes, mine, kind, scale), f"{kind.label} ({len(mine)})"))
        entries += _draw_openings(axes, [shape for shape in report.shapes or () if shape.headings], report.footprint)
        _number(axes, bars, picture.points_per_m, scale)
        entries += cost_legend(costmap.data[costmap.geometry.window_of(picture.area).slices])
        picture.legend(entries)
        return picture.finish(path, dpi)


def _texts(report: PassageReport, name: str) -> tuple[str, str]:
    """Title and subtitle."""
    of_costmap = f"{report.costmap_name} costmap:"
    if report.shapes is not None:
        radius = f"   turning radius {report.turning_radius:g} m" if report.turning_radius else ""
        return f"passages of {name} for a footprint", (
            f"{of_costmap} footprint with inscribed radius {report.inscribed_radius:.3f} m, "
            f"circumscribed radius {report.circumscribed_radius:.3f} m{radius}"
        )
    counts = ", ".join(f"{report.count(rating)} {kind.label}" for rating, kind in KINDS.items())
    return f"passages of {name}: {counts}", (
        f"{of_costmap} inscribed radius {report.inscribed_radius:.3f} m, inflation radius {report.inflation_radius:g} m   "
        f"minimum width {report.widths.minimum:.2f} m, low-cost width {report.widths.low_cost:.2f} m"
    )


def _area(costmap: Costmap, bars: Sequence[_Bar]) -> Bounds:
    """Return the part of the costmap that differs from the most frequent cost on its border."""
    g = costmap.geometry
    data = costmap.data
    edge = np.bincount(np.concatenate((data[0], data[-1], data[:, 0], data[:, -1])), minlength=256).argmax()
    rows, columns = np.flatnonzero((data != edge).any(axis=1)), np.flatnonzero((data != edge).any(axis=0))
    if not len(rows):
        return area_of_grid(g)
    x0, y0 = g.cell_to_world(int(columns[0]), int(rows[0]))
    x1, y1 = g.cell_to_world(int(columns[-1]), int(rows[-1]))
    area = Bounds(x0, y0, x1, y1).union(area_of([np.array(bar.ends) for bar in bars]))
    return area.grown(0.02 * max(g.width_m, g.height_m))


def _draw_bars(axes: Axes, bars: Sequence[_Bar], kind: _Kind, scale: float) -> Any:
    from matplotlib.lines import Line2D

    for bar in bars:
        drawing.draw_line(axes, np.array(bar.ends), kind.color, width=2.2 * scale, casing=True, zorder=5)
    middles = np.array([bar.ends for bar in bars]).mean(axis=1)
    style: dict[str, Any] = {"marker": kind.marker, "color": kind.color, "mec": "white", "mew": 0.8}
    axes.plot(middles[:, 0], middles[:, 1], ls="none", zorder=6, ms=kind.size * scale, **style)
    return Line2D([], [], lw=2.2, ms=kind.size, **style)


def _number(axes: Axes, bars: Sequence[_Bar], points_per_m: float, scale: float) -> None:
    """Draw the numbers next to their bars, each where it overlaps least with marks and other numbers."""
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
        # ties go to the first position, next to the middle of the bar
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
    """Return 1 if the box of half sizes `half` around `spot` contains no point, down to 0 for a point in its center."""
    if not len(points):
        return 1.0
    return min(1.0, float((np.abs(points - spot) / half).max(axis=1).min()))


def _draw_openings(axes: Axes, openings: Sequence[ShapePassage], footprint: Footprint) -> Entries:
    """Draw footprints, wedges of headings and ways; returns the entries of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch, Wedge

    if not openings:
        return []
    radius = _ARROW_M * footprint.circumscribed_radius
    turns: list[NDArray[np.float64]] = []
    for opening in openings:
        pose = opening.headings[0].pose
        drawing.draw_footprint(axes, footprint, pose, zorder=4.2)
        for headings in opening.headings:
            wedge = Wedge(pose[:2], radius, math.degrees(headings.low), math.degrees(headings.high))
            wedge.set(facecolor=colors.GREEN, alpha=0.35, lw=0.0, zorder=4.4)
            axes.add_patch(wedge)
        nose = (pose.x + radius * math.cos(pose.yaw), pose.y + radius * math.sin(pose.yaw))
        axes.plot([pose.x, nose[0]], [pose.y, nose[1]], color=colors.GREEN, lw=1.0, zorder=4.6)
        if opening.path is not None:
            way, signs = opening.path.poses, opening.path.directions
            axes.plot(way[:, 0], way[:, 1], color=colors.BLACK, lw=0.9, zorder=4.5)
            turns.append(way[np.flatnonzero(signs[1:] * signs[:-1] < 0) + 1])
    entries: Entries = [
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
