"""A fleet: the order of the robots, a robot alone, contacts, distances, and what they see of each other."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from navstack.core import InputError, LaserScan, NavError, Pose2D
from navstack.fleet import Fleet, FleetResult, FleetRun, make_fleet, run_fleet
from navstack.scenario import run_scenario
from tests.fleet.stage import EAST, WEST, scenario

NOISY = ("navstack/sim/odometry_noise=0.05", "navstack/sim/wheel_slip=0.02")


def arrays(result: FleetResult, name: str) -> dict[str, bytes]:
    recorder = result.robot(name).run.recorder
    assert recorder is not None
    return {key: value.tobytes() for key, value in recorder.record().arrays.items()}


@pytest.fixture(scope="module")
def passing() -> FleetResult:
    return run_fleet(make_fleet({"east": EAST, "west": WEST}, seed=3))


@pytest.mark.parametrize("overrides", [(), NOISY])
def test_a_robot_alone_drives_as_in_a_single_simulation(overrides: tuple[str, ...]) -> None:
    fleet = make_fleet({"only": scenario((1.0, 1.0, 0.0), (2.0, 1.2, 0.5), overrides=overrides)}, seed=7)
    alone = run_scenario(fleet.robots[0].scenario)
    result = run_fleet(fleet)
    assert result.robot("only").run.goals == alone.goals
    assert alone.recorder is not None
    expected = {key: value.tobytes() for key, value in alone.recorder.record().arrays.items()}
    assert arrays(result, "only") == expected
    assert result.min_distance_m == math.inf


def test_the_order_of_the_robots_does_not_matter(passing: FleetResult) -> None:
    other = run_fleet(make_fleet({"west": WEST, "east": EAST}, seed=3))
    for name in ("east", "west"):
        assert arrays(other, name) == arrays(passing, name)
    assert [robot.nearest for robot in other.robots] == [robot.nearest for robot in passing.robots]


def test_robots_pass_each_other_and_know_their_distance(passing: FleetResult) -> None:
    assert passing.succeeded
    assert passing.contacts == ()
    tracks = []
    for name in ("east", "west"):
        recorder = passing.robot(name).run.recorder
        assert recorder is not None
        tracks.append(recorder.record())
    # the cycles of both robots are at the same times; the footprints are round, with a radius of 0.2 m
    count = min(len(track.times) for track in tracks)
    away = np.hypot(*(tracks[0].poses[:count, :2] - tracks[1].poses[:count, :2]).T).min() - 0.4
    least = passing.min_distance_m
    assert least <= away + 1e-6
    assert (
        away - least < 0.05
    )  # at 0.5 m/s each, the smallest distance of cycles 0.2 s apart is at most that much larger
    assert {robot.nearest.robot for robot in passing.robots} == {"east", "west"}
    assert passing.makespan_s == max(robot.finished_s for robot in passing.robots)


def test_a_record_has_the_other_robots_as_obstacles(passing: FleetResult) -> None:
    recorder = passing.robot("east").run.recorder
    other = passing.robot("west").run.recorder
    assert recorder is not None and other is not None
    record, seen = recorder.record(), other.record()
    t = 3.0
    _, polygons = record.solids_at(t)
    at = seen.poses[seen.index_at(t), :2]
    assert len(polygons) == 1
    assert np.hypot(*(np.asarray(polygons[0]).mean(axis=0) - at)) < 0.02


def test_the_seed_of_a_robot_depends_on_its_name_only() -> None:
    one = make_fleet({"a": EAST, "b": WEST}, seed=5)
    other = make_fleet({"c": EAST, "b": WEST, "a": EAST}, seed=5)
    assert {r.name: r.seed for r in one.robots}.items() <= {r.name: r.seed for r in other.robots}.items()
    assert len({robot.seed for robot in other.robots}) == 3
    assert make_fleet({"a": EAST}, seed=6).robots[0].seed != one.robots[0].seed


def test_contacts_are_named_and_exact() -> None:
    run = FleetRun(make_fleet({"a": scenario((1.0, 1.0, 0.0)), "b": scenario((3.0, 1.05, 0.0))}))
    a = run.runs["a"].robot
    for step in range(1, 300):
        run.lockstep.catch_up()
        a.command(a.state().velocity._replace(vx=0.5, vy=0.0, wz=0.0))
        run.lockstep.advance_to(step)
    run.lockstep.catch_up()
    (contact,) = run.contacts()
    assert str(contact).startswith("a touches b at ")
    assert [(c.kind, c.name) for c in a.collisions] == [("robot", "b")]
    # it stops within a centimeter (the length of two steps) of the other one, which stands
    assert run.lockstep.nearest(0).distance_m < 0.01
    assert run.runs["b"].robot.pose == Pose2D(3.0, 1.05, 0.0)
    assert a.pose.x + 0.2 <= 3.0 - 0.2 + 0.01


def test_a_lidar_sees_robots_that_are_as_high_as_it() -> None:
    seen = {}
    for height in (0.2, 0.6):
        low = scenario((3.0, 1.5, 0.0), overrides=(f"navstack/sim/body_height={height}",))
        run = FleetRun(make_fleet({"a": scenario((1.0, 1.5, 0.0)), "b": low}))
        scan = run.runs["a"].robot.scans()[0]
        assert isinstance(scan, LaserScan)
        lidar = run.runs["a"].robot.params.lidar(run.runs["a"].robot.params.lasers[0])
        seen[height] = float(np.nanmin(scan.ranges))
        assert 0.2 < lidar.height < 0.6
    assert seen[0.6] == pytest.approx(3.0 - 0.2 - 1.0, abs=0.15)
    assert seen[0.2] > 2.0


def test_starts_that_overlap_are_refused() -> None:
    with pytest.raises(InputError, match="a and b overlap at their starts"):
        FleetRun(make_fleet({"a": EAST, "b": replace(EAST, start=Pose2D(1.2, 1.0, 0.0))}))
    with pytest.raises(NavError, match=r"^b: the robot collides"):
        FleetRun(make_fleet({"a": EAST, "b": replace(EAST, start=Pose2D(1.2, 0.0, 0.0))}))
    with pytest.raises(InputError, match='two robots have the name "a"'):
        Fleet((*make_fleet({"a": EAST}).robots, *make_fleet({"a": WEST}).robots))


@pytest.mark.slow
def test_a_fleet_is_the_same_in_another_process() -> None:
    program = (
        "from navstack.fleet import make_fleet, run_fleet\n"
        "from tests.fleet.stage import EAST, WEST\n"
        "import hashlib\n"
        "r = run_fleet(make_fleet({'east': EAST, 'west': WEST}, seed=3))\n"
        "a = [x.run.recorder.record().arrays for x in r.robots]\n"
        "print(hashlib.sha256(b''.join(v.tobytes() for d in a for v in d.values())).hexdigest())\n"
    )
    found = {
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
        for _ in range(2)
    }
    assert len(found) == 1
