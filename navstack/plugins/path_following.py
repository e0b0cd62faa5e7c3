"""What controllers that follow a path share: goal checkers, progress checkers and path handlers (nav2_core)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeVar

from navstack.core import GridGeometry, Path, Pose2D, Transform2D, Twist2D
from navstack.plugins.guards import check_results, number_problem, truth_problem
from navstack.plugins.parameters import ParamModel, param

P = TypeVar("P", default=Any)
"""The parameters of a plugin."""


class PluginSection(ParamModel):
    """Parameters in a namespace that names its plugin, as in Nav2: `goal_checker: {plugin: "..", ..}`."""

    plugin: str = param("", "type of the plugin whose parameters these are")


_NO_PATH = np.empty((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """What a goal checker knows. All poses are in one frame."""

    pose: Pose2D
    goal: Pose2D
    velocity: Twist2D = Twist2D()
    """Measured, in the robot's frame."""
    path: NDArray[np.float64] = field(default_factory=lambda: _NO_PATH)
    """(n, 3) the local path, which ends at the goal if the goal is near."""
    remaining_m: float = 0.0
    """Length of the path that is left, beyond the local path, too."""


class GoalChecker(ABC):
    """Decides whether the robot is at its goal.

    A checker that returns anything other than True or False, or raises, fails the goal with an InternalError that names it.
    """

    Params: ClassVar[type[ParamModel]]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        truths = dict.fromkeys(("at_position", "at_heading", "stopped", "reached"), truth_problem)
        check_results(cls, {**truths, "xy_tolerance": number_problem, "yaw_tolerance": number_problem})

    def reset(self) -> None:  # noqa: B027
        """Prepare for a new goal."""

    @property
    @abstractmethod
    def xy_tolerance(self) -> float:
        """Distance (m) within which a robot may be said to be at the goal's position."""

    @property
    @abstractmethod
    def yaw_tolerance(self) -> float:
        """Angle (rad) within which a robot may be said to be at the goal's heading; pi if every heading is."""

    @abstractmethod
    def at_position(self, approach: Approach) -> bool:
        """Return True within the position tolerance, or if it is latched there."""

    @abstractmethod
    def at_heading(self, approach: Approach) -> bool:
        """Return True within the heading tolerance."""

    def stopped(self, velocity: Twist2D) -> bool:
        """Return True if the robot counts as stopped."""
        del velocity
        return True

    def reached(self, approach: Approach) -> bool:
        """Return True at position and heading, and stopped."""
        return self.at_position(approach) and self.at_heading(approach) and self.stopped(approach.velocity)


class ProgressChecker(ABC, Generic[P]):
    """Decides whether the robot still makes progress towards its goal."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: P) -> None:
        self.params = params

    @abstractmethod
    def reset(self) -> None:
        """Start again at the next pose; called with every new goal and after every recovery."""

    @abstractmethod
    def makes_progress(self, pose: Pose2D, now: float) -> bool:
        """Return False if the robot, at `pose` at `now` (s), has made no progress for too long."""

    @property
    @abstractmethod
    def failure(self) -> str:
        """What a robot without progress has not done: `moved less than 0.5 m in 10 s`."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalPath:
    """The part of the plan that a controller follows now, in the costmap's frame."""

    poses: NDArray[np.float64]
    """(n, 3) from the pose closest to the robot on; at least one."""
    length: float
    """Sum of its segments (m)."""
    remaining_m: float
    """Length of the whole plan from its closest pose on (m)."""
    first: int
    """Index of its first pose in the plan."""
    end: int
    """Index after its last pose in the plan."""
    ends_at_cusp: bool = False
    """The path was cut where the robot reverses or turns in place; the rest follows when the robot is there."""
    ends_at_goal: bool = True
    """Its last pose is the last one of the plan."""


def _local_path_problem(path: Any) -> str:
    if not isinstance(path, LocalPath):
        return "which is not a LocalPath"
    poses: Any = path.poses
    if not isinstance(poses, np.ndarray) or poses.dtype != np.float64 or poses.ndim != 2 or poses.shape[1] != 3:
        return "whose poses are not float64 of shape (n, 3)"
    if len(poses) == 0 or not np.isfinite(poses).all():
        return "whose poses are none, or not finite"
    numbers = (path.length, path.remaining_m, path.first, path.end)
    return next(filter(None, map(number_problem, numbers)), "").replace(
        "which is", "one of whose lengths or indices is"
    )


class PathHandler(ABC):
    """Holds the plan and hands out the part of it that is to be followed.

    A handler that returns anything other than a LocalPath of finite poses, or raises, fails the goal with an InternalError that
    names it.
    """

    Params: ClassVar[type[ParamModel]]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        check_results(cls, {"local_path": _local_path_problem})

    @abstractmethod
    def set_plan(self, plan: Path) -> None:
        """Replace the plan. Raises InvalidPathError if it is empty or not finite."""

    @abstractmethod
    def local_path(self, robot: Pose2D, to_costmap: Transform2D, geometry: GridGeometry) -> LocalPath:
        """Return the local path of a robot at `robot` (costmap's frame).

        `to_costmap` is the pose of the plan's frame in the costmap's. Raises InvalidPathError without a plan, or if no pose of
        it is in the local costmap.
        """
