"""The suites of `navstack.testing` on every registered plugin, those of installed packages included."""

from __future__ import annotations

from typing import Any

from navstack.behaviors import AssistedTeleop
from navstack.core import RobotState, Twist2D
from navstack.local_planner import RegulatedPurePursuitParams
from navstack.local_planner.goal_checkers import SimpleGoalCheckerParams
from navstack.local_planner.mppi.critics.goal_angle import GoalAngleCriticParams
from navstack.local_planner.mppi.params import TrajectoryValidatorParams
from navstack.plugins import (
    CRITICS,
    GLOBAL_PLANNERS,
    GOAL_CHECKERS,
    LAYERS,
    LOCAL_PLANNERS,
    PATH_HANDLERS,
    PROGRESS_CHECKERS,
    RECOVERY_BEHAVIORS,
    SMOOTHERS,
    BehaviorStep,
)
from navstack.testing import (
    critic_contract,
    global_planner_contract,
    goal_checker_contract,
    layer_contract,
    local_planner_contract,
    path_handler_contract,
    progress_checker_contract,
    recovery_contract,
    smoother_contract,
)
from tests.local_planner.networks import shared_network

STRAIGHT_ONLY = {"carrot_planner"}
"""Global planners that do not search around obstacles."""
GIVEN = {"given_path"}
"""Planners of a path in their parameters: their own tests check them."""

NEAR_GOAL = SimpleGoalCheckerParams(xy_goal_tolerance=0.15, yaw_goal_tolerance=0.2)

LOCAL_PLANNER_VALUES: dict[str, dict[str, Any]] = {
    "dwa": {
        "max_vel_trans": 0.5,
        "min_vel_trans": 0.1,
        "max_vel_x": 0.5,
        "min_vel_x": 0.0,
        "max_vel_y": 0.0,
        "min_vel_y": 0.0,
        "acc_lim_x": 1.0,
        "acc_lim_y": 0.0,
        "acc_lim_theta": 2.0,
        "max_vel_theta": 1.0,
        "xy_goal_tolerance": 0.15,
        "yaw_goal_tolerance": 0.2,
        "vx_samples": 6,
        "vy_samples": 1,
        "sim_time": 1.0,
    },
    "dwb": {
        "max_vel_x": 0.5,
        "max_vel_theta": 1.0,
        "max_speed_xy": 0.5,
        "acc_lim_x": 1.0,
        "acc_lim_theta": 2.0,
        "decel_lim_x": -1.0,
        "decel_lim_theta": -2.0,
        "limit_vel_cmd_in_traj": True,
        "sim_time": 1.0,
        "linear_granularity": 0.05,
        "xy_goal_tolerance": 0.15,
        "sections": {"goal_checker": NEAR_GOAL},
    },
    "mppi": {
        "model_dt": 0.2,
        "time_steps": 14,
        "batch_size": 400,
        "sections": {
            "goal_checker": SimpleGoalCheckerParams(xy_goal_tolerance=0.15, yaw_goal_tolerance=0.2),
            "TrajectoryValidator": TrajectoryValidatorParams(collision_lookahead_time=3.0),
            "GoalAngleCritic": GoalAngleCriticParams(threshold_to_consider=0.15),
        },
    },
    "graceful": {"sections": {"goal_checker": NEAR_GOAL}},
    "rotation_shim": {
        "sections": {
            "goal_checker": NEAR_GOAL,
            "primary_controller": RegulatedPurePursuitParams(
                max_allowed_time_to_collision_up_to_carrot=2.0, controller_frequency=5.0
            ),
        },
    },
    "policy": {
        "model": shared_network(),
        "max_vel_x": 0.5,
        "max_vel_theta": 1.0,
        "acc_lim_theta": 2.0,
        "scan_clip": 2.0,
        "collision_time": 1.0,
        "sections": {"goal_checker": NEAR_GOAL},
    },
    "regulated_pure_pursuit": {
        "sections": {"goal_checker": NEAR_GOAL},
        "max_allowed_time_to_collision_up_to_carrot": 2.0,
        "use_cancel_deceleration": True,
        "cancel_deceleration": 0.5,
    },
    "trajectory_rollout": {
        "max_vel_x": 0.5,
        "min_vel_x": 0.1,
        "acc_lim_x": 1.0,
        "acc_lim_y": 0.0,
        "acc_lim_theta": 2.0,
        "max_vel_theta": 1.0,
        "xy_goal_tolerance": 0.15,
        "yaw_goal_tolerance": 0.2,
        "vx_samples": 6,
        "sim_time": 1.0,
        "dwa": True,
        "holonomic_robot": False,
        "meter_scoring": True,
        "escape_vel": 0.0,
        "path_distance_bias": 1.0,
        "goal_distance_bias": 0.8,
    },
}
"""A turtlebot; other local planners run with their defaults."""
GLOBAL_PLANNER_VALUES: dict[str, dict[str, Any]] = {
    "smac_hybrid": {"minimum_turning_radius": 0.1, "motion_model_for_search": "REEDS_SHEPP"},
    "smac_lattice": {"lattice_filepath": "10cm_resolution/0.2m_turning_radius/diff/output.json"},
    "nav2_navfn": {"tolerance": 0.1},
}
"""The rooms of the contract are too small for turns of the default radius, and for a goal within 0.5 m."""


class DrivenByAPerson(AssistedTeleop):
    """A person who drives for a second, then ends it; without one, assisted_teleop fails after its time_allowance."""

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        self.take(Twist2D(0.2, 0.0, 0.1), now)
        if now - self.started_at >= 1.0:
            self.preempt()
        return super().step(state, now)


WITH_A_PERSON = {"assisted_teleop": DrivenByAPerson}

SUITES: dict[str, type[Any]] = {
    **{f"TestLayer_{e.name}": layer_contract(e.cls) for e in LAYERS},
    **{
        f"TestGlobalPlanner_{e.name}": global_planner_contract(
            e.cls, searches=e.name not in STRAIGHT_ONLY, **GLOBAL_PLANNER_VALUES.get(e.name, {})
        )
        for e in GLOBAL_PLANNERS
        if e.name not in GIVEN
    },
    **{f"TestSmoother_{e.name}": smoother_contract(e.cls) for e in SMOOTHERS},
    **{
        f"TestLocalPlanner_{e.name}": local_planner_contract(e.cls, **LOCAL_PLANNER_VALUES.get(e.name, {}))
        for e in LOCAL_PLANNERS
    },
    **{f"TestCritic_{e.name}": critic_contract(e.cls) for e in CRITICS},
    **{f"TestGoalChecker_{e.name}": goal_checker_contract(e.cls) for e in GOAL_CHECKERS},
    **{f"TestProgressChecker_{e.name}": progress_checker_contract(e.cls) for e in PROGRESS_CHECKERS},
    **{f"TestPathHandler_{e.name}": path_handler_contract(e.cls) for e in PATH_HANDLERS},
    **{f"TestRecovery_{e.name}": recovery_contract(WITH_A_PERSON.get(e.name, e.cls)) for e in RECOVERY_BEHAVIORS},
}
globals().update(SUITES)


def test_every_kind_is_tested() -> None:
    assert {name.split("_")[0] for name in SUITES} == {
        *("TestLayer", "TestGlobalPlanner", "TestLocalPlanner", "TestCritic", "TestRecovery"),
        *("TestGoalChecker", "TestProgressChecker", "TestPathHandler", "TestSmoother"),
    }
