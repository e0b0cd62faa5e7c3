"""Gradient descent may bounce about in a narrow place before it comes through: a path without these loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def without_loops(points: NDArray[np.float32], nx: int) -> NDArray[np.float32]:
    """The path (n, 2), in cells whose centres lie at whole numbers, that enters no cell again after it left it.

    Where it comes back to a cell it goes straight on from there: what is left out are points, and what is put in their place
    lies within that cell. Most paths have no loop and come back as they are.
    """
    numbers = np.rint(points).astype(np.int64) @ np.array([1, nx])
    if len(numbers) < 3:
        return points
    _, which = np.unique(numbers, return_inverse=True)
    last = np.empty(len(numbers), np.int64)
    last[which] = np.arange(len(numbers))  # of a cell that comes twice the later one stays
    last = last[which]
    entered = np.flatnonzero(np.diff(numbers, prepend=-1))
    if np.array_equal(last[entered], np.append(entered[1:], len(numbers)) - 1):
        return points  # every cell is left for good
    kept: list[int] = []
    i = 0
    while i < len(numbers):
        end = int(last[i])
        if np.all(numbers[i : end + 1] == numbers[i]):
            kept.extend(range(i, end + 1))
        else:
            kept.extend((i, end))
        i = end + 1
    return points[kept]
