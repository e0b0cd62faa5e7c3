"""Behaviors: what a robot does apart from driving to a goal, step by step. Recovery behaviors and motions are one kind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, Generic

from typing_extensions import TypeVar

from navstack.core import Path, Pose2D, RobotState, Twist2D
from navstack.plugins.costmap import CostmapServer
from navstack.plugins.global_planner import Plan
from navstack.plugins.local_planner import ControlInput, LocalPlan, LocalPlanner
from navstack.plugins.localization import LocalizationStatus
from navstack.plugins.parameters import ParamModel

P = TypeVar("P", default=Any)
"""The parameters of a behavior."""


@dataclass(frozen=True, slots=True, eq=False)
class BehaviorContext:
    """What a behavior may act on."""

    global_costmap: CostmapServer
    local_costmap: CostmapServer
    local_planner: LocalPlanner
    controller_frequency: float = 20.0
    localization: Callable[[], LocalizationStatus | None] = lambda: None
    """Returns whether the robot is localized; None for a robot that does not report it."""
    control_input: Callable[[Plan, float], ControlInput] | None = None
    """Returns the local planner's input for a plan at a time (s); None without move_base. Raises NavError."""
    make_plan: Callable[[Pose2D, Pose2D], Plan] | None = None
    """Plans to a goal from a start, in the global costmap's frame; None without move_base. Raises PlanningError."""
    inform: Callable[[float, str], None] = lambda now, text: None
    """Writes a message of a time (s) to the record."""


class BehaviorStatus(Enum):
    """Status of a behavior after a step."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class BehaviorStep:
    """Result of one step: the status, and the velocity to command until the next step."""

    status: BehaviorStatus
    twist: Twist2D = Twist2D()
    text: str = ""
    """What was done, or why it failed, for the log."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class Behavior(ABC, Generic[P]):
    """Runs step by step, so that a cancel or a new goal takes effect within one cycle.

    A recovery behavior is listed in `recovery_behaviors` and runs when planning or control fails; a motion is started while no
    goal is active. The attributes below are for records and pictures, valid after the first step.
    """

    Params: ClassVar[type[ParamModel]]
    turns_in_place: ClassVar[bool] = False
    """True if it commands turns in place, which a base with a turning radius cannot drive."""

    frame: str = ""
    """Frame of `target` and `reference`."""
    target: Pose2D | None = None
    """Pose at which it ends (m, rad); None if it does not move, or ends elsewhere."""
    reference: Path | None = None
    """The path that the robot should drive."""
    local_plan: LocalPlan | None = None
    """The last command, with its reasons in sentences; its trajectory has the poses that were checked for collisions."""

    def __init__(self, name: str, params: P) -> None:
        self.name = name
        self.params = params

    @property
    def frequency(self) -> float | None:
        """Rate of the steps (Hz); None for the frequency of the control cycle."""
        return None

    @abstractmethod
    def start(self, context: BehaviorContext, now: float) -> None:
        """Prepare the first step; called once. May raise a RecoveryError."""

    @abstractmethod
    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Execute one step at `now` (s) without blocking; `state.pose` is in the local costmap's frame."""

    def check(self, context: BehaviorContext) -> None:
        """Raise a ParameterError if the parameters do not fit this robot; called once, before the first goal."""
        del context

    def describe(self) -> dict[str, Any]:
        """Return what it will do, as JSON data for the record."""
        return {}

    def release(self) -> None:
        """Undo what must not outlast the behavior, such as a speed limit; called after its end, also by a cancel or an error."""

    def follow_up(self, state: RobotState, now: float) -> bool:
        """Continue effects that outlast the behavior, such as a speed limit for a distance; return False at their end.

        Called in every control cycle after the last step until it returns False. `state.pose` is in the local costmap's frame.
        """
        del state, now
        return False


# the names under which plugins of others import them
RecoveryBehavior = Behavior
RecoveryContext = BehaviorContext
RecoveryStatus = BehaviorStatus
RecoveryStep = BehaviorStep
