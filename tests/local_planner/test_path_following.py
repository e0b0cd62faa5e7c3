"""Goal checkers, progress checkers and the path handler: closed forms and the cases of Nav2."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from navstack.core import GridGeometry, InvalidPathError, Path, Pose2D, Transform2D, Twist2D
from navstack.local_planner.goal_checkers import (
    AdaptiveToleranceGoalChecker,
    AxisGoalChecker,
    PositionGoalChecker,
    SimpleGoalChecker,
    StoppedGoalChecker,
)
from navstack.local_planner.path_handlers import FeasiblePathHandler, path_cuts
from navstack.local_planner.progress_checkers import PoseProgressChecker, SimpleProgressChecker
from navstack.parameters import check_parameters, load_configuration
from navstack.plugins import Approach

GOAL = Pose2D(0.0, 0.0, 0.0)
WINDOW = GridGeometry(80, 80, 0.05, -2.0, -2.0)


def at(distance: float, yaw: float = 0.0, velocity: Twist2D = Twist2D(), **more: Any) -> Approach:
    return Approach(Pose2D(-distance, 0.0, yaw), GOAL, velocity, **more)


def make(cls: type[Any], **values: Any) -> Any:
    return cls(cls.Params(**values))


# --- goal checkers ----------------------------------------------------------------------------------------------------


def test_the_latch_and_its_buffer() -> None:
    latched, free = make(SimpleGoalChecker), make(SimpleGoalChecker, stateful=False)
    buffered = make(SimpleGoalChecker, xy_goal_tolerance_buffer=0.1)
    for checker in (latched, free, buffered):
        assert checker.at_position(at(0.25))
    assert latched.at_position(at(0.9)) and not free.at_position(at(0.3))
    assert buffered.at_position(at(0.34)) and not buffered.at_position(at(0.36))
    assert not buffered.at_position(at(0.3)), "released"


def test_a_long_path_is_never_reached() -> None:
    for cls in (SimpleGoalChecker, PositionGoalChecker, StoppedGoalChecker, AxisGoalChecker):
        assert make(cls).at_position(at(0.0, remaining_m=1.0))
        assert not make(cls).at_position(at(0.0, remaining_m=1.01))


def test_a_symmetric_heading() -> None:
    checker = make(SimpleGoalChecker, symmetric_yaw_tolerance=True)
    for yaw, reached in ((0.2, True), (0.3, False), (math.pi - 0.2, True), (-math.pi + 0.2, True), (1.6, False)):
        assert checker.at_heading(at(0.0, yaw)) is reached
    assert not make(SimpleGoalChecker).at_heading(at(0.0, math.pi))


def test_stopped() -> None:
    checker = make(StoppedGoalChecker)
    for velocity, stopped in (((0.25, 0, 0.25), True), ((0.2, 0.2, 0), False), ((0, 0, -0.26), False)):
        assert checker.reached(at(0.0, velocity=Twist2D(*velocity))) is stopped


def test_axes() -> None:
    """A path that ends turning: its direction is that of its end, not of its poses' headings."""
    path = np.array([[0.0, -1.0, 1.5], [0.0, -0.5, 1.5], [0.0, -0.2, 1.5], [0.0, -0.1, 1.5], [0.0, 0.0, 0.0]])
    checker = make(AxisGoalChecker, along_path_tolerance=0.1, cross_track_tolerance=0.3)

    def reached(x: float, y: float, which: AxisGoalChecker = checker) -> bool:
        return which.at_position(Approach(Pose2D(x, y), GOAL, path=path))

    assert reached(0.29, -0.09) and reached(-0.29, 0.09)
    assert not reached(0.31, 0.0) and not reached(0.0, -0.11) and not reached(0.0, 0.11)
    beyond = make(AxisGoalChecker, along_path_tolerance=0.1, cross_track_tolerance=0.3, is_overshoot_valid=True)
    assert reached(0.1, 0.8, beyond) and not reached(0.1, -0.11, beyond) and not reached(0.4, 0.8, beyond)
    alone = Approach(Pose2D(0.09, 0.0), GOAL, path=path[-1:])
    assert checker.at_position(alone)
    assert not checker.at_position(Approach(Pose2D(0.11, 0.0), GOAL, path=path[-1:]))


def test_adaptive_accepts_a_robot_that_stands_still_in_the_sixteenth_cycle() -> None:
    checker = make(AdaptiveToleranceGoalChecker)
    assert [checker.at_position(at(0.2)) for _ in range(16)] == [False] * 15 + [True]
    assert checker.at_position(at(0.9)), "latched"
    checker.reset()
    assert checker.at_position(at(0.1)), "fine"


def test_adaptive_accepts_a_robot_that_passes_its_goal() -> None:
    checker = make(AdaptiveToleranceGoalChecker)
    moving = Twist2D(0.5, 0.0, 0.0)

    def ask(x: float) -> bool:
        return checker.at_position(Approach(Pose2D(x, 0.15), GOAL, moving))

    assert [ask(x) for x in (-0.3, -0.15, -0.1, -0.05)] == [False] * 4
    assert ask(0.2)


def test_adaptive_counts_anew_outside_the_coarse_tolerance() -> None:
    checker = make(AdaptiveToleranceGoalChecker)
    for _ in range(5):
        assert not any(checker.at_position(at(0.2)) for _ in range(15))
        assert not checker.at_position(at(0.3))


# --- progress checkers ------------------------------------------------------------------------------------------------


def test_a_turn_in_place_is_progress_for_the_pose_checker_only() -> None:
    simple, pose = make(SimpleProgressChecker), make(PoseProgressChecker)
    answers = [(simple.makes_progress(p, t), pose.makes_progress(p, t)) for p, t in turning(0.1, 12.0)]
    assert [a for a, _ in answers].index(False) == 101, "at 10.1 s"
    assert all(b for _, b in answers)
    assert simple.failure == "moved less than 0.5 m in 10 s"


def turning(speed: float, seconds: float) -> list[tuple[Pose2D, float]]:
    return [(Pose2D(0.0, 0.0, speed * 0.1 * k), 0.1 * k) for k in range(round(seconds / 0.1))]


def test_just_the_radius_is_no_progress() -> None:
    checker = make(SimpleProgressChecker, movement_time_allowance=1.0)
    assert checker.makes_progress(Pose2D(0.0, 0.0), 5.0)
    assert checker.makes_progress(Pose2D(0.5, 0.0), 6.0)
    assert not checker.makes_progress(Pose2D(0.5, 0.0), 6.1)
    assert checker.makes_progress(Pose2D(0.51, 0.0), 6.2)
    assert checker.makes_progress(Pose2D(0.51, 0.0), 7.2)


# --- path handler -----------------------------------------------------------------------------------------------------


def line(*corners: tuple[float, float], step: float = 0.1) -> Path:
    """Poses every `step` along a polyline, with the headings of its segments."""
    rows: list[tuple[float, float, float]] = []
    for (x0, y0), (x1, y1) in pairwise(corners):
        n, yaw = round(math.hypot(x1 - x0, y1 - y0) / step), math.atan2(y1 - y0, x1 - x0)
        rows += [(x0 + (x1 - x0) * k / n, y0 + (y1 - y0) * k / n, yaw) for k in range(n)]
    rows.append((*corners[-1], rows[-1][2]))
    return Path(np.array(rows), "odom")


def handler(plan: Path, **values: Any) -> FeasiblePathHandler:
    made = make(FeasiblePathHandler, **values)
    made.set_plan(plan)
    return made


def test_prune_distance_counts_from_the_closest_pose() -> None:
    path = handler(line((-1.0, 0.0), (5.0, 0.0)), prune_distance=1.0).local_path(
        Pose2D(0.02, 0.1), Transform2D(), WINDOW
    )
    assert path.first == 10 and path.poses[-1, 0] == pytest.approx(1.0) and path.length == pytest.approx(1.0)
    assert path.remaining_m == pytest.approx(5.0)


def test_a_tie_goes_to_the_later_pose() -> None:
    path = handler(line((-1.0, 0.0), (1.0, 0.0), step=0.25)).local_path(Pose2D(0.125, 0.0), Transform2D(), WINDOW)
    assert path.poses[0, 0] == 0.25


def test_two_poses_are_kept_at_the_end() -> None:
    path = handler(line((-1.0, 0.0), (1.0, 0.0))).local_path(Pose2D(1.0, 0.0), Transform2D(), WINDOW)
    assert len(path.poses) == 2


def test_the_closest_pose_is_searched_within_a_distance() -> None:
    """There and back on two parallel lines: the way back is nearer, but a long way off."""
    plan = line((-1.5, 0.0), (1.5, 0.0), (1.5, 0.3), (-1.5, 0.3))
    robot = Pose2D(-1.0, 0.2)
    assert handler(plan).local_path(robot, Transform2D(), WINDOW).first == 5
    assert handler(plan, max_robot_pose_search_dist=-1.0).local_path(robot, Transform2D(), WINDOW).first > 50


def test_the_path_ends_at_the_first_pose_outside_the_window() -> None:
    """Even if it comes back."""
    plan = line((0.0, 0.0), (2.5, 0.0), (2.5, 0.5), (0.0, 0.5))
    path = handler(plan, prune_distance=9.0).local_path(Pose2D(0.0, 0.0), Transform2D(), WINDOW)
    assert path.poses[-1, 0] == pytest.approx(1.9) and not path.ends_at_goal


@pytest.mark.parametrize("direction", [0.0, 0.7, 1.5, 3.0, -2.0])
@pytest.mark.parametrize("change", [0.3, 1.4, 1.7, 2.5, 3.1, -1.5, -1.7])
def test_a_cusp_is_a_change_of_direction_by_more_than_a_right_angle(direction: float, change: float) -> None:
    ends = [(1.0 * math.cos(direction), 1.0 * math.sin(direction))]
    back = direction + change
    ends.append((ends[0][0] + 0.3 * math.cos(back), ends[0][1] + 0.3 * math.sin(back)))
    plan = np.zeros((3, 5))
    plan[1:, :2] = ends
    out = np.empty(3, np.int64)
    assert path_cuts(plan, True, 10.0, out) == int(abs(change) > 0.5 * math.pi)


def test_a_path_is_cut_at_its_cusp() -> None:
    plan = line((0.0, 0.0), (1.0, 0.0), (0.0, 0.5))
    whole = handler(plan, prune_distance=9.0).local_path(GOAL, Transform2D(), WINDOW)
    assert not whole.ends_at_cusp and whole.ends_at_goal
    cut = handler(plan, enforce_path_inversion=True, prune_distance=9.0)
    first = cut.local_path(GOAL, Transform2D(), WINDOW)
    assert first.ends_at_cusp and first.poses[-1, :2] == pytest.approx((1.0, 0.0)) and first.end == 11
    assert cut.local_path(Pose2D(0.85, 0.0, 0.5), Transform2D(), WINDOW).ends_at_cusp, "turned by more than 0.4 rad"
    # the yaw of the cusp is that of the segment after it here
    yaw = float(plan.poses[10, 2])
    rest = cut.local_path(Pose2D(0.85, 0.0, yaw), Transform2D(), WINDOW)
    assert not rest.ends_at_cusp and rest.ends_at_goal


def test_the_way_back_is_not_taken_before_the_cusp() -> None:
    """There and back on the same line: at every point both ways are equally near."""
    cut = handler(line((0.0, 0.0), (1.0, 0.0), (0.0, 0.0)), enforce_path_inversion=True, prune_distance=9.0)
    for x in (0.0, 0.31, 0.72):
        path = cut.local_path(Pose2D(x, 0.0, math.pi), Transform2D(), WINDOW)
        assert path.ends_at_cusp and path.first == round(x, 1) * 10 and path.poses[-1, 0] == 1.0
    assert cut.local_path(Pose2D(0.81, 0.0, math.pi), Transform2D(), WINDOW).first == 12
    assert cut.local_path(Pose2D(0.4, 0.0, math.pi), Transform2D(), WINDOW).first == 16


@pytest.mark.parametrize(
    ("x", "y", "turned", "passed"),
    [(0.75, 0.3, 0.0, False), (0.85, 0.3, 0.0, True), (0.95, 0.3, 0.5, False), (1.05, 0.3, 0.5, True)],
)
def test_a_cusp_that_is_missed_to_the_side_is_passed(x: float, y: float, turned: float, passed: bool) -> None:
    """At most inversion_xy_tolerance before it along the path, or beyond it whatever the heading."""
    plan = line((0.0, 0.0), (1.0, 0.0), (0.0, -0.4))
    cut = handler(plan, enforce_path_inversion=True, prune_distance=9.0)
    path = cut.local_path(Pose2D(x, y, float(plan.poses[10, 2]) + turned), Transform2D(), WINDOW)
    assert path.ends_at_cusp != passed


def test_a_path_is_cut_where_it_turns_in_place() -> None:
    rows = [[0.1 * k, 0.0, 0.0] for k in range(10)] + [[0.9, 0.0, 0.2 * k] for k in range(1, 8)]
    rows += [[0.9, 0.1 * k, 1.57] for k in range(1, 10)]
    plan = Path(np.array(rows), "odom")
    assert not handler(plan, enforce_path_inversion=True).local_path(GOAL, Transform2D(), WINDOW).ends_at_cusp
    path = handler(plan, enforce_path_rotation=True).local_path(GOAL, Transform2D(), WINDOW)
    assert path.ends_at_cusp and path.end == 17
    small = handler(plan, enforce_path_rotation=True, minimum_rotation_angle=1.5)
    assert not small.local_path(GOAL, Transform2D(), WINDOW).ends_at_cusp


def test_a_plan_of_one_pose_can_be_refused() -> None:
    with pytest.raises(InvalidPathError, match="single pose"):
        handler(Path(np.zeros((1, 3))), reject_unit_path=True).local_path(GOAL, Transform2D(), WINDOW)


# --- parameters -------------------------------------------------------------------------------------------------------


def test_the_progress_checker_of_a_yaml() -> None:
    """Named by its namespace, by a list, or not at all."""
    section = {"plugin": "nav2_controller::PoseProgressChecker", "required_movement_radius": 0.3}
    by_name = load_configuration(["turtlebot", {"progress_checker": section}]).move_base
    assert isinstance(by_name.make_progress_checker(), PoseProgressChecker)
    assert by_name.sections["progress_checker"].required_movement_radius == 0.3
    listed = {"progress_checker_plugins": ["mine"], "mine": section}
    assert isinstance(load_configuration(["turtlebot", listed]).move_base.make_progress_checker(), PoseProgressChecker)
    off = {"progress_checker_plugins": [], "progress_checker": section}
    assert load_configuration(["turtlebot", off]).move_base.make_progress_checker() is None
    assert load_configuration(["turtlebot"]).move_base.make_progress_checker() is None


def test_an_unknown_plugin_of_a_section_is_an_error() -> None:
    section = {"plugin": "nav2_controller::SimpleProgresChecker"}
    found = check_parameters(["turtlebot", {"progress_checker": section}])
    errors = [f for f in found if f.severity == "error"]
    assert len(errors) == 1 and errors[0].key == "progress_checker/plugin"
    assert 'did you mean "nav2_controller/SimpleProgressChecker"' in errors[0].message


def test_a_misspelt_parameter_of_a_section() -> None:
    found = check_parameters(["turtlebot", {"progress_checker": {"required_movement_raduis": 0.3}}])
    assert [(f.key, f.suggestion) for f in found if f.severity == "warning"] == [
        ("progress_checker/required_movement_raduis", "required_movement_radius")
    ]
