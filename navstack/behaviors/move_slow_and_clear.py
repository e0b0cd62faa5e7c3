"""move_slow_and_clear: clear the obstacles near the robot and drive slowly for some distance.

Source: move_slow_and_clear/src/move_slow_and_clear.cpp.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from navstack.core import Bounds, Pose2D, RobotState
from navstack.plugins import (
    RECOVERY_BEHAVIORS,
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    LocalPlanner,
    ParamModel,
    param,
)

_UNUSED = "the limits always apply to the local planner in use (parity 20)"


class MoveSlowAndClearParams(ParamModel):
    """Namespace: the instance's name."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "max_trans_param_name": _UNUSED,
        "max_rot_param_name": _UNUSED,
        "planner_namespace": _UNUSED,
    }

    clearing_distance: float = param(
        0.5, "half the side length of the square around the robot that is cleared", unit="m", ge=0.0
    )
    limited_trans_speed: float = param(0.25, "maximum translational speed afterwards", unit="m/s", ge=0.0)
    limited_rot_speed: float = param(0.45, "maximum rotational speed afterwards", unit="rad/s", ge=0.0)
    limited_distance: float = param(0.3, "distance after which the limits are restored", unit="m", ge=0.0)


@RECOVERY_BEHAVIORS.register("move_slow_and_clear", aliases=("move_slow_and_clear/MoveSlowAndClear",))
class MoveSlowAndClear(Behavior[MoveSlowAndClearParams]):
    """Clears both costmaps near the robot and lowers the local planner's speed limits for `limited_distance`.

    ROS differs: there, the limits are set by parameter names that no longer exist, and only layers whose name contains
    "obstacles" are cleared (parity 18, 20).
    """

    Params = MoveSlowAndClearParams

    def __init__(self, name: str, params: MoveSlowAndClearParams) -> None:
        super().__init__(name, params)
        self._context: BehaviorContext | None = None
        self._slowed: LocalPlanner | None = None
        self._from = Pose2D(0.0, 0.0)

    def start(self, context: BehaviorContext, now: float) -> None:
        """Store the context; the first step does the work."""
        del now
        self._context = context

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Clear the costmaps and lower the limits. Raises FrameError if the robot's pose is unknown."""
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
            f"Move slow and clear: cleared a square of {2.0 * p.clearing_distance:.2f} m around the robot; limits "
            f"{p.limited_trans_speed:g} m/s and {p.limited_rot_speed:g} rad/s for {p.limited_distance:g} m"
        )
        return BehaviorStep(BehaviorStatus.DONE, text=text, data={"cells_cleared": cleared})

    def follow_up(self, state: RobotState, now: float) -> bool:
        """Restore the limits after `limited_distance`; return True until then."""
        del now
        if self._slowed is None:
            return False
        if state.pose.distance_to(self._from) < self.params.limited_distance:
            return True
        self._slowed.set_limits()
        self._slowed = None
        return False
