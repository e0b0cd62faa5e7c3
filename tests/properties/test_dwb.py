"""DWB's samples, trajectories and distances against plain Python, for any limits, state, costmap and plan."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from navstack.core import ControlError, Costmap, Footprint, GridGeometry, Path, Pose2D, RobotState, Twist2D, grid_record
from navstack.local_planner import DWBParams, DWBPlanner
from navstack.local_planner.dwb.generator import LIMITED_ACCEL, STANDARD, DWBGenerator
from navstack.local_planner.dwb.map_grid import cell_distances
from navstack.plugins import ControlInput, Inflation

pytestmark = pytest.mark.slow
SETTINGS = settings(deadline=None, max_examples=80)
SMALL = 1e-12
POSE = 1e-9
LIMIT = 1.2e-7


# --- the generator in plain Python ------------------------------------------------------------------------------------


def project(speed: float, target: float, faster: float, slower: float, seconds: float) -> float:
    if speed < target:
        return min(target, speed + faster * seconds)
    return max(target, speed + slower * seconds)


def values(speed: float, low: float, high: float, faster: float, slower: float, seconds: float, n: int) -> list[float]:
    speed = max(min(speed, high), low)
    top = project(speed, high, faster, slower, seconds)
    value = project(speed, low, faster, slower, seconds)
    if abs(top - value) < 1e-5:
        return [value]
    step, found, crossed = (top - value) / (max(2, n) - 1), list[float](), False
    while value <= top + 1e-5:
        found.append(value)
        if not crossed and value < 0.0 < value + step <= top + 1e-5:
            found.append(0.0)
            crossed = True
        value += step
    return found


def twists(p: DWBParams, state: RobotState, period: float) -> list[tuple[float, float, float]]:
    seconds = p.sim_time if p.trajectory_generator_name == STANDARD else (p.sim_period or period)
    v = state.velocity
    xs = values(v.vx, p.min_vel_x, p.max_vel_x, p.acc_lim_x, p.decel_lim_x, seconds, p.vx_samples)
    ys = values(v.vy, p.min_vel_y, p.max_vel_y, p.acc_lim_y, p.decel_lim_y, seconds, p.vy_samples)
    turn = p.max_vel_theta
    ws = values(v.wz, -turn, turn, p.acc_lim_theta, p.decel_lim_theta, seconds, p.vtheta_samples)
    found = list[tuple[float, float, float]]()
    for x in xs:
        for y in ys:
            for w in ws:
                squared = x * x + y * y
                if p.max_speed_xy >= 0.0 and squared > p.max_speed_xy**2 + 2.0**-23:
                    continue
                slow = p.min_speed_xy >= 0.0 and squared + 2.0**-23 < p.min_speed_xy**2
                if slow and p.min_speed_theta >= 0.0 and abs(w) + 2.0**-23 < p.min_speed_theta:
                    continue
                if squared or w:
                    found.append((x, y, w))
    return found


def trajectory(p: DWBParams, state: RobotState, twist: tuple[float, float, float]) -> list[list[float]]:
    tx, ty, tw = twist
    steps = math.ceil(p.sim_time / p.time_granularity)
    if not p.discretize_by_time:
        along = math.hypot(tx, ty) * p.sim_time / p.linear_granularity
        steps = math.ceil(max(along, abs(tw) * p.sim_time / p.angular_granularity))
    steps = max(1, steps)
    dt = p.sim_time / steps
    x, y, yaw = state.pose
    vx, vy, wz = state.velocity
    poses = [[x, y, yaw]]
    for _ in range(steps):
        if p.trajectory_generator_name == STANDARD:
            vx = project(vx, tx, p.acc_lim_x, p.decel_lim_x, dt)
            vy = project(vy, ty, p.acc_lim_y, p.decel_lim_y, dt)
            wz = project(wz, tw, p.acc_lim_theta, p.decel_lim_theta, dt)
        else:
            vx, vy, wz = twist
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, yaw = x + (vx * c - vy * s) * dt, y + (vx * s + vy * c) * dt, yaw + wz * dt
        poses.append([x, y, yaw])
    return poses + poses[-1:] if p.include_last_point else poses


speeds = st.floats(0.0, 1.5)
signed = st.floats(-1.5, 1.5)


@st.composite
def parameters(draw: st.DrawFn) -> DWBParams:
    drawn: dict[str, Any] = {
        "min_vel_x": -draw(speeds),
        "max_vel_x": draw(speeds),
        "min_vel_y": -draw(speeds),
        "max_vel_y": draw(speeds),
        "max_vel_theta": draw(speeds),
        "max_speed_xy": draw(st.sampled_from([-1.0, 0.0, 0.3, 2.0])),
        "min_speed_xy": draw(st.sampled_from([-1.0, 0.0, 0.1])),
        "min_speed_theta": draw(st.sampled_from([-1.0, 0.0, 0.4])),
        "vx_samples": draw(st.integers(1, 5)),
        "vy_samples": draw(st.integers(1, 4)),
        "vtheta_samples": draw(st.integers(1, 6)),
        "sim_time": draw(st.floats(0.1, 2.0)),
        "linear_granularity": draw(st.floats(0.02, 0.5)),
        "angular_granularity": draw(st.floats(0.02, 0.5)),
        "time_granularity": draw(st.floats(0.05, 0.5)),
        "discretize_by_time": draw(st.booleans()),
        "include_last_point": draw(st.booleans()),
        "trajectory_generator_name": draw(st.sampled_from([STANDARD, LIMITED_ACCEL])),
        "sim_period": draw(st.sampled_from([None, 0.3])),
    }
    for axis in ("x", "y", "theta"):
        drawn[f"acc_lim_{axis}"], drawn[f"decel_lim_{axis}"] = draw(speeds), -draw(speeds)
    return DWBParams(**drawn)


states = st.builds(
    RobotState,
    st.builds(Pose2D, signed, signed, st.floats(-3.1, 3.1)),
    st.builds(Twist2D, signed, signed, signed),
)


def at_a_limit(p: DWBParams, state: RobotState, period: float) -> bool:
    """True if rounding decides whether a sample is legal."""
    found = twists(p.model_copy(update={"max_speed_xy": -1.0, "min_speed_xy": -1.0}), state, period)
    limits = (p.max_speed_xy**2 + 2.0**-23, p.min_speed_xy**2 - 2.0**-23)
    return any(abs(x * x + y * y - limit) < SMALL for x, y, _ in found for limit in limits)


@SETTINGS
@given(parameters(), states)
def test_samples_and_trajectories_are_those_of_plain_python(p: DWBParams, state: RobotState) -> None:
    generator = DWBGenerator(p, 0.05)
    generator.set_limits(p.kinematics)
    for _ in range(2):  # the second cycle uses the buffers of the first
        samples, rollouts = generator.rollouts(state)
        wanted = twists(p, state, 0.05)
        if at_a_limit(p, state, 0.05):
            return
        assert len(samples) == len(wanted)
        np.testing.assert_allclose(samples, np.reshape(wanted, (-1, 3)), rtol=0, atol=SMALL)
        np.testing.assert_array_equal(rollouts.commands, samples)
        assert rollouts.seconds is not None
        for k in range(0, len(samples), max(1, len(samples) // 7)):
            poses = np.array(trajectory(p, state, tuple(samples[k].tolist())))
            found = rollouts.poses[k, : rollouts.counts[k]]
            assert found.shape == poses.shape
            np.testing.assert_allclose(found[:, :2], poses[:, :2], rtol=0, atol=POSE)
            np.testing.assert_allclose(np.exp(1j * found[:, 2]), np.exp(1j * poses[:, 2]), rtol=0, atol=POSE)
            assert (np.abs(found[:, 2]) <= math.pi).all()
            steps = len(poses) - 1 - p.include_last_point
            assert rollouts.seconds[k] == p.sim_time / steps


@SETTINGS
@given(parameters(), states)
def test_the_limited_command_is_the_first_step(p: DWBParams, state: RobotState) -> None:
    """With `limit_vel_cmd_in_traj`, the first step of a trajectory is the command."""
    p = p.model_copy(update={"limit_vel_cmd_in_traj": True})
    generator = DWBGenerator(p, 0.05)
    generator.set_limits(p.kinematics)
    _, rollouts = generator.rollouts(state)
    if not len(rollouts.counts):
        return
    assert rollouts.seconds is not None
    first, second = rollouts.poses[:, 0], rollouts.poses[:, 1]
    turned = (second[:, 2] - first[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    expected = rollouts.commands[:, 2] * rollouts.seconds
    np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j * expected), rtol=0, atol=POSE)
    moved = np.hypot(*(second - first)[:, :2].T)
    np.testing.assert_allclose(moved, np.hypot(*rollouts.commands[:, :2].T) * rollouts.seconds, rtol=0, atol=POSE)


# --- the map grid -----------------------------------------------------------------------------------------------------


def sources(costs: np.ndarray, geometry: GridGeometry, plan: np.ndarray) -> list[tuple[int, int]]:
    """The cells of the plan that count, in order."""
    g, points = geometry, list[tuple[float, float]]()
    for i, (x, y) in enumerate(plan[:, :2].tolist()):
        if i:
            x0, y0 = plan[i - 1, :2].tolist()
            length = math.sqrt((x - x0) ** 2 + (y - y0) ** 2)
            if length > 2.0 * g.resolution:
                n = int((length - 2.0 * g.resolution) / g.resolution) - 1
                points += [(x0 + j * (x - x0) / n, y0 + j * (y - y0) / n) for j in range(1, n)]
        points.append((x, y))
    found = list[tuple[int, int]]()
    for x, y in points:
        cell = g.world_to_cell(x, y)
        if cell is not None and costs[cell[1], cell[0]] != 255:
            found.append(cell)
        elif found:
            break
    return found


@SETTINGS
@given(
    st.integers(1, 12),
    st.integers(1, 12),
    st.lists(st.tuples(st.integers(-10, 160), st.integers(-10, 160)), max_size=8),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
@example(1, 1, [(0, 0)], 0, False)
def test_distances_are_those_to_the_nearest_source(
    nx: int, ny: int, points: list[tuple[int, int]], seed: int, to_last: bool
) -> None:
    """The brute force: Manhattan distance to the nearest cell of the plan, through obstacles."""
    rng = np.random.default_rng(seed)
    geometry = GridGeometry(nx, ny, 0.1, -0.05, 0.02)
    costs = rng.choice(np.array([0, 254, 255], np.uint8), (ny, nx), p=[0.6, 0.2, 0.2])
    # off the borders of cells, where rounding decides
    plan = np.array([(0.0113 + 0.01 * x, 0.0113 + 0.01 * y, 0.0) for x, y in points]).reshape(-1, 3)
    found = np.empty(nx * ny, np.int32)
    count = cell_distances(costs, grid_record(geometry), plan, to_last, found)
    cells = sources(costs, geometry, plan)
    assert count == len(cells)
    iy, ix = np.indices((ny, nx))
    wanted = np.full((ny, nx), nx * ny + 1)
    if cells:
        used = cells[-1:] if to_last else cells
        wanted = np.min([np.abs(ix - x) + np.abs(iy - y) for x, y in used], axis=0)
    np.testing.assert_array_equal(found.reshape(ny, nx), wanted)


# --- the planner ------------------------------------------------------------------------------------------------------

FOOTPRINTS = [
    Footprint.from_radius(0.18, 0.01),
    Footprint(np.array([[0.3, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.3, -0.2]])),
]


@SETTINGS
@given(parameters(), states, st.integers(0, 2**32 - 1), st.sampled_from(FOOTPRINTS), st.booleans(), st.booleans())
def test_any_cycle_gives_a_legal_command_or_a_control_error(
    p: DWBParams, state: RobotState, seed: int, footprint: Footprint, inflated: bool, sums: bool
) -> None:
    """For random costs and plans; the diagnostics explain every sample."""
    rng = np.random.default_rng(seed)
    listed = ["RotateToGoal", "Oscillation", "BaseObstacle", "GoalAlign", "PathAlign", "PathDist", "GoalDist"]
    listed += ["PreferForward", "Twirling", *(["ObstacleFootprint"] if seed % 2 else [])]
    kinds = DWBParams.child_models({})
    aggregated = {n: kinds[n](aggregation_type=("sum", "product")[seed % 2]) for n in ("PathDist", "GoalAlign")}
    planner = DWBPlanner(p.model_copy(update={"critics": listed, "sections": aggregated if sums else {}}))
    nx, ny = (int(n) for n in rng.integers(5, 60, 2))
    geometry = GridGeometry(nx, ny, 0.1, float(-0.05 * nx + rng.normal()), float(-0.05 * ny + rng.normal()))
    costs = rng.choice(np.array([0, 60, 253, 254, 255], np.uint8), (ny, nx), p=[0.9, 0.06, 0.01, 0.02, 0.01])
    plan = np.cumsum(rng.normal(0.0, 0.1, (int(rng.integers(1, 30)), 3)), axis=0) + (state.pose.x, state.pose.y, 0.0)
    planner.set_plan(Path(plan, "map"), Pose2D(*plan[-1].tolist()))
    inflation = Inflation(0.18, 0.5, 3.0) if inflated else None
    inputs = ControlInput(state, Costmap(geometry, costs), footprint, inflation=inflation)
    try:
        local = planner.compute_command(inputs)
    except ControlError as exc:
        assert exc.message
        details = planner.diagnostics()
        assert details is None or all(by is not None for by, _ in details.samples)
        return
    if local.mode == "arrived":
        return
    details = planner.diagnostics()
    assert details is not None and local.samples is not None and local.totals is not None
    for by, detail in details.samples:
        assert by is None or detail.reason
    limits = planner.limits
    low, high = min(limits.min_vel_x, limits.max_vel_x), limits.max_vel_x
    assert low - 1.1e-5 <= local.command.vx <= high + 1.1e-5
    assert abs(local.command.wz) <= limits.max_vel_theta + 1.1e-5
    assert local.command.speed <= math.sqrt(limits.max_vel_trans**2 + LIMIT) + 1.1e-5
