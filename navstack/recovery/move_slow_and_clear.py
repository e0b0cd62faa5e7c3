"""move_slow_and_clear: forget the obstacles at the robot's side and creep on for a while.

Source: move_slow_and_clear/src/move_slow_and_clear.cpp.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from navstack.core import Bounds, Pose2D, RobotState
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import LocalPlanner, RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.plugins import RECOVERY_BEHAVIORS

_OURS = "the local planner in use is slowed down, whatever its name (parity 20)"


class MoveSlowAndClearParams(ParamModel):
    """Namespace: the instance's name."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "max_trans_param_name": _OURS,
        "max_rot_param_name": _OURS,
        "planner_namespace": _OURS,
    }

    clearing_distance: float = param(
        0.5, "half the side of the square around the robot that is cleared", unit="m", ge=0.0
    )
    limited_trans_speed: float = param(0.25, "highest speed for a while", unit="m/s", ge=0.0)
    limited_rot_speed: float = param(0.45, "highest turning speed for a while", unit="rad/s", ge=0.0)
    limited_distance: float = param(0.3, "how far from here the limits hold", unit="m", ge=0.0)


@RECOVERY_BEHAVIORS.register("move_slow_and_clear", aliases=("move_slow_and_clear/MoveSlowAndClear",))
class MoveSlowAndClear(RecoveryBehavior):
    """Clears both costmaps near the robot and lowers the local planner's speed limits until it is `limited_distance` away.

    ROS differs: there, limits are set by parameter names that no longer exist, and only layers whose name contains
    "obstacles" are cleared (parity 18, 20).
    """

    Params = MoveSlowAndClearParams
    params: MoveSlowAndClearParams

    def __init__(self, name: str, params: MoveSlowAndClearParams) -> None:
        super().__init__(name, params)
        self._context: RecoveryContext | None = None
        self._slowed: LocalPlanner | None = None
        self._from = Pose2D(0.0, 0.0)

    def start(self, context: RecoveryContext, now: float) -> None:
        """Nothing yet."""
        del now
        self._context = context

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Clears, slows down, and is done; FrameError when the robot's place is not known."""
        context = self._context
        assert context is not None
        cleared: dict[str, dict[str, int]] = {}
        for costmap in (context.global_costmap, context.local_costmap):
            pose = costmap.robot_pose(now)
            square = Bounds(pose.x, pose.y, pose.x, pose.y).grown(self.params.clearing_distance)
            cleared[costmap.name] = {layer.name: layer.reset(square) for layer in costmap.layers if layer.clearable}
        p = self.params
        planner = context.local_planner
        planner.set_limits(max_vel_trans=p.limited_trans_speed, max_vel_theta=p.limited_rot_speed)
        self._slowed = planner
        self._from = state.pose
        text = (
            f"Move slow and clear: cleared {2.0 * p.clearing_distance:.2f} m around the robot, no faster than "
            f"{p.limited_trans_speed:g} m/s and {p.limited_rot_speed:g} rad/s for {p.limited_distance:g} m"
        )
        return RecoveryStep(RecoveryStatus.DONE, text=text, data={"cells_cleared": cleared})

    def follow_up(self, state: RobotState, now: float) -> bool:
        """Lifts the limits once the robot is far enough."""
        del now
        if self._slowed is None:
            return False
        if state.pose.distance_to(self._from) < self.params.limited_distance:
            return True
        self._slowed.set_limits()
        self._slowed = None
        return False
