"""Charts of comparisons: runs before and after, and the sensitivity to each parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from navstack.plot import canvas, colors
from navstack.tune.chart_canvas import DPI, new_figure
from navstack.tune.comparison import Comparison
from navstack.tune.sensitivity import Perturbation

MAX_RUNS: Final = 40
"""Number of runs drawn; of more, those with the greatest change."""
MAX_PERTURBATIONS: Final = 30


def before_after(
    comparison: Comparison, path: Path, *, title: str, names: tuple[str, str] = ("before", "after")
) -> Path:
    """A row per run with the times before and after, of localizers the errors; failures are at the right edge."""
    rows = _rows_to_draw(comparison)
    left_out = len(comparison.cases) - len(rows)
    key, label = _measured(comparison)
    times = [o.get(key, 0.0) for i in rows for o in (comparison.before[i], comparison.after[i]) if o["success"]]
    edge = 1.12 * max(times, default=1.0)
    with canvas.style():
        figure = new_figure(8.0, 1.5 + 0.22 * len(rows), title=title)
        axes: Any = figure.add_subplot()
        for y, i in enumerate(rows):
            _draw_pair(axes, y, comparison.before[i], comparison.after[i], key, edge)
        axes.axvline(edge, color=colors.FAINT, lw=0.8, ls=(0, (2, 2)))
        axes.set_yticks(range(len(rows)), [comparison.cases[i].key.removesuffix(" seed 0") for i in rows], fontsize=7)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlim(0.0, edge * 1.06)
        note = f"; {left_out} runs with smaller changes are not shown" if left_out else ""
        axes.set_xlabel(f"{label}; hollow marks on the dashed line: no success{note}", fontsize=8)
        for marker, color, name in (("o", colors.ORANGE, names[0]), ("D", colors.BLUE, names[1])):
            axes.plot([], [], marker, color=color, label=name, ls="none")
        figure.legend(loc="outside lower right", ncols=2, fontsize=8)
        return canvas.save(figure, path, DPI)


def _measured(comparison: Comparison) -> tuple[str, str]:
    """Key and label of what is drawn of a run."""
    outcomes = (*comparison.before, *comparison.after)
    return ("error_m", "position error (m)") if any("error_m" in o for o in outcomes) else ("time_s", "time (s)")


def _rows_to_draw(comparison: Comparison) -> list[int]:
    """Indices of the runs with the greatest change, in order."""

    def change(i: int) -> float:
        before, after = comparison.before[i], comparison.after[i]
        if before["success"] != after["success"]:
            return math.inf
        return abs(after["score"] - before["score"])

    rows = range(len(comparison.cases))
    return sorted(sorted(rows, key=lambda i: -change(i))[:MAX_RUNS])


def _draw_pair(axes: Any, y: int, before: Any, after: Any, key: str, edge: float) -> None:
    xb, xa = (o.get(key, 0.0) if o["success"] else edge for o in (before, after))
    axes.plot([xb, xa], [y, y], color=colors.FAINT, lw=1.2, zorder=1)
    for x, o, color, marker in ((xb, before, colors.ORANGE, "o"), (xa, after, colors.BLUE, "D")):
        axes.plot([x], [y], marker, ms=6, color=color if o["success"] else "white", mec=color, mew=1.6, zorder=2)


def sensitivities(found: Sequence[Perturbation], path: Path) -> Path:
    """The difference in the score for each change, with its confidence interval; the greatest on top."""
    shown = list(found)[:MAX_PERTURBATIONS]
    with canvas.style():
        figure = new_figure(8.0, 1.4 + 0.26 * len(shown), title="Effect of halving or doubling one parameter")
        axes: Any = figure.add_subplot()
        axes.axvline(0.0, color=colors.INK, lw=1.0)
        for y, one in enumerate(shown):
            difference = one.comparison.measure("score").difference
            i = difference.interval
            color = colors.FAINT
            if difference.shown:
                color = colors.BLUE if i.value > 0.0 else colors.VERMILLION
            if math.isfinite(i.low):
                axes.plot([i.low, i.high], [y, y], color=color, lw=2.0)
            axes.plot([i.value], [y], "o", color=color, ms=5)
        axes.set_yticks(range(len(shown)), [f"{one.dimension.name} {one.what}" for one in shown], fontsize=7)
        axes.set_ylim(len(shown) - 0.4, -0.6)
        for color, name in (
            (colors.BLUE, "better"),
            (colors.VERMILLION, "worse"),
            (colors.FAINT, "no difference shown"),
        ):
            axes.plot([], [], "-o", color=color, ms=5, lw=2.0, label=name)
        axes.set_xlabel("difference in the score, 95 % confidence interval", fontsize=8)
        figure.legend(loc="outside lower right", ncols=3, fontsize=8)
        return canvas.save(figure, path, DPI)
