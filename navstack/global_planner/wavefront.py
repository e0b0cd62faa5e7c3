"""A potential over a costmap and the arrays it lives in, kept from plan to plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap
from navstack.core.errors import InputError
from navstack.global_planner import _kernels as kernels
from navstack.global_planner.cost_rule import CostRule

UNREACHED: Final = float(kernels.HIGH)
_MARGIN: Final = 32
_FIRST_LISTS: Final = 4096
_NO_GUIDE: Final = np.empty(0, np.float32)


class Guide(NamedTuple):
    """Potentials from the other end, by which a wave is kept to the cells that can lie on a good path."""

    values: NDArray[np.float32]
    """One per square of 2**shift cells, with a ring around; one per cell, without a ring, when shift is 0."""
    shift: int
    careful: bool = False
    """Whether the wave is to look again at every neighbour that could come lower still."""


class Wavefront:
    """A wavefront over one costmap at a time. Cells are numbered k = iy * nx + ix.

    Two arrays, 5 bytes a cell together, are allocated once per size of costmap and touched only where the wave goes; the
    lists of cells grow with its front. The costmap is read, never written to, and must not change while a wave is under way.
    """

    def __init__(self) -> None:
        self.nx = 0
        self.ny = 0
        self._pot = np.empty(0, np.float32)
        self._pending = np.empty(0, np.uint8)
        self._lists = [np.empty(_FIRST_LISTS, np.uint32) for _ in range(3)]
        self._notes = np.empty(_FIRST_LISTS, np.uint8)
        self._state = np.zeros(kernels.STATE_SIZE, np.int64)
        self._level = np.zeros(2, np.float32)
        self._cost = np.empty(0, np.uint8)
        self._rule: CostRule | None = None
        self.most = 1 << 62
        """Cells it may lower at most; looked at when it begins."""

    @property
    def pot(self) -> NDArray[np.float32]:
        """(ny*nx,) the potential; means something only inside `rectangle`, none where >= UNREACHED."""
        return self._pot

    @property
    def cost(self) -> NDArray[np.uint8]:
        """(ny*nx,) the costs the wave runs over."""
        return self._cost

    @property
    def rule(self) -> CostRule:
        """The rule it runs by."""
        assert self._rule is not None, "begin() first"
        return self._rule

    @property
    def rectangle(self) -> tuple[int, int, int, int]:
        """(x0, y0, x1, y1): the cells whose potential means something."""
        s: list[int] = self._state.tolist()
        return s[kernels.X0], s[kernels.Y0], s[kernels.X1], s[kernels.Y1]

    @property
    def expanded(self) -> int:
        """How often a cell's potential was lowered."""
        return int(self._state[kernels.EXPANDED])

    @property
    def is_exhausted(self) -> bool:
        """True when it ended because it had lowered as many cells as it may."""
        s = self._state
        return bool(s[kernels.EXPANDED] >= s[kernels.MOST] and s[kernels.NCURRENT] > 0)

    def begin(
        self,
        costmap: Costmap,
        rule: CostRule,
        seeds: Sequence[tuple[int, float]],
        fronts: Sequence[tuple[int, int]],
        target: tuple[int, int],
        threshold: float,
        rise: float,
        *,
        whole: bool = False,
    ) -> None:
        """Forgets the last wave and sets up one that starts from `seeds` (cell number, potential).

        `fronts` are the cells (ix, iy) queued first, in this order; those that are blocked, on the outermost ring or outside are
        passed over. `target` is the cell it is to reach; `threshold` navfn's first one, `rise` what it
        grows by. `whole` opens the whole grid at once: a potential that is read as a guide must be defined everywhere.
        """
        ny, nx = costmap.data.shape
        if (nx, ny) != (self.nx, self.ny):
            if nx * ny > kernels.MOST_CELLS:
                raise InputError(f"a costmap of {nx} x {ny} cells: at most 2**31 can be planned over")
            self.nx, self.ny = nx, ny
            self._pot = np.empty(nx * ny, np.float32)
            self._pending = np.empty(nx * ny, np.uint8)
        self._cost = np.ascontiguousarray(costmap.data).reshape(-1)
        self._rule = rule
        self._state[:] = 0
        self._state[kernels.MOST] = self.most
        self._level[:] = threshold, rise
        margin = max(nx, ny) if whole else _MARGIN
        xs = [target[0], *(k % nx for k, _ in seeds)]
        ys = [target[1], *(k // nx for k, _ in seeds)]
        kernels.open_rectangle(
            self._pot,
            self._pending,
            nx,
            ny,
            self._state,
            min(xs) - margin,
            min(ys) - margin,
            max(xs) + margin + 1,
            max(ys) + margin + 1,
        )
        inside = [y * nx + x for x, y in fronts if 0 < x < nx - 1 and 0 < y < ny - 1]
        kernels.seed(
            self._cost,
            self._pot,
            self._pending,
            rule.weights,
            self._state,
            self._lists[0],
            np.array([k for k, _ in seeds], np.int64),
            np.array([p for _, p in seeds], np.float32),
            np.array(inside, np.int64),
        )

    def run(
        self, stop: int = -1, *, last: float = math.inf, guide: Guide | None = None, limit: float = math.inf
    ) -> None:
        """Spreads until nothing is left to do, cell `stop` has a potential, or the threshold exceeds `last`.

        May be called again to go on. With a `guide`, cells where the potentials from both ends together exceed `limit` are
        left out.
        """
        if stop >= 0:
            self._open(stop % self.nx, stop // self.nx)
        *self._lists, self._notes = kernels.wave(
            self._cost,
            self._pot,
            self._pending,
            self.rule.steps,
            self.rule.weights,
            self.nx,
            self.ny,
            self._lists[0],
            self._lists[1],
            self._lists[2],
            self._notes,
            self._state,
            self._level,
            np.float32(last),
            int(stop),
            _NO_GUIDE if guide is None else guide.values,
            0 if guide is None else guide.shift,
            np.float32(limit),
            int(self.rule.quadratic),
        )

    def _open(self, ix: int, iy: int) -> None:
        """Makes sure that the cell lies inside the rectangle, so that its potential can be read."""
        x0, y0, x1, y1 = self.rectangle
        if not (x0 <= ix < x1 and y0 <= iy < y1):
            kernels.open_rectangle(
                self._pot,
                self._pending,
                self.nx,
                self.ny,
                self._state,
                ix - _MARGIN,
                iy - _MARGIN,
                ix + _MARGIN + 1,
                iy + _MARGIN + 1,
            )

    def settle(self, cell: tuple[int, int], guide: Guide | None, limit: float) -> None:
        """Runs on until nothing that is queued could lower the potential of `cell` any more.

        A wave that stops where it first arrives, as C++'s, may have come by a way that the next round would beat by a per cent.
        """
        reached = self.potential_of(*cell)
        if reached < math.inf:
            # what waits was queued by cells whose potential is at least the threshold before this one
            self.run(last=reached + float(self._level[1]), guide=guide, limit=limit)

    def revise(self, changed: NDArray[np.int64], *, cheaper: NDArray[np.bool_], rise: float) -> None:
        """The costs of the cells `changed` are others now: lowers the potential where it has become cheaper.

        What has become dearer keeps its potential, as a lower bound; so this is for guides only. The wave under way is
        interrupted for it and taken up again where it was.
        """
        nx, ny = self.nx, self.ny
        pot = self._pot
        inner = (changed % nx > 0) & (changed % nx < nx - 1) & (changed >= nx) & (changed < (ny - 1) * nx)
        # what waits is queued by the wave under way: it will see to it
        cells = changed[inner & cheaper & (self._pending[changed] == 0)]
        around = (
            pot[np.stack([cells - 1, cells + 1, cells - nx, cells + nx])]
            if cells.size
            else np.empty((4, 0), np.float32)
        )
        lowest = around.min(axis=0) if cells.size else np.empty(0, np.float32)
        cells = cells[lowest < UNREACHED]
        if cells.size == 0:
            return
        suspended, level = self._queued(), float(self._level[0])
        self._pending[cells] = kernels.WAITS
        self._queue(cells.astype(np.uint32))
        self._level[0] = min(level, float(lowest.min()) + rise)
        self.run(last=level)
        self._queue(np.concatenate([suspended, self._queued()]))
        self._level[0] = level

    def _queued(self) -> NDArray[np.uint32]:
        n, m = int(self._state[kernels.NCURRENT]), int(self._state[kernels.NOVER])
        return np.concatenate([self._lists[0][:n], self._lists[2][:m]])

    def _queue(self, cells: NDArray[np.uint32]) -> None:
        if cells.size > self._lists[0].size:
            self._lists[0] = np.empty(2 * cells.size, np.uint32)
        self._lists[0][: cells.size] = cells
        self._state[kernels.NCURRENT], self._state[kernels.NOVER] = cells.size, 0

    def complete(self, ix: int, iy: int, reach: int) -> None:
        """Gives the free cells without potential within `reach` cells of (ix, iy) one from their neighbours."""
        rule = self.rule
        kernels.complete(
            self._cost,
            self._pot,
            rule.steps,
            rule.weights,
            self.nx,
            self.ny,
            self._state,
            ix,
            iy,
            reach,
            rule.quadratic,
        )

    def potential_of(self, ix: int, iy: int) -> float:
        """Potential of a cell, inf where there is none."""
        x0, y0, x1, y1 = self.rectangle
        if not (x0 <= ix < x1 and y0 <= iy < y1):
            return math.inf
        p = float(self._pot[iy * self.nx + ix])
        return p if p < UNREACHED else math.inf

    def full_potential(self) -> NDArray[np.float32]:
        """(ny, nx) a copy, inf where not reached."""
        out = np.full((self.ny, self.nx), np.inf, np.float32)
        x0, y0, x1, y1 = self.rectangle
        part = self._pot.reshape(self.ny, self.nx)[y0:y1, x0:x1]
        out[y0:y1, x0:x1] = np.where(part < UNREACHED, part, np.float32(np.inf))
        return out

    def nearest_reached(self, ix: int, iy: int) -> tuple[int, int]:
        """The cell with a potential whose centre is nearest to that of (ix, iy); the first in reading order on a tie."""
        x0, y0, x1, y1 = self.rectangle
        ys, xs = np.nonzero(self._pot.reshape(self.ny, self.nx)[y0:y1, x0:x1] < UNREACHED)
        best = int(np.argmin((xs + (x0 - ix)) ** 2 + (ys + (y0 - iy)) ** 2))
        return int(xs[best]) + x0, int(ys[best]) + y0
