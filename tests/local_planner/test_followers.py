"""Pure pursuit, rotation shim and graceful controller: closed forms, limits over random cycles, wrong parameters."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from navstack.core import (
    LETHAL,
    Footprint,
    NoValidControlError,
    Path,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    grid_record,
    lethal_cells_under,
    place_scaled,
)
from navstack.local_planner import RegulatedPurePursuit, RegulatedPurePursuitParams, RotationShim, RotationShimParams
from navstack.local_planner.goal_checkers import SimpleGoalCheckerParams
from navstack.local_planner.graceful import LAW, GracefulController, GracefulParams, law
from navstack.local_planner.path_follower import Following, limited_turning_speed, turning_speed
from navstack.local_planner.regulated_pure_pursuit import ArcCheck, Scene, Window, held_to_radius
from navstack.parameters import check_parameters
from navstack.plugins import LocalPath
from navstack.testing.doubles import control_input, driven, local_costmap
from tests.local_planner.limits import LIMIT_CASES, Limits, excess, search_excess

FAR = SimpleGoalCheckerParams(path_length_tolerance=0.0, xy_goal_tolerance=0.0)


def pursuit(**values: Any) -> RegulatedPurePursuit:
    values = {"sections": {"goal_checker": FAR}, "use_collision_detection": False, **values}
    return RegulatedPurePursuit(RegulatedPurePursuitParams(**values))


def command(controller: Any, poses: Any, pose: Pose2D, velocity: Twist2D = Twist2D()) -> Twist2D:
    path = Path(np.asarray(poses, np.float64), "odom")
    controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
    return controller.compute_command(control_input(pose, velocity)).command


def arc(radius: float, length: float = 1.9, step: float = 0.005) -> list[tuple[float, float, float]]:
    turns = np.arange(0.0, length / radius, step / radius).tolist()
    return [(radius * math.sin(t), radius * (1.0 - math.cos(t)), t) for t in turns]


# --- pure pursuit -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.6, 0.8, 1.5])
@pytest.mark.parametrize("lookahead", [0.3, 0.6])
def test_every_carrot_on_a_circle_gives_its_curvature(radius: float, lookahead: float) -> None:
    got = command(pursuit(lookahead_dist=lookahead, controller_frequency=20.0), arc(radius), Pose2D(0.0, 0.0))
    # chords of 5 mm between the poses: relative error (5 mm / R)² / 8
    assert got.wz / got.vx == pytest.approx(1.0 / radius, rel=1e-4)
    assert got.vx == pytest.approx(0.5 * min(1.0, radius / 0.9), rel=1e-4)


def test_an_offset_decays_as_the_closed_form() -> None:
    """e(s) = e0 exp(-s/L) (cos(s/L) + sin(s/L)): 0.508 e0 after L, overshoot 4.3 % after pi L."""
    controller = pursuit(controller_frequency=100.0)
    path = [(0.05 * i, 0.0, 0.0) for i in range(100)]
    pose, start = Pose2D(0.0, 0.01), 0.01
    offsets: list[float] = []
    controller.set_plan(Path(np.array(path), "odom"), Pose2D(*path[-1]))
    for _ in range(400):
        offsets.append(pose.y / start)
        pose = driven(pose, controller.compute_command(control_input(pose)).command, 0.01)
    steps = [s / (0.5 * 0.01) for s in (0.6, math.pi * 0.6)]
    assert offsets[round(steps[0])] == pytest.approx(0.508, abs=0.01)
    assert offsets[round(steps[1])] == pytest.approx(-0.043, abs=0.003)


def test_the_approach_slows_down_in_proportion() -> None:
    """From D to 0.25 m in (D / v) ln(D / 0.25) = 1.05 s."""
    controller = pursuit(controller_frequency=100.0)
    path = [(0.01 * i, 0.0, 0.0) for i in range(101)]
    controller.set_plan(Path(np.array(path), "odom"), Pose2D(*path[-1]))
    pose, time = Pose2D(0.4, 0.0), 0.0
    while pose.x < 0.75:
        pose = driven(pose, controller.compute_command(control_input(pose)).command, 0.01)
        time += 0.01
    assert time == pytest.approx(1.05, abs=0.03)


def test_a_carrot_at_the_side_is_not_faster_than_the_turning_limit() -> None:
    """Nav2 commands 5 rad/s here (P2)."""
    got = command(pursuit(use_rotate_to_heading=False), [(0.0, 0.1, 1.57), (0.0, 0.12, 1.57)], Pose2D(0.0, 0.0))
    assert abs(got.wz) <= 2.5 and got.vx < 0.25


def test_a_car_keeps_its_turning_radius() -> None:
    controller = pursuit(use_rotate_to_heading=False, min_turning_r=0.8)
    for yaw in np.linspace(-1.5, 1.5, 13).tolist():
        got = command(controller, [(0.1 * i, 0.0, 0.0) for i in range(20)], Pose2D(0.0, 0.3, yaw))
        assert abs(got.wz) <= abs(got.vx) / 0.8 + 1e-12


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("lowest", [-0.5, 0.0])
def test_it_reverses_only_as_its_limits_say_and_never_stands_still(turns: bool, lowest: float) -> None:
    """A path behind the robot, with `allow_reversing`: backward, or a turn in place, or an error with the reason."""
    controller = pursuit(
        allow_reversing=True, use_rotate_to_heading=turns, use_dynamic_window=True, min_linear_vel=lowest
    )
    reverses = lowest < 0.0 and not turns
    assert (controller.limits.min_vel_x < 0.0) is controller.params.drives_backward is reverses
    path = [(-0.05 * i, 0.01 * i, 3.0) for i in range(40)]
    if not turns and not reverses:
        with pytest.raises(NoValidControlError, match="behind the robot, and min_linear_vel = 0 m/s allows"):
            command(controller, path, Pose2D(0.0, 0.0))
        return
    got = command(controller, path, Pose2D(0.0, 0.0))
    assert (got.vx < 0.0, got.vx == 0.0 and got.wz != 0.0) == (reverses, turns)


def test_a_turn_takes_the_time_of_the_closed_form() -> None:
    """By pi from rest, at 1.8 rad/s and 3.2 rad/s²: 2.31 s. Nav2's rule is within 0.25 rad after 1.9 s at 20 Hz."""
    for rate, left, expected in ((turning_speed, 0.25, 1.9), (limited_turning_speed, 1e-3, 2.308)):
        error, speed, time = math.pi, 0.0, 0.0
        while abs(error) > left and time < 5.0:
            last, speed = speed, rate(error, 1.8, 3.2, speed, 0.05)
            error -= 0.05 * speed
            time += 0.05
            assert rate is turning_speed or abs(speed - last) <= 3.2 * 0.05 + 1e-12
        # a command is held for a period: the speed is up to one period ahead of the ramp, and the end up to three behind
        assert expected - 0.1 <= time <= expected + 0.15


# --- limits over random cycles ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", LIMIT_CASES)
def test_no_limit_is_exceeded(name: str) -> None:
    """Velocity, acceleration from command to command, turning radius. `tools/search_limits.py` searches longer."""
    case = LIMIT_CASES[name]
    found = search_excess(case, 1500, seed=7)
    assert found.cycles > 1200
    assert {k: v for k, v in found.by_limit.items() if v > case.tolerance} == {}


def test_an_excess_is_measured() -> None:
    limits = Limits(-0.2, 0.5, 1.0, faster_x=1.0, slower_x=2.0, theta=3.0, radius=0.5)
    still, moving = Twist2D(), Twist2D(0.5, 0.0, 1.0)
    assert excess(limits, still, Twist2D(0.05, 0.0, 0.1), 0.05)["ax"] == pytest.approx(0.0)
    assert excess(limits, still, Twist2D(0.07, 0.0, 0.1), 0.05)["ax"] == pytest.approx(0.02)
    assert excess(limits, moving, Twist2D(0.38, 0.0, 1.0), 0.05)["ax"] == pytest.approx(0.02)
    assert excess(limits, moving, Twist2D(0.5, 0.0, 0.8), 0.05)["az"] == pytest.approx(0.05)
    found = excess(limits, moving, Twist2D(0.6, 0.0, -1.5), 0.05)
    assert (found["vx"], found["wz"], found["radius"]) == (
        pytest.approx(0.1),
        pytest.approx(0.5),
        pytest.approx(0.15),
    )


def test_rounding_does_not_turn_the_robot_round() -> None:
    """On the tightest arc, |w| r may exceed |v| by a bit: the direction stays."""
    window = Window(-0.08, 0.0, -0.11, 0.15)
    v = -0.0761
    w = math.nextafter(-v / 0.6, math.inf)
    assert held_to_radius(v, w, 0.01, window, 0.6)[0] == v
    # braking from an arc: the speed falls no faster than the turning speed allows
    assert held_to_radius(0.31, -0.537, 0.4, Window(0.31, 0.31, -0.80, -0.537), 0.6) == (
        pytest.approx(0.3222),
        -0.537,
    )


@pytest.mark.parametrize("name", ["pure pursuit", "graceful"])
@pytest.mark.parametrize("corner", [(-0.16, 0.0), (-0.11, 0.11)])
def test_it_leaves_an_obstacle_under_its_footprint_but_does_not_drive_into_it(
    corner: tuple[float, float], name: str
) -> None:
    """A mark at the robot's back: forward is free, backward is not; a second mark ahead still stops it."""
    ahead = [(0.05 * i, 0.0, 0.0) for i in range(40)]
    for path, marks, goes in (
        (ahead, [corner], True),
        ([(-x, y, yaw) for x, y, yaw in ahead], [corner], False),
        (ahead, [corner, (0.2, 0.0)], False),
    ):
        if name == "graceful":
            controller: Any = GracefulController(GracefulParams(initial_rotation=False, allow_backward=True))
        else:
            controller = pursuit(use_collision_detection=True, allow_reversing=True, use_rotate_to_heading=False)
        plan = Path(np.array(path), "odom")
        controller.set_plan(plan, Pose2D(*plan.poses[-1].tolist()))
        inputs = control_input(Pose2D(0.0, 0.0), Twist2D(), marks)
        if goes:
            found = controller.compute_command(inputs)
            assert found.command.vx > 0.0 and "leads away" in found.notes[-1]
        else:
            with pytest.raises(NoValidControlError, match=r"would collide|free of collisions"):
                controller.compute_command(inputs)


@pytest.mark.parametrize("acceleration", [0.3, 1.0, 2.5])
@pytest.mark.parametrize("start", [-0.4, 0.0, 0.33])
def test_a_slow_robot_does_not_creep_into_a_wall(start: float, acceleration: float) -> None:
    """From rest the first commands cover less than a cell in the time of the check; the third start overlaps the wall."""
    controller = pursuit(use_collision_detection=True, use_dynamic_window=True, max_linear_accel=acceleration)
    path = Path(np.array([(0.05 * i, 0.0, 0.0) for i in range(-8, 40)]), "odom")
    controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
    wall = [(0.525, y) for y in np.arange(-0.6, 0.6, 0.05).tolist()]
    pose, velocity = Pose2D(start, 0.0), Twist2D()
    for _ in range(100):
        try:
            velocity = controller.compute_command(control_input(pose, velocity, wall)).command
        except NoValidControlError:
            velocity = Twist2D()
        pose = driven(pose, velocity, 0.05)
    assert pose.x <= max(0.5 - 0.18, start)


def test_a_round_robot_turns_beside_what_only_its_corners_reach() -> None:
    """The corners of the polygon are 3.5 mm beyond its edges; the wall is between the two."""
    wall = [(0.225, y) for y in np.arange(-0.6, 0.6, 0.05).tolist()]
    controller = pursuit(use_collision_detection=True)
    back = Path(np.array([(-0.05 * i, 0.0, math.pi) for i in range(30)]), "odom")
    controller.set_plan(back, Pose2D(*back.poses[-1].tolist()))
    found = controller.compute_command(control_input(Pose2D(0.2 - 0.178, 0.0, math.pi / 16), lethal=wall)).command
    assert found.vx == 0.0 and found.wz != 0.0


@pytest.mark.parametrize("radius", [0.0, 0.25])
def test_a_car_keeps_closer_to_its_path_where_the_arc_cuts_a_corner(radius: float) -> None:
    """Straight ahead, then left around a mark: the arc to the carrot passes over it, that to a nearer one does not."""
    controller = pursuit(use_collision_detection=True, use_rotate_to_heading=False, min_turning_r=radius)
    corner = [(0.02 * i, 0.0, 0.0) for i in range(20)] + [(0.4, 0.02 * i, math.pi / 2) for i in range(30)]
    path = Path(np.array(corner), "odom")
    controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
    inputs = control_input(Pose2D(0.0, 0.0), Twist2D(0.4), [(0.21, 0.21)])
    if radius == 0.0:
        with pytest.raises(NoValidControlError, match="would collide after"):
            controller.compute_command(inputs)
    else:
        found = controller.compute_command(inputs)
        assert "steering to one" in found.notes[-1] and 0.0 < found.command.vx < 0.5


@pytest.mark.parametrize("may_turn", [False, True])
def test_a_blocked_robot_turns_to_where_the_arc_is_free(may_turn: bool) -> None:
    """A mark next to the path: the robot turns away from it, drives past without a contact, and does not turn back and forth."""
    controller = pursuit(
        use_collision_detection=True, use_dynamic_window=True, use_rotate_to_heading=False, max_linear_accel=1.0
    )
    controller.may_turn = may_turn  # as behind a rotation shim
    path = Path(np.array([(0.05 * i, 0.0, 0.0) for i in range(40)]), "odom")
    controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
    mark = (0.275, 0.175)
    pose, velocity, turns = Pose2D(0.0, 0.0), Twist2D(), set[float]()
    for _ in range(160):
        try:
            plan = controller.compute_command(control_input(pose, velocity, [mark]))
            velocity = plan.command
            if "turning by" in plan.notes[0]:
                turns.add(math.copysign(1.0, velocity.wz))
        except NoValidControlError:
            velocity = Twist2D()
        pose = driven(pose, velocity, 0.05)
        assert math.hypot(pose.x - mark[0], pose.y - mark[1]) > 0.18
    assert (pose.x > 1.0, turns) == ((True, {-1.0}) if may_turn else (False, set()))


LONG = Footprint(np.array([(0.9, 0.3), (0.9, -0.3), (-0.5, -0.3), (-0.5, 0.3)]))
"""Its corners are up to 0.95 m from the center of rotation."""


def longest_move(poses: Any) -> float:
    """The longest way (m) of a corner of the long footprint between two consecutive poses (n, 3)."""
    corners = np.array([Transform2D(*pose).apply_points(LONG.vertices) for pose in poses])
    return float(np.linalg.norm(np.diff(corners, axis=0), axis=-1).max())


@pytest.mark.parametrize("speed", [0.0, 0.012, 0.1, -0.3, 0.5])
@pytest.mark.parametrize("turning", [-2.5, -0.02, 0.7, 1.8])
def test_no_corner_skips_a_cell_of_the_check(speed: float, turning: float) -> None:
    """However fast the robot turns, no corner moves by more than a cell between two poses; the last one is at the end."""
    scene = Scene(Pose2D(0.3, -0.2, 0.9), local_costmap(Pose2D(0.0, 0.0), side_m=8.0), LONG, False)
    command = Twist2D(speed, 0.0, turning)
    hit, poses = ArcCheck().first_collision(scene, command, 1.0, math.inf, as_nav2=False)
    assert hit == -1 and longest_move(poses) <= 0.05 + 1e-9
    end = driven(scene.pose, command, 1.0)
    # the check drives chords of up to a cell, not the arc
    assert math.hypot(poses[-1, 0] - end.x, poses[-1, 1] - end.y) < 1e-3


# --- rotation shim ----------------------------------------------------------------------------------------------------


def shim(**values: Any) -> RotationShim:
    window = RegulatedPurePursuitParams(
        use_dynamic_window=True, use_rotate_to_heading=False, max_linear_accel=1.0, max_linear_decel=-1.0
    )
    return RotationShim(RotationShimParams(closed_loop=False, sections={"primary_controller": window}, **values))


@pytest.mark.parametrize(
    ("error", "speed", "checked"),
    [
        (1.0, 1.0, [0.125 * i for i in range(1, 9)]),  # a left turn: for the whole time
        (-1.0, -1.0, [-0.125]),  # a right turn: while it has turned by less than 1 - 0.75
        (-1.5, -2.0, [-0.25, -0.5]),
        (0.5, 1.0, []),  # a short turn: not at all
    ],
)
def test_the_headings_that_nav2_checks_in_a_turn(error: float, speed: float, checked: list[float]) -> None:
    """From simulate_ahead_time and angular_dist_threshold, in steps of a period of 1/8 s: every number is exact."""
    params = RotationShimParams(
        controller_frequency=8.0,
        simulate_ahead_time=1.0,
        angular_dist_threshold=0.75,
        sections={"primary_controller": RegulatedPurePursuitParams()},
    )
    controller = RotationShim(params, as_nav2=True)
    state, path = RobotState(Pose2D(0.0, 0.0), Twist2D()), LocalPath(np.zeros((2, 3)), 0.0, 0.0, 0, 2)
    costmap = local_costmap(state.pose)
    now = Following(state, path, Pose2D(0.0, 2.0), costmap, LONG, None, False, False, True, True)
    assert list(controller._headings(now, error, speed)) == checked


def test_the_shim_brakes_before_it_turns() -> None:
    """From 0.5 m/s at 1 m/s² it takes ten cycles; Nav2 commands zero at once."""
    controller = shim()
    pose, velocity, speeds, reasons = Pose2D(0.0, 0.0), Twist2D(0.5, 0.0, 0.0), list[float](), list[str]()
    path = Path(np.array([(0.0, 0.05 * i, math.pi / 2) for i in range(40)]), "odom")
    controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
    for _ in range(12):
        plan = controller.compute_command(control_input(pose, velocity))
        velocity = plan.command
        speeds.append(velocity.vx)
        reasons.append(plan.notes[0])
        pose = driven(pose, velocity, 0.05)
    assert speeds == pytest.approx([0.05 * i for i in range(9, 0, -1)] + [0.0] * 3)
    assert reasons[-1].endswith("turning in place")


def test_the_shim_does_not_turn_where_it_would_collide_while_it_brakes() -> None:
    """A wall beyond the robot: at rest it can turn, at speed it would slide into the wall, and the other controller drives."""
    path = Path(np.array([(0.0, 0.05 * i, math.pi / 2) for i in range(40)]), "odom")
    wall = [(0.3, y) for y in np.arange(-0.6, 0.6, 0.05).tolist()]
    for speed, turns in ((0.0, True), (0.5, False)):
        controller = shim()
        controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
        try:
            plan = controller.compute_command(control_input(Pose2D(0.0, 0.0), Twist2D(speed, 0.0, 0.0), wall))
        except NoValidControlError:
            assert not turns
        else:
            assert plan.notes[0].endswith("turning in place") is turns


def test_the_shim_skips_no_cell_while_it_brakes() -> None:
    """At 0.5 m/s and 1.5 rad/s, a corner moves by two cells per control period."""
    controller: Any = shim()
    path = LocalPath(np.array([(0.0, 0.05 * i, math.pi / 2) for i in range(40)]), 1.95, 1.95, 0, 40)
    state, goal = RobotState(Pose2D(0.0, 0.0), Twist2D(0.5, 0.0, 1.5)), Pose2D(0.0, 2.0)
    now = Following(state, path, goal, local_costmap(state.pose), LONG, None, False, False, True, True)
    poses = [state.pose, *controller._poses_ahead(now, math.pi / 2, Twist2D(0.45, 0.0, 1.5))]
    assert longest_move(poses) <= 0.05 + 1e-9


# --- graceful ---------------------------------------------------------------------------------------------------------


def settings() -> Any:
    controller: Any = GracefulController(GracefulParams())
    p = controller._law.copy()
    assert p.dtype == LAW
    p["slowdown_radius"] = 1.5
    return p[0]


def test_the_control_law() -> None:
    p = settings()
    v, w = law(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, p)
    assert (v, w) == (pytest.approx(1.0 / 3.0), 0.0)
    assert law(0.2, 0.0, 0.0, 0.0, 0.0, 0.0, False, p)[0] == pytest.approx(0.1)
    v, w = law(1.0, 0.0, 0.0, 0.0, 0.0, 0.1, False, p)
    assert w / v == pytest.approx(-0.3995, abs=1e-4)
    v, w = law(1.0, 0.0, 0.5, 0.0, 0.0, 0.0, False, p)
    assert w / v == pytest.approx(-math.pi / 4.0)
    for delta, phi in np.random.default_rng(2).uniform(-3.0, 3.0, (50, 2)).tolist():
        a = law(1.0, 0.0, phi, 0.0, 0.0, delta, False, p)
        b = law(1.0, 0.0, -phi, 0.0, 0.0, -delta, False, p)
        assert a == (pytest.approx(b[0]), pytest.approx(-b[1]))


def under_the_footprint(trajectory: Any, steps: int) -> set[tuple[float, float]]:
    """Centers (m) of the cells under the long footprint on a trajectory (n, 3), at `steps` poses per pose of it."""
    index = np.linspace(0.0, len(trajectory) - 1, steps * (len(trajectory) - 1) + 1)
    poses = np.column_stack([np.interp(index, np.arange(len(trajectory)), column) for column in trajectory.T])
    geometry = local_costmap(Pose2D(0.0, 0.0)).geometry
    everywhere, cells = np.full((geometry.ny, geometry.nx), LETHAL, np.uint8), np.empty((2000, 2), np.int64)
    corners, placed, found = LONG.vertices.T.copy(), np.empty((2, 4)), set[tuple[float, float]]()
    for pose in poses:
        place_scaled(corners, 1.0, pose, grid_record(geometry), placed)
        number = lethal_cells_under(everywhere, placed, cells)
        found |= {geometry.cell_to_world(ix, iy) for ix, iy in cells[:number].tolist()}
    return found


def test_graceful_turns_in_place_only_if_no_corner_passes_an_obstacle() -> None:
    """A long robot at its goal turns by 2 rad past an obstacle that it would touch only halfway."""
    controller = GracefulController(GracefulParams(v_angular_max=2.0, in_place_collision_resolution=5.0))
    plan = Path(np.array([(-0.05 * k, 0.0, 2.0) for k in range(21)][::-1]), "odom")

    def turns(*marks: tuple[float, float]) -> bool:
        controller.reset()
        controller.set_plan(plan, Pose2D(0.0, 0.0, 2.0))
        try:
            command = controller.compute_command(
                replace(control_input(Pose2D(0.0, 0.0), Twist2D(), marks), footprint=LONG)
            ).command
        except NoValidControlError:
            return False
        return command.vx == 0.0 and command.wz > 0.0

    assert turns() and turns((0.9, 0.9))
    assert not turns((0.5, 0.7))


def test_graceful_sees_what_is_between_its_poses() -> None:
    """In the initial turn, corners of a long robot move by up to four cells per simulated step."""
    controller = GracefulController(GracefulParams(v_angular_max=2.0))
    plan = Path(np.array([(-0.05 * k, 0.015 * k, 2.8) for k in range(21)]), "odom")

    def trajectory(*marks: tuple[float, float]) -> Any:
        controller.reset()
        controller.set_plan(plan, Pose2D(*plan.poses[-1].tolist()))
        inputs = replace(control_input(Pose2D(0.0, 0.0), Twist2D(), marks), footprint=LONG)
        try:
            return controller.compute_command(inputs).trajectory
        except NoValidControlError:
            return None

    free = trajectory()
    between = under_the_footprint(free, 4) - under_the_footprint(free, 1)
    assert len(between) > 5
    for mark in between:
        driven = trajectory(mark)
        assert driven is None or mark not in under_the_footprint(driven, 4)


def test_cruise_is_the_highest_speed() -> None:
    """In Nav2 it is v_linear_max * max_lookahead / slowdown_radius, 0.333 m/s (G1)."""
    controller = GracefulController(GracefulParams(max_linear_accel=1.0, sections={"goal_checker": FAR}))
    found = [command(controller, [(0.05 * i, 0.0, 0.0) for i in range(39)], Pose2D(0.0, 0.0)).vx for _ in range(12)]
    assert found == pytest.approx([min(0.05 * n, 0.5) for n in range(1, 13)])


def test_graceful_stops_at_once_where_its_deceleration_hits_an_obstacle() -> None:
    """The path leads back, so that the robot has to stop and turn: it brakes, but at once before a wall."""
    path = Path(np.array([(-0.05 * i, 0.0, math.pi) for i in range(30)]), "odom")
    velocity = Twist2D(0.5, 0.0, 0.0)
    outcomes: list[float | None] = []
    for at in (1.0, 0.4, 0.25):
        controller = GracefulController(GracefulParams(deceleration_max=1.0))
        controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
        wall = [(at, 0.05 * k) for k in range(-20, 21)]
        try:
            outcomes.append(controller.compute_command(control_input(Pose2D(0.0, 0.0), velocity, wall)).command.vx)
        except NoValidControlError:
            outcomes.append(None)
    assert outcomes == [pytest.approx(0.45), pytest.approx(0.45), None]


# --- parameters -------------------------------------------------------------------------------------------------------

PURSUIT = {"base_local_planner": "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"}
SHIM = {"base_local_planner": "nav2_rotation_shim_controller::RotationShimController"}
GRACEFUL = {"base_local_planner": "nav2_graceful_controller::GracefulController"}


@pytest.mark.parametrize(
    ("tree", "rule"),
    [
        ({**PURSUIT, "FollowPath": {"allow_reversing": True}}, "turn-or-reverse"),
        (
            {
                **PURSUIT,
                "FollowPath": {
                    "allow_reversing": True,
                    "use_rotate_to_heading": False,
                    "use_dynamic_window": True,
                    "min_linear_vel": 0.0,
                },
            },
            "no-reverse-speed",
        ),
        ({**PURSUIT, "FollowPath": {"min_turning_r": 0.5}}, "turn-in-place"),
        ({**PURSUIT, "FollowPath": {"min_turning_r": 2.0, "use_rotate_to_heading": False}}, "turning-radius"),
        ({**PURSUIT, "FollowPath": {"lookahead_dist": 9.0}}, "carrot-beyond-path"),
        ({**PURSUIT, "FollowPath": {"lookahead_dist": 0.03}}, "short-lookahead"),
        ({**PURSUIT, "FollowPath": {"interpolate_curvature_after_goal": True}}, "no-second-carrot"),
        ({**SHIM, "FollowPath": {"angular_dist_threshold": 0.5}}, "no-primary-controller"),
        ({**SHIM, "FollowPath": {"primary_controller": {"plugin": "rotation_shim"}}}, "shim-in-shim"),
        ({**GRACEFUL, "FollowPath": {"allow_backward": True}}, "turn-or-reverse"),
        ({**GRACEFUL, "FollowPath": {"v_linear_min": 0.9}}, "minimum-over-maximum"),
    ],
)
def test_combinations_that_do_not_work_are_named(tree: dict[str, Any], rule: str) -> None:
    found = check_parameters(["turtlebot", tree])
    assert rule in [f.rule for f in found], [f.rule for f in found]
