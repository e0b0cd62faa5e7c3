"""The passage report: the doors and corridors of a map that a robot can pass, at what cost."""

from navstack.explain.passages.find import find_passages
from navstack.explain.passages.narrow_places import NarrowPlace, narrow_places
from navstack.explain.passages.report import (
    LABELS,
    RATINGS,
    VERDICT_TEXTS,
    Passage,
    PassageReport,
    Rating,
    RequiredWidths,
)
from navstack.explain.passages.shape import ShapePassage

__all__ = [
    "LABELS",
    "RATINGS",
    "VERDICT_TEXTS",
    "NarrowPlace",
    "Passage",
    "PassageReport",
    "Rating",
    "RequiredWidths",
    "ShapePassage",
    "find_passages",
    "narrow_places",
]
