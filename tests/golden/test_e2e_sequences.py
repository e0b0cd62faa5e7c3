"""docs/parity/end_to_end.md: the recorded runs of the real move_base node against navstack with the real parts.

The document lists every difference with its number in the parity list; these tests show that there are no others.
"""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path
from typing import Any

import pytest

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Event, Pose2D, Twist2D
from navstack.map_io import load_map
from navstack.move_base import GoalHandle, MoveBase
from navstack.parameters import load_configuration
from navstack.sim import SimulatedRobot

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "parity" / "end_to_end.md"
WILLOW = "maps/turtlebot_apps__willow-2010-02-18-0.10/willow-2010-02-18-0.10.yaml"
STEP = 0.02
"""Step of the simulated world (s): a message at 6.004 s arrives at 6.02 s."""


class Turtlebot:
    """The real parts on the map of Willow Garage, with the turtlebot's own YAML."""

    def __init__(self, data: Path) -> None:
        grid = load_map(data / WILLOW)
        configuration = load_configuration([data / "params/turtlebot2/param"])
        self.robot: SimulatedRobot = simulated_robot(configuration, grid, Pose2D(29.75, 7.95, 0.0))
        self.events: list[Event] = []
        self.move_base: MoveBase = build_move_base(configuration, self.robot, static_map=grid, listeners=[self])
        self.commands: list[tuple[float, Twist2D]] = []
        command = self.robot.command

        def taken(twist: Twist2D) -> None:
            self.commands.append((self.robot.time, twist))
            command(twist)

        self.robot.command = taken  # type: ignore[method-assign]

    def on_event(self, event: Event) -> None:
        self.events.append(event)

    def tick(self) -> None:
        self.robot.advance_to(self.move_base.next_due(self.robot.time))
        self.move_base.tick(self.robot.time)

    def run_to(self, time: float) -> None:
        while self.move_base.next_due(self.robot.time) <= time:
            self.tick()
        self.robot.advance_to(time)
        self.move_base.tick(self.robot.time)

    def run(self, handle: GoalHandle) -> GoalHandle:
        while not handle.is_done:
            self.tick()
            assert self.robot.time < 120.0
        return handle


def theirs(folder: Path, name: str) -> Any:
    with gzip.open(folder / "e2e" / f"{name}.json.gz") as file:
        return json.load(file)


def written(heading: str) -> list[list[str]]:
    """Return the rows of the table below a heading of the document."""
    section = DOCUMENT.read_text(encoding="utf-8").split(f"## {heading}\n")[1].split("\n## ")[0]
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in section.splitlines() if line.startswith("|")]
    return rows[2:]


def seconds(cell: str) -> float:
    found = re.match(r"[\d.]+", cell)
    assert found, cell
    return float(found[0])


def test_an_unreachable_goal(golden_dir: Path, data_dir: Path) -> None:
    (case,) = theirs(golden_dir, "unreachable_asloaded")
    turtlebot = Turtlebot(data_dir)
    x, y, yaw, _ = case["goal"]
    handle = turtlebot.run(turtlebot.move_base.send_goal(Pose2D(x, y, yaw)))
    assert (handle.status.name, handle.text) == (case["final_state"], case["final_text"])
    messages = [(e.time, e.text) for e in turtlebot.events if e.kind in ("recovery", "warning")]
    ended = [time for time, text in messages if text == "Rotate recovery behavior finished."]  # navstack only
    messages = [entry for entry in messages if not entry[1].endswith("finished.")]
    # the same messages in the same order at the same times; parity 21: another square
    assert [text.replace("0.86m", "1.84m") for _, text in messages] == [entry[2] for entry in case["log"]]
    assert [time for time, _ in messages] == pytest.approx([entry[0] for entry in case["log"]], abs=0.05)
    # the same number of plan requests at the same times, all without a path
    tries = [e.time for e in turtlebot.events if e.kind == "plan_failed"]
    assert tries == pytest.approx([entry[0] for entry in case["plans"]], abs=0.05)
    # the same zero velocities; parity 19: one more at the end of each turn
    zeros = [time for time, twist in turtlebot.commands if twist == Twist2D()]
    assert [t for t in zeros if t in ended] == ended
    expected = [t for t, v, w in case["cmd"] if v == 0.0 and w == 0.0]
    assert [t for t in zeros if t not in ended] == pytest.approx(expected, abs=0.05)
    # and the document lists them
    rows = written("Unreachable goal")
    assert [seconds(row[1]) for row in rows] == pytest.approx([0.0, *(entry[0] for entry in case["log"])], abs=0.001)
    assert [seconds(row[2]) for row in rows] == pytest.approx([0.0, *(time for time, _ in messages)], abs=0.03)


def test_preempt_cancel_bad_quaternion_another_frame(golden_dir: Path, data_dir: Path) -> None:
    events = theirs(golden_dir, "preempt")
    turtlebot = Turtlebot(data_dir)
    manager = turtlebot.move_base
    far = {"A": Pose2D(27.35, 10.55, 1.57), "B": Pose2D(34.45, 15.25, 0.0)}
    handles: dict[str, GoalHandle] = {}
    for time, what, name, *_ in (e for e in events if e[1].startswith(("send", "cancel"))):
        turtlebot.run_to(time)
        if what == "cancel":
            manager.cancel_goal(handles[name])
        elif what == "send zero quaternion":
            handles[name] = manager.send_goal(far["B"], goal_id=name, orientation=(0.0, 0.0, 0.0, 0.0))
        elif what == "send goal in base_footprint":
            handles[name] = manager.send_goal(Pose2D(1.0, 0.0), "base_footprint", goal_id=name)
        else:
            handles[name] = manager.send_goal(far[name], goal_id=name)
    turtlebot.run(handles["D"])
    ours = [(e.time, e.data["id"], e.data["status"], e.data["text"]) for e in turtlebot.events if e.kind == "status"]
    # the node does not publish PENDING for a goal that is accepted at once
    shown = {(e[2], e[3]) for e in events if e[1] == "status"}
    ours = [entry for entry in ours if entry[2] != "PENDING" or entry[1:3] in shown]
    expected = [(e[0], *e[2:]) for e in events if e[1] == "status"]
    assert sorted(e[1:3] for e in ours) == sorted(e[1:3] for e in expected)
    for name in handles:
        assert [e[2:] for e in ours if e[1] == name] == [e[2:] for e in expected if e[1] == name]
    times = {e[1:3]: e[0] for e in ours}
    for time, name, status, _ in expected:
        if (name, status) != ("D", "SUCCEEDED"):  # its duration depends on the planners
            assert times[name, status] == pytest.approx(time, abs=0.07)
    rows = written("Preempt, cancel, zero quaternion, another frame")
    listed = [(row[0].split()[0], row[0].split()[1]) for row in rows]
    assert listed == [(name, status) for _, name, status, _ in expected]
    for row, (time, name, status, _) in zip(rows, expected, strict=True):
        assert seconds(row[1]) == pytest.approx(time, abs=0.001)
        assert seconds(row[2]) == pytest.approx(times[name, status], abs=0.03 if name != "D" else 1.0)
