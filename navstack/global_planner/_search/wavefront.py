"""A wavefront potential over a costmap, and its arrays, which are reused from plan to plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Window
from navstack.core.errors import InputError
from navstack.global_planner._search import _wavefront_kernels as kernels
from navstack.global_planner._search.cells import Cell, start_fronts
from navstack.global_planner._search.cost_interpreter import WaveCosts

UNREACHED: Final = float(kernels.HIGH)
_MARGIN: Final = 32
_INITIAL_CAPACITY: Final = 4096
_NO_GUIDE: Final = np.empty(0, np.float32)


class Guide(NamedTuple):
    """Potentials from the target, by which a wave is restricted to the cells that can be on a good path."""

    values: NDArray[np.float32]
    """One per square of 2**shift cells, with a border of one square; one per cell, without a border, if shift is 0."""
    shift: int
    limit: float
    """Largest sum of the potentials from both ends; cells with a larger sum are pruned."""
    order_independent: bool = False
    """Whether the wave uses `cost_interpreter.order_independent` costs."""


class Wavefront:
    """A wavefront over one costmap at a time. Cells are numbered k = iy * nx + ix.

    Two arrays, 5 bytes per cell together, are allocated once per size of costmap and accessed only where the wave goes. The
    lists of cells grow with the front. The costmap is never written to and must not change between `begin` and the last `run`.
    """

    def __init__(self) -> None:
        self.nx = 0
        self.ny = 0
        self._pot = np.empty(0, np.float32)
        self._pending = np.empty(0, np.uint8)
        self._lists = [np.empty(_INITIAL_CAPACITY, np.uint32) for _ in range(3)]
        self._flags = np.empty(_INITIAL_CAPACITY, np.uint8)
        self._state = np.zeros(1, kernels.STATE)
        # views of single fields: access to a field of a record takes longer
        fields: dict[str, NDArray[Any]] = {name: self._state[name] for name in kernels.STATE.names or ()}
        self._window = fields["window"][0]
        self._fields = fields
        self._cost = np.empty(0, np.uint8)
        self._costs: WaveCosts | None = None
        self.max_expanded = 1 << 62
        """Limit on how often a potential is lowered; takes effect at `begin`."""

    @property
    def pot(self) -> NDArray[np.float32]:
        """(ny*nx,) the potential; defined only inside `window`, >= UNREACHED where the wave did not arrive."""
        return self._pot

    @property
    def cost(self) -> NDArray[np.uint8]:
        """(ny*nx,) the bytes of the costmap."""
        return self._cost

    @property
    def costs(self) -> WaveCosts:
        """The cost interpreter of the wave; requires `begin`."""
        assert self._costs is not None, "begin() first"
        return self._costs

    @property
    def window(self) -> Window:
        """The cells whose potential is defined."""
        return Window(*self._window.tolist())

    @property
    def expanded(self) -> int:
        """How often a potential was lowered."""
        return int(self._fields["expanded"][0])

    @property
    def is_exhausted(self) -> bool:
        """Whether the wave ended because of `max_expanded`."""
        f = self._fields
        return bool(f["expanded"][0] >= f["max_expanded"][0] and f["n_current"][0] > 0)

    def begin(
        self,
        costmap: Costmap,
        costs: WaveCosts,
        seeds: Sequence[tuple[Cell, float]],
        fronts: Sequence[Cell],
        target: Cell,
        *,
        threshold: float,
        rise: float,
        whole: bool = False,
    ) -> None:
        """Set up a wave that starts from `seeds` (cell, potential) and discard the last one.

        `fronts` are the cells queued first, in this order; cells that are blocked, on the outermost ring or outside are
        skipped. `target` is the cell to reach; `threshold` is navfn's initial threshold and `rise` its increment. `whole`
        opens the whole grid at once, for a potential that is used as a guide and must be defined everywhere.
        """
        ny, nx = costmap.data.shape
        self._allocate(nx, ny)
        self._cost = np.ascontiguousarray(costmap.data).reshape(-1)
        self._costs = costs
        self._state[0] = (
            nx,
            ny,
            (0, 0, 0, 0),
            0,
            0,
            0,
            self.max_expanded,
            -1,
            0,
            costs.quadratic,
            threshold,
            rise,
            0.0,
            0.0,
        )
        margin = max(nx, ny) if whole else _MARGIN
        xs = [target[0], *(x for (x, _), _ in seeds)]
        ys = [target[1], *(y for (_, y), _ in seeds)]
        kernels.open_window(
            self._pot,
            self._pending,
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
            costs.weights,
            self._state,
            self._lists[0],
            np.array([y * nx + x for (x, y), _ in seeds], np.int64),
            np.array([p for _, p in seeds], np.float32),
            np.array(inside, np.int64),
        )

    def begin_at(
        self,
        costmap: Costmap,
        costs: WaveCosts,
        root: Cell,
        target: Cell,
        *,
        threshold: float,
        rise: float,
        whole: bool = False,
    ) -> None:
        """As `begin`, from potential 0 at the cell `root`."""
        self.begin(
            costmap,
            costs,
            [(root, 0.0)],
            start_fronts(root),
            target,
            threshold=threshold,
            rise=rise,
            whole=whole,
        )

    def _allocate(self, nx: int, ny: int) -> None:
        if (nx, ny) == (self.nx, self.ny):
            return
        if nx * ny > kernels.MAX_CELLS:
            raise InputError(f"a costmap of {nx} x {ny} cells is too large to plan on; the limit is 2**31 cells")
        self.nx, self.ny = nx, ny
        self._pot = np.empty(nx * ny, np.float32)
        self._pending = np.empty(nx * ny, np.uint8)

    def run(self, target: Cell | None = None, *, last: float = math.inf, guide: Guide | None = None) -> None:
        """Propagate until the lists are empty, `target` has a potential, or the threshold exceeds `last`.

        A later call resumes the wave. With a `guide`, cells are pruned where the sum of the potentials exceeds its limit.
        """
        f, costs = self._fields, self.costs
        if target is None:
            f["stop"][0] = -1
        else:
            self._open(*target)
            f["stop"][0] = target[1] * self.nx + target[0]
        f["last"][0] = last
        if guide is not None:
            f["limit"][0] = guide.limit
            f["guide_shift"][0] = guide.shift
        *self._lists, self._flags = kernels.propagate(
            self._cost,
            self._pot,
            self._pending,
            costs.steps,
            costs.weights,
            self._lists[0],
            self._lists[1],
            self._lists[2],
            self._flags,
            _NO_GUIDE if guide is None else guide.values,
            self._state,
        )

    def run_to(self, target: Cell, *, guide: Guide | None = None) -> None:
        """Propagate until `target` has a potential, if it has none yet."""
        if self.potential_of(*target) == math.inf:
            self.run(target, guide=guide)

    def _open(self, ix: int, iy: int) -> None:
        """Grow the open window to contain the cell, so that its potential can be read."""
        x0, y0, x1, y1 = self._window.tolist()
        if not (x0 <= ix < x1 and y0 <= iy < y1):
            kernels.open_window(
                self._pot,
                self._pending,
                self._state,
                ix - _MARGIN,
                iy - _MARGIN,
                ix + _MARGIN + 1,
                iy + _MARGIN + 1,
            )

    def settle(self, cell: Cell, guide: Guide | None) -> None:
        """Propagate until no queued cell can lower the potential of `cell` any more.

        A wave that stops at the first arrival, as in C++, may have taken a path that the next list would improve by 1 %.
        """
        reached = self.potential_of(*cell)
        if reached < math.inf:
            # queued cells were queued by cells whose potential is at least the previous threshold
            self.run(last=reached + float(self._fields["rise"][0]), guide=guide)

    def revise(self, changed: NDArray[np.int64], *, cheaper: NDArray[np.bool_], rise: float) -> None:
        """Update the potential after the costs of the cells `changed` were modified, where they became cheaper.

        Cells that became more expensive keep their potential, which is then a lower bound; the method is for guides only.
        The current wave is suspended and resumed.
        """
        nx, ny = self.nx, self.ny
        inner = (changed % nx > 0) & (changed % nx < nx - 1) & (changed >= nx) & (changed < (ny - 1) * nx)
        # cells that are pending are updated by the current wave
        cells = changed[inner & cheaper & (self._pending[changed] == 0)]
        if cells.size == 0:
            return
        lowest = self._pot[np.stack([cells - 1, cells + 1, cells - nx, cells + nx])].min(axis=0)
        cells = cells[lowest < UNREACHED]
        if cells.size == 0:
            return
        threshold_field = self._fields["threshold"]
        suspended, threshold = self._queued(), float(threshold_field[0])
        self._pending[cells] = kernels.PENDING
        self._queue(cells.astype(np.uint32))
        threshold_field[0] = min(threshold, float(lowest.min()) + rise)
        self.run(last=threshold)
        self._queue(np.concatenate([suspended, self._queued()]))
        threshold_field[0] = threshold

    def _queued(self) -> NDArray[np.uint32]:
        n, m = int(self._fields["n_current"][0]), int(self._fields["n_overflow"][0])
        return np.concatenate([self._lists[0][:n], self._lists[2][:m]])

    def _queue(self, cells: NDArray[np.uint32]) -> None:
        if cells.size > self._lists[0].size:
            self._lists[0] = np.empty(2 * cells.size, np.uint32)
        self._lists[0][: cells.size] = cells
        self._fields["n_current"][0], self._fields["n_overflow"][0] = cells.size, 0

    def complete(self, cell: Cell, reach: int) -> None:
        """Compute the potential of unreached free cells within `reach` cells of `cell` from their neighbours."""
        costs = self.costs
        kernels.complete(self._cost, self._pot, costs.steps, costs.weights, self._state, *cell, reach)

    def potential_of(self, ix: int, iy: int) -> float:
        """Potential of a cell, inf if unreached."""
        x0, y0, x1, y1 = self._window.tolist()
        if not (x0 <= ix < x1 and y0 <= iy < y1):
            return math.inf
        p = float(self._pot[iy * self.nx + ix])
        return p if p < UNREACHED else math.inf

    def full_potential(self) -> NDArray[np.float32]:
        """(ny, nx) a copy, inf where unreached."""
        out = np.full((self.ny, self.nx), np.inf, np.float32)
        window = self.window.slices
        part = self._pot.reshape(self.ny, self.nx)[window]
        out[window] = np.where(part < UNREACHED, part, np.float32(np.inf))
        return out

    def nearest_reached(self, ix: int, iy: int) -> Cell:
        """The reached cell whose centre is nearest to that of (ix, iy); ties go to the first in row order."""
        window = self.window
        ys, xs = np.nonzero(self._pot.reshape(self.ny, self.nx)[window.slices] < UNREACHED)
        best = int(np.argmin((xs + (window.x0 - ix)) ** 2 + (ys + (window.y0 - iy)) ** 2))
        return int(xs[best]) + window.x0, int(ys[best]) + window.y0
