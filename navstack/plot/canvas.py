"""Figures, style and files of all pictures.

Pictures use matplotlib's object API on the Agg canvas: no pyplot (0.5 s to import), no windows, no global state. The user's
matplotlibrc has no effect, and files contain no date and no version: equal input gives equal bytes.
"""

from __future__ import annotations

import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from navstack.core import Bounds
from navstack.core.errors import OutputError
from navstack.core.files import atomic_write, ensure_directory
from navstack.plot import colors
from navstack.plot.areas import shaped
from navstack.plot.legend import handlers

FORMATS = (".png", ".svg", ".pdf")
_TALLEST_IN = 6.6
"""Largest height of the axes of a picture."""

_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": colors.INK,
    "axes.edgecolor": colors.FAINT,
    "axes.linewidth": 0.8,
    "xtick.color": colors.FAINT,
    "ytick.color": colors.FAINT,
    "xtick.labelcolor": colors.INK,
    "ytick.labelcolor": colors.INK,
    "text.color": colors.INK,
    "text.parse_math": False,  # the name of a map can contain "$"
    "axes.formatter.useoffset": False,  # 4500012 m instead of 12 m and an offset of +4.5e6
    "axes.formatter.limits": (-9, 9),
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.hashsalt": "navstack",
    "path.simplify_threshold": 0.2,
}


@contextmanager
def style() -> Generator[None]:
    """Applies matplotlib's defaults and the style of this package; everything is drawn inside this context."""
    import matplotlib as mpl

    untouched = {"backend", "backend_fallback", "interactive", "toolbar", "webagg.address"}
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        # assigning to the dictionary skips the validation of 300 defaults, which takes longer than the picture
        settings: Any = mpl.rcParams
        for key in mpl.rcParamsDefault:
            if key not in untouched:
                dict.__setitem__(settings, key, dict.__getitem__(mpl.rcParamsDefault, key))
        settings.update(_STYLE)
        yield


def check_format(path: Path, formats: Sequence[str] = FORMATS) -> None:
    """Raises OutputError unless the suffix of `path` is one of `formats`."""
    if path.suffix.lower() not in formats:
        known = ", ".join(formats)
        raise OutputError(f"cannot write {path.name}: the suffix must be one of {known}", path=str(path))


def save(figure: Any, path: Path, dpi: float) -> Path:
    """Writes the figure atomically, in the format of the suffix. Equal figures give equal bytes."""
    suffix = path.suffix.lower()
    metadata: dict[str, Any] = {
        ".png": {"Software": None},
        ".svg": {"Date": None, "Creator": None},
        ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }[suffix]
    ensure_directory(path.parent)
    with atomic_write(path) as beside:
        figure.savefig(beside, dpi=dpi, format=suffix[1:], metadata=metadata)
    return path


def new_figure(width_in: float, height_in: float, *, layout: Literal["constrained"] | None = None) -> Any:
    """Returns an empty figure on an Agg canvas."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=layout)
    FigureCanvasAgg(figure)
    return figure


@dataclass(frozen=True, slots=True)
class _Frame:
    """Axes and margins of a picture, in inches."""

    left: float
    right: float
    """Margin right of the axes, with the legend."""
    bottom: float
    top: float
    width: float
    """Width of the axes."""
    height: float

    @classmethod
    def around(cls, area: Bounds, width_in: float, legend_in: float, *, above: float) -> _Frame:
        left, right, bottom = 0.62, 0.18, 0.55
        width = width_in - left - right - legend_in
        height = width * (area.max_y - area.min_y) / (area.max_x - area.min_x)
        if height > _TALLEST_IN:
            width, height = width * _TALLEST_IN / height, _TALLEST_IN
        return cls(left, right + legend_in, bottom, above, width, height)

    @property
    def size(self) -> tuple[float, float]:
        return self.left + self.width + self.right, self.bottom + self.height + self.top

    @property
    def axes_box(self) -> tuple[float, float, float, float]:
        """Left, bottom, width and height of the axes as shares of the figure."""
        w, h = self.size
        return self.left / w, self.bottom / h, self.width / w, self.height / h


class Picture:
    """A figure with axes in metres, a title above them and room for a legend on the right."""

    def __init__(
        self, area: Bounds, *, title: str, subtitle: str = "", width_in: float = 9.2, legend_in: float = 2.35
    ) -> None:
        # a file name that is not UTF-8 contains lone surrogates, which no font has
        title, subtitle = (text.encode("utf-8", "replace").decode() for text in (title, subtitle))
        self.area = shaped(area, least=0.0)
        frame = _Frame.around(self.area, width_in, legend_in, above=0.72 if subtitle else 0.5)
        self.figure = new_figure(*frame.size)
        self.canvas: Any = self.figure.canvas
        self.axes = self.figure.add_axes(frame.axes_box, facecolor="#F4F4F4")
        self._set_up_axes()
        frame = self._make_room_for_labels(frame)
        self.points_per_m = 72.0 * min(
            frame.width / (self.area.max_x - self.area.min_x), frame.height / (self.area.max_y - self.area.min_y)
        )
        """Scale of the axes, in points (1/72 inch) per metre."""
        width, height = frame.size
        self._legend_at = ((frame.left + frame.width + 0.12) / width, (frame.bottom + frame.height) / height)
        x, y = frame.left / width, (frame.bottom + frame.height) / height
        self.subtitle = self.figure.text(x, y + 0.12 / height, subtitle, fontsize=8.5, color="#666666", va="baseline")
        offset = 0.36 if subtitle else 0.16
        self.figure.text(x, y + offset / height, title, fontsize=12, fontweight="bold", va="baseline")

    def _set_up_axes(self) -> None:
        self.axes.set_aspect("equal", adjustable="box", anchor="NW")
        self.axes.set_xlim(self.area.min_x, self.area.max_x)
        self.axes.set_ylim(self.area.min_y, self.area.max_y)
        self.axes.set_xlabel("x (m)")
        self.axes.set_ylabel("y (m)")

    def _make_room_for_labels(self, frame: _Frame) -> _Frame:
        """Widens the figure if long tick labels ("-1234.5") push the y label out of it."""
        labels = self.axes.yaxis.get_tightbbox(self.canvas.get_renderer())
        missing = 0.05 - labels.x0 / self.figure.dpi if labels is not None else 0.0
        if missing <= 0.0:
            return frame
        frame = replace(frame, left=frame.left + missing)
        self.figure.set_size_inches(*frame.size)
        self.axes.set_position(frame.axes_box)
        return frame

    def legend(self, handles: Sequence[Any], labels: Sequence[str], **options: Any) -> Any:
        """Adds the legend on the right of the axes and returns it."""
        return self.figure.legend(
            handles,
            labels,
            loc="upper left",
            bbox_to_anchor=self._legend_at,
            borderaxespad=0.0,
            handlelength=2.2,
            labelspacing=0.75,
            handler_map=handlers(),
            **options,
        )
