"""Global planners and the plans they return."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Footprint,
    Path,
    Pose2D,
)
from navstack.core.clearance import clearance_along
from navstack.core.parameters import ParamModel


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


class GlobalPlanner(ABC):
    """Plans paths over a costmap, which it never writes to."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: Any) -> None:
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
