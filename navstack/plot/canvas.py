"""Figures, style and files of all pictures.

Pictures use matplotlib's object API on the Agg canvas: no pyplot (0.5 s to import), no windows, no global state. The user's
matplotlibrc has no effect, and files contain no date and no version: equal input gives equal bytes.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from navstack.core.errors import InputError, OutputError
from navstack.core.files import atomic_write, ensure_directory
from navstack.plot import colors

FORMATS = (".png", ".svg", ".pdf")
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


def managed_figure(width_in: float, height_in: float, *, layout: Literal["constrained"] | None = None) -> Any:
    """Returns an empty figure of pyplot, which notebooks display and `matplotlib.pyplot.show` shows."""
    import matplotlib.pyplot as plt

    return plt.figure(figsize=(width_in, height_in), layout=layout)


def figure_for(
    path: str | os.PathLike[str] | None,
    width_in: float,
    height_in: float,
    *,
    layout: Literal["constrained"] | None = None,
) -> Any:
    """Returns an empty figure: of pyplot without a path, otherwise for a file."""
    new = managed_figure if path is None else new_figure
    return new(width_in, height_in, layout=layout)


def chart_axes(path: str | os.PathLike[str] | None, ax: Any, width_in: float, height_in: float) -> Any:
    """Returns the axes of a chart: `ax`, or those of a new figure."""
    if ax is not None:
        return ax
    return figure_for(path, width_in, height_in, layout="constrained").add_subplot()


def stacked_axes(ax: Any, heights: Sequence[float]) -> list[Any]:
    """Returns one axes per panel, from top to bottom: the given ones, or single axes divided in proportion to `heights`.

    Raises InputError for another number of axes.
    """
    given = [ax] if hasattr(ax, "inset_axes") else list(ax)
    if len(given) == len(heights):
        return given
    if len(given) != 1:
        raise InputError(
            f"the picture has {len(heights)} panels, but ax has {len(given)} axes; give one or {len(heights)}"
        )
    ax.set_axis_off()
    gap = 0.25 / len(heights)
    scale = (1.0 - gap * (len(heights) - 1)) / sum(heights)
    found: list[Any] = []
    top = 1.0
    for height in heights:
        found.append(ax.inset_axes((0.0, top - scale * height, 1.0, scale * height)))
        top -= scale * height + gap
    return found


def finish(figure: Any, axes: Any, path: str | os.PathLike[str] | None, dpi: float) -> Any:
    """Writes the figure and returns the file; without a path returns the axes."""
    return axes if path is None else save(figure, Path(path), dpi)


def check_target(path: str | os.PathLike[str] | None, ax: Any) -> None:
    """Raises OutputError for a suffix that is no format of pictures, InputError for a file and axes at once."""
    if path is not None:
        if ax is not None:
            raise InputError("give a file or axes (ax=), not both; save axes with ax.figure.savefig(..)")
        check_format(Path(path))
