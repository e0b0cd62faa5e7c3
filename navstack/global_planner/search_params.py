"""The parameters that all planners that search have in common."""

from __future__ import annotations

from navstack.core.parameters import ParamModel, param
from navstack.global_planner.departure import StartPolicy


class SearchParams(ParamModel):
    """Where a search may begin and end, and how long it may go on."""

    default_tolerance: float = param(
        0.0,
        "half the side of the square around the goal in which the nearest reachable point will do",
        unit="m",
        ge=0.0,
    )
    start_policy: StartPolicy = param(
        "clear_cell",
        "when the start is blocked: take its cell for free (as C++), all cells under the footprint, begin at the nearest free "
        "cell, or refuse",
    )
    max_expansions: int = param(
        0,
        "cells a search may expand before it gives up (TIMEOUT); 0 = as many as there are. Counted, not timed: the same query "
        "has the same answer on every machine",
        ge=0,
    )

    @property
    def most(self) -> int:
        """`max_expansions`, a number in any case."""
        return self.max_expansions or 1 << 62
