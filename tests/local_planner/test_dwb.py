"""DWB: parameters and their findings, plan windows, limits, critics, diagnostics."""

from __future__ import annotations

import json
import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from navstack.core import (
    Costmap,
    Footprint,
    GridGeometry,
    InputError,
    InvalidPathError,
    NoValidControlError,
    ParameterError,
    Path,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
)
from navstack.local_planner import DWBParams, DWBPlanner
from navstack.local_planner.critics import RotateToGoalCritic
from navstack.local_planner.dwb.critics import ObstacleFootprintCritic, OscillationCritic, OscillationParams
from navstack.local_planner.dwb.plan_window import PlanWindow
from navstack.local_planner.path_handlers import FeasiblePathHandler
from navstack.parameters import load_configuration
from navstack.plugins import CRITICS, LOCAL_PLANNERS, ControlInput, Inflation, Rollouts, ScoringContext
from navstack.testing import critic_contract

LIMITS: dict[str, Any] = {
    "max_vel_x": 0.5,
    "max_speed_xy": 0.5,
    "max_vel_theta": 1.0,
    "acc_lim_x": 1.0,
    "acc_lim_theta": 2.0,
    "decel_lim_x": -1.0,
    "decel_lim_theta": -2.0,
    "linear_granularity": 0.05,
}
ROUND = Footprint.from_radius(0.18)
LONG = Footprint(np.array([[0.4, 0.1], [-0.4, 0.1], [-0.4, -0.1], [0.4, -0.1]]))
INFLATED = Inflation(0.18, 0.5, 3.0)
PARAMS = FilePath(__file__).resolve().parents[2] / "params" / "turtlebot_dwb"


def planner(**values: Any) -> DWBPlanner:
    """With the limits of a turtlebot; sections are given by name as dictionaries."""
    sections = {n: v for n, v in values.items() if isinstance(v, dict)}
    plain = {**LIMITS, **{n: v for n, v in values.items() if n not in sections}}
    models = DWBParams.child_models({**plain, **sections})
    return DWBPlanner(DWBParams(**plain, sections={n: models[n](**v) for n, v in sections.items()}))


def line(length: float = 2.0, y: float = 0.0) -> Path:
    x = np.arange(0.0, length + 1e-9, 0.05)
    return Path(np.column_stack((x, np.full(len(x), y), np.zeros(len(x)))), "odom")


def inputs(
    pose: Pose2D = Pose2D(0.0, 0.0),
    velocity: Twist2D = Twist2D(),
    footprint: Footprint = ROUND,
    inflation: Inflation | None = INFLATED,
    **cells: int,
) -> ControlInput:
    """Costs by cell: c60_41=254 is the cell at (1.025, 0.075)."""
    costmap = Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0), frame="odom")
    for cell, cost in cells.items():
        ix, iy = (int(v) for v in cell[1:].split("_"))
        costmap.data[iy, ix] = cost
    return ControlInput(RobotState(pose, velocity), costmap, footprint, inflation=inflation)


def following(made: DWBPlanner, plan: Path | None = None) -> DWBPlanner:
    plan = line() if plan is None else plan
    made.set_plan(plan, Pose2D(*plan.poses[-1].tolist()))
    return made


# --- parameters -------------------------------------------------------------------------------------------------------


def findings(*settings: str) -> list[str]:
    """What the check of the packaged set reports with settings."""
    configuration = load_configuration([str(PARAMS)], overrides=[f"DWBLocalPlanner/{s}" for s in settings])
    return [f"{f.severity} {f.rule}: {f.message}" for f in configuration.findings]


def errors(*settings: str) -> list[str]:
    with pytest.raises(ParameterError) as caught:
        findings(*settings)
    return [f["message"] for f in caught.value.data["findings"] if f["severity"] == "error"]


def test_the_packaged_set_has_no_findings() -> None:
    assert findings() == []


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("critics=[PathDst]", 'unknown critic "PathDst"; did you mean "PathDist"?'),
        ("critics=[dwb_critics::GoalDistt]", 'did you mean "GoalDist"?'),
        ("critics=[PathDist, PathDist]", 'critics lists "PathDist" twice'),
        ("critics=[]", "critics is empty"),
        ("critics=PathDist", 'critics = "PathDist" is text; write a list'),
        ("PathDist/aggregation_type=mean", 'aggregation_type = "mean" is unknown; use one of: last, sum, product'),
        ("trajectory_generator_name=Standard", 'unknown trajectory generator "Standard"'),
        ("decel_lim_x=2.5", "decel_lim_x = 2.5 is out of range; it must be at most 0"),
        ("acc_lim_x=-2.5", "acc_lim_x = -2.5 is out of range; it must be at least 0"),
        ("sim_time=0.0", "sim_time = 0 is out of range"),
        ("vx_samples=-1", "vx_samples = -1 is out of range"),
        ("vx_samples=1000000", "lower the numbers"),
        ("max_speed_xy=0.0", "every sample that drives is rejected"),
        ("min_vel_x=0.7", "min_vel_x = 0.7 is greater than max_vel_x = 0.5"),
        ("min_speed_xy=0.7", "min_speed_xy = 0.7 is greater than max_speed_xy = 0.5"),
    ],
)
def test_wrong_parameters_have_one_error_each(setting: str, message: str) -> None:
    (found,) = errors(setting)
    assert message in found


def test_limits_of_zero_are_an_error() -> None:
    (found,) = errors("max_vel_x=0.0", "max_vel_theta=0.0")
    assert "the robot does not move" in found


@pytest.mark.parametrize(
    ("setting", "rule"),
    [
        ("decel_lim_x=0.0", "no-deceleration"),
        ("decel_lim_theta=0.0", "no-deceleration"),
        ("acc_lim_x=0.0", "zero-limits"),
        ("RotateToGoal/xy_goal_tolerance=0.4", "rotate-before-goal"),
        ("prune_plan=false", "two-plan-windows"),
        ("sim_time=6.0", "window-too-small"),
        ("BaseObstacle/scale=0.0", "no-obstacle-critic"),
    ],
)
def test_parameters_that_keep_the_robot_from_its_goal_have_a_warning(setting: str, rule: str) -> None:
    found = findings(setting)
    assert [text.partition(":")[0] for text in found] == [f"warning {rule}"], found


def test_an_elongated_robot_needs_its_outline_checked() -> None:
    footprint = "[[0.4, 0.1], [-0.4, 0.1], [-0.4, -0.1], [0.4, -0.1]]"
    overrides = [f"{name}_costmap/footprint={footprint}" for name in ("local", "global")]
    found = load_configuration([str(PARAMS)], overrides=overrides).findings
    assert "footprint-ignored" in {f.rule for f in found}


def test_names_of_nav2_are_known() -> None:
    assert LOCAL_PLANNERS.get("dwb_core::DWBLocalPlanner").cls is DWBPlanner
    for name in ("BaseObstacle", "ObstacleFootprint", "GoalAlign", "PathAlign", "PathDist", "GoalDist"):
        assert CRITICS.get(f"dwb_critics::{name}Critic").cls is type(planner(critics=[name]).critics[0])
    assert [c.name for c in planner(critics=["PathDistCritic"]).critics] == ["PathDistCritic"]


def test_a_critic_has_a_name_and_a_class() -> None:
    """Two critics of one class, with parameters of their own."""
    made = planner(
        critics=["Near", "Far"],
        Near={"class": "PathDist", "scale": 3.0},
        Far={"class": "dwb_critics::PathDistCritic", "aggregation_type": "Sum"},
    )
    assert [type(c).__name__ for c in made.critics] == ["PathDistCritic"] * 2
    assert [c.params.scale for c in made.critics] == [3.0, 1.0]
    with pytest.raises(ValidationError, match='unknown critic "Nowhere" of Near'):
        planner(critics=["Near"], Near={"class": "Nowhere"})


def test_critics_of_other_packages_are_found_in_their_namespaces() -> None:
    made = planner(critics=["GoalCritic", "obstacle"], default_critic_namespaces=["mppi::critics"])
    assert [type(c).__module__.split(".")[2] for c in made.critics] == ["mppi", "critics"]


@pytest.mark.slow
def test_critics_of_dwa_score_for_dwb() -> None:
    made = following(planner(critics=["obstacle", "oscillation", "GoalDist"]))
    assert made.compute_command(inputs()).command.vx > 0.3


def test_rotate_to_goal_takes_parameters_of_the_controller_unless_it_has_its_own() -> None:
    made = planner(critics=["RotateToGoal"], xy_goal_tolerance=0.4, RotateToGoal={"trans_stopped_velocity": 0.1})
    critic = made.critics[0]
    assert isinstance(critic, RotateToGoalCritic)
    assert critic.params.xy_goal_tolerance == 0.4 and critic.params.trans_stopped_velocity == 0.1


def test_without_critics_those_of_nav2_bringup_are_used() -> None:
    scales = {c.name: c.params.scale for c in planner().critics}
    assert scales == {
        "RotateToGoal": 32.0,
        "Oscillation": 1.0,
        "BaseObstacle": 0.02,
        "GoalAlign": 24.0,
        "PathAlign": 32.0,
        "PathDist": 32.0,
        "GoalDist": 24.0,
    }


# --- limits -----------------------------------------------------------------------------------------------------------


def test_a_speed_limit_lowers_all_speeds_in_proportion() -> None:
    made = planner(min_vel_x=-0.4)
    made.set_speed_limit(50.0, percentage=True)
    assert (made.limits.max_vel_x, made.limits.max_vel_trans, made.limits.max_vel_theta) == (0.25, 0.25, 0.5)
    made.set_speed_limit(0.1, percentage=False)
    assert made.limits.max_vel_trans == 0.1 and made.limits.max_vel_theta == pytest.approx(0.2)
    made.set_speed_limit(0.0, percentage=False)
    assert made.limits == planner(min_vel_x=-0.4).limits
    made.set_limits(max_vel_theta=0.3)
    assert made.limits.max_vel_theta == 0.3 and made.limits.max_vel_x == 0.5


def test_a_lowest_speed_above_a_lowered_highest_one_is_lowered_too() -> None:
    made = planner(min_vel_x=0.2)
    made.set_limits(max_vel_trans=0.1)
    command = following(made).compute_command(inputs()).command
    assert 0.0 < command.vx <= 0.1


def test_a_speed_limit_of_zero_stops_the_robot() -> None:
    made = following(planner())
    made.set_limits(max_vel_trans=0.0, max_vel_theta=0.0)
    plan = made.compute_command(inputs(velocity=Twist2D(0.3, 0.0, 0.2)))
    assert plan.command == Twist2D() and plan.notes
    made.set_limits()
    assert made.compute_command(inputs()).command.vx > 0.0


def test_limits_without_a_sample_are_an_error_with_the_cause() -> None:
    made = following(planner(max_vel_x=0.0, max_vel_theta=0.0))
    with pytest.raises(NoValidControlError, match="max_vel_x, max_vel_theta and max_speed_xy"):
        made.compute_command(inputs())
    assert made.diagnostics() is None


def test_too_many_points_are_an_error_with_the_cause() -> None:
    made = following(planner(angular_granularity=1e-6))
    with pytest.raises(InputError, match="raise linear_granularity"):
        made.compute_command(inputs())


# --- the part of the plan ---------------------------------------------------------------------------------------------


def test_parameters_of_kilted_select_its_plan_window() -> None:
    assert isinstance(planner().path_handler, FeasiblePathHandler)
    for name, value in (("prune_plan", True), ("prune_distance", 1.0), ("forward_prune_distance", 3.0)):
        assert isinstance(planner(**{name: value}).path_handler, PlanWindow)


@pytest.mark.parametrize("prune", [True, False])
@pytest.mark.parametrize("shorten", [True, False])
def test_the_plan_window_is_that_of_kilted(prune: bool, shorten: bool) -> None:
    """A plain search over the poses, along a plan that comes back near its beginning."""
    angles = np.linspace(0.0, 1.9 * math.pi, 300)
    plan = np.column_stack((2.0 * np.sin(angles), 2.0 - 2.0 * np.cos(angles), angles))
    window = PlanWindow(prune=prune, prune_distance=0.5, shorten=shorten, forward_prune_distance=0.9)
    window.set_plan(Path(plan, "map"))
    geometry = GridGeometry(60, 60, 0.05, 0.0, 0.0)
    rest, dropped = plan.tolist(), 0
    for at in plan[::20].tolist():
        robot = Pose2D(at[0] + 0.03, at[1] - 0.02, at[2])
        behind, ahead = (0.5 if prune else 1.5), (0.9 if shorten else 1.5)
        driven, searched = 0.0, len(rest)
        for i in range(1, len(rest)):
            driven += math.dist(rest[i][:2], rest[i - 1][:2])
            if driven > 0.9:
                searched = i
                break
        first = next((i for i in range(searched) if math.dist(rest[i][:2], robot[:2]) < behind), searched)
        end = next((i for i in range(first, len(rest)) if math.dist(rest[i][:2], robot[:2]) > ahead), len(rest))
        if first == end:  # Nav2 has no command here
            path = window.local_path(robot, Transform2D(), geometry)
            assert math.dist(rest[path.first - dropped][:2], robot[:2]) < min(behind, ahead)
            break
        path = window.local_path(robot, Transform2D(), geometry)
        assert (path.first, path.end) == (dropped + first, dropped + end)
        np.testing.assert_allclose(path.poses[:, :2], np.array(rest)[first:end, :2], atol=1e-12)
        assert path.ends_at_goal == (end == len(rest))
        if prune:
            rest, dropped = rest[first:], dropped + first


def test_the_plan_window_needs_a_plan_nearby() -> None:
    window = PlanWindow(prune=True, prune_distance=2.0, shorten=True, forward_prune_distance=2.0)
    geometry = GridGeometry(80, 80, 0.05, -2.0, -2.0)
    with pytest.raises(InvalidPathError, match="set_plan"):
        window.local_path(Pose2D(0.0, 0.0), Transform2D(), geometry)
    window.set_plan(Path(np.array([[30.0, 0.0, 0.0], [31.0, 0.0, 0.0]])))
    with pytest.raises(InvalidPathError, match=r"30\.00 m from the robot"):
        window.local_path(Pose2D(0.0, 0.0), Transform2D(), geometry)


@pytest.mark.parametrize(("ahead", "x"), [(2.0, 3.7), (0.5, 1.2)])
def test_the_plan_window_finds_a_robot_that_has_driven_a_part_of_the_plan(ahead: float, x: float) -> None:
    """A path that is sent again after a recovery; a window that ends nearer than it begins. Nav2 has no command for both."""
    plan = np.zeros((161, 3))
    plan[:, 0] = np.linspace(0.0, 4.0, 161)
    window = PlanWindow(prune=True, prune_distance=2.0, shorten=True, forward_prune_distance=ahead)
    window.set_plan(Path(plan, "map"))
    path = window.local_path(Pose2D(x, 0.02), Transform2D(), GridGeometry(60, 60, 0.05, x - 1.5, -1.5))
    reach = min(1.5, ahead)
    np.testing.assert_allclose(path.poses[[0, -1], 0], (max(0.0, x - reach), min(4.0, x + reach)), atol=0.03)
    assert path.remaining_m == pytest.approx(4.0 - x, abs=0.03)  # from the robot, not from the first pose of the window


def test_without_a_forward_limit_the_plan_window_ends_with_the_costmap() -> None:
    plan = line(4.0)
    geometry = GridGeometry(60, 60, 0.05, -1.5, -1.5)
    for limit, end in ((-1.0, 1.5), (0.5, 0.5)):
        window = planner(forward_prune_distance=limit).path_handler
        window.set_plan(plan)
        assert window.local_path(Pose2D(0.0, 0.0), Transform2D(), geometry).poses[-1, 0] == pytest.approx(
            end, abs=0.051
        )


def test_zero_samples_of_an_axis_count_as_two() -> None:
    """Files of robots without sideways motion write vy_samples: 0."""
    commands = [following(planner(vy_samples=n)).compute_command(inputs()).command for n in (0, 2)]
    assert commands[0] == commands[1] and commands[0].vx > 0.0


def test_a_robot_turns_at_its_goal_with_more_than_a_meter_of_the_window_behind_it() -> None:
    """path_length_tolerance came with the path handlers: with the window of before, it counts only if it is written."""
    plan = np.zeros((161, 3))
    plan[:, 0], plan[:, 2] = np.linspace(-4.0, 0.0, 161), 0.0
    goal = Pose2D(0.0, 0.0, 1.5)
    for written, turns in (({}, True), ({"path_length_tolerance": 1.0}, False)):
        made = planner(critics=["RotateToGoal", "PathDist"], prune_plan=True, **written)
        (rotate,) = [critic for critic in made.critics if isinstance(critic, RotateToGoalCritic)]
        made.set_plan(Path(plan, "odom"), goal)
        made.compute_command(inputs(Pose2D(-0.1, 0.0, 0.0)))
        assert rotate.state()["in_window"] is turns


def test_the_plan_window_is_in_the_frame_of_the_costmap() -> None:
    frame = Transform2D(0.7, -1.1, 2.8)
    plan = line()
    here = PlanWindow(prune=True, prune_distance=2.0, shorten=True, forward_prune_distance=1.0)
    here.set_plan(plan.transformed(frame.inverse(), "map"))
    path = here.local_path(Pose2D(0.0, 0.0), frame, GridGeometry(80, 80, 0.05, -2.0, -2.0))
    np.testing.assert_allclose(path.poses[:, :2], plan.poses[: len(path.poses), :2], atol=1e-12)
    assert len(path.poses) == 21


# --- critics ----------------------------------------------------------------------------------------------------------


class TestObstacleFootprint(critic_contract(ObstacleFootprintCritic)):  # type: ignore[misc]
    """With another weight the same contract."""


@pytest.mark.parametrize(
    ("cell", "code"),
    [("c48_40", -6), ("c40_42", -6), ("c40_40", 0), ("c49_43", 0)],
)
def test_obstacle_footprint_looks_at_the_outline(cell: str, code: int) -> None:
    """Of a robot that stands at (0, 0): obstacles on its edges collide, those inside and outside do not."""
    made = following(planner(critics=["ObstacleFootprint", "PathDist"]))
    at = inputs(footprint=LONG, **{cell: 254})
    context = ScoringContext(at.state, at.costmap, LONG, line().poses, Pose2D(2.0, 0.0), made.limits)
    critic = made.critics[0]
    critic.prepare(context)
    still = Rollouts(np.zeros((1, 3)), np.full((1, 2, 3), 0.001), np.array([2]))
    assert critic.score(still).tolist() == [code]
    if code:
        detail = critic.explain(0)
        ix, iy = (int(v) for v in cell[1:].split("_"))
        assert detail.cell == (ix, iy) and detail.step == 0 and detail.reason == "footprint on lethal (254)"


@pytest.mark.parametrize(
    ("costs", "text"),
    [
        ({"c48_40": 255}, "Trajectory Hits Unknown Region."),
        ({"c48_40": 255, "c44_42": 254}, "Trajectory Hits Obstacle."),
        ({"c48_40": 253}, None),
    ],
)
def test_obstacle_footprint_says_what_it_hits_first(costs: dict[str, int], text: str | None) -> None:
    made = planner(critics=["ObstacleFootprint"])
    at = inputs(footprint=LONG, **costs)
    critic = made.critics[0]
    critic.prepare(ScoringContext(at.state, at.costmap, LONG, line().poses, Pose2D(2.0, 0.0), made.limits))
    (score,) = critic.score(Rollouts(np.zeros((1, 3)), np.full((1, 2, 3), 0.001), np.array([2]))).tolist()
    assert (critic.CODES[int(score)] if score < 0 else None) == text


def test_a_footprint_that_leaves_the_map_is_rejected() -> None:
    made = planner(critics=["ObstacleFootprint", "BaseObstacle"])
    at = inputs(footprint=LONG)
    context = ScoringContext(at.state, at.costmap, LONG, line().poses, Pose2D(2.0, 0.0), made.limits)
    poses = np.array([[[1.7, 0.0, 0.0]], [[1.5, 0.0, 0.0]], [[2.1, 0.0, 0.0]]])
    rows = Rollouts(np.zeros((3, 3)), poses, np.ones(3, np.int64))
    for critic, codes in zip(made.critics, ([-5, 0, -4], [0, 0, -4]), strict=True):
        critic.prepare(context)
        assert critic.score(rows).tolist() == codes


def test_oscillation_forbids_the_direction_it_left_until_the_robot_has_moved() -> None:
    critic = OscillationCritic(
        "Oscillation", OscillationParams(oscillation_reset_time=1.0, oscillation_reset_angle=-1.0)
    )
    rows = Rollouts(
        np.array([[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.0, 0.0, 0.5]]), np.zeros((3, 1, 3)), np.ones(3, np.int64)
    )

    def cycle(vx: float, x: float, stamp: float) -> list[float]:
        at = inputs()
        state = RobotState(Pose2D(x, 0.0), Twist2D(), stamp)
        critic.prepare(ScoringContext(state, at.costmap, ROUND, line().poses, Pose2D(2.0, 0.0), planner().limits))
        scores = critic.score(rows).tolist()
        critic.debrief(Twist2D(vx, 0.0, 0.0), Pose2D(x, 0.0))
        return scores

    assert cycle(0.2, 0.0, 0.0) == [0.0, 0.0, 0.0]
    assert cycle(-0.2, 0.0, 0.1) == [0.0, 0.0, 0.0]
    assert cycle(-0.2, 0.0, 0.2) == [-5.0, 0.0, 0.0]
    assert critic.state()["x_negative_only"] and not critic.state()["x_positive_only"]
    assert cycle(-0.2, 0.04, 1.0) == [-5.0, 0.0, 0.0]
    assert cycle(-0.2, 0.04, 1.1) == [-5.0, 0.0, 0.0]
    assert cycle(-0.2, 0.04, 1.2) == [-5.0, 0.0, 0.0]  # more than a second after the change: allowed from now on
    assert cycle(0.2, 0.04, 1.3) == [0.0, 0.0, 0.0]


def test_a_heading_that_passes_pi_has_not_turned_far() -> None:
    critic = OscillationCritic(
        "Oscillation", OscillationParams(oscillation_reset_dist=-1.0, oscillation_reset_angle=0.2)
    )
    for sign, yaw in ((1.0, 3.1), (-1.0, 3.1), (-1.0, -3.13)):
        critic.debrief(Twist2D(sign, 0.0, 0.0), Pose2D(0.0, 0.0, yaw))
    assert critic.state()["x_negative_only"]
    critic.debrief(Twist2D(-1.0, 0.0, 0.0), Pose2D(0.0, 0.0, -2.9))
    assert not critic.state()["x_negative_only"]


def test_every_plan_resets_the_critics() -> None:
    made = following(planner(critics=["RotateToGoal", "Oscillation", "PathDist"]))
    rotate, oscillation = made.critics[:2]
    assert isinstance(rotate, RotateToGoalCritic) and isinstance(oscillation, OscillationCritic)
    rotate.rotating = rotate.near = True
    oscillation.only[0][1] = True
    following(made)
    assert not rotate.near and not rotate.rotating and not oscillation.only[0][1]


def test_rotate_to_goal_looks_ahead_along_the_trajectory() -> None:
    """`lookahead_time` interpolates the simulated headings, also through pi."""
    made = planner(
        critics=["RotateToGoal"],
        trajectory_generator_name="dwb_plugins::LimitedAccelGenerator",
        sim_period=10.0,
        RotateToGoal={"lookahead_time": 0.52, "xy_goal_tolerance": 5.0},
    )
    plan = following(made, line(0.5)).compute_command(inputs(Pose2D(0.0, 0.0, 3.0)))
    assert plan.samples is not None and plan.costs is not None and plan.rejected_by is not None
    turning = np.flatnonzero(plan.rejected_by == -1)
    expected = [abs(math.remainder(3.0 + 0.52 * w, 2.0 * math.pi)) for w in plan.samples[turning, 2]]
    assert len(turning) > 10
    np.testing.assert_allclose(plan.costs[turning, 0], expected, atol=1e-9)


def test_the_outline_is_checked_where_costs_are_not_inflated() -> None:
    """BaseObstacle looks at the center, and an obstacle without inflation would be hit."""
    wall = {f"c{ix}_{iy}": 254 for ix in (54, 55) for iy in range(20, 60)}
    made = following(planner(critics=["BaseObstacle", "PathDist", "GoalDist"]))
    hit = made.compute_command(inputs(velocity=Twist2D(0.4, 0.0, 0.0), **wall))
    raw = made.compute_command(inputs(velocity=Twist2D(0.4, 0.0, 0.0), inflation=None, **wall))
    assert hit.trajectory is not None and raw.trajectory is not None
    assert hit.trajectory[-1, 0] > 0.6 > 0.5 > raw.trajectory[-1, 0]


# --- the selection ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("short", [True, False])
def test_the_short_circuit_does_not_change_the_command(short: bool) -> None:
    made = following(planner(short_circuit_trajectory_evaluation=short))
    other = following(planner(short_circuit_trajectory_evaluation=not short))
    pose, velocity = Pose2D(0.0, 0.1, 0.3), Twist2D(0.2, 0.0, 0.1)
    a, b = made.compute_command(inputs(pose, velocity)), other.compute_command(inputs(pose, velocity))
    assert a.command == b.command and a.best == b.best
    assert a.costs is not None and bool(np.isnan(a.costs).any()) == short
    details = made.diagnostics()
    assert details is not None and ("short_circuit" in details.rule) == short


def test_a_failure_says_which_critic_rejected_what_and_where() -> None:
    ring = {f"c{40 + i}_{40 + j}": 254 for i in range(-5, 5) for j in range(-5, 5) if max(abs(i), abs(j)) > 1}
    made = following(planner(critics=["RotateToGoal", "BaseObstacle", "PathDist"], min_vel_x=0.3, max_vel_theta=0.0))
    with pytest.raises(NoValidControlError) as caught:
        made.compute_command(inputs(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.0), **ring))
    message = caught.value.message
    assert "BaseObstacle (center on lethal (254) 0." in message
    json.dumps(caught.value.as_dict(), allow_nan=False)
    details = made.diagnostics()
    assert details is not None and details.plan.best == -1
    by, detail = details.samples[0]
    assert by == "BaseObstacle" and detail.cost == 254 and detail.ahead_m is not None and detail.ahead_m > 0.0


def test_no_cell_of_the_plan_in_the_costmap_rejects_everything() -> None:
    """Unknown cells do not count as cells of the plan."""
    made = following(planner(critics=["PathDist"]))
    unknown = {f"c{ix}_40": 255 for ix in range(80)}
    with pytest.raises(NoValidControlError, match="no cell of the plan is known"):
        made.compute_command(inputs(**unknown))


def test_diagnostics_have_the_grids_and_states_of_the_critics() -> None:
    made = following(planner(), Path(line().poses + (0.01, 0.01, 0.0), "odom"))
    plan = made.compute_command(inputs(Pose2D(0.0, 0.0)))
    details = made.diagnostics()
    assert details is not None and details.plan is plan
    assert set(details.grids) == {"GoalAlign", "PathAlign", "PathDist", "GoalDist"}
    assert details.grids["PathDist"][40, 40:76].max() == 0.0 and details.grids["PathDist"][45, 60] == 5.0
    assert details.critic_states["RotateToGoal"] == {"in_window": False, "rotating": False}
    assert details.critic_states["Oscillation"]["x_positive_only"] is False


def test_the_robot_turns_at_the_goal_and_stops_there() -> None:
    """RotateToGoal slows down, then turns; the goal checker ends it."""
    made = planner(limit_vel_cmd_in_traj=True, controller_frequency=10.0)
    plan = line(1.0)
    plan.poses[-1, 2] = 1.5
    following(made, plan)
    pose, velocity, turned = Pose2D(0.0, 0.0), Twist2D(), 0
    for _ in range(150):
        now = inputs(pose, velocity)
        if made.goal_reached(now):
            break
        velocity = made.compute_command(now).command
        turned += velocity.vx == 0.0 and velocity.wz > 0.0
        yaw = pose.yaw + 0.05 * velocity.wz
        x, y = pose.x + 0.1 * velocity.vx * math.cos(yaw), pose.y + 0.1 * velocity.vx * math.sin(yaw)
        pose = Pose2D(x, y, pose.yaw + 0.1 * velocity.wz)
    assert made.goal_reached(inputs(pose, velocity)) and turned > 5
    assert made.compute_command(inputs(pose, velocity)).mode == "arrived"
