"""Timeout of a sensor."""

from __future__ import annotations


class SensorTimeout:
    """Time since the newest message, the last restart or the first check, whichever is the latest.

    A stamp from the future counts as the present: a wrong clock must not hide that a sensor has stopped.
    """

    __slots__ = ("_arrival", "_newest", "_restarted", "_since")

    def __init__(self) -> None:
        self._since: float | None = None
        self._newest: float | None = None
        self._arrival: float | None = None
        self._restarted = False

    def received(self, stamp: float) -> None:
        """Record a message with this stamp (s)."""
        self._arrival = stamp

    def restart(self) -> None:
        """Start the full timeout again."""
        self._since, self._restarted = None, True

    def is_within(self, allowed: float, now: float) -> bool:
        """Return True if at most `allowed` seconds have passed without a message; 0 allows any time."""
        if allowed == 0.0:
            return True
        if self._arrival is not None:
            newest, self._arrival = min(self._arrival, now), None
            self._newest = newest if self._newest is None else max(newest, self._newest)
        if self._since is None:
            self._since = now if self._newest is None or self._restarted else self._newest
        newest = self._since if self._newest is None else max(self._newest, self._since)
        return now - newest <= allowed
