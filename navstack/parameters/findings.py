"""Findings: problems and notes about parameters, with their locations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from navstack.plugins import Severity

MAX_TEXT = 1200
_ORDER = {"error": 0, "warning": 1, "info": 2}


class Location(NamedTuple):
    """A place in a source: line and column, counted from 1; line 0 stands for the whole source."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem or note about the parameters. Errors prevent loading, warnings and infos do not."""

    severity: Severity
    rule: str
    """Short stable name of the rule: `unknown`, `renamed`, `out-of-range`."""
    file: str
    line: int
    column: int
    key: str
    """Full name below move_base: `local_costmap/inflation_layer/inflation_radius`; empty for a whole source."""
    message: str
    """What is wrong with which value, then how to fix it."""
    suggestion: str | None = None
    """The name or value to write instead, if known."""
    replacement: str | None = None
    """The key to write instead, if no other one can be meant; `navstack check --fix` writes it."""

    @property
    def location(self) -> Location:
        """File, line and column."""
        return Location(self.file, self.line, self.column)

    def __str__(self) -> str:
        return f"{self.location}: {self.severity}: {self.message}"

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return {
            "severity": self.severity,
            "rule": self.rule,
            "file": self.file,
            "line": self.line,
            "column": self.column,
            "key": self.key,
            "message": self.message,
            "suggestion": self.suggestion,
            "replacement": self.replacement,
        }


def finding(
    severity: Severity,
    rule: str,
    at: Location,
    key: str,
    message: str,
    suggestion: str | None = None,
    replacement: str | None = None,
) -> Finding:
    """Make a finding at a location. Line breaks and control characters of the user's text are escaped."""
    return Finding(severity, rule, at.file, at.line, at.column, _line(key), _line(message), suggestion, replacement)


def _line(text: str) -> str:
    """`text` on one line, without control characters, of limited length."""
    if len(text) > MAX_TEXT:
        text = f"{text[: MAX_TEXT // 2]} [...] {text[-MAX_TEXT // 2 :]}"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


_GLOBAL, _LOCAL = "global_costmap", "local_costmap"


def _either(text: str) -> str:
    return text.replace(_LOCAL, _GLOBAL)


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings sorted by file, line and column, without duplicates.

    A file loaded into both costmaps causes every finding twice: the first one is kept for both.
    """
    kept: dict[tuple[Any, ...], Finding] = {}
    for f in findings:
        place = (f.file, f.line, f.column, f.rule, _either(f.key), _either(f.message))
        before = kept.setdefault(place, f)
        if before.message != f.message and f"(and {_LOCAL})" not in before.message:
            both = before.message.replace(_GLOBAL, f"{_GLOBAL} (and {_LOCAL})", 1)
            kept[place] = replace(before, message=both)
    return sorted(kept.values(), key=lambda f: (f.file, f.line, f.column, _ORDER[f.severity], f.rule, f.key))
