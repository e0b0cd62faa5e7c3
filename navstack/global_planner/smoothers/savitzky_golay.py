"""savitzky_golay: each point moves to a polynomial through its neighbors (Nav2's SavitzkyGolaySmoother)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap
from navstack.global_planner.smoothers.base import PointSmoother, PointSmootherParams
from navstack.plugins import SMOOTHERS, CheckContext, Issue, param


class SavitzkyGolayParams(PointSmootherParams):
    """Parameters of savitzky_golay."""

    window_size: int = param(7, "points of the window; even numbers are raised by one", ge=3, le=101)
    poly_order: int = param(3, "order of the polynomial, below window_size - 1", ge=0, le=10)

    @property
    def half(self) -> int:
        """Points of the window before the one in its middle, and after it."""
        return self.window_size // 2

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue for an even window, and for polynomials that pass through all its points."""
        del context
        points = 2 * self.half + 1
        if points != self.window_size:
            message = f"window_size = {self.window_size} is even, so {points} points are used (Nav2 refuses it); write {points}"
            yield Issue("warning", "smoother-window", ("window_size",), message, str(points))
        if self.poly_order >= points - 1:
            message = (
                f"poly_order = {self.poly_order} smooths nothing: such polynomials pass through all {points} points of the "
                f"window; write at most {points - 2}, or increase window_size"
            )
            yield Issue("warning", "smoother-window", ("poly_order", "window_size"), message)


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
        offsets = np.arange(-p.half, p.half + 1, dtype=np.float64)
        order = min(p.poly_order, 2 * p.half)
        self._weights = np.linalg.pinv(np.vander(offsets, order + 1, increasing=True))[0]

    @property
    def shortest(self) -> int:
        """Pieces of up to window_size + 2 steps stay as they are."""
        return 2 * self.params.half + 3

    def move(
        self, points: NDArray[np.float64], free: NDArray[np.bool_], costmap: Costmap | None
    ) -> NDArray[np.float64]:
        """Return the filtered points."""
        del costmap
        p, h = self.params, self.params.half
        out = points
        for _ in range(1 + (p.refinement_num if p.do_refinement else 0)):
            padded = np.concatenate([np.repeat(out[:1], h, axis=0), out, np.repeat(out[-1:], h, axis=0)])
            moved = sum(w * padded[k : k + len(out)] for k, w in enumerate(self._weights))
            out = np.where(free[:, None], moved, out)
        return out
