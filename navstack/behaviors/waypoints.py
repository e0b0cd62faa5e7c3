"""Tasks at waypoints: what a robot does where it stops, and the report of each waypoint (nav2_waypoint_follower)."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors.base import TimedBehavior
from navstack.behaviors.wait import Pause
from navstack.core import InputError, NavError, Pose2D, RobotState, atomic_write, ensure_directory
from navstack.plugins import Behavior, BehaviorStatus, BehaviorStep, ParamModel, param

WaypointExecutor = Callable[[int, Pose2D], "Behavior | bool | None"]
"""What is done at a waypoint: gets its index and pose; returns a behavior to run there, or False for a failure."""


class WaypointError(NavError):
    """Waypoints could not be followed."""

    code = 600
    name = "UNKNOWN"


class ExecutorFailedError(WaypointError):
    """The task at a waypoint failed."""

    code = 601
    name = "TASK_EXECUTOR_FAILED"


class NoWaypointsError(WaypointError, InputError):
    """There are no waypoints, or not the one to begin with."""

    code = 602
    name = "NO_VALID_WAYPOINTS"


class MissedWaypointError(WaypointError):
    """A waypoint was missed, and the task ends at the first one."""

    code = 603
    name = "STOP_ON_MISSED_WAYPOINT"


class WaypointStatus(IntEnum):
    """Status of a waypoint, with Nav2's numbers."""

    PENDING = 0
    COMPLETED = 1
    SKIPPED = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class WaypointReport:
    """How a waypoint went: Nav2's message WaypointStatus, with loop and times."""

    waypoint_index: int
    waypoint_pose: Pose2D
    waypoint_status: WaypointStatus
    error_code: int = 0
    error_msg: str = ""
    loop: int = 0
    """0 for the first pass."""
    started_s: float = 0.0
    """When the robot set out for it (s)."""
    ended_s: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            "waypoint_index": self.waypoint_index,
            "waypoint_pose": list(self.waypoint_pose),
            "waypoint_status": self.waypoint_status.name,
            "error_code": self.error_code,
            "error_msg": self.error_msg,
            "loop": self.loop,
            "started_s": self.started_s,
            "ended_s": self.ended_s,
        }


class Picture(Protocol):
    """What a camera returns."""

    rgb: NDArray[np.uint8]
    """(height, width, 3)."""


class WaitAtWaypoint:
    """Stands still at each waypoint."""

    def __init__(self, duration: float = 0.2) -> None:
        """`duration` in s; Nav2's parameter waypoint_pause_duration is in ms. Raises InvalidMotionError."""
        self.duration = Pause(duration).params.wait_duration

    def __call__(self, index: int, pose: Pose2D) -> Behavior:
        """Return the pause."""
        return Pause(self.duration)


class PhotoAtWaypoint:
    """Takes a photo at each waypoint: waypoint_0.png, .."""

    def __init__(self, camera: Callable[[], Picture], save_dir: str | os.PathLike[str]) -> None:
        """`camera` returns a picture, such as `robot.camera` of a simulated robot. The folder is made. Raises OutputError."""
        self.camera = camera
        self.folder = ensure_directory(Path(save_dir))
        self.taken: list[Path] = []

    def __call__(self, index: int, pose: Pose2D) -> bool:
        """Take and write the photo; of later loops the number of the photo is part of the name. Raises OutputError."""
        from PIL import Image  # slow import

        file = self.folder / f"waypoint_{index}.png"
        if file in self.taken:
            file = self.folder / f"waypoint_{index}_{len(self.taken)}.png"
        with atomic_write(file) as beside:
            Image.fromarray(self.camera().rgb).save(beside)
        self.taken.append(file)
        return True


class InputParams(ParamModel):
    """Parameters of InputAtWaypoint."""

    timeout: float = param(10.0, "time after which the task fails", unit="s", gt=0.0)


class AwaitInput(TimedBehavior[InputParams]):
    """Stands still until a function returns True, or fails after the time-out."""

    Params = InputParams
    timeout = ExecutorFailedError

    def __init__(self, ready: Callable[[], bool], params: InputParams, name: str = "input") -> None:
        super().__init__(name, params)
        self.ready = ready

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Return the time-out (s)."""
        return self.params.timeout

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Ask the function."""
        return BehaviorStep(BehaviorStatus.DONE if self.ready() else BehaviorStatus.RUNNING)

    def summary(self) -> str:
        """Return what is missing."""
        return "no input came"

    def within_allowance(self) -> str:
        """Return the time-out."""
        return f"within its timeout of {self.allowance:g} s"


class InputAtWaypoint:
    """Waits at each waypoint until a function returns True: a button, a message, a scanner."""

    def __init__(self, ready: Callable[[], bool], timeout: float = 10.0) -> None:
        """`timeout` in s. Raises InputError for one that is not above 0."""
        if not timeout > 0.0:
            raise InputError(f"timeout is {timeout} s; it must be above 0", timeout=timeout)
        self.ready = ready
        self.params = InputParams(timeout=float(timeout))

    def __call__(self, index: int, pose: Pose2D) -> Behavior:
        """Return the wait for the input."""
        return AwaitInput(self.ready, self.params)


NO_EXECUTOR: Final[WaypointExecutor] = lambda index, pose: None  # noqa: E731
"""Does nothing."""
