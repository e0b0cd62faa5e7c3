"""Tables of results: the same rows for the terminal, Markdown, HTML and JSON."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

from navstack.core import Correlation, Difference, Interval

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

DIGITS = "_digits"
"""Key of a row that overrides the number of digits of its columns."""
_MIN_WIDTH: Final = 400
"""Least width of a printed table (columns)."""


class Column(NamedTuple):
    """One column of a table."""

    key: str
    """Key of the value in a row."""
    head: str
    digits: int = 2
    """Decimal places of floats."""
    looks: Literal["", "number", "name", "faint"] = ""
    """`number`: texts that are numbers, aligned at the right; `name`: divided on pages where needed; `faint`: a remark."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of named values, and the columns to show."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Mapping[str, Any]]

    def texts(self) -> list[list[str]]:
        """Return the texts of the cells, row by row."""
        return [[text_of(row.get(c.key), row.get(DIGITS, c.digits)) for c in self.columns] for row in self.rows]

    def is_numeric(self, column: int) -> bool:
        """Return True for a column without text, which is right-aligned."""
        values = [row.get(self.columns[column].key) for row in self.rows]
        return self.columns[column].looks == "number" or not any(isinstance(v, str) for v in values)

    def markdown(self) -> str:
        """Return the table in GitHub's Markdown, below its title in bold."""
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

    def html(self) -> str:
        """Return the table for a page, without its title; numbers have the class `n`, remarks the class `dim`."""
        kinds = [
            "n" if self.is_numeric(i) else "dim" if column.looks == "faint" else ""
            for i, column in enumerate(self.columns)
        ]
        heads = "".join(_cell("th", c.head, k if k == "n" else "") for c, k in zip(self.columns, kinds, strict=True))
        rows = [
            "".join(
                _cell("td", text, kind, breaks=column.looks in ("name", "faint"))
                for text, kind, column in zip(row, kinds, self.columns, strict=True)
            )
            for row in self.texts()
        ]
        return "\n".join([f"<table><tr>{heads}</tr>", *(f"<tr>{row}</tr>" for row in rows), "</table>"])

    def rich(self) -> RichTable:
        """Return the table for a terminal."""
        from rich.box import SIMPLE_HEAD
        from rich.markup import escape
        from rich.table import Table as RichTable

        shown = RichTable(title=escape(self.title), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
        for i, column in enumerate(self.columns):
            shown.add_column(escape(column.head), justify="right" if self.is_numeric(i) else "left", no_wrap=True)
        for row in self.texts():
            shown.add_row(*(escape(cell) for cell in row))
        return shown

    def print(self, console: Console) -> None:
        """Print the table, not cut to the width of the terminal: a truncated number is a wrong number."""
        from rich.console import Console

        Console(file=console.file, width=max(console.width, _MIN_WIDTH), highlight=False).print(self.rich())


def _cell(tag: str, text: str, kind: str, *, breaks: bool = False) -> str:
    return f"<{tag}{f' class={kind}' if kind else ''}>{html_text(text, breaks=breaks)}</{tag}>"


def html_text(text: object, *, breaks: bool = False) -> str:
    """Return the text for HTML; `names` in backticks become code. `breaks`: may be divided after a slash or an underscore."""
    escaped = re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(str(text)))
    return re.sub(r"([/_])", r"\1<wbr>", escaped) if breaks else escaped


def text_of(value: Any, digits: int = 2) -> str:
    """Return the text of a cell; a dash for None and NaN."""
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
    """Return the arithmetic mean; NaN for no values."""
    return math.fsum(values) / len(values) if values else math.nan
