"""Critics, which score simulated trajectories, and the data they exchange in a control cycle."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, Protocol

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeVar

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D, grid_record
from navstack.plugins.parameters import ParamModel
from navstack.plugins.rollouts import RolloutCells, Rollouts, VelocityLimits

P = TypeVar("P", default=Any)
"""Parameters of a critic."""


class DistanceGrid(Protocol):
    """Distances over the local costmap, which critics share in a cycle."""

    def values(self) -> NDArray[np.float64]:
        """(ny, nx) steps to the target; nx*ny in obstacles next to reached cells, nx*ny + 1 where unreachable."""
        ...

    def at_center(self, rollouts: Rollouts, cells: RolloutCells, out: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K,) value at the last point; -4 off the map, -3 in an obstacle, -2 unreachable at any point."""
        ...

    def at_nose(
        self, rollouts: Rollouts, cells: RolloutCells, ahead: float, out: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(K,) value `ahead` meters in front of the last point; -4 if this point is ever off the map."""
        ...


@dataclass(slots=True, eq=False)
class ScoringContext:
    """Input of the critics in one cycle, in the costmap's frame, and what they share."""

    state: RobotState
    costmap: Costmap
    footprint: Footprint
    plan: NDArray[np.float64]
    """(n, 3) the part of the plan inside the costmap."""
    goal: Pose2D
    """The final goal."""
    limits: VelocityLimits
    notes: list[str] = field(default_factory=list[str])
    """Remarks of the critics on this cycle; they become `LocalPlan.notes`."""
    cells: RolloutCells | None = None
    """Cells of the rollouts, computed by the first critic that needs them."""
    path_grid: DistanceGrid | None = None
    """Distances to the plan, computed by the first critic that needs them."""
    shared: dict[str, Any] = field(default_factory=dict[str, Any])
    """What else critics compute once for all of them, by a name of their own."""
    _grid: NDArray[Any] | None = None

    @property
    def grid(self) -> NDArray[Any]:
        """(1,) geometry of the costmap for kernels, see `grid_record`."""
        if self._grid is None:
            self._grid = grid_record(self.costmap.geometry)
        return self._grid


@dataclass(frozen=True, slots=True)
class RejectionDetail:
    """Why a critic rejected one rollout."""

    reason: str = ""
    step: int | None = None
    """Point of the rollout at which it was rejected."""
    pose: Pose2D | None = None
    """Pose at that point."""
    ahead_m: float | None = None
    """Distance travelled up to that point (m)."""
    cell: tuple[int, int] | None = None
    """ix, iy of the cell in collision; None if the footprint leaves the map."""
    cost: int | None = None
    """Cost of that cell."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON; the place only where there is one."""
        if self.step is None or self.pose is None:
            return {"reason": self.reason}
        return {
            "reason": self.reason,
            "step": self.step,
            "pose": list(self.pose),
            "ahead_m": self.ahead_m,
            "cell": None if self.cell is None else list(self.cell),
            "cost": self.cost,
        }


class Critic(ABC, Generic[P]):
    """Scores rollouts; `class Own(Critic[OwnParams])` has its parameters in `params`. One file each.

    Life cycle: `reset` with every plan; in each control cycle `prepare`, then `score`, then `debrief` with the selected
    command. `explain` describes the last scored cycle on request.
    """

    Params: ClassVar[type[ParamModel]]
    CODES: ClassVar[dict[int, str]] = {}
    """Negative score -> reason for the rejection."""

    def __init__(self, name: str, params: P) -> None:
        self.name = name
        self.params = params

    @property
    def scale(self) -> float:
        """Weight of this critic's scores in the total; a critic with weight 0 is skipped."""
        return 1.0

    def reset(self) -> None:
        """Clear the state that is kept between cycles. Called with every plan and for every command at the goal."""

    def prepare(self, context: ScoringContext) -> None:
        """Called once per cycle, before `score`."""

    @abstractmethod
    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) raw costs; a negative one rejects the row, see `CODES`. Rows that are not alive may hold any value."""

    def debrief(self, command: Twist2D, pose: Pose2D) -> None:
        """Called with the command selected in this cycle and the robot's pose."""

    def explain(self, row: int) -> RejectionDetail:
        """Why this critic rejected a row in the last scored cycle; an empty reason: see `CODES`."""
        del row
        return RejectionDetail()

    def nearest_rejection(self, rows: NDArray[np.intp]) -> int:
        """The one of `rows`, all rejected by this critic, that was rejected nearest to the robot; used in messages."""
        return int(rows[0])

    def grid_values(self) -> NDArray[np.float64] | None:
        """(ny, nx) of the grid used in the last cycle; None for a critic without a grid."""
        return None

    def state(self) -> dict[str, Any]:
        """State that is kept between cycles, for diagnostics."""
        return {}
