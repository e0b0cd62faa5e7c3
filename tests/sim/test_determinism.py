"""Results are identical to the bit in any process."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import pytest

SCRIPT = """
import hashlib
from navstack.core import Footprint, Pose2D, Twist2D
from navstack.scenario.places import load_places
from navstack.sim import LidarParams, SimParams, SimulatedRobot, World
from tests.test_maps import read

params = SimParams(acc_lim_x=1.0, wheel_slip=0.02, odometry_noise=0.05,
                   sensors={"laser": LidarParams(range_noise=0.01, dropout=0.01)})
discs = [(3.0 + 0.4 * k, 6.9 + 0.3 * (k % 4), 0.02) for k in range(20)]
robot = SimulatedRobot(params, World(read("office"), discs), Footprint.from_radius(0.18), load_places("office").start, seed=7)
digest = hashlib.sha256()
for k in range(100):
    robot.command(Twist2D(0.4, 0.0, 0.3 if k % 7 < 3 else -0.25))
    digest.update(robot.advance_to(0.2 * (k + 1)).tobytes())
    for scan in robot.scans():
        digest.update((scan.ranges if hasattr(scan, "ranges") else scan.points).tobytes())
digest.update(repr(robot.collisions).encode())
print(digest.hexdigest(), len(robot.collisions))
"""


def run(**environment: str) -> str:
    env = {**os.environ, **environment}
    out = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, env=env)
    return out.stdout


@pytest.mark.slow
def test_identical_results_in_any_process() -> None:
    first = run(PYTHONHASHSEED="1")
    assert len(first.split()[0]) == len(hashlib.sha256().hexdigest())
    assert int(first.split()[1]) > 0
    assert run(PYTHONHASHSEED="2") == first
