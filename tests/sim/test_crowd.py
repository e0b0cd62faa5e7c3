"""Pedestrians: paths, distances to obstacles, reproducibility by seed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navstack.core import Footprint, Pose2D, Twist2D
from navstack.sim import PedestrianMotion, Shape, SimParams, SimulatedRobot, World
from navstack.sim.crowd import (
    BEHIND,
    BODY,
    PUSHES,
    SIGHT,
    add_social_forces,
    people_within,
    push_from_wall,
    pushes_from_others,
)
from tests.sim.worlds import ascii_map

CIRCLE = Footprint.from_radius(0.18)
FAR_AWAY = Pose2D(50.0, 50.0, 0.0)
BLIND = SimParams(lasers=[], bumpers=[])


def push_from_other(*pair: float) -> tuple[float, float]:
    """The force of one person: rx, ry, vx, vy, extra."""
    pairs = np.full((PUSHES, 1), math.nan)
    pairs[:5, 0] = pair
    pushes_from_others(pairs, 1)
    return float(pairs[0, 0]), float(pairs[1, 0])


def walker(x: float, y: float, *goals: tuple[float, float], radius: float = 0.25, **more: object) -> Shape:
    motion = PedestrianMotion(goals=[list(goal) for goal in goals], **more)  # pyright: ignore
    return Shape(radius=radius, pose=[x, y], motion=motion)


def ways(robot: SimulatedRobot, seconds: float, step: float = 0.1) -> NDArray[np.float64]:
    """(time, people, 2) their positions."""
    found: list[NDArray[np.float64]] = []
    begun = robot.time
    for k in range(round(seconds / step)):
        robot.advance_to(begun + step * (k + 1))
        found.append(robot.solids.discs[-len(robot.world.people) :, :2].copy())
    return np.array(found)


def test_a_single_pedestrian_walks_to_its_goals_at_its_speed() -> None:
    world = World(None, shapes=[walker(0, 0, (10, 0), (10, 5), speed=1.2, goal_radius=0.2)])
    way = ways(SimulatedRobot(BLIND, world, CIRCLE, FAR_AWAY), 15.0)[:, 0]
    # v (t - tau (1 - exp(-t / tau))): the speed is come to under the relaxation time of 0.5 s
    t = 0.1 * np.arange(1, 81)
    assert way[:80, 0] == pytest.approx(1.2 * (t - 0.5 * (1 - np.exp(-t / 0.5))), abs=0.35)
    assert np.hypot(*(way - [10, 0]).T).min() < 0.25
    assert np.hypot(*(way - [10, 5]).T).min() < 1.0
    speeds = np.hypot(*np.diff(way, axis=0).T) / 0.1
    assert speeds.max() < 1.3 * 1.2 + 1e-9


def test_forces_are_the_gradients_of_the_paper_s_potentials() -> None:
    """Equations 3 to 5 by central differences."""

    def others(x: float, y: float, vx: float, vy: float) -> float:
        sx, sy = 2.0 * vx, 2.0 * vy
        ahead = math.hypot(x - sx, y - sy)
        b = 0.5 * math.sqrt((math.hypot(x, y) + ahead) ** 2 - sx * sx - sy * sy)
        return 2.1 * math.exp(-b / 0.3)

    h = 1e-6
    for x, y, vx, vy in ((1.0, 0.2, 0.0, 0.3), (0.4, -0.6, 0.5, 0.5), (-0.8, 0.1, 1.0, 0.0), (0.5, 0.5, 0.0, 0.0)):
        expected = (
            -(others(x + h, y, vx, vy) - others(x - h, y, vx, vy)) / (2 * h),
            -(others(x, y + h, vx, vy) - others(x, y - h, vx, vy)) / (2 * h),
        )
        assert push_from_other(x, y, vx, vy, 0.0) == pytest.approx(expected, rel=1e-5, abs=1e-8)
    assert push_from_wall(0.5, 0.0, 0.0, 0.3, 0.4) == pytest.approx(
        (0.6 * 50 * math.exp(-2.5), 0.8 * 50 * math.exp(-2.5))
    )


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.floats(1.0, 30.0))
def test_forces_equal_a_plain_loop_over_all_people(seed: int, people: int, side: float) -> None:
    """To the bit, although only those in sight are visited and few need the size of their force."""
    rng = np.random.default_rng(seed)
    shapes = [walker(*rng.uniform(0, side, 2), (0.0, 0.0), radius=rng.uniform(0.15, 0.5)) for _ in range(people)]  # pyright: ignore
    crowd = World(None, shapes=shapes).crowd(0)
    assert crowd is not None
    crowd._people["vx"], crowd._people["vy"] = rng.normal(0.0, 0.8, (2, people))
    before, own = crowd._people, crowd._settings
    angle = rng.uniform(-math.pi, math.pi)
    ex, ey = math.cos(angle), math.sin(angle)
    if rng.random() < 0.3:  # exactly at the border of the field of view
        k = int(rng.integers(people))
        force = push_from_other(*(before[0][a] - before[k][a] for a in ("x", "y", "vx", "vy")), 0.0)
        turn = math.atan2(force[1], force[0]) + math.acos(-SIGHT)
        ex, ey = math.cos(turn), math.sin(turn)
    robot = np.array([*rng.uniform(0, side, 2), 0.3, 0.1, 0.2])
    for k in range(people):
        ax, ay = 0.3, -0.2
        for j in range(people + 1):
            if j == k:
                continue
            other = [*robot] if j == people else [before[j][a] for a in ("x", "y", "vx", "vy")] + [own[j]["radius"]]
            x, y, vx, vy, radius = (float(value) for value in other)
            extra = radius + float(own[k]["radius"]) - 2.0 * BODY
            fx, fy = push_from_other(float(before[k]["x"]) - x, float(before[k]["y"]) - y, vx, vy, extra)
            if -(ex * fx + ey * fy) < SIGHT * math.hypot(fx, fy):
                fx, fy = BEHIND * fx, BEHIND * fy
            ax, ay = ax + fx, ay + fy
        near = np.empty(people + 1, np.int64)
        reach = 5.0 + 2.0 * 0.5 - 2.0 * BODY + 1e-9
        x, y = float(before[k]["x"]), float(before[k]["y"])
        count = people_within(before["x"].copy(), before["y"].copy(), x, y, reach, near)
        pairs = np.empty((PUSHES, people + 1))
        assert add_social_forces(before, own, k, near, count, ex, ey, robot, pairs, 0.3, -0.2) == (ax, ay)


def test_two_pedestrians_pass_each_other() -> None:
    world = World(None, shapes=[walker(-4, 0, (4, 0), speed=1.2), walker(4, 0.05, (-4, 0), speed=1.2)])
    both = ways(SimulatedRobot(BLIND, world, CIRCLE, FAR_AWAY), 12.0)
    assert np.hypot(*(both[:, 0] - both[:, 1]).T).min() > 0.5
    assert np.hypot(*(both[:, 0] - [4, 0]).T).min() < 0.4
    assert np.hypot(*(both[:, 1] - [-4, 0]).T).min() < 0.4


ROOM = """
################
#              #
#              #
#      ##      #
#      ##      #
#              #
#              #
################
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_pedestrians_do_not_collide_with_walls_solids_or_the_robot(seed: int) -> None:
    """Six pedestrians cross a room with a pillar, a post and a moving robot."""
    rng = np.random.default_rng(seed)
    grid = ascii_map(ROOM, 0.5)
    people = [
        walker(*start, *[tuple(rng.uniform(0.9, 3.0, 2) * (2.3, 1.0)) for _ in range(3)])  # pyright: ignore
        for start in ((1, 1), (1, 2), (1, 3), (6.8, 1), (6.8, 2), (6.8, 3))
    ]
    post = Shape(radius=0.2, pose=[2.5, 2.0])
    box = Shape(box=[0.4, 0.4], pose=[5.5, 2.2, 0.7])
    world = World(grid, shapes=[*people, post, box])
    robot = SimulatedRobot(BLIND, world, CIRCLE, Pose2D(4.0, 0.9, 0.0), seed=seed)
    still = World(grid, shapes=[post, box])
    speeds: list[float] = []
    last = robot.solids.discs[-6:, :2].copy()
    for k in range(400):
        robot.command(Twist2D(*((0.3, 0.0, 0.4) if k % 80 < 40 else (-0.3, 0.0, 0.4))))
        robot.advance_to(0.1 * (k + 1))
        now = robot.solids.discs[-6:, :2].copy()
        speeds += (np.hypot(*(now - last).T) / 0.1).tolist()
        last = now
        for x, y in now.tolist():
            assert still.clearance(Pose2D(x, y)) >= 0.25 - 1e-9
    assert max(speeds) < 1.3 * 2.5
    assert np.mean(speeds) > 0.2


def test_pedestrians_walk_around_a_stopped_robot() -> None:
    world = World(None, shapes=[walker(-3, 0.02, (3, 0), speed=1.0)])
    robot = SimulatedRobot(BLIND, world, CIRCLE, Pose2D(0, 0, 0))
    way = ways(robot, 10.0)[:, 0]
    assert not robot.collisions
    assert np.hypot(*way.T).min() > 0.43
    assert np.hypot(*(way - [3, 0]).T).min() < 0.4


def test_a_pedestrian_that_ignores_the_robot_collides_with_it() -> None:
    shape = walker(-3, 0, (3, 0), speed=1.0, notices_robot=False).model_copy(update={"name": "ann"})
    robot = SimulatedRobot(BLIND, World(None, shapes=[shape]), CIRCLE, Pose2D(0, 0, 0))
    robot.advance_to(8.0)
    assert [(c.kind, c.name) for c in robot.collisions] == [("disc", "ann")]
    assert robot.pose == Pose2D(0, 0, 0)


def test_speeds_and_paths_depend_on_the_seed() -> None:
    world = World(None, shapes=[walker(0, y, (20, y)) for y in np.arange(0, 120, 6.0).tolist()])

    def walked(seed: int) -> NDArray[np.float64]:
        return ways(SimulatedRobot(BLIND, world, CIRCLE, Pose2D(-50, 0, 0), seed=seed), 4.0, 1.0)

    first = walked(1)
    assert (first == walked(1)).all()
    assert (first != walked(2)).any()
    speeds = (first[3] - first[2])[:, 0]
    assert speeds.mean() == pytest.approx(1.34, abs=4 * 0.26 / math.sqrt(20))
    assert 0.1 < speeds.std() < 0.5


def test_pedestrians_pause_at_their_goals() -> None:
    world = World(None, shapes=[walker(0, 0, (2, 0), (0, 0), speed=1.0, pause=3.0)])
    way = ways(SimulatedRobot(BLIND, world, CIRCLE, FAR_AWAY), 6.0)[:, 0]
    there = np.hypot(*(way - [2, 0]).T) < 0.45
    assert 2.5 < 0.1 * there.sum() < 4.0
