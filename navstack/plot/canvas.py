"""Figures, style and files of all pictures.

Pictures use matplotlib's object API on the Agg canvas: no pyplot (0.5 s to import), no windows, no global state. The user's
matplotlibrc has no effect, and files contain no date and no version: equal input gives equal bytes.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, OutputError, atomic_write, ensure_directory
from navstack.plot import colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMATS = (".png", ".svg", ".pdf")
GRID = "#E3E3E3"
"""Color of grid lines."""
SUBTITLE = "#666666"
"""Color of the line below a title."""
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

PAPER_WIDTH_IN: Final = 3.5
"""Width of a picture in the style of a paper: a column of two (89 mm)."""
PAPER_SCALE: Final = 0.65
"""Width of lines and size of marks in that style, relative to those on a screen."""
_PAPER_BOTTOM_IN: Final = 0.36
_PAPER_HEIGHT: Final = 0.55
"""Height of a panel, relative to that on a screen."""
_PAPER_DPI: Final = 300.0
"""Least resolution of what is not a vector: maps, and pictures as .png."""
_PAPER_POINTS: Final = 6.5
"""Size of the numbers of the axes and of the legend in that style."""
_LEAST_POINTS: Final = 5.0
"""Least size of the texts on the picture, which are as much smaller as marks."""
_PAPER: Final[dict[str, Any]] = {
    "font.size": 7.0,
    "axes.linewidth": 0.6,
    "axes.labelpad": 2.0,
    "xtick.labelsize": _PAPER_POINTS,
    "ytick.labelsize": _PAPER_POINTS,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "legend.fontsize": _PAPER_POINTS,
    "legend.handlelength": 1.6,
    "pdf.fonttype": 42,  # publishers refuse the default, Type 3
    "hatch.linewidth": 0.5,
}
_IS_PAPER: Final[ContextVar[bool]] = ContextVar("paper", default=False)


@contextmanager
def paper_style() -> Generator[None]:
    """Draw pictures for print inside this context: one column wide, white, small sans-serif text, thin lines, no title.

    The caption of a figure says what its title says on a screen. Write .pdf or .svg: text and lines stay vectors.
    """
    token = _IS_PAPER.set(True)
    try:
        yield
    finally:
        _IS_PAPER.reset(token)


def is_paper() -> bool:
    """Return True inside `paper_style`."""
    return _IS_PAPER.get()


def line_scale() -> float:
    """Return by how much lines are thinner than on a screen."""
    return PAPER_SCALE if is_paper() else 1.0


def _thin(figure: Any) -> None:
    """Scale the lines, marks and text of a figure for print."""
    from matplotlib.axis import Axis
    from matplotlib.legend import Legend
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    # the axes have their own settings in the style
    kept = {part for axis in figure.findobj(Axis) for part in axis.findobj()}
    for line in figure.findobj(Line2D):
        if line not in kept:
            line.set_linewidth(PAPER_SCALE * line.get_linewidth())
            line.set_markersize(PAPER_SCALE * line.get_markersize())
            line.set_markeredgewidth(PAPER_SCALE * line.get_markeredgewidth())
    for patch in figure.findobj(Patch):
        patch.set_linewidth(PAPER_SCALE * patch.get_linewidth())
    kept |= {part for legend in figure.findobj(Legend) for part in legend.findobj(Text)}
    for text in figure.findobj(Text):
        if text not in kept:
            text.set_fontsize(max(_LEAST_POINTS, PAPER_SCALE * text.get_fontsize()))


@contextmanager
def style() -> Generator[None]:
    """Apply matplotlib's defaults and the style of this package; everything is drawn inside this context."""
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
        if is_paper():
            settings.update(_PAPER)
        yield


def check_format(path: Path, formats: Sequence[str] = FORMATS) -> None:
    """Raise OutputError unless the suffix of `path` is one of `formats`."""
    if path.suffix.lower() not in formats:
        known = ", ".join(formats)
        raise OutputError(f"cannot write {path.name}: the suffix must be one of {known}", path=str(path))


def save(figure: Any, path: Path, dpi: float) -> Path:
    """Write the figure atomically, in the format of the suffix. Equal figures give equal bytes."""
    suffix = path.suffix.lower()
    metadata: dict[str, Any] = {
        ".png": {"Software": None},
        ".svg": {"Date": None, "Creator": None},
        ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }[suffix]
    if is_paper():
        _thin(figure)
        dpi = max(dpi, _PAPER_DPI)
    ensure_directory(path.parent)
    with atomic_write(path) as beside:
        figure.savefig(beside, dpi=dpi, format=suffix[1:], metadata=metadata)
    return path


def new_figure(width_in: float, height_in: float, *, layout: Literal["constrained"] | None = None) -> Any:
    """Return an empty figure on an Agg canvas."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def managed_figure(width_in: float, height_in: float, *, layout: Literal["constrained"] | None = None) -> Any:
    """Return an empty figure of pyplot, which notebooks display and `matplotlib.pyplot.show` shows."""
    import matplotlib.pyplot as plt

    return plt.figure(figsize=(width_in, height_in), layout=layout)


def figure_for(
    path: str | os.PathLike[str] | None,
    width_in: float,
    height_in: float,
    *,
    layout: Literal["constrained"] | None = None,
) -> Any:
    """Return an empty figure: of pyplot without a path, otherwise for a file."""
    new = managed_figure if path is None else new_figure
    return new(width_in, height_in, layout=layout)


def chart_axes(path: str | os.PathLike[str] | None, ax: Axes | None, width_in: float, height_in: float) -> Any:
    """Return the axes of a chart: `ax`, or those of a new figure."""
    if ax is not None:
        return ax
    return figure_for(path, width_in, height_in, layout="constrained").add_subplot()


def stacked_axes(ax: Axes | Sequence[Axes], heights: Sequence[float]) -> list[Axes]:
    """Return one axes per panel, from top to bottom: the given ones, or single axes divided in proportion to `heights`.

    Raises InputError for another number of axes.
    """
    given = list(ax) if isinstance(ax, Iterable) else [ax]
    if len(given) == len(heights):
        return given
    if len(given) != 1:
        raise InputError(
            f"the picture has {len(heights)} panels, but ax has {len(given)} axes; give one or {len(heights)}"
        )
    outer = given[0]
    outer.set_axis_off()
    gap = 0.25 / len(heights)
    scale = (1.0 - gap * (len(heights) - 1)) / sum(heights)
    found: list[Axes] = []
    top = 1.0
    for height in heights:
        found.append(outer.inset_axes((0.0, top - scale * height, 1.0, scale * height)))
        top -= scale * height + gap
    return found


class Panels:
    """Panels one above the other, in a figure of their own or in axes of the caller: a title above, the legend at the right."""

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        ax: Axes | Sequence[Axes] | None,
        places: Sequence[tuple[float, float]],
        *,
        title: str,
        subtitle: str = "",
        size: tuple[float, float] = (10.0, 5.6),
        left: float = 0.72,
        right: float = 7.6,
    ) -> None:
        """`places`: bottom and height of each panel, from top to bottom; these, `size`, `left` and `right` in inches.

        `ax`: the axes of the caller, one or as many as there are panels; None: a new figure of `size`. Raises InputError for
        another number of axes.
        """
        self._path = path
        self._given = ax is not None
        if is_paper() and ax is None:
            # in a column: lower panels; the legend comes below them
            places = [
                (_PAPER_BOTTOM_IN + (bottom - places[-1][0]) * _PAPER_HEIGHT, h * _PAPER_HEIGHT) for bottom, h in places
            ]
            size = (PAPER_WIDTH_IN, places[0][0] + places[0][1] + 0.08)
            left, right, title, subtitle = 0.5, PAPER_WIDTH_IN - 0.08, "", ""
        self.right = right / size[0]
        """Right edge of the panels, as a share of the figure's width."""
        if ax is not None:
            self.axes = stacked_axes(ax, [height for _, height in places])
            self.axes[0].set_title("\n".join(part for part in (title, subtitle) if part), fontsize=9.0)
            self.figure: Any = self.axes[0].figure
            return
        self.figure = figure_for(path, *size)
        write_title(self.figure, left / size[0], title, subtitle)
        self.axes = [
            self.figure.add_axes((left / size[0], bottom / size[1], (right - left) / size[0], height / size[1]))
            for bottom, height in places
        ]

    @property
    def is_own(self) -> bool:
        """Whether the figure was made for these panels."""
        return not self._given

    def set_times(self, begin: float, end: float, label: str = "time (s)") -> None:
        """Give all panels the same time axis."""
        for axes in self.axes:
            axes.set_xlim(begin, end)
            axes.grid(axis="x", color=GRID, lw=0.6)
            axes.set_axisbelow(True)
        self.axes[-1].set_xlabel(label)

    def legend(self, panel: int = 0) -> None:
        """Add one legend for all panels: the entries of a panel, at the right of the panels or inside that panel."""
        if self._given:
            self.axes[panel].legend(fontsize=7, loc="upper right")
            return
        handles, labels = self.axes[panel].get_legend_handles_labels()
        if is_paper():
            self._legend_below(handles, labels)
            return
        self.figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(self.right + 0.012, 0.87), fontsize=8)

    def _legend_below(self, handles: Sequence[Any], labels: Sequence[str]) -> None:
        """Add a legend below the panels and grow the figure by its height."""
        legend = self.figure.legend(handles, labels, loc="lower center", ncols=2, borderaxespad=0.1)
        taller = legend.get_window_extent(self.figure.canvas.get_renderer()).height / self.figure.dpi + 0.06
        width, height = self.figure.get_size_inches()
        self.figure.set_size_inches(width, height + taller)
        for axes in self.axes:
            box = axes.get_position()
            bottom, high = (box.y0 * height + taller) / (height + taller), box.height * height / (height + taller)
            axes.set_position((box.x0, bottom, box.width, high))

    def finish(self, dpi: float) -> Any:
        """Write the figure and return the file; without a path return the axes."""
        return finish(self.figure, self.axes, self._path, dpi)


def write_title(figure: Any, left: float, title: str, subtitle: str = "") -> None:
    """Write a title and a line below it at the top of a figure, from `left` (share of the width)."""
    height = figure.get_figheight()
    figure.text(left, 1.0 - 0.3 / height, title, fontsize=12, fontweight="bold", va="baseline")
    figure.text(left, 1.0 - 0.53 / height, subtitle, fontsize=8.5, color=SUBTITLE, va="baseline")


def shade(
    axes: Axes, times: NDArray[np.float64], chosen: NDArray[np.bool_], color: str, *, alpha: float, label: str
) -> None:
    """Shade the times (n,) of the `chosen` samples, each up to the next sample; the legend has one entry for them."""
    ends = np.append(times[1:], times[-1] + 0.05)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], chosen.astype(np.int8), [0]))))
    for i, (begin, end) in enumerate(edges.reshape(-1, 2).tolist()):
        axes.axvspan(times[begin], ends[end - 1], color=color, alpha=alpha, lw=0, zorder=0, label=None if i else label)


def finish(figure: Any, axes: Axes | Sequence[Axes], path: str | os.PathLike[str] | None, dpi: float) -> Any:
    """Write the figure and return the file; without a path return the axes."""
    return axes if path is None else save(figure, Path(path), dpi)


def check_target(path: str | os.PathLike[str] | None, ax: object) -> None:
    """Raise OutputError for a suffix that is no format of pictures, InputError for a file and axes at once."""
    if path is not None:
        if ax is not None:
            raise InputError("give a file or axes (ax=), not both; save axes with ax.figure.savefig(..)")
        check_format(Path(path))
