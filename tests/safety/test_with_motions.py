"""Motions through the collision monitor: it slows them, makes them wait, or they end with a reason."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.behaviors import read_step
from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.parameters import load_configuration
from navstack.scenario import GoalOutcome, Scenario, run_scenario
from navstack.sim import DoorMotion, Shape

START = Pose2D(5.0, 5.0, 0.0)
AHEAD = "[[1.0, 0.25], [1.0, -0.25], [0.0, -0.25], [0.0, 0.25]]"
STOP_AHEAD = {"type": "polygon", "action_type": "stop", "points": AHEAD, "min_points": 2}
STOP_AROUND = {"type": "circle", "action_type": "stop", "radius": 0.7, "min_points": 2}
SLOW = {"type": "circle", "action_type": "slowdown", "radius": 1.0, "slowdown_ratio": 0.5, "min_points": 2}
LIMIT = {
    "type": "circle",
    "action_type": "limit",
    "radius": 0.8,
    "linear_limit": 0.2,
    "angular_limit": 0.3,
    "min_points": 2,
}
BESIDE = (0.9, 0.5)
"""Beside the heart, where the robot is after 3 s."""
LASER = {"fov": 6.28, "beams": 360, "range_min": 0.05, "x": 0.0}


def box(x: float, y: float, begin: float = 0.0, end: float = 1e6, side: float = 0.3) -> Shape:
    """A box at (x, y) from the start, there from `begin` to `end` (s)."""
    motion = DoorMotion(style="sliding", slide=[0.0, START.y + y - 40.0], open=[[begin, end]], moving_time=0.0)
    return Shape(name="box", box=[side, side], pose=[START.x + x, 40.0, 0.0], motion=motion)


@cache
def room() -> OccupancyGrid:
    """A room of 10 m with walls: rays that end there clear the costmaps."""
    cells = np.zeros((200, 200), np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return OccupancyGrid(cells, GridGeometry(200, 200, 0.05, 0.0, 0.0))


def run(
    step: dict[str, Any], zone: dict[str, Any], *shapes: Shape, robot: str = "turtlebot"
) -> tuple[GoalOutcome, NDArray[Any]]:
    """Run one motion; return its outcome and the steps of the chain."""
    topic = "front/scan" if robot.startswith("jackal") else "scan"
    monitor = {
        "polygons": ["Zone"],
        "observation_sources": ["scan"],
        "Zone": zone,
        "scan": {"type": "scan", "topic": topic},
    }
    sections = {"collision_monitor": monitor, "navstack": {"sim": {"laser": LASER}}}
    result = run_scenario(
        Scenario(
            map=room(),
            configuration=load_configuration([robot, sections]),
            start=START,
            goals=(),
            steps=(read_step(step, folder=None),),
            shapes=shapes,
            time_limit_s=100.0,
        )
    )
    assert result.recorder is not None
    assert result.collisions == 0
    return result.goals[0], result.recorder.record().command_steps


def held(rows: NDArray[Any], action: str) -> NDArray[Any]:
    """The steps at which the monitor acted."""
    return rows[rows["action"] == action]


@pytest.mark.slow
def test_a_slowed_move_ends_at_its_distance() -> None:
    outcome, rows = run({"move": 1.5}, SLOW, box(0.8, 0.6))
    slowed = held(rows, "slowdown")
    assert outcome.state == "SUCCEEDED", outcome.message
    assert outcome.figures["driven_m"] == pytest.approx(1.5, abs=0.02)
    assert len(slowed) > 100
    np.testing.assert_allclose(slowed["sent_vx"], 0.5 * slowed["smoothed_vx"], atol=1e-12)
    assert set(slowed["source"].tolist()) == {"motion"}


@pytest.mark.slow
def test_a_move_waits_until_the_way_is_free() -> None:
    outcome, rows = run({"move": 2.0}, STOP_AHEAD, box(1.5, 0.0, 1.0, 8.0))
    stopped = held(rows, "stop")
    assert outcome.state == "SUCCEEDED", outcome.message
    assert outcome.figures["driven_m"] == pytest.approx(2.0, abs=0.02)
    assert (stopped["sent_vx"] == 0.0).all()
    assert 5.0 < stopped["t"][-1] - stopped["t"][0] < 7.5
    assert stopped["t"][-1] == pytest.approx(8.0, abs=0.2)


@pytest.mark.slow
def test_a_move_that_waits_too_long_ends_with_its_time_allowance() -> None:
    outcome, rows = run({"move": 2.0}, STOP_AHEAD, box(1.5, 0.0, 1.0))
    assert (outcome.state, outcome.error_name) == ("ABORTED", "TIMEOUT")
    assert "move: drove 0.3" in outcome.message
    assert "within its time allowance" in outcome.message
    assert (held(rows, "stop")["t"][0] < 3.0) and (rows["t"][-1] > 20.0)


@pytest.mark.slow
def test_a_limited_turn_ends_at_its_angle() -> None:
    outcome, rows = run({"turn": "180 deg"}, LIMIT, box(0.0, 0.6))
    assert outcome.state == "SUCCEEDED", outcome.message
    assert outcome.figures["turned_rad"] == pytest.approx(np.pi, abs=0.05)
    limited = held(rows, "limit")
    assert len(limited) > 50
    assert np.abs(limited["sent_wz"]).max() == pytest.approx(0.3)


@pytest.mark.slow
def test_a_round_robot_turns_beside_an_obstacle_in_a_stop_zone() -> None:
    """A turn in place of a circle brings nothing nearer."""
    outcome, rows = run({"turn": "180 deg"}, STOP_AROUND, box(0.35, 0.3, side=0.1))
    assert outcome.state == "SUCCEEDED", outcome.message
    assert not len(held(rows, "stop"))


@pytest.mark.slow
@pytest.mark.parametrize(("end", "state", "error"), [(8.0, "SUCCEEDED", "NONE"), (1e6, "ABORTED", "TIMEOUT")])
def test_a_rectangular_robot_waits_for_a_turn(end: float, state: str, error: str) -> None:
    outcome, rows = run({"turn": "180 deg"}, STOP_AROUND, box(0.35, 0.3, 2.0, end, side=0.1), robot="jackal_dwa")
    assert (outcome.state, outcome.error_name) == (state, error)
    stopped = held(rows, "stop")
    assert (stopped["sent_wz"] == 0.0).all()
    assert stopped["t"][0] == pytest.approx(2.0, abs=0.2)
    assert stopped["t"][-1] == pytest.approx(min(end, float(rows["t"][-1])), abs=0.3)


@pytest.mark.slow
def test_a_trajectory_is_caught_up_with_after_a_stop() -> None:
    outcome, rows = run({"follow": "heart", "size": 1.0, "speed": 0.2}, STOP_AROUND, box(*BESIDE, 3.0, 4.0))
    assert outcome.state == "SUCCEEDED", outcome.message
    assert 10 < len(held(rows, "stop")) < 30


@pytest.mark.slow
def test_a_trajectory_that_the_robot_falls_behind_is_lost() -> None:
    outcome, rows = run({"follow": "heart", "size": 1.0, "speed": 0.2}, STOP_AROUND, box(*BESIDE, 3.0))
    assert (outcome.state, outcome.error_name) == ("ABORTED", "TRACKING_LOST")
    assert "more than max_tracking_error, 0.5 m" in outcome.message
    assert (held(rows, "stop")["sent_vx"] == 0.0).all()
