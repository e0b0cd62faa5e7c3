"""The reports of tuning: self-contained HTML files, and their pictures as PNG."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from navstack.core import NavError, ensure_directory, write_text
from navstack.parameters import RewrittenFiles, value_text
from navstack.plot import plot_run
from navstack.studies import charts
from navstack.studies.comparison import Comparison
from navstack.studies.evaluation import Case, RunInput, RunWork
from navstack.studies.problem import OBJECTIVES
from navstack.studies.sensitivity import Perturbation
from navstack.studies.table import Column, Table, html_text
from navstack.studies.tuning import TuningResult

FEW: Final = 6
"""With fewer groups, no exact test can show a difference at 5 %."""

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
table { border-collapse: collapse; font-size: 0.9rem; } td, th { padding: 0.2rem 0.8rem 0.2rem 0; text-align: left; }
table { display: block; max-width: 100%; overflow-x: auto; } p, li, code { overflow-wrap: anywhere; }
td.n { white-space: nowrap; }
th { border-bottom: 1px solid #888; } td.n, th.n { text-align: right; } tr:nth-child(even) td { background: #f6f6f6; }
.verdict { font-size: 1.1rem; border-left: 4px solid #0072B2; padding: 0.4rem 0 0.4rem 1rem; }
.nothing { border-color: #E69F00; } .dim { color: #666; } code { font-size: 0.9em; }
img { max-width: 100%; } .pair { display: flex; gap: 1rem; flex-wrap: wrap; } .pair figure { flex: 1 1 20rem; margin: 0; }
figcaption { font-size: 0.85rem; color: #444; }
@media (max-width: 40rem) { body { margin: 1rem auto; } table { font-size: 0.75rem; } td.n { white-space: normal; }
td, th { padding-right: 0.35rem; vertical-align: top; } }
"""


@dataclass(frozen=True, slots=True)
class ReportHeader:
    """Where the results of a report come from."""

    title: str
    params: str
    command: str
    """Command to reproduce the results."""
    summary: str
    """Cases, trials, sampler and random seed in a sentence."""
    against: str = ""
    """Name of the reference parameter set."""


@dataclass(frozen=True, slots=True)
class FixedRun:
    """Pictures of a run that failed before and succeeds after."""

    case: str
    before: Path
    after: Path
    text: str


@dataclass(frozen=True, slots=True)
class FailedRun:
    """A validation run that fails."""

    case: str
    picture: Path | None
    """None for a run that could not be driven."""
    text: str
    """Which run, and why it fails."""


def tuning_page(
    tuning: TuningResult,
    header: ReportHeader,
    rewritten: RewrittenFiles | None,
    charts: Mapping[str, Path],
    fixed_runs: Sequence[FixedRun],
    failed_runs: Sequence[FailedRun] = (),
) -> Iterator[str]:
    """The lines of the report of a tuning."""
    yield from _head(header)
    yield f'<p class="verdict{"" if tuning.found else " nothing"}">{html_text(tuning.verdict)}</p>'
    yield from _origin(header)
    if rewritten is not None and rewritten.changes:
        yield from _changes(tuning, rewritten)
    if tuning.held_out is not None:
        yield "<h2>Held-out runs (not used for the search)</h2>"
        yield from _comparison(tuning.held_out, "before", "tuned")
        yield from _chart(charts, "held_out", "Time of each held-out run before and after")
    if tuning.against is not None:
        yield f"<h2>Comparison with {html_text(header.against)}</h2>"
        yield from _comparison(tuning.against, header.against, "tuned")
        yield from _chart(charts, "against", f"Time of each run with {header.against} and with the tuned parameters")
    yield "<h2>Training runs</h2>"
    yield from _comparison(tuning.training, "before", "tuned")
    yield from _chart(charts, "training", "Time of each training run before and after")
    yield from _fixed_and_broken(tuning, fixed_runs)
    yield from _failing(tuning, failed_runs)
    yield from _importance(tuning, charts)
    yield from _trade_off(tuning, charts)
    yield from _search(tuning, charts)
    yield "</body></html>"


def _head(header: ReportHeader) -> Iterator[str]:
    yield "<!DOCTYPE html>"
    yield '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
    yield f"<title>{html.escape(header.title)}</title><style>{_STYLE}</style></head><body>"
    yield f"<h1>{html_text(header.title)}</h1>"


def _origin(header: ReportHeader) -> Iterator[str]:
    command = f"</p><p>Command to reproduce: <code>{html_text(header.command)}</code>" if header.command else ""
    yield f"<p>{html_text(header.summary)}{command}</p>"


def _image(path: Path, alt: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{data}">'


def _chart(charts: Mapping[str, Path], name: str, alt: str) -> Iterator[str]:
    if name in charts:
        yield f"<p>{_image(charts[name], alt)}</p>"


def _changes(tuning: TuningResult, rewritten: RewrittenFiles) -> Iterator[str]:
    yield "<h2>Changed parameters</h2>"
    columns = (
        Column("parameter", "parameter", looks="name"),
        Column("before", "before", looks="number"),
        Column("after", "after", looks="number"),
        Column("location", "location", looks="faint"),
    )
    rows = [
        {
            "parameter": c.name,
            "before": "default" if c.old is None else value_text(c.old),
            "after": value_text(c.new),
            "location": c.place or "new line",
        }
        for c in rewritten.changes
    ]
    yield Table("", columns, rows).html()
    if tuning.reverted:
        names = [_with_importance(name, tuning.importance) for name in tuning.reverted]
        yield (
            "<p class=dim>Reverted, because the best trial's value gave the same result as the current one: "
            f"{html_text(', '.join(names))}. The importance describes the whole range, including values far from both.</p>"
        )
    limits = [d.name for d in tuning.problem.space if d.robot and d.name in tuning.candidate]
    if limits:
        yield (
            f"<p><b>Check the limits of your robot.</b> {html_text(', '.join(limits))}: the simulated robot follows any command; "
            "the real one may not. Give the true limits with <code>--param NAME=LOW:HIGH</code>.</p>"
        )
    if rewritten.overlay_reason:
        yield f"<p>The values are in a separate file, to be loaded last, because {html_text(rewritten.overlay_reason)}.</p>"


def _with_importance(name: str, importance: Mapping[str, float]) -> str:
    return f"{name} (importance {importance[name]:.0%})" if name in importance else name


def _comparison(comparison: Comparison, before: str, after: str) -> Iterator[str]:
    columns = (
        Column("measure", ""),
        Column("before", before, looks="number"),
        Column("after", after, looks="number"),
        Column("difference", "difference, 95 % interval", looks="number"),
        Column("verdict", ""),
    )
    rows: list[dict[str, str]] = []
    for m in comparison.measures:
        note = " of runs that succeed in both" if m.name in ("time", "clearance", "jerk") else ""
        texts = zip(("before", "after", "difference"), m.texts, strict=True)
        rows.append({"measure": m.label + note, **dict(texts), "verdict": m.verdict})
    yield Table("", columns, rows).html()
    runs = f"{len(comparison.cases)} paired runs; the runs of one scenario form a group."
    yield f"<p class=dim>{runs}{_few(comparison)}</p>"


def _few(comparison: Comparison) -> str:
    """Return a comment on intervals that are wide because there are few groups."""
    few = {m.name: m.difference.interval.groups for m in comparison.measures if 0 < m.difference.interval.groups < FEW}
    if not few:
        return ""
    counts = ", ".join(f"{name} {n}" for name, n in few.items())
    return f" <b>Few scenarios ({html_text(counts)})</b>: their intervals are wide and say little; tune with more scenarios."


def _fixed_and_broken(tuning: TuningResult, fixed_runs: Sequence[FixedRun]) -> Iterator[str]:
    if fixed_runs:
        yield "<h2>From failure to success</h2>"
    for run in fixed_runs:
        yield f"<p>{html_text(run.text)}</p><div class='pair'>"
        for file, word in ((run.before, "before"), (run.after, "after")):
            yield f"<figure><figcaption>{word}</figcaption>{_image(file, f'{run.case}, {word}')}</figure>"
        yield "</div>"
    shown = tuning.validation
    if shown.broken and tuning.found:
        yield f"<p>From success to failure: {html_text(', '.join(shown.cases[i].key for i in shown.broken))}.</p>"


def _failing(tuning: TuningResult, runs: Sequence[FailedRun]) -> Iterator[str]:
    """Why runs of the validation still fail."""
    if not runs:
        return
    yield f"<h2>{tuning.validation_name.capitalize()} runs that fail</h2>"
    for run in runs:
        yield f"<p>{html_text(run.text)}</p>"
        if run.picture is not None:
            yield f"<p>{_image(run.picture, f'{run.case}, failed')}</p>"
    more = len(tuning.validation.failed) - len(runs)
    if more:
        yield f"<p class=dim>{more} more are in tune.json.</p>"


def _importance(tuning: TuningResult, charts: Mapping[str, Path]) -> Iterator[str]:
    yield "<h2>Importance of the parameters</h2>"
    if tuning.importance:
        yield from _chart(charts, "importance", "Importance of each parameter")
        yield from _chart(charts, "slices", "Score of the trials against the six most important parameters")
    else:
        yield "<p>There are too few trials to estimate it.</p>"


def _trade_off(tuning: TuningResult, charts: Mapping[str, Path]) -> Iterator[str]:
    several = len(tuning.problem.objectives) > 1
    yield "<h2>" + ("Pareto front" if several else "Time against clearance") + "</h2>"
    yield from _chart(charts, "pareto", "Trials by two objectives")
    if several:
        yield from _front(tuning)


def _front(tuning: TuningResult) -> Iterator[str]:
    names = [o.name for o in tuning.problem.objectives]
    columns = (
        Column("trial", "trial"),
        *(Column(name, name, looks="number") for name in names),
        Column("values", "values", looks="faint"),
    )
    rows = [
        {
            "trial": str(t.number),
            **{name: f"{value:.4g}" for name, value in zip(names, t.values, strict=True)},
            "values": ", ".join(f"{name.rpartition('/')[2]} {value_text(v)}" for name, v in t.candidate.items()),
        }
        for t in tuning.front
    ]
    yield Table("", columns, rows).html()


def _search(tuning: TuningResult, charts: Mapping[str, Path]) -> Iterator[str]:
    complete = sum(t.complete for t in tuning.trials)
    yield "<h2>Search</h2>"
    yield f"<p>{len(tuning.trials)} trials: {complete} complete, {len(tuning.trials) - complete} pruned.</p>"
    yield from _chart(charts, "history", "Objective of every trial")
    columns = (
        Column("parameter", "parameter", looks="name"),
        Column("range", "range"),
        Column("before", "before", looks="number"),
        Column("best", "best trial", looks="number"),
        Column("meaning", "", looks="faint"),
    )
    rows: list[dict[str, str]] = []
    for d in tuning.problem.space:
        also = f"; with {', '.join(n for n, _ in d.ties)}" if d.ties else ""
        rows.append(
            {
                "parameter": d.name,
                "range": d.range_text(),
                "before": value_text(d.present) if d.present is not None else "default",
                "best": value_text(tuning.best.candidate[d.name]) if tuning.best is not None else "",
                "meaning": d.meaning + also,
            }
        )
    yield Table("", columns, rows).html()
    meanings = "; ".join(f"{o.name}: {o.meaning}" for o in tuning.problem.objectives)
    yield f"<p class=dim>{html_text(meanings)}.</p>"


def sensitivity_page(found: Sequence[Perturbation], header: ReportHeader, chart: Path) -> Iterator[str]:
    """The lines of the report of a sensitivity analysis."""
    yield from _head(header)
    yield from _origin(header)
    yield f"<p>{_image(chart, 'Difference in the score for each change')}</p>"
    yield "<ol>"
    for one in found:
        yield f"<li>{html_text(one.sentence)}</li>"
    yield "</ol>"
    columns = (
        Column("parameter", "parameter", looks="name"),
        Column("change", "change"),
        Column("score", "score", 3, "number"),
        Column("success", "success", 2, "number"),
        Column("time", "time (s)", 1, "number"),
    )
    rows: list[dict[str, Any]] = []
    for one in found:
        measures = {name: one.comparison.find(name) for name in ("score", "success", "time")}
        differences = {name: m.difference if m is not None else None for name, m in measures.items()}
        rows.append({"parameter": one.dimension.name, "change": one.what, **differences})
    yield Table("", columns, rows).html()
    yield f"<p class=dim>{html_text(OBJECTIVES['score'].meaning)}.</p></body></html>"


MAX_FIXED_RUNS: Final = 4
"""Number of runs drawn that changed from failure to success."""
_SLICES: Final = 6


def draw_fixed_runs(tuning: TuningResult, training: RunWork, held_out: RunWork | None, folder: Path) -> list[FixedRun]:
    """Repeat and draws runs that changed from failure to success; held-out runs first."""
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


MAX_FAILED_RUNS: Final = 3
"""Number of validation runs drawn that fail with the result."""


def draw_failed_runs(tuning: TuningResult, work: RunWork, folder: Path) -> list[FailedRun]:
    """Repeat and draw validation runs that fail with the result; without a better one, with the current parameters."""
    comparison = tuning.validation
    overrides = tuple(tuning.problem.space.overrides(tuning.candidate)) if tuning.found else ()
    found: list[FailedRun] = []
    for i in comparison.failed[:MAX_FAILED_RUNS]:
        case, outcome = comparison.cases[i], comparison.after[i]
        picture = _draw_run(work, overrides, case, folder / f"failed_{len(found) + 1}.png")
        reason = f"{outcome['outcome']}{': ' + outcome['text'] if outcome['text'] else ''}"
        found.append(FailedRun(case.key, picture, f"{case.key}: {reason}"))
    return found


def _draw_run(work: RunWork, overrides: tuple[str, ...], case: Case, path: Path) -> Path | None:
    """Return the picture of a run; None for a run that cannot be drawn."""
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
    failed_runs: Sequence[FailedRun] = (),
) -> Path:
    """Draw the charts into `folder` and writes `report.html`; returns its path."""
    ensure_directory(folder)
    drawn = draw_charts(tuning, folder, header.against)
    path = folder / "report.html"
    write_text(path, "\n".join(tuning_page(tuning, header, rewritten, drawn, fixed_runs, failed_runs)) + "\n")
    return path


def draw_charts(tuning: TuningResult, folder: Path, against: str = "") -> dict[str, Path]:
    """Draw all charts for which there are data; their files by name."""
    drawn: dict[str, Path] = {}
    for name, comparison, title, before in (
        ("held_out", tuning.held_out if tuning.found else None, "Held-out runs", "before"),
        ("against", tuning.against, f"Comparison with {against}", against),
        ("training", tuning.training if tuning.found else None, "Training runs", "before"),
    ):
        if comparison is not None:
            path = folder / f"{name}.png"
            drawn[name] = charts.before_after(comparison, path, title=title, names=(before, "tuned"))
    if tuning.trials:
        drawn["history"] = charts.history(tuning, folder / "trials.png")
    if tuning.importance:
        drawn["importance"] = charts.importance(tuning, folder / "importance.png")
        drawn["slices"] = charts.slices(tuning, folder / "slices.png", list(tuning.importance)[:_SLICES])
    if any(t.complete for t in tuning.trials):
        drawn["pareto"] = charts.pareto(tuning, folder / "pareto.png")
    return drawn


def write_sensitivity_report(folder: Path, found: Sequence[Perturbation], header: ReportHeader) -> Path:
    """Draw the chart into `folder` and writes `why.html`; returns its path."""
    ensure_directory(folder)
    chart = charts.sensitivities(found, folder / "why.png")
    path = folder / "why.html"
    write_text(path, "\n".join(sensitivity_page(found, header, chart)) + "\n")
    return path


def tuning_as_dict(tuning: TuningResult) -> dict[str, Any]:
    """Return the result without the trials, which are in the study, for JSON."""
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
