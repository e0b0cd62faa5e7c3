"""Parameters of nav2_graceful_controller::GracefulController."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from pydantic import create_model

from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import param
from navstack.local_planner.path_follower import PathFollowerParams

# a keyword of Python cannot be declared as a field of a class
_FIELDS: dict[str, Any] = {"lambda": (float, param(2.0, "exponent of the curvature in the fall of the speed", gt=0.0))}
_WithLambda: type[PathFollowerParams] = create_model("_WithLambda", __base__=PathFollowerParams, **_FIELDS)


class GracefulParams(_WithLambda):
    """Parameters of nav2_graceful_controller::GracefulController."""

    RENAMED: ClassVar[Mapping[str, str]] = {
        "motion_target_dist": "max_lookahead",
        "initial_rotation_min_angle": "initial_rotation_tolerance",
    }
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **PathFollowerParams.NO_EFFECT,
        "min_lookahead": "Nav2 reads it but never uses it",
        "final_rotation": "of Humble; see prefer_final_rotation",
    }

    max_lookahead: float = param(1.0, "distance of the motion target along the path", unit="m", gt=0.0)
    k_phi: float = param(2.0, "how fast the heading turns to the target's, compared with the approach", gt=0.0)
    k_delta: float = param(1.0, "how fast the robot turns onto the curve", gt=0.0)
    beta: float = param(0.4, "how much the speed falls with the curvature", ge=0.0)
    v_linear_min: float = param(0.1, "lowest speed", unit="m/s", gt=0.0)
    v_linear_max: float = param(0.5, "highest speed", unit="m/s", gt=0.0)
    v_angular_max: float = param(1.0, "highest turning speed", unit="rad/s", gt=0.0)
    v_angular_min_in_place: float = param(0.25, "lowest turning speed in place", unit="rad/s", ge=0.0)
    slowdown_radius: float = param(
        1.5,
        "rest of the path below which the speed falls in proportion",
        unit="m",
        gt=0.0,
        ros_differs="the path that is left counts; in Nav2 the distance to the motion target, so that the robot never gets fast",
    )
    deceleration_max: float = param(2.5, "deceleration with which the robot can stop at the goal", unit="m/s²", gt=0.0)
    initial_rotation: bool = param(True, "turn in place first if the motion target is far off the heading")
    initial_rotation_tolerance: float = param(0.75, "angle to the motion target that needs no turn", unit="rad", ge=0.0)
    prefer_final_rotation: bool = param(True, "ignore the goal's heading on the way, and turn in place at the goal")
    rotation_scaling_factor: float = param(0.5, "turning speed in place per angle, in v_angular_max per rad", gt=0.0)
    allow_backward: bool = param(False, "drive backward to a motion target behind the robot; not with initial_rotation")
    use_collision_detection: bool = param(True, "check the simulated trajectory for collisions")
    in_place_collision_resolution: float = param(0.1, "angle between the checks of a turn in place", unit="rad", gt=0.0)
    footprint_scaling_linear_vel: float = param(0.5, "speed above which the footprint grows", unit="m/s", ge=0.0)
    footprint_scaling_factor: float = param(0.25, "growth of the footprint at v_linear_max", ge=0.0)
    footprint_scaling_step: float = param(
        0.1,
        "the speed is lowered by this much, down to footprint_scaling_linear_vel, until nothing collides",
        unit="m/s",
        gt=0.0,
    )
    obstacle_cost_margin: int = param(
        1, "costs this near to a collision make the controller look for another final heading", ge=0, le=253
    )
    final_rotation_search_step: float = param(0.1, "step of that search", unit="rad", gt=0.01)

    @property
    def drives_backward(self) -> bool:
        """True if it drives to a target behind the robot."""
        return self.allow_backward and not self.initial_rotation

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the robot from driving as the parameters say."""
        yield from super().check(context)
        if self.allow_backward and self.initial_rotation:
            message = "initial_rotation turns the robot to a target behind it, so allow_backward has no effect; set one to false"
            yield Issue("warning", "turn-or-reverse", ("allow_backward", "initial_rotation"), message, "false")
        if self.v_linear_min > self.v_linear_max:
            message = (
                f"v_linear_min = {self.v_linear_min:g} is greater than v_linear_max = {self.v_linear_max:g}; swap or correct the "
                "values"
            )
            yield Issue("error", "minimum-over-maximum", ("v_linear_min", "v_linear_max"), message)
        if self.v_angular_min_in_place > self.v_angular_max:
            message = (
                f"v_angular_min_in_place = {self.v_angular_min_in_place:g} is greater than v_angular_max = "
                f"{self.v_angular_max:g}; lower it"
            )
            yield Issue("error", "minimum-over-maximum", ("v_angular_min_in_place", "v_angular_max"), message)
        handler = getattr(self.make_path_handler(), "params", None)
        prune = float(getattr(handler, "prune_distance", self.max_lookahead))
        costmap = context.local_costmap
        half = 0.5 * min(costmap.width, costmap.height)
        reach = min(prune, half) if costmap.rolling_window else prune
        if self.max_lookahead > reach:
            name = "prune_distance" if prune <= reach else "half the local costmap"
            message = (
                f"max_lookahead = {self.max_lookahead:g} m is beyond {name} = {reach:g} m, so the target is the end of the local "
                f"path; lower it to {reach:g}"
            )
            yield Issue("warning", "carrot-beyond-path", ("max_lookahead", "prune_distance"), message, f"{reach:g}")
