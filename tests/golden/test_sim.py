"""The simulator moves as the one that the C++ stack was measured in: `e2e/*.json.gz`, odometry [t, x, y, yaw, v, w].

That one ran on the wall clock: its steps of 20 ms came at uneven times, and some messages were lost. What can be held is how
a step is integrated, how long it is on average, and which velocity it takes.
"""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Footprint, Pose2D, Twist2D
from navstack.sim import SimParams, SimulatedRobot, World
from tests.conftest import golden_files

Array = NDArray[np.float64]


def drives(file: Path) -> list[tuple[Array, Array]]:
    """Odometry and commands [t, v, w] of every goal that moved."""
    goals: Any = json.loads(gzip.decompress(file.read_bytes()))
    found = [g for g in goals if isinstance(g, dict) and len(g.get("odom", ())) > 10]
    return [(np.array(g["odom"]), np.array(g["cmd"])) for g in found]


FILES = [file for file in golden_files("e2e/*.json.gz") if drives(file)]
ROUND = Footprint.from_radius(0.18)


def replayed(odometry: Array) -> Array:
    """Poses of our robot when each step of the log is one of its steps, with the same displacement and rotation."""
    robot = SimulatedRobot(SimParams(lasers=[]), World(), ROUND, Pose2D(*odometry[0, 1:4].tolist()))
    length = np.hypot(*np.diff(odometry[:, 1:3], axis=0).T) * np.where(odometry[1:, 4] < 0, -1.0, 1.0)
    turn = np.diff(np.unwrap(odometry[:, 3]))
    poses = [tuple(robot.pose)]
    for k in range(len(length)):
        robot.command(Twist2D(float(length[k]) * 50.0, 0.0, float(turn[k]) * 50.0))
        robot.advance_to((k + 1) * 0.02)
        poses.append(tuple(robot.pose))
    return np.array(poses)


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.name)
def test_a_step_uses_the_heading_at_its_midpoint(file: Path) -> None:
    """Displacements of the log, summed over a drive, with the heading at the start, the midpoint and the end of each step.

    Positions are rounded to 0.1 mm: n steps sum up to about 0.04 sqrt(n) mm of random error, 2 mm at most here. The other
    two rules are off by dt/2 times the integral of v w, several times as much.
    """
    worst = {0.0: 0.0, 0.5: 0.0, 1.0: 0.0}
    for odometry, _ in drives(file):
        step = np.diff(odometry[:, 1:3], axis=0)
        yaw, turn = odometry[:-1, 3], np.diff(np.unwrap(odometry[:, 3]))
        length = np.hypot(step[:, 0], step[:, 1]) * np.where(odometry[1:, 4] < 0, -1.0, 1.0)
        for share in worst:
            heading = yaw + share * turn
            error = np.cumsum(step - length[:, None] * np.column_stack((np.cos(heading), np.sin(heading))), axis=0)
            worst[share] = max(worst[share], float(np.hypot(error[:, 0], error[:, 1]).max()))
    assert worst[0.5] < 2e-3
    if worst[0.0] > 2e-3:  # it did drive curves
        assert worst[0.5] < 0.35 * min(worst[0.0], worst[1.0])


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.name)
def test_velocities_follow_commands_immediately(file: Path) -> None:
    """No acceleration limit and no lag: every velocity of the log was commanded within 40 ms of its message."""
    for odometry, commands in drives(file):
        known = {(round(v, 3), round(w, 3)) for v, w in commands[:, 1:].tolist()} | {(0.0, 0.0)}
        begun = commands[0, 0]
        velocities = {(round(v, 3), round(w, 3)) for t, *_, v, w in odometry.tolist() if t > begun}
        assert velocities <= known


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=lambda f: f.name)
def test_our_robot_integrates_in_the_same_way(file: Path) -> None:
    """Whole drives end at the same pose within 2 mm, the rounding of the log; measured 1.0, 0.8, 1.6 mm."""
    for odometry, _ in drives(file):
        ours = replayed(odometry)
        assert np.hypot(*(ours[:, :2] - odometry[:, 1:3]).T).max() < 2e-3
        assert np.abs(np.unwrap(ours[:, 2]) - np.unwrap(odometry[:, 3])).max() < 1e-6


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.name)
def test_a_step_takes_20_ms(file: Path) -> None:
    """Rotation divided by angular velocity over the steps without gaps in the log gives the step length within 1 %."""
    for odometry, _ in drives(file):
        turn, w = np.diff(np.unwrap(odometry[:, 3])), odometry[1:, 5]
        sure = (np.abs(w) > 0.1) & (np.diff(odometry[:, 0]) < 0.03) & (np.diff(odometry[:, 0]) > 0.01)
        if sure.sum() > 50:
            assert (turn[sure] / w[sure]).mean() * 50.0 == pytest.approx(1.0, abs=0.01)
