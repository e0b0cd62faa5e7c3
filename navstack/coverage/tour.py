"""The order of passes: nearest insertion, then 2-opt and or-opt; last, the best way through each of them.

D. Rosenkrantz, R. Stearns, P. Lewis, An analysis of several heuristics for the traveling salesman problem, 1977; G. Croes,
A method for solving traveling-salesman problems, 1958; I. Or, 1976. The tour is open: it begins at the robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

ROUNDS: Final = 20
"""Passes of improvement over the whole tour, at most."""
LONGEST_BLOCK: Final = 3
"""Units that or-opt moves together, at most."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A way through a unit: where it begins and ends, as rows of the matrix of distances."""

    entry: int
    exit: int
    cost: float = 0.0
    """m, for comparing the ways through one unit."""


def best_tour(units: list[list[Choice]], distances: NDArray[np.float64], start: int) -> list[tuple[int, int]]:
    """Return (unit, index of its choice) in the order of the tour that begins at row `start` of `distances` (n, n) (m)."""
    if not units:
        return []
    order = _inserted(_between(units, distances, start))
    order = _improved(order, _between(units, distances, start))
    return _chosen(order, units, distances, start)


def _between(units: list[list[Choice]], distances: NDArray[np.float64], start: int) -> NDArray[np.float64]:
    """Return the distances (n + 1, n + 1) between units, the least of all choices; the last one is the start."""
    n = len(units)
    sites = [sorted({k for choice in unit for k in (choice.entry, choice.exit)}) for unit in units] + [[start]]
    found = np.zeros((n + 1, n + 1))
    flat = np.concatenate([np.array(s) for s in sites])
    first = np.cumsum([0, *(len(s) for s in sites)])
    block = distances[np.ix_(flat, flat)]
    rows = np.minimum.reduceat(block, first[:-1], axis=0)
    found[:] = np.minimum.reduceat(rows, first[:-1], axis=1)
    np.fill_diagonal(found, 0.0)
    return np.minimum(found, found.T)


def _inserted(between: NDArray[np.float64]) -> list[int]:
    """Nearest insertion: the unit nearest to the tour comes next, where it lengthens the tour least."""
    n = len(between) - 1
    tour = [n]
    left = np.ones(n, np.bool_)
    nearest = between[n, :n].copy()
    for _ in range(n):
        unit = int(np.argmin(np.where(left, nearest, np.inf)))
        left[unit] = False
        here = np.array(tour)
        after = here[1:]
        added = np.empty(len(here))
        added[:-1] = between[here[:-1], unit] + between[unit, after] - between[here[:-1], after]
        added[-1] = between[here[-1], unit]
        tour.insert(int(np.argmin(added)) + 1, unit)
        nearest = np.minimum(nearest, between[unit, :n])
    return tour


def _improved(tour: list[int], between: NDArray[np.float64]) -> list[int]:
    """2-opt (turn a part around) and or-opt (move up to LONGEST_BLOCK units) until nothing shortens the tour."""
    tour = list(tour)
    for _ in range(ROUNDS):
        changed = _two_opt(tour, between)
        changed |= _or_opt(tour, between)
        if not changed:
            break
    return tour[1:]


def _two_opt(tour: list[int], d: NDArray[np.float64]) -> bool:
    changed = False
    n = len(tour)
    for i in range(n - 2):
        t = np.array(tour)
        a, b = t[i], t[i + 1]
        ends = t[i + 2 :]
        after = np.append(t[i + 3 :], -1)
        old = d[a, b] + np.where(after >= 0, d[ends, after], 0.0)
        new = d[a, ends] + np.where(after >= 0, d[b, after], 0.0)
        gain = old - new
        k = int(np.argmax(gain))
        if gain[k] > 1e-9:
            j = i + 2 + k
            tour[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1]
            changed = True
    return changed


def _or_opt(tour: list[int], d: NDArray[np.float64]) -> bool:
    changed = False
    n = len(tour)
    for size in range(1, min(LONGEST_BLOCK, n - 2) + 1):
        i = 1
        while i + size <= n:
            block = tour[i : i + size]
            rest = np.array(tour[:i] + tour[i + size :])
            after = np.append(rest[1:], -1)
            behind = d[tour[i - 1], block[0]]
            onward = d[block[-1], tour[i + size]] if i + size < n else 0.0
            joined = d[tour[i - 1], tour[i + size]] if i + size < n else 0.0
            gone = behind + onward - joined
            there = np.where(after >= 0, d[rest, after], 0.0)
            forth = d[rest, block[0]] + np.where(after >= 0, d[block[-1], after], 0.0) - there
            back = d[rest, block[-1]] + np.where(after >= 0, d[block[0], after], 0.0) - there
            added = np.minimum(forth, back)
            k = int(np.argmin(added))
            if gone - added[k] > 1e-9:
                moved = block if forth[k] <= back[k] else block[::-1]
                tour[:] = [*rest[: k + 1].tolist(), *moved, *rest[k + 1 :].tolist()]
                changed = True
            i += 1
    return changed


def _chosen(
    order: list[int], units: list[list[Choice]], distances: NDArray[np.float64], start: int
) -> list[tuple[int, int]]:
    """Return the choices of the units in this order that make the tour shortest: exact, by dynamic programming."""
    costs = np.zeros(1)
    exits = np.array([start])
    back: list[NDArray[np.int64]] = []
    for unit in order:
        entries = np.array([choice.entry for choice in units[unit]])
        total = costs[:, None] + distances[np.ix_(exits, entries)]
        before = np.argmin(total, axis=0)
        costs = total[before, np.arange(len(entries))] + [choice.cost for choice in units[unit]]
        exits = np.array([choice.exit for choice in units[unit]])
        back.append(before)
    found: list[tuple[int, int]] = []
    k = int(np.argmin(costs))
    for unit, before in zip(reversed(order), reversed(back)):
        found.append((unit, k))
        k = int(before[k])
    return found[::-1]
