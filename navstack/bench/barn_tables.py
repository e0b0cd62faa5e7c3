"""Tables of BARN: per world, in total, and against the results of the C++ stack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from navstack.bench.barn import BarnOutcome, BarnWorld
from navstack.bench.csv_reader import read_csv
from navstack.bench.table import Column, Table, mean_of
from navstack.statistics import Difference, mean, paired_difference, paired_share_difference, rank_correlation, share

CppResults = Mapping[int, Mapping[str, Any]]
"""By world: outcome, time_s, length_m, clearance_m, score."""

_WORLD_COLUMNS: Final = (
    Column("world", "world"),
    Column("runs", "runs"),
    Column("success", "success"),
    Column("collision", "collision"),
    Column("other", "other"),
    Column("time_s", "time (s)", 1),
    Column("length_m", "length (m)"),
    Column("clearance_m", "clearance (m)", 3),
    Column("turning_s", "turning (s)", 1),
    Column("score", "score", 4),
)
_CPP_COLUMNS: Final = (
    Column("cpp_outcome", "C++"),
    Column("cpp_time_s", "C++ (s)", 1),
    Column("cpp_score", "C++ score", 4),
)
_TOTAL_COLUMNS: Final = (
    Column("stack", "stack"),
    Column("runs", "runs"),
    Column("success", "success", 3),
    Column("collision", "collision", 3),
    Column("other", "other", 3),
    Column("time_s", "time of successes (s)", 1),
    Column("score", "score", 4),
)
_COMPARISON_COLUMNS: Final = (
    Column("what", "navstack against C++, by world"),
    Column("worlds", "worlds"),
    Column("difference", "difference", 3),
    Column("verdict", "verdict"),
    Column("rank_correlation", "rank correlation"),
)


def read_cpp_results(file: Path) -> CppResults:
    """The results of C++; empty without the file. Raises InputError."""
    if not file.is_file():
        return {}
    return dict(read_csv(file, ("world", "outcome", "AT", "length", "clearance", "score"), _cpp_row))


def _cpp_row(row: Mapping[str, str]) -> tuple[int, Mapping[str, Any]]:
    result = {
        "outcome": row["outcome"],
        "time_s": float(row["AT"]),
        "length_m": float(row["length"]),
        "clearance_m": float(row["clearance"]),
        "score": float(row["score"]),
    }
    return int(row["world"]), result


def worlds_table(worlds: Mapping[int, BarnWorld], outcomes: Sequence[BarnOutcome], cpp: CppResults) -> Table:
    """A row per world, in the order of the outcomes."""
    numbers = dict.fromkeys(o.world for o in outcomes)
    rows = [_world_row(worlds[w], [o for o in outcomes if o.world == w], cpp.get(w)) for w in numbers]
    return Table("worlds", (*_WORLD_COLUMNS, *_CPP_COLUMNS) if cpp else _WORLD_COLUMNS, rows)


def _world_row(world: BarnWorld, outcomes: Sequence[BarnOutcome], cpp: Mapping[str, Any] | None) -> dict[str, Any]:
    won = [o for o in outcomes if o.succeeded]
    row: dict[str, Any] = {
        "world": world.number,
        "optimal_time_s": world.optimal_time_s,
        "runs": len(outcomes),
        "success": len(won),
        "collision": sum(o.outcome == "collision" for o in outcomes),
        "other": sum(o.outcome not in ("success", "collision") for o in outcomes),
        "time_s": mean_of([o.time_s for o in won]),
        "length_m": mean_of([o.length_m for o in won]),
        "clearance_m": min(o.clearance_m for o in outcomes),
        "turning_s": mean_of([o.turning_s for o in outcomes]),
        "score": mean_of([o.score for o in outcomes]),
    }
    if cpp is not None:
        row |= {"cpp_outcome": cpp["outcome"], "cpp_score": cpp["score"]}
        row["cpp_time_s"] = cpp["time_s"] if cpp["outcome"] == "success" else None
    return row


def totals_table(outcomes: Sequence[BarnOutcome], cpp: CppResults) -> Table:
    """A row for navstack and, if its results are known, one for C++."""
    rows = [_total_row("navstack", outcomes)]
    if cpp:
        theirs = [
            BarnOutcome(w, r["outcome"], r["time_s"], r["length_m"], r["clearance_m"], r["score"], 0.0)
            for w, r in cpp.items()
        ]
        rows.append(_total_row("C++", theirs))
    return Table("totals, with 95 % confidence intervals over worlds", _TOTAL_COLUMNS, rows)


def _total_row(stack: str, outcomes: Sequence[BarnOutcome]) -> dict[str, Any]:
    """Shares and means over the worlds; the time is that of the successes."""
    worlds = [o.world for o in outcomes]
    won = [o for o in outcomes if o.succeeded]
    return {
        "stack": stack,
        "runs": len(outcomes),
        "success": share([o.succeeded for o in outcomes], worlds),
        "collision": share([o.outcome == "collision" for o in outcomes], worlds),
        "other": share([o.outcome not in ("success", "collision") for o in outcomes], worlds),
        "time_s": mean([o.time_s for o in won], [o.world for o in won]),
        "score": mean([o.score for o in outcomes], worlds),
    }


def cpp_comparison_table(rows: Sequence[Mapping[str, Any]], outcomes: Sequence[BarnOutcome], cpp: CppResults) -> Table:
    """The differences navstack minus C++, paired by world; `rows` are those of `worlds_table`."""
    both = [row for row in rows if row["world"] in cpp]
    won = [row for row in both if row["cpp_time_s"] is not None and row["success"] > 0]
    runs = [o for o in outcomes if o.world in cpp]
    success = paired_share_difference(
        [cpp[o.world]["outcome"] == "success" for o in runs], [o.succeeded for o in runs], [o.world for o in runs]
    )
    theirs = [float(r["cpp_outcome"] == "success") for r in both]
    compared = [
        _comparison_row("success", success, theirs, [r["success"] / r["runs"] for r in both]),
        _paired_row("score", [r["cpp_score"] for r in both], [r["score"] for r in both]),
        _paired_row("time, both succeed (s)", [cpp[r["world"]]["time_s"] for r in won], [r["time_s"] for r in won]),
        _paired_row(
            "length, both succeed (m)", [cpp[r["world"]]["length_m"] for r in won], [r["length_m"] for r in won]
        ),
    ]
    return Table("navstack minus C++, paired by world", _COMPARISON_COLUMNS, compared)


def _paired_row(what: str, theirs: Sequence[float], ours: Sequence[float]) -> dict[str, Any]:
    return _comparison_row(what, paired_difference(theirs, ours), theirs, ours)


def _comparison_row(
    what: str, difference: Difference, theirs: Sequence[float], ours: Sequence[float]
) -> dict[str, Any]:
    return {
        "what": what,
        "worlds": len(ours),
        "difference": difference,
        "verdict": difference.verdict,
        "rank_correlation": rank_correlation(theirs, ours),
    }
