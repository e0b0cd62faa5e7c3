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
    left = np.append(entered[1:], len(numbers)) - 1
    comes_back = np.flatnonzero(last[entered] != left)
    if not len(comes_back):
        return points  # every cell is left for good
    kept = np.ones(len(numbers), np.bool_)
    onward = 0
    for i in entered[comes_back].tolist():
        if i >= onward:  # not within a loop that is out already
            onward = int(last[i])
            kept[i + 1 : onward] = False
    return points[kept]
