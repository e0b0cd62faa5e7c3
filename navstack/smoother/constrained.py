"""constrained: the path of least smoothness, curvature, distance and cost terms (Nav2's ConstrainedSmoother)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path
from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Smoother
from navstack.plugins import SMOOTHERS
from navstack.smoother._chain import Chain, headings, kept_poses, upsampled, with_kept_ends, with_yaws
from navstack.smoother._checks import SAME_M, curvatures, is_good, smooth_where_good
from navstack.smoother._least_squares import Problem, Stops, Weights, minimize
from navstack.smoother.base import require_finite

_STIFF: Final = 1e4
"""Factor on w_curve where the turning radius is a bound."""
_ROUNDS: Final = 8
"""Limit on the minimizations until it is kept."""
_SHARE: Final = 0.999
"""Share of the curvature that it aims at, so that rounds end."""
_STRAIGHT_M2: Final = 1e-12
"""See `headings`: exact ones, however short the steps are."""


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

    Cusps move with the path. `unchecked` is Nav2's result. `smooth` checks it: where it collides or turns too sharply, the pieces
    between cusps are optimized on their own, with all poses and with the turning radius as a bound; poses where the result is
    still not good stay as they were.
    """

    Params = ConstrainedSmootherParams
    params: ConstrainedSmootherParams

    def __init__(self, params: ConstrainedSmootherParams | None = None) -> None:
        super().__init__(params or ConstrainedSmootherParams())

    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        """Return a smoother path that is free, and turns no more sharply than the turning radius, or than the path did.

        Raises InputError for a path that is not finite.
        """
        require_finite(path)
        poses = path.poses
        if len(poses) < 2:
            return path
        last = len(poses) - 1
        out = [
            self._within(a > 0, b < last)._stretch(poses[a : b + 1], costmap, footprint) for a, b in stretches(poses)
        ]
        return Path(joined(out), path.frame)

    def unchecked(self, path: Path, costmap: Costmap) -> NDArray[np.float64]:
        """Return the smoothed poses before they are checked, as Nav2's smoother returns them."""
        return joined([self._as_nav2(path.poses[a : b + 1], costmap)[0] for a, b in stretches(path.poses)])

    def _within(self, after: bool, before: bool) -> ConstrainedSmoother:
        """The smoother of a part of a path: after or before another one, it keeps its heading there."""
        p = self.params
        kept = {"keep_start_orientation": p.keep_start_orientation or after}
        kept["keep_goal_orientation"] = p.keep_goal_orientation or before
        return ConstrainedSmoother(p.model_copy(update=kept))

    def _stretch(
        self, poses: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None
    ) -> NDArray[np.float64]:
        """Smooth a stretch without turns in place: as Nav2, or each piece between its cusps where that is not good."""
        if len(poses) < 3:
            return poses
        out, starts, chain = self._as_nav2(poses, costmap)
        pieces = list(pairwise(chain.bounds))
        radius, last = self.params.minimum_turning_radius, len(poses) - 1
        if all(
            is_good(poses[a : b + 1], out[starts[a] : starts[b] + 1], costmap, footprint, radius) for a, b in pieces
        ):
            return out
        chain = kept_poses(poses, self.params, 1)
        return joined(
            [
                self._within(a > 0, b < last)._piece(poses[a : b + 1], chain.part(a, b), costmap, footprint)
                for a, b in pieces
            ]
        )

    def _as_nav2(
        self, poses: NDArray[np.float64], costmap: Costmap
    ) -> tuple[NDArray[np.float64], dict[int, int], Chain]:
        """Optimize a stretch as Nav2 does; return it, the new numbers of its kept poses, and what was kept."""
        p = self.params
        chain = kept_poses(poses, p, p.path_downsampling_factor)
        points = poses[chain.kept, :2]
        limit = np.full(len(points), 1.0 / p.minimum_turning_radius if p.minimum_turning_radius > 0.0 else math.inf)
        problem = self._problem(points, chain, costmap, self._free(len(points)), p.w_curve, limit)
        return *upsampled(poses, self._minimum(problem, points), chain, p), chain

    def _piece(
        self, poses: NDArray[np.float64], chain: Chain, costmap: Costmap, footprint: Footprint | None
    ) -> NDArray[np.float64]:
        """Smooth a piece between two cusps, where the result is good."""
        inner = self._free(len(poses))
        return smooth_where_good(
            poses,
            lambda free: self._bounded(poses, chain, costmap, free & inner),
            costmap,
            footprint,
            self.params.minimum_turning_radius,
        )

    def _bounded(
        self, poses: NDArray[np.float64], chain: Chain, costmap: Costmap, free: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Optimize the free poses of a piece (n, 3) within the turning radius.

        The bound is kept by the method of multipliers (M. Hestenes, 1969): where the curvature exceeds it, it counts from a lower
        limit on, and the sum is minimized again.
        """
        p = self.params
        points = poses[:, :2]
        radius = p.minimum_turning_radius
        bound = _SHARE / radius if radius > 0.0 else math.inf
        limit = np.full(len(points), bound)
        for _ in range(_ROUNDS if radius > 0.0 and p.w_curve > 0.0 else 1):
            problem = self._problem(poses[:, :2], chain, costmap, free, _STIFF * p.w_curve, limit)
            points = self._minimum(problem, points)
            over = np.zeros(len(points))
            over[1:-1] = curvatures(points) - bound
            over[~free] = 0.0
            if over.max() * radius <= 1.0 - _SHARE:
                break
            limit = np.minimum(bound, limit - over)
        out = with_yaws(points, headings(poses, points, chain, p, _STRAIGHT_M2))
        stay = np.flatnonzero(~(free[:-2] | free[1:-1] | free[2:])) + 1
        out[stay, 2] = poses[stay, 2]
        return with_kept_ends(out, poses, p)

    def _free(self, count: int) -> NDArray[np.bool_]:
        """Which of the poses may move: not the ends, nor the poses beside them if the headings there stay."""
        free = np.ones(count, np.bool_)
        first, last = 1 + self.params.keep_start_orientation, 1 + self.params.keep_goal_orientation
        free[:first] = free[max(0, count - last) :] = False
        return free

    def _problem(
        self,
        original: NDArray[np.float64],
        chain: Chain,
        costmap: Costmap,
        free: NDArray[np.bool_],
        w_curve: float,
        limit: NDArray[np.float64],
    ) -> Problem:
        """The least squares of points (n, 2), with curvature above `limit` (n,)."""
        weights = Weights(self.params.w_smooth, w_curve, self.params.w_dist)
        given = original, chain.ratio, chain.cost_weight, limit
        return Problem.of(costmap, weights, given, free, chain.backward, self.params.checks())

    def _minimum(self, problem: Problem, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (n, 2) of least squares, or those given where nothing is free or no step helps."""
        if not problem.free.any():
            return points
        o = self.params.optimizer
        found = minimize(problem, points, Stops(o.max_iterations, o.param_tol, o.fn_tol, o.gradient_tol))
        return points if found is None else found


def joined(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the poses of successive parts, which share their ends."""
    return np.concatenate([*(part[:-1] for part in parts), parts[-1][-1:]])


def stretches(poses: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return first and last pose of each stretch; steps without a distance, as in turns in place, are stretches of their own."""
    if len(poses) < 2:
        return []
    still = (np.abs(np.diff(poses[:, :2], axis=0)) < SAME_M).all(axis=1)
    cuts = {0, len(poses) - 1}
    for i in np.flatnonzero(still).tolist():
        cuts |= {i, i + 1}
    return list(pairwise(sorted(cuts)))
