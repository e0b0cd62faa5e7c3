"""Origin of marks: serial numbers of observations that fit into the spare bits of a cell."""

from __future__ import annotations

from array import array
from typing import Final

CAPACITY: Final = 4096
"""Largest number of stored observations."""


class MarkLog:
    """A ring buffer of observations. Serial number 0 means unknown.

    Before half of the ring is used again, `expired` names the serial numbers that are about to get a new meaning: the owner
    removes them from its cells, so that an old mark never shows a new time.
    """

    def __init__(self, bits: int) -> None:
        self._size = min(CAPACITY, 1 << max(bits, 0))
        self._stamps = array("d", bytes(8 * self._size))
        self._sources = array("B", bytes(self._size))
        self._names: list[str] = []
        self._next = 1
        self._wrapped = False
        self.expired: tuple[int, int] | None = None
        """Serial numbers (first, last) that the last `add` invalidated; None without any."""

    def add(self, source: str, stamp: float) -> int:
        """Store an observation of `source` at `stamp` (s); return its serial number."""
        self.expired = None
        if self._size < 4:  # no spare bits
            return 0
        half = self._size // 2
        serial = self._next
        if serial == half:
            self.expired = (half, self._size - 1) if self._wrapped else None
        elif serial == 1 and self._wrapped:
            self.expired = (1, half - 1)
        if source not in self._names:
            self._names.append(source)
        self._stamps[serial] = stamp
        self._sources[serial] = min(self._names.index(source), 255)
        self._next += 1
        if self._next == self._size:
            self._next, self._wrapped = 1, True
        return serial

    def look_up(self, serial: int) -> tuple[str, float] | None:
        """Return the source and the stamp (s) of a serial number; None if unknown."""
        if serial <= 0 or serial >= self._size:
            return None
        return self._names[self._sources[serial]], self._stamps[serial]
