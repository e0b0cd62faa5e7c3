"""Tables of results: the same rows for the terminal, for Markdown and for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from navstack.statistics import Correlation, Difference, Interval

DIGITS = "_digits"
"""Key of a row that overrides the number of digits of its columns."""


class Column(NamedTuple):
    """One column of a table."""

    key: str
    """Key of the value in a row."""
    head: str
    digits: int = 2
    """Decimal places of floats."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of named values, and the columns to show."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Mapping[str, Any]]

    def texts(self) -> list[list[str]]:
        """The texts of the cells, row by row."""
        return [[text_of(row.get(c.key), row.get(DIGITS, c.digits)) for c in self.columns] for row in self.rows]

    def is_numeric(self, column: int) -> bool:
        """True for a column without text, which is right-aligned."""
        values = [row.get(self.columns[column].key) for row in self.rows]
        return not any(isinstance(v, str) for v in values)

    def markdown(self) -> str:
        """The table in GitHub's Markdown, below its title in bold."""
        # a bar or a newline in a cell would start another cell
        texts = ([text.replace("|", "\\|").replace("\n", " ") for text in row] for row in self.texts())
        cells = [[c.head for c in self.columns], *texts]
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        right = [self.is_numeric(i) for i in range(len(self.columns))]
        lines = [
            "| "
            + " | ".join(t.rjust(w) if r else t.ljust(w) for t, w, r in zip(row, widths, right, strict=True))
            + " |"
            for row in cells
        ]
        rule = "|" + "|".join("-" * (w + 1) + (":" if r else "-") for w, r in zip(widths, right, strict=True)) + "|"
        return "\n".join([f"**{self.title}**", "", lines[0], rule, *lines[1:]]) + "\n"


def text_of(value: Any, digits: int = 2) -> str:
    """The text of a cell; a dash for None and NaN."""
    if value is None:
        return "-"
    if isinstance(value, (Interval, Difference)):
        return (value if isinstance(value, Interval) else value.interval).text(digits)
    if isinstance(value, Correlation):
        return Interval(value.rho, value.low, value.high, value.pairs).text(digits)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        if math.isnan(value):
            return "-"
        return f"{value:,.{digits}f}"
    return str(value)


def as_json(value: Any) -> Any:
    """Rows, intervals and tables as JSON values."""
    if isinstance(value, (Interval, Difference, Correlation)):
        return value.as_dict()
    if isinstance(value, Table):
        return [{k: as_json(v) for k, v in row.items() if k != DIGITS} for row in value.rows]
    if isinstance(value, Mapping):
        return {str(k): as_json(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_json(v) for v in value]
    return value


def mean_of(values: Sequence[float]) -> float:
    """The arithmetic mean; NaN for no values."""
    return math.fsum(values) / len(values) if values else math.nan
