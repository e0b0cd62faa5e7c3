# pyright: reportUnknownLambdaType=false
"""The parts of the nodes, without a ROS graph: inbox, action, log, parameters, advice for launch files."""

from __future__ import annotations

import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from navstack.cli.app import run
from navstack.core import LogError, NavError, Pose2D
from navstack.move_base import Goal, GoalStatus, MoveBase, SimpleActionServer, goals
from navstack.parameters import load_configuration
from navstack.ros1 import action, parameters, ros
from navstack.ros1.action import ActionInterface
from navstack.ros_messages import messages as msg
from navstack.ros_node import Inbox, NodeLog, line_of
from navstack.ros_node import inbox as inboxes
from navstack.ros_node import log as logs


def _fail(error: NavError) -> None:
    raise error


# --- inbox ------------------------------------------------------------------------------------------------------------


def test_the_inbox_drops_the_oldest_messages() -> None:
    inbox, seen = Inbox(), list[int]()
    for number in range(inboxes.MOST_MESSAGES + 30):
        inbox.post(lambda number=number: seen.append(number))
    while inbox.run(0.0, _fail) == 0.0 and len(seen) < inboxes.MOST_MESSAGES:
        pass
    assert seen == list(range(30, inboxes.MOST_MESSAGES + 30)) and inbox.dropped == 30


def test_a_flooded_topic_drops_only_its_own_messages() -> None:
    inbox, seen = Inbox(), list[Any]()
    flood, rare = inbox.poster(seen.append, most=3), inbox.poster(seen.append)
    rare("first")
    for number in range(10):
        flood(number)
    rare("last")
    inbox.run(0.0, _fail)
    assert seen == ["first", 7, 8, 9, "last"] and inbox.dropped == 7
    flood(11)
    inbox.run(0.0, _fail)
    assert seen[-1] == 11 and inbox.dropped == 7


def test_slow_messages_do_not_keep_a_cycle_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    inbox, clock = Inbox(), SimpleNamespace(now=0.0)
    monkeypatch.setattr(inboxes, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    done: list[int] = []

    def work(number: int) -> None:
        clock.now += 0.02
        done.append(number)

    for number in range(100):
        inbox.poster(work)(number)
    inbox.run(0.0, _fail)
    assert done == [0, 1, 2]
    inbox.run(0.0, _fail)
    assert done == [0, 1, 2, 3, 4, 5]


# --- the action -------------------------------------------------------------------------------------------------------


class _Publisher:
    def __init__(self) -> None:
        self.messages: list[Any] = []

    def publish(self, message: Any) -> None:
        self.messages.append(message)


class _Message(SimpleNamespace):
    """A message with the fields that it is made with; `header` and `status_list` are always there."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(**{"header": SimpleNamespace(stamp=None), "status_list": [], **fields})


class _Cancel(_Message):
    pass


class _Rig:
    """The action between topics and a server of goals, without a graph."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.out: dict[str, _Publisher] = {}
        self.log: list[str] = []
        self.now = 1.0

        def publisher(name: str, *_: Any, **__: Any) -> _Publisher:
            return self.out.setdefault(name, _Publisher())

        def warn(text: str, *values: Any) -> None:
            self.log.append(text % values)

        rospy = SimpleNamespace(
            Publisher=publisher,
            Subscriber=lambda *_, **__: None,
            get_name=lambda: "/move_base",
            has_param=lambda name: False,
            search_param=lambda name: None,
            get_param=lambda name, default=None: default,
            logwarn=warn,
        )
        monkeypatch.setattr(ros, "rospy", lambda: rospy)
        monkeypatch.setattr(ros, "message", lambda name: _Cancel if name == "actionlib_msgs/GoalID" else _Message)
        self.inbox = Inbox()
        clock: Any = SimpleNamespace(
            now=lambda: self.now, ns=lambda time: round(time * 1e9), of=lambda stamp: stamp.time
        )
        build: Any = SimpleNamespace(time=lambda ns: ns)
        self.action = ActionInterface(clock, build, self.inbox)
        self.server = SimpleActionServer(self._on_status)
        self.sent = 0

    def _on_status(self, handle: Any, now: float) -> None:
        text, data = handle.announcement()
        self.action.on_event(cast(Any, SimpleNamespace(kind="status", time=now, data=data, text=text)))

    def connect(self) -> None:
        def send_goal(pose: Pose2D, frame: str, *, orientation: Any, goal_id: str, stamp: float) -> None:
            if goal_id == "wrong":
                raise LogError("wrong")
            self.sent += 1
            self.server.submit(Goal(pose, frame, goal_id, stamp, orientation), 1.0)

        self.action.connect(
            cast(
                MoveBase,
                SimpleNamespace(
                    server=self.server,
                    send_goal=send_goal,
                    goal_handle=None,
                    cancel_goal=lambda name: self.server.cancel(1.0, name),
                    cancel_all_goals=lambda: self.server.cancel(1.0),
                ),
            )
        )

    def goal(self, name: str) -> None:
        position, rotation = SimpleNamespace(x=1.0, y=2.0), SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        target = SimpleNamespace(
            header=SimpleNamespace(frame_id="map"), pose=SimpleNamespace(position=position, orientation=rotation)
        )
        self.action.receive(_Message(goal=SimpleNamespace(target_pose=target), goal_id=_id(name)))

    def results(self) -> dict[str, int]:
        return {m.status.goal_id.id: m.status.status for m in self.out["move_base/result"].messages}


def _id(name: str) -> _Cancel:
    return _Cancel(id=name, stamp=SimpleNamespace(is_zero=lambda: True, time=0.0))


def test_goals_before_the_start_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """In their order with the cancels; one that is not valid does not cost the others."""
    rig = _Rig(monkeypatch)
    rig.goal("first")
    rig.action.receive(_id("first"))
    rig.goal("wrong")
    rig.goal("second")
    rig.inbox.run(0.0, _fail)
    assert rig.server.next is None and not rig.out["move_base/status"].messages
    rig.connect()
    problems: list[NavError] = []
    rig.inbox.run(0.0, problems.append)
    assert rig.server.next is not None and rig.server.next.id == "second" and len(problems) == 1
    assert rig.results() == {"first": GoalStatus.RECALLED}


def test_a_flood_of_goals(monkeypatch: pytest.MonkeyPatch) -> None:
    """The newest wins, each of the others has its result, and what is published grows with their number, not its square."""
    rig = _Rig(monkeypatch)
    rig.connect()
    rig.inbox.run(0.0, _fail)
    count = 1762
    for number in range(count):
        rig.goal(f"goal_{number}")
    rig.inbox.run(0.0, _fail)
    assert rig.sent == action.QUEUE
    assert rig.server.next is not None and rig.server.next.id == f"goal_{count - 1}"
    for _ in range(count):
        rig.action.publish(1.0)
    assert rig.results() == {f"goal_{number}": GoalStatus.RECALLED for number in range(count - 1)}
    listed = sum(len(message.status_list) for message in rig.out["move_base/status"].messages)
    assert listed < 30 * action.QUEUE
    assert rig.log == [f"{count} goals at once: the newest {action.QUEUE} are looked at, the others are recalled"]
    for _ in range(3):  # a flood that goes on is not a warning per cycle
        for number in range(2 * action.QUEUE):
            rig.goal(f"later_{number}")
        rig.inbox.run(0.0, _fail)
    assert len(rig.log) == 1
    rig.now = 1.0 + action.WARNING_PERIOD_S
    for number in range(2 * action.QUEUE):
        rig.goal(f"last_{number}")
    rig.inbox.run(0.0, _fail)
    assert len(rig.log) == 2


def test_the_status_list_is_bounded() -> None:
    server = SimpleActionServer()
    for number in range(1000):
        server.submit(Goal(Pose2D(0.0, 0.0), "map", f"goal_{number}", 1.0), 1.0)
    assert len(server.statuses()) <= goals.MOST_ENDED + 2
    assert server.next is not None and server.next.id == "goal_999"


# --- maps and scans ---------------------------------------------------------------------------------------------------


def _map(*orientation: float) -> Any:
    x, y, z, w = orientation
    origin = SimpleNamespace(
        position=SimpleNamespace(x=-1.0, y=2.0, z=0.0), orientation=SimpleNamespace(x=x, y=y, z=z, w=w)
    )
    info = SimpleNamespace(width=3, height=2, resolution=0.05, origin=origin)
    return SimpleNamespace(info=info, data=[0] * 6, header=SimpleNamespace(frame_id="map"))


def test_a_map_without_an_orientation() -> None:
    notes: list[str] = []
    grid = msg.map_of(_map(0.0, 0.0, 0.0, 0.0), "/robot/map", notes.append)
    assert (grid.geometry.origin_x, grid.geometry.origin_y, grid.origin_yaw) == (-1.0, 2.0, 0.0)
    assert len(notes) == 1 and "the map of 3 x 2 cells on /robot/map has the orientation (0, 0, 0, 0)" in notes[0]
    assert msg.map_of(_map(0.0, 0.0, 1.0, 0.0), "map", notes.append).origin_yaw == pytest.approx(np.pi)
    assert len(notes) == 1
    with pytest.raises(LogError, match="not a rotation"):
        msg.map_of(_map(0.0, 0.0, float("nan"), 0.0))


def test_ranges_of_a_scan_can_be_written() -> None:
    """rospy's arrays are views of the bytes that have arrived; kernels are compiled for arrays of their own."""
    ranges = np.frombuffer(np.ones(100_000, np.float32).tobytes(), np.float32)
    header = SimpleNamespace(frame_id="laser")
    scan = SimpleNamespace(
        ranges=ranges, angle_min=0.0, angle_increment=1e-5, range_min=0.1, range_max=9.0, header=header
    )
    found = msg.scan_of(scan, "scan", 0.0, height=0.2, upside_down=False).ranges
    assert found.flags.writeable and found.dtype == np.float32 and len(found) == 100_000


# --- log --------------------------------------------------------------------------------------------------------------


def test_names_in_the_log_are_escaped(caplog: pytest.LogCaptureFixture) -> None:
    name = "odom\n[FATAL] [1.0]: all is lost\x1b[2J\u202e"
    lines: list[str] = []
    sink: Any = SimpleNamespace(logwarn=lambda text, *values: lines.append(text % values))
    log = NodeLog(sink, str)
    log.problem(f'the transform from "{name}" is not finite')
    log.finish()
    assert lines == ['the transform from "odom\\n[FATAL] [1.0]: all is lost\\x1b[2J\\u202e" is not finite']
    assert len(line_of("x" * 100_000)) == logs.LONGEST_LINE
    logger = logging.getLogger("rosout")
    before = list(logger.filters)
    ros.escape_log()
    try:
        logger.warning('initialpose is in "%s"', name)
    finally:
        logger.filters[:] = before
    assert "\n" not in caplog.messages[-1] and "\\n[FATAL]" in caplog.messages[-1]


# --- parameters -------------------------------------------------------------------------------------------------------


class _Server:
    """A parameter server with the private names of one node."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, values: dict[str, Any]) -> None:
        self.values, self.log = values, list[str]()
        monkeypatch.setattr(ros, "rospy", lambda: self)

    def get_param(self, name: str, default: Any = None) -> Any:
        return self.values if name == "~" else self.values.get(name.removeprefix("~"), default)

    def resolve_name(self, name: str) -> str:
        return name.replace("~", "/sim/")

    def search_param(self, name: str) -> None:
        del name

    def logwarn(self, text: str, *values: Any) -> None:
        self.log.append(text % values)

    loginfo = logwarn


def test_a_value_that_is_left_over_is_named(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    _Server(monkeypatch, {"localization": False})
    caplog.set_level(logging.INFO, ros.LOGGER)
    monkeypatch.setattr("sys.argv", ["navstack"])
    assert not parameters.flag("localization", True)
    assert caplog.messages == [
        (
            "/sim/localization is False, not the default True: a launch file or an earlier start has set it; rosparam delete "
            "/sim/localization removes it"
        )
    ]
    monkeypatch.setattr("sys.argv", ["navstack", "_localization:=false"])
    assert not parameters.flag("localization", True) and parameters.flag("other", True) and len(caplog.messages) == 1


FILE = {
    "base_local_planner": "dwa_local_planner/DWAPlannerROS",
    "DWAPlannerROS": {"acc_lim_th": 2.5, "max_trans_vel": 0.3},
}


def _second_start(monkeypatch: pytest.MonkeyPatch, server: dict[str, Any], **changes: Any) -> tuple[list[str], Any]:
    """Return the warnings about names, and the planner's parameters, of a start after one that has written to the server."""
    first = load_configuration([FILE])
    now = first.local_planner.params.model_dump()
    written = {**server, "acc_lim_theta": now["acc_lim_theta"], "max_vel_trans": now["max_vel_trans"], **changes}
    _Server(
        monkeypatch,
        {
            "base_local_planner": FILE["base_local_planner"],
            "DWAPlannerROS": written,
            parameters.WRITTEN: parameters.renamed(first),
        },
    )
    sources: Any = [] if server else [FILE]
    second = parameters.load(sources)
    found = [item.message for item in second.findings if item.rule == "renamed" and item.severity == "warning"]
    return found, second.local_planner.params


def test_a_second_start_reports_no_former_names(monkeypatch: pytest.MonkeyPatch) -> None:
    of_file = dict(cast("dict[str, Any]", FILE["DWAPlannerROS"]))
    found, params = _second_start(monkeypatch, of_file)
    assert not found and (params.acc_lim_theta, params.max_vel_trans) == (2.5, 0.3)
    # changed while it ran: counts as set
    found, params = _second_start(monkeypatch, of_file, acc_lim_theta=1.5)
    assert not found and params.acc_lim_theta == 1.5
    # loaded again with another value
    found, params = _second_start(monkeypatch, {**of_file, "acc_lim_th": 0.7})
    assert not found and params.acc_lim_theta == 0.7
    # by --params: the file counts
    found, params = _second_start(monkeypatch, {}, acc_lim_theta=1.5)
    assert not found and (params.acc_lim_theta, params.max_vel_trans) == (2.5, 0.3)
    # both names in a file
    both = load_configuration([{**FILE, "DWAPlannerROS": {**of_file, "acc_lim_theta": 1.0}}])
    assert [i.severity for i in both.findings if i.rule == "renamed" and "acc_lim_th " in i.message] == ["warning"]


# --- launch files -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", ["global", "node", "group"])
def test_a_launch_file_that_needs_xacro_cannot_just_stay(
    place: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command = """<param name="robot_description" command="$(find xacro)/xacro --inorder robot.urdf.xacro"/>"""
    body = {
        "global": f"{command}\n<node pkg='move_base' type='move_base' name='nav'/>",
        "node": f"<node pkg='move_base' type='move_base' name='nav'>{command}</node>",
        "group": f"<group>{command}</group>\n<node pkg='move_base' type='move_base' name='nav'/>",
    }[place]
    file = tmp_path / "robot.launch"
    file.write_text(f"<launch>\n{body}\n</launch>\n")
    assert run(["ros1", "install", "--launch", str(file)]) == 0
    text = capfd.readouterr().out
    assert "roslaunch needs the package xacro for it" in text
    assert "ROS_PACKAGE_PATH, and xacro, the file can also stay" in text
