"""A potential over a costmap and the arrays it lives in, kept from plan to plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap
from navstack.global_planner import _kernels as kernels
from navstack.global_planner.cost_rule import CostRule

UNREACHED: Final = float(kernels.HIGH)
_MARGIN: Final = 32
_FIRST_LISTS: Final = 4096
_FIRST_LIMIT: Final = 1.03
_WIDEN: Final = 1.05


class Wavefront:
    """A wavefront over one costmap at a time. Cells are numbered k = iy * nx + ix.

    The two arrays of 4 bytes a cell are allocated once per size of costmap and touched only where the wave goes; the lists
    of cells grow with its front. The costmap is read, never written to, and must not change while a wave is under way.
    """

    def __init__(self) -> None:
        self.nx = 0
        self.ny = 0
        self._pot = np.empty(0, np.float32)
        self._weight = np.empty(0, np.float32)
        self._lists = [np.empty(_FIRST_LISTS, np.uint32) for _ in range(4)]
        self._state = np.zeros(kernels.STATE_SIZE, np.int64)
        self._level = np.zeros(kernels.LEVEL_SIZE, np.float32)
        self._cost = np.empty(0, np.uint8)
        self._rule: CostRule | None = None
        self._seeds: list[int] = []

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
        s = self._state
        return int(s[kernels.X0]), int(s[kernels.Y0]), int(s[kernels.X1]), int(s[kernels.Y1])

    @property
    def expanded(self) -> int:
        """How often a cell's potential was lowered."""
        return int(self._state[kernels.EXPANDED])

    def begin(
        self,
        costmap: Costmap,
        rule: CostRule,
        seeds: Sequence[tuple[int, float]],
        fronts: Sequence[tuple[int, int]],
        target: tuple[int, int],
        threshold: float,
    ) -> None:
        """Forgets the last wave and sets up one that starts from `seeds` (cell number, potential).

        `fronts` are the cells (ix, iy) queued first, in this order; those that are blocked, on the outermost ring or outside are
        passed over. `target` is the cell it is to reach; `threshold` navfn's first one.
        """
        ny, nx = costmap.data.shape
        if (nx, ny) != (self.nx, self.ny):
            self.nx, self.ny = nx, ny
            self._pot = np.empty(nx * ny, np.float32)
            self._weight = np.empty(nx * ny, np.float32)
        self._cost = np.ascontiguousarray(costmap.data).reshape(-1)
        self._rule = rule
        self._seeds = [k for k, _ in seeds]
        self._state[:] = 0
        self._level[:] = threshold, np.inf, kernels.HIGH
        xs = [target[0], *(k % nx for k, _ in seeds)]
        ys = [target[1], *(k // nx for k, _ in seeds)]
        kernels.open_rectangle(
            self._cost,
            self._pot,
            self._weight,
            rule.weights,
            nx,
            ny,
            self._state,
            min(xs) - _MARGIN,
            min(ys) - _MARGIN,
            max(xs) + _MARGIN + 1,
            max(ys) + _MARGIN + 1,
        )
        inside = [y * nx + x for x, y in fronts if 0 < x < nx - 1 and 0 < y < ny - 1]
        kernels.seed(
            self._pot,
            self._weight,
            self._state,
            self._lists[0],
            np.array([k for k, _ in seeds], np.int64),
            np.array([p for _, p in seeds], np.float32),
            np.array(inside, np.int64),
        )

    def run(self, stop: int = -1, *, ahead: float = 0.0, rise: float = 100.0) -> None:
        """Spreads until nothing is left to do or cell `stop` has a potential; may be called again to go on.

        `ahead` > 0: A* toward `stop`, with that much potential per cell of distance. `rise`: navfn's step of the threshold.
        """
        rule = self.rule
        if ahead > 0.0:
            self._level[kernels.LIMIT] = self._first_limit(stop, ahead, rise)
        self._lists[:] = kernels.wave(
            self._cost,
            self._pot,
            self._weight,
            rule.steps,
            rule.weights,
            self.nx,
            self.ny,
            self._lists[0],
            self._lists[1],
            self._lists[2],
            self._lists[3],
            self._state,
            self._level,
            np.float32(rise),
            rule.quadratic,
            int(stop),
            np.float32(ahead),
            np.float32(_WIDEN),
        )

    def _first_limit(self, stop: int, ahead: float, rise: float) -> float:
        root = self._seeds[0]
        distance = math.hypot(stop % self.nx - root % self.nx, stop // self.nx - root // self.nx)
        return _FIRST_LIMIT * ahead * distance + 4.0 * rise

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
