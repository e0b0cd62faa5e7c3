"""A robot whose footprint overlaps lethal cells at rest leaves them, and never comes nearer to one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

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
from navstack.local_planner.dwa import DWAParams, DWAPlanner
from navstack.plugins import ControlInput

BOX = Footprint(np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]]), 0.01)
L_SHAPE = Footprint(np.array([[-0.2, -0.2], [0.5, -0.2], [0.5, 0.0], [0.15, 0.0], [0.15, 0.3], [-0.2, 0.3]]), 0.01)
DISC = Footprint.from_radius(0.2, 0.01)
PERIOD = 0.1


def planner(goal: Pose2D, **more: Any) -> DWAPlanner:
    values = {
        "controller_frequency": 1.0 / PERIOD,
        "max_vel_x": 0.5,
        "min_vel_x": 0.0,
        "max_vel_y": 0.0,
        "min_vel_y": 0.0,
        "max_vel_trans": 0.5,
        "min_vel_trans": 0.05,
        "max_vel_theta": 1.0,
        "min_vel_theta": 0.2,
        "acc_lim_x": 2.5,
        "acc_lim_theta": 3.0,
        "vy_samples": 1,
        "sim_granularity": 0.005,
        "angular_sim_granularity": 0.01,
        **more,
    }
    made = DWAPlanner(DWAParams(**values))
    steps = np.linspace(0.0, 1.0, 41)
    made.set_plan(Path(np.column_stack((goal.x * steps, goal.y * steps, np.zeros(41))), "odom"), goal)
    return made


def costmap(*lethal: tuple[float, float]) -> Costmap:
    made = Costmap(GridGeometry(100, 100, 0.05, -2.5, -2.5), frame="odom")
    for x, y in lethal:
        cell = made.geometry.world_to_cell(x, y)
        assert cell is not None
        made.data[cell[1], cell[0]] = LETHAL
    return made


def lethal_squares(grid: Costmap) -> list[shapely.Polygon]:
    r = grid.geometry.resolution
    centers = [grid.geometry.cell_to_world(ix, iy) for iy, ix in np.argwhere(grid.data == LETHAL).tolist()]
    return [shapely.box(x - 0.5 * r, y - 0.5 * r, x + 0.5 * r, y + 0.5 * r) for x, y in centers]


def overlapped(grid: Costmap, footprint: Footprint, pose: Pose2D) -> set[int]:
    body = shapely.Polygon(footprint.at(pose))
    return {i for i, square in enumerate(lethal_squares(grid)) if body.intersection(square).area > 1e-9}


def moved(pose: Pose2D, command: Twist2D) -> Pose2D:
    yaw = pose.yaw + 0.5 * PERIOD * command.wz
    x, y = pose.x + PERIOD * command.vx * math.cos(yaw), pose.y + PERIOD * command.vx * math.sin(yaw)
    return Pose2D(x, y, math.remainder(pose.yaw + PERIOD * command.wz, 2.0 * math.pi))


def drive(made: DWAPlanner, grid: Costmap, footprint: Footprint, cycles: int) -> list[Pose2D]:
    """Poses from the origin, at rest, until the footprint is free; a cycle without a legal sample stops the robot."""
    pose, velocity = Pose2D(0.0, 0.0), Twist2D()
    poses = [pose]
    for _ in range(cycles):
        try:
            velocity = made.compute_command(ControlInput(RobotState(pose, velocity), grid, footprint)).command
        except NoValidControlError:
            velocity = Twist2D()
        pose = moved(pose, velocity)
        poses.append(pose)
        if not overlapped(grid, footprint, pose):
            break
    return poses


def test_backs_away_from_a_mark_under_its_front() -> None:
    grid = costmap((0.29, 0.0))
    assert overlapped(grid, BOX, Pose2D(0.0, 0.0))
    made = planner(Pose2D(2.0, 0.0), min_vel_x=-0.2)
    plan = made.compute_command(ControlInput(RobotState(Pose2D(0.0, 0.0), Twist2D()), grid, BOX))
    assert plan.mode == "escape" and plan.command.vx < 0.0
    assert plan.notes[-1] == (
        "the footprint overlaps an obstacle cell at (0.28, 0.03): only samples that come no nearer are legal"
    )
    poses = drive(made, grid, BOX, 20)
    assert not overlapped(grid, BOX, poses[-1])


def test_drives_forwards_from_a_mark_behind_it() -> None:
    grid = costmap((-0.29, 0.0))
    poses = drive(planner(Pose2D(2.0, 0.0)), grid, BOX, 20)
    assert not overlapped(grid, BOX, poses[-1]) and poses[-1].x > 0.0


def test_a_round_robot_that_cannot_reverse_turns_away_first() -> None:
    grid = costmap((0.17, 0.03))
    poses = drive(planner(Pose2D(2.0, 0.0)), grid, DISC, 100)
    assert not overlapped(grid, DISC, poses[-1])
    (square,) = lethal_squares(grid)
    distances = [square.distance(shapely.Point(pose.x, pose.y)) for pose in poses]
    assert min(np.diff(distances)) > -1e-4


@pytest.mark.parametrize("minimum", [0.0, -0.2])
def test_stays_between_marks_on_both_sides(minimum: float) -> None:
    grid = costmap(*((x, y) for x in (-0.29, 0.29) for y in np.arange(-0.4, 0.4, 0.05)))
    with pytest.raises(NoValidControlError, match="lethal"):
        planner(Pose2D(2.0, 0.0), min_vel_x=minimum).compute_command(
            ControlInput(RobotState(Pose2D(0.0, 0.0), Twist2D()), grid, BOX)
        )


def test_a_mark_under_the_center_is_not_left() -> None:
    """No direction leads away from it."""
    with pytest.raises(NoValidControlError):
        planner(Pose2D(2.0, 0.0), min_vel_x=-0.2).compute_command(
            ControlInput(RobotState(Pose2D(0.0, 0.0), Twist2D()), costmap((0.0, 0.0)), BOX)
        )


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(
    footprint=st.sampled_from([BOX, L_SHAPE, DISC]),
    marks=st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)), min_size=1, max_size=4),
    minimum=st.sampled_from([0.0, -0.2]),
    goal=st.floats(-math.pi, math.pi),
)
def test_never_enters_another_cell_and_never_goes_deeper(
    footprint: Footprint, marks: list[tuple[float, float]], minimum: float, goal: float
) -> None:
    grid = costmap(*marks)
    made = planner(Pose2D(1.5 * math.cos(goal), 1.5 * math.sin(goal)), min_vel_x=minimum)
    before = overlapped(grid, footprint, Pose2D(0.0, 0.0))
    if not before:
        return
    squares = [lethal_squares(grid)[i] for i in sorted(before)]

    def depth(pose: Pose2D) -> float:
        """By how much (m) the footprint would have to shrink to be free of the cells under it at the start."""
        if footprint is DISC:
            return footprint.circumscribed_radius - min(s.distance(shapely.Point(pose.x, pose.y)) for s in squares)
        low, high = 0.0, 1.0
        for _ in range(20):
            middle = 0.5 * (low + high)
            shrunk = shapely.Polygon(Footprint(middle * footprint.vertices).at(pose)) if middle > 0.01 else None
            if shrunk is not None and any(shrunk.intersection(square).area > 1e-9 for square in squares):
                high = middle
            else:
                low = middle
        return footprint.circumscribed_radius * (1.0 - low)

    poses = drive(made, grid, footprint, 15)
    for pose in poses:
        assert overlapped(grid, Footprint(0.99 * footprint.vertices), pose) <= before
    # the points of a rollout are checked, not the motion between them
    assert max(depth(pose) for pose in poses) <= depth(poses[0]) + 0.003
