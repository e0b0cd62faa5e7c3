"""What is to be said about a parameter, and where it stands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

Severity = Literal["error", "warning", "info"]

MAX_TEXT = 1200
_ORDER = {"error": 0, "warning": 1, "info": 2}


class Location(NamedTuple):
    """A place in a source: line and column count from 1; line 0 means the source as a whole."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing a user should know about the parameters. Errors stop, warnings and infos do not."""

    severity: Severity
    rule: str
    """Short name of the rule, stable: `unknown`, `renamed`, `out-of-range`."""
    file: str
    line: int
    column: int
    key: str
    """Full name below move_base: `local_costmap/inflation_layer/inflation_radius`; empty for a source as a whole."""
    message: str
    """What, the value, the way out."""
    suggestion: str | None = None
    """The name or value to write instead, where there is one."""

    @property
    def location(self) -> Location:
        """Where it stands."""
        return Location(self.file, self.line, self.column)

    def __str__(self) -> str:
        return f"{self.location}: {self.severity}: {self.message}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "severity": self.severity,
            "rule": self.rule,
            "file": self.file,
            "line": self.line,
            "column": self.column,
            "key": self.key,
            "message": self.message,
            "suggestion": self.suggestion,
        }


def finding(
    severity: Severity, rule: str, at: Location, key: str, message: str, suggestion: str | None = None
) -> Finding:
    """A finding at a location, on one line whatever the user's text in it."""
    return Finding(severity, rule, at.file, at.line, at.column, _line(key), _line(message), suggestion)


def _line(text: str) -> str:
    """`text` without line breaks and control characters, and not endless."""
    if len(text) > MAX_TEXT:
        text = f"{text[: MAX_TEXT // 2]} [...] {text[-MAX_TEXT // 2 :]}"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


_GLOBAL, _LOCAL = "global_costmap", "local_costmap"


def _either(text: str) -> str:
    return text.replace(_LOCAL, _GLOBAL)


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """By file, line and column; each said once.

    A file that is loaded into both costmaps says everything twice: the first key stands for both.
    """
    said: dict[tuple[Any, ...], Finding] = {}
    for f in findings:
        place = (f.file, f.line, f.column, f.rule, _either(f.key), _either(f.message))
        before = said.setdefault(place, f)
        if before.message != f.message and f"(and {_LOCAL})" not in before.message:
            both = before.message.replace(_GLOBAL, f"{_GLOBAL} (and {_LOCAL})", 1)
            said[place] = replace(before, message=both)
    return sorted(said.values(), key=lambda f: (f.file, f.line, f.column, _ORDER[f.severity], f.rule, f.key))
