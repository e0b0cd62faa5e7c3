"""Buffer of a recorder for the obstacles that are not on the map, which may move, appear and disappear."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class SolidNames(NamedTuple):
    """What identifies the obstacles of one row, in its order."""

    discs: tuple[str, ...]
    polygons: tuple[str, ...]


class _Row(NamedTuple):
    sample: int
    discs: NDArray[np.float32]
    corners: NDArray[np.float32]
    first: NDArray[np.int64]
    names: SolidNames | None
    """None: as listed first."""


class SolidsBuffer:
    """Collects rows of obstacles. A named obstacle keeps its column; it is NaN while it is absent."""

    def __init__(self) -> None:
        self._rows: list[_Row] = []
        self._initial: SolidNames | None = None

    def add(
        self,
        sample: int,
        discs: NDArray[np.float64],
        corners: NDArray[np.float64],
        first: NDArray[np.int64],
        names: SolidNames | None = None,
    ) -> None:
        """Adds the obstacles from the sample with this index on."""
        self._rows.append(_Row(sample, discs.astype(np.float32), corners.astype(np.float32), first, names))

    def identify(
        self, discs: NDArray[np.float64], corners: NDArray[np.float64], first: NDArray[np.int64], names: SolidNames
    ) -> None:
        """Names the obstacles of the rows so far; without rows, these are the obstacles since the start."""
        self._initial = names
        if not self._rows:
            self.add(0, discs, corners, first)

    def arrays(self, samples: int) -> dict[str, NDArray[Any]]:
        """Returns the arrays of the record: one row, or one per sample."""
        rows = self._rows
        if not rows:
            return {}
        if self._initial is None:
            return {
                "solid_discs": np.array([row.discs for row in rows], "<f4"),
                "solid_corners": np.array([row.corners for row in rows], "<f4"),
                "solid_first": rows[-1].first.astype("<i8"),
            }
        columns = _Columns()
        placed = [columns.place(row, row.names or self._initial) for row in rows]
        index = np.searchsorted([row.sample for row in rows], np.arange(samples), side="right") - 1
        discs = np.full((samples, len(columns.discs), 3), np.nan, "<f4")
        corners = np.full((samples, columns.corner_count, 2), np.nan, "<f4")
        for sample, at in enumerate(index.tolist()):
            row, (disc_columns, corner_columns) = rows[at], placed[at]
            discs[sample, disc_columns] = row.discs
            corners[sample, corner_columns] = row.corners
        return {"solid_discs": discs, "solid_corners": corners, "solid_first": columns.first()}


class _Columns:
    """The columns of all obstacles that ever existed, in the order of their appearance."""

    def __init__(self) -> None:
        self.discs: dict[str, int] = {}
        self._polygons: dict[tuple[str, int], int] = {}
        self._counts: list[int] = []
        self._known: dict[SolidNames, tuple[list[int], list[int]]] = {}

    @property
    def corner_count(self) -> int:
        return sum(self._counts)

    def first(self) -> NDArray[np.int64]:
        return np.cumsum([0, *self._counts]).astype("<i8")

    def place(self, row: _Row, names: SolidNames) -> tuple[list[int], list[int]]:
        """Returns the columns of the row's discs and of its corners."""
        if names in self._known:
            return self._known[names]
        discs = [self.discs.setdefault(name, len(self.discs)) for name in names.discs]
        corners: list[int] = []
        for name, count in zip(names.polygons, np.diff(row.first).tolist(), strict=True):
            # a polygon with another number of corners is another one
            key = (name, count)
            if key not in self._polygons:
                self._polygons[key] = self.corner_count
                self._counts.append(count)
            corners += range(self._polygons[key], self._polygons[key] + count)
        self._known[names] = discs, corners
        return discs, corners
