"""Global planners, the plans they return, and smoothers of these plans."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Generic

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Footprint,
    Path,
    Pose2D,
    clearance_along,
)
from navstack.plugins.parameters import P, ParamModel


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The result of a global planner."""

    path: Path
    """From the start to `goal`, in the costmap's frame."""
    cost: float
    """In the unit of the planner; comparable between plans of one planner on one costmap."""
    goal: Pose2D
    """The goal that the path ends at."""
    goal_moved_m: float = 0.0
    """Its distance from the requested goal (default_tolerance)."""
    cells_expanded: int = 0
    potential: NDArray[np.float32] | None = None
    """(ny, nx), inf where unreached; only on request."""
    notes: tuple[str, ...] = ()
    """What the planner adjusted, in sentences."""
    for_footprint: bool = False
    """Whether the robot drives the path with the heading of each pose, for which its footprint was checked."""
    took_s: float | None = None
    """Elapsed planning time (s), None if not measured. For display only: it affects no result and is not recorded."""

    @property
    def length_m(self) -> float:
        """Length of the path (m)."""
        return self.path.length

    def clearance_m(self, costmap: Costmap) -> float:
        """Smallest distance (m) of the path to a lethal cell of `costmap`, inf without lethal cells; computed at each call."""
        return clearance_along(costmap, self.path.poses)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.path.length:.2f} m, {len(self.path)} poses, cost {self.cost:.0f})"


class GlobalPlanner(ABC, Generic[P]):
    """Plans paths over a costmap, which it never writes to."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: P) -> None:
        self.params = params

    @abstractmethod
    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Plan between two poses in the frame of the costmap; raise a PlanningError with code and data on failure.

        `footprint`: that of the robot, for planners that use it. `keep_potential`: return the potential with the plan, if the
        planner computes one.
        """


class Smoother(ABC, Generic[P]):
    """Replaces the poses of a path by smoother ones that the robot can drive as well."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: P) -> None:
        self.params = params

    @abstractmethod
    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        """Return a smoother path with the same ends, in the frame of the costmap; `path` and `costmap` are unchanged.

        No pose of the result is in collision (cost 253 or 254 at its center, or `footprint` over a lethal cell) unless the path
        was there already. A path that cannot be smoothed is returned as it is. Raises InputError for a path that is not finite.
        """
