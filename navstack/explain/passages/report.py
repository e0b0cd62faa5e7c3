"""The passages of a map and the widths that a robot requires. Lengths in metres, coordinates in the map frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from navstack.core import Costmap, Footprint

if TYPE_CHECKING:
    from navstack.explain.passages.shape import ShapePassage

Rating = Literal["free", "costly", "blocked"]
RATINGS: tuple[Rating, ...] = ("free", "costly", "blocked")
LABELS: dict[Rating, str] = {"free": "passable", "costly": "at high cost", "blocked": "not passable"}

Verdict = Literal["free", "turns", "fits", "stuck", "blocked"]
VERDICT_TEXTS: dict[Verdict, str] = {
    "free": "passable",
    "turns": "passable with changes of direction",
    "fits": "the robot fits",
    "stuck": "fits, no way found",
    "blocked": "not passable",
}

HIGH_COST = 126
"""Cells from this cost on are of high cost: half of the largest inflated cost (252)."""


@dataclass(frozen=True, slots=True)
class Passage:
    """A door, the narrowest part of a corridor, or the gap between two obstacles."""

    x: float
    """x of the centre."""
    y: float
    """y of the centre."""
    ends: tuple[tuple[float, float], tuple[float, float]]
    """Centres of the two obstacle cells on either side."""
    width: float
    """Free width: distance between the ends minus one cell; accurate to one cell."""
    length: float
    """Length of the part that is equally narrow, within one cell; 0 for a door in a thin wall."""
    obstacle: float
    """Size of the smaller of the two obstacles: the longer side of its box, with the obstacles closer to it than this width."""
    cost: int
    """Lowest cost at which the robot's centre can pass."""
    clearance: float
    """Distance from the cell of that cost to the nearer end, centre to centre."""
    rating: Rating
    fits: bool
    """True if the unpadded footprint is narrower than the passage."""
    can_turn: bool
    """True if the circumscribed circle is narrower than the passage."""
    reason: str
    """The cause of the rating: clearance of the centreline, and what it means for the robot."""

    def as_dict(self) -> dict[str, Any]:
        """Returns the passage for JSON."""
        return {
            "at": [self.x, self.y],
            "ends": [list(end) for end in self.ends],
            "width_m": self.width,
            "length_m": self.length,
            "obstacle_m": self.obstacle,
            "cost": self.cost,
            "clearance_m": self.clearance,
            "rating": self.rating,
            "fits": self.fits,
            "can_turn": self.can_turn,
            "reason": self.reason,
        }


@dataclass(frozen=True, slots=True)
class RequiredWidths:
    """Widths between straight walls along the grid that a robot requires, in whole cells."""

    minimum: float
    """Narrowest passage whose centreline is not inscribed."""
    low_cost: float
    """Narrowest passage whose centreline costs less than `HIGH_COST`."""
    robot: float
    """Width of the robot: twice the inscribed radius of the unpadded footprint."""
    turning: float
    """Twice the circumscribed radius: the width for a turn in place."""

    def as_dict(self) -> dict[str, Any]:
        """Returns the widths for JSON."""
        return {
            "minimum_m": self.minimum,
            "low_cost_m": self.low_cost,
            "robot_m": self.robot,
            "turning_m": self.turning,
        }


@dataclass(frozen=True, slots=True, eq=False)
class PassageReport:
    """All passages of a map for one robot, the narrowest first."""

    passages: tuple[Passage, ...]
    widths: RequiredWidths
    costmap: Costmap
    """The inflated map in which the passages were rated."""
    costmap_name: str
    inscribed_radius: float
    """With padding."""
    circumscribed_radius: float
    """With padding."""
    inflation_radius: float
    """0 without an inflation layer."""
    narrowest: float
    """Lower limit of the searched widths."""
    widest: float
    """Upper limit of the searched widths."""
    narrower: int
    """Number of openings that are left out because they are narrower than `narrowest`."""
    smallest_obstacle: float
    """Lower limit of `Passage.obstacle`."""
    unknown_border: float
    """Share of unknown cells among the cells that border free space."""
    footprint: Footprint
    """With padding."""
    turning_radius: float = 0.0
    """m; 0 without one."""
    shapes: tuple[ShapePassage, ...] | None = None
    """For each passage what it means for the footprint; None for a round robot."""

    def count(self, rating: Rating) -> int:
        """Number of passages with this rating."""
        return sum(passage.rating == rating for passage in self.passages)

    @property
    def shape_counts(self) -> dict[Verdict, int]:
        """Number of passages by what they mean for the footprint; empty for a round robot."""
        verdicts = [shape.verdict for shape in self.shapes or ()]
        return {verdict: verdicts.count(verdict) for verdict in VERDICT_TEXTS} if self.shapes is not None else {}

    def as_dict(self) -> dict[str, Any]:
        """Returns the report for JSON, without the costmap."""
        return {
            "costmap": self.costmap_name,
            "inscribed_radius_m": self.inscribed_radius,
            "circumscribed_radius_m": self.circumscribed_radius,
            "inflation_radius_m": self.inflation_radius,
            "narrowest_m": self.narrowest,
            "widest_m": self.widest,
            "narrower": self.narrower,
            "smallest_obstacle_m": self.smallest_obstacle,
            "unknown_border": self.unknown_border,
            "required_widths": self.widths.as_dict(),
            "counts": {rating: self.count(rating) for rating in RATINGS},
            "footprint": None if self.footprint.is_round else self.footprint.vertices.tolist(),
            "turning_radius_m": self.turning_radius,
            "footprint_counts": self.shape_counts,
            "passages": [
                passage.as_dict() if shape is None else {**passage.as_dict(), "footprint": shape.as_dict()}
                for passage, shape in zip(self.passages, self.shapes or [None] * len(self.passages), strict=True)
            ],
        }
