"""nav2_controller::PoseProgressChecker: the robot must move by a distance, or turn by an angle, within a time."""

from __future__ import annotations

from typing import ClassVar

from navstack.core import Pose2D, angle_between
from navstack.core.parameters import ParamModel, param
from navstack.local_planner.progress_checkers.simple import SimpleProgressChecker, SimpleProgressCheckerParams
from navstack.plugins import PROGRESS_CHECKERS


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
