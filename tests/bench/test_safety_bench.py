"""The search for contacts: what the monitor guarantees, what it cannot, and the table."""

from __future__ import annotations

from typing import Any

import pytest

from navstack.bench.safety_bench import SafetyTask, safety_jobs, safety_tables, stopping_distance, unexplained
from navstack.bench.safety_drive import SafetyDrive
from navstack.bench.safety_scene import HostileSource, robot_kinds, safety_scene
from navstack.jobs.job import JobResult, perform

COUNT = 12


@pytest.fixture(scope="module")
def results() -> list[JobResult]:
    return [perform(SafetyTask(), job) for job in safety_jobs(0, COUNT)]


def test_every_contact_with_the_monitor_is_explained(results: list[JobResult]) -> None:
    assert not any(result.failed for result in results)
    assert unexplained(results) == []


def test_the_monitor_prevents_contacts(results: list[JobResult]) -> None:
    with_it = sum(_still(result.value["with"]) for result in results)
    without = sum(_still(result.value["without"]) for result in results)
    walls = [c for result in results for c in result.value["with"] if c["obstacle"] == "map"]
    assert walls == []
    assert with_it < without
    # it does not simply stand still
    driven = sum(result.value["driven_with_m"] for result in results)
    assert driven > 0.5 * sum(result.value["driven_without_m"] for result in results)


def test_tables(results: list[JobResult]) -> None:
    rates, causes, bounds = safety_tables(results)
    assert [row["scenes"] for row in rates.rows[-2:]] == [COUNT, COUNT]
    assert {"cause": "unexplained", "wall": 0, "box": 0, "person": 0} in list(causes.rows)
    assert len(bounds.rows) == len(robot_kinds())


def test_stopping_distance() -> None:
    assert stopping_distance(1.0, 0.5) == pytest.approx(0.1 + 1.0)


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
