"""simple: each point moves toward the mean of its neighbors (Nav2's SimpleSmoother)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap
from navstack.global_planner.smoothers import base as kernels
from navstack.global_planner.smoothers.base import PointSmoother, PointSmootherParams
from navstack.plugins import SMOOTHERS, param

_NO_COSTS: Final = np.zeros((0, 0), np.uint8)


class SimpleSmootherParams(PointSmootherParams):
    """Parameters of simple."""

    tolerance: float = param(1e-10, "a sweep that moves the points by less in sum is the last one", unit="m", gt=0.0)
    max_its: int = param(1000, "limit on the sweeps of a pass", ge=1)
    w_data: float = param(0.2, "weight of the distance from the path", ge=0.0, le=1.0)
    w_smooth: float = param(0.3, "weight of smoothness", ge=0.0, le=0.5)


@SMOOTHERS.register("simple", aliases=("nav2_smoother/SimpleSmoother", "simple_smoother"))
class SimpleSmoother(PointSmoother):
    """simple: gradient descent on smoothness and the distance from the path.

    Equal to Nav2's SimpleSmoother where the result is free (`PointSmoother.smooth`). Nav2 ends all sweeps before the first one
    that enters an inscribed cell (`unchecked`).
    """

    Params = SimpleSmootherParams

    def __init__(self, params: SimpleSmootherParams | None = None) -> None:
        super().__init__(params or SimpleSmootherParams())

    @property
    def shortest(self) -> int:
        """Pieces of up to 3 steps stay as they are."""
        return 3

    def move(
        self, points: NDArray[np.float64], free: NDArray[np.bool_], costmap: Costmap | None
    ) -> NDArray[np.float64]:
        """Return the relaxed points."""
        p = self.params
        costs, grid = _NO_COSTS, np.zeros(3)
        if costmap is not None:
            g = costmap.geometry
            costs, grid = costmap.data, np.array([g.origin_x, g.origin_y, g.resolution])
        weights, limits = np.array([p.w_data, p.w_smooth]), np.array([p.tolerance, float(p.max_its)])
        out, previous = points.copy(), np.empty_like(points)
        for k in range(1 + (p.refinement_num if p.do_refinement else 0)):
            data = points if k == 0 else out.copy()
            if not kernels.relax(costs, grid, data, free, out, previous, weights, limits):
                break
        return out
