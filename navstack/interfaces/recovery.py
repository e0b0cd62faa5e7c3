"""Recovery behaviors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
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
from navstack.interfaces.localization import LocalizationStatus


@dataclass(frozen=True, slots=True, eq=False)
class RecoveryContext:
    """What a recovery behavior may act on."""

    global_costmap: CostmapServer
    local_costmap: CostmapServer
    local_planner: LocalPlanner
    controller_frequency: float = 20.0
    localization: Callable[[], LocalizationStatus | None] = lambda: None
    """Returns whether the robot is localized; None for a robot that does not report it."""


class RecoveryStatus(Enum):
    """Status of a recovery behavior after a step."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class RecoveryStep:
    """Result of one step: the status, and the velocity to command until the next step."""

    status: RecoveryStatus
    twist: Twist2D = Twist2D()
    text: str = ""
    """What was done, or why it failed, for the log."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class RecoveryBehavior(ABC):
    """A recovery behavior runs step by step, so that a cancel or a new goal takes effect within one cycle."""

    Params: ClassVar[type[ParamModel]]
    turns_in_place: ClassVar[bool] = False
    """True if it commands turns in place, which a base with a turning radius cannot drive."""

    def __init__(self, name: str, params: Any) -> None:
        self.name = name
        self.params = params

    @property
    def frequency(self) -> float | None:
        """Rate of the steps (Hz); None for the frequency of the control cycle."""
        return None

    @abstractmethod
    def start(self, context: RecoveryContext, now: float) -> None:
        """Prepare the first step; called once. May raise a RecoveryError."""

    @abstractmethod
    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Execute one step at `now` (s) without blocking; `state.pose` is in the local costmap's frame."""

    def check(self, context: RecoveryContext) -> None:
        """Raise a ParameterError if the parameters do not fit this robot; called once, before the first goal."""
        del context

    def follow_up(self, state: RobotState, now: float) -> bool:
        """Continue effects that outlast the behavior, such as a speed limit for a distance; return False at their end.

        Called in every control cycle after the last step until it returns False. `state.pose` is in the local costmap's frame.
        """
        del state, now
        return False
