"""The goal manager in real time: costmap and commands follow the scans."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Pose2D
from tests.move_base.world import Bench

LATE = 30


def delays(arrivals: Sequence[float]) -> tuple[NDArray[np.float64], list[float]]:
    """Return the times (n, 2) from each scan to its update of the costmap and to the command after that, and the periods (s)."""
    bench = Bench(controller_frequency=10.0)
    bench.move_base.send_goal(Pose2D(30.0, 0.0))
    for arrival in arrivals:
        bench.run_to(arrival)
        bench.move_base.follow_scans(arrival)
    bench.run_to(arrivals[-1] + 1.0)
    commands = [time for time, _ in bench.robot.commands]
    found: list[tuple[float, float]] = []
    for arrival in arrivals:
        update = next(time for time in bench.local_costmap.updates if time >= arrival)
        found.append((update - arrival, next(time for time in commands if time >= update) - arrival))
    return np.array(found), [b - a for a, b in pairwise(commands[10:])]


def test_a_command_follows_each_scan_at_once() -> None:
    found, periods = delays([0.0777 + 0.2 * k for k in range(60)])
    np.testing.assert_allclose(found[5:], np.tile((0.001, 0.002), (55, 1)), atol=1e-6)
    assert periods == pytest.approx([0.1] * len(periods), abs=1e-6)


def test_the_next_command_rests_on_a_late_scan() -> None:
    found, periods = delays([0.0777 + 0.2 * k + (0.03 if k == LATE else 0.0) for k in range(60)])
    others = np.delete(found, LATE, axis=0)[5:]
    np.testing.assert_allclose(others, np.tile((0.001, 0.002), (len(others), 1)), atol=1e-4)
    np.testing.assert_allclose(found[LATE], (0.071, 0.072), atol=1e-4)  # the regular update comes after 0.171 s
    assert periods == pytest.approx([0.1] * len(periods), abs=1e-4)


def test_more_scans_than_updates_cost_no_update() -> None:
    bench = Bench(controller_frequency=20.0)
    bench.move_base.send_goal(Pose2D(30.0, 0.0))
    for k in range(200):
        bench.run_to(0.0777 + 0.05 * k)
        bench.move_base.follow_scans(bench.robot.time)
    assert len(bench.local_costmap.updates) == pytest.approx(50, abs=2)
