"""The nodes that tutorials rely on: moves, turns, initial pose, teleop, timed trajectories, against the simulated robot."""

from __future__ import annotations

import json
import math
import os
import pty
import signal
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.behaviors import poly_path
from navstack.core import InputError, Pose2D, RobotState
from navstack.plugins import BehaviorStatus
from navstack.ros1 import motion_nodes, parameters, ros, static_transform
from navstack.ros1.open_motion import NO_CONTEXT, Damping, Settings, shorter
from navstack.ros1.tour import Score, cut
from navstack.ros1.trajectories import without
from navstack.ros_messages import Transform3D
from navstack.ros_node import NodeClock
from tests.ros1.conftest import PYTHON, TIMEOUT_S, paced, wait_for
from tests.ros1.module_graph import ModuleGraph, module_graph

VELOCITY = "/mobile_base/mobile_base_controller/cmd_vel"
OBSERVER = """
import json, signal, sys, rospy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from nav_msgs.msg import Odometry
from trajectory_msgs.msg import MultiDOFJointTrajectory
rospy.init_node("observer", disable_signals=True)
seen = {"twists": [], "truth": [], "initialpose": [], "trajectory": []}
def twist(m):
    seen["twists"].append([rospy.get_time(), m.linear.x, m.linear.y, m.linear.z, m.angular.z])
def truth(m):
    p, q = m.pose.pose.position, m.pose.pose.orientation
    seen["truth"].append([m.header.stamp.to_sec(), p.x, p.y, q.z, q.w])
def initial(m):
    p = m.pose.pose
    seen["initialpose"].append([m.header.frame_id, m.header.stamp.to_sec() > 0, p.position.x, p.position.y, p.orientation.z,
        list(m.pose.covariance)])
def trajectory(m):
    seen["trajectory"].append([m.header.frame_id, m.joint_names, [
        [p.time_from_start.to_sec(), *[getattr(v, a) for v in
          (p.transforms[0].translation, p.velocities[0].linear, p.accelerations[0].linear) for a in "xyz"],
         p.transforms[0].rotation.w] for p in m.points]])
kept = [rospy.Subscriber(sys.argv[1], Twist, twist), rospy.Subscriber("/base_pose_ground_truth", Odometry, truth),
    rospy.Subscriber("/initialpose", PoseWithCovarianceStamped, initial),
    rospy.Subscriber("/command/trajectory", MultiDOFJointTrajectory, trajectory)]
def write(*_):
    with open(sys.argv[2] + ".new", "w") as out:
        json.dump(seen, out)
    import os
    os.rename(sys.argv[2] + ".new", sys.argv[2])
signal.signal(signal.SIGUSR1, write)
open(sys.argv[2] + ".ready", "w").close()
while True:
    rospy.rostime.wallsleep(0.1)
"""
CALLER = """
import sys
from navstack.ros1 import ros
rospy = ros.rospy()
rospy.init_node("caller", disable_signals=True)
rospy.wait_for_service("/move_distance")
rospy.wait_for_service("/turn_radian")
move = rospy.ServiceProxy("/move_distance", ros.message("handsfree_msgs/srv/SpecialMove"))
turn = rospy.ServiceProxy("/turn_radian", ros.message("handsfree_msgs/srv/SpecialTurn"))
print([move(target_distance_move=-0.3).success, turn(target_radian_turn=-1.0).success, turn(6.28).success,
    move(float("nan")).success, move(0.0).success])
"""


class Robot:
    """A graph with the simulated robot and an observer."""

    def __init__(self, graph: ModuleGraph) -> None:
        self.graph = graph
        self._out = graph.folder / "observed.json"
        graph.node("sim", "office", "--clock", "--speed", paced(4))
        self._observer = graph.start(PYTHON, "-c", OBSERVER, VELOCITY, str(self._out))
        ready = self._out.with_name("observed.json.ready")
        for name in ("linear_move", "radian_turn"):
            graph.node(name, "--service", "--name", f"{name}_server")
        self.lost = graph.node("linear_move", "_base_frame:=nowhere", "--name", "lost")
        wait_for(
            lambda: ready.exists() and "/navstack_sim" in graph.run("/usr/bin/rosnode", "list"), "the start", 240.0
        )
        wait_for(lambda: self.observed()["truth"], "the first pose", 240.0)

    def run(self, *arguments: str, code: int = 0) -> str:
        """Run a command of `navstack ros1` to its end; return its output."""
        return self.graph.run_node(*arguments, code=code)

    def observed(self) -> dict[str, Any]:
        """Return what the observer has seen so far."""
        self._out.unlink(missing_ok=True)
        self._observer.send_signal(signal.SIGUSR1)
        wait_for(self._out.exists, "the observer's answer")
        return json.loads(self._out.read_text())


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with module_graph(tmp_path_factory.mktemp("helpers")) as graph:
        yield Robot(graph)


def _yaw(row: list[float]) -> float:
    return 2.0 * math.atan2(row[3], row[4])


def test_linear_move(robot: Robot) -> None:
    """Defaults of the page: topic, frames with a slash, speeds, tolerances; constant speed, zero at the end."""
    before = wait_for(lambda: (seen := robot.observed())["truth"] and seen, "the true pose")
    assert "LinearMove: drove 0.3" in robot.run("linear_move", "_t_dis:=0.4", "__name:=mover")
    seen = robot.observed()
    moved, first = seen["twists"][len(before["twists"]) :], seen["truth"][-1]
    assert {tuple(t[2:]) for t in moved} == {(0.0, 0.0, 0.0)}
    speeds = [t[1] for t in moved]
    assert set(speeds) == {0.1, 0.0} and speeds[-1] == 0.0 and speeds[0] == 0.1
    # within the tolerance and one cycle (0.01 m), and what a command that is late by 0.2 s of simulated time adds
    assert 0.4 - 0.08 - 1e-6 <= math.dist(first[1:3], before["truth"][-1][1:3]) <= 0.4


def test_services_and_initial_pose(robot: Robot) -> None:
    robot.run("initial_pose", "0.8,7.45,0.5", "--name", "poser")
    before = robot.observed()
    frame, has_stamp, x, y, z, covariance = before["initialpose"][-1]
    assert (frame, has_stamp, x, y) == ("map", True, 0.8, 7.45) and z == pytest.approx(math.sin(0.25))
    assert {k: v for k, v in enumerate(covariance) if v} == {0: 0.25, 7: 0.25, 35: 0.06853891945200942}
    caller = robot.graph.start(sys.executable, "-c", CALLER, **robot.graph.own)
    assert caller.wait(TIMEOUT_S) == 0, robot.graph.output_of(caller)
    assert robot.graph.output_of(caller).strip().endswith("[True, True, True, False, True]")
    seen = robot.observed()
    after, commands = seen["truth"][-1], [t[1:] for t in seen["twists"][len(before["twists"]) :]]
    # a turn begins with a stop, every motion ends with one; nothing but these is commanded
    turns = [c for c in commands if c[3] != 0.0]
    assert min(t[3] for t in turns) == -0.436 and {tuple(t[:3]) for t in turns} == {(0.0, 0.0, 0.0)}
    assert {c[0] for c in commands if c not in turns} == {0.0, -0.1}
    assert commands[commands.index(turns[0]) - 1] == commands[-1] == [0.0, 0.0, 0.0, 0.0]
    # 0.3 m backwards along a heading of 0.5 rad, short of it by up to the tolerance; then 1 rad clockwise
    driven = (0.8 - after[1]) * math.cos(0.5) + (7.45 - after[2]) * math.sin(0.5)
    assert 0.3 - 0.08 - 1e-6 <= driven <= 0.3
    # the tolerance, a cycle, and what the last command is late on a busy machine (0.2 s of simulated time)
    assert _yaw(after) == pytest.approx(-0.5, abs=0.03 + 0.436 * 0.3)


def test_trajectories_and_teleop(robot: Robot) -> None:
    publisher = robot.graph.node("trajectory", "--count", "1")
    points = ("--point", "1,0,0", "--point", "1,1,0", "_velocity:=1.0")
    poly = robot.graph.node("trajectory", "poly_path", *points, "--count", "1", "odometry:=odom")
    ours, theirs = pty.openpty()
    keys = robot.graph.node("teleop", stdin=theirs)
    robot.graph.wait_for_text(keys, "turn 0.600")
    info = ("/usr/bin/rosnode", "info", "/teleop_twist_keyboard")
    wait_for(lambda: "to: /observer" in robot.graph.run(*info), "the connection of teleop")
    count = len(robot.observed()["twists"])
    for number, key in enumerate(b"itJq", 1):
        os.write(ours, bytes([key]))
        wait_for(lambda: len(robot.observed()["twists"]) >= count + number, "the velocity of a key")  # noqa: B023
    robot.graph.wait_for_text(keys, "turn 0.660")
    keys.send_signal(signal.SIGINT)
    assert keys.wait(TIMEOUT_S) == 0
    os.close(ours)
    os.close(theirs)
    assert publisher.wait(TIMEOUT_S) == 0 and poly.wait(TIMEOUT_S) == 0
    seen = robot.observed()
    stop = [0.0, 0.0, 0.0, 0.0]
    assert [t[1:] for t in seen["twists"][count:]] == [[0.3, 0, 0, 0], [0, 0, 0.3, 0], [0, 0.3, 0, 0], stop, stop]
    by_length = sorted(seen["trajectory"], key=lambda item: len(item[2]))
    assert [item[:2] for item in by_length] == [["map", ["robot_link"]]] * 2
    _check_eight(np.array(by_length[1][2]))
    _check_poly(np.array(by_length[0][2]))


def _check_eight(eight: NDArray[np.float64]) -> None:
    """The first eight is centered at (4, 0, 2), in the y-z plane: its samples are those of the closed form, t < P."""
    t, w = np.arange(100) * 0.1, 0.2 * np.pi
    np.testing.assert_allclose(eight[:, 0], t, atol=1e-9)
    place = (np.full(100, 4.0), 1.5 * np.sin(2 * w * t), 2.0 - np.cos(w * t))
    velocity = (0 * t, 3.0 * w * np.cos(2 * w * t), w * np.sin(w * t))
    acceleration = (0 * t, -6.0 * w**2 * np.sin(2 * w * t), w**2 * np.cos(w * t))
    np.testing.assert_allclose(eight[:, 1:10].T, (*place, *velocity, *acceleration), atol=1e-12)
    assert (eight[:, 10] == 1.0).all()


def _check_poly(poly: NDArray[np.float64]) -> None:
    """From where the odometry is, through both points at a mean speed of 1 m/s; no samples at the corners and at the end."""
    start = poly[0, 1:4]
    first = np.linalg.norm([1.0, 0.0, 0.0] - start)
    assert poly[0, 0] == 0.0 and (poly[0, 7:10] == 0.0).all()
    assert poly[-1, 0] < first + 1.0 and not np.isclose(poly[:, 0], first, atol=1e-6).any()
    t, d = poly[1, 0], np.array([1.0, 0.0, 0.0]) - start
    end, v = d / first, poly[0, 4:7]
    a, b = (3 * d - 2 * first * v - first * end) / first**2, (-2 * d + first * v + first * end) / first**3
    np.testing.assert_allclose(poly[1, 1:4], start + v * t + a * t**2 + b * t**3, atol=1e-6)


def test_a_node_without_its_transform(robot: Robot) -> None:
    assert robot.lost.wait(TIMEOUT_S) == 2
    text = " ".join(robot.graph.output_of(robot.lost).split())
    assert "no transform from odom to nowhere within 5 s; set ~odom_frame and ~base_frame" in text


# --- without ROS ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("angle", "turn"),
    [
        (6.28, 6.28 - 2 * math.pi),
        (-4.0, 2 * math.pi - 4.0),
        (math.pi, math.pi),
        (-math.pi, -math.pi),
        (7.0, 7.0 - 2 * math.pi),
    ],
)
def test_shorter_way(angle: float, turn: float) -> None:
    assert shorter(angle) == pytest.approx(turn, abs=1e-12)


def _cycles_of_a_late_turn(*, damped: bool) -> int:
    """Turn by 1.11 rad with ten commands per second and a new pose after every third; return the cycles, at most 100."""
    motion = Settings(0.03, 0.436, 10.0, "t", "b", "o").turn(1.11, direct=True)
    motion.frame = "odom"
    yaw = seen = 0.0
    motion.start(NO_CONTEXT, 0.0)
    for cycle in range(100):
        seen = yaw if cycle % 3 == 0 else seen
        pose = Pose2D(0.0, 0.0, seen)
        if not damped:
            motion.damping = Damping()
        step = motion.step(RobotState(pose), 0.1 * cycle)
        if step.status is not BehaviorStatus.RUNNING:
            assert yaw == pytest.approx(1.11, abs=0.03)
            return cycle
        yaw += 0.1 * step.twist.wz
    return 100


def test_a_late_robot_does_not_swing_about_its_target() -> None:
    assert _cycles_of_a_late_turn(damped=False) == 100
    assert _cycles_of_a_late_turn(damped=True) < 50


def test_a_motion_within_the_tolerance_is_made_too() -> None:
    settings = Settings(0.08, 0.1, 10.0, "t", "b", "o")
    assert settings.move(0.05).params.tolerance == 0.025
    assert settings.move(-0.5).params.tolerance == 0.08
    assert settings.turn(9.0, direct=True).angle == 9.0


def _parameters(monkeypatch: pytest.MonkeyPatch, values: dict[str, Any]) -> None:
    """Have the parameter server of a node /n answer with these values."""

    def get_param(name: str, default: Any) -> Any:
        return values.get(name, default)

    def resolve_name(name: str) -> str:
        return name.replace("~", "/n/")

    server = SimpleNamespace(get_param=get_param, resolve_name=resolve_name)
    monkeypatch.setattr(ros, "rospy", lambda: server)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"~t_dis": 0}, "the distance is 0; set ~t_dis to a distance"),
        ({"~tolerance": "small"}, "the parameter /n/tolerance is 'small', not a finite number"),
        ({"~speed_linear": -0.1}, "the parameter /n/speed_linear is -0.1, not a positive number"),
        ({"~velocity_pub_rate": 0.5}, "/n/velocity_pub_rate is 0.5, not from 1 to 1000"),
        ({"~vel_topic": ""}, "/n/vel_topic is '', not a text"),
    ],
)
def test_wrong_parameters(values: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _parameters(monkeypatch, values)
    with pytest.raises(InputError, match=message):
        motion_nodes.linear_move()


def test_default_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the known nodes."""
    _parameters(monkeypatch, {})
    common = (10.0, VELOCITY, "base_link", "odom")
    assert motion_nodes.linear_settings() == Settings(0.08, 0.1, *common)
    assert motion_nodes.turn_settings() == Settings(0.03, 0.436, *common)
    _parameters(monkeypatch, {"~base_aliases": "wheels", "~direct": 1})
    assert parameters.texts("base_aliases", []) == ["wheels"] and parameters.flag("direct", False)


def test_score_of_a_tour() -> None:
    score = Score()
    assert score.lines(0.0)[0] == "Success so far: 0/0 = 0.0%"
    score.add(Pose2D(3.0, 4.0), Pose2D(0.0, 0.0), succeeded=True)
    score.add(Pose2D(9.0, 4.0), Pose2D(3.1, 4.0), succeeded=False)
    score.add(Pose2D(3.0, 8.0), Pose2D(3.0, 4.0), succeeded=True)  # from where the failed goal ended
    assert (score.goals, score.successes, score.distance_m) == (3, 2, 9.0)
    assert score.lines(119.0) == ("Success so far: 2/3 = 66.7%", "Running time: 1.9 min Distance: 9.0 m")
    assert cut(1.99) == 1.9


def test_corners_are_left_out() -> None:
    whole = poly_path([(0, 0), (1, 0), (1, 1)], 1.0, dt=0.1)
    cut_down = without(whole, [1.0, 2.0])
    assert len(whole) == 21 and len(cut_down) == 19
    assert not np.isclose(cut_down.t, 1.0).any() and cut_down.duration == pytest.approx(1.9)


def test_stamps_before_a_jump_of_the_clock() -> None:
    """A bag restarts: the node's time goes on, and what was stamped before keeps its stamp, also where the start is before 0."""
    now = SimpleNamespace(ns=6_000_000_000)
    clock = NodeClock(lambda: now.ns)
    assert clock.now() == 0.0
    now.ns = 11_000_000_000
    assert clock.now() == 5.0
    now.ns = 1_000_000_000
    assert clock.now() == 5.0 and clock.jumps == 1
    now.ns = 3_000_000_000
    assert clock.now() == 7.0 and clock.ns(7.0) == now.ns
    assert clock.ns(2.0) == 8_000_000_000 and clock.ns(-100.0) == 0
    assert clock.of(SimpleNamespace(to_nsec=lambda: 2_000_000_000)) == 6.0 and clock.ns(6.0) == 2_000_000_000
    now.ns = 1_500_000_000
    assert clock.now() == 7.0 and clock.jumps == 2 and clock.ns(6.5) == 2_500_000_000


COMMANDS = (
    "move_base",
    "sim",
    "map_server office",
    "map_saver",
    "amcl",
    "fake_localization",
    "linear_move",
    "radian_turn",
    "initial_pose 0,0",
    "tour",
    "trajectory",
)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (
            "map_saver --occ 20",
            "--occ 20 and --free 25 are no thresholds: --occ is from 1 to 100, --free from 0 to below --occ",
        ),
        ("amcl __name:=a/b", '"a/b" is no name of a node; use letters, digits and _, with a letter first'),
        ("fake_localization more", "more is neither an option nor a ROS argument NAME:=VALUE"),
        ("sim office --speed 3", "--speed 3 needs simulated time; add --clock"),
        ("amcl", "no ROS master at http://127.0.0.1:9"),
    ],
)
def test_wrong_uses(
    command: str, message: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sentence each, also without ROS."""
    from navstack.cli.app import run

    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    assert run(["ros1", *command.split()]) == 2
    text = " ".join(capfd.readouterr().err.split())
    assert message in text or "ROS 1 is not installed" in text
    assert "Traceback" not in text


@pytest.mark.parametrize("command", COMMANDS)
def test_without_ros(command: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence with the command that installs ROS."""
    from navstack.cli.app import run

    real = ros.importlib.import_module

    def absent(name: str) -> Any:
        if name.startswith(("ros", "gen", "actionlib")) or name.partition(".")[0].endswith(("_msgs", "_srvs")):
            raise ImportError(name)
        return real(name)

    monkeypatch.setattr(ros.importlib, "import_module", absent)
    assert run(["ros1", *command.split()]) == 2
    message = " ".join(capfd.readouterr().err.split())
    assert "ROS 1 is not installed" in message and "sudo apt-get install python3-rospy" in message


def test_arguments_of_static_transform_publisher() -> None:
    """Both forms of tf's program; without a period the transform is static, as by tf2_ros's."""
    angles = static_transform.parse(["0.1", "-0.2", "0.3", "0.5", "0", "0", "/base_link", "/laser", "100"])
    assert angles.translation == (0.1, -0.2, 0.3) and (angles.frame, angles.child) == ("base_link", "laser")
    assert angles.period_s == 0.1 and angles.rotation.yaw == 0.5
    upside_down = static_transform.parse(["0", "0", "0", "0.7", "0", "3.141592653589793", "a", "b"])
    assert Transform3D(rotation=upside_down.rotation).tilt == pytest.approx(math.pi) and upside_down.period_s == 0.0
    assert upside_down.rotation.yaw == pytest.approx(0.7)
    assert static_transform.parse(["1", "2", "3", "0", "0", "0", "2", "a", "b", "10"]).rotation == (0.0, 0.0, 0.0, 1.0)
    for words, message in (
        ("1 2 3 a b 100", "is no transform; give x y z yaw pitch roll FRAME CHILD PERIOD_MS"),
        ("0 0 0 0 0 0 a b -5", 'the period "-5" is not a time'),
        ("0 0 0 0 0 0 0 a b 5", "is not a rotation"),
        ("0 0 0 0 0 0 /a a 5", '"a" cannot be its own child'),
    ):
        with pytest.raises(InputError, match=message):
            static_transform.parse(words.split())
