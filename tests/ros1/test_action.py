"""The action over ROS against the recorded real move_base: statuses, texts, feedback, plans and recoveries; and faults."""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from navstack.map_io import load_map, map_path
from navstack.move_base import GoalStatus, goals, states
from tests.conftest import golden_files
from tests.ros1.conftest import Graph, new_graph, paced, wait_for
from tests.ros1.rig import Event, Rig, rest_after

PERIOD = 0.2
"""Control period of the recording and of the packaged turtlebot (s)."""
RECOVERIES = """
recovery_behaviors:
  - {name: conservative_reset, type: clear_costmap_recovery/ClearCostmapRecovery}
  - {name: rotate_recovery, type: rotate_recovery/RotateRecovery}
  - {name: aggressive_reset, type: clear_costmap_recovery/ClearCostmapRecovery}
  - {name: second_rotate_recovery, type: rotate_recovery/RotateRecovery}
conservative_reset: {reset_distance: 3.0, layer_names: [obstacle_layer]}
aggressive_reset: {reset_distance: 1.84, layer_names: [obstacle_layer]}
"""
"""The list of the recording; its last behavior has the name of the second there."""
FAR, BACK = (11.0, 7.4), (1.2, 7.45)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """The packaged turtlebot in the office, six times as fast as real time, behind a probe."""
    graph: Graph = new_graph(tmp_path_factory.mktemp("rig"))
    rig = Rig(graph)
    try:
        pace = paced(6)
        rig.start_sim("office", "--clock", "--speed", pace)
        rig.start_probe()
        # limits in wall time: a stop is reported with its cause if it follows within 0.6 s, and a busy machine delays messages
        limits = {
            "local_costmap/obstacle_layer/scan/expected_update_rate": max(0.55, 0.5 * float(pace)),
            "local_costmap/transform_tolerance": max(0.4, 0.35 * float(pace)),
            "global_costmap/transform_tolerance": max(0.4, 0.35 * float(pace)),
        }
        settings = [part for name, value in limits.items() for part in ("--set", f"{name}={value:.2f}")]
        recoveries = graph.folder / "recoveries.yaml"
        recoveries.write_text(RECOVERIES)
        rig.start_node("--params", "turtlebot", "--params", str(recoveries), *settings)
        yield rig
    finally:
        rig.close()
        graph.close()


def recorded(name: str) -> Any:
    """Return a recording of the real move_base."""
    (file,) = golden_files(f"e2e/{name}.json.gz")[:1]
    with gzip.open(file) as stream:
        return json.load(stream)


def changes(events: list[Event]) -> list[tuple[str, str, str]]:
    """Return (goal, status, text) at each change of a status; PENDING, which only a regular status shows, is left out."""
    last: dict[str, tuple[int, str]] = {}
    found: list[tuple[str, str, str]] = []
    for event in events:
        for name, status, text in event["goals"] if event["what"] == "status" else ():
            if last.get(name) != (status, text):
                last[name] = status, text
                found.append((name, GoalStatus(status).name, text))
    return [change for change in found if change[1] != "PENDING"]


def own(found: list[tuple[str, str, str]], names: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    return [change for change in found if change[0] in names]


def result_of(rig: Rig, name: str) -> tuple[str, str]:
    """Wait for the result of a goal."""
    found = rig.wait(lambda e: e["what"] == "result" and e["id"] == name, f"the end of {name}")
    return GoalStatus(found["status"]).name, found["text"]


def test_the_recorded_goals_and_cancels(rig: Rig) -> None:
    theirs = recorded("preempt")
    begin, mark = rig.now() + 1.0, len(rig.take())
    goals: dict[str, tuple[float, float]] = {}
    for time, what, *rest in theirs:
        name, at = str(rest[0]), begin + time
        if what == "cancel":
            rig.do("cancel", id=name, at=at)
        elif what.startswith("send"):
            goals[name] = (FAR, BACK)[len(goals) % 2]
            data: dict[str, Any] = {"id": name, "at": at}
            if "quaternion" in what:
                data["q"] = (0.0, 0.0, 0.0, 0.0)
            elif "base_footprint" in what:
                goals[name], data["frame"] = (1.0, 0.0), "base_footprint"
            rig.send_goal(*goals[name], **data)
    assert result_of(rig, "D") == next((e[3], e[4]) for e in theirs if e[1:3] == ["result", "D"])
    rig.wait(lambda e: e["what"] == "status" and any(g[:2] == ["D", 3] for g in e["goals"]), "the last status")
    events = rig.take()[mark:]
    assert own(changes(events), goals) == [tuple(e[2:5]) for e in theirs if e[1] == "status" and e[3] != "PENDING"]
    results = [(e["id"], GoalStatus(e["status"]).name, e["text"]) for e in events if e["what"] == "result"]
    assert results == [tuple(e[2:5]) for e in theirs if e[1] == "result"]
    # feedback: once per control cycle, in the global frame
    feedback = [e for e in events if e["what"] == "feedback"]
    assert {e["frame"] for e in feedback} == {"map"}
    stamps = np.array([e["stamp"] for e in feedback if e["id"] == "A"])
    commands = [e["now"] for e in events if e["what"] == "cmd" and stamps[0] <= e["now"] <= stamps[-1] + PERIOD]
    assert len(commands) == pytest.approx(len(stamps), abs=2)
    assert np.median(np.diff(stamps)) > PERIOD - 0.03  # cycles of a busy machine are longer
    # the goal before the robot is transformed; each goal is published once when it is accepted, an invalid one never
    published = [(e["frame"], e["x"]) for e in events if e["what"] == "current_goal"]
    assert [frame for frame, _ in published] == ["map"] * 3
    assert published[0][1] == pytest.approx(FAR[0]) and published[1][1] == pytest.approx(BACK[0])


def test_the_recorded_unreachable_goal(rig: Rig) -> None:
    (theirs,) = recorded("unreachable_asloaded")
    grid = load_map(map_path("office"))
    iy, ix = np.argwhere(grid.data == 100)[len(np.argwhere(grid.data == 100)) // 2]
    mark = len(rig.take())
    rig.send_goal(*grid.geometry.cell_to_world(int(ix), int(iy)), id="wall")
    assert result_of(rig, "wall") == (theirs["final_state"], theirs["final_text"])
    rig.do("nothing", at=rig.now() + 2.0)
    events = rig.take()[mark:]
    wall = [(status, text) for name, status, text in changes(events) if name == "wall"]
    assert [status for status, _ in wall] == [status for _, status in theirs["status"]]
    recoveries = [(e["name"], e["index"], e["total"]) for e in events if e["what"] == "recovery"]
    names = ["conservative_reset", "rotate_recovery", "aggressive_reset", "second_rotate_recovery"]
    assert recoveries == [(name, i, 4) for i, name in enumerate(names)]
    log = [e["text"] for e in events if e["what"] == "log"]
    wanted = [text for _, _, text in theirs["log"]]
    assert [text for text in log if text in wanted] == wanted
    # every attempt is published as an empty path, and feedback pauses during recoveries
    attempts = [e["poses"] for e in events if e["what"] == "plan"]
    assert set(attempts) == {0}
    assert len(attempts) == pytest.approx(len(theirs["plans"]), rel=0.15)
    assert len([e for e in events if e["what"] == "feedback"]) == pytest.approx(theirs["feedback"], rel=0.15)


def test_cancels_and_goals_that_are_not_taken(rig: Rig) -> None:
    def active(name: str) -> None:
        rig.wait(
            lambda e: e["what"] == "status" and any(g[0] == name and g[1] == 1 for g in e["goals"]), f"{name} active"
        )

    rig.send_goal(*FAR, id="by id")
    active("by id")
    rig.do("cancel", id="another")
    rig.do("nothing", at=rig.now() + 2.0)  # two topics: the order of arrival is not that of sending
    rig.send_goal(*FAR, id="another")
    assert result_of(rig, "another") == ("RECALLED", "")
    # an older goal does not replace a newer one
    rig.send_goal(*FAR, id="older", stamp=1.0)
    assert result_of(rig, "older") == ("RECALLED", goals.REPLACED)
    rig.do("cancel", id="by id")
    assert result_of(rig, "by id") == ("PREEMPTED", "")
    for name in ("all", "all of the shell"):
        rig.send_goal(*FAR, id=name)
        active(name)
        rig.do("cancel")
        assert result_of(rig, name) == ("PREEMPTED", "")
    rig.send_goal(*FAR, id="by stamp")
    active("by stamp")
    until = rig.now() + 1.0
    rig.do("cancel", stamp=until)
    assert result_of(rig, "by stamp") == ("PREEMPTED", "")
    rig.send_goal(*FAR, id="stamped before", stamp=until - 0.5)
    assert result_of(rig, "stamped before") == ("RECALLED", goals.CANCELED_BEFORE)
    rig.do("nothing", at=until + 0.1)
    half = math.sqrt(0.5)
    for number, q in enumerate([(math.nan, 0.0, 0.0, 1.0), (half, 0.0, 0.0, half), (0.0, half, 0.0, half)]):
        rig.send_goal(*FAR, id=f"tilted {number}", q=q)
        assert result_of(rig, f"tilted {number}") == ("ABORTED", states.BAD_QUATERNION)


def test_faults_stop_the_robot_with_one_line(rig: Rig) -> None:
    """The short faults of tools/ros1_faults.py, which has the long ones."""
    for topic, mode, said in (
        ("tf", "stop", " s old at "),
        ("scan", "stop", "newest data: scan"),
        ("scan", "nan", " are valid (from range_min"),
        ("odom", "nan", "is not finite"),
    ):
        mark = len(rig.take())
        at_x = next((e["x"] for e in reversed(rig.take()) if e["what"] == "truth"), 0.8)
        rig.send_goal(*(BACK if at_x > 6.0 else FAR), id=f"{topic} {mode}")
        rig.wait_for_motion(0.3, since=mark)
        begin = rig.request("mode", topic=topic, mode=mode)
        heard = len(rig.take())
        rig.wait(lambda e: e["what"] == "log" and e["level"] >= 4, f"a line about {topic}", since=heard)
        rig.do("nothing", at=rig.now() + 2.0)
        assert math.isfinite(rest_after(rig, begin)), (topic, mode)
        usual = ("Aborting", "Clearing", "Rotate")  # recoveries that follow
        lines = [line for line in rig.warnings(begin) if not line.startswith(usual)]
        assert len(lines) == 1, lines
        assert said in lines[0]
        rig.request("mode", topic=topic, mode="pass")
        mark = len(rig.take())
        rig.send_goal(*(BACK if at_x > 6.0 else FAR), id=f"{topic} {mode}, after")  # the goal may have been aborted
        rig.wait_for_motion(0.2, since=mark)
        rig.do("cancel")
        rig.do("nothing", at=rig.now() + 6.0 * 2.1)  # a fault that was absent for 2 s of wall time is a new one


def test_a_new_master_finds_the_node(rig: Rig) -> None:
    graph = rig.graph
    assert rig.node is not None
    graph.master.kill()
    graph.master.wait()
    graph.start_master()

    assert rig.sim is not None
    for program in (rig.node, rig.sim):
        log = graph.log_of(program)
        wait_for(lambda log=log: "registered there now" in log.read_text(), "the registration at the new master")
    services = graph.run("/usr/bin/rosservice", "list").split()
    assert "/move_base/make_plan" in services and "/reset_positions" in services
