"""given_path: the path of the parameters, to be driven as it is: for maneuvers that no planner finds, and to repeat a path."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from navstack.core import (
    Costmap,
    Footprint,
    NoValidPathError,
    Path,
    Pose2D,
    Twist2D,
    footprint_cost,
    integrate,
    normalize_angle,
)
from navstack.global_planner._search.start_goal import cells_of, with_yaw_in_range
from navstack.plugins import GLOBAL_PLANNERS, CheckContext, GlobalPlanner, Issue, ParamModel, Plan, param

_YAW_WEIGHT_M = 0.3
"""Distance (m) that counts as much as a difference of 1 rad when the pose of the path nearest to the robot is sought."""


class GivenPathParams(ParamModel):
    """The path, and how near to it the robot and the goal must be."""

    begin: list[float] = param([0.0, 0.0, 0.0], "first pose [x, y, yaw] of the path, in the frame of the costmap")
    segments: list[list[float]] = param(
        [],
        "arcs [length, curvature] of the path, m and 1/m, one after the other: a negative length is driven in reverse, a "
        "positive curvature turns the steering to the left",
    )
    step: float = param(0.05, "largest distance between two poses of the path", unit="m", gt=0.0)
    start_tolerance: float = param(
        0.5, "largest distance of the robot from the path, or the plan fails", unit="m", gt=0.0
    )
    goal_tolerance: float = param(
        0.1, "largest distance of the goal from the end of the path, or the plan fails", unit="m", ge=0.0
    )

    @field_validator("begin")
    @classmethod
    def _check_begin(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError(f"begin = {value} is not a pose; write [x, y, yaw] (m, m, rad)")
        return value

    @field_validator("segments")
    @classmethod
    def _check_segments(cls, value: list[list[float]]) -> list[list[float]]:
        for number, segment in enumerate(value, 1):
            if len(segment) != 2 or segment[0] == 0.0:
                raise ValueError(
                    f"segment {number} is {segment}; write [length, curvature] (m, 1/m) with a length other than 0"
                )
        return value

    @property
    def turning_radius(self) -> float:
        """Radius (m) of the tightest curve of the path; inf if it is straight."""
        tightest = max((abs(curvature) for _, curvature in self.segments), default=0.0)
        return 1.0 / tightest if tightest > 0.0 else math.inf

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the path from being driven."""
        del context
        if not self.segments:
            message = "given_path has no path, so every plan fails; set segments, and begin to its first pose"
            yield Issue("warning", "no-path", ("segments", "/base_global_planner"), message)

    def poses(self) -> NDArray[np.float64]:
        """(n, 3) the poses of the path (m, rad)."""
        rows = [Pose2D(self.begin[0], self.begin[1], normalize_angle(self.begin[2]))]
        for length, curvature in self.segments:
            first = rows[-1]
            count = max(1, math.ceil(abs(length) / self.step - 1e-9))
            whole = Twist2D(length, 0.0, length * curvature)
            rows += [integrate(first, whole, (k + 1) / count) for k in range(count)]
        return np.array(rows, np.float64)


@GLOBAL_PLANNERS.register("given_path")
class GivenPath(GlobalPlanner):
    """The rest of the path in the parameters, from the pose nearest to the robot on. An addition of navstack.

    Nothing is searched. The plan fails if the robot or the goal is not at the path, or if the footprint would hit an obstacle
    of the costmap on it. Where the path passes the robot's pose twice, as after a change of direction, the first pass counts:
    set planner_frequency to 0, so that the path is not begun again while the robot drives it. `Plan.cost` is the length in
    meters.
    """

    Params: ClassVar[type[ParamModel]] = GivenPathParams
    params: GivenPathParams

    def __init__(self, params: GivenPathParams | None = None) -> None:
        super().__init__(params or GivenPathParams())
        self._poses = self.params.poses()

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Return the rest of the path.

        Raises StartOutsideMapError, GoalOutsideMapError, InputError for a pose that is not finite, and NoValidPathError.
        """
        del keep_potential
        began = time.perf_counter()
        p = self.params
        start, goal = with_yaw_in_range(start), with_yaw_in_range(goal)
        cells_of(costmap, start, goal)
        if not p.segments:
            raise NoValidPathError("given_path has no path; set segments, and begin to its first pose")
        poses = self._poses
        aside = np.hypot(poses[:, 0] - start.x, poses[:, 1] - start.y)
        turned = np.abs(np.remainder(poses[:, 2] - start.yaw + math.pi, 2.0 * math.pi) - math.pi)
        first = int(np.argmin(aside + _YAW_WEIGHT_M * turned))
        if aside[first] > p.start_tolerance:
            raise NoValidPathError(
                f"the robot is {aside[first]:.2f} m from the given path, more than start_tolerance {p.start_tolerance:g} m; "
                f"drive to its first pose ({poses[0, 0]:.2f}, {poses[0, 1]:.2f}, {poses[0, 2]:.2f}), or raise start_tolerance",
                distance_m=float(aside[first]),
            )
        end = Pose2D(*poses[-1].tolist())
        moved = goal.distance_to(end)
        if moved > p.goal_tolerance:
            raise NoValidPathError(
                f"the given path ends at ({end.x:.2f}, {end.y:.2f}, {end.yaw:.2f}), {moved:.2f} m from the goal ({goal.x:.2f}, "
                f"{goal.y:.2f}), more than goal_tolerance {p.goal_tolerance:g} m; send its end as the goal",
                distance_m=moved,
                end=list(end),
            )
        if footprint is not None:
            self._require_free(costmap, footprint, first)
        path = Path(poses[first:].copy(), costmap.frame)
        return Plan(path, path.length, end, moved, took_s=time.perf_counter() - began)

    def _require_free(self, costmap: Costmap, footprint: Footprint, first: int) -> None:
        """Raise NoValidPathError for the first pose at which the footprint hits an obstacle."""
        for x, y, yaw in self._poses[first:].tolist():
            cost = footprint_cost(costmap, footprint, Pose2D(x, y, yaw))
            if cost is None or cost == 254:
                what = "leaves the costmap" if cost is None else "overlaps an obstacle"
                raise NoValidPathError(
                    f"the footprint {what} on the given path at ({x:.2f}, {y:.2f}, {yaw:.2f}); change the path, or remove the "
                    "obstacle",
                    at=[x, y, yaw],
                )
