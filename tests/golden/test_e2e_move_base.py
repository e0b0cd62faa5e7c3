"""The goal manager against the real move_base node: the same statuses, texts, plans, commands and recoveries at the same times.

The other parts are small (a kinematic robot on an empty costmap, a straight planner), so that only the goal manager is
compared. C++ ran on a wall clock with threads: its times are a few milliseconds after their cycle, rarely a whole cycle.
`PERIOD` is the turtlebot's control period.
"""

from __future__ import annotations

import gzip
import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from navstack.behaviors import (
    ClearCostmapRecovery,
    ClearCostmapRecoveryParams,
    RotateRecovery,
    RotateRecoveryParams,
)
from navstack.core import Pose2D, Twist2D
from navstack.move_base import GoalHandle
from tests.conftest import golden_files
from tests.move_base.world import Bench, StraightPlanner, occupied

PERIOD = 0.2
LATE = 0.06
"""Delay of C++ after its cycle (s)."""


def load(file: Path) -> Any:
    with gzip.open(file) as stream:
        return json.load(stream)


def is_case(file: Path, kind: str) -> bool:
    return file.name.startswith(kind)


FILES = golden_files("e2e/*.json.gz")


@pytest.mark.parametrize("file", [f for f in FILES if is_case(f, "preempt")], ids=lambda f: f.name)
def test_a_sequence_of_goals_and_cancels(file: Path) -> None:
    theirs = load(file)
    bench = Bench()
    handles: dict[str, GoalHandle] = {}
    far = [Pose2D(4.0, 4.0, 0.0), Pose2D(-4.0, 2.0, 0.0)]
    for time, what, *rest in theirs:
        if what in ("cmd", "status", "result"):
            continue
        # messages between two cycles arrive between them
        bench.run_to(time - 1e-3)
        bench.robot.advance_to(time)
        bench.move_base.tick(time)
        name = rest[0]
        if what == "send":
            handles[name] = bench.move_base.send_goal(far[len(handles) % 2], goal_id=name, stamp=time)
        elif what == "cancel":
            bench.move_base.cancel_goal(handles[name])
        elif what == "send zero quaternion":
            zero = (0.0, 0.0, 0.0, 0.0)
            handles[name] = bench.move_base.send_goal(far[0], goal_id=name, stamp=time, orientation=zero)
        else:
            assert what == "send goal in base_footprint"
            bench.robot.frames.set_static("base_link", "base_footprint", bench.robot.frames.lookup("map", "map"))
            handles[name] = bench.move_base.send_goal(Pose2D(1.0, 0.0), "base_footprint", goal_id=name, stamp=time)
    last = handles[list(handles)[-1]]
    bench.run(last)

    def status_sequence(name: str) -> list[tuple[str, str]]:
        received = [e for e in bench.listener.of("status") if e.data["id"] == name]
        found = [(e.data["status"], e.data["text"]) for e in received]
        # the node reports a goal that is accepted at once as ACTIVE
        return found[1:] if received[1].time - received[0].time < LATE else found

    for name in handles:
        expected = [(e[3], e[4]) for e in theirs if e[1] == "status" and e[2] == name]
        result = next((e[3], e[4]) for e in theirs if e[1] == "result" and e[2] == name)
        found = status_sequence(name)
        assert [s for s, _ in found] == [s for s, _ in expected], name
        assert found[-1] == result == expected[-1]
        assert [t for _, t in found if t] == [t for _, t in expected if t]
    # times of the statuses; the end of the last goal depends on the local planner
    for time, what, *rest in theirs:
        if what == "status" and (rest[0], rest[1]) != (last.id, "SUCCEEDED"):
            ours = next(
                e.time for e in bench.listener.of("status") if (e.data["id"], e.data["status"]) == (rest[0], rest[1])
            )
            # C++'s clock is slightly later, or one cycle apart
            assert ours == pytest.approx(time, abs=PERIOD + 1e-6), (time, rest)

    # no commands between the end of a goal and the next plan; zero where C++ sends zero
    def commands(events: list[tuple[float, float]], begin: float, end: float) -> list[tuple[float, float]]:
        return [e for e in events if begin - 1e-6 <= e[0] <= end]

    theirs_cmd = [(e[0], abs(e[2]) + abs(e[3])) for e in theirs if e[1] == "cmd"]
    ours_cmd = [(t, abs(c.vx) + abs(c.wz)) for t, c in bench.robot.commands]
    sent = {rest[0]: time for time, what, *rest in theirs if what.startswith("send")}
    ended = {rest[0]: time for time, what, *rest in theirs if what == "result"}
    for name, following in itertools.pairwise(sent):
        stop = ended[name]
        if stop > sent[following]:
            # replaced while driving: the robot keeps its command for one period, then receives one for the new goal
            assert not commands(theirs_cmd, stop, stop + PERIOD / 2)
            swap = bench.listener.of("status")
            accepted = next(e.time for e in swap if (e.data["id"], e.data["status"]) == (following, "ACTIVE"))
            assert not commands(ours_cmd, accepted, accepted + PERIOD / 2)
            assert commands(ours_cmd, accepted + PERIOD - 1e-6, accepted + PERIOD + 1e-6)[0][1] > 0.0
        else:
            quiet = commands(ours_cmd, stop - LATE, sent[following] - LATE)
            assert [c for _, c in quiet if c > 0.0] == []
            assert bench.robot.twist is not None


@pytest.mark.parametrize("file", [f for f in FILES if is_case(f, "unreachable")], ids=lambda f: f.name)
def test_an_unreachable_goal(file: Path) -> None:
    (case,) = load(file)
    spin = RotateRecovery("rotate_recovery", RotateRecoveryParams())
    bench = Bench(
        planner=StraightPlanner(occupied),
        recoveries=[
            ClearCostmapRecovery("conservative_reset", ClearCostmapRecoveryParams()),
            spin,
            ClearCostmapRecovery("aggressive_reset", ClearCostmapRecoveryParams(reset_distance=1.84)),
            spin,
        ],
    )
    handle = bench.run(bench.move_base.send_goal(Pose2D(1.1, -1.3)))
    assert handle.status.name == case["final_state"] == "ABORTED"
    assert handle.text == case["final_text"]
    # two turns, each one step shorter or longer than C++'s (poses of other times)
    slack = 2 * 0.05 + LATE
    assert handle.result.time_s == pytest.approx(case["time"], abs=slack)
    # log messages and their times
    ours = [
        (e.time, e.text)
        for e in bench.listener.events
        if e.kind in ("recovery", "warning") and not e.text.endswith("finished.")
    ]
    assert [text for _, text in ours] == [entry[2] for entry in case["log"]]
    for (time, _), entry in zip(ours, case["log"], strict=True):
        assert time == pytest.approx(entry[0], abs=slack)
    # every plan request
    attempts = [e.time for e in bench.listener.of("plan_failed")]
    assert len(attempts) == len(case["plans"]) == handle.result.data["failed_plans"]
    for time, (theirs, _) in zip(attempts, case["plans"], strict=True):
        assert time == pytest.approx(theirs, abs=slack)
    # every zero velocity; navstack sends one more after each turn (parity 19)
    zeros = [t for t, c in bench.robot.commands if c == Twist2D()]
    finished = [e.time for e in bench.listener.of("recovery") if e.text.endswith("finished.")]
    assert len(finished) == 2
    zeros = [t for t in zeros if t not in finished]
    expected = [t for t, v, w in case["cmd"] if v == 0.0 and w == 0.0]
    assert zeros == pytest.approx(expected, abs=slack)


@pytest.mark.parametrize("file", [f for f in FILES if is_case(f, "three_goals")], ids=lambda f: f.name)
def test_goals_that_are_reached(file: Path) -> None:
    for case in load(file):
        bench = Bench()
        # far enough for the driving time of C++
        x = min(4.8, 0.45 * case["time"])
        handle = bench.run(bench.move_base.send_goal(Pose2D(x, 0.3)))
        assert (handle.status.name, handle.text) == (case["final_state"], case["final_text"])
        assert [e[1] for e in case["status"]] == [e.data["status"] for e in bench.listener.of("status")][1:]
        # zero velocity and a plan immediately, the first command one period later, one plan per second
        assert case["cmd"][0][1:] == [0.0, 0.0]
        assert bench.robot.commands[0] == (0.0, Twist2D())
        assert case["cmd"][1][0] == pytest.approx(bench.robot.commands[1][0], abs=LATE)
        assert bench.robot.commands[1][1] != Twist2D()
        # C++ publishes every plan twice: navfn's plan, and the plan with the goal
        theirs = [t for t, n in case["plans"][::2]]
        ours = [e.time for e in bench.listener.of("plan")]
        assert ours == [float(k) for k in range(len(ours))]
        for mine, yours in zip(ours, theirs, strict=False):
            assert mine == pytest.approx(yours, abs=PERIOD)
        # the last command is zero, in the cycle that detects the goal
        assert bench.robot.commands[-1] == (bench.robot.time, Twist2D())
