"""Recovery behaviors, stepwise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar

from navstack.core import (
    RobotState,
    Twist2D,
)
from navstack.core.parameters import ParamModel
from navstack.interfaces.costmap import CostmapServer
from navstack.interfaces.local_planner import LocalPlanner


@dataclass(frozen=True, slots=True, eq=False)
class RecoveryContext:
    """What a recovery behaviour may act on."""

    global_costmap: CostmapServer
    local_costmap: CostmapServer
    local_planner: LocalPlanner
    controller_frequency: float = 20.0


class RecoveryStatus(Enum):
    """Where a recovery behaviour stands after a step."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class RecoveryStep:
    """The velocity to command until the next step, and whether there will be one."""

    status: RecoveryStatus
    twist: Twist2D = Twist2D()
    text: str = ""
    """What was done or why it failed, for the log."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class RecoveryBehavior(ABC):
    """Stepwise, so that a cancel or a new goal takes effect within one cycle."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, name: str, params: Any) -> None:
        self.name = name
        self.params = params

    @property
    def frequency(self) -> float | None:
        """How often it wants to be stepped (Hz); None: at the controller's frequency."""
        return None

    @abstractmethod
    def start(self, context: RecoveryContext, now: float) -> None:
        """Called once, before the first step. May raise a RecoveryError."""

    @abstractmethod
    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """One step; `state.pose` in the local costmap's frame. Never blocks."""

    def check(self, context: RecoveryContext) -> None:
        """Raises a ParameterError when the parameters do not fit this robot; called once, before the first goal."""
        del context

    def follow_up(self, state: RobotState, now: float) -> bool:
        """Called once a control cycle after the last step, until it returns False: for effects that outlast the behaviour.

        A speed limit that holds for a distance, say. `state.pose` in the local costmap's frame.
        """
        del state, now
        return False
