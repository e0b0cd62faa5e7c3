"""A picture in metres: axes, title, length bar and legend, in a figure of its own or in axes of the caller."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from navstack.core import Bounds
from navstack.plot import canvas, colors
from navstack.plot.areas import shaped
from navstack.plot.legend import handlers

_TALLEST_IN: Final = 6.6
"""Largest height of the axes of a picture."""
_TALL: Final = 0.7
"""Ratio of height to width from which on the legend is beside the axes; below them for wide areas."""
_RIGHT_IN: Final = 0.18
_MOST_COLUMNS: Final = 6


class Picture:
    """A figure with axes in metres, a title above them, and a legend below (wide areas) or beside them (tall ones)."""

    def __init__(
        self,
        area: Bounds,
        *,
        title: str,
        subtitle: str = "",
        width_in: float = 9.2,
        ax: Any = None,
        managed: bool = False,
    ) -> None:
        """`ax`: draw there instead of in a new figure. `managed`: create the figure by pyplot, which notebooks display."""
        # a file name that is not UTF-8 contains lone surrogates, which no font has
        title, subtitle = (text.encode("utf-8", "replace").decode() for text in (title, subtitle))
        self.area = shaped(area, least=0.0)
        wide, high = self.area.max_x - self.area.min_x, self.area.max_y - self.area.min_y
        self._beside = high / wide > _TALL
        self._own = ax is None
        if ax is not None:
            self.figure: Any = ax.figure
            self.axes: Any = ax
            ax.set_title("\n".join(part for part in (title, subtitle.strip()) if part), fontsize=9.0)
            self._set_up_axes()
            box = ax.get_window_extent()
            self.points_per_m = 72.0 / self.figure.dpi * min(box.width / wide, box.height / high)
            return
        self._left, self._right, self._bottom, self._top = 0.62, _RIGHT_IN, 0.55, 0.72 if subtitle else 0.5
        width = width_in - self._left - self._right - (2.0 if self._beside else 0.0)
        scale = min(width / wide, _TALLEST_IN / high)
        self._width, self._height = wide * scale, high * scale
        self.figure = canvas.managed_figure(*self._size) if managed else canvas.new_figure(*self._size)
        self.axes = self.figure.add_axes((0.1, 0.1, 0.8, 0.8), facecolor="#F4F4F4")
        self.points_per_m = 72.0 * scale
        """Scale of the axes, in points (1/72 inch) per metre."""
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
        """Sets the size of the figure, and the positions of axes and texts in it."""
        w, h = self._size
        self.figure.set_size_inches(w, h)
        self.axes.set_position((self._left / w, self._bottom / h, self._width / w, self._height / h))
        above = self._bottom + self._height
        self.subtitle.set_position((self._left / w, (above + 0.12) / h))
        self._title.set_position((self._left / w, (above + self._title_offset) / h))

    def _make_room_for_labels(self) -> None:
        """Widens the figure if long tick labels ("-1234.5") push the y label out of it."""
        labels = self.axes.yaxis.get_tightbbox(self.canvas.get_renderer())
        missing = 0.05 - labels.x0 / self.figure.dpi if labels is not None else 0.0
        if missing > 0.0:
            self._left += missing
            self._place()

    def legend(self, handles: Sequence[Any], labels: Sequence[str], *, extra_in: float = 0.0, **options: Any) -> Any:
        """Adds the legend, grows the figure by its size plus `extra_in` (inch) below it, and returns it."""
        options |= {
            "loc": "upper left",
            "borderaxespad": 0.0,
            "handlelength": 2.2,
            "labelspacing": 0.6,
            "columnspacing": 1.6,
            "handler_map": handlers(),
        }
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
        wide, high = box.width / self.figure.dpi, box.height / self.figure.dpi + extra_in
        if self._beside:
            self._right = 0.12 + max(wide, 2.1 if extra_in else 0.0) + 0.12
            self._bottom += max(0.0, high - self._height - 0.4)
        else:
            self._bottom += high + 0.12
        self._place()
        w, h = self._size
        at = (
            ((self._left + self._width + 0.12) / w, (self._bottom + self._height) / h)
            if self._beside
            else (self._left / w, (high + 0.12) / h)
        )
        legend.set_bbox_to_anchor(at, transform=self.figure.transFigure)
        return legend

    def _legend_in_given_axes(self, handles: Sequence[Any], labels: Sequence[str], options: dict[str, Any]) -> Any:
        """Adds a small legend below the label of the x axis; a constrained layout makes room for it."""
        from matplotlib.transforms import ScaledTranslation

        below = self.axes.transAxes + ScaledTranslation(0.0, -38.0 / 72.0, self.figure.dpi_scale_trans)
        options |= {"columnspacing": 1.0, "labelspacing": 0.4, "handlelength": 1.8, "fontsize": 6.5}
        return self.axes.legend(
            handles, labels, bbox_to_anchor=(0.0, 0.0), bbox_transform=below, ncols=min(3, len(labels)), **options
        )

    def finish(self, path: str | os.PathLike[str] | None, dpi: float) -> Any:
        """Writes the picture and returns the file; without a path returns the axes."""
        return self.axes if path is None else canvas.save(self.figure, Path(path), dpi)


def draw_length_bar(axes: Any, area: Bounds) -> None:
    """Draws a bar of 1, 2 or 5 times a power of ten metres, at most a fifth of the width, below the axes on the right."""
    from matplotlib.transforms import ScaledTranslation

    length = round_length((area.max_x - area.min_x) / 5.0)
    below = axes.get_xaxis_transform() + ScaledTranslation(0.0, -27.0 / 72.0, axes.figure.dpi_scale_trans)
    style: dict[str, Any] = {"transform": below, "clip_on": False}
    ends = [area.max_x - length, area.max_x]
    axes.plot(ends, [0.0, 0.0], color=colors.INK, lw=2.6, solid_capstyle="butt", zorder=12, **style)
    text = f"{length:g} m" if length >= 1.0 else f"{100.0 * length:g} cm"
    axes.text(ends[0], 0.0, f"{text}  ", ha="right", va="center_baseline", fontsize=8, **style)


def round_length(longest: float) -> float:
    """Returns the largest of 1, 2 and 5 times a power of ten that does not exceed `longest`."""
    power = 10.0 ** math.floor(math.log10(longest))
    return next(digit * power for digit in (5.0, 2.0, 1.0) if digit * power <= longest * (1.0 + 1e-12))
