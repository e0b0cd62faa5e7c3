"""Docks: what a type of dock is to the robot, and what finds a dock in the data of sensors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Generic, Protocol, runtime_checkable

from typing_extensions import TypeVar

from navstack.core import BatteryState, DockDetection, Pose2D, RobotState, SensorData, Transform2D, Twist2D
from navstack.plugins.guards import check_results, pose_problem, truth_problem
from navstack.plugins.parameters import ParamModel

P = TypeVar("P", default=Any)
"""The parameters of a plugin."""


@runtime_checkable
class DockingRobot(Protocol):
    """What a robot has besides the interface `Robot` if it docks by a detector or charges a battery."""

    def dock_detections(self) -> Sequence[DockDetection]:
        """Return the detections since the last call, the oldest first."""
        ...

    @property
    def battery_state(self) -> BatteryState | None:
        """The last state of the battery; None for a robot that does not report it."""
        ...


def _detection_problem(value: Any) -> str:
    return "" if value is None or isinstance(value, DockDetection) else "which is not a DockDetection or None"


def _refined_problem(value: Any) -> str:
    return "" if value is None else pose_problem(value)


class DockDetector(ABC, Generic[P]):
    """Finds the marker of a dock in one measurement. It draws no random numbers and reads no clock.

    What it returns is a pure function of its parameters and of the arguments since `reset`.
    """

    Params: ClassVar[type[ParamModel]]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        check_results(cls, {"detect": _detection_problem})

    def __init__(self, params: P) -> None:
        self.params = params
        self.remark = ""
        """What the last measurement showed, or why it shows no dock, in a few words."""

    def reset(self) -> None:
        """Forget earlier measurements: a new approach begins."""
        self.remark = ""

    @abstractmethod
    def detect(self, data: SensorData | DockDetection, expected: Pose2D) -> DockDetection | None:
        """Return where the marker is, in the frame of `data`; None if the measurement does not show it.

        `expected`: where it should be, in that frame (m, rad); its x axis points into the dock.
        """


class DockType(ABC, Generic[P]):
    """A type of dock: where the robot stages, where exactly the dock is, and when the robot is docked or charges.

    All poses are in the fixed frame; the x axis of a dock's pose points into the dock.
    """

    Params: ClassVar[type[ParamModel]]
    is_charger: ClassVar[bool] = False
    """True if the robot waits for a charging current after it has docked."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        names = ("drives_backward", "rotates_to_dock", "is_docked", "is_charging")
        poses = {"staging_pose": pose_problem, "refined_pose": _refined_problem}
        check_results(cls, {**dict.fromkeys(names, truth_problem), **poses})

    def __init__(self, name: str, params: P) -> None:
        self.name = name
        self.params = params

    @property
    def drives_backward(self) -> bool:
        """True if the robot drives into the dock backward."""
        return False

    @property
    def rotates_to_dock(self) -> bool:
        """True if the robot turns around after it has seen the dock, to drive in backward."""
        return False

    @abstractmethod
    def staging_pose(self, dock: Pose2D) -> Pose2D:
        """Return the pose before the dock from which the robot drives in."""

    @abstractmethod
    def begin(self, dock: Pose2D, now: float) -> None:
        """Begin a new approach to a dock that is known to be at this pose, at `now` (s)."""

    @abstractmethod
    def observe(self, data: SensorData | DockDetection, to_fixed: Transform2D) -> None:
        """Take a measurement; `to_fixed` is the pose of its frame in the fixed frame at its stamp."""

    @abstractmethod
    def refined_pose(self, now: float) -> Pose2D | None:
        """Return where the dock is by the measurements; None if there is none, or none recently."""

    @abstractmethod
    def is_docked(self, pose: Pose2D, state: RobotState, command: Twist2D) -> bool:
        """Return True if the robot at `pose` is in the dock; `command` is the last command."""

    def is_charging(self, battery: BatteryState | None, *, docked: bool) -> bool:
        """Return True if the battery is charged; `docked`: whether the robot is in the dock."""
        del battery, docked
        return False

    def seen(self) -> str:
        """Return in a few words what the detector saw last."""
        return ""
