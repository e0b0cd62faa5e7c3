"""A learned policy as a controller: what it sees, its limits, its collision check, wrong models."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import TensorProto

from navstack.cli import app
from navstack.core import (
    ControlError,
    Costmap,
    GridGeometry,
    InputError,
    NoValidControlError,
    Pose2D,
    RobotState,
    Twist2D,
)
from navstack.gym import LocalControlEnv, read_levels
from navstack.local_planner.goal_checkers import SimpleGoalCheckerParams
from navstack.local_planner.policy import PolicyController, PolicyParams, costmap_ranges
from navstack.parameters import check_parameters
from navstack.scenario import Run, load_scenario
from navstack.studies.barn import barn_configuration, run_world
from navstack.testing.doubles import FOOTPRINT, control_input, straight_path
from tests.local_planner.networks import shared_network, toward_goal, write_network

NEAR = SimpleGoalCheckerParams(xy_goal_tolerance=0.15, yaw_goal_tolerance=0.2)


def policy(**values: Any) -> PolicyController:
    params: dict[str, Any] = {"model": shared_network(), "scan_clip": 2.0, "sections": {"goal_checker": NEAR}}
    return PolicyController(PolicyParams(**{**params, **values}))


# --- what it sees -----------------------------------------------------------------------------------------------------


def test_ranges_end_where_the_ray_enters_a_lethal_cell() -> None:
    """A wall of cells from x = 1.0 on: the range of a beam at the angle a is 1 / cos(a)."""
    costs = np.zeros((81, 81), np.uint8)
    costs[:, 60:] = 254
    costs[0] = 253  # inscribed cells are free for a lidar
    out = np.empty(41)
    grid = np.array([-2.0, -2.0, 0.05])
    costmap_ranges(costs, grid, np.array([0.013, 0.0, 0.0]), -0.5, 0.025, 3.0, out)
    angles = -0.5 + 0.025 * np.arange(41)
    assert out == pytest.approx(0.987 / np.cos(angles), abs=1e-9)
    costmap_ranges(costs, grid, np.array([0.013, 0.0, math.pi]), -0.5, 0.025, 3.0, out)
    assert (out == 3.0).all()  # nothing behind it, and nothing outside the costmap
    costmap_ranges(costs, grid, np.array([9.0, 0.0, 0.0]), -0.5, 0.025, 3.0, out)
    assert (out == 3.0).all()
    costmap_ranges(costs, grid, np.array([1.5, 0.0, 0.0]), -0.5, 0.025, 3.0, out)
    assert (out == 0.0).all()


def test_it_sees_what_the_environment_shows(tmp_path: Path) -> None:
    """In a costmap with the cells of the cylinders, ranges differ by a cell, and the rest by rounding."""
    beams, plan = 90, 4
    (level,) = read_levels("barn", count=1)
    env = LocalControlEnv(levels=level, beams=beams, plan=plan, scan_clip=2.0, flat=True, last_action=True)
    size = beams + 6 + 2 * plan + 2
    controller = policy(
        model=str(toward_goal(tmp_path / "policy.onnx", beams, size=size)),
        beams=beams,
        plan_points=plan,
        last_action=True,
    )
    seen: list[np.ndarray] = []
    controller._model = lambda observation: seen.append(observation.copy()) or np.array([0.5, 0.2])  # type: ignore[assignment]
    controller.set_plan(straight_path(level.start, level.goal), level.goal)
    poses = np.column_stack((level.path, np.zeros(len(level.path))))
    controller.set_plan(type(straight_path(level.start, level.goal))(poses, "odom"), level.goal)
    observation, _ = env.reset(seed=0)
    pose, velocity = level.start, Twist2D()
    for _ in range(25):
        costmap = Costmap(GridGeometry(140, 140, 0.05, round(pose.x, 2) - 3.5, round(pose.y, 2) - 3.5), frame="odom")
        y, x = np.mgrid[:140, :140] * 0.05 + 0.025
        x, y = x + costmap.geometry.origin_x, y + costmap.geometry.origin_y
        for cx, cy, radius in level.world.solids_at(0.0).discs.tolist():
            costmap.data[np.hypot(x - cx, y - cy) <= radius + 0.025] = 254
        controller.compute_command(
            control_input(pose, velocity).__class__(RobotState(pose, velocity), costmap, FOOTPRINT)
        )
        scan = np.abs(seen[-1][:beams] - observation[:beams]) * 2.0
        # rays that graze a cylinder hit its cell or what is behind it
        assert np.median(scan) < 0.05 and (scan < 0.15).mean() > 0.8
        assert seen[-1][beams : beams + 6] == pytest.approx(observation[beams : beams + 6], abs=1e-5)
        # the points of the plan are those of the path, to a cell of its grid
        assert seen[-1][beams + 6 : -2] == pytest.approx(observation[beams + 6 : -2], abs=0.15 / 5.0)
        assert seen[-1][-2:] == pytest.approx(observation[-2:], abs=1e-6)
        observation, *_, info = env.step(np.array([0.5, 0.2], np.float32))
        velocity = Twist2D(0.75, 0.0, 0.4)
        pose = Pose2D(*info["pose"].tolist())


# --- commands ---------------------------------------------------------------------------------------------------------


def test_a_slower_limit_keeps_the_arc() -> None:
    controller = policy()
    goal = Pose2D(1.5, 1.0, 0.0)
    controller.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    free = controller.compute_command(control_input(Pose2D(0.0, 0.0))).command
    assert free.vx > 0.2 and free.wz > 0.2
    controller.set_limits(max_vel_trans=0.1)
    slow = controller.compute_command(control_input(Pose2D(0.0, 0.0))).command
    assert slow.vx == pytest.approx(0.1) and slow.wz / slow.vx == pytest.approx(free.wz / free.vx)
    controller.set_limits(max_vel_theta=0.05)
    assert abs(controller.compute_command(control_input(Pose2D(0.0, 0.0))).command.wz) <= 0.05 + 1e-12
    controller.set_limits(max_vel_trans=0.0)
    assert controller.compute_command(control_input(Pose2D(0.0, 0.0))).command.speed == 0.0
    with pytest.raises(ControlError, match="max_vel_trans must be a finite speed"):
        controller.set_limits(max_vel_trans=math.nan)


def test_before_a_wall_it_slows_down_and_turns() -> None:
    controller = policy(collision_time=1.0)
    goal = Pose2D(1.6, 0.0, 0.0)
    wall = tuple((0.5, 0.025 + 0.05 * i) for i in range(-20, 20))
    controller.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    plan = controller.compute_command(control_input(Pose2D(0.0, 0.0), lethal=wall))
    assert 0.0 < plan.command.vx < 0.5
    assert any("slower on the same arc" in note for note in plan.notes)
    assert any(note.startswith("action of the policy: ") for note in plan.notes)
    plan = controller.compute_command(control_input(Pose2D(0.28, 0.0), lethal=wall))
    assert plan.command.speed == 0.0 and plan.command.wz != 0.0
    ring = [(0.18 * math.cos(a), 0.18 * math.sin(a)) for a in np.linspace(0.0, 2.0 * math.pi, 100).tolist()]
    with pytest.raises(NoValidControlError, match="slower, and when it turns in place, too"):
        controller.compute_command(control_input(Pose2D(0.0, 0.0), lethal=ring))
    unchecked = policy(use_collision_detection=False)
    unchecked.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    assert unchecked.compute_command(control_input(Pose2D(0.28, 0.0), lethal=wall)).command.vx > 0.5


def test_sideways_actions_of_a_holonomic_policy(tmp_path: Path) -> None:
    model = toward_goal(tmp_path / "omni.onnx", outputs=3)
    controller = policy(model=str(model), max_vel_y=0.4, min_vel_y=-0.2)
    goal = Pose2D(1.5, 0.0, 0.0)
    controller.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    # the action 0 is the middle of the range
    assert controller.compute_command(control_input(Pose2D(0.0, 0.0))).command.vy == pytest.approx(0.1)


# --- wrong models -----------------------------------------------------------------------------------------------------


def broken(tmp_path: Path, kind: str) -> dict[str, Any]:
    file = tmp_path / f"{kind}.onnx"
    weights, bias = np.zeros((126, 2)), np.zeros(2)
    match kind:
        case "none":
            return {"model": ""}
        case "absent":
            return {"model": str(file)}
        case "text":
            file.write_text("not a network")
        case "inputs":
            toward_goal(file, size=130)
        case "rank":
            write_network(file, weights, bias, shape=[1, 1, 126])
        case "doubles":
            write_network(file, weights, bias, kind=TensorProto.DOUBLE)
        case "outputs":
            write_network(file, np.zeros((126, 4)), np.zeros(4))
        case "nan":
            write_network(file, weights, np.array([np.nan, 0.0]))
        case "dynamic":
            write_network(file, np.zeros((130, 2)), bias, shape=[1, "n"])
    return {"model": str(file)}


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("none", "no policy is given; set model to an ONNX file"),
        ("absent", "does not exist; set model to an ONNX file"),
        ("text", "is not a readable ONNX file"),
        (
            "inputs",
            "the input of {} is (1, 130) tensor(float), but beams, plan_points and last_action make an observation of",
        ),
        ("rank", "(1, 1, 126) tensor(float)"),
        ("doubles", "tensor(double)"),
        ("outputs", "the output of {} has 4 numbers, but an action has 2"),
        ("nan", "gave the action [nan, 0.0], which is not finite"),
        ("dynamic", "cannot be run on an observation of 126 numbers"),
    ],
)
def test_a_wrong_model_is_one_message(kind: str, message: str, tmp_path: Path) -> None:
    values = broken(tmp_path, kind)
    with pytest.raises(InputError) as caught:
        policy(**values)
    assert message.format(values["model"]) in caught.value.message
    assert "\n" not in caught.value.message


def test_nan_while_driving_is_a_control_error(tmp_path: Path) -> None:
    """A network whose output is infinite for a near obstacle only: 0 / 0 in a beam."""
    weights = np.zeros((126, 2))
    controller = policy(model=str(write_network(tmp_path / "p.onnx", weights, np.zeros(2))))
    goal = Pose2D(1.5, 0.0, 0.0)
    controller.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    session = controller._model._session
    controller._model._session = type("Session", (), {"run": lambda *_: [np.array([[np.nan, 0.1]])]})()
    with pytest.raises(ControlError, match=r"gave the action \[nan, 0\.1\], which is not finite"):
        controller.compute_command(control_input(Pose2D(0.0, 0.0)))
    controller._model._session = session
    assert controller.compute_command(control_input(Pose2D(0.0, 0.0))).command.is_finite()


def sources(model: str, **values: Any) -> list[Any]:
    return ["turtlebot", {"base_local_planner": "policy", "policy": {"model": model, **values}}]


def test_the_check_says_what_is_wrong(tmp_path: Path) -> None:
    findings = check_parameters(sources(str(tmp_path / "none.onnx")))
    assert any(f.severity == "error" and f.rule == "policy-model" for f in findings)
    findings = check_parameters(sources(shared_network(), scan_clip=9.0))
    (far,) = [f for f in findings if f.rule == "window-too-small"]
    assert "what is beyond looks free" in far.message


# --- the whole stack --------------------------------------------------------------------------------------------------


def test_it_drives_a_scenario_and_the_monitor_and_the_explainer_know_it(tmp_path: Path, capsys: Any) -> None:
    scenario = load_scenario(
        "narrow_door" if Path("narrow_door").exists() else _shipped("narrow_door"),
        params=sources(shared_network(), beams=120, max_vel_x=0.5, max_vel_theta=1.0, scan_clip=1.5),
    )
    run = Run(scenario)
    while run.step():
        pass
    result = run.result(0.0)
    assert not run.robot.collisions
    assert result.goals[0].state in ("SUCCEEDED", "ABORTED")
    assert run.robot.distance_travelled > 1.0
    assert run.recorder is not None
    record = tmp_path / "run.npz"
    run.recorder.save(record)
    found = sorted(tmp_path.iterdir())[0]
    assert app.run(["explain", "command", str(found), "--time", "4"]) in (0, None)
    assert "action of the policy" in capsys.readouterr().out


def _shipped(name: str) -> Path:
    from navstack.scenario import shipped_scenarios

    return shipped_scenarios()[name]


def test_two_runs_through_a_barn_world_are_the_same_to_the_bit() -> None:
    (level,) = read_levels("barn", count=1)
    from navstack.gym import generated_barn_worlds

    (world,) = generated_barn_worlds([0])
    configuration = barn_configuration(
        ["jackal_dwa", "examples/learning/policy.yaml"],
        overrides=[f"policy/model={shared_network()}", "policy/plan_points=0"],
    )
    outcomes = [run_world(world, configuration)[0] for _ in range(2)]
    assert outcomes[0] == outcomes[1] and outcomes[0].length_m > 1.0
    assert level.length == world.optimal_length_m
