"""Bins of particles: the number of bins sets the size of the particle set, connected bins are clusters.

amcl keeps them in a k-d tree (pf/pf_kdtree.c); here a hash table with open addressing. `keys` (size,) int64 holds the bins, -1
where empty; `numbers` (size,) int32 their numbers in the order of insertion. The size is a power of two, at least twice the
number of bins.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel

BIN_M = 0.5
BIN_RAD = 10.0 * math.pi / 180.0
TURN = 36
OFFSET = 1 << 20
YAW_OFFSET = 1 << 14
YAW_BITS = 15


@kernel
def bin_of(x: float, y: float, yaw: float, wrapped: bool) -> int:
    """Return the key of the bin of a pose. `wrapped`: headings a full turn apart share a bin."""
    ix = min(max(math.floor(x / BIN_M) + OFFSET, 1), 2 * OFFSET - 2)
    iy = min(max(math.floor(y / BIN_M) + OFFSET, 1), 2 * OFFSET - 2)
    turn = math.floor(yaw / BIN_RAD)
    if wrapped:
        turn = turn % TURN
    turn = min(max(turn + YAW_OFFSET, 1), 2 * YAW_OFFSET - 2)
    key: int = np.int64((((np.int64(ix) << 21) | np.int64(iy)) << YAW_BITS) | np.int64(turn))  # pyright: ignore[reportAssignmentType]
    return key


@kernel
def slot_of(keys: NDArray[np.int64], key: int) -> int:
    """Return the slot of a key, or the empty one where it belongs."""
    mask = len(keys) - 1
    scrambled = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot: int = np.int64(scrambled >> np.uint64(32)) & mask  # pyright: ignore[reportAssignmentType]
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@kernel
def count_bins(
    particles: NDArray[np.float64],
    wrapped: bool,
    keys: NDArray[np.int64],
    numbers: NDArray[np.int32],
    members: NDArray[np.int32],
    bins: NDArray[np.int64],
) -> int:
    """Sort `particles` (n, 3) into bins; fill `members` (n,) and the keys `bins`; return the number of bins."""
    keys[:] = -1
    count = 0
    for i in range(len(particles)):
        key = bin_of(particles[i, 0], particles[i, 1], particles[i, 2], wrapped)
        slot = slot_of(keys, key)
        if keys[slot] == -1:
            keys[slot] = key
            numbers[slot] = count
            bins[count] = key
            count += 1
        members[i] = numbers[slot]
    return count


@kernel
def neighbor_of(key: int, dx: int, dy: int, turn: int, wrapped: bool) -> int:
    """Return the key of a neighboring bin."""
    heading = (key & ((1 << YAW_BITS) - 1)) + turn
    if wrapped:
        heading = (heading - YAW_OFFSET) % TURN + YAW_OFFSET
    found: int = (((key >> YAW_BITS) + (np.int64(dx) << 21) + dy) << YAW_BITS) | heading  # pyright: ignore[reportAssignmentType]
    return found


@kernel
def label_bins(
    count: int,
    wrapped: bool,
    keys: NDArray[np.int64],
    numbers: NDArray[np.int32],
    bins: NDArray[np.int64],
    labels: NDArray[np.int32],
    stack: NDArray[np.int32],
) -> int:
    """Label the `count` bins by their 26-connected components, from the last bin to the first; return the number of clusters."""
    labels[:count] = -1
    clusters = 0
    for first in range(count - 1, -1, -1):
        if labels[first] != -1:
            continue
        labels[first] = clusters
        stack[0] = first
        depth = 1
        while depth > 0:
            depth -= 1
            key: int = bins[stack[depth]]  # pyright: ignore[reportAssignmentType]
            for dx in range(-1, 2):
                for dy in range(-1, 2):
                    for turn in range(-1, 2):
                        other = neighbor_of(key, dx, dy, turn, wrapped)
                        slot = slot_of(keys, other)
                        if keys[slot] == other and labels[numbers[slot]] == -1:
                            labels[numbers[slot]] = clusters
                            stack[depth] = numbers[slot]
                            depth += 1
        clusters += 1
    return clusters


@kernel
def add_up(
    particles: NDArray[np.float64],
    weights: NDArray[np.float64],
    members: NDArray[np.int32],
    labels: NDArray[np.int32],
    sums: NDArray[np.float64],
) -> None:
    """Add up the moments of each cluster.

    `sums` (clusters, 9): count, weight, weighted x, y, cos yaw, sin yaw, xx, xy, yy.
    """
    sums[:] = 0.0
    for i in range(len(particles)):
        row = labels[members[i]]
        w = weights[i]
        x, y, yaw = particles[i, 0], particles[i, 1], particles[i, 2]
        wx, wy = w * x, w * y
        sums[row, 0] += 1.0
        sums[row, 1] += w
        sums[row, 2] += wx
        sums[row, 3] += wy
        sums[row, 4] += w * math.cos(yaw)
        sums[row, 5] += w * math.sin(yaw)
        sums[row, 6] += wx * x
        sums[row, 7] += wx * y
        sums[row, 8] += wy * y
