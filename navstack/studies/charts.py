"""Charts of tuning: the trials of a study, and comparisons of runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TypeGuard

from navstack.plot import canvas, colors
from navstack.studies.comparison import Comparison
from navstack.studies.problem import NO_SUCCESS, OBJECTIVES, Objective, Trial, dominates, success_rate
from navstack.studies.search_space import Dimension
from navstack.studies.sensitivity import Perturbation
from navstack.studies.tuning import TuningResult

# --- figures ----------------------------------------------------------------------------------------------------------


DPI: Final = 110.0
DASHED: Final = (0, (4, 2))


def new_figure(width: float, height: float, *, title: str) -> Any:
    """Return an empty figure (inches) with a title at the top left."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left")
    return figure


_COMPLETE, _PRUNED = "complete", "pruned (mean of its runs)"
_TOLERANCE: Final = 1e-9
_MAX_COLUMNS: Final = 3


def history(tuning: TuningResult, path: Path) -> Path:
    """Return the first objective of every trial, the best so far, and the current parameters."""
    objective = tuning.problem.objectives[0]
    with canvas.style():
        figure = new_figure(8.0, 3.8, title="Trials")
        axes: Any = figure.add_subplot()
        # trials without any success would compress the scale
        shown = [t for t in tuning.trials if t.values[0] < NO_SUCCESS]
        left_out = len(tuning.trials) - len(shown)
        present = {"color": colors.INK, "lw": 1.2, "ls": DASHED}
        before = objective.of(list(tuning.training.before))
        if before < NO_SUCCESS:
            axes.axhline(before, label="current parameters", **present)
        else:
            axes.plot([], [], label="current parameters: no success", **present)
        complete = [t for t in shown if t.complete]
        pruned = [t for t in shown if not t.complete]
        if pruned:
            axes.plot(*_points(pruned), "x", color=colors.FAINT, ms=5, label=_PRUNED)
        axes.plot(*_points(complete), "o", color=colors.BLUE, ms=5, label=_COMPLETE)
        best = _best_so_far(complete, objective)
        if best:
            numbers = [t.number for t in complete]
            axes.step(numbers, best, where="post", color=colors.VERMILLION, lw=1.6, label="best so far")
        axes.set_xlabel("trial" + (f" ({left_out} without success not shown)" if left_out else ""))
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_ylabel(f"{objective.label} in training")
        axes.legend(loc="best", fontsize=8)
        return canvas.save(figure, path, DPI)


def _points(trials: Sequence[Trial]) -> tuple[list[int], list[float]]:
    return [t.number for t in trials], [t.values[0] for t in trials]


def _best_so_far(trials: Sequence[Trial], objective: Objective) -> list[float]:
    best: list[float] = []
    for t in trials:
        best.append(t.values[0] if not best or objective.better(t.values[0], best[-1]) else best[-1])
    return best


def importance(tuning: TuningResult, path: Path) -> Path:
    """Return a bar per parameter."""
    items = list(tuning.importance.items())
    with canvas.style():
        figure = new_figure(8.0, 1.3 + 0.28 * len(items), title="Importance of the parameters")
        axes: Any = figure.add_subplot()
        y = range(len(items))
        axes.barh(y, [v for _, v in items], color=colors.BLUE, height=0.62)
        axes.set_yticks(y, [name for name, _ in items], fontsize=8)
        axes.invert_yaxis()
        for i, (_, v) in enumerate(items):
            axes.text(v, i, f" {v:.0%}", va="center", fontsize=7, color=colors.INK)
        axes.set_xlabel("share of the difference between the best trials and the others (PED-ANOVA)")
        axes.set_xlim(0.0, 1.12 * max([v for _, v in items], default=1.0))
        return canvas.save(figure, path, DPI)


# --- slices -----------------------------------------------------------------------------------------------------------


def slices(tuning: TuningResult, path: Path, names: Sequence[str]) -> Path:
    """Return the first objective against each of these parameters, with the current and the tuned value."""
    objective = tuning.problem.objectives[0]
    dimensions = {d.name: d for d in tuning.problem.space}
    columns = min(_MAX_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    with canvas.style():
        figure = new_figure(3.1 * columns, 2.6 * rows + 0.8, title="Values of the most important parameters")
        for i, name in enumerate(names):
            axes: Any = figure.add_subplot(rows, columns, i + 1)
            _draw_slice(axes, tuning, dimensions[name])
            axes.set_xlabel(_axis_label(dimensions[name], names), fontsize=8)
            if i % columns == 0:
                axes.set_ylabel(objective.label, fontsize=8)
        first = figure.axes[0]
        shown = [t for t in tuning.trials if t.values[0] < NO_SUCCESS]
        if any(t.complete for t in shown):
            first.plot([], [], "o", color=colors.BLUE, ms=4, label=_COMPLETE)
        if not all(t.complete for t in shown):
            first.plot([], [], "x", color=colors.FAINT, ms=4, label="pruned")
        if any(_is_number(dimensions[name].present) for name in names):
            first.plot([], [], color=colors.ORANGE, lw=1.4, ls=DASHED, label="before")
        if any(_is_number(tuning.candidate.get(name)) for name in names):
            first.plot([], [], color=colors.VERMILLION, lw=1.4, label="tuned")
        figure.legend(loc="outside lower center", fontsize=8, ncols=4)
        return canvas.save(figure, path, DPI)


def _draw_slice(axes: Any, tuning: TuningResult, d: Dimension) -> None:
    for complete, color, marker in ((False, colors.FAINT, "x"), (True, colors.BLUE, "o")):
        some = [t for t in tuning.trials if t.complete is complete and t.values[0] < NO_SUCCESS]
        values = [t.candidate[d.name] for t in some]
        x = [str(v) if isinstance(v, (bool, str)) else float(v) for v in values]
        axes.plot(x, [t.values[0] for t in some], marker, color=color, ms=4)
    if d.log and d.kind != "choice":
        axes.set_xscale("log")
        # the default labels of a log scale need mathtext, which the style disables
        axes.xaxis.set_major_formatter(_plain_number)
        axes.xaxis.set_minor_formatter("")
    if _is_number(d.present):
        axes.axvline(float(d.present), color=colors.ORANGE, lw=1.4, ls=DASHED)
    tuned = tuning.candidate.get(d.name)
    if _is_number(tuned):
        axes.axvline(float(tuned), color=colors.VERMILLION, lw=1.4)
    axes.tick_params(labelsize=7)


def _is_number(value: Any) -> TypeGuard[float]:
    return value is not None and not isinstance(value, str)


def _axis_label(d: Dimension, names: Sequence[str]) -> str:
    """Return the last part of the name, or the whole name if another parameter has the same last part."""
    last = d.name.rpartition("/")[2]
    shown = last if sum(name.rpartition("/")[2] == last for name in names) == 1 else d.name
    return f"{shown} ({d.unit})" if d.unit else shown


def _plain_number(value: float, position: int) -> str:
    del position
    return f"{value:g}"


# --- Pareto front -----------------------------------------------------------------------------------------------------


def pareto(tuning: TuningResult, path: Path) -> Path:
    """Complete trials by two objectives (by default, time and clearance), with the Pareto front."""
    searched = tuning.problem.objectives
    two = tuple(searched[:2]) if len(searched) > 1 else (OBJECTIVES["time"], OBJECTIVES["clearance"])
    with canvas.style():
        figure = new_figure(6.6, 4.4, title=f"{two[0].name.capitalize()} against {two[1].name}")
        axes: Any = figure.add_subplot()
        shown = _draw_trials(axes, tuning, two)
        if tuning.found:
            shown.append(tuple(o.of(list(tuning.training.after)) for o in two))
            axes.plot(
                *([v] for v in shown[-1]), "*", color=colors.VERMILLION, ms=12, mec="white", mew=0.8, label="tuned"
            )
        limits = _draw_before(axes, tuning, two, shown)
        axes.set_xlim(*limits[0])
        axes.set_ylim(*limits[1])
        for set_label, o in ((axes.set_xlabel, two[0]), (axes.set_ylabel, two[1])):
            set_label(f"{o.meaning}{f' ({o.unit})' if o.unit else ''}", fontsize=8)
        axes.legend(fontsize=7, loc="best")
        return canvas.save(figure, path, DPI)


def _draw_trials(axes: Any, tuning: TuningResult, two: Sequence[Objective]) -> list[tuple[float, ...]]:
    """Draw the complete trials; the points of those with the highest success rate."""
    complete = [list(t.outcomes.values()) for t in tuning.trials if t.complete]
    points = [tuple(o.of(outcomes) for o in two) for outcomes in complete]
    rates = [success_rate(outcomes) for outcomes in complete]
    highest = max(rates, default=0.0)
    several = len(tuning.problem.objectives) > 1
    if several:  # the front of the study has all trials with the required success rate
        highest = min(highest, tuning.problem.min_success)
    good = [p for p, rate in zip(points, rates) if rate >= highest - _TOLERANCE]
    others = [p for p, rate in zip(points, rates) if rate < highest - _TOLERANCE]
    front = sorted({p for p in good if not any(dominates(q, p, two) for q in good)})
    least = "at least " if several and highest < 1.0 else ""
    for some, style, label in (
        (others, {"marker": "x", "ls": "none", "color": colors.FAINT, "ms": 5}, f"below {highest:.0%} success"),
        (good, {"marker": "o", "ls": "none", "color": colors.SKY, "ms": 5}, f"{least}{highest:.0%} success"),
        (
            front,
            {"marker": "D", "ls": "-", "color": colors.BLUE, "ms": 6, "lw": 1.0, "drawstyle": _steps(two)},
            "Pareto front",
        ),
    ):
        if some:
            axes.plot([p[0] for p in some], [p[1] for p in some], label=label, **style)
    return good


def _steps(two: Sequence[Objective]) -> str:
    """Return the style of a front as steps: between two trials lies what one of them dominates, not a mixture of both.

    From left to right, the better value of the right-hand axis is kept until the next trial if the left one is to be small.
    """
    low_is_better = two[0].better(0.0, 1.0)
    return "steps-post" if low_is_better else "steps-pre"


def _draw_before(
    axes: Any, tuning: TuningResult, two: Sequence[Objective], shown: Sequence[tuple[float, ...]]
) -> list[tuple[float, float]]:
    """Draw the current parameters, or notes them in the legend if they are far away; the limits of both axes."""
    before = tuple(o.of(list(tuning.training.before)) for o in two)
    limits = [_limits([p[k] for p in shown]) for k in (0, 1)]
    if all(low - 2.0 * (high - low) <= v <= high + 2.0 * (high - low) for v, (low, high) in zip(before, limits)):
        axes.plot([before[0]], [before[1]], "s", color=colors.ORANGE, ms=9, mec="white", mew=0.8, label="before")
        return [_limits([low, high, v]) for v, (low, high) in zip(before, limits)]
    label = f"before: {before[0]:.4g}, {before[1]:.4g}, outside the chart"
    axes.plot([], [], "s", color=colors.ORANGE, ms=9, label=label)
    return limits


def _limits(values: Sequence[float]) -> tuple[float, float]:
    """Minimum and maximum with a margin."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    margin = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin


# --- comparisons ------------------------------------------------------------------------------------------------------


MAX_RUNS: Final = 40
"""Number of runs drawn; of more, those with the greatest change."""
MAX_PERTURBATIONS: Final = 30


def before_after(
    comparison: Comparison, path: Path, *, title: str, names: tuple[str, str] = ("before", "after")
) -> Path:
    """Return a row per run with the times before and after, of localizers the errors; failures are at the right edge."""
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
    """Return the indices of the runs with the greatest change, in order."""

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
    """Return the difference in the score for each change, with its confidence interval; the greatest on top."""
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
