"""The picture of a comparison of two parameter sets: the times of each pair of runs, and the failures."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from typing import Any

from navstack.plot import canvas, colors

Times = Sequence[tuple[float | None, float | None]]
"""(time with A, time with B) of each pair (s); None for a failure."""


def plot_pairs(
    pairs: Times,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str,
    names: tuple[str, str],
    dpi: float = 130.0,
) -> Any:
    """Draws one point per pair: time with A on the x axis, time with B on the y axis, failures on the margins.

    Draws to a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises OutputError. Returns the file; without a path
    the axes.
    """
    canvas.check_target(path, ax)
    with canvas.style():
        axes = canvas.chart_axes(path, ax, 6.4, 4.8)
        axes.set_title(title)
        known = [t for pair in pairs for t in pair if t is not None]
        top = 1.08 * max(known, default=1.0)
        edge = 1.04 * top
        axes.plot([0.0, top], [0.0, top], color=colors.FAINT, lw=0.9, ls=(0, (4, 2)), label="equal times")
        axes.axhspan(top, 1.08 * top, color=colors.FAINT, alpha=0.15, lw=0, label="failure")
        axes.axvspan(top, 1.08 * top, color=colors.FAINT, alpha=0.15, lw=0)
        for label, marker, color, mine in (
            ("both succeed", "o", colors.BLUE, [(a, b) for a, b in pairs if a is not None and b is not None]),
            ("A fails", "<", colors.ORANGE, [(edge, b) for a, b in pairs if a is None and b is not None]),
            ("B fails", "v", colors.VERMILLION, [(a, edge) for a, b in pairs if a is not None and b is None]),
            ("both fail", "x", colors.BLACK, [(edge, edge) for a, b in pairs if a is None and b is None]),
        ):
            if mine:
                xs, ys = zip(*mine, strict=True)
                axes.plot(xs, ys, marker, color=color, ms=5.5, ls="none", label=f"{label} ({len(mine)})")
        axes.set_xlim(0.0, 1.08 * top)
        axes.set_ylim(0.0, 1.08 * top)
        axes.set_aspect("equal", anchor="W")
        axes.set_xlabel(_wrapped(f"time with A, {names[0]} (s)"))
        axes.set_ylabel(_wrapped(f"time with B, {names[1]} (s)"))
        axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), borderaxespad=0.0)
        return canvas.finish(axes.figure, axes, path, dpi)


def _wrapped(label: str) -> str:
    """Wraps a label to at most three lines; a longer label loses its middle."""
    lines = textwrap.wrap(label, 58, break_long_words=True)
    return "\n".join(lines if len(lines) <= 3 else [*lines[:2], f".. {lines[-1]}"])
