"""Critics and scoring of velocity sequences, as MPPI samples them, for several motion models (examples/velocity_sequences)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from velocity_sequences import DIFFERENTIAL, OMNIDIRECTIONAL, MotionModel, ackermann, simulate_sequences

from navstack.core import LETHAL, Costmap, Footprint, GridGeometry, InputError, Pose2D, RobotState, Twist2D
from navstack.core.footprint_kernels import lethal_under
from navstack.local_planner.dwa import DWAParams, DWAPlanner
from navstack.local_planner.scoring import score
from navstack.local_planner.trajectory_rollout.escape import perimeter_cost
from navstack.plugins import ScoringContext

FOOTPRINT = Footprint.from_radius(0.18)
STATE = RobotState(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.0))
PLANNER = DWAPlanner(DWAParams(controller_frequency=20.0, twirling_scale=0.1))
LINE = np.column_stack((np.linspace(0.0, 1.6, 40), np.zeros(40), np.zeros(40)))


def scene() -> Costmap:
    costmap = Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0), frame="odom")
    costmap.data[44:60, 52] = LETHAL
    costmap.data[20:60, 50:55] = np.maximum(costmap.data[20:60, 50:55], 90)
    return costmap


def context(costmap: Costmap) -> ScoringContext:
    return ScoringContext(STATE, costmap, FOOTPRINT, LINE, Pose2D(1.6, 0.0, 0.0), PLANNER.limits)


def noise(k: int, t: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(3)
    return np.array([0.3, 0.0, 0.0]) + rng.normal(0.0, 1.0, (k, t, 3)) * (0.2, 0.1, 0.4)


@pytest.mark.parametrize("model", [DIFFERENTIAL, OMNIDIRECTIONAL, ackermann(0.6)])
def test_scores_as_many_sequences_as_mppi_samples(model: MotionModel) -> None:
    costmap = scene()
    driven, rollouts = simulate_sequences(noise(2000, 56), STATE, PLANNER.limits, 0.05, model)
    assert rollouts.poses.shape == (2000, 56, 3) and rollouts.counts.tolist() == [56] * 2000
    table = score(PLANNER.critics, context(costmap), rollouts)
    legal = table.rejected_by == -1
    assert 0 < legal.sum() < 2000 and legal[table.best] and np.isfinite(table.totals).all()
    np.testing.assert_allclose(table.totals[legal], (table.costs[legal] * table.scales).sum(axis=1), rtol=1e-12)
    # the obstacle critic, pose by pose
    g = costmap.geometry
    obstacle = [c.name for c in PLANNER.critics].index("obstacle")
    for k in range(0, 2000, 40):
        scale = 1.0
        speed = float(np.hypot(*rollouts.commands[k, :2]))
        if speed > 0.25:
            scale = 0.2 * ((speed - 0.25) / (PLANNER.limits.max_vel_trans - 0.25)) + 1.0
        costs = [
            perimeter_cost(
                costmap.data, g.origin_x, g.origin_y, g.resolution, FOOTPRINT.vertices, *pose.tolist(), scale
            )
            for pose in rollouts.poses[k]
        ]
        # the critic also counts lethal cells that the edges enclose
        under = [
            lethal_under(costmap.data, g.origin_x, g.origin_y, g.resolution, scale * FOOTPRINT.vertices, *pose.tolist())
            for pose in rollouts.poses[k]
        ]
        expected = -6.0 if min(costs) < 0 or any(under) else max(costs)
        if expected >= 0.0:
            expected = max(expected, max(costmap.cost_at(x, y) or 0 for x, y in rollouts.poses[k, :, :2].tolist()))
        assert table.costs[k, obstacle] == expected
    assert np.array_equal(rollouts.commands, driven[:, 0])


def test_velocities_become_drivable() -> None:
    limits, before = PLANNER.limits, np.array(STATE.velocity)
    acceleration = np.array((limits.acc_lim_x, limits.acc_lim_y, limits.acc_lim_theta))
    driven, _ = simulate_sequences(20.0 * noise(50, 30), STATE, limits, 0.05, OMNIDIRECTIONAL)
    steps = np.diff(np.concatenate((np.broadcast_to(before, (50, 1, 3)), driven), axis=1), axis=1)
    assert (np.abs(steps) <= acceleration * 0.05 + 1e-12).all()
    assert driven[:, :, 0].max() == limits.max_vel_x and driven[:, :, 0].min() == limits.min_vel_x
    assert np.abs(driven[:, :, 2]).max() == limits.max_vel_theta
    straight, rollouts = simulate_sequences(20.0 * noise(50, 30), STATE, limits, 0.05, DIFFERENTIAL)
    assert not straight[:, :, 1].any() and not rollouts.commands[:, 1].any()


def test_a_car_does_not_turn_in_place() -> None:
    spin = np.zeros((1, 40, 3))
    spin[:, :, 2] = 1.0
    turned, _ = simulate_sequences(spin, STATE, PLANNER.limits, 0.05, ackermann(0.5))
    assert turned[0, -1].tolist() == [0.0, 0.0, 0.0]
    driven, rollouts = simulate_sequences(noise(200, 40), STATE, PLANNER.limits, 0.05, ackermann(0.5))
    assert (np.abs(driven[:, :, 2]) * 0.5 <= np.hypot(driven[:, :, 0], driven[:, :, 1]) + 1e-12).all()
    moved = np.hypot(*np.diff(rollouts.poses[:, :, :2], axis=1).transpose(2, 0, 1))
    assert (np.abs(np.diff(rollouts.poses[:, :, 2], axis=1)) <= moved / 0.5 + 1e-12).all()


def test_a_constant_velocity_gives_the_rollout_of_dwa() -> None:
    """The same points as DWA's rollout of a sample, to its float32 precision."""
    planner = DWAPlanner(DWAParams(vx_samples=4, vth_samples=5, min_vel_y=0.0, max_vel_y=0.0, sim_time=1.0))
    plan = planner.search(STATE, scene(), FOOTPRINT, LINE, Pose2D(1.6, 0.0, 0.0))
    last = planner.diagnostics()
    assert last is not None
    for k in np.flatnonzero(plan.rejected_by == -1):
        n = int(last.rollouts.counts[k])
        held = np.repeat(plan.samples[k][None, None], n, axis=1)
        limits = planner.limits._replace(acc_lim_x=1e9, acc_lim_theta=1e9)
        _, rollouts = simulate_sequences(held, STATE, limits, 1.0 / n)
        np.testing.assert_allclose(rollouts.poses[0], last.rollouts.poses[k, :n], atol=2e-6)


def test_rejects_invalid_sequences() -> None:
    for wrong in (np.zeros((3, 4)), np.zeros((3, 4, 2)), np.zeros((0, 4, 3)), np.full((1, 2, 3), math.nan)):
        with pytest.raises(InputError, match="velocities must be"):
            simulate_sequences(wrong, STATE, PLANNER.limits, 0.05)
    with pytest.raises(InputError, match="period"):
        simulate_sequences(noise(1, 2), STATE, PLANNER.limits, 0.0)
    with pytest.raises(InputError, match="min_turning_radius"):
        ackermann(-1.0)
    with pytest.raises(InputError, match="too many"):
        simulate_sequences(np.broadcast_to(np.zeros(3), (100000, 1000, 3)), STATE, PLANNER.limits, 0.05)
