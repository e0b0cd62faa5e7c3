"""Openings for a robot with a shape: at which headings it passes, and with how many changes of direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from navstack.core import Costmap, Footprint, Path
from navstack.explain.passages.crossing import CrossingSearch
from navstack.explain.passages.headings import HeadingRange, free_headings
from navstack.explain.passages.report import Passage, Verdict


@dataclass(frozen=True, slots=True)
class ShapePassage:
    """What an opening means for a footprint."""

    headings: tuple[HeadingRange, ...]
    """At which the robot fits with its base between the two obstacles, the widest range first."""
    changes: int | None
    """Changes between forward and backward of the way found through it; None without a turning radius, and without a way."""
    path: Path | None
    """That way."""
    searched: bool
    """Whether a way was searched: with a turning radius only."""
    limited: bool = False
    """Whether no way was found, and a search ended at its limit of poses."""

    @property
    def verdict(self) -> Verdict:
        """Whether the robot passes: from wholly on one side of the opening to wholly on the other.

        `blocked` and the ways of `free` and `turns` are exact; `stuck` may miss a way that needs finer steps than the search.

        `fits`: without a turning radius no way is searched.
        """
        if not self.headings:
            return "blocked"
        if not self.searched:
            return "fits"
        return "stuck" if self.changes is None else "turns" if self.changes else "free"

    def as_dict(self) -> dict[str, Any]:
        """Returns the answer for JSON; headings in radians."""
        return {
            "verdict": self.verdict,
            "headings": [[r.low, r.high] for r in self.headings],
            "changes_of_direction": self.changes,
            "limit_reached": self.limited,
            "path": None if self.path is None else self.path.poses.tolist(),
        }


@dataclass(frozen=True, slots=True)
class Shape:
    """The robot whose passages are asked for."""

    footprint: Footprint
    """With padding."""
    turning_radius: float
    """m; 0: only the headings are computed."""

    def passages(
        self, costmap: Costmap, passages: tuple[Passage, ...], progress: Callable[[int, int], None] | None = None
    ) -> tuple[ShapePassage, ...]:
        """The answers for the passages of a costmap in which all walls are lethal; `progress(done, total)` follows each."""
        search = None
        if self.turning_radius > 0.0:
            search = CrossingSearch(costmap, self.footprint, self.turning_radius)
        found: list[ShapePassage] = []
        for passage in passages:
            headings = free_headings(costmap, self.footprint, passage)
            crossing = search.through(passage, headings) if search is not None and headings else None
            changes, path = (None, None) if crossing is None else (crossing.changes, crossing.path)
            limited = search is not None and crossing is None and bool(headings) and search.limited
            found.append(ShapePassage(headings, changes, path, search is not None, limited))
            if progress is not None:
                progress(len(found), len(passages))
        return tuple(found)
