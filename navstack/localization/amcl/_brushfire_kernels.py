"""The distance field as amcl computes it, for comparisons (amcl/src/amcl/map/map_cspace.cpp).

Labels spread over 4-neighbors from a binary heap; a cell keeps the first label that reaches it, which need not be that of the
nearest occupied cell. The order of equal distances is that of libstdc++'s `push_heap` and `pop_heap`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel


@kernel
def sift_up(heap: NDArray[np.int32], hole: int, cell: int, distances: NDArray[np.float64]) -> None:
    """Put `cell` into the heap at `hole` or above it."""
    parent = (hole - 1) // 2
    while hole > 0 and distances[heap[parent]] > distances[cell]:
        heap[hole] = heap[parent]
        hole = parent
        parent = (hole - 1) // 2
    heap[hole] = cell


@kernel
def drop_top(heap: NDArray[np.int32], size: int, distances: NDArray[np.float64]) -> None:
    """Remove the top of a heap of `size` cells."""
    size -= 1
    cell = heap[size]
    if size == 0:
        return
    hole = 0
    child = 0
    while child < (size - 1) // 2:
        child = 2 * (child + 1)
        if distances[heap[child]] > distances[heap[child - 1]]:
            child -= 1
        heap[hole] = heap[child]
        hole = child
    if size % 2 == 0 and child == (size - 2) // 2:
        child = 2 * (child + 1)
        heap[hole] = heap[child - 1]
        hole = child - 1
    sift_up(heap, hole, cell, distances)


@kernel
def brushfire(
    occupied: NDArray[np.bool_],
    radius: int,
    resolution: float,
    heap: NDArray[np.int32],
    sources: NDArray[np.int32],
    distances: NDArray[np.float64],
) -> None:
    """Fill `distances` (ny * nx,), which holds the greatest distance (m) everywhere, from the `occupied` cells (ny, nx).

    `heap` and `sources` are scratch arrays (ny * nx,).
    """
    ny, nx = occupied.shape
    sources[:] = -1
    size = 0
    for ix in range(nx):
        for iy in range(ny):
            if occupied[iy, ix]:
                cell = iy * nx + ix
                distances[cell] = 0.0
                sources[cell] = cell
                sift_up(heap, size, cell, distances)
                size += 1
    while size > 0:
        cell = heap[0]
        source = sources[cell]
        ix, iy = cell % nx, cell // nx
        for side in range(4):
            jx = ix + (-1 if side == 0 else 1 if side == 2 else 0)
            jy = iy + (-1 if side == 1 else 1 if side == 3 else 0)
            if jx < 0 or jy < 0 or jx >= nx or jy >= ny:
                continue
            other = jy * nx + jx
            if sources[other] != -1:
                continue
            dx, dy = abs(jx - source % nx), abs(jy - source // nx)
            distance = math.sqrt(dx * dx + dy * dy)
            if distance > radius:
                continue
            distances[other] = distance * resolution
            sources[other] = source
            sift_up(heap, size, other, distances)
            size += 1
        # as amcl: what is on top now is removed, which may be a neighbor that was just added
        drop_top(heap, size, distances)
        size -= 1
