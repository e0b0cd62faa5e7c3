"""The record of a running node, without ROS: pieces per goal, the oldest deleted."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Pose2D
from navstack.explain import explain_goal
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.ros_node.live_record import LATEST, LiveRecord
from navstack.sim import World

LOG: Any = SimpleNamespace()
"""Nothing is logged."""


def test_pieces_and_their_rotation(tmp_path: Path) -> None:
    configuration, grid = load_configuration(["turtlebot"]), load_map(map_path("office"))
    robot = simulated_robot(configuration, World(grid), Pose2D(0.8, 7.45))
    record = LiveRecord(tmp_path, 0.2, configuration, grid, robot, name="ros1", log=LOG)
    move_base = build_move_base(configuration, robot, static_map=grid, listeners=[record])

    def run(until: float) -> None:
        while move_base.now < until:
            now = move_base.next_due(move_base.now)
            robot.advance_to(now)
            move_base.tick(now)
            record.tick(move_base)

    run(0.5)
    for x in (1.6, 2.4, 3.2, 4.0):
        handle = move_base.send_goal(Pose2D(x, 7.45))
        while not handle.is_done:
            run(move_base.now + 0.2)
        run(move_base.now + 1.5)
    last = record.save(move_base, wait=True)
    pieces = sorted(file.parent for file in tmp_path.glob("2*/run.npz"))
    # 0.2 MB hold some of the pieces of about 0.07 MB; the newest is always kept
    assert pieces[-1] == last and 2 <= len(pieces) < 5
    assert (tmp_path / LATEST).resolve() == last
    found = Record.load(pieces[-2])
    assert [result["state"] for result in found.results] == ["SUCCEEDED"]
    assert "reached" in explain_goal(found, 1).summary
