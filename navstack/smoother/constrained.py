"""constrained: the path of least smoothness, curvature, distance and cost terms (Nav2's ConstrainedSmoother)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path
from navstack.core.errors import InputError
from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Smoother
from navstack.plugins import SMOOTHERS
from navstack.smoother._chain import ARC_HANDLE, HANDLE, Chain, kept_poses, upsampled
from navstack.smoother._least_squares import Grid, Problem, Stops, Weights, minimize
from navstack.smoother.base import is_good, is_smooth

_SAME_M: Final = 1e-4
_STRICTER: Final = ((1.0, 0.0, 1.0), (1e4, 1e-4, 0.95), (1e5, 1e-2, 0.97), (1e6, 1e-1, 0.98))
"""What is tried one after the other until a result is free: factor on w_curve, w_dist as a share of w_smooth, and factor on the
limit of the curvature, which the result exceeds a little. From the second on, cusps stay and all poses are optimized."""


class ConstrainedOptimizerParams(ParamModel):
    """The section `optimizer:` of Nav2's smoother."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "linear_solver_type": "the normal equations are banded, and solved by a banded Cholesky decomposition",
        "debug_optimizer": "nothing is printed",
    }

    max_iterations: int = param(100, "limit on the iterations", ge=1, le=10_000)
    param_tol: float = param(1e-15, "a step shorter than this is the last one", unit="m", ge=0.0)
    fn_tol: float = param(1e-7, "a relative change of the sum smaller than this ends the iterations", ge=0.0)
    gradient_tol: float = param(1e-10, "a gradient smaller than this ends the iterations", ge=0.0)


class ConstrainedSmootherParams(ParamModel):
    """Parameters of constrained, under Nav2's names."""

    minimum_turning_radius: float = param(
        0.4,
        "turning radius of the robot: sharper turns are penalized, and results that turn more sharply, and more sharply than the "
        "path, are dropped; 0 = no limit",
        unit="m",
        ge=0.0,
        ros_differs="Nav2's result may turn more sharply",
    )
    w_smooth: float = param(2_000_000.0, "weight of even steps", ge=0.0)
    w_curve: float = param(30.0, "weight of curvature above 1 / minimum_turning_radius", ge=0.0)
    w_dist: float = param(0.0, "weight of the distance from the path", ge=0.0)
    w_cost: float = param(0.015, "weight of the costs of cells", ge=0.0)
    w_cost_cusp_multiplier: float = param(3.0, "factor on w_cost at a change of direction", ge=0.0)
    cusp_zone_length: float = param(
        2.5, "length of the path around a change of direction in which that factor decreases to 1", unit="m", gt=0.0
    )
    cost_check_points: list[float] = param(
        [], "points of the robot at which costs count, [x, y, weight, x, y, weight, ..]; none = its centre", unit="m"
    )
    path_downsampling_factor: int = param(1, "every n-th pose of the path is optimized", ge=1, le=1000)
    path_upsampling_factor: int = param(
        1, "poses of the result per pose of the path; 0 = only those that were optimized", ge=0, le=100
    )
    reversing_enabled: bool = param(True, "whether poses that look away from the next one are driven backward")
    keep_start_orientation: bool = param(True, "whether the second pose stays, and so the first heading")
    keep_goal_orientation: bool = param(True, "whether the last pose but one stays, and so the last heading")
    sections: dict[str, Any] = param({}, "Nav2's section `optimizer:`")

    CHILD_FIELD: ClassVar[str | None] = "sections"

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the section `optimizer`."""
        del values
        return {"optimizer": ConstrainedOptimizerParams}

    @property
    def optimizer(self) -> ConstrainedOptimizerParams:
        """The section `optimizer`."""
        section = self.sections.get("optimizer", {})
        return section if isinstance(section, ConstrainedOptimizerParams) else ConstrainedOptimizerParams(**section)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue for cost_check_points that are no triples, or have no weight."""
        del context
        points = self.cost_check_points
        if len(points) % 3 != 0 or any(w < 0.0 for w in points[2::3]) or (points and sum(points[2::3]) == 0.0):
            message = (
                f"cost_check_points has {len(points)} values; write [x, y, weight, x, y, weight, ..] with weights of at least 0, "
                "not all 0"
            )
            yield Issue("error", "cost-check-points", ("cost_check_points",), message)

    def checks(self) -> NDArray[np.float64]:
        """(k, 3) x, y and share of the points of cost_check_points; roots of their weights, with the sum 1 (as Nav2)."""
        points = np.array(self.cost_check_points, np.float64).reshape(-1, 3)
        shares = np.sqrt(points[:, 2])
        return np.column_stack((points[:, :2], shares / shares.sum())) if len(points) else np.zeros((0, 3))


@SMOOTHERS.register("constrained", aliases=("nav2_constrained_smoother/ConstrainedSmoother", "constrained_smoother"))
class ConstrainedSmoother(Smoother):
    """constrained: nonlinear least squares over the positions (Levenberg-Marquardt), away from costs, with a turning radius.

    Cusps move with the path. `unchecked` is Nav2's result. `smooth` checks it: where it collides or turns too sharply, the
    optimization is repeated with all poses, cusps that stay, and greater weights of curvature and distance from the path; pieces
    between cusps that are still not free stay as they were.
    """

    Params = ConstrainedSmootherParams
    params: ConstrainedSmootherParams

    def __init__(self, params: ConstrainedSmootherParams | None = None) -> None:
        super().__init__(params or ConstrainedSmootherParams())

    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        """Return a smoother path that is free, and turns no more sharply than the turning radius, or than the path did.

        Raises InputError for a path that is not finite.
        """
        if not np.isfinite(path.poses).all():
            raise InputError("the path to be smoothed has poses that are not finite; give x, y (m) and yaw (rad)")
        if len(path) < 2:
            return path
        poses = path.poses
        last = len(poses) - 1
        out = [
            self._within(a > 0, b < last)._stretch(poses[a : b + 1], costmap, footprint) for a, b in stretches(poses)
        ]
        return Path(np.concatenate([*(part[:-1] for part in out), out[-1][-1:]]), path.frame)

    def unchecked(self, path: Path, costmap: Costmap) -> NDArray[np.float64]:
        """Return the smoothed poses before they are checked, as Nav2's smoother returns them."""
        out = [self._smoothed(path.poses[a : b + 1], costmap, 0)[0] for a, b in stretches(path.poses)]
        return np.concatenate([*(part[:-1] for part in out), out[-1][-1:]])

    def _within(self, after: bool, before: bool) -> ConstrainedSmoother:
        """The smoother of a stretch: one after or before a turn in place keeps its heading there."""
        p = self.params
        kept = {"keep_start_orientation": p.keep_start_orientation or after}
        kept["keep_goal_orientation"] = p.keep_goal_orientation or before
        return ConstrainedSmoother(p.model_copy(update=kept))

    def _stretch(
        self, poses: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None
    ) -> NDArray[np.float64]:
        """Smooth a stretch without turns in place."""
        if len(poses) < 3:
            return poses
        parts: list[NDArray[np.float64]] = []
        pieces: list[tuple[int, int]] = []
        for level in range(len(_STRICTER)):
            out, starts, chain = self._smoothed(poses, costmap, level)
            pieces = list(pairwise(chain.bounds))
            after = [out[starts[a] : starts[b] + 1] for a, b in pieces]
            good = [
                is_good(poses[a : b + 1], piece, costmap, footprint, self.params.minimum_turning_radius)
                for (a, b), piece in zip(pieces, after, strict=True)
            ]
            if all(good):
                return out
            parts = [
                piece if free else poses[a : b + 1] for (a, b), piece, free in zip(pieces, after, good, strict=True)
            ]
        # at a cusp between a smoothed piece and one that stays, the headings differ a little: that of the former is kept
        joined = [parts[0], *(np.concatenate((a[-1:], b[1:])) for a, b in pairwise(parts))]
        radius = self.params.minimum_turning_radius
        if not all(is_smooth(poses[a : b + 1], piece, radius) for (a, b), piece in zip(pieces, joined, strict=True)):
            return poses
        return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])

    def _smoothed(
        self, poses: NDArray[np.float64], costmap: Costmap, level: int
    ) -> tuple[NDArray[np.float64], dict[int, int], Chain]:
        """Optimize a stretch at a level of _STRICTER; return it, the new numbers of its kept poses, and what was kept."""
        p, g = self.params, costmap.geometry
        chain = kept_poses(poses, p, p.path_downsampling_factor if level == 0 else 1)
        points = poses[chain.kept, :2]
        free = np.ones(len(points), np.bool_)
        free[0] = free[-1] = False
        if p.keep_start_orientation:
            free[min(1, len(free) - 1)] = False
        if p.keep_goal_orientation:
            free[max(0, len(free) - 2)] = False
        curve, dist, share = _STRICTER[level]
        if level > 0:
            free[chain.cusp] = False
        if free.any():
            limit = share / p.minimum_turning_radius if p.minimum_turning_radius > 0.0 else math.inf
            weights = Weights(p.w_smooth, curve * p.w_curve, p.w_dist + dist * p.w_smooth, limit)
            grid = Grid(costmap.data, np.array([g.origin_x, g.origin_y]), g.resolution)
            problem = Problem(grid, points, chain.ratio, chain.cost_weight, free, weights, p.checks(), chain.backward)
            o = p.optimizer
            moved = minimize(problem, points, Stops(o.max_iterations, o.param_tol, o.fn_tol, o.gradient_tol))
            points = points if moved is None else moved
        return *upsampled(poses, points, chain, p, HANDLE if level == 0 else ARC_HANDLE), chain


def stretches(poses: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return first and last pose of each stretch; steps without a distance, as in turns in place, are stretches of their own."""
    if len(poses) < 2:
        return []
    still = (np.abs(np.diff(poses[:, :2], axis=0)) < _SAME_M).all(axis=1)
    cuts = {0, len(poses) - 1}
    for i in np.flatnonzero(still).tolist():
        cuts |= {i, i + 1}
    return list(pairwise(sorted(cuts)))
