"""The report of a run as one HTML file: map, goals with their timelines, metrics, possible causes, and a film. No network."""

from __future__ import annotations

import base64
import html
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from navstack.core import OutputError, RecordError, ensure_directory, write_text
from navstack.explain import GoalReport, explain_goals
from navstack.plot import animate_run, circumstances, headline, paper_style, plot_goal_reports, plot_run
from navstack.record import Record, RunMetrics, metrics_of
from navstack.scenario import advice_of
from navstack.studies.table import Column, Table, html_text

FILM_S: Final = 24.0
"""Longest film (s): longer runs are shown faster."""
FILM_SPEED: Final = 4.0
"""Least simulated seconds per second of the film."""
_FILM_FPS: Final = 6.0
_FILM_DPI: Final = 66.0
_COLORS: Final = {"PLANNING": "#F0E442", "CONTROLLING": "#56B4E9", "CLEARING": "#CC79A7", "MOTION": "#009E73"}
_BAD: Final = frozenset({"collision"})
_WARN: Final = frozenset({"plan_failed", "control_failed", "recovery", "warning", "lost", "stuck"})

_STYLE: Final = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 62rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: .5rem 0; } h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; }
p, li { overflow-wrap: anywhere; } .dim { color: #5a5a5a; font-size: .9rem; }
img { display: block; width: 100%; height: auto; } .wide { overflow-x: auto; } .wide img { min-width: 40rem; }
table { border-collapse: collapse; font-size: .9rem; width: 100%; } .scroll { overflow-x: auto; }
td, th { padding: .25rem .8rem .25rem 0; text-align: left; vertical-align: top; } th { border-bottom: 1px solid #888; }
td.n, th.n { text-align: right; white-space: nowrap; } tr:nth-child(even) td { background: #f6f6f6; }
.badge { font-size: .85rem; font-weight: 600; padding: .1rem .5rem; border-radius: .3rem; color: #fff; background: #8a3d00; }
.badge.good { background: #00664a; } .badge.open { background: #555; }
.goal { border: 1px solid #ddd; border-radius: .5rem; padding: .2rem 1rem .8rem; margin: .8rem 0; } .goal h3 { font-size: 1rem; }
.states { display: flex; height: 1rem; border-radius: .2rem; overflow: hidden; background: #eee; }
.key { display: inline-block; width: .8rem; height: .8rem; margin-right: .3rem; border: 1px solid #999; vertical-align: -.05rem; }
.keys span { margin-right: 1rem; white-space: nowrap; } ol.time { list-style: none; padding: 0; margin: .6rem 0; }
ol.time li { display: grid; grid-template-columns: 8.5rem 1fr; gap: .6rem; padding: .2rem 0 .2rem .6rem; }
ol.time li { border-left: 3px solid #ccc; }
ol.time li.warn { border-color: #E69F00; } ol.time li.bad { border-color: #D55E00; } ol.time li.end { border-color: #222; }
ol.time b { font-variant-numeric: tabular-nums; font-weight: 600; } ul.causes { padding-left: 1.2rem; }
@media (max-width: 40rem) { ol.time li { grid-template-columns: 1fr; gap: 0; } td, th { padding-right: .5rem; } }
"""


def write_run_report(
    record: Record,
    path: Path,
    *,
    film: bool = True,
    title: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the report of a run as one HTML file that needs no other file and no network; return the file.

    `film` adds an animation, of at most FILM_S seconds; `progress(done, total)` is called after each of its frames. Raises
    OutputError for a suffix other than .html.
    """
    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"cannot write {path.name}: a report is a .html file", path=str(path))
    ensure_directory(path.parent)
    with tempfile.TemporaryDirectory() as folder:
        pictures = _pictures(record, Path(folder), film=film, progress=progress)
    write_text(path, "\n".join(_page(record, title or headline(record), pictures)) + "\n")
    return path


def _pictures(
    record: Record, folder: Path, *, film: bool, progress: Callable[[int, int], None] | None
) -> dict[str, str]:
    """Return the pictures as data URLs, by name: `run`, `run_narrow` (for a phone), `goals`, `film`."""
    made = {"run": plot_run(record, folder / "run.png", title=headline(record))}
    with paper_style():
        made["run_narrow"] = plot_run(record, folder / "run_narrow.png")
    goals = [g for g in _goals_of(record) if len(g.times) and math.isfinite(g.ended)]
    if goals:
        made["goals"] = plot_goal_reports(goals, folder / "goals.png")
    if film and len(record.times) > 1:
        speed = max(FILM_SPEED, record.duration / FILM_S)
        file = folder / "film.gif"
        made["film"] = animate_run(record, file, fps=_FILM_FPS, speed=speed, dpi=_FILM_DPI, progress=progress)
    return {name: _data_url(file) for name, file in made.items()}


def _goals_of(record: Record) -> tuple[GoalReport, ...]:
    """Return the goals; none of a run by hand."""
    try:
        return explain_goals(record)
    except RecordError:
        return ()


def _data_url(file: Path) -> str:
    return f"data:image/{file.suffix[1:]};base64,{base64.b64encode(file.read_bytes()).decode('ascii')}"


def _page(record: Record, title: str, pictures: Mapping[str, str]) -> Iterator[str]:
    goals = _goals_of(record)
    yield '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>"
    yield f"<h1>{html_text(title)}</h1><p class=dim>{html_text(circumstances(record))}</p>"
    yield from _causes(advice_of(record))
    yield "<h2>Map</h2><picture>"
    yield f'<source media="(max-width: 40rem)" srcset="{pictures["run_narrow"]}">'
    yield f'<img alt="Map, plans, driven path, start and goals" src="{pictures["run"]}"></picture>'
    if goals:
        yield "<h2>Goals</h2>"
        yield from _goals_table(goals)
        yield "<h2>Timeline</h2>"
        yield from _keys(goals)
        for goal in goals:
            yield from _timeline(goal)
    if "goals" in pictures:
        yield "<h2>Distance, velocity and states over time</h2>"
        yield f'<div class=wide><img alt="Distance to the goal, velocity and states over time" src="{pictures["goals"]}"></div>'
    if "film" in pictures:
        yield f'<h2>Film</h2><img alt="Animation of the run" src="{pictures["film"]}">'
        speed = max(FILM_SPEED, record.duration / FILM_S)
        yield f"<p class=dim>{speed:.3g} times as fast as the run.</p>"
    if len(record.times):
        yield "<h2>Metrics</h2>"
        yield from _metrics(metrics_of(record))
    yield "</body></html>"


def _causes(advice: Sequence[str]) -> Iterator[str]:
    if advice:
        yield "<h2>Possible causes</h2><ul class=causes>"
        yield from (f"<li>{html_text(text)}</li>" for text in advice)
        yield "</ul>"


def _badge(goal: GoalReport) -> str:
    kind = "good" if goal.status == "SUCCEEDED" else "" if goal.ended_in_record else "open"
    return f'<span class="badge {kind}">{html.escape(goal.status)}</span>'


def _goals_table(goals: Sequence[GoalReport]) -> Iterator[str]:
    columns = (
        Column("number", "goal"),
        Column("pose", "x, y, yaw", looks="number"),
        Column("state", "state"),
        Column("time", "time (s)", 1),
        Column("plans", "plans"),
        Column("recoveries", "recoveries"),
    )
    rows = [
        {
            "number": goal.number,
            "pose": "-" if goal.pose is None else f"{goal.pose.x:.2f}, {goal.pose.y:.2f}, {goal.pose.yaw:.2f}",
            "state": goal.status,
            "time": goal.duration,
            "plans": len(goal.plan_times),
            "recoveries": len(goal.recoveries),
        }
        for goal in goals
    ]
    yield f"<div class=scroll>{Table('', columns, rows).html()}</div>"


def _keys(goals: Sequence[GoalReport]) -> Iterator[str]:
    """The colors of the states that occur."""
    states = dict.fromkeys(span.state for goal in goals for span in goal.spans)
    shown = [
        f'<span><i class=key style="background:{_COLORS.get(state, "#bbb")}"></i>{html.escape(state.lower())}</span>'
        for state in states
    ]
    yield f'<p class="keys dim">{"".join(shown)}</p>'


def _timeline(goal: GoalReport) -> Iterator[str]:
    """The states of a goal as a bar, and what happened in words."""
    yield f"<section class=goal><h3>Goal {goal.number} {_badge(goal)}</h3><p>{html_text(goal.summary)}</p>"
    parts = [
        f'<i title="{html.escape(span.state.lower())}, {span.end - span.begin:.1f} s" '
        f'style="flex:{max(span.end - span.begin, 1e-3):.3f};background:{_COLORS.get(span.state, "#bbb")}"></i>'
        for span in goal.spans
    ]
    if parts:
        yield f'<div class=states role=img aria-label="states over time">{"".join(parts)}</div>'
    yield "<ol class=time>"
    for entry in goal.timeline:
        tone = "bad" if entry.kind in _BAD else "warn" if entry.kind in _WARN else "end" if entry.kind == "end" else ""
        when = f"{entry.begin:.1f} s"
        if entry.end - entry.begin >= 0.05:
            when = f"{entry.begin:.1f} to {entry.end:.1f} s"
        yield f'<li class="{tone}"><b>{when}</b><span>{html_text(entry.text)}</span></li>'
    yield "</ol></section>"


def _metrics(metrics: RunMetrics) -> Iterator[str]:
    columns = (Column("name", "metric"), Column("value", "value", looks="number"))
    shown = (
        ("goals reached", f"{metrics.succeeded} of {metrics.goals}"),
        ("collisions", str(metrics.collisions)),
        ("recoveries", str(metrics.recoveries)),
        ("time", f"{metrics.time_s:.1f} s"),
        ("path driven", f"{metrics.length_m:.2f} m"),
        ("least clearance", _meters(metrics.clearance_min_m)),
        ("mean clearance", _meters(metrics.clearance_mean_m)),
        ("mean speed in motion", f"{metrics.speed_mean_m_s:.2f} m/s"),
        ("turning in place", f"{metrics.turning_s:.1f} s"),
        ("standing", f"{metrics.standing_s:.1f} s"),
        ("jerk, root mean square", f"{metrics.jerk_rms_m_s3:.2f} m/s³"),
    )
    if metrics.social is not None:
        shown += metrics.social.shown()
    yield f"<div class=scroll>{Table('', columns, [{'name': n, 'value': v} for n, v in shown]).html()}</div>"


def _meters(value: float) -> str:
    return f"{value:.2f} m" if math.isfinite(value) else "-"
