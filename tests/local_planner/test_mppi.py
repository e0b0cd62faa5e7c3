"""MPPI: closed forms, statistics of its noise, limits in random scenes, failures, wrong input, and its explanations."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from navstack.core import Footprint, NoValidControlError, ParameterError, Pose2D, RobotState, Twist2D
from navstack.local_planner.mppi import MPPIParams, MPPIPlanner
from navstack.local_planner.mppi.batch import LANES, Batch, Motion, TrajectoryContext
from navstack.local_planner.mppi.collisions import EVERYWHERE, CollisionTest, table
from navstack.local_planner.mppi.critics import (
    ConstraintCritic,
    CostCritic,
    GoalAngleCritic,
    GoalCritic,
    PreferForwardCritic,
    TwirlingCritic,
    VelocityDeadbandCritic,
)
from navstack.local_planner.mppi.optimizer import FILTERS, Optimizer, fill_normals, smooth, softmax
from navstack.local_planner.mppi.params import DIFF, OMNI, MotionModelParams
from navstack.parameters import check_parameters, load_configuration
from navstack.plugins import ControlInput, Inflation
from navstack.testing.doubles import FOOTPRINT, driven, local_costmap, straight_path

f32 = np.float32


def params(model: str = DIFF, radius: float = 0.2, **values: Any) -> MPPIParams:
    sections = {"base": MotionModelParams(plugin=model, min_turning_r=radius), **values.pop("sections", {})}
    return MPPIParams(**{"batch_size": 200, "motion_model": "base", "sections": sections, **values})


def open_field(pose: Pose2D = Pose2D(0.0, 0.0), cost: int = 0, lethal: Any = ()) -> TrajectoryContext:
    """A robot on the way to a goal 5 m ahead, on a costmap of one cost."""
    costmap = local_costmap(pose, lethal, side_m=6.0)
    costmap.data[costmap.data == 0] = cost
    plan = straight_path(pose, Pose2D(pose.x + 2.0, pose.y)).poses
    goal = Pose2D(pose.x + 5.0, pose.y)
    return TrajectoryContext(
        RobotState(pose),
        costmap,
        FOOTPRINT,
        plan,
        goal,
        None,  # type: ignore[arg-type]
        length=5.0,
        target=goal,
        inflation=Inflation(0.18, 0.5, 5.0),
    )


# --- noise ------------------------------------------------------------------------------------------------------------


def normals(first: int, second: int, size: int = 1 << 17) -> Any:
    out = np.empty(size, np.float32)
    fill_normals(np.array([first, second], np.uint32), f32(1.0), out)
    return out.astype(np.float64)


def test_the_noise_is_normal() -> None:
    """Moments within 5 standard errors, and the shape by Kolmogorov and Smirnov."""
    from scipy import stats

    for keys in ((0, 0), (1, 0), (0, 1), (123456789, 987654321), (2**32 - 1, 7)):
        x = normals(*keys)
        n = len(x)
        assert abs(x.mean()) < 5.0 / math.sqrt(n)
        assert abs(x.var() - 1.0) < 5.0 * math.sqrt(2.0 / n)
        assert abs((x**3).mean()) < 5.0 * math.sqrt(15.0 / n)
        assert abs((x**4).mean() - 3.0) < 5.0 * math.sqrt(96.0 / n)
        assert stats.kstest(x, "norm").pvalue > 1e-4
        assert 4.0 < np.abs(x).max() < 7.0


def test_the_noise_is_independent() -> None:
    """Between neighbors, steps, cycles and axes: correlations within 5 standard errors."""
    base = normals(10, 20)
    bound = 5.0 / math.sqrt(len(base))
    for lag in (1, 2, 3, LANES - 1, LANES, 2 * LANES, 1024, 2048):
        assert abs(np.corrcoef(base[:-lag], base[lag:])[0, 1]) < 1.01 * bound, lag
    for keys in ((11, 20), (10, 21), (10 + 2 * LANES, 20), (20, 10)):
        other = normals(*keys)
        assert abs(np.corrcoef(base, other)[0, 1]) < bound
        assert abs(np.corrcoef(base**2, other**2)[0, 1]) < bound


@pytest.mark.slow
def test_the_noise_is_a_function_of_its_counter() -> None:
    """The same in another process, and new in every cycle only if asked."""
    code = "from tests.local_planner.test_mppi import normals; print(normals(3, 4, 512).tobytes().hex())"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert other == normals(3, 4, 512).tobytes().hex()
    same, fresh = Optimizer(params(), []), Optimizer(params(regenerate_noises=True), [])
    seen: list[list[bytes]] = [[], []]
    for _ in range(2):
        for optimizer, found in zip((same, fresh), seen, strict=True):
            optimizer.draw(0)
            found.append(optimizer.noise.tobytes())
            optimizer.finish(Twist2D())
    assert seen[0][0] == seen[0][1] and seen[1][0] != seen[1][1]
    assert Optimizer(params(seed=1), []).params.seed == 1
    other_seed = Optimizer(params(seed=1), [])
    other_seed.draw(0)
    assert other_seed.noise.tobytes() != seen[0][0]


# --- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gamma", [0.0, 0.015])
def test_without_critics_an_update_shrinks_the_controls_by_gamma(gamma: float) -> None:
    """u -> u * (1 - gamma / temperature) in expectation; the error of a mean of K samples is sigma / sqrt(K)."""
    p = params(batch_size=20_000, gamma=gamma, seed=5)
    optimizer = Optimizer(p, [])
    optimizer.controls[:, 0] = 0.3
    optimizer.controls[:, 2] = -0.5
    before = optimizer.controls.copy()
    optimizer.draw(0)
    optimizer.sampled = optimizer.noise
    optimizer.costs[:] = 0.0
    optimizer.add_control_cost()
    optimizer.weigh()
    optimizer.average()
    factor = 1.0 - gamma / 0.3
    for axis, sigma in ((0, 0.2), (2, 0.4)):
        error = optimizer.controls[:, axis] - factor * before[:, axis]
        assert abs(error.mean()) < 5.0 * sigma / math.sqrt(20_000 * 56)
        assert np.abs(error).max() < 5.0 * sigma / math.sqrt(20_000)


def test_the_filter() -> None:
    """Gains, polynomials, a step, and short sequences."""
    assert FILTERS[1].sum() == pytest.approx(1.0, abs=1e-6) and FILTERS[2].sum() == pytest.approx(1.0, abs=1e-6)
    assert math.sqrt((FILTERS[2] ** 2).sum()) == pytest.approx(0.505, abs=1e-3)
    assert math.sqrt((FILTERS[1] ** 2).sum()) == pytest.approx(0.333, abs=1e-3)
    t = np.arange(-4.0, 40.0)
    for order, curve in ((2, 0.5 * t**3 - t**2 + 3.0), (1, 2.0 * t - 1.0)):
        values = np.repeat(curve[:, None], 3, axis=1).astype(np.float32)
        out = np.empty_like(values[4:])
        smooth(np.ascontiguousarray(values[4:]), np.ascontiguousarray(values[:4]), FILTERS[order], out)
        np.testing.assert_allclose(out[:-5], values[4:-5], rtol=1e-4, atol=0.02)
    for order, expected in ((2, (0.628, 0.861, 1.030, 1.091, 1.0)), (1, (0.556, 0.667, 0.778, 0.889, 1.0))):
        ones, out = np.ones((30, 3), np.float32), np.empty((30, 3), np.float32)
        smooth(ones, np.zeros((4, 3), np.float32), FILTERS[order], out)
        np.testing.assert_allclose(out[:5, 0], expected, atol=1e-3)
    short = Optimizer(params(time_steps=20), [])
    short.controls[:] = np.random.default_rng(0).normal(size=(20, 3))
    before = short.controls.copy()
    short.smooth()
    np.testing.assert_array_equal(short.controls, before)


def test_integration_is_eulers_polygon() -> None:
    """Constant speeds: the closed form of the sum."""
    p = params(time_steps=30, ax_max=1000.0, ax_min=-1000.0, az_max=1000.0)
    optimizer = Optimizer(p, [])
    optimizer.controls[:] = (0.4, 0.0, 0.9)
    start, yaw, dt = np.array([0.4, 0.0, 0.9], f32), 0.7, 0.05
    optimizer.roll_out(start, Pose2D(1000.0, -2000.0, yaw))
    for n in (1, 7, 30):
        angle = 0.5 * 0.9 * dt
        chord = 0.4 * dt * math.sin(n * angle) / math.sin(angle)
        heading = yaw + (n - 1) * angle
        expected = (chord * math.cos(heading), chord * math.sin(heading), yaw + n * 0.9 * dt)
        np.testing.assert_allclose(optimizer.batch.points[:, n - 1, 0], expected, atol=2e-6)


def batch_of(speeds: tuple[float, float, float], yaw: float = 0.0) -> Batch:
    """One trajectory of constant speeds over 56 steps of 0.05 s."""
    batch = Batch.empty(1, 56, 0.05)
    batch.speeds[:] = np.array(speeds, f32)[:, None, None]
    batch.points[0] = (speeds[0] * 0.05 * np.arange(1, 57, dtype=f32))[:, None]
    batch.points[2] = yaw
    return batch


def total(cls: Any, context: TrajectoryContext, batch: Batch, **values: Any) -> float:
    critic = cls("critic", cls.Params(**values))
    context.begin(batch.anchor)
    critic.prepare(context)
    out, totals = np.zeros((2, batch.points.shape[2]), f32)
    critic.add_scores(batch, out, totals)
    return float(totals[0])


def test_scores_of_simple_trajectories() -> None:
    """The figures of Nav2's formulas, with its weights."""
    far, near = open_field(), open_field()
    near.length, near.target = 0.3, Pose2D(0.0, 0.3, 0.0)
    rest = batch_of((0.0, 0.0, 0.0))
    assert total(ConstraintCritic, far, batch_of((0.6, 0.0, 0.0))) == pytest.approx(1.12, rel=1e-5)
    assert total(PreferForwardCritic, far, batch_of((-0.2, 0.0, 0.0))) == pytest.approx(2.8, rel=1e-5)
    assert total(PreferForwardCritic, near, batch_of((-0.2, 0.0, 0.0))) == 0.0
    assert total(CostCritic, open_field(cost=100), rest) == pytest.approx(1.5, rel=1e-5)
    assert total(CostCritic, open_field(cost=253), rest) == pytest.approx(535.71, rel=1e-5)
    assert total(GoalCritic, near, rest) == pytest.approx(5.0 * 0.3, rel=1e-5)
    assert total(GoalCritic, far, rest) == 0.0
    assert total(GoalAngleCritic, near, batch_of((0.0, 0.0, 0.0), yaw=0.4)) == pytest.approx(1.2, rel=1e-5)
    assert total(TwirlingCritic, far, batch_of((0.0, 0.0, 0.3))) == pytest.approx(3.0, rel=1e-5)
    slow = total(VelocityDeadbandCritic, far, batch_of((0.05, 0.0, 0.0)), deadband_velocities=[0.08, 0.0, 0.1])
    assert slow == pytest.approx(35.0 * 2.8 * (0.03 + 0.1), rel=1e-4)
    assert total(PreferForwardCritic, far, batch_of((-0.2, 0.0, 0.0)), cost_power=2) == pytest.approx(2.8**2, rel=1e-5)
    assert total(PreferForwardCritic, far, batch_of((-0.2, 0.0, 0.0)), enabled=True, cost_weight=0.0) == 0.0


def test_an_ackermann_turn_below_the_radius_costs() -> None:
    context = open_field()
    context.motion = Motion(0.5, -0.35, 0.0, 1.9, False, 0.5)
    assert total(ConstraintCritic, context, batch_of((0.3, 0.0, 0.6))) == 0.0
    assert total(ConstraintCritic, context, batch_of((0.3, 0.0, 1.0))) == pytest.approx(4.0 * 2.8 * 0.2, rel=1e-4)


def test_softmax() -> None:
    """Equal costs: the mean; a constant changes nothing; the best alone at a low temperature."""
    costs = np.random.default_rng(1).normal(size=256).astype(f32)
    weights, moved = np.empty(256, f32), np.empty(256, f32)
    softmax(costs, 200, f32(0.3), weights)
    softmax(costs + f32(8.0), 200, f32(0.3), moved)
    assert weights.sum() == pytest.approx(1.0, abs=1e-6) and (weights[200:] == 0.0).all()
    np.testing.assert_allclose(weights, moved, atol=1e-6)
    softmax(np.zeros(256, f32), 200, f32(0.3), weights)
    np.testing.assert_allclose(weights[:200], 1.0 / 200.0, rtol=1e-6)
    softmax(costs, 200, f32(1e-6), weights)
    assert weights[int(costs[:200].argmin())] > 0.99


def test_from_rest_the_command_keeps_the_acceleration() -> None:
    planner = MPPIPlanner(params(batch_size=1000))
    goal = Pose2D(3.0, 0.0)
    planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    pose, velocity = Pose2D(0.0, 0.0), Twist2D()
    for n in range(1, 12):
        velocity = planner.compute_command(inputs_at(pose, velocity)).command
        assert velocity.vx <= min(0.15 * n, 0.5) + 1e-6
        pose = driven(pose, velocity, 0.05)
    assert velocity.vx > 0.25


# --- the same world elsewhere -----------------------------------------------------------------------------------------


def inputs_at(pose: Pose2D, velocity: Twist2D, lethal: Any = (), footprint: Footprint = FOOTPRINT) -> ControlInput:
    """With inflation, so that the distance follows from the center's cost."""
    costmap = local_costmap(pose, lethal)
    if lethal:
        from scipy import ndimage

        distance: Any = ndimage.distance_transform_edt(costmap.data != 254)
        away = distance * 0.05
        costs = np.where(away <= 0.18, 253.0, np.floor(252.0 * np.exp(-5.0 * (away - 0.18))))
        costs[away > 0.5] = 0.0
        costmap.data[:] = np.maximum(costmap.data, costs.astype(np.uint8))
    return ControlInput(RobotState(pose, velocity), costmap, footprint, inflation=Inflation(0.18, 0.5, 5.0))


def test_far_from_the_origin_the_command_is_the_same() -> None:
    """100 km away a float32 has steps of 8 mm: the batch is relative to the robot. 100 km are whole cells."""
    commands: list[Twist2D] = []
    for x, y in ((0.0, 0.0), (1e5, -1e5)):
        planner = MPPIPlanner(params())
        pose, goal = Pose2D(x, y, 0.3), Pose2D(x + 3.0, y + 0.5)
        planner.set_plan(straight_path(pose, goal), goal)
        commands.append(planner.compute_command(inputs_at(pose, Twist2D(0.2, 0.0, 0.0))).command)
    assert tuple(commands[0]) == pytest.approx(tuple(commands[1]), abs=1e-4)


# --- limits -----------------------------------------------------------------------------------------------------------


def test_speed_limits_hold_for_every_axis() -> None:
    """A lowered limit scales both axes of a holonomic robot, so that the speed in any direction is within it."""
    planner = MPPIPlanner(params(OMNI))
    planner.set_limits(max_vel_trans=0.2, max_vel_theta=0.4)
    limits = planner.limits
    assert math.hypot(limits.max_vel_x, limits.max_vel_y) == pytest.approx(0.2)
    assert limits.max_vel_theta == 0.4 and limits.max_vel_trans == pytest.approx(0.2)
    planner.set_limits()
    assert planner.limits.max_vel_x == 0.5 and planner.limits.max_vel_theta == 1.9


# --- failures ---------------------------------------------------------------------------------------------------------


def test_all_in_collision_is_no_valid_control_after_the_attempts() -> None:
    """Each attempt with new noise; the message says which critic and where."""
    planner = MPPIPlanner(params(retry_attempt_limit=2))
    goal = Pose2D(1.5, 0.0)
    planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    ring = [(0.17 * math.cos(a), 0.17 * math.sin(a)) for a in np.linspace(0.0, 2.0 * math.pi, 200).tolist()]
    with pytest.raises(NoValidControlError, match="200 of 200 samples rejected by CostCritic") as caught:
        planner.compute_command(inputs_at(Pose2D(0.0, 0.0), Twist2D(), ring))
    assert caught.value.data["attempts"] == 3
    assert caught.value.data["rejected"] == {"CostCritic": 200}
    assert planner.optimizer.last == Twist2D() and not planner.optimizer.controls.any()
    details = planner.diagnostics()
    assert details is not None and details.plan.best == -1 and len(details.plan.notes) == 3
    assert {name for name, _ in details.samples} == {"CostCritic"}


def test_a_retry_can_succeed() -> None:
    """A sequence that leads into a wall is dropped, and the robot finds another."""
    wall = [(0.62, 0.05 * k) for k in range(-30, 31)]
    planner = MPPIPlanner(params(batch_size=500, vx_std=0.05, ax_min=-1.0))
    goal = Pose2D(1.5, 0.0)
    planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    planner.optimizer.controls[:, 0] = 0.5
    planner.optimizer.last = Twist2D(0.12, 0.0, 0.0)
    plan = planner.compute_command(inputs_at(Pose2D(0.0, 0.0), Twist2D(0.1, 0.0, 0.0), wall))
    assert plan.notes and plan.notes[0].startswith("attempt 1 of 2: ")
    assert plan.command.vx < 0.3


# --- wrong input ------------------------------------------------------------------------------------------------------

MPPI: dict[str, Any] = {"base_local_planner": "nav2_mppi_controller::MPPIController", "controller_frequency": 20.0}


def errors_of(**values: Any) -> list[str]:
    found = check_parameters(["turtlebot", {**MPPI, "MPPIController": values}])
    return [f"{f.key}: {f.message}" for f in found if f.severity == "error"]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"critics": ["PathAlginCritic"]}, 'unknown critic "PathAlginCritic"; did you mean "PathAlignCritic"'),
        ({"critics": []}, "critics is empty, so that every sample is as good as any other"),
        ({"batch_size": 0}, "batch_size = 0 is out of range; it must be at least 1"),
        ({"temperature": 0.0}, "temperature = 0 is out of range; it must be greater than 0"),
        ({"vx_std": 0.0}, "vx_std = 0"),
        ({"model_dt": 0.02}, "set model_dt to 0.05 (and time_steps to 22 for the same horizon), or controller_frequency to 50"),
        ({"motion_model": "m", "m": {"plugin": "mppi::TankMotionModel"}}, 'unknown motion model "mppi::TankMotionModel"'),
        ({"motion_model": "Ackermann", "AckermannConstraints": {"min_turning_r": 0.0}}, "min_turning_r = 0"),
        ({"vx_min": 0.6}, "vx_min = 0.6 is greater than vx_max = 0.5"),
        ({"VelocityDeadbandCritic": {"deadband_velocities": [0.1]}, "critics": ["VelocityDeadbandCritic"]}, "needs three speeds"),
        ({"TrajectoryValidator": {"plugin": "mine::Validator"}}, "unknown trajectory validator"),
    ],
)  # fmt: skip
def test_wrong_parameters_are_errors(values: dict[str, Any], expected: str) -> None:
    found = errors_of(**values)
    assert len(found) == 1 and expected in found[0], found


def test_warnings() -> None:
    """A step longer than the period, a path shorter than the horizon, corners that nobody checks."""
    values = {"model_dt": 0.1, "vx_max": 0.5}
    long = {"footprint": [[-0.3, -0.1], [-0.3, 0.1], [0.3, 0.1], [0.3, -0.1]]}
    sources = ["turtlebot", {**MPPI, "MPPIController": values, "local_costmap": long, "global_costmap": long}]
    found = {f.rule: f.message for f in check_parameters(sources) if f.severity == "warning"}
    assert "not shifted" in found["model-dt"]
    assert "trajectories reach 2.8 m" in found["horizon-over-path"]
    assert "consider_footprint of CostCritic is false" in found["footprint-ignored"]


def test_a_controller_that_is_too_slow_is_refused() -> None:
    with pytest.raises(ParameterError, match="Nav2 refuses it"):
        MPPIPlanner(params(controller_frequency=10.0))


def test_a_critic_of_dwa_is_refused() -> None:
    with pytest.raises(ParameterError, match='"path" is a critic of DWA'):
        MPPIPlanner(
            load_configuration(["turtlebot", {**MPPI, "FollowPath": {"critics": ["path"]}}]).local_planner.params
        )


def test_files_of_former_releases() -> None:
    """Motion model and path handling as in Nav2 up to Kilted; Nav2's own namespace."""
    tree = {
        **MPPI,
        "FollowPath": {
            "plugin": "nav2_mppi_controller::MPPIController",
            "motion_model": "Ackermann",
            "AckermannConstraints": {"min_turning_r": 0.45},
            "prune_distance": 1.7,
            "transform_tolerance": 0.1,
        },
        "goal_checker": {"plugin": "nav2_controller::StoppedGoalChecker", "xy_goal_tolerance": 0.2},
    }
    configuration = load_configuration(["turtlebot", tree])
    planner = MPPIPlanner(configuration.local_planner.params)
    assert planner.optimizer.radius == 0.45
    assert planner.path_handler.params.prune_distance == 1.7  # type: ignore[attr-defined]
    assert type(planner.goal_checker).__name__ == "StoppedGoalChecker" and planner.goal_checker.xy_tolerance == 0.2
    assert not [f for f in configuration.findings if f.severity == "warning" and f.key.startswith("FollowPath")]


# --- explanations -----------------------------------------------------------------------------------------------------


def test_the_diagnostics_add_up() -> None:
    """Columns sum to the totals, the chosen sequence is the last row, and the notes name samples, temperature and critics."""
    planner = MPPIPlanner(params(batch_size=300))
    goal = Pose2D(2.0, 0.4)
    planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    assert planner.diagnostics() is None
    planner.compute_command(inputs_at(Pose2D(0.0, 0.0, 0.2), Twist2D(0.2, 0.0, 0.0), [(0.9, -0.3)]))
    details = planner.diagnostics()
    assert details is not None
    plan = details.plan
    assert (
        plan.costs is not None and plan.totals is not None and plan.samples is not None and plan.rejected_by is not None
    )
    assert plan.costs.shape == (301, 9) and plan.best == 300 and plan.critics[-1] == "control cost"
    legal = plan.rejected_by == -1
    np.testing.assert_allclose(plan.totals[legal], plan.costs[legal].sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose(
        plan.totals[:300][legal[:300]], planner.optimizer.costs[:300][legal[:300]], rtol=1e-4, atol=1e-4
    )
    assert details.rollouts.poses.shape == (301, 56, 3)
    assert any(note.startswith("effective sample size") for note in plan.notes)
    assert any("PathFollowCritic vx +" in note for note in plan.notes)


def test_why_the_robot_stands_still() -> None:
    """A wall right ahead, closer than a robot can pass."""
    wall = [(0.45, 0.05 * k) for k in range(-30, 31)]
    planner = MPPIPlanner(params(batch_size=500, vx_min=0.0, wz_std=0.02))
    goal = Pose2D(1.5, 0.0)
    planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    pose, velocity = Pose2D(0.0, 0.0), Twist2D()
    for _ in range(100):
        velocity = planner.compute_command(inputs_at(pose, velocity, wall)).command
        pose = driven(pose, velocity, 0.05)
        if pose.x > 0.05 and abs(velocity.vx) < 0.005:
            break
    details = planner.diagnostics()
    assert details is not None
    assert any("stands still" in note and "CostCritic" in note for note in details.plan.notes), details.plan.notes


def test_dead_time_delays_the_trajectory() -> None:
    """With a dead time of 0.2 s the commands of the last four cycles come first."""
    optimizer = Optimizer(params(model_delay_vx=0.2), [])
    for k in range(6):
        optimizer.finish(Twist2D(0.1 * k, 0.0, 0.0))
    optimizer.controls[:, 0] = 0.5
    optimizer.roll_out(np.array([0.5, 0.0, 0.0], f32), Pose2D(0.0, 0.0))
    np.testing.assert_allclose(optimizer.batch.speeds[0, :6, 0], [0.5, 0.2, 0.3, 0.4, 0.5, 0.5], atol=1e-6)


def test_clamped_controls_are_within_reach() -> None:
    """What is averaged is what a trajectory does."""
    optimizer = Optimizer(params(clamp_raw_controls=True), [])
    start = np.zeros(3, f32)
    optimizer.pin(start)
    optimizer.draw(0)
    optimizer.roll_out(start, Pose2D(0.0, 0.0))
    used = optimizer.sampled[0, 1:, :200] + optimizer.controls[1:, 0, None]
    np.testing.assert_allclose(used, optimizer.batch.speeds[0, 1:, :200], atol=1e-6)
    assert np.abs(np.diff(optimizer.batch.speeds[0], axis=0)).max() <= 0.15 + 1e-6


def test_its_critics_serve_dwa() -> None:
    """Listed for DWA, CostCritic rejects rollouts into a wall, and the robot still drives."""
    listed = [{"name": n, "type": n} for n in ("CostCritic", "PathFollowCritic", "PreferForwardCritic")]
    tree = {"base_local_planner": "dwa", "DWAPlannerROS": {"critics": [*listed, {"name": "path", "type": "path"}]}}
    choice = load_configuration(["turtlebot", tree]).local_planner
    planner: Any = choice.cls(choice.params)
    goal = Pose2D(1.8, 0.0)
    planner.set_plan(straight_path(Pose2D(0.0, 0.0), goal), goal)
    wall = [(0.55, 0.05 * k) for k in range(31)]
    plan = planner.compute_command(inputs_at(Pose2D(0.0, 0.0), Twist2D(0.3, 0.0, 0.0), wall))
    assert plan.rejected_by is not None and 0 < (plan.rejected_by == 0).sum() < len(plan.rejected_by)
    assert plan.command.vx > 0.0


@pytest.mark.parametrize("track_unknown", [False, True])
def test_without_inflation_far_footprints_are_not_checked_and_nothing_changes(track_unknown: bool) -> None:
    """Cells from which the footprint touches nothing are skipped: the same scores and collisions as with every check."""
    rng = np.random.default_rng(11)
    for _ in range(25):
        lethal = [tuple(p) for p in rng.uniform(-3.0, 3.0, (int(rng.integers(1, 8)), 2)).tolist()]
        context = replace(open_field(lethal=lethal), inflation=None, exact=True, track_unknown_space=track_unknown)
        data = context.costmap.data
        data[rng.random(data.shape) < 0.003] = 255
        data[rng.random(data.shape) < 0.003] = 17
        batch = Batch.empty(256, 20, 0.05)
        batch.points[:2] = rng.uniform(-3.2, 3.2, batch.points[:2].shape)
        batch.points[2] = rng.uniform(-3.0, 3.0, batch.points[2].shape)
        test = CollisionTest.of(context, consider_footprint=True)
        whole = replace(test, near=EVERYWHERE)
        assert test.near.any() and not test.near.all()
        for values in (table(np.arange(256.0)), table(np.zeros(256), np.arange(256.0))):
            a, b = np.zeros(256, np.float32), np.zeros(256, np.float32)
            assert np.array_equal(test.scores(batch, 1, values, a), whole.scores(batch, 1, values, b))
            assert np.array_equal(a, b)
        assert [test.first(batch, row) for row in range(256)] == [whole.first(batch, row) for row in range(256)]
