"""The charts of a tuning report. matplotlib is imported by the first of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from navstack.plot import canvas, colors
from navstack.tune.comparison import Comparison
from navstack.tune.objectives import NOTHING, OBJECTIVES, success_rate
from navstack.tune.sensitivity import Step
from navstack.tune.session import Tuning

DPI = 110.0
MOST_ROWS = 40
"""So many runs are drawn a row each; of more, those that changed most."""


def _figure(width: float, height: float, *, title: str) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left")
    return figure, figure.add_subplot()


def history(tuning: Tuning, path: Path) -> Path:
    """The first objective of every trial, the best so far, and the parameters as they were."""
    objective = tuning.problem.objectives[0]
    with canvas.style():
        figure, axes = _figure(8.0, 3.8, title="Trials")
        # one in which nothing succeeded would squeeze everything else into a line
        told = [t for t in tuning.trials if t.values[0] < NOTHING]
        left_out = len(tuning.trials) - len(told)
        whole = [t for t in told if t.complete]
        cut = [t for t in told if not t.complete]
        before = objective.of(list(tuning.training.before))
        if before < NOTHING:
            axes.axhline(before, color=colors.INK, lw=1.2, ls=(0, (4, 2)), label="parameters as they were")
        else:
            axes.plot([], [], color=colors.INK, lw=1.2, ls=(0, (4, 2)), label="parameters as they were: no success")
        if cut:
            axes.plot(
                [t.number for t in cut],
                [t.values[0] for t in cut],
                "x",
                color=colors.FAINT,
                ms=5,
                label="given up (mean of the runs driven)",
            )
        axes.plot(
            [t.number for t in whole],
            [t.values[0] for t in whole],
            "o",
            color=colors.BLUE,
            ms=5,
            label="driven over every case",
        )
        best: list[float] = []
        for t in whole:
            best.append(t.values[0] if not best or objective.better(t.values[0], best[-1]) else best[-1])
        if best:
            axes.step(
                [t.number for t in whole], best, where="post", color=colors.VERMILLION, lw=1.6, label="best so far"
            )
        axes.set_xlabel("trial" + (f" ({left_out} without a single success left out)" if left_out else ""))
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_ylabel(f"{objective.name}{f' ({objective.unit})' if objective.unit else ''} in training")
        axes.legend(loc="best", fontsize=8)
        return canvas.save(figure, path, DPI)


def before_after(
    comparison: Comparison, path: Path, *, title: str, names: tuple[str, str] = ("before", "after")
) -> Path:
    """A row per run: the time before and after, failures at the right edge."""
    rows = list(range(len(comparison.cases)))

    def moved(i: int) -> float:
        b, a = comparison.before[i], comparison.after[i]
        if b["success"] != a["success"]:
            return math.inf
        return abs(a["score"] - b["score"])

    left_out = 0
    if len(rows) > MOST_ROWS:
        left_out = len(rows) - MOST_ROWS
        rows = sorted(sorted(rows, key=lambda i: -moved(i))[:MOST_ROWS])
    times = [o["time_s"] for i in rows for o in (comparison.before[i], comparison.after[i]) if o["success"]]
    edge = 1.12 * max(times, default=1.0)
    with canvas.style():
        figure, axes = _figure(8.0, 1.5 + 0.22 * len(rows), title=title)
        for y, i in enumerate(rows):
            b, a = comparison.before[i], comparison.after[i]
            xb, xa = (o["time_s"] if o["success"] else edge for o in (b, a))
            axes.plot([xb, xa], [y, y], color=colors.FAINT, lw=1.2, zorder=1)
            for x, o, color, marker in ((xb, b, colors.ORANGE, "o"), (xa, a, colors.BLUE, "D")):
                good = bool(o["success"])
                axes.plot([x], [y], marker, ms=6, color=color if good else "white", mec=color, mew=1.6, zorder=2)
        axes.axvline(edge, color=colors.FAINT, lw=0.8, ls=(0, (2, 2)))
        axes.set_yticks(range(len(rows)), [comparison.cases[i].key.removesuffix(" seed 0") for i in rows], fontsize=7)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlim(0.0, edge * 1.06)
        axes.set_xlabel(
            "time (s); hollow, at the dashed line: did not get there"
            + (f"; {left_out} runs that changed least left out" if left_out else ""),
            fontsize=8,
        )
        for marker, color, name in (("o", colors.ORANGE, names[0]), ("D", colors.BLUE, names[1])):
            axes.plot([], [], marker, color=color, label=name, ls="none")
        figure.legend(loc="outside lower right", ncols=2, fontsize=8)
        return canvas.save(figure, path, DPI)


def importance(tuning: Tuning, path: Path) -> Path:
    """Bars of how much each parameter mattered."""
    items = list(tuning.importance.items())
    with canvas.style():
        figure, axes = _figure(8.0, 1.3 + 0.28 * len(items), title="Parameters that mattered")
        y = range(len(items))
        axes.barh(y, [v for _, v in items], color=colors.BLUE, height=0.62)
        axes.set_yticks(y, [name for name, _ in items], fontsize=8)
        axes.invert_yaxis()
        for i, (_, v) in enumerate(items):
            axes.text(v, i, f" {v:.0%}", va="center", fontsize=7, color=colors.INK)
        axes.set_xlabel("share of what separates the best trials from the others (PED-ANOVA)")
        axes.set_xlim(0.0, 1.12 * max([v for _, v in items], default=1.0))
        return canvas.save(figure, path, DPI)


def slices(tuning: Tuning, path: Path, names: Sequence[str]) -> Path:
    """The first objective against each of these parameters; the present and the tuned value marked."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    objective = tuning.problem.objectives[0]
    dimensions = {d.name: d for d in tuning.problem.space}
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    with canvas.style():
        figure = Figure(figsize=(3.1 * columns, 2.6 * rows + 0.8), layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle("What was tried of them", fontsize=12, fontweight="bold", x=0.01, ha="left")
        for i, name in enumerate(names):
            d = dimensions[name]
            axes = figure.add_subplot(rows, columns, i + 1)
            for complete, color, marker in ((False, colors.FAINT, "x"), (True, colors.BLUE, "o")):
                some = [t for t in tuning.trials if t.complete is complete and t.values[0] < NOTHING]
                axes.plot([_x(t.candidate[name]) for t in some], [t.values[0] for t in some], marker, color=color, ms=4)
            if d.log and d.kind != "choice":
                axes.set_xscale("log")
                # the style does not read mathematics, which the usual labels of a log scale are written in
                axes.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
                axes.xaxis.set_minor_formatter(lambda v, _: "")
            if d.present is not None and not isinstance(d.present, str):
                axes.axvline(float(d.present), color=colors.ORANGE, lw=1.4, ls=(0, (4, 2)))
            if name in tuning.candidate and not isinstance(tuning.candidate[name], str):
                axes.axvline(float(tuning.candidate[name]), color=colors.VERMILLION, lw=1.4)
            axes.set_xlabel(f"{name.rpartition('/')[2]}{f' ({d.unit})' if d.unit else ''}", fontsize=8)
            if i % columns == 0:
                axes.set_ylabel(f"{objective.name}{f' ({objective.unit})' if objective.unit else ''}", fontsize=8)
            axes.tick_params(labelsize=7)
        figure.axes[0].plot([], [], "o", color=colors.BLUE, ms=4, label="driven over every case")
        figure.axes[0].plot([], [], "x", color=colors.FAINT, ms=4, label="given up")
        figure.axes[0].plot([], [], color=colors.ORANGE, lw=1.4, ls=(0, (4, 2)), label="before")
        figure.axes[0].plot([], [], color=colors.VERMILLION, lw=1.4, label="tuned")
        figure.legend(loc="outside lower center", fontsize=8, ncols=4)
        return canvas.save(figure, path, DPI)


def _x(value: Any) -> Any:
    return str(value) if isinstance(value, (bool, str)) else float(value)


def pareto(tuning: Tuning, path: Path) -> Path:
    """Trials by two objectives: those searched for, or time and clearance; the front marked."""
    objectives = tuning.problem.objectives
    two = objectives[:2] if len(objectives) > 1 else (OBJECTIVES["time"], OBJECTIVES["clearance"])
    whole = [t for t in tuning.trials if t.complete]
    points = [tuple(o.of(list(t.outcomes.values())) for o in two) for t in whole]
    rates = [success_rate(list(t.outcomes.values())) for t in whole]
    best = max(rates, default=0.0)
    good = [p for p, r in zip(points, rates) if r >= best - 1e-9]
    front = sorted(p for p in good if not any(_beats(q, p, two) for q in good))
    with canvas.style():
        figure, axes = _figure(6.6, 4.4, title=f"{two[0].name.capitalize()} against {two[1].name}")
        worse = [p for p, r in zip(points, rates) if r < best - 1e-9]
        axes.plot(
            [p[0] for p in worse],
            [p[1] for p in worse],
            "x",
            color=colors.FAINT,
            ms=5,
            label=f"fewer than {best:.0%} of runs succeed",
        )
        axes.plot(
            [p[0] for p in good], [p[1] for p in good], "o", color=colors.SKY, ms=5, label=f"{best:.0%} of runs succeed"
        )
        axes.plot(
            [p[0] for p in front],
            [p[1] for p in front],
            "-D",
            color=colors.BLUE,
            ms=6,
            lw=1.0,
            label="no trial beats these in both",
        )
        shown = list(good)
        if tuning.found:
            shown.append(tuple(o.of(list(tuning.training.after)) for o in two))
            axes.plot(
                *([v] for v in shown[-1]), "*", color=colors.VERMILLION, ms=12, mec="white", mew=0.8, label="tuned"
            )
        before = tuple(o.of(list(tuning.training.before)) for o in two)
        limits = [_limits([p[k] for p in shown]) for k in (0, 1)]
        # parameters that reach no goal would squeeze everything else into a corner
        if all(low - 2.0 * (high - low) <= v <= high + 2.0 * (high - low) for v, (low, high) in zip(before, limits)):
            limits = [_limits([low, high, v]) for v, (low, high) in zip(before, limits)]
            axes.plot([before[0]], [before[1]], "s", color=colors.ORANGE, ms=9, mec="white", mew=0.8, label="before")
        else:
            axes.plot(
                [], [], "s", color=colors.ORANGE, ms=9, label=f"before: {before[0]:.4g}, {before[1]:.4g}, off the chart"
            )
        axes.set_xlim(*limits[0])
        axes.set_ylim(*limits[1])
        axes.set_xlabel(f"{two[0].meaning}{f' ({two[0].unit})' if two[0].unit else ''}", fontsize=8)
        axes.set_ylabel(f"{two[1].meaning}{f' ({two[1].unit})' if two[1].unit else ''}", fontsize=8)
        axes.legend(fontsize=7, loc="best")
        return canvas.save(figure, path, DPI)


def _limits(values: Sequence[float]) -> tuple[float, float]:
    """From the least to the greatest, with room around."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def _beats(a: Sequence[float], b: Sequence[float], objectives: Sequence[Any]) -> bool:
    return not any(o.better(y, x) for x, y, o in zip(a, b, objectives)) and tuple(a) != tuple(b)


def sensitivities(steps: Sequence[Step], path: Path) -> Path:
    """The difference in the score of each step, with its confidence interval; the greatest on top."""
    shown = list(steps)[:30]
    with canvas.style():
        figure, axes = _figure(8.0, 1.4 + 0.26 * len(shown), title="What changes if one parameter is halved or doubled")
        axes.axvline(0.0, color=colors.INK, lw=1.0)
        for y, step in enumerate(shown):
            i = step.comparison.measure("score").difference.interval
            color = colors.FAINT
            if step.comparison.measure("score").difference.shown:
                color = colors.BLUE if i.value > 0.0 else colors.VERMILLION
            if math.isfinite(i.low):
                axes.plot([i.low, i.high], [y, y], color=color, lw=2.0)
            axes.plot([i.value], [y], "o", color=color, ms=5)
        axes.set_yticks(range(len(shown)), [f"{s.dimension.name} {s.what}" for s in shown], fontsize=7)
        axes.set_ylim(len(shown) - 0.4, -0.6)
        for color, name in (
            (colors.BLUE, "better"),
            (colors.VERMILLION, "worse"),
            (colors.FAINT, "no difference shown"),
        ):
            axes.plot([], [], "-o", color=color, ms=5, lw=2.0, label=name)
        axes.set_xlabel("difference in the score, with 95 % confidence", fontsize=8)
        figure.legend(loc="outside lower right", ncols=3, fontsize=8)
        return canvas.save(figure, path, DPI)


def figures_of(tuning: Tuning, folder: Path, against: str = "") -> Mapping[str, Path]:
    """All charts that there is something to draw for, by name, in the order in which a report shows them."""
    found: dict[str, Path] = {}
    if tuning.held_out is not None and tuning.found:
        found["held_out"] = before_after(
            tuning.held_out,
            folder / "held_out.png",
            title="Runs that were not used for tuning",
            names=("before", "tuned"),
        )
    if tuning.against is not None:
        found["against"] = before_after(
            tuning.against, folder / "against.png", title=f"Beside {against}", names=(against, "tuned")
        )
    if tuning.found:
        found["training"] = before_after(
            tuning.training, folder / "training.png", title="Training runs", names=("before", "tuned")
        )
    if tuning.trials:
        found["history"] = history(tuning, folder / "trials.png")
    if tuning.importance:
        found["importance"] = importance(tuning, folder / "importance.png")
        found["slices"] = slices(tuning, folder / "slices.png", list(tuning.importance)[:6])
    if any(t.complete for t in tuning.trials):
        found["pareto"] = pareto(tuning, folder / "pareto.png")
    return found
