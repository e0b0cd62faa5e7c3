"""Progress checkers: the robot must move, or turn, within a time (nav2_controller)."""

from __future__ import annotations

from typing import ClassVar

from navstack.core import Pose2D, angle_between
from navstack.plugins import PROGRESS_CHECKERS, ParamModel, PluginSection, ProgressChecker, param


class SimpleProgressCheckerParams(PluginSection):
    """How far the robot must move, and how soon."""

    plugin: str = param("nav2_controller::SimpleProgressChecker", "type of the progress checker")
    required_movement_radius: float = param(0.5, "distance that counts as progress", unit="m", ge=0.0)
    movement_time_allowance: float = param(10.0, "longest time without progress", unit="s", gt=0.0)


@PROGRESS_CHECKERS.register("simple", aliases=("nav2_controller/SimpleProgressChecker",))
class SimpleProgressChecker(ProgressChecker):
    """Progress is a motion beyond a circle around the place of the last progress. A turn in place is none."""

    Params: ClassVar[type[ParamModel]] = SimpleProgressCheckerParams

    def __init__(self, params: SimpleProgressCheckerParams) -> None:
        super().__init__(params)
        self._baseline: Pose2D | None = None
        self._since = 0.0

    def reset(self) -> None:
        """Start again at the next pose."""
        self._baseline = None

    def makes_progress(self, pose: Pose2D, now: float) -> bool:
        """False if the last progress was more than `movement_time_allowance` ago."""
        if self._baseline is None or self.has_moved(self._baseline, pose):
            self._baseline, self._since = pose, now
            return True
        return now - self._since <= self.params.movement_time_allowance + 1e-9

    def has_moved(self, baseline: Pose2D, pose: Pose2D) -> bool:
        """True if the way from the place of the last progress to `pose` is progress."""
        return baseline.distance_to(pose) > self.params.required_movement_radius

    @property
    def failure(self) -> str:
        """Distance and time."""
        p = self.params
        return f"moved less than {p.required_movement_radius:g} m in {p.movement_time_allowance:g} s"


class PoseProgressCheckerParams(SimpleProgressCheckerParams):
    """How far the robot must move or turn, and how soon."""

    plugin: str = param("nav2_controller::PoseProgressChecker", "type of the progress checker")
    required_movement_angle: float = param(0.5, "turn that counts as progress", unit="rad", ge=0.0)


@PROGRESS_CHECKERS.register("pose", aliases=("nav2_controller/PoseProgressChecker",))
class PoseProgressChecker(SimpleProgressChecker):
    """Progress is a motion or a turn away from the pose of the last progress."""

    Params: ClassVar[type[ParamModel]] = PoseProgressCheckerParams

    def has_moved(self, baseline: Pose2D, pose: Pose2D) -> bool:
        """True also for a turn beyond `required_movement_angle`."""
        turned = abs(angle_between(baseline.yaw, pose.yaw)) > self.params.required_movement_angle
        return turned or super().has_moved(baseline, pose)

    @property
    def failure(self) -> str:
        """Distance, angle and time."""
        p = self.params
        return (
            f"moved less than {p.required_movement_radius:g} m and turned less than {p.required_movement_angle:g} rad in "
            f"{p.movement_time_allowance:g} s"
        )
