"""Escapes and full turns of TrajectoryPlanner, where C++ turns or moves back and forth forever."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

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
from navstack.plugins import ControlInput, LocalPlan

BOX = Footprint(np.array([[-0.2, -0.15], [0.2, -0.15], [0.2, 0.15], [-0.2, 0.15]]))
GOAL = Pose2D(2.0, 0.0)


def planner(**more: Any) -> TrajectoryPlanner:
    values = {"holonomic_robot": False, "dwa": True, "acc_lim_x": 10.0, "acc_lim_theta": 20.0, "min_vel_x": 0.1, **more}
    made = TrajectoryPlanner(TrajectoryPlannerParams(**values))
    line = np.column_stack((np.linspace(0.0, GOAL.x, 41), np.zeros(41), np.zeros(41)))
    made.set_plan(Path(line, "odom"), GOAL)
    return made


def costmap(*lethal: tuple[float, float]) -> Costmap:
    made = Costmap(GridGeometry(120, 120, 0.05, -3.0, -3.0), frame="odom")
    for x, y in lethal:
        cell = made.geometry.world_to_cell(x, y)
        assert cell is not None
        made.data[cell[1], cell[0]] = LETHAL
    return made


def at(pose: Pose2D, grid: Costmap, velocity: Twist2D = Twist2D()) -> ControlInput:
    return ControlInput(RobotState(pose, velocity), grid, BOX)


def driven(pose: Pose2D, plan: LocalPlan) -> Pose2D:
    v, w = plan.command.vx, plan.command.wz
    yaw = pose.yaw + 0.025 * w
    x, y = pose.x + 0.05 * v * math.cos(yaw), pose.y + 0.05 * v * math.sin(yaw)
    return Pose2D(x, y, math.remainder(pose.yaw + 0.05 * w, 2.0 * math.pi))


def test_backs_away_from_a_wall_inside_the_padding() -> None:
    """The padding overlaps lethal cells ahead: every sample is rejected, but backing up comes no nearer to an obstacle."""
    wall = [(0.19, y) for y in np.arange(-0.5, 0.5, 0.04)]
    plan = planner(escape_vel=-0.3).compute_command(at(Pose2D(0.0, 0.0), costmap(*wall)))
    assert plan.mode == "escape" and plan.command == Twist2D(-0.3, 0.0, 0.0)
    assert plan.rejected_by is not None and plan.rejected_by[plan.best] >= 0  # it remains marked as rejected
    assert plan.trajectory is not None and -0.3 < plan.trajectory[-1, 0] < -0.1  # only the checked part


def test_backs_off_what_the_footprint_encloses() -> None:
    """A mark under the robot rejects every sample; it must not keep the robot from leaving it."""
    grid = costmap((-0.08, 0.02))
    plan = planner(escape_vel=-0.3).compute_command(at(Pose2D(0.0, 0.0), grid))
    assert plan.mode == "escape" and plan.command == Twist2D(-0.3, 0.0, 0.0)


@pytest.mark.parametrize("behind", [-0.19, -0.27])
def test_does_not_back_into_an_obstacle(behind: float) -> None:
    wall = [(x, y) for x in (0.19, behind) for y in np.arange(-0.5, 0.5, 0.04)]
    with pytest.raises(NoValidControlError, match="lethal"):
        planner(escape_vel=-0.3).compute_command(at(Pose2D(0.0, 0.0), costmap(*wall)))


@pytest.mark.slow
def test_escapes_from_the_same_place_lead_farther() -> None:
    """In a narrow dead end each escape leads farther back, up to the reach of the rollouts."""
    tunnel = [(x, y) for y in (-0.225, 0.225) for x in np.arange(-2.5, 0.8, 0.04)]
    end = [(0.6, y) for y in np.arange(-0.3, 0.3, 0.04)]
    grid, robot = costmap(*tunnel, *end), planner(escape_vel=-0.5, max_vel_x=0.5, sim_time=1.0)
    pose, velocity, escaping = Pose2D(0.3, 0.0), Twist2D(), False
    began, lengths = pose, list[float]()
    for _ in range(400):
        try:
            plan = robot.compute_command(at(pose, grid, velocity))
        except NoValidControlError:
            velocity = Twist2D()
            continue
        if (plan.mode == "escape") is not escaping:
            if escaping:
                lengths.append(began.distance_to(pose))
            began, escaping = pose, not escaping
        velocity, pose = plan.command, driven(pose, plan)
        assert pose.x < 0.4
    assert len(lengths) >= 3
    assert lengths[0] == pytest.approx(0.1, abs=0.06)
    assert lengths[1] == pytest.approx(0.2, abs=0.06)
    assert max(lengths) <= 0.6


@pytest.mark.slow
def test_drives_on_after_one_full_turn_in_place() -> None:
    """A gate that costs more than its gain: C++ turns in front of it forever; here the robot passes it after a full turn."""
    grid = costmap()
    for (ix, iy), _ in np.ndenumerate(grid.data.T):
        x, y = grid.geometry.cell_to_world(ix, iy)
        if 0.55 < x < 0.9:
            grid.data[iy, ix] = 250 if abs(y) < 0.3 else LETHAL
    robot = planner(occdist_scale=0.1, meter_scoring=True, max_vel_x=0.5, sim_time=1.0)
    pose, velocity, turned = Pose2D(0.0, 0.0, 0.0), Twist2D(), 0.0
    for _ in range(1200):
        plan = robot.compute_command(at(pose, grid, velocity))
        if plan.command.vx == 0.0:
            turned += abs(plan.command.wz) * 0.05
        velocity, pose = plan.command, driven(pose, plan)
        if pose.x > 1.0:
            break
    assert pose.x > 1.0
    assert 2.0 * math.pi < turned < 6.0 * math.pi


def test_mirrored_scenes_give_mirrored_tables() -> None:
    """Each sample costs the same as its mirror image in the mirrored scene.

    Except on the borders of cells, and because the footprint's edges are rasterized in one sense of rotation.
    """
    rng = np.random.default_rng(5)
    pairs = equal = same_verdict = 0
    for _ in range(25):
        spots = rng.uniform((-0.2, -1.0), (1.6, 1.0), (12, 2))
        spots = spots[np.hypot(*spots.T) > 0.5]
        cells = (np.floor(spots / 0.05) + 0.5) * 0.05
        yaw = float(rng.uniform(-0.8, 0.8))
        tables: list[dict[tuple[float, float], tuple[int, list[float]]]] = []
        for side in (1.0, -1.0):
            grid = costmap(*(cells * (1.0, side)).tolist())
            robot = planner(vtheta_samples=21, max_vel_x=0.5, escape_vel=0.0)
            line = np.column_stack((np.linspace(0.0, GOAL.x, 41), np.full(41, side * 0.013), np.zeros(41)))
            robot.set_plan(Path(line, "odom"), Pose2D(GOAL.x, side * 0.013))
            try:
                plan = robot.compute_command(at(Pose2D(0.0, side * 0.007, side * yaw), grid))
            except NoValidControlError as exc:
                plan = exc.data["plan"]
            assert plan.samples is not None and plan.costs is not None and plan.rejected_by is not None
            tables.append(
                {
                    (round(vx, 6), round(side * wz, 6) + 0.0): (int(by), costs)
                    for (vx, _, wz), by, costs in zip(
                        plan.samples.tolist(), plan.rejected_by.tolist(), plan.costs.tolist(), strict=True
                    )
                }
            )
        for key in tables[0].keys() & tables[1].keys():
            (by, costs), (other_by, other_costs) = tables[0][key], tables[1][key]
            pairs += 1
            same_verdict += by == other_by
            equal += by == other_by and (by != -1 or costs == other_costs)
    assert pairs > 5000
    assert same_verdict >= 0.97 * pairs
    assert equal >= 0.95 * pairs


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 0.3, -0.3])
def test_a_straight_corridor_gives_a_straight_path(heading: float) -> None:
    """Once on the plan, the robot stays within half a cell of it (two if it starts at an angle: within two cells of the plan
    the sum of path and goal distances is the same) and rarely changes its turning direction."""
    walls = [(x, y) for y in (-0.475, 0.475) for x in np.arange(-1.0, 2.6, 0.04)]
    grid, robot = costmap(*walls), planner(meter_scoring=True, max_vel_x=0.5)
    pose, velocity = Pose2D(0.0, 0.0, heading), Twist2D()
    off, turns = list[float](), list[float]()
    for _ in range(200):
        inputs = at(pose, grid, velocity)
        plan = robot.compute_command(inputs)
        if plan.mode != "follow":
            break
        velocity, pose = plan.command, driven(pose, plan)
        if pose.x > 0.8:
            off.append(abs(pose.y))
            turns.append(velocity.wz)
    assert pose.x > GOAL.x - 0.2
    assert max(off) <= (0.026 if heading == 0.0 else 0.1)
    changes = sum(a * b < 0.0 for a, b in pairwise(turns))
    assert changes <= 6


def test_an_escape_may_not_overlap_more_than_where_it_began() -> None:
    """A scale of the footprint chosen anew in each cycle let the robot creep into a wall beside its way."""

    large = Footprint(2.0 * BOX.vertices)

    def with_wall(robot: TrajectoryPlanner, *lethal: tuple[float, float]) -> str:
        inputs = ControlInput(RobotState(Pose2D(0.0, 0.0), Twist2D()), costmap(*lethal), large)
        return robot.compute_command(inputs).mode

    slightly, deeply = ([(x, y) for y in np.arange(-0.5, 0.5, 0.04)] for x in (0.37, 0.32))
    robot = planner(escape_vel=-0.3)
    assert with_wall(robot, *slightly) == "escape"
    with pytest.raises(NoValidControlError, match="lethal"):
        with_wall(robot, *deeply)
    # a robot that overlaps it from the start may leave, and so may one that was free in between
    assert with_wall(planner(escape_vel=-0.3), *deeply) == "escape"
    while with_wall(robot) == "escape":
        pass
    assert with_wall(robot, *deeply) == "escape"
