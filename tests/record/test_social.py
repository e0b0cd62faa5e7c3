"""Social metrics against closed forms, and a record against its run."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Footprint, Pose2D
from navstack.record import PeopleTrack, Record, SocialMetrics, metrics_of, social_metrics
from navstack.record.social import social_force, times_to_collision
from navstack.scenario import load_suite, run_scenario
from navstack.sim import PedestrianMotion, Shape, SimParams, SimulatedRobot, World

DT = 0.1


def measured(
    robot: NDArray[np.float64],
    people: NDArray[np.float64],
    *,
    groups: tuple[int, ...] = (),
    walks: NDArray[np.float64] | None = None,
    **more: Any,
) -> SocialMetrics:
    """Metrics of a robot of 0.2 m radius at (n, 2) or (n, 3) among people of 0.3 m at (n, p, 2), every 0.1 s."""
    n, count = people.shape[:2]
    poses = robot if robot.shape[1] == 3 else np.column_stack((robot, np.zeros(n)))
    track = PeopleTrack(
        people,
        np.full(count, 0.3),
        np.array(groups or (-1,) * count, np.int32),
        np.full((count, 3), math.nan) if walks is None else walks,
    )
    options: dict[str, Any] = {
        "footprint": Footprint.from_radius(0.2),
        "collisions": np.empty((0, 4)),
        "targets": np.full((n, 2), math.nan),
        "plans": {},
        "results": [],
        **more,
    }
    return social_metrics(DT * np.arange(n), poses, track, **options)


def along(n: int, speed: float, start: float = 0.0, y: float = 0.0) -> NDArray[np.float64]:
    """(n, 2) at a constant speed along x."""
    return np.column_stack((start + speed * DT * np.arange(n), np.full(n, y)))


def test_passing_a_standing_person() -> None:
    """From x = -5 to 5 at 1 m/s, past a person 1 m aside: chords of circles around the person."""
    robot = along(1001, 1.0 * 0.1, -5.0)  # 0.1 m/s for 100 s: fine in space
    person = np.broadcast_to([0.0, 1.0], (1001, 1, 2)).copy()
    found = measured(robot, person)

    def chord(d: float) -> float:
        return 2.0 * math.sqrt(max((d + 0.5) ** 2 - 1.0, 0.0)) / 10.0

    assert found.people == 1
    assert found.distance_min_m == pytest.approx(0.5)
    assert found.space_compliance == pytest.approx(0.0, abs=2e-3)
    assert found.intimate == 0.0
    assert found.personal == pytest.approx(chord(1.2), abs=2e-3)
    assert found.social == pytest.approx(chord(3.6) - chord(1.2), abs=3e-3)
    assert found.intimate + found.personal + found.social + found.public == pytest.approx(1.0)
    assert found.time_to_collision_min_s == math.inf  # it passes 1 m aside
    assert math.isnan(found.group_intimate)
    assert (found.contacts_by_robot, found.contacts_by_people) == (0, 0)
    nearer = measured(robot, person - [0.0, 0.35])
    assert nearer.space_compliance == pytest.approx(2.0 * math.sqrt(1.0 - 0.65**2) / 10.0, abs=2e-3)
    assert nearer.discomfort == pytest.approx(2.0 * math.sqrt(0.7**2 - 0.65**2) / 10.0, abs=2e-3)


def test_head_on() -> None:
    """At 0.5 m/s against 1 m/s from 10 m, until 0.5 s before they touch: the time to collision runs down linearly."""
    meet = (10.0 - 0.5) / 1.5
    n = math.floor((meet - 0.5) / DT) + 1
    robot, person = along(n, 0.5), along(n, -1.0, 10.0)[:, None]
    found = measured(robot, person)
    assert found.time_to_collision_min_s == pytest.approx(meet - DT * (n - 2))
    assert found.stalled_s == 0.0
    assert found.acceleration_max_m_s2 == pytest.approx(0.0, abs=1e-9)


def test_times_to_collision_are_the_first_contact() -> None:
    """Against a march in small steps, for random pairs."""
    rng = np.random.default_rng(0)
    offset, velocity = rng.uniform(-3, 3, (200, 3, 2)), rng.uniform(-1, 1, (200, 3, 2))
    reach = np.array([0.3, 0.5, 0.8])
    found = times_to_collision(offset, velocity, reach)
    t = np.arange(0.0, 20.0, 0.002)
    for k in range(200):
        for p in range(3):
            away = np.hypot(*(offset[k, p][:, None] + velocity[k, p][:, None] * t))
            hits = np.flatnonzero(away <= reach[p])
            if len(hits):
                assert found[k, p] == pytest.approx(t[hits[0]], abs=0.0021)
            else:
                assert found[k, p] > 19.9 or away.min() < reach[p] + 1e-4
    assert (found[np.hypot(offset[..., 0], offset[..., 1]) <= reach] == 0.0).all()


def test_who_touches_whom() -> None:
    """The robot drives into a standing person; a person walks into the standing robot; the second contact counts again."""
    n = 60
    still = np.zeros((n, 2))
    into = measured(along(n, 0.5, -1.4), still[:, None])
    assert (into.contacts_by_robot, into.contacts_by_people) == (1, 0)
    assert into.distance_min_m < 0.0
    assert into.time_to_collision_min_s == 0.0
    swing = np.column_stack((1.5 - 1.1 * np.abs(np.sin(0.15 * np.arange(n))), np.zeros(n)))
    assert measured(still, swing[:, None]).contacts_by_people == 3
    assert measured(still, swing[:, None]).contacts_by_robot == 0


def test_absent_people_and_none() -> None:
    robot = along(101, 0.5)
    nobody = measured(robot, np.full((101, 1, 2), math.nan))
    assert nobody.distance_min_m == nobody.time_to_collision_min_s == math.inf
    assert (nobody.public, nobody.social_work) == (1.0, 0.0)
    half = np.full((101, 1, 2), math.nan)
    half[50:, 0] = robot[50:] + [0.6, 0.0]
    found = measured(robot, half)
    assert found.intimate == pytest.approx(0.5)
    assert found.distance_min_m == pytest.approx(0.1)


def test_centers_of_groups() -> None:
    """Between two of a group 3 m apart: nobody is near, but the group's center is."""
    people = np.broadcast_to([[0.0, 1.5], [0.0, -1.5], [9.0, 9.0]], (11, 3, 2)).copy()
    found = measured(np.zeros((11, 2)), people, groups=(0, 0, -1))
    assert found.personal == 1.0
    assert (found.group_intimate, found.group_personal) == (1.0, 0.0)


def test_motion_in_closed_form() -> None:
    """A circle of 1 m at 0.5 m/s: centripetal acceleration v^2 / r and jerk v^3 / r^2; then it stands for 4 s."""
    t = DT * np.arange(201)
    yaw = np.minimum(0.5 * t, 8.0)
    robot = np.column_stack((np.sin(yaw), -np.cos(yaw), yaw))
    found = measured(robot, np.full((201, 1, 2), 50.0))
    assert found.heading_change_rad == pytest.approx(8.0)
    assert found.stalled_s == found.not_moving_s == pytest.approx(4.0)
    driven = measured(robot[:150], np.full((150, 1, 2), 50.0))
    assert driven.acceleration_mean_m_s2 == pytest.approx(0.25, rel=1e-3)
    assert driven.jerk_mean_m_s3 == pytest.approx(0.125, rel=1e-3)
    assert driven.jerk_max_m_s3 == pytest.approx(0.125, rel=1e-3)


def test_failures_to_progress() -> None:
    """Towards a goal for 20 s, 65 s on the spot, then on: three times 20 s without progress."""
    x = np.concatenate((np.linspace(0, 4, 200), np.full(650, 4.0), np.linspace(4, 8, 200)))
    robot = np.column_stack((x, np.zeros(len(x))))
    far = np.full((len(x), 1, 2), 50.0)
    assert measured(robot, far, targets=np.broadcast_to([9.0, 0.0], (len(x), 2))).failures_to_progress == 3
    assert measured(robot, far).failures_to_progress == 0  # without a goal


def test_paths_against_plans() -> None:
    """A goal reached on 5 m instead of 4, one on less than its plan, one that failed, and one for which there was no plan."""
    corner = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0]])
    results = [
        {"state": "SUCCEEDED", "path_length_m": 5.0},
        {"state": "SUCCEEDED", "path_length_m": 3.0},
        {"state": "ABORTED", "path_length_m": 9.0},
        {"state": "ABORTED", "path_length_m": 0.0},
    ]
    found = measured(along(11, 0.5), np.full((11, 1, 2), 9.0), plans=dict.fromkeys(range(3), corner), results=results)
    assert found.path_efficiency == pytest.approx(8.0 / 8.0)
    assert found.spl == pytest.approx((4.0 / 5.0 + 1.0 + 0.0 + 0.0) / 4.0)
    assert found.path_irregularity_rad == pytest.approx(-3 * 0.5 * math.pi)
    assert found.all_arrived_s == math.inf


def test_disturbance_is_the_mean_of_what_is_known() -> None:
    walks = np.array([[3.0, 1.0, 0.5], [4.0, 0.0, 0.1], [math.inf, math.nan, math.nan]])
    people = np.full((11, 3, 2), 9.0)
    found = measured(along(11, 0.5), people, walks=walks)
    assert (found.disturbance_s, found.disturbance_m) == pytest.approx((0.5, 0.3))
    done = [{"state": "SUCCEEDED", "path_length_m": 1.0}]
    assert measured(along(11, 0.5), people, walks=walks, results=done).all_arrived_s == math.inf
    assert measured(along(11, 0.5), people[:, :2], walks=walks[:2], results=done).all_arrived_s == 4.0


def test_social_force_in_closed_form() -> None:
    """Head on at rest: D = e, so t = e, theta = 0 and F = -2.1 exp(-d / 0.35) e; mirrored people give mirrored forces."""
    zero = np.zeros(2)
    assert social_force(np.array([1.0, 0.0]), zero, zero) == pytest.approx([-2.1 * math.exp(-1.0 / 0.35), 0.0])
    v, w = np.array([1.0, 0.0]), np.array([-0.5, 0.2])
    e = np.array([1.0, 0.5]) / math.hypot(1.0, 0.5)
    d = 2.0 * (v - w) + e
    size = float(np.hypot(*d))
    tx, ty = d / size
    reach, theta = 0.35 * size, math.atan2(e[1], e[0]) - math.atan2(ty, tx)
    assert theta > 0.0
    slow = math.exp(-math.hypot(1.0, 0.5) / reach - (3.0 * reach * theta) ** 2)
    turn = math.exp(-math.hypot(1.0, 0.5) / reach - (2.0 * reach * theta) ** 2)
    expected = -2.1 * (slow * np.array([tx, ty]) + turn * np.array([-ty, tx]))
    found = social_force(np.array([1.0, 0.5]), v, w)
    assert found == pytest.approx(expected)
    mirror = np.array([1.0, -1.0])
    assert social_force(mirror * [1.0, 0.5], mirror * v, mirror * w) == pytest.approx(mirror * found)
    n = 11
    people = np.broadcast_to([[1.0, 0.0]], (n, 1, 2)).copy()
    work = measured(np.zeros((n, 2)), people).social_work
    assert work == pytest.approx(2.0 * 2.1 * math.exp(-1.0 / 0.35) * DT * (n - 1))


# --- runs ----------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suite", "number", "robot"), [("crowd", 2, "turtlebot"), ("circle_crossing", 1, "jackal_dwa")]
)
def test_a_record_gives_the_metrics_of_its_run(tmp_path: Path, suite: str, number: int, robot: str) -> None:
    scenario = load_suite(suite, count=3)[number].build(params=[robot])
    result = run_scenario(scenario)
    assert result.recorder is not None
    result.recorder.save(tmp_path)
    found, social = metrics_of(Record.load(tmp_path)).social, result.metrics.social
    assert found is not None and social is not None
    assert repr(found) == repr(social)
    assert repr(run_scenario(scenario, record=False).metrics.social) == repr(social)
    assert set(result.metrics.as_dict()["social"]) == {field.name for field in fields(SocialMetrics)}
    assert social.collisions_with_people + social.collisions_with_others == result.collisions
    if suite == "circle_crossing":  # there is nothing else to touch, and people walk on through the robot
        assert social.collisions_with_people == result.collisions > 0
    else:
        assert social.distance_min_m >= result.min_clearance_m - 1e-6 - 0.05  # a circle around the footprint is larger


def test_a_collision_is_with_a_person_whom_the_footprint_touches() -> None:
    """A square of 0.4 m, and a person of 0.3 m who walks by: 1 cm from its corner at 0.55 s if it stands at 45 degrees."""
    square = Footprint([[-0.2, -0.2], [-0.2, 0.2], [0.2, 0.2], [0.2, -0.2]])
    corner = 0.2 * math.sqrt(2.0)
    person = np.column_stack((np.full(11, corner + 0.31), along(11, 1.0)[:, 0] - 0.55))[:, None]
    absent = np.full((11, 1, 2), math.nan)

    def counted(*rows: tuple[float, ...]) -> tuple[int, int]:
        found = measured(
            np.zeros((11, 2)),
            np.concatenate((absent, person), axis=1),
            footprint=square,
            collisions=np.array(rows, np.float64).reshape(-1, 4),
        )
        return found.collisions_with_people, found.collisions_with_others

    turned = (0.55, 0.0, 0.0, 0.25 * math.pi)
    assert counted() == (0, 0)
    assert counted(turned) == (1, 0)
    assert counted((0.55, 0.0, 0.0, 0.0)) == (0, 1)  # its side is farther away
    assert counted((0.35, 0.0, 0.0, 0.25 * math.pi), turned, (0.55, 0.3, 0.0, 0.0)) == (2, 1)


def test_the_disturbance_is_that_of_a_paired_run() -> None:
    """People who do not notice the robot are not delayed; one who walks around it is, and the other run is without it."""
    blind = SimParams(lasers=[], bumpers=[])

    def walks(*, notices: bool, x: float) -> NDArray[np.float64]:
        motion = PedestrianMotion(goals=[[3.0, 0.0]], speed=1.0, notices_robot=notices)
        world = World(None, shapes=[Shape(radius=0.25, pose=[-3.0, 0.02], motion=motion)])
        robot = SimulatedRobot(blind, world, Footprint.from_radius(0.18), Pose2D(x, 5.0 if x else 0.6, 0.0), seed=3)
        robot.advance_to(12.0)
        return robot.walks()

    assert walks(notices=False, x=0.0)[0, 1:].tolist() == [0.0, 0.0]
    far = walks(notices=True, x=500.0)
    assert far[0, 1:].tolist() == [0.0, 0.0]
    near = walks(notices=True, x=0.0)
    assert near[0, 1] > 0.05
    assert near[0, 2] > 0.001
    assert near[0, 0] == pytest.approx(far[0, 0] + near[0, 1])


def test_values_are_replaced_by_name() -> None:
    """The reports show the most important ones, with units, and a dash for what is unknown."""
    shown = dict(measured(along(11, 0.5), np.full((11, 1, 2), math.nan)).shown())
    assert shown["people"] == "1"
    assert shown["minimum distance to a person"] == "-"
    found = measured(along(11, 0.5), np.full((11, 1, 2), 3.0))
    assert dict(replace(found, disturbance_s=1.25).shown())["mean delay of people"] == "1.2 s"
