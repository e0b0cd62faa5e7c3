"""Large arrays of which a search touches little."""

from __future__ import annotations

import mmap
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_SMALL: Final = 1 << 22
"""Bytes: numpy asks for huge pages from here on."""


def untouched_zeros(count: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return zeros (count,) whose pages are created when they are touched, 4 kB each.

    `np.zeros` of megabytes asks for huge pages: one access then clears 2 MB, which takes longer than a short search.
    """
    size = count * dtype.itemsize
    if size < _SMALL or not hasattr(mmap, "MAP_PRIVATE"):
        return np.zeros(count, dtype)
    return np.frombuffer(mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS), dtype)


@lru_cache(maxsize=6)
def curve_table(half: int, bins: int, radius: float, cusp: float | None) -> NDArray[np.float32]:
    """The lengths of curves that are known so far, shared by all searches for the same curves: a length is always the same."""
    del radius, cusp  # None: Dubins
    return untouched_zeros((2 * half + 1) * (half + 1) * bins, np.dtype(np.float32))
