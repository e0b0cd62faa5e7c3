"""The HTML of the tuning reports; pictures are embedded."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from navstack.parameters.report import value_text
from navstack.parameters.yaml_rewrite import RewrittenFiles
from navstack.tune.comparison import Comparison
from navstack.tune.objectives import OBJECTIVES
from navstack.tune.sensitivity import Perturbation
from navstack.tune.tuning import TuningResult

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


def tuning_page(
    tuning: TuningResult,
    header: ReportHeader,
    rewritten: RewrittenFiles | None,
    charts: Mapping[str, Path],
    fixed_runs: Sequence[FixedRun],
) -> Iterator[str]:
    """The lines of the report of a tuning."""
    yield from _head(header)
    yield f'<p class="verdict{"" if tuning.found else " nothing"}">{_e(tuning.verdict)}</p>'
    yield from _origin(header)
    if rewritten is not None and rewritten.changes:
        yield from _changes(tuning, rewritten)
    if tuning.held_out is not None:
        yield "<h2>Held-out runs (not used for the search)</h2>"
        yield from _comparison(tuning.held_out, "before", "tuned")
        yield from _chart(charts, "held_out", "Time of each held-out run before and after")
    if tuning.against is not None:
        yield f"<h2>Comparison with {_e(header.against)}</h2>"
        yield from _comparison(tuning.against, header.against, "tuned")
        yield from _chart(charts, "against", f"Time of each run with {header.against} and with the tuned parameters")
    yield "<h2>Training runs</h2>"
    yield from _comparison(tuning.training, "before", "tuned")
    yield from _chart(charts, "training", "Time of each training run before and after")
    yield from _fixed_and_broken(tuning, fixed_runs)
    yield from _importance(tuning, charts)
    yield from _trade_off(tuning, charts)
    yield from _search(tuning, charts)
    yield "</body></html>"


def _e(text: object) -> str:
    """The text for HTML; `names` in backticks become code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(str(text)))


def _name(text: str) -> str:
    """A name for a cell of a table, which may be divided after a slash or an underscore."""
    return re.sub(r"([/_])", r"\1<wbr>", _e(text))


def _head(header: ReportHeader) -> Iterator[str]:
    yield "<!DOCTYPE html>"
    yield '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
    yield f"<title>{html.escape(header.title)}</title><style>{_STYLE}</style></head><body>"
    yield f"<h1>{_e(header.title)}</h1>"


def _origin(header: ReportHeader) -> Iterator[str]:
    command = f"</p><p>Command to reproduce: <code>{_e(header.command)}</code>" if header.command else ""
    yield f"<p>{_e(header.summary)}{command}</p>"


def _image(path: Path, alt: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{data}">'


def _chart(charts: Mapping[str, Path], name: str, alt: str) -> Iterator[str]:
    if name in charts:
        yield f"<p>{_image(charts[name], alt)}</p>"


def _changes(tuning: TuningResult, rewritten: RewrittenFiles) -> Iterator[str]:
    yield "<h2>Changed parameters</h2>"
    yield "<table><tr><th>parameter</th><th class=n>before</th><th class=n>after</th><th>location</th></tr>"
    for c in rewritten.changes:
        before = "default" if c.old is None else value_text(c.old)
        values = f"<td class=n>{_e(before)}</td><td class=n>{_e(value_text(c.new))}</td>"
        yield f"<tr><td>{_name(c.name)}</td>{values}<td class=dim>{_name(c.place or 'new line')}</td></tr>"
    yield "</table>"
    if tuning.reverted:
        names = [_with_importance(name, tuning.importance) for name in tuning.reverted]
        yield (
            "<p class=dim>Reverted, because the best trial's value gave the same result as the present one: "
            f"{_e(', '.join(names))}. The importance describes the whole range, including values far from both.</p>"
        )
    limits = [d.name for d in tuning.problem.space if d.robot and d.name in tuning.candidate]
    if limits:
        yield (
            f"<p><b>Check the limits of your robot.</b> {_e(', '.join(limits))}: the simulated robot follows any command; the "
            "real one may not. Give the true limits with <code>--param NAME=LOW:HIGH</code>.</p>"
        )
    if rewritten.overlay_reason:
        yield f"<p>The values are in a separate file, to be loaded last, because {_e(rewritten.overlay_reason)}.</p>"


def _with_importance(name: str, importance: Mapping[str, float]) -> str:
    return f"{name} (importance {importance[name]:.0%})" if name in importance else name


def _comparison(comparison: Comparison, before: str, after: str) -> Iterator[str]:
    yield (
        f"<table><tr><th></th><th class=n>{_e(before)}</th><th class=n>{_e(after)}</th>"
        "<th class=n>difference, 95 % interval</th><th></th></tr>"
    )
    for m in comparison.measures:
        note = " of runs that succeed in both" if m.name in ("time", "clearance", "jerk") else ""
        cells = "".join(f"<td class=n>{_e(text)}</td>" for text in m.texts)
        yield f"<tr><td>{_e(m.label)}<span class=dim>{note}</span></td>{cells}<td>{_e(m.verdict)}</td></tr>"
    runs = f"{len(comparison.cases)} paired runs; the runs of one scenario form a group."
    yield f"</table><p class=dim>{runs}{_few(comparison)}</p>"


def _few(comparison: Comparison) -> str:
    """A comment on intervals that are wide because there are few groups."""
    few = {m.name: m.difference.interval.groups for m in comparison.measures if 0 < m.difference.interval.groups < FEW}
    if not few:
        return ""
    counts = ", ".join(f"{name} {n}" for name, n in few.items())
    return f" <b>Few scenarios ({_e(counts)})</b>: their intervals are wide and say little; tune with more scenarios."


def _fixed_and_broken(tuning: TuningResult, fixed_runs: Sequence[FixedRun]) -> Iterator[str]:
    if fixed_runs:
        yield "<h2>From failure to success</h2>"
    for run in fixed_runs:
        yield f"<p>{_e(run.text)}</p><div class='pair'>"
        for file, word in ((run.before, "before"), (run.after, "after")):
            yield f"<figure><figcaption>{word}</figcaption>{_image(file, f'{run.case}, {word}')}</figure>"
        yield "</div>"
    shown = tuning.validation
    if shown.broken and tuning.found:
        yield f"<p>From success to failure: {_e(', '.join(shown.cases[i].key for i in shown.broken))}.</p>"


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
    yield "<table><tr><th>trial</th>" + "".join(f"<th class=n>{_e(n)}</th>" for n in names) + "<th>values</th></tr>"
    for t in tuning.front:
        cells = "".join(f"<td class=n>{v:.4g}</td>" for v in t.values)
        values = ", ".join(f"{name.rpartition('/')[2]} {value_text(v)}" for name, v in t.candidate.items())
        yield f"<tr><td>{t.number}</td>{cells}<td class=dim>{_name(values)}</td></tr>"
    yield "</table>"


def _search(tuning: TuningResult, charts: Mapping[str, Path]) -> Iterator[str]:
    complete = sum(t.complete for t in tuning.trials)
    yield "<h2>Search</h2>"
    yield f"<p>{len(tuning.trials)} trials: {complete} complete, {len(tuning.trials) - complete} pruned.</p>"
    yield from _chart(charts, "history", "Objective of every trial")
    yield "<table><tr><th>parameter</th><th>range</th><th class=n>before</th><th class=n>best trial</th><th></th></tr>"
    for d in tuning.problem.space:
        present = value_text(d.present) if d.present is not None else "default"
        best = value_text(tuning.best.candidate[d.name]) if tuning.best is not None else ""
        also = f"; with {', '.join(n for n, _ in d.ties)}" if d.ties else ""
        yield (
            f"<tr><td>{_name(d.name)}</td><td>{_e(d.range_text())}</td><td class=n>{_e(present)}</td><td class=n>{_e(best)}</td>"
            f"<td class=dim>{_e(d.meaning + also)}</td></tr>"
        )
    yield "</table>"
    meanings = "; ".join(f"{o.name}: {o.meaning}" for o in tuning.problem.objectives)
    yield f"<p class=dim>{_e(meanings)}.</p>"


def sensitivity_page(found: Sequence[Perturbation], header: ReportHeader, chart: Path) -> Iterator[str]:
    """The lines of the report of a sensitivity analysis."""
    yield from _head(header)
    yield from _origin(header)
    yield f"<p>{_image(chart, 'Difference in the score for each change')}</p>"
    yield "<ol>"
    for one in found:
        yield f"<li>{_e(one.sentence)}</li>"
    yield "</ol>"
    heads = "".join(f"<th class=n>{name}</th>" for name in ("score", "success", "time (s)"))
    yield f"<table><tr><th>parameter</th><th>change</th>{heads}</tr>"
    for one in found:
        cells = "".join(
            f"<td class=n>{_e(_difference_text(one.comparison, name, digits))}</td>"
            for name, digits in (("score", 3), ("success", 2), ("time", 1))
        )
        yield f"<tr><td>{_name(one.dimension.name)}</td><td>{_e(one.what)}</td>{cells}</tr>"
    yield f"</table><p class=dim>{_e(OBJECTIVES['score'].meaning)}.</p></body></html>"


def _difference_text(comparison: Comparison, name: str, digits: int) -> str:
    m = comparison.find(name)
    return m.difference.interval.text(digits) if m is not None else "-"
