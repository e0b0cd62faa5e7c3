"""Tables of a comparison of controllers: a row per suite and controller, and times against the first controller."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final, get_args

from navstack.bench.contact_causes import UNEXPLAINED, Cause
from navstack.bench.controllers_bench import MeasuredRun
from navstack.bench.table import Column, Table
from navstack.statistics import Interval, mean, paired_difference, rate, share

COLUMNS: Final = (
    Column("suite", "suite"),
    Column("controller", "controller"),
    Column("runs", "runs"),
    Column("success", "success", 2),
    Column("time_s", "time (s)", 1),
    Column("clearance_min_m", "min. clearance (m)", 3),
    Column("jerk_rms_m_s3", "jerk, rms (m/s³)", 2),
    Column("contacts", "contacts"),
    Column("contacts_per_hour", "contacts per hour", 1),
    Column("avoidable_per_hour", "avoidable per hour", 1),
    Column("cycle_p50_ms", "cycle, median (ms)", 3),
    Column("cycle_p99_ms", "cycle, p99 (ms)", 3),
)
_SCORE: Final = Column("score", "score", 3)
_DIFFERENCE_COLUMNS: Final = (
    Column("suite", "suite"),
    Column("controller", "controller"),
    Column("pairs", "pairs"),
    Column("first_s", "time of the first (s)", 1),
    Column("time_s", "time (s)", 1),
    Column("difference", "difference (s)", 1),
    Column("verdict", "verdict"),
)


def all_tables(runs: Sequence[MeasuredRun]) -> list[Table]:
    """The tables to show: all measures; if there are any, times against the first controller, causes of contacts, failures."""
    tables = [controllers_table(runs)]
    if len({run.controller for run in runs}) > 1:
        tables.append(differences_table(runs))
    return [*tables, *(table for table in (causes_table(runs), failures_table(runs)) if table is not None)]


def controllers_table(runs: Sequence[MeasuredRun]) -> Table:
    """A row per suite and controller, with confidence intervals over scenarios.

    Time, clearance and jerk are of the scenarios and seeds in which every controller succeeds; the rest is of all runs.
    """
    scored = any(run.values["score"] is not None for run in runs)
    columns = (*COLUMNS[:4], _SCORE, *COLUMNS[4:]) if scored else COLUMNS
    rows: list[dict[str, Any]] = []
    for suite in dict.fromkeys(run.group for run in runs):
        mine = [run for run in runs if run.group == suite]
        common = common_cases(mine)
        rows += [
            _row(suite, name, [run for run in mine if run.controller == name], common)
            for name in dict.fromkeys(run.controller for run in mine)
        ]
    return Table("controllers, with 95 % confidence intervals over scenarios", columns, rows)


def common_cases(runs: Sequence[MeasuredRun]) -> set[tuple[str, int]]:
    """The scenarios and seeds in which every controller has a run, and succeeds."""
    names = {run.controller for run in runs}
    successes: dict[tuple[str, int], set[str]] = {}
    for run in runs:
        if run.values["success"]:
            successes.setdefault((run.scenario, run.seed), set()).add(run.controller)
    return {case for case, by in successes.items() if by == names}


def _row(suite: str, name: str, runs: Sequence[MeasuredRun], common: set[tuple[str, int]]) -> dict[str, Any]:
    groups = [run.scenario for run in runs]
    compared = [run for run in runs if (run.scenario, run.seed) in common]
    contacts = [int(run.values["contacts"]) for run in runs]
    hours = [run.values["simulated_s"] / 3600.0 for run in runs]
    row: dict[str, Any] = {
        "suite": suite,
        "controller": name,
        "runs": len(runs),
        "compared": len(compared),
        "success": share([bool(run.values["success"]) for run in runs], groups),
        "contacts": sum(contacts),
        "contacts_per_hour": rate(contacts, hours, groups),
        "avoidable_per_hour": rate([_causes(run)[UNEXPLAINED] for run in runs], hours, groups),
        "simulated_h": math.fsum(hours),
        "recoveries": sum(int(run.values["recoveries"]) for run in runs),
    }
    for key in ("time_s", "clearance_min_m", "jerk_rms_m_s3"):
        row[key] = _mean(compared, key)
    for key in ("cycle_p50_ms", "cycle_p99_ms"):
        row[key] = _mean(runs, key)
    row["score"] = _mean(runs, "score") if runs[0].values["score"] is not None else None
    return row


def _mean(runs: Sequence[MeasuredRun], key: str) -> Interval:
    """The mean of the finite values, with an interval over scenarios."""
    used = [run for run in runs if isinstance(run.values[key], (int, float)) and math.isfinite(run.values[key])]
    return mean([float(run.values[key]) for run in used], [run.scenario for run in used])


def differences_table(runs: Sequence[MeasuredRun]) -> Table:
    """The times of each controller minus those of the first one, over the runs in which both succeed."""
    names = list(dict.fromkeys(run.controller for run in runs))
    first, *others = names
    found = {(r.controller, r.group, r.scenario, r.seed): r.values for r in runs if r.values["success"]}
    rows: list[dict[str, Any]] = []
    for suite in dict.fromkeys(run.group for run in runs):
        for name in others:
            cases = [(s, seed) for who, g, s, seed in found if who == name and g == suite]
            cases = [case for case in cases if (first, suite, *case) in found]
            a = [float(found[first, suite, *case]["time_s"]) for case in cases]
            b = [float(found[name, suite, *case]["time_s"]) for case in cases]
            groups = [scenario for scenario, _ in cases]
            difference = paired_difference(a, b, groups)
            rows.append(
                {
                    "suite": suite,
                    "controller": name,
                    "pairs": len(cases),
                    "first_s": mean(a, groups),
                    "time_s": mean(b, groups),
                    "difference": difference,
                    "verdict": {"higher": "slower", "lower": "faster"}.get(difference.verdict, difference.verdict),
                }
            )
    return Table(f"times against {first}, of the runs in which both succeed", _DIFFERENCE_COLUMNS, rows)


def causes_table(runs: Sequence[MeasuredRun]) -> Table | None:
    """Contacts by cause, a row per suite and controller that has any; None without contacts."""
    rows: list[dict[str, Any]] = []
    for suite, name in dict.fromkeys((run.group, run.controller) for run in runs):
        found = sum((_causes(run) for run in runs if (run.group, run.controller) == (suite, name)), Counter())
        if found:
            rows.append({"suite": suite, "controller": name, **{cause: found[cause] for cause in get_args(Cause)}})
    if not rows:
        return None
    causes: tuple[str, ...] = get_args(Cause)
    headings: dict[str, str] = {UNEXPLAINED: "avoidable"}
    columns = [Column("suite", "suite"), Column("controller", "controller")]
    columns += [Column(cause, headings.get(cause, cause)) for cause in causes]
    return Table("contacts by cause", columns, rows)


def _causes(run: MeasuredRun) -> Counter[Cause]:
    return Counter(run.values["causes"])


def failures_table(runs: Sequence[MeasuredRun]) -> Table | None:
    """A row per run without success; None if all succeed."""
    rows = [
        {
            "suite": run.group,
            "scenario": run.scenario,
            "seed": run.seed,
            "controller": run.controller,
            "recoveries": run.values["recoveries"],
            "ended": run.values["ended"],
        }
        for run in runs
        if not run.values["success"]
    ]
    if not rows:
        return None
    columns = [Column(key, key) for key in ("suite", "scenario", "seed", "controller", "recoveries", "ended")]
    return Table("runs without success", columns, rows)


def controllers_notes(runs: Sequence[MeasuredRun], period_s: float) -> list[str]:
    """What to consider when reading the tables."""
    notes = [
        "time, clearance and jerk are of the scenarios in which every controller succeeds; contacts and cycles are of all runs",
        "avoidable contacts: with something that the robot saw, after a command that was worse than a stop",
        f"jerk is measured at {period_s:g} s for any control frequency",
        "a cycle is processor time of the local planner's compute_command on this machine",
    ]
    for suite in dict.fromkeys(run.group for run in runs):
        mine = [run for run in runs if run.group == suite]
        many, all_ = len(common_cases(mine)), len({(run.scenario, run.seed) for run in mine})
        if many < all_:
            notes.append(f"{suite}: every controller succeeds in {many} of {all_}")
    return notes
