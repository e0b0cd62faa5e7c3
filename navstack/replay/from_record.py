"""Repeats the replay of a log that a record came from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from navstack.core import Listener
from navstack.core.errors import LogError, RecordError
from navstack.logs import open_log
from navstack.record import Record
from navstack.replay.replay import LogReplay, ReplayOptions
from navstack.scenario import Scenario


def is_of_log(record: Record) -> bool:
    """Return True for the record of a replay of a log."""
    return isinstance(record.scenario.get("log"), dict)


def replay_of_log(record: Record, *, recorded: bool = True, listeners: Sequence[Listener] = ()) -> LogReplay:
    """Return the replay that a record came from, before its first cycle; with `recorded` it is recorded again.

    Raises RecordError if the log is not there.
    """
    stored: Any = record.scenario["log"]
    try:
        path, partial = str(stored["path"]), bool(stored["partial"])
        options = ReplayOptions.from_dict(stored["options"])
    except (KeyError, TypeError, ValueError, AttributeError) as exc:
        raise RecordError(f"{record.path or 'the record'} is damaged: its log is not described ({exc})") from exc
    configuration = Scenario.from_record(record).configuration
    try:
        log = open_log(path, partial=partial)
    except LogError as exc:
        raise RecordError(
            f"{record.path or 'the record'} is the replay of a log, which is needed again: {exc.message}", log=path
        ) from exc
    return LogReplay(log, configuration, record.map, options, record=recorded, listeners=listeners)
