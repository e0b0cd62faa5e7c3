"""Large arrays of which a search touches little."""

from __future__ import annotations

import mmap
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
