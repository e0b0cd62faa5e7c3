"""Which observation a mark comes from: serial numbers that fit into the spare bits of a cell."""

from __future__ import annotations

from array import array
from typing import Final

MOST: Final = 4096
"""Observations remembered at most."""


class MarkLog:
    """A ring of observations. Serial 0 means "not known".

    Before half of the ring is used again, `stale` names the serials that are about to change their meaning: the owner
    wipes them from its cells, so that an old mark never claims a new time.
    """

    def __init__(self, bits: int) -> None:
        self._size = min(MOST, 1 << max(bits, 0))
        self._stamps = array("d", bytes(8 * self._size))
        self._sources = array("B", bytes(self._size))
        self._names: list[str] = []
        self._next = 1
        self._wrapped = False
        self.stale: tuple[int, int] | None = None
        """Serials (first, last) that the last `enter` took back; None when none."""

    def enter(self, source: str, stamp: float) -> int:
        """A serial for an observation of `source` at `stamp` (s)."""
        self.stale = None
        if self._size < 4:  # no spare bits to write it into
            return 0
        half = self._size // 2
        serial = self._next
        if serial == half:
            self.stale = (half, self._size - 1) if self._wrapped else None
        elif serial == 1 and self._wrapped:
            self.stale = (1, half - 1)
        if source not in self._names:
            self._names.append(source)
        self._stamps[serial] = stamp
        self._sources[serial] = min(self._names.index(source), 255)
        self._next += 1
        if self._next == self._size:
            self._next, self._wrapped = 1, True
        return serial

    def look_up(self, serial: int) -> tuple[str, float] | None:
        """Source and stamp (s) of a serial; None when not known."""
        if serial <= 0 or serial >= self._size:
            return None
        return self._names[self._sources[serial]], self._stamps[serial]
