"""Causes of contacts: what the robot sent, and what it saw."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from navstack.core import Footprint, Pose2D, Twist2D
from navstack.scenario import Run, read_scenario, shipped_scenarios
from navstack.sim import Collision, Solids
from navstack.sim.solids import solids_from_discs
from navstack.studies.contacts import Braking, ContactWatch, Moment, SeenPoints, Sight, cause_of, touched_cell

PERIOD_S = 0.1
ROBOT = Braking(Footprint.from_radius(0.2), False, False, (1.0, math.inf, 2.0), 0.0, PERIOD_S)


def person(x: float, y: float = 0.0) -> Solids:
    return solids_from_discs(np.array([[x, y, 0.25]]), np.array([1.8]))


def drive(speeds: list[float], people: list[float], *, seen: bool = True, y: float = 0.0) -> list[Moment]:
    """A drive along x with a command per period, next to a person at x = `people`, `y`."""
    moments: list[Moment] = []
    x, before = 0.0, speeds[0]
    for k, (speed, at) in enumerate(zip(speeds, people, strict=True)):
        solids = person(at, y)
        front = [[at - 0.25, y], [at - 0.25, y + 0.01], [at - 0.25, y - 0.01]]
        sight = Sight(np.array(front) if seen else np.empty((0, 2)), solids)
        pose, now, sent = Pose2D(x, 0.0), Twist2D(before), Twist2D(speed)
        moments.append(Moment(k * PERIOD_S, pose, now, now, sent, solids, sight))
        x, before = x + PERIOD_S * speed, speed
    return moments


def cause(moments: list[Moment]) -> str:
    last = moments[-1]
    pose = last.pose._replace(x=last.pose.x + PERIOD_S * last.sent.vx)
    return cause_of(ROBOT, moments, Collision(len(moments) * PERIOD_S, pose, "disc", 0, (pose.x + 0.45, 0.0)))


@pytest.mark.parametrize(
    ("moments", "expected"),
    [
        (drive([0.5] * 11, [1.0] * 11), "unexplained"),  # it drives on, into a standing person
        (drive([0.5] * 11, [1.0] * 11, seen=False), "seen too late"),
        (drive([0.0] * 6, [0.7 - 0.05 * k for k in range(6)]), "it moved into the standing robot"),
        # it brakes as soon as the person steps in front of it
        (drive([0.5, 0.5, 0.4, 0.3], [9.0, 9.0, 0.72, 0.66]), "it moved into the way"),
        (drive([0.2, 0.2, 0.1, 0.05, 0.0], [0.9, 0.8, 0.7, 0.6, 0.5]), "it moved into the way"),
    ],
)
def test_causes(moments: list[Moment], expected: str) -> None:
    assert cause(moments) == expected


def test_a_person_out_of_view_is_no_reason_to_stop() -> None:
    """It saw the person, and drives on when it does not see it any more."""
    moments = drive([0.5] * 11, [1.0] * 11)
    blind = [m if m.time < 0.35 else replace(m, sight=Sight(np.empty((0, 2)), m.solids)) for m in moments]
    assert cause(blind) == "not in view"


def wall_cause(seen_at: float | None, speeds: list[float] | None = None) -> str:
    """The robot drives into a cell of the map at x = 0.4 m, which a scan shows at a time (s), or never."""
    moments = drive(speeds or [0.5] * 5, [9.0] * 5)
    hit = Collision(0.5, Pose2D(0.2, 0.0), "map", 0, (0.425, 0.0))
    seen = SeenPoints()
    if seen_at is not None:
        seen.add(np.array([[0.4, 0.01], [0.4, -0.01]]), seen_at)
    seen.add(np.array([[3.0, 0.0]]), 0.0)
    return cause_of(ROBOT, moments, hit, seen.wall(touched_cell(hit, 0.05)))


def test_a_wall_is_the_robots_fault_if_it_saw_it_in_time() -> None:
    assert wall_cause(0.0) == "unexplained"
    # before the moments that are kept: it stands still, so it is known
    assert wall_cause(-5.0) == "unexplained"
    assert wall_cause(None) == "not in view"
    assert wall_cause(0.4) == "seen too late"
    # the robot stands: nothing that stands still touches it
    assert wall_cause(None, [0.0] * 5) == "it moved into the standing robot"


@pytest.mark.slow
def test_only_cycles_in_which_a_command_is_due_are_checks() -> None:
    """The local costmap is updated five times as often as the controller commands: between two commands, nothing can be sent."""
    spec = read_scenario(shipped_scenarios()["narrow_door"])
    slow = ["controller_frequency=2.0", "local_costmap/update_frequency=10.0"]
    run = Run(spec.build(overrides=slow), record=False, measure=False)
    watch, cycles = ContactWatch(run), 0
    while run.step() and run.robot.time < 4.0:
        watch.look()
        cycles += 1
    times = [moment.time for moment in watch._moments]
    assert cycles >= 30 and len(times) >= 5
    assert np.diff(times) == pytest.approx(0.5)
