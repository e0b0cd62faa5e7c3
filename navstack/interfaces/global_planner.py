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
    """What a global planner found."""

    path: Path
    """From the start to `goal`, in the costmap's frame."""
    cost: float
    """In the planner's own unit; comparable between plans of one planner on one costmap."""
    goal: Pose2D
    """The goal really used."""
    goal_moved_m: float = 0.0
    """How far that is from the goal asked for (default_tolerance)."""
    cells_expanded: int = 0
    potential: NDArray[np.float32] | None = None
    """(ny, nx), inf where not reached; only on request."""
    notes: tuple[str, ...] = ()
    """What the planner mended on the way, in sentences."""
    took_s: float | None = None
    """Wall time the planner took (s); None when it does not say. To be shown: it decides nothing and is not recorded."""

    @property
    def length_m(self) -> float:
        """Length of the path (m)."""
        return self.path.length

    def clearance_m(self, costmap: Costmap) -> float:
        """Smallest distance (m) of the path to a lethal cell of `costmap`, inf when it has none; computed on request."""
        return clearance_along(costmap, self.path.poses)


class GlobalPlanner(ABC):
    """Plans over a costmap that it never writes to."""

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
        """A plan between two poses in the costmap's frame; raises a PlanningError with code and data otherwise."""
