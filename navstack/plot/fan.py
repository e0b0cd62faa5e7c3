"""A picture of one control cycle: the fan of trajectories over the local costmap, and which of them were ruled out by whom."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Costmap, Footprint, Pose2D
from navstack.plot import canvas, colors

# who rejected: told apart by the dashes as well as by the colour
_REJECTED: Final = (
    (colors.VERMILLION, (0, (4.0, 1.6)), "X"),
    (colors.PURPLE, (0, (1.0, 1.3)), "v"),
    (colors.SKY, (0, (6.0, 1.4, 1.2, 1.4)), "s"),
    (colors.GREEN, (0, (2.0, 2.4)), "D"),
    (colors.FAINT, (0, (1.0, 3.0)), "P"),
)
_IN_PLACE_M: Final = 0.02
"""A trajectory shorter than this turns in place, and is drawn as an arc around the robot."""


def plot_fan(
    costmap: Costmap,
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    totals: NDArray[np.float64],
    rejected_by: Sequence[str | None],
    path: str | os.PathLike[str],
    *,
    best: int,
    robot: Pose2D,
    footprint: Footprint | None = None,
    plan: NDArray[np.float64] | None = None,
    contacts: Sequence[int] | None = None,
    title: str = "",
    subtitle: str = "",
    dpi: float = 130.0,
) -> Path:
    """Draws trajectories `poses` (K, T, 3) with `counts` (K,) valid points to a .png, .svg or .pdf; all in the costmap's frame.

    Legal ones are coloured by `totals` (K,), the others marked by who rejected them (`rejected_by`: K names, None for legal);
    `contacts` (K,) is the point of collision, -1 without. `best`: index of the winner, -1 for none. `plan` (n, 2+): the part
    in sight. Raises OutputError. Returns the file.
    """
    out = Path(path)
    canvas.check_format(out)
    drawn = np.flatnonzero(counts > 0)
    legal = np.array([k for k in drawn.tolist() if rejected_by[k] is None], np.int64)
    names = _by_number(rejected_by, drawn)
    radius = footprint.circumscribed_radius if footprint is not None else 0.3
    area = _area(poses, counts, drawn, robot, radius, costmap)
    low, high = _range(totals[legal])
    with canvas.style():
        picture = canvas.Picture(area, title=title, subtitle=subtitle, width_in=10.0, legend_in=3.0)
        axes = picture.axes
        canvas.draw_grid(axes, costmap.data, colors.COSTS, costmap.geometry, area=picture.area)
        handles: list[Any] = []
        labels: list[str] = []
        shapes = _shapes(poses, counts, drawn, robot, radius)

        for number, (name, rows) in enumerate(names.items()):
            color, dashes, marker = _REJECTED[min(number, len(_REJECTED) - 1)]
            for k in rows:
                stop = contacts[k] if contacts is not None else -1
                shape = shapes[k]
                inside = len(shape) == counts[k]
                part = shape[: stop + 1] if inside and stop > 0 else shape
                axes.plot(part[:, 0], part[:, 1], color=color, ls=dashes, lw=1.0, alpha=0.85, zorder=3.0)
                axes.plot(*part[-1, :2], marker, ms=4.0, color=color, mec="white", mew=0.4, zorder=3.1)
            handles.append(_line(color, dashes, marker))
            labels.append(f"{len(rows)} rejected by {name}")

        ramp = _ramp()
        # the dearest first, so that the cheapest lie on top
        for k in sorted(legal.tolist(), key=lambda k: -totals[k]):
            if k == best:
                continue
            share = (min(totals[k], high) - low) / (high - low) if high > low else 0.0
            canvas.draw_line(axes, shapes[k], ramp(share), width=1.5, zorder=4.0)
        if len(legal):
            handles.append(_line(ramp(0.0), "-", ""))
            labels.append(f"{len(legal)} legal, coloured by cost (below)")

        if plan is not None and len(plan):
            line = canvas.draw_line(axes, plan, colors.PLAN, width=2.0, casing=True, ls=(0, (7, 2.5)), zorder=4.5)
            handles.append(line)
            labels.append("plan in sight")
        if footprint is not None:
            outline = canvas.draw_footprint(axes, footprint, robot, zorder=4.8)
            handles.append(outline)
            labels.append("footprint, with padding")
        if best >= 0 and counts[best] > 0:
            line = canvas.draw_line(axes, shapes[best], colors.BLACK, width=3.4, casing=True, zorder=5.5)
            _head(axes, shapes[best])
            if footprint is not None:
                end = canvas.pose_of(poses[best, counts[best] - 1])
                axes.fill(
                    *footprint.at(end).T, fill=False, edgecolor=colors.BLACK, lw=0.9, ls=(0, (2, 1.5)), zorder=5.4
                )
            handles.insert(0, line)
            labels.insert(0, f"chosen (cost {totals[best]:.4g})")
        canvas.draw_heading(axes, robot, colors.BLUE, picture.points_per_m)
        window = costmap.geometry.window_of(picture.area)
        bands, texts = canvas.cost_legend(costmap.data[window.slices])
        legend = picture.legend(handles + bands, labels + texts)
        if len(legal):
            _scale(picture, legend, ramp, low, high, clipped=bool((totals[legal] > high).any()))
        return canvas.save(picture.figure, out, dpi)


def _by_number(rejected_by: Sequence[str | None], drawn: NDArray[np.int64]) -> dict[str, list[int]]:
    """The rows that each critic rejected, the most frequent critic first."""
    found: dict[str, list[int]] = {}
    for k in drawn.tolist():
        name = rejected_by[k]
        if name is not None:
            found.setdefault(name, []).append(k)
    return dict(sorted(found.items(), key=lambda item: (-len(item[1]), item[0])))


def _area(
    poses: NDArray[np.float64],
    counts: NDArray[np.int64],
    drawn: NDArray[np.int64],
    robot: Pose2D,
    radius: float,
    costmap: Costmap,
) -> Bounds:
    points = [np.array([[robot.x - 2 * radius, robot.y - 2 * radius], [robot.x + 2 * radius, robot.y + 2 * radius]])]
    points += [poses[k, : counts[k], :2] for k in drawn.tolist()]
    area = canvas.shaped(canvas.area_of(points).grown(0.5), widest=1.6, tallest=1.1, least=2.0)
    whole = canvas.area_of_grid(costmap.geometry)
    wanted = area.max_x - area.min_x, area.max_y - area.min_y
    if wanted[0] >= whole.max_x - whole.min_x or wanted[1] >= whole.max_y - whole.min_y:
        return whole
    return area


def _range(totals: NDArray[np.float64]) -> tuple[float, float]:
    """Ends of the colours: the lowest total, and one that only outliers exceed."""
    if not len(totals):
        return 0.0, 0.0
    low, median, top = float(totals.min()), float(np.median(totals)), float(totals.max())
    return low, min(top, low + 4.0 * (median - low)) if median > low else top


def _shapes(
    poses: NDArray[np.float64], counts: NDArray[np.int64], drawn: NDArray[np.int64], robot: Pose2D, radius: float
) -> dict[int, NDArray[np.float64]]:
    """What is drawn of each trajectory: its way, or, in place, an arc as wide as the turn, each outside the one before."""
    shapes: dict[int, NDArray[np.float64]] = {}
    arcs = 0
    for k in drawn.tolist():
        way = poses[k, : counts[k]]
        if np.ptp(way[:, 0]) + np.ptp(way[:, 1]) > _IN_PLACE_M:
            shapes[k] = way
            continue
        turn = float(np.unwrap(way[:, 2])[-1] - way[0, 2])
        around = way[0, 2] + np.linspace(0.0, turn, 40)
        reach = radius * (1.1 + 0.035 * arcs)
        arcs += 1
        shapes[k] = np.column_stack((robot.x + reach * np.cos(around), robot.y + reach * np.sin(around), around))
    return shapes


def _head(axes: Any, way: NDArray[np.float64]) -> None:
    """An arrow head at the end of the winner."""
    back = np.flatnonzero(np.hypot(*(way[:, :2] - way[-1, :2]).T) > 1e-3)
    if not len(back):
        return
    axes.annotate(
        "",
        xy=tuple(way[-1, :2]),
        xytext=tuple(way[back[-1], :2]),
        arrowprops={
            "arrowstyle": "-|>,head_length=0.6,head_width=0.35",
            "color": colors.BLACK,
            "lw": 2.0,
            "shrinkB": 0,
        },
        zorder=5.6,
        annotation_clip=True,
    )


def _ramp() -> Any:
    """Costs of legal samples: dark blue is cheap, light yellow dear; made for colour-blind people, and of growing lightness."""
    from matplotlib import colormaps

    whole = colormaps["cividis"]

    def color(share: float) -> Any:
        return whole(0.92 * float(share))

    return color


def _line(color: Any, dashes: Any, marker: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=color, ls=dashes, lw=1.4, marker=marker, ms=5, mec="white", mew=0.4)


def _scale(picture: Any, legend: Any, ramp: Any, low: float, high: float, *, clipped: bool) -> None:
    """A bar below the legend that gives the colours their numbers."""
    picture.canvas.draw()
    figure = picture.figure
    box = legend.get_window_extent().transformed(figure.transFigure.inverted())
    height = 0.13 / figure.get_figheight()
    bar = figure.add_axes(
        (box.x0 + 0.01, max(box.y0 - 3.2 * height, 0.02 + 1.2 * height), 2.4 / figure.get_figwidth(), height)
    )
    bar.imshow(
        np.array([[ramp(s) for s in np.linspace(0.0, 1.0, 128)]])[..., :3], aspect="auto", extent=(0.0, 1.0, 0.0, 1.0)
    )
    bar.set_yticks([])
    same = math.isclose(low, high, rel_tol=1e-12)
    bar.set_xticks([0.0] if same else [0.0, 1.0])
    bar.set_xticklabels([f"{low:.4g}"] if same else [f"{low:.4g}", f"{high:.4g}{' and more' if clipped else ''}"])
    bar.tick_params(length=0, labelsize=8)
    bar.set_title("cost of legal samples", fontsize=8.5, fontweight="normal", pad=3)
