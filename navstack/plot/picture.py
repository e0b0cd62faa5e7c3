"""A picture in meters: axes, title, length bar and legend, in a figure of its own or in axes of the caller."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, GridGeometry, OccupancyGrid
from navstack.plot import canvas, colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Entries = list[tuple[Any, str]]
"""Handles and labels of a legend."""

# --- areas (m) --------------------------------------------------------------------------------------------------------


def area_of(points: Sequence[NDArray[np.float64]]) -> Bounds:
    """Return the bounding box of the finite points among arrays (n, 2+)."""
    area = Bounds()
    for part in points:
        finite = part[np.isfinite(part[:, :2]).all(axis=1)]
        if len(finite):
            (x0, y0), (x1, y1) = finite[:, :2].min(axis=0), finite[:, :2].max(axis=0)
            area = area.union(Bounds(float(x0), float(y0), float(x1), float(y1)))
    return area


def shaped(area: Bounds, widest: float = 2.5, tallest: float = 1.4, least: float = 4.0) -> Bounds:
    """Grow an area about its center until its aspect ratio and its sides suit a picture."""
    width, height = area.max_x - area.min_x, area.max_y - area.min_y
    new_width = max(width, height / tallest, least)
    new_height = max(height, width / widest, least)
    mx, my = (area.min_x + area.max_x) / 2.0, (area.min_y + area.max_y) / 2.0
    return Bounds(mx - new_width / 2.0, my - new_height / 2.0, mx + new_width / 2.0, my + new_height / 2.0)


def area_of_grid(geometry: GridGeometry) -> Bounds:
    """Return the extent of a grid."""
    x0, x1, y0, y1 = geometry.extent
    return Bounds(x0, y0, x1, y1)


# --- handles of legends -----------------------------------------------------------------------------------------------


_RAMP_STEPS: Final = 32


class Ramp:
    """Handle for the costs between free and inscribed."""


def handlers() -> dict[Any, Any]:
    """Return the legend handlers of the handles in this module; their class needs matplotlib, so it is made with a picture."""
    from matplotlib.legend_handler import HandlerBase
    from matplotlib.patches import Rectangle

    class RampHandler(HandlerBase):
        """Draws a swatch with the colors of the costs from 1 to 252: rectangles of single colors in a frame."""

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
            table = colors.cost_colors() / 255.0
            step = width / _RAMP_STEPS
            parts: list[Any] = []
            for i in range(_RAMP_STEPS):
                color = table[1 + round(251 * i / (_RAMP_STEPS - 1))]
                style: dict[str, Any] = {"facecolor": color, "edgecolor": "none", "transform": trans}
                parts.append(Rectangle((i * step - xdescent, -ydescent), 1.05 * step, height, **style))
            frame: dict[str, Any] = {"facecolor": "none", "edgecolor": colors.FAINT, "lw": 0.5, "transform": trans}
            return [*parts, Rectangle((-xdescent, -ydescent), width, height, **frame)]

    return {Ramp: RampHandler()}


def swatch(rgb: tuple[int, int, int]) -> Any:
    """Handle: a box of one color."""
    from matplotlib.patches import Patch

    return Patch(facecolor=colors.hex_of(rgb), edgecolor=colors.FAINT, linewidth=0.5)


def translucent_handle(color: str) -> Any:
    """Handle: a box of a translucent color."""
    from matplotlib.patches import Patch

    return Patch(facecolor=color, edgecolor=color, alpha=0.5, linewidth=0.6)


def cost_legend(costs: NDArray[np.uint8] | None) -> Entries:
    """Return the entries of the cost bands: those that occur in `costs`, or all."""
    bands = (
        (swatch(colors.FREE_RGB), "free (0)", (0, 0)),
        (Ramp(), "inflated (1 to 252)", (1, 252)),
        (swatch(colors.INSCRIBED_RGB), "inscribed (253)", (253, 253)),
        (swatch(colors.LETHAL_RGB), "lethal (254)", (254, 254)),
        (swatch(colors.UNKNOWN_RGB), "unknown (255)", (255, 255)),
    )
    present = np.ones(256, bool) if costs is None else np.bincount(costs.ravel(), minlength=256) > 0
    return [(handle, label) for handle, label, (low, high) in bands if present[low : high + 1].any()]


def occupancy_legend(grid: OccupancyGrid) -> Entries:
    """Return the entries of the kinds of cells that occur in an occupancy grid."""
    present = np.bincount(grid.data.ravel().view(np.uint8), minlength=256) > 0
    cells = (
        ("free", colors.FREE_RGB, present[:50]),
        ("occupied", colors.LETHAL_RGB, present[50:128]),
        ("unknown", colors.UNKNOWN_RGB, present[128:]),
    )
    return [(swatch(rgb), name) for name, rgb, occurs in cells if occurs.any()]


def disc_handle(color: str, *, hollow: bool = False) -> Any:
    """Handle: the disc of a start or goal."""
    from matplotlib.lines import Line2D

    face, edge = ("white", color) if hollow else (color, "white")
    return Line2D([], [], ls="none", marker="o", ms=9, color=face, mec=edge, mew=1.4 if hollow else 1.0)


def frame_handle() -> Any:
    """Handle: the dashed border of a rolling window."""
    from matplotlib.patches import Patch

    return Patch(facecolor="none", edgecolor=colors.INK, linestyle=(0, (3, 2)), linewidth=1.0)


_TALLEST_IN: Final = 6.6
"""Largest height of the axes of a picture."""
_TALL: Final = 0.7
"""Ratio of height to width from which on the legend is next to the axes; below them for wide areas."""
_RIGHT_IN: Final = 0.18
_MOST_COLUMNS: Final = 6


class Picture:
    """A figure with axes in meters, a title above them, and a legend below (wide areas) or next to them (tall ones)."""

    def __init__(
        self,
        area: Bounds,
        *,
        title: str,
        subtitle: str = "",
        width_in: float = 9.2,
        ax: Axes | None = None,
        managed: bool = False,
    ) -> None:
        """`ax`: draw there instead of in a new figure. `managed`: create the figure by pyplot, which notebooks display."""
        # a file name that is not UTF-8 contains lone surrogates, which no font has
        title, subtitle = (text.encode("utf-8", "replace").decode() for text in (title, subtitle))
        self.area = shaped(area, least=0.0)
        wide, high = self.area.max_x - self.area.min_x, self.area.max_y - self.area.min_y
        self._own = ax is None
        paper = canvas.is_paper() and self._own
        self._beside = high / wide > _TALL and not paper
        if ax is not None:
            self.figure: Any = ax.figure
            self.axes: Axes = ax
            ax.set_title("\n".join(part for part in (title, subtitle.strip()) if part), fontsize=9.0)
            self._set_up_axes()
            box = ax.get_window_extent()
            self.points_per_m = 72.0 / self.figure.dpi * min(box.width / wide, box.height / high)
            return
        self._left, self._right, self._bottom, self._top = 0.62, _RIGHT_IN, 0.55, 0.72 if subtitle else 0.5
        if paper:
            width_in, title, subtitle = canvas.PAPER_WIDTH_IN, "", ""
            self._left, self._right, self._bottom, self._top = 0.42, 0.06, 0.4, 0.06
        width = width_in - self._left - self._right - (2.0 if self._beside else 0.0)
        scale = min(width / wide, _TALLEST_IN / high)
        self._width, self._height = wide * scale, high * scale
        self.figure = canvas.managed_figure(*self._size) if managed else canvas.new_figure(*self._size)
        self.axes = self.figure.add_axes((0.1, 0.1, 0.8, 0.8), facecolor="white" if paper else "#F4F4F4")
        self.points_per_m = 72.0 * scale / canvas.line_scale()
        """Scale of the axes, in points (1/72 inch, in print as much smaller as marks) per meter."""
        self.subtitle = self.figure.text(0, 0, subtitle, fontsize=8.5, color="#666666", va="baseline")
        self._title = self.figure.text(0, 0, title, fontsize=12, fontweight="bold", va="baseline")
        self._title_offset = 0.36 if subtitle else 0.16
        self._set_up_axes()
        self._place()
        self._make_room_for_labels()

    @property
    def canvas(self) -> Any:
        """The canvas of the figure."""
        return self.figure.canvas

    @property
    def _size(self) -> tuple[float, float]:
        return self._left + self._width + self._right, self._bottom + self._height + self._top

    def _set_up_axes(self) -> None:
        self.axes.set_aspect("equal", adjustable="box", anchor="NW")
        self.axes.set_xlim(self.area.min_x, self.area.max_x)
        self.axes.set_ylim(self.area.min_y, self.area.max_y)
        self.axes.set_xlabel("x (m)")
        self.axes.set_ylabel("y (m)")
        draw_length_bar(self.axes, self.area)

    def _place(self) -> None:
        """Set the size of the figure, and the positions of axes and texts in it."""
        w, h = self._size
        self.figure.set_size_inches(w, h)
        self.axes.set_position((self._left / w, self._bottom / h, self._width / w, self._height / h))
        above = self._bottom + self._height
        self.subtitle.set_position((self._left / w, (above + 0.12) / h))
        self._title.set_position((self._left / w, (above + self._title_offset) / h))

    def _make_room_for_labels(self) -> None:
        """Widen the figure if long tick labels ("-1234.5") push the y label out of it."""
        labels = self.axes.yaxis.get_tightbbox(self.canvas.get_renderer())
        missing = 0.05 - labels.x0 / self.figure.dpi if labels is not None else 0.0
        if missing > 0.0:
            self._left += missing
            self._place()

    def legend(self, entries: Entries, *, extra_in: float = 0.0) -> Any:
        """Add the legend, grow the figure by its size plus `extra_in` (inch) below it, and return it."""
        handles, labels = [handle for handle, _ in entries], [label for _, label in entries]
        options: dict[str, Any] = {
            "loc": "upper left",
            "borderaxespad": 0.0,
            "handlelength": 2.2,
            "labelspacing": 0.6,
            "columnspacing": 1.6,
            "handler_map": handlers(),
        }
        if canvas.is_paper():
            options |= {"handlelength": 1.5, "labelspacing": 0.3, "columnspacing": 0.8, "handletextpad": 0.5}
            options |= {"borderpad": 0.0}
        if not self._own:
            return self._legend_in_given_axes(handles, labels, options)
        renderer = self.canvas.get_renderer()
        legend: Any = None
        box = self.figure.bbox
        for columns in [1] if self._beside else range(max(1, min(len(labels), _MOST_COLUMNS)), 0, -1):
            if legend is not None:
                legend.remove()
            legend = self.figure.legend(handles, labels, ncols=columns, **options)
            box = legend.get_window_extent(renderer)
            if box.width / self.figure.dpi <= self._width:
                break
        below = 0.02 if canvas.is_paper() else 0.12
        wide, high = box.width / self.figure.dpi, box.height / self.figure.dpi + extra_in
        if self._beside:
            self._right = 0.12 + max(wide, 2.1 if extra_in else 0.0) + 0.12
            self._bottom += max(0.0, high - self._height - 0.4)
        else:
            self._bottom += high + below
        self._place()
        w, h = self._size
        at = (
            ((self._left + self._width + 0.12) / w, (self._bottom + self._height) / h)
            if self._beside
            else (self._left / w, (high + below) / h)
        )
        legend.set_bbox_to_anchor(at, transform=self.figure.transFigure)
        return legend

    def _legend_in_given_axes(self, handles: Sequence[Any], labels: Sequence[str], options: dict[str, Any]) -> Any:
        """Add a small legend below the label of the x axis; a constrained layout makes room for it."""
        from matplotlib.transforms import ScaledTranslation

        below = self.axes.transAxes + ScaledTranslation(0.0, -38.0 / 72.0, self.figure.dpi_scale_trans)
        options |= {"columnspacing": 1.0, "labelspacing": 0.4, "handlelength": 1.8, "fontsize": 6.5}
        return self.axes.legend(
            handles, labels, bbox_to_anchor=(0.0, 0.0), bbox_transform=below, ncols=min(3, len(labels)), **options
        )

    def finish(self, path: str | os.PathLike[str] | None, dpi: float) -> Any:
        """Write the picture and return the file; without a path returns the axes."""
        return self.axes if path is None else canvas.save(self.figure, Path(path), dpi)


def draw_length_bar(axes: Axes, area: Bounds) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten meters, at most a fifth of the width, below the axes on the right."""
    from matplotlib.transforms import ScaledTranslation

    length = round_length((area.max_x - area.min_x) / 5.0)
    drop = 19.0 if canvas.is_paper() else 27.0
    below = axes.get_xaxis_transform() + ScaledTranslation(0.0, -drop / 72.0, axes.figure.dpi_scale_trans)
    style: dict[str, Any] = {"transform": below, "clip_on": False}
    ends = [area.max_x - length, area.max_x]
    axes.plot(ends, [0.0, 0.0], color=colors.INK, lw=2.6, solid_capstyle="butt", zorder=12, **style)
    text = f"{length:g} m" if length >= 1.0 else f"{100.0 * length:g} cm"
    axes.text(ends[0], 0.0, f"{text}  ", ha="right", va="center_baseline", fontsize=8, **style)


def round_length(longest: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that does not exceed `longest`."""
    power = 10.0 ** math.floor(math.log10(longest))
    return next(digit * power for digit in (5.0, 2.0, 1.0) if digit * power <= longest * (1.0 + 1e-12))
