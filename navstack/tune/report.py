"""The reports of tuning: self-contained HTML files, and their pictures as PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from navstack.core.errors import NavError
from navstack.core.files import ensure_directory, write_text
from navstack.parameters.yaml_rewrite import RewrittenFiles
from navstack.plot import plot_run
from navstack.tune import comparison_charts, trial_charts
from navstack.tune.comparison import Comparison
from navstack.tune.evaluation import Case
from navstack.tune.report_html import FixedRun, ReportHeader, sensitivity_page, tuning_page
from navstack.tune.sensitivity import Perturbation
from navstack.tune.tuning import TuningResult
from navstack.tune.work import RunInput, RunWork

MAX_FIXED_RUNS: Final = 4
"""Number of runs drawn that changed from failure to success."""
_SLICES: Final = 6


def draw_fixed_runs(tuning: TuningResult, training: RunWork, held_out: RunWork | None, folder: Path) -> list[FixedRun]:
    """Repeats and draws runs that changed from failure to success; held-out runs first."""
    found: list[FixedRun] = []
    overrides = tuple(tuning.problem.space.overrides(tuning.candidate))
    for name, comparison, work in (("held-out", tuning.held_out, held_out), ("training", tuning.training, training)):
        if comparison is None or work is None:
            continue
        for i in comparison.fixed:
            if len(found) == MAX_FIXED_RUNS:
                return found
            stem = f"fixed_{len(found) + 1}"
            before = _draw_run(work, (), comparison.cases[i], folder / f"{stem}_before.png")
            after = before and _draw_run(work, overrides, comparison.cases[i], folder / f"{stem}_after.png")
            if before and after:
                key = comparison.cases[i].key
                found.append(FixedRun(key, before, after, f"{key} ({name}): {_fixed_text(comparison, i)}"))
    return found


def _draw_run(work: RunWork, overrides: tuple[str, ...], case: Case, path: Path) -> Path | None:
    """The picture of a run; None for a run that cannot be drawn."""
    recorder = work.drive(RunInput(overrides, case), record=True)[1]
    if recorder is None:
        return None
    try:
        return plot_run(recorder.record(), path, dpi=90.0)
    except NavError:
        return None


def _fixed_text(comparison: Comparison, index: int) -> str:
    before = comparison.before[index]
    reason = f"{before['outcome']}{': ' + before['text'] if before['text'] else ''}"
    return f"before, {reason}; after, success in {comparison.after[index]['time_s']:.1f} s"


def write_report(
    folder: Path,
    tuning: TuningResult,
    header: ReportHeader,
    rewritten: RewrittenFiles | None,
    fixed_runs: Sequence[FixedRun] = (),
) -> Path:
    """Draws the charts into `folder` and writes `report.html`; returns its path."""
    ensure_directory(folder)
    charts = draw_charts(tuning, folder, header.against)
    path = folder / "report.html"
    write_text(path, "\n".join(tuning_page(tuning, header, rewritten, charts, fixed_runs)) + "\n")
    return path


def draw_charts(tuning: TuningResult, folder: Path, against: str = "") -> dict[str, Path]:
    """Draws all charts for which there are data; their files by name."""
    charts: dict[str, Path] = {}
    for name, comparison, title, before in (
        ("held_out", tuning.held_out if tuning.found else None, "Held-out runs", "before"),
        ("against", tuning.against, f"Comparison with {against}", against),
        ("training", tuning.training if tuning.found else None, "Training runs", "before"),
    ):
        if comparison is not None:
            path = folder / f"{name}.png"
            charts[name] = comparison_charts.before_after(comparison, path, title=title, names=(before, "tuned"))
    if tuning.trials:
        charts["history"] = trial_charts.history(tuning, folder / "trials.png")
    if tuning.importance:
        charts["importance"] = trial_charts.importance(tuning, folder / "importance.png")
        charts["slices"] = trial_charts.slices(tuning, folder / "slices.png", list(tuning.importance)[:_SLICES])
    if any(t.complete for t in tuning.trials):
        charts["pareto"] = trial_charts.pareto(tuning, folder / "pareto.png")
    return charts


def write_sensitivity_report(folder: Path, found: Sequence[Perturbation], header: ReportHeader) -> Path:
    """Draws the chart into `folder` and writes `why.html`; returns its path."""
    ensure_directory(folder)
    chart = comparison_charts.sensitivities(found, folder / "why.png")
    path = folder / "why.html"
    write_text(path, "\n".join(sensitivity_page(found, header, chart)) + "\n")
    return path


def tuning_as_dict(tuning: TuningResult) -> dict[str, Any]:
    """The result without the trials, which are in the study, for JSON."""
    return {
        "found": tuning.found,
        "verdict": tuning.verdict,
        "trials": len(tuning.trials),
        "best_trial": tuning.best.number if tuning.best is not None else None,
        "values": dict(tuning.candidate),
        "reverted": list(tuning.reverted),
        "importance": tuning.importance,
        "front": [{"trial": t.number, "values": list(t.values), "candidate": t.candidate} for t in tuning.front],
        "objectives": [o.name for o in tuning.problem.objectives],
        "training": tuning.training.as_dict(),
        "held_out": tuning.held_out.as_dict() if tuning.held_out is not None else None,
        "against": tuning.against.as_dict() if tuning.against is not None else None,
    }
