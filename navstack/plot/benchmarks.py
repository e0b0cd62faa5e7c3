"""Pictures of benchmarks: BARN worlds, two parameter sets, controllers."""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from navstack.plot import canvas, colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
    ax: Axes | None = None,
    title: str,
    dpi: float = 130.0,
) -> Any:
    """Draw a bar per world with the shares of the outcomes, and the single run of C++ as a square above it.

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


def _draw_cpp_outcomes(axes: Axes, rows: Sequence[Row]) -> None:
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
    ax: Axes | None = None,
    title: str,
    dpi: float = 130.0,
) -> Any:
    """Draw the time of each world's successes against the time of the shortest path at 2 m/s, with lines of equal score.

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


def _draw_score_lines(axes: Axes, low: float, high: float) -> None:
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


# --- two parameter sets -----------------------------------------------------------------------------------------------


Times = Sequence[tuple[float | None, float | None]]
"""(time with A, time with B) of each pair (s); None for a failure."""


def plot_pairs(
    pairs: Times,
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    title: str,
    names: tuple[str, str],
    dpi: float = 130.0,
) -> Any:
    """Draw one point per pair: time with A on the x axis, time with B on the y axis, failures on the margins.

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
    """Wrap a label to at most three lines; a longer label loses its middle."""
    lines = textwrap.wrap(label, 58, break_long_words=True)
    return "\n".join(lines if len(lines) <= 3 else [*lines[:2], f".. {lines[-1]}"])


# --- controllers ------------------------------------------------------------------------------------------------------


"""A suite and a controller: suite, controller, and an `Interval` per measure."""


class _Panel(NamedTuple):
    key: str
    label: str
    log: bool = False


_PANELS: Final = (
    _Panel("success", "success (share)"),
    _Panel("time_s", "time (s)"),
    _Panel("clearance_min_m", "min. clearance (m)"),
    _Panel("jerk_rms_m_s3", "jerk (m/s³)"),
    _Panel("contacts_per_hour", "contacts per hour"),
    _Panel("cycle_p50_ms", "cycle (ms)", log=True),
)
_HOLLOW: Final = {"cycle_p50_ms": "cycle_p99_ms", "contacts_per_hour": "avoidable_per_hour"}
"""Drawn hollow in the panel of another measure."""
_MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X")


def plot_controllers(
    rows: Sequence[Row],
    path: str | os.PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    title: str,
    dpi: float = 130.0,
) -> Any:
    """Draw a column per suite and a row per measure; bars are 95 % intervals.

    Hollow: avoidable contacts, and the p99 of the cycle.

    Draws to a .png, .svg or .pdf, into the axes `ax` (divided), or a new figure. Raises OutputError. Returns the file;
    without a path the axes.
    """
    canvas.check_target(path, ax)
    suites = list(dict.fromkeys(str(row["suite"]) for row in rows))
    names = list(dict.fromkeys(str(row["controller"]) for row in rows))
    with canvas.style():
        whole = canvas.chart_axes(path, ax, 2.6 + 2.0 * len(suites), 0.8 + 1.15 * len(_PANELS))
        whole.set_title(title, pad=24.0)
        whole.axis("off")
        for i, panel in enumerate(_PANELS):
            for j, suite in enumerate(suites):
                width, height = 1.0 / len(suites), 1.0 / len(_PANELS)
                box = (j * width + 0.14 * width, 1.0 - (i + 0.9) * height, 0.84 * width, 0.78 * height)
                axes = whole.inset_axes(box)
                mine = {str(row["controller"]): row for row in rows if row["suite"] == suite}
                _draw_intervals(axes, panel, [mine.get(name) for name in names])
                if i == 0:
                    axes.set_title(suite, fontsize=9.5)
                if j == 0:
                    axes.set_ylabel(panel.label)
                    axes.yaxis.set_label_coords(-0.24, 0.5)
        for k, name in enumerate(names):
            whole.plot([], [], _MARKERS[k % 7], color=colors.PLANS[k % 7], label=name.replace("_", " "))
        whole.plot([], [], "o", mfc="none", color=colors.FAINT, label="avoidable contacts,\np99 of a cycle")
        whole.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        return canvas.finish(whole.figure, whole, path, dpi)


def _draw_intervals(axes: Axes, panel: _Panel, rows: Sequence[Row | None]) -> None:
    for k, row in enumerate(rows):
        interval = row.get(panel.key) if row is not None else None
        if row is None or interval is None or math.isnan(interval.value):
            continue
        color, marker = colors.PLANS[k % 7], _MARKERS[k % 7]
        low, high = (interval.value if math.isnan(v) else v for v in (interval.low, interval.high))
        axes.plot([k, k], [max(low, 0.0), high], color=color, lw=1.2)
        axes.plot([k], [interval.value], marker, color=color, ms=5.0, clip_on=False)
        hollow = row.get(_HOLLOW.get(panel.key, ""))
        if hollow is not None and not math.isnan(hollow.value):
            axes.plot([k], [hollow.value], marker, mfc="none", color=color, ms=5.0, clip_on=False)
    axes.set_xlim(-0.6, len(rows) - 0.4)
    axes.set_xticks([])
    axes.tick_params(labelsize=7.5)
    axes.grid(axis="y", color=colors.FAINT, alpha=0.25, lw=0.6)
    if panel.log:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        axes.set_ylim(0.7 * low, 1.4 * high)
        axes.yaxis.set_major_formatter(_plain)
        axes.yaxis.set_minor_formatter(_nothing)
    elif panel.key == "success":
        axes.set_ylim(-0.04, 1.04)
    else:
        axes.set_ylim(0.0, 1.08 * axes.get_ylim()[1])


def _plain(value: float, _: float) -> str:
    return f"{value:g}"


def _nothing(_: float, __: float) -> str:
    return ""
