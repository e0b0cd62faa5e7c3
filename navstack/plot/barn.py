"""Pictures of BARN: the outcomes in each world, and the times against the optimum."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from navstack.plot import canvas, colors

Row = Mapping[str, Any]
"""A world: world, optimal_time_s, runs, success, collision, other, time_s; if C++ is known, cpp_outcome and cpp_time_s."""

_OUTCOMES = (
    ("success", "success", colors.BLUE),
    ("collision", "collision", colors.VERMILLION),
    ("other", "timeout or aborted", colors.ORANGE),
)
_SCORE_LINES = ((2.0, "0.5"), (4.0, "0.25"), (8.0, "0.125, the minimum of a success"))
"""Multiples of the optimal time, and the score of a run that takes so long."""


def plot_success(
    rows: Sequence[Row],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str,
    dpi: float = 130.0,
) -> Any:
    """Draws a bar per world with the shares of the outcomes, and the single run of C++ as a square above it.

    Draws to a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises OutputError. Returns the file; without a path
    the axes.
    """
    canvas.check_target(path, ax)
    with canvas.style():
        axes = canvas.chart_axes(path, ax, max(6.0, 2.6 + 0.19 * len(rows)), 3.6)
        axes.set_title(title)
        at = list(range(len(rows)))
        below = [0.0] * len(rows)
        for key, label, color in _OUTCOMES:
            shares = [row[key] / row["runs"] for row in rows]
            # an empty label has no entry in the legend
            axes.bar(at, shares, bottom=below, color=color, width=0.8, label=label if any(shares) else "")
            below = [b + s for b, s in zip(below, shares, strict=True)]
        if any("cpp_outcome" in row for row in rows):
            _draw_cpp_outcomes(axes, rows)
        axes.set_xticks(at, [str(row["world"]) for row in rows], rotation=90, fontsize=7)
        axes.set_xlim(-0.7, len(rows) - 0.3)
        axes.set_ylim(0.0, 1.18)
        axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0])
        axes.set_xlabel("world")
        axes.set_ylabel("share of runs")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
        return canvas.finish(axes.figure, axes, path, dpi)


def _draw_cpp_outcomes(axes: Any, rows: Sequence[Row]) -> None:
    for key, label, color in _OUTCOMES:
        worlds = [i for i, row in enumerate(rows) if _cpp_outcome(row) == key]
        axes.plot(worlds, [1.08] * len(worlds), "s", ms=5.0, color=color, mec=colors.INK, mew=0.5)
        if worlds:
            axes.plot([], [], "s", ms=5.0, color=color, mec=colors.INK, mew=0.5, label=f"C++: {label}")


def _cpp_outcome(row: Row) -> str | None:
    outcome = row.get("cpp_outcome")
    return outcome if outcome in (None, "success", "collision") else "other"


def plot_times(
    rows: Sequence[Row],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Any = None,
    title: str,
    dpi: float = 130.0,
) -> Any:
    """Draws the time of each world's successes against the time of the shortest path at 2 m/s, with lines of equal score.

    Draws to a .png, .svg or .pdf, into the axes `ax`, or a new figure. Raises OutputError. Returns the file; without a path
    the axes.
    """
    canvas.check_target(path, ax)
    with canvas.style():
        axes = canvas.chart_axes(path, ax, 7.6, 4.4)
        axes.set_title(title)
        optimal = [row["optimal_time_s"] for row in rows]
        low, high = min(optimal) - 0.1, max(optimal) + 0.1
        _draw_score_lines(axes, low, high)
        cpp = [row for row in rows if row.get("cpp_time_s") is not None]
        if cpp:
            hollow = {"ms": 6.0, "mfc": "none", "mec": colors.ORANGE, "mew": 1.3}
            times = [row["cpp_time_s"] for row in cpp]
            axes.plot([row["optimal_time_s"] for row in cpp], times, "o", label="C++, one run", **hollow)
        won = [row for row in rows if row["success"] > 0]
        if won:
            times = [row["time_s"] for row in won]
            blue = {"ms": 4.0, "color": colors.BLUE, "label": "navstack, mean"}
            axes.plot([row["optimal_time_s"] for row in won], times, "o", **blue)
        axes.set_xlim(low, high)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("time of the shortest path at 2 m/s (s)")
        axes.set_ylabel("time of the successes (s)")
        if cpp or won:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
        return canvas.finish(axes.figure, axes, path, dpi)


def _draw_score_lines(axes: Any, low: float, high: float) -> None:
    for factor, score in _SCORE_LINES:
        axes.plot([low, high], [factor * low, factor * high], color=colors.FAINT, lw=0.8, ls=(0, (4, 2)), zorder=1)
        axes.annotate(
            f"score {score}",
            (high, factor * high),
            xytext=(0.0, 3.0),
            textcoords="offset points",
            color=colors.FAINT,
            fontsize=7.5,
            ha="right",
        )
