"""The picture of a comparison of controllers: a panel per measure and suite, an interval per controller."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from navstack.plot import canvas, colors

Row = Mapping[str, Any]
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
    ax: Any = None,
    title: str,
    dpi: float = 130.0,
) -> Any:
    """Draws a column per suite and a row per measure; bars are 95 % intervals.

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
                _draw(axes, panel, [mine.get(name) for name in names])
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


def _draw(axes: Any, panel: _Panel, rows: Sequence[Row | None]) -> None:
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


def _plain(value: float, _: int) -> str:
    return f"{value:g}"


def _nothing(_: float, __: int) -> str:
    return ""
