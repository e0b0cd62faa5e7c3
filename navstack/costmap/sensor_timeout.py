"""For how long nothing was heard of a sensor."""

from __future__ import annotations


class Silence:
    """Counts from the first question, from the newest message, or from a restart, whichever is the latest.

    A stamp from the future counts as now: a clock that is wrong must not hide that the sensor fell silent.
    """

    __slots__ = ("_arrival", "_heard", "_restarted", "_since")

    def __init__(self) -> None:
        self._since: float | None = None
        self._heard: float | None = None
        self._arrival: float | None = None
        self._restarted = False

    def arrived(self, stamp: float) -> None:
        """A message of that stamp (s) came."""
        self._arrival = stamp

    def restart(self) -> None:
        """The sensor gets its full time again."""
        self._since, self._restarted = None, True

    def is_within(self, allowed: float, now: float) -> bool:
        """True while no more than `allowed` seconds passed without a message; 0 = any number."""
        if allowed == 0.0:
            return True
        if self._arrival is not None:
            heard, self._arrival = min(self._arrival, now), None
            self._heard = heard if self._heard is None else max(heard, self._heard)
        if self._since is None:
            self._since = now if self._heard is None or self._restarted else self._heard
        newest = self._since if self._heard is None else max(self._heard, self._since)
        return now - newest <= allowed
