"""The commands of a run on their way from their source through multiplexer, smoother and monitor to the robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Twist2D
from navstack.record.columns import Streamed, Table
from navstack.safety import CommandStep

_VELOCITIES: Final = tuple(
    f"{stage}_{axis}" for stage in ("requested", "smoothed", "sent") for axis in ("vx", "vy", "wz")
)
_TEXTS: Final = ("source", "changed_by", "action", "zone", "reason")
COMMAND_TABLE: Final[list[tuple[str, str]]] = [
    ("t", "<f8"),
    *((name, "<f8") for name in _VELOCITIES),
    *((name, "<U") for name in _TEXTS),
]
"""Columns of the table `commands`."""
MAX_TEXT: Final = 2000
"""Longest text of a row that a reader accepts."""


@dataclass(frozen=True, slots=True)
class RecordedCommand:
    """One command of the table `commands`."""

    t: float
    """Seconds."""
    requested: Twist2D
    smoothed: Twist2D
    sent: Twist2D
    source: str
    changed_by: str
    """`velocity_smoother`, `collision_monitor` or empty: the last one that changed it."""
    action: str
    """Action of the collision monitor."""
    zone: str
    reason: str
    """Why it was changed, one clause per part."""

    def as_dict(self) -> dict[str, Any]:
        """Return the command for JSON."""
        return {
            "time": self.t,
            "source": self.source,
            "requested": list(self.requested),
            "smoothed": list(self.smoothed),
            "sent": list(self.sent),
            "changed_by": self.changed_by,
            "action": self.action,
            "zone": self.zone,
            "reason": self.reason,
        }


class CommandBuffer:
    """Collects steps of a `CommandChain`."""

    def __init__(self, folder: Path | None = None) -> None:
        self._table = Table(COMMAND_TABLE, folder)

    def __len__(self) -> int:
        return len(self._table)

    def add(self, step: CommandStep) -> None:
        """Adds a step."""
        zone = step.decision.zone if step.decision is not None else ""
        texts = step.source, step.changed_by, step.action, zone, step.reason[:MAX_TEXT]
        numbers = (known.number(text) for known, text in zip(self._table.texts.values(), texts, strict=True))
        self._table.add(step.time, *step.requested, *step.smoothed, *step.sent, *numbers)

    def table(self) -> Streamed:
        """Returns the steps as a structured array."""
        return self._table.streamed()


def recorded_command(row: Any) -> RecordedCommand:
    """Return a row of the table."""
    requested, smoothed, sent = (
        Twist2D(*(float(row[f"{stage}_{axis}"]) for axis in ("vx", "vy", "wz")))
        for stage in ("requested", "smoothed", "sent")
    )
    source, changed_by, action, zone, reason = (str(row[name]) for name in _TEXTS)
    return RecordedCommand(float(row["t"]), requested, smoothed, sent, source, changed_by, action, zone, reason)


def check_commands(rows: NDArray[Any]) -> None:
    """Raises ValueError unless the table has the columns of `COMMAND_TABLE` and finite, ordered times."""
    if rows.ndim != 1 or rows.dtype.names != tuple(name for name, _ in COMMAND_TABLE):
        raise ValueError("commands does not have the columns of this version")
    for name, kind in COMMAND_TABLE:
        actual = rows.dtype[name]
        if actual.kind != "U" if kind == "<U" else actual != np.dtype(kind):
            raise ValueError(f"commands.{name} has the type {actual}, not {kind}")
        if kind == "<f8" and not np.isfinite(rows[name]).all():
            raise ValueError(f"commands.{name} has a value that is not finite")
    if (np.diff(rows["t"]) < 0.0).any():
        raise ValueError("the times of commands decrease")


def check_zones(zones: Any) -> None:
    """Raises ValueError unless the zones of the metadata are a list of names, actions and corners."""
    if not isinstance(zones, list) or len(zones) > MAX_TEXT:
        raise ValueError("zones is not a list of zones")
    for zone in zones:
        corners = zone.get("corners") if isinstance(zone, dict) else None
        good = (
            isinstance(corners, list)
            and isinstance(zone.get("name"), str)
            and isinstance(zone.get("action"), str)
            and all(
                isinstance(c, list) and len(c) == 2 and all(type(v) in (int, float) and abs(v) < 1e6 for v in c)
                for c in corners
            )
        )
        if not good:
            raise ValueError("a zone has no name, action or corners")
