"""savitzky_golay: each point moves to a polynomial through its neighbors (Nav2's SavitzkyGolaySmoother)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap
from navstack.core.parameters import param
from navstack.plugins import SMOOTHERS
from navstack.smoother.base import PointSmoother, PointSmootherParams


class SavitzkyGolayParams(PointSmootherParams):
    """Parameters of savitzky_golay."""

    window_size: int = param(7, "points of the window; even numbers are raised by one", ge=3, le=101)
    poly_order: int = param(3, "order of the polynomial, below window_size", ge=0, le=10)


@SMOOTHERS.register("savitzky_golay", aliases=("nav2_smoother/SavitzkyGolaySmoother", "savitzky_golay_smoother"))
class SavitzkyGolaySmoother(PointSmoother):
    """savitzky_golay: least squares polynomials over a window (A. Savitzky, M. Golay, 1964); cubic paths stay as they are.

    The ends stay, and stand for the points beyond them. Equal to Nav2's SavitzkyGolaySmoother, but the result is checked:
    `PointSmoother.smooth`.
    """

    Params = SavitzkyGolayParams

    def __init__(self, params: SavitzkyGolayParams | None = None) -> None:
        super().__init__(params or SavitzkyGolayParams())
        p = self.params
        self._half = p.window_size // 2
        offsets = np.arange(-self._half, self._half + 1, dtype=np.float64)
        order = min(p.poly_order, 2 * self._half)
        self._weights = np.linalg.pinv(np.vander(offsets, order + 1, increasing=True))[0]

    @property
    def shortest(self) -> int:
        """Pieces of up to window_size + 2 steps stay as they are."""
        return 2 * self._half + 3

    def move(
        self, points: NDArray[np.float64], free: NDArray[np.bool_], costmap: Costmap | None
    ) -> NDArray[np.float64]:
        """Return the filtered points."""
        del costmap
        p, h = self.params, self._half
        out = points
        for _ in range(1 + (p.refinement_num if p.do_refinement else 0)):
            padded = np.concatenate([np.repeat(out[:1], h, axis=0), out, np.repeat(out[-1:], h, axis=0)])
            moved = sum(w * padded[k : k + len(out)] for k, w in enumerate(self._weights))
            out = np.where(free[:, None], moved, out)
        return out
