"""Trajectory rollout: samples, scores, direction flags, strafing, escapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from navstack.core import (
    LETHAL,
    Costmap,
    Footprint,
    GridGeometry,
    NoValidControlError,
    Path,
    Pose2D,
    RobotState,
    Twist2D,
)
from navstack.local_planner import TrajectoryPlanner, TrajectoryPlannerParams
from navstack.local_planner.trajectory_rollout.critics import PathDistanceCritic, heading_errors
from navstack.local_planner.trajectory_rollout.escape import OscillationFlags
from navstack.local_planner.trajectory_rollout.planner import y_speeds
from navstack.plugins import ControlInput, ScoringContext

FOOTPRINT = Footprint.from_radius(0.18)
LINE = np.column_stack((np.linspace(0.0, 1.5, 31), np.zeros(31), np.zeros(31)))


def empty_map() -> Costmap:
    return Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0), frame="odom")


def planner_on(line: NDArray[np.float64] = LINE, **more: Any) -> TrajectoryPlanner:
    planner = TrajectoryPlanner(TrajectoryPlannerParams(**{"holonomic_robot": False, **more}))
    planner.set_plan(Path(line, "odom"), Pose2D(*line[-1]))
    return planner


def at(pose: Pose2D, velocity: Twist2D = Twist2D(), costmap: Costmap | None = None) -> ControlInput:
    return ControlInput(RobotState(pose, velocity), costmap or empty_map(), FOOTPRINT)


def test_effective_defaults_are_noetics() -> None:
    p = TrajectoryPlannerParams()
    assert (p.max_vel_x, p.min_vel_x, p.sim_time, p.vx_samples, p.vtheta_samples) == (0.55, 0.0, 1.7, 20, 20)
    assert (p.path_distance_bias, p.goal_distance_bias, p.occdist_scale) == (0.6, 0.8, 0.01)
    assert p.escape_reset_theta == pytest.approx(math.pi / 2) and not p.dwa and p.prune_plan
    for old, new in p.RENAMED.items():
        assert new in type(p).model_fields and old not in type(p).model_fields


def test_y_vels_is_a_string_or_a_list() -> None:
    assert y_speeds("-0.3,-0.1, 0.1,-0.3") == [-0.3, -0.1, 0.1, -0.3]
    assert y_speeds([0.2, -0.2]) == [0.2, -0.2]
    assert y_speeds("") == []
    for wrong in ("a,b", "0.1;0.2", "nan"):
        with pytest.raises(ValidationError, match="y_vels"):
            TrajectoryPlannerParams(y_vels=wrong)


def test_samples_in_their_order() -> None:
    """Each speed straight, then with every turn but the last; strafing; then turns in place of at least the lowest speed."""
    planner = planner_on(vx_samples=3, vtheta_samples=5, holonomic_robot=True, max_vel_x=0.4)
    plan = planner.compute_command(at(Pose2D(0.0, 0.0), Twist2D()))
    turns = [-1.0, -0.5, 0.0, 0.5, 1.0]
    expected = [(v, 0.0, w) for v in (0.0, 0.2, 0.4) for w in (0.0, *turns[:-1])]
    expected += [(0.1, 0.1, 0.0), (0.1, -0.1, 0.0)]
    expected += [(0.0, 0.0, w) for w in (-1.0, -0.5, -0.4, 0.5, 1.0)]
    assert plan.samples is not None
    np.testing.assert_allclose(plan.samples, expected, atol=1e-12)


def test_the_window_of_one_period_with_dwa() -> None:
    planner = planner_on(dwa=True, controller_frequency=10.0, vx_samples=3, vtheta_samples=3)
    plan = planner.compute_command(at(Pose2D(0.0, 0.0), Twist2D(0.3, 0.0, 0.1)))
    assert plan.samples is not None
    forward = plan.samples[: 3 * 3]
    assert forward[:, 0].min() == pytest.approx(0.05) and forward[:, 0].max() == pytest.approx(0.55)
    assert forward[:, 2].min() == pytest.approx(0.1 - 0.32)


@pytest.mark.parametrize(
    ("distro", "meters", "expected"),
    [
        ("noetic", True, [0.01, 0.03, 0.04]),
        ("indigo", True, [0.01 * 0.05, 0.03, 0.04]),
        ("noetic", False, [0.01, 0.6, 0.8]),
        ("indigo", False, [0.01, 0.6, 0.8]),
    ],
)
def test_scoring_scale_of_both_distros(distro: str, meters: bool, expected: list[float]) -> None:
    """Parity 31: before 2018 meter_scoring also scaled obstacles."""
    plan = planner_on(ros_distro=distro, meter_scoring=meters).compute_command(at(Pose2D(0.0, 0.0)))
    assert plan.scales is not None
    np.testing.assert_allclose(plan.scales, expected)


def test_keeps_its_turning_direction() -> None:
    """Facing away from the plan, it turns in place in one direction."""
    planner = planner_on(-LINE, dwa=True, controller_frequency=5.0)
    yaw, signs = 0.02, set[float]()
    for _ in range(10):
        command = planner.compute_command(at(Pose2D(0.0, 0.0, yaw))).command
        assert command.vx == 0.0 and abs(command.wz) >= 0.4
        signs.add(math.copysign(1.0, command.wz))
        yaw += 0.02 * command.wz
    assert len(signs) == 1


def test_backs_up_if_every_sample_is_rejected() -> None:
    """Close to a wall, turning collides, but straight back is free (escaping in C++)."""
    shape = Footprint(np.array([[0.3, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.3, -0.2]]))
    costmap = empty_map()
    costmap.data[34:46, 47] = LETHAL  # 0.35 .. 0.40 m ahead
    costmap.data[45, 30:47] = LETHAL  # to the left, 0.25 .. 0.30 m
    costmap.data[34, 30:47] = LETHAL  # to the right
    planner = planner_on(min_vel_x=0.2)
    state = RobotState(Pose2D(0.0, 0.0, 0.0))
    plan = planner.compute_command(ControlInput(state, costmap, shape))
    assert plan.command == Twist2D(-0.1, 0.0, 0.0)
    # no forward samples during an escape
    again = planner.compute_command(ControlInput(state, costmap, shape))
    assert again.samples is not None and again.samples[:, 0].max() == 0.0
    # with a wall behind, too, no command is legal: C++ backs into it
    costmap.data[30:50, 34] = LETHAL
    with pytest.raises(NoValidControlError, match="obstacle"):
        planner.compute_command(ControlInput(state, costmap, shape))


def test_strafes_if_all_other_samples_are_rejected() -> None:
    """Walls in front, behind and within reach of every turn; the left is free."""
    shape = Footprint(np.array([[0.3, 0.1], [-0.3, 0.1], [-0.3, -0.1], [0.3, -0.1]]))
    costmap = empty_map()
    costmap.data[:, 46:48] = LETHAL
    costmap.data[:, 32:34] = LETHAL
    line = np.column_stack((np.zeros(31), np.linspace(0.0, 1.5, 31), np.zeros(31)))
    planner = planner_on(
        line, holonomic_robot=True, min_vel_x=0.3, y_vels=[-0.3, 0.3], sim_time=1.0, heading_lookahead=0.1
    )
    plan = planner.compute_command(ControlInput(RobotState(Pose2D(0.0, 0.0, 0.0)), costmap, shape))
    assert plan.command == Twist2D(0.0, 0.3, 0.0)


def test_heading_scoring_compares_with_the_visible_plan() -> None:
    left = np.column_stack((np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 21), np.zeros(21)))
    planner = planner_on(left, heading_scoring=True, heading_scoring_timestep=0.8)
    plan = planner.compute_command(at(Pose2D(0.0, 0.0, 0.0)))
    assert plan.critics[-1] == "heading" and plan.command.wz > 0.0
    assert plan.costs is not None and plan.samples is not None
    straight = int(np.flatnonzero((plan.samples == (0.0, 0.0, 0.0)).all(axis=1))[0])
    assert plan.costs[straight, -1] == pytest.approx(math.pi / 4, abs=0.05)


def test_heading_errors_use_visible_poses_only() -> None:
    costs = np.zeros((20, 20), np.uint8)
    plan = np.array([[0.05, 0.55, 0.0], [0.95, 0.55, 0.0], [0.95, 0.95, 0.0]])
    pose, alive, out = np.array([[0.05, 0.05, 0.0]]), np.ones(1, np.bool_), np.zeros(1)
    heading_errors(costs, 0.0, 0.0, 0.05, plan, pose, alive, out)
    assert out[0] == pytest.approx(math.pi / 4, abs=0.03)
    costs[5, 3:] = LETHAL
    heading_errors(costs, 0.0, 0.0, 0.05, plan, pose, alive, out)
    assert out[0] == pytest.approx(math.pi / 2, abs=0.06)
    costs[5, :] = LETHAL
    heading_errors(costs, 0.0, 0.0, 0.05, plan, pose, alive, out)
    assert math.isinf(out[0])


def test_simple_attractor_drives_straight_to_the_end() -> None:
    plan = planner_on(simple_attractor=True).compute_command(at(Pose2D(0.0, 0.0, 0.0)))
    assert plan.critics == ("obstacle", "goal") and plan.command.vx > 0.3 and abs(plan.command.wz) < 0.2


def test_cells_under_the_robot_are_passable() -> None:
    """Robot in a solid block, plan through its center: distances to the plan exist under the footprint only."""
    costs = np.full((40, 40), LETHAL, np.uint8)
    costmap = Costmap(GridGeometry(40, 40, 0.05, -1.0, -1.0), costs, "odom")
    planner = planner_on()
    critic = next(c for c in planner.critics if isinstance(c, PathDistanceCritic))
    plan = np.array([[0.01, 0.01, 0.0]])

    def passable(pose: Pose2D) -> NDArray[np.bool_]:
        context = ScoringContext(RobotState(pose), costmap, FOOTPRINT, plan, Pose2D(*plan[0]), planner.limits)
        return critic.build(context).values() < costs.size

    free = passable(Pose2D(0.0, 0.0, 0.3))
    assert free[18:22, 18:22].all() and 3.14 * 3.6**2 * 0.8 < free.sum() < 3.14 * 4.6**2 * 1.2
    assert passable(Pose2D(0.95, 0.0, 0.0)).sum() == 1  # off the map: the plan's own cell only
    assert (costs == LETHAL).all()


def test_unknown_cells_under_the_robot_are_no_part_of_the_plan() -> None:
    """As in C++: MapGrid::setTargetCells looks at the costmap, not at the footprint."""
    costs = np.zeros((40, 40), np.uint8)
    costs[:, 18:22] = 255
    costmap = Costmap(GridGeometry(40, 40, 0.05, -1.0, -1.0), costs, "odom")
    planner = planner_on()
    critic = next(c for c in planner.critics if isinstance(c, PathDistanceCritic))
    plan = np.column_stack((np.linspace(-0.02, 0.6, 20), np.zeros((20, 2))))
    context = ScoringContext(RobotState(Pose2D(0.0, 0.0)), costmap, FOOTPRINT, plan, Pose2D(*plan[-1]), planner.limits)
    values = critic.build(context).values()
    assert values[20, 22] == 0.0 and values[20, 21] == 1.0


def test_strafing_excludes_the_direction_before_the_last() -> None:
    """TrajectoryPlanner::createTrajectories: sideways, a reversal excludes the first direction; a repetition does not."""
    flags, pose = OscillationFlags(), Pose2D(0.0, 0.0)
    flags.update(np.array([0.0, 0.3, 0.0]), pose)
    flags.update(np.array([0.0, 0.3, 0.0]), pose)
    assert flags.strafe.allows(0.3) and flags.strafe.allows(-0.3)
    flags.update(np.array([0.0, -0.3, 0.0]), pose)
    assert not flags.strafe.allows(0.3) and flags.strafe.allows(-0.3)


def test_reached_after_a_command_at_position_and_heading() -> None:
    planner = planner_on()
    there = at(Pose2D(1.5, 0.0, 0.0))
    assert not planner.goal_reached(there)
    assert planner.compute_command(there).mode == "arrived"
    assert planner.goal_reached(there)
    planner.set_plan(Path(LINE, "odom"), Pose2D(*LINE[-1]))
    assert planner.goal_reached(there)  # a replan to the same goal
    planner.set_plan(Path(LINE, "odom"), Pose2D(0.5, 0.0, 0.0))
    assert not planner.goal_reached(there)
