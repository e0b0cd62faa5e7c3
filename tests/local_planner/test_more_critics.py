"""The critics of Nav2, and parameters that critics inherit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, Path, Pose2D, RobotState, Twist2D
from navstack.local_planner.critics import BaseObstacleCritic, PreferForwardCritic, RotateToGoalCritic
from navstack.local_planner.critics.base_obstacle import BaseObstacleParams
from navstack.local_planner.critics.obstacle import nearest_collision, travelled
from navstack.local_planner.critics.prefer_forward import PreferForwardParams
from navstack.local_planner.critics.rotate_to_goal import RotateToGoalParams
from navstack.local_planner.dwa import DWAParams, DWAPlanner, make_critics
from navstack.plugins import CRITICS, ControlInput, Rollouts, ScoringContext

GEOMETRY = GridGeometry(40, 40, 0.05, -1.0, -1.0)
FOOTPRINT = Footprint.from_radius(0.1)


def context(velocity: Twist2D = Twist2D(), goal: Pose2D = Pose2D(0.1, 0.0, 1.0), **costs: int) -> ScoringContext:
    costmap = Costmap(GEOMETRY, frame="odom")
    for cell, cost in costs.items():
        ix, iy = (int(v) for v in cell[1:].split("_"))
        costmap.data[iy, ix] = cost
    limits = DWAPlanner(DWAParams()).limits
    return ScoringContext(RobotState(Pose2D(0.0, 0.0), velocity), costmap, FOOTPRINT, np.zeros((1, 3)), goal, limits)


def straight(*samples: tuple[float, float, float], seconds: float = 1.0, points: int = 11) -> Rollouts:
    """Rollouts along straight lines, for critics that use cells and headings only."""
    array = np.array(samples)
    times = np.linspace(0.0, seconds, points)
    poses = array[:, None, :] * times[None, :, None]
    return Rollouts(array, np.ascontiguousarray(poses), np.full(len(array), points, np.int64))


def scored(critic: Any, rollouts: Rollouts, at: ScoringContext) -> NDArray[np.float64]:
    critic.prepare(at)
    out = critic.score(rollouts)
    assert out.dtype == np.float64 and out.shape == rollouts.counts.shape
    return out


def test_prefer_forward() -> None:
    critic = PreferForwardCritic("prefer_forward", PreferForwardParams(penalty=3.0))
    samples = ((-0.2, 0.0, 0.5), (0.05, 0.0, 0.1), (0.05, 0.0, -0.3), (0.5, 0.0, 0.0), (0.5, 0.0, -0.4))
    assert scored(critic, straight(*samples), context()) == pytest.approx([3.0, 3.0, 3.0, 0.0, 4.0])


@pytest.mark.parametrize(("sums", "expected"), [(False, 7.0), (True, 10.0 + 7.0)])
def test_base_obstacle_scores_the_center_only(sums: bool, expected: float) -> None:
    critic = BaseObstacleCritic("base_obstacle", BaseObstacleParams(sum_scores=sums))
    # points 0.05 m apart, moved to the centers of cells
    rollouts = straight((0.5, 0.0, 0.0))
    rollouts.poses[:, :, :2] += 0.025
    assert scored(critic, rollouts, context(c25_20=10, c30_20=7, c25_21=254)) == pytest.approx([expected])


@pytest.mark.parametrize("cost", [253, 254, 255])
def test_base_obstacle_reports_the_first_rejection_along_the_rollout(cost: int) -> None:
    critic = BaseObstacleCritic("base_obstacle", BaseObstacleParams())
    ahead = straight((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (3.0, 0.0, 0.0), (-3.0, 0.0, 0.0))
    ahead.poses[:, :, :2] += 0.025
    costs = dict.fromkeys(("c25_20", "c26_20"), cost)
    # the third rollout skips the first of the two cells, hits the second, and leaves the map later
    assert scored(critic, ahead, context(**costs)).tolist() == [-6.0, 0.0, -6.0, -4.0]
    assert set(critic.CODES) == {-6, -4}


def test_skips_rejected_and_empty_rows() -> None:
    critic = BaseObstacleCritic("base_obstacle", BaseObstacleParams())
    critic.prepare(context())
    rollouts = straight((9.0, 0.0, 0.0), (0.1, 0.0, 0.0))
    rollouts.counts[0] = 0
    rollouts.alive[0] = False
    rollouts.poses[0] = np.nan
    out = critic.score(rollouts)
    assert out[1] == 0.0


def test_rotate_to_goal_is_zero_far_from_the_goal() -> None:
    critic = RotateToGoalCritic("rotate_to_goal", RotateToGoalParams())
    assert scored(critic, straight((0.5, 0.0, 1.0)), context(goal=Pose2D(0.3, 0.0))).tolist() == [0.0]


def test_rotate_to_goal_slows_down_first() -> None:
    critic = RotateToGoalCritic("rotate_to_goal", RotateToGoalParams(slowing_factor=5.0))
    samples = ((0.5, 0.0, 0.0), (0.3, 0.0, 1.0), (0.4, 0.0, 0.0), (0.39, 0.0, 0.0))
    out = scored(critic, straight(*samples), context(Twist2D(0.4, 0.0, 0.0)))
    assert out == pytest.approx([-7.0, 5.0 * 0.09 + 0.0, -7.0, 5.0 * 0.39**2 + 1.0])


def test_rotate_to_goal_keeps_its_phase_until_the_next_plan() -> None:
    """Neither leaving the tolerance nor a higher speed ends the phase; a reset does."""
    critic = RotateToGoalCritic("rotate_to_goal", RotateToGoalParams(xy_goal_tolerance=0.15))
    ahead = straight((0.2, 0.0, 0.0))
    assert scored(critic, ahead, context()).tolist() == [-8.0]
    pushed = context(Twist2D(0.5, 0.0, 0.0))
    away = ScoringContext(
        RobotState(Pose2D(-0.3, 0.0), Twist2D(0.5, 0.0, 0.0)),
        pushed.costmap,
        FOOTPRINT,
        pushed.plan,
        pushed.goal,
        pushed.limits,
    )
    assert scored(critic, ahead, away).tolist() == [-8.0]
    critic.reset()
    assert scored(critic, ahead, away).tolist() == [0.0]


def test_rotate_to_goal_waits_for_the_end_of_the_path() -> None:
    """A path that passes its goal and comes back to it is driven to its end."""
    critic = RotateToGoalCritic("rotate_to_goal", RotateToGoalParams())
    at = context()
    at.plan = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.1, 0.0, 1.0]])
    assert scored(critic, straight((0.2, 0.0, 0.0)), at).tolist() == [0.0]
    at.plan = at.plan[1:]
    assert scored(critic, straight((0.2, 0.0, 0.0)), at).tolist() == [-8.0]


def test_rotate_to_goal_then_only_turns() -> None:
    critic = RotateToGoalCritic("rotate_to_goal", RotateToGoalParams())
    samples = ((0.1, 0.0, 1.0), (0.0, 0.0, 1.5), (0.0, 0.0, -1.0), (0.0, 0.1, 0.0))
    assert scored(critic, straight(*samples), context()) == pytest.approx([-8.0, 0.5, 2.0, -8.0])
    around = scored(critic, straight((0.0, 0.0, -1.0)), context(goal=Pose2D(0.0, 0.0, math.pi)))
    assert around == pytest.approx([math.pi - 1.0])


def test_rotate_to_goal_with_lookahead_time() -> None:
    critic = RotateToGoalCritic("rotate_to_goal", RotateToGoalParams(lookahead_time=0.5))
    assert scored(critic, straight((0.0, 0.0, 1.0), (0.0, 0.0, 2.0)), context()) == pytest.approx([0.5, 0.0])


def test_names_of_nav2_are_known() -> None:
    for name, cls in (
        ("dwb_critics::RotateToGoalCritic", RotateToGoalCritic),
        ("PreferForward", PreferForwardCritic),
        ("BaseObstacle", BaseObstacleCritic),
    ):
        assert CRITICS.get(name).cls is cls


def rotate_to_goal_of(**planner: Any) -> RotateToGoalParams:
    """Parameters of a listed rotate_to_goal critic under DWA."""
    listed: Any = [{"name": "turn", "type": "rotate_to_goal"}]
    return make_critics(DWAParams(critics=listed, **planner))[0].params


def test_a_critic_inherits_only_parameters_that_were_set() -> None:
    """DWA's default xy_goal_tolerance is 0.1, that of the critic 0.25."""
    assert DWAParams().xy_goal_tolerance == 0.1
    defaults = rotate_to_goal_of()
    assert (defaults.xy_goal_tolerance, defaults.trans_stopped_velocity) == (0.25, 0.25)
    inherited = rotate_to_goal_of(xy_goal_tolerance=0.15)
    assert (inherited.xy_goal_tolerance, inherited.trans_stopped_velocity) == (0.15, 0.25)
    own = rotate_to_goal_of(xy_goal_tolerance=0.15, critic_params={"turn": RotateToGoalParams(xy_goal_tolerance=0.2)})
    assert own.xy_goal_tolerance == 0.2


def test_drives_with_critics_of_ros_1_and_nav2() -> None:
    """The robot reaches its goal; the table has a column for each critic."""
    kinds = ("base_obstacle", "path", "goal", "goal_front", "alignment", "prefer_forward", "rotate_to_goal")
    planner = DWAPlanner(
        DWAParams(
            critics=[{"name": kind, "type": kind} for kind in kinds],  # pyright: ignore[reportArgumentType]
            critic_params={
                "rotate_to_goal": RotateToGoalParams(xy_goal_tolerance=0.1),
                "base_obstacle": BaseObstacleParams(scale=0.02),
            },
            min_vel_y=0.0,
            max_vel_y=0.0,
        )
    )
    goal = Pose2D(0.6, 0.2, 0.0)
    line = np.column_stack((np.linspace(0.0, goal.x, 20), np.linspace(0.0, goal.y, 20), np.zeros(20)))
    planner.set_plan(Path(line, "odom"), goal)
    pose, velocity, costmap = Pose2D(0.0, 0.0, 0.3), Twist2D(), Costmap(GEOMETRY, frame="odom")
    for _ in range(400):
        inputs = ControlInput(RobotState(pose, velocity), costmap, FOOTPRINT)
        plan = planner.compute_command(inputs)
        assert plan.critics == kinds
        if planner.goal_reached(inputs):
            return
        velocity = plan.command
        yaw = pose.yaw + 0.025 * velocity.wz
        pose = Pose2D(
            pose.x + 0.05 * velocity.vx * math.cos(yaw),
            pose.y + 0.05 * velocity.vx * math.sin(yaw),
            math.remainder(pose.yaw + 0.05 * velocity.wz, 2.0 * math.pi),
        )
    raise AssertionError(f"not reached: {pose}")


@pytest.mark.parametrize("seed", range(10))
def test_the_nearest_collision_is_that_of_the_shortest_way(seed: int) -> None:
    """Equal to measuring every row; rows without a collision, and points behind the last one, do not count."""
    rng = np.random.default_rng(seed)
    poses = np.cumsum(rng.normal(0.0, 0.1, (30, 12, 3)), axis=1)
    steps = rng.integers(-1, 12, 30)
    for row, step in enumerate(steps.tolist()):
        poses[row, step + 1 :] = np.nan if step >= 0 else np.inf
    rollouts = Rollouts(np.zeros((30, 3)), poses, np.maximum(steps + 1, 1))
    rows = np.flatnonzero(rng.random(30) < 0.7)
    found = nearest_collision(rollouts, rows, steps[rows])
    colliding = [row for row in rows.tolist() if steps[row] >= 0]
    assert found in colliding
    shortest = min(travelled(rollouts, row, int(steps[row])) for row in colliding)
    assert travelled(rollouts, found, int(steps[found])) == pytest.approx(shortest, abs=1e-12)
    assert nearest_collision(rollouts, rows, np.full(len(rows), -1)) == rows[0]
