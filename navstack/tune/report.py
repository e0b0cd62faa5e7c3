"""The report of a tuning: one HTML file with everything in it, and the same pictures as PNG."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navstack.core.errors import NavError
from navstack.core.files import ensure_directory, write_text
from navstack.plot import plot_run
from navstack.tune import charts
from navstack.tune.comparison import Comparison
from navstack.tune.layout import Written
from navstack.tune.objectives import OBJECTIVES
from navstack.tune.sensitivity import Step
from navstack.tune.session import Tuning
from navstack.tune.space import value_of
from navstack.tune.work import RunInput, RunWork

MOST_RUNS = 4
"""So many runs that changed from failure to success are drawn."""

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
table { border-collapse: collapse; font-size: 0.9rem; } td, th { padding: 0.2rem 0.8rem 0.2rem 0; text-align: left; }
th { border-bottom: 1px solid #888; } td.n, th.n { text-align: right; } tr:nth-child(even) td { background: #f6f6f6; }
.verdict { font-size: 1.1rem; border-left: 4px solid #0072B2; padding: 0.4rem 0 0.4rem 1rem; }
.nothing { border-color: #E69F00; } .dim { color: #666; } code { font-size: 0.9em; }
img { max-width: 100%; } .pair { display: flex; gap: 1rem; flex-wrap: wrap; } .pair figure { flex: 1 1 20rem; margin: 0; }
figcaption { font-size: 0.85rem; color: #444; }
"""


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What the report says about where it comes from."""

    title: str
    params: str
    command: str
    how: str
    """Cases, trials, sampler, seed: a sentence."""
    against: str = ""
    """Name of the parameters that the tuned ones are compared with."""


@dataclass(frozen=True, slots=True)
class MendedRun:
    """Pictures of a run before and after."""

    case: str
    before: Path
    after: Path
    text: str


def draw_mended(tuning: Tuning, work: RunWork, held_out: RunWork | None, folder: Path) -> list[MendedRun]:
    """Runs that changed from failure to success, driven once more with a record; held-out ones first."""
    found: list[MendedRun] = []
    overrides = tuple(tuning.problem.space.overrides(tuning.candidate))
    for name, comparison, by in (("held_out", tuning.held_out, held_out), ("training", tuning.training, work)):
        if comparison is None or by is None:
            continue
        for i in comparison.mended:
            if len(found) == MOST_RUNS:
                return found
            case = comparison.cases[i]
            files: list[Path] = []
            for word, given in (("before", ()), ("after", overrides)):
                recorder = by.drive(RunInput(given, case), record=True)[1]
                if recorder is None:
                    break
                path = folder / f"mended_{len(found) + 1}_{word}.png"
                try:
                    files.append(plot_run(recorder.record(), path, dpi=90.0))
                except NavError:
                    break
            if len(files) == 2:
                ended = comparison.before[i]
                why = f"{ended['outcome']}{': ' + ended['text'] if ended['text'] else ''}"
                place = "held-out" if name == "held_out" else "training"
                text = f"{case.key} ({place}): before, {why}; after, success in {comparison.after[i]['time_s']:.1f} s"
                found.append(MendedRun(case.key, files[0], files[1], text))
    return found


def write_report(
    folder: Path,
    tuning: Tuning,
    about: Circumstances,
    written: Written | None,
    mended: Sequence[MendedRun] = (),
) -> Path:
    """Draws the charts into `folder` and writes `report.html` there; its path."""
    ensure_directory(folder)
    figures = charts.figures_of(tuning, folder, about.against)
    path = folder / "report.html"
    write_text(path, "\n".join(_document(tuning, about, written, figures, mended)) + "\n")
    return path


def write_why(folder: Path, steps: Sequence[Step], about: Circumstances) -> Path:
    """The report of `--why`; its path."""
    ensure_directory(folder)
    picture = charts.sensitivities(steps, folder / "why.png")
    path = folder / "why.html"
    write_text(path, "\n".join(_why_document(steps, about, picture)) + "\n")
    return path


# --- HTML -------------------------------------------------------------------------------------------------------------


def _e(text: object) -> str:
    return html.escape(str(text))


def _head(about: Circumstances) -> Iterator[str]:
    yield "<!DOCTYPE html>"
    yield '<html lang="en"><head><meta charset="utf-8">'
    yield f"<title>{_e(about.title)}</title><style>{_STYLE}</style></head><body>"
    yield f"<h1>{_e(about.title)}</h1>"


def _document(
    tuning: Tuning,
    about: Circumstances,
    written: Written | None,
    figures: Mapping[str, Path],
    mended: Sequence[MendedRun],
) -> Iterator[str]:
    yield from _head(about)
    yield f'<p class="verdict{"" if tuning.found else " nothing"}">{_e(tuning.verdict)}</p>'
    yield f"<p>{_e(about.how)}</p><p><code>{_e(about.command)}</code></p>"
    if written is not None and written.changes:
        yield from _changes(tuning, written)
    if tuning.held_out is not None:
        yield "<h2>Held-out runs, which tuning has not seen</h2>"
        yield from _comparison(tuning.held_out, "before", "tuned")
        yield from _picture(figures, "held_out", "Time of each held-out run before and after")
    if tuning.against is not None:
        yield f"<h2>Beside {_e(about.against)}</h2>"
        yield from _comparison(tuning.against, about.against, "tuned")
        yield from _picture(figures, "against", f"Time of each run with {about.against} and with the tuned parameters")
    yield "<h2>Training runs</h2>"
    yield from _comparison(tuning.training, "before", "tuned")
    yield from _picture(figures, "training", "Time of each training run before and after")
    if mended:
        yield "<h2>From failure to success</h2>"
        for run in mended:
            yield f"<p>{_e(run.text)}</p><div class='pair'>"
            for file, word in ((run.before, "before"), (run.after, "after")):
                yield f"<figure><figcaption>{word}</figcaption>{_image(file, f'{run.case}, {word}')}</figure>"
            yield "</div>"
    broken = (tuning.held_out or tuning.training).broken
    if broken and tuning.found:
        cases = (tuning.held_out or tuning.training).cases
        yield f"<p>From success to failure: {_e(', '.join(cases[i].key for i in broken))}.</p>"
    yield "<h2>Which parameters mattered</h2>"
    if tuning.importance:
        yield from _picture(figures, "importance", "Importance of each parameter")
        yield from _picture(figures, "slices", "Score of the trials against the six most important parameters")
    else:
        yield "<p>There were too few trials to tell.</p>"
    objectives = tuning.problem.objectives
    yield "<h2>" + ("Pareto front" if len(objectives) > 1 else "Time against clearance") + "</h2>"
    yield from _picture(figures, "pareto", "Trials by two objectives")
    if len(objectives) > 1:
        yield from _front(tuning)
    yield "<h2>The search</h2>"
    whole = sum(t.complete for t in tuning.trials)
    yield f"<p>{len(tuning.trials)} trials, {whole} driven over every case, {len(tuning.trials) - whole} given up early.</p>"
    yield from _picture(figures, "history", "Every trial")
    yield from _space(tuning)
    yield "</body></html>"


def _image(path: Path, alt: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{_e(alt)}" src="data:image/png;base64,{data}">'


def _picture(figures: Mapping[str, Path], name: str, alt: str) -> Iterator[str]:
    if name in figures:
        yield f"<p>{_image(figures[name], alt)}</p>"


def _changes(tuning: Tuning, written: Written) -> Iterator[str]:
    yield "<h2>What was changed</h2><table><tr><th>parameter</th><th class=n>before</th><th class=n>after</th><th>in</th></tr>"
    for c in written.changes:
        before = "default" if c.old is None else value_of(c.old)
        where = c.place or "a new line"
        values = f"<td class=n>{_e(before)}</td><td class=n>{_e(value_of(c.new))}</td>"
        yield f"<tr><td>{_e(c.name)}</td>{values}<td class=dim>{_e(where)}</td></tr>"
    yield "</table>"
    if tuning.set_back:
        yield f"<p class=dim>Made no difference, so they stayed as they were: {_e(', '.join(tuning.set_back))}.</p>"
    robots = [d.name for d in tuning.problem.space if d.robot and d.name in tuning.candidate]
    if robots:
        yield (
            f"<p><b>Can your robot do that?</b> {_e(', '.join(robots))} say what the robot is able to; the simulated one "
            "does whatever it is told. Give the true limits by <code>--param NAME=LOW:HIGH</code>.</p>"
        )
    if written.why_overlay:
        yield f"<p>The values stand in a file of their own, to be loaded last, since {_e(written.why_overlay)}.</p>"


def _comparison(comparison: Comparison, before: str, after: str) -> Iterator[str]:
    yield (
        f"<table><tr><th></th><th class=n>{_e(before)}</th><th class=n>{_e(after)}</th>"
        "<th class=n>difference, 95 % interval</th><th></th></tr>"
    )
    for m in comparison.measures:
        digits = 1 if m.unit == "s" else 3
        unit = f" ({m.unit})" if m.unit else ""
        note = " of runs that succeed both times" if m.name in ("time", "clearance", "jerk") else ""
        yield (
            f"<tr><td>{_e(m.name)}{_e(unit)}<span class=dim>{note}</span></td><td class=n>{_e(m.before.text(digits))}</td>"
            f"<td class=n>{_e(m.after.text(digits))}</td><td class=n>{_e(m.difference.interval.text(digits))}</td>"
            f"<td>{_e(m.verdict)}</td></tr>"
        )
    yield f"</table><p class=dim>{len(comparison.cases)} runs, paired; runs of one scenario count as one.</p>"


def _front(tuning: Tuning) -> Iterator[str]:
    names = [o.name for o in tuning.problem.objectives]
    yield "<table><tr><th>trial</th>" + "".join(f"<th class=n>{_e(n)}</th>" for n in names) + "<th>values</th></tr>"
    for t in tuning.front:
        cells = "".join(f"<td class=n>{v:.4g}</td>" for v in t.values)
        values = ", ".join(f"{name.rpartition('/')[2]} {value_of(v)}" for name, v in t.candidate.items())
        yield f"<tr><td>{t.number}</td>{cells}<td class=dim>{_e(values)}</td></tr>"
    yield "</table>"


def _space(tuning: Tuning) -> Iterator[str]:
    yield "<table><tr><th>searched</th><th>range</th><th class=n>before</th><th class=n>best trial</th><th></th></tr>"
    for d in tuning.problem.space:
        present = value_of(d.present) if d.present is not None else "default"
        best = value_of(tuning.best.candidate[d.name]) if tuning.best is not None else ""
        also = f"; with {', '.join(n for n, _ in d.ties)}" if d.ties else ""
        yield (
            f"<tr><td>{_e(d.name)}</td><td>{_e(d.range_text())}</td><td class=n>{_e(present)}</td><td class=n>{_e(best)}</td>"
            f"<td class=dim>{_e(d.meaning + also)}</td></tr>"
        )
    yield "</table>"
    meanings = "; ".join(f"{o.name}: {o.meaning}" for o in tuning.problem.objectives)
    yield f"<p class=dim>{_e(meanings)}.</p>"


def _why_document(steps: Sequence[Step], about: Circumstances, picture: Path) -> Iterator[str]:
    yield from _head(about)
    yield f"<p>{_e(about.how)}</p><p><code>{_e(about.command)}</code></p>"
    yield f"<p>{_image(picture, 'difference in the score of each step')}</p>"
    yield "<ol>"
    for step in steps:
        yield f"<li>{_e(step.sentence)}</li>"
    yield "</ol>"
    yield "<table><tr><th>parameter</th><th></th><th class=n>score</th><th class=n>success</th><th class=n>time (s)</th></tr>"
    for step in steps:
        cells: list[str] = []
        for name, digits in (("score", 3), ("success", 2), ("time", 1)):
            m = next((m for m in step.comparison.measures if m.name == name), None)
            cells.append(f"<td class=n>{_e(m.difference.interval.text(digits)) if m else '-'}</td>")
        yield f"<tr><td>{_e(step.dimension.name)}</td><td>{_e(step.what)}</td>{''.join(cells)}</tr>"
    yield f"</table><p class=dim>{_e(OBJECTIVES['score'].meaning)}.</p></body></html>"


def tuning_as_dict(tuning: Tuning) -> dict[str, Any]:
    """Everything of a tuning that is not in its study, for JSON."""
    return {
        "found": tuning.found,
        "verdict": tuning.verdict,
        "trials": len(tuning.trials),
        "best_trial": tuning.best.number if tuning.best is not None else None,
        "values": dict(tuning.candidate),
        "set_back": list(tuning.set_back),
        "importance": tuning.importance,
        "front": [{"trial": t.number, "values": list(t.values), "candidate": t.candidate} for t in tuning.front],
        "objectives": [o.name for o in tuning.problem.objectives],
        "training": tuning.training.as_dict(),
        "held_out": tuning.held_out.as_dict() if tuning.held_out is not None else None,
        "against": tuning.against.as_dict() if tuning.against is not None else None,
    }
