"""ORCA: against pyrvo (bindings of RVO2) step by step, against a search over all velocities, and by closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Pose2D, Twist2D
from navstack.sim import PedestrianMotion, Shape, SimulatedRobot, World
from navstack.sim.orca import avoiding_velocity, nearest_velocity, reciprocal_plane
from tests.sim.test_crowd import BLIND, CIRCLE, FAR_AWAY, ROOM, walker, ways
from tests.sim.worlds import ascii_map

pyrvo = pytest.importorskip("pyrvo", reason="ORCA is compared with pyrvo")

DT = 0.05


def circle(n: int, radius: float, seed: int) -> NDArray[np.float64]:
    """(n, 2) positions on a circle, nearly regular: opposite people would meet head on."""
    angles = np.arange(n) * 2.0 * math.pi / n + np.random.default_rng(seed).uniform(-0.1, 0.1, n)
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))


def rvo_velocities(
    at: NDArray[np.float64], velocity: NDArray[np.float64], wanted: NDArray[np.float64], radius: float, speed: float
) -> NDArray[np.float64]:
    """(n, 2) velocities that RVO2 chooses in one step."""
    simulator = pyrvo.RVOSimulator(DT, 10.0, 10, 5.0, 5.0, radius, speed)
    for k in range(len(at)):
        simulator.add_agent(tuple(at[k].tolist()))
        simulator.set_agent_velocity(k, tuple(velocity[k].tolist()))
        simulator.set_agent_pref_velocity(k, tuple(wanted[k].tolist()))
    simulator.do_step()
    found = [simulator.get_agent_velocity(k) for k in range(len(at))]
    return np.array([(v.x, v.y) for v in found])


def orca_velocities(
    at: NDArray[np.float64], velocity: NDArray[np.float64], wanted: NDArray[np.float64], radius: float, speed: float
) -> NDArray[np.float64]:
    """The same by the kernels, for the ten nearest of each."""
    found = np.empty_like(at)
    for k in range(len(at)):
        away = np.hypot(*(at - at[k]).T)
        others = [j for j in np.argsort(away, kind="stable").tolist() if j != k and away[j] < 10.0][:10]
        planes = np.array(
            [reciprocal_plane(*(at[j] - at[k]), *velocity[k], *velocity[j], 2.0 * radius, 5.0, DT, 0.5) for j in others]
        )
        found[k] = avoiding_velocity(planes, len(planes), 0, *wanted[k], speed, np.empty((len(planes), 3)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("people", "across"), [(2, 4.0), (5, 4.0), (12, 4.0), (30, 6.0)])
def test_equals_rvo2_step_by_step(people: int, across: float) -> None:
    """Across a circle. RVO2 computes with 24 bits: 1e-5 m/s; in a dense crowd that can decide which border is the first."""
    rng = np.random.default_rng(people)
    at, goals = circle(people, across, 1), -circle(people, across, 1)
    velocity = np.zeros((people, 2))
    errors: list[float] = []
    nearest = math.inf
    for _ in range(round(20.0 / DT)):
        left = goals - at
        wanted = left / np.maximum(np.hypot(*left.T), 1.0)[:, None] + rng.normal(0.0, 1e-3, (people, 2))
        theirs = rvo_velocities(at, velocity, wanted, 0.3, 1.0)
        ours = orca_velocities(at, velocity, wanted, 0.3, 1.0)
        errors += np.hypot(*(ours - theirs).T).tolist()
        velocity = ours
        at = at + DT * velocity
        apart = np.hypot(*(at[:, None] - at).transpose(2, 0, 1))
        nearest = min(nearest, float(apart[np.triu_indices(people, 1)].min()))
    assert np.quantile(errors, 0.99) < 1e-5
    assert max(errors) < 1e-2
    assert nearest > (0.6 - 1e-3 if people <= 12 else 0.3)  # thirty are too many for ten neighbors each


@pytest.mark.slow
def test_equals_rvo2_in_crowds_that_overlap() -> None:
    """No velocity avoids everyone: the least deep one. RVO2 takes borders within 1e-5 as parallel: a few differ."""
    rng = np.random.default_rng(0)
    errors: list[float] = []
    for _ in range(60):
        at, velocity = rng.uniform(-1.5, 1.5, (12, 2)), rng.uniform(-0.7, 0.7, (12, 2))
        wanted = rng.uniform(-0.7, 0.7, (12, 2))
        difference = orca_velocities(at, velocity, wanted, 0.3, 1.0) - rvo_velocities(at, velocity, wanted, 0.3, 1.0)
        errors += np.hypot(*difference.T).tolist()
    assert np.quantile(errors, 0.95) < 1e-4


@pytest.mark.parametrize("seed", range(40))
def test_no_velocity_is_better(seed: int) -> None:
    """A search over all velocities, 0.02 m/s apart: none in all half-planes is nearer, and where none is, none is less deep."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 9))
    angles = rng.uniform(-math.pi, math.pi, count)
    planes = np.column_stack((np.cos(angles), np.sin(angles), rng.uniform(-1.0, 0.5, count)))
    wanted = rng.uniform(-1.2, 1.2, 2)
    found = np.array(avoiding_velocity(planes, count, 0, *wanted, 1.0, np.empty((count, 3))))
    grid = np.arange(-1.0, 1.001, 0.02)
    others = np.column_stack([axis.ravel() for axis in np.meshgrid(grid, grid)])
    others = others[np.hypot(*others.T) <= 1.0]
    depth = (planes[:, 2] - others @ planes[:, :2].T).max(axis=1)
    own = float((planes[:, 2] - planes[:, :2] @ found).max())
    assert np.hypot(*found) <= 1.0 + 1e-9
    if (depth <= 0.0).any():
        assert own <= 1e-9
        assert np.hypot(*(found - wanted)) <= np.hypot(*(others[depth <= 0.0] - wanted).T).min() + 1e-9
    elif own > 1e-9:
        assert own <= depth.min() + 1e-9


def test_walls_do_not_give_way() -> None:
    """Between a wall ahead and people from behind, the wall decides."""
    planes = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.5], [math.sqrt(0.5), math.sqrt(0.5), 0.4]])
    with_wall = avoiding_velocity(planes, 3, 1, 0.5, 0.0, 1.0, np.empty((3, 3)))
    without = avoiding_velocity(planes, 3, 0, 0.5, 0.0, 1.0, np.empty((3, 3)))
    assert with_wall[0] <= 1e-9
    assert without[0] > 0.05
    assert nearest_velocity(planes, 3, 0.5, 0.0, False, 1.0)[2] < 3


def test_half_plane_in_closed_form() -> None:
    """Head on at 1 m/s each, 4 m apart: both pass on the same side by half of the angle of the cone; or stop for the disc."""
    nx, ny, offset = reciprocal_plane(4.0, 0.0, 1.0, -1e-12, -1.0, 1e-12, 0.6, 5.0, DT, 0.5)
    half = math.asin(0.6 / 4.0)
    assert (nx, ny) == pytest.approx((-math.sin(half), -math.cos(half)))
    assert offset - nx == pytest.approx(0.5 * 2.0 * math.sin(half))  # u: from 2 m/s to the tangent
    nx, ny, offset = reciprocal_plane(4.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.6, 5.0, DT, 1.0)
    assert (nx, ny) == pytest.approx((-1.0, 0.0))
    assert offset == pytest.approx(-3.4 / 5.0)  # at most the distance divided by the horizon
    nx, ny, offset = reciprocal_plane(0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.6, 5.0, DT, 0.5)
    assert (nx, offset) == pytest.approx((-1.0, 0.5 * 0.1 / DT))  # overlapping: apart in one step


# --- in the simulator ---------------------------------------------------------------------------------------------------


def orca(x: float, y: float, *goals: tuple[float, float], **more: object) -> Shape:
    return walker(x, y, *goals, model="orca", **more)


def test_two_people_pass_and_arrive() -> None:
    world = World(None, shapes=[orca(-4, 0, (4, 0), speed=1.2), orca(4, 0.05, (-4, 0), speed=1.2)])
    both = ways(SimulatedRobot(BLIND, world, CIRCLE, FAR_AWAY), 12.0)
    assert np.hypot(*(both[:, 0] - both[:, 1]).T).min() > 0.5 - 1e-3
    assert np.hypot(*(both[-1, 0] - [4, 0])) < 0.35
    assert np.hypot(*(both[-1, 1] - [-4, 0])) < 0.35
    speeds = np.hypot(*np.diff(both[:, 0], axis=0).T) / 0.1
    assert speeds.max() <= 1.2 + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_people_touch_neither_each_other_nor_walls_nor_the_robot(seed: int) -> None:
    """In a room with a pillar, a post and a robot that drives on: only the robot's own motion can cause a contact."""
    rng = np.random.default_rng(seed)
    grid = ascii_map(ROOM, 0.5)
    starts = ((1, 1), (1, 2), (1, 3), (6.8, 1), (6.8, 2), (6.8, 3))
    people = [
        orca(*start, *[tuple(rng.uniform(0.9, 3.0, 2) * (2.3, 1.0)) for _ in range(3)])  # pyright: ignore
        for start in starts
    ]
    post = Shape(radius=0.2, pose=[2.5, 2.0])
    robot = SimulatedRobot(BLIND, World(grid, shapes=[*people, post]), CIRCLE, Pose2D(4.0, 0.9, 0.0), seed=seed)
    still = World(grid, shapes=[post])
    for k in range(300):
        robot.command(Twist2D(*((0.3, 0.0, 0.4) if k % 80 < 40 else (-0.3, 0.0, 0.4))))
        robot.advance_to(0.1 * (k + 1))
        now = robot.solids.discs[-6:, :2]
        for x, y in now.tolist():
            assert still.clearance(Pose2D(x, y)) >= 0.25 - 1e-9
        apart = np.hypot(*(now[:, None] - now).transpose(2, 0, 1))[np.triu_indices(6, 1)]
        assert apart.min() > 0.45


def test_a_person_takes_the_whole_change_for_the_robot() -> None:
    world = World(None, shapes=[orca(-3, 0.02, (3, 0), speed=1.0)])
    robot = SimulatedRobot(BLIND, world, CIRCLE, Pose2D(0, 0, 0))
    way = ways(robot, 10.0)[:, 0]
    assert not robot.collisions
    assert np.hypot(*way.T).min() > 0.43 - 1e-3
    assert np.hypot(*(way[-1] - [3, 0])) < 0.35


def test_parameters_of_orca_need_its_model() -> None:
    with pytest.raises(ValueError, match="social force model has no time_horizon; remove it, or write model: orca"):
        PedestrianMotion(goals=[[1.0, 0.0]], time_horizon=3.0)


# --- groups --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["social_force", "orca"])
def test_a_group_stays_together(model: str) -> None:
    """Three of them with different speeds and goals 1.2 m apart; without the group, they draw away from each other."""

    def spread(group: str) -> float:
        shapes = [
            walker(0.0, 0.7 * k, (30.0, 0.7 * k), speed=speed, model=model, group=group)
            for k, speed in enumerate((0.8, 1.0, 1.2))
        ]
        robot = SimulatedRobot(BLIND, World(None, shapes=shapes), CIRCLE, FAR_AWAY)
        way = ways(robot, 15.0)[-1]
        return float(np.hypot(*(way - way.mean(axis=0)).T).max())

    assert spread("family") < 0.6 * spread("")
    assert spread("family") < 2.0
