"""The search for contacts: what the monitor guarantees, what it cannot, and the table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

from navstack.core import Pose2D, Twist2D
from navstack.studies.contacts import Moment, Sight, is_worse_than_stop
from navstack.studies.jobs import JobResult, perform
from navstack.studies.safety import (
    HostileSource,
    SafetyDrive,
    SafetyTask,
    braking,
    robot_kinds,
    safety_scene,
    safety_tables,
    stopping_distance,
    unexplained,
)

COUNT = 12


@pytest.fixture(scope="module")
def results() -> list[JobResult]:
    task = SafetyTask(0, COUNT)
    return [perform(task, job) for job in task.jobs()]


@pytest.mark.slow
def test_every_contact_with_the_monitor_is_explained(results: list[JobResult]) -> None:
    assert not any(result.failed for result in results)
    assert unexplained(results) == []


@pytest.mark.slow
def test_the_monitor_prevents_contacts(results: list[JobResult]) -> None:
    with_it = sum(_still(result.value["with"]) for result in results)
    without = sum(_still(result.value["without"]) for result in results)
    walls = [c for result in results for c in result.value["with"] if c["obstacle"] == "map"]
    assert walls == []
    assert with_it < without
    # it does not simply stand still
    driven = sum(result.value["driven_with_m"] for result in results)
    assert driven > 0.5 * sum(result.value["driven_without_m"] for result in results)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "why"),
    [
        (1356, "a person stands on the lidar: a scan without a valid beam is not a free room"),
        (3457, "the robot still drives towards a box while the command moves away and turns"),
        (463, "a stop would have touched the person as early as the command that moves away"),
        (6302, "a person walks on through the robot after the first contact"),
    ],
)
def test_scenes_that_were_not_explained(number: int, why: str) -> None:
    contacts = SafetyTask()(number)["with"]
    assert [c for c in contacts if c["cause"] == "unexplained"] == [], why
    assert [c for c in contacts if c["obstacle"] == "map"] == []


def test_commands_that_are_worse_than_a_stop_are_not_explained() -> None:
    solids = SafetyDrive(0, monitored=False).robot.solids
    robot = braking(safety_scene(0))  # round, radius 0.2 m, 1 m/s²
    nothing = Sight(np.empty((0, 2)), solids)
    person = shapely.Point(0.25, 0.0).buffer(0.02)

    def worse(sent: Twist2D, velocity: Twist2D, obstacle: shapely.Polygon = person) -> bool:
        moment = Moment(0.0, Pose2D(0.0, 0.0), velocity, velocity, sent, solids, nothing)
        return is_worse_than_stop(robot, moment, obstacle)

    assert worse(Twist2D(0.7), Twist2D(0.15))  # a stop would not touch it
    assert not worse(Twist2D(), Twist2D(0.5))
    assert not worse(Twist2D(-0.7), Twist2D(0.5))  # both touch it while the robot brakes
    assert worse(Twist2D(0.7), Twist2D(0.3))  # both touch it, the command earlier
    overlapping = shapely.Point(0.2, 0.0).buffer(0.02)
    assert worse(Twist2D(0.7), Twist2D(), overlapping)
    assert not worse(Twist2D(-0.7), Twist2D(), overlapping)


@pytest.mark.slow
def test_tables(results: list[JobResult]) -> None:
    rates, causes, bounds = safety_tables(results)
    assert [row["scenes"] for row in rates.rows[-2:]] == [COUNT, COUNT]
    assert {"cause": "unexplained", "wall": 0, "box": 0, "person": 0} in list(causes.rows)
    assert len(bounds.rows) == len(robot_kinds())


def test_stopping_distance() -> None:
    assert stopping_distance(1.0, 0.5) == pytest.approx(0.1 + 1.0)


@pytest.mark.slow
def test_scenes_and_commands_depend_on_the_number_only() -> None:
    assert safety_scene(5) == safety_scene(5)
    assert safety_scene(5).shapes != safety_scene(8).shapes
    one, other = HostileSource(safety_scene(5)), HostileSource(safety_scene(5))
    commands = [one.command(0.05 * k) for k in range(100)]
    assert commands == [other.command(0.05 * k) for k in range(100)]
    limit = safety_scene(5).robot.max_velocity
    assert all(abs(c.vx) <= limit[0] and abs(c.vy) <= limit[1] and abs(c.wz) <= limit[2] for c in commands)
    assert SafetyDrive(5, monitored=True).run() == SafetyDrive(5, monitored=True).run()


def _still(contacts: list[dict[str, Any]]) -> int:
    """Number of contacts with walls and boxes."""
    return sum(contact["obstacle"] == "map" or contact["obstacle"].startswith("box") for contact in contacts)
