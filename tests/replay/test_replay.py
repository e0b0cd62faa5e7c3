"""What a replay does with logs of real robots: other names, missing parts, silences, goals that fail, differences."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import LogError, OccupancyGrid, Pose2D, RecordError, Transform2D, Twist2D
from navstack.explain import explain_cell, explain_command, explain_goals, replay
from navstack.logs import open_log, open_writer
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.replay import LogReplay, ReplayOptions
from navstack.replay.comparison import Cycle, Cycles, PlanComparer, compare_commands
from navstack.replay.moment import rectangles, snapshot
from navstack.replay.player import empty_map, last_pose, logged_map
from navstack.replay.report import ReplayReport
from navstack.replay.topics import find_topics
from navstack.ros_messages import MessageBuilder
from tests.logs.samples import START_NS

NS = 1_000_000_000
CONFIGURATION = load_configuration(["turtlebot"])


class Maker:
    """Writes a log of a robot that drives straight ahead at 0.2 m/s towards a wall at x = 4 m, in the frame odom."""

    def __init__(self, path: Path) -> None:
        target = open_writer(path)
        self.build = MessageBuilder(target.store, ros1=target.is_ros1)
        self.path = path
        self.scan_frame = "base_laser_link"
        self.scan_topic = "/scan"
        self.silent: tuple[float, float] = (99.0, 99.0)
        self.goal: Pose2D | None = Pose2D(3.0, 0.0)
        self.command = Twist2D(0.2, 0.0, 0.0)
        self.shift_ns = 0
        self.localized = True
        self.odometry = True
        self._target = target

    def write(self, duration: float = 6.0) -> Path:
        build, shift = self.build, self.shift_ns
        with self._target as writer:
            static = [(START_NS + shift, "base_footprint", self.scan_frame, Transform2D(0.1, 0.0, 0.0), 0.3)]
            if self.localized:
                static.append((START_NS + shift, "map", "odom", Transform2D(), 0.0))
            kind = "tf2_msgs/msg/TFMessage"
            writer.write("/tf_static", kind, START_NS, build.transforms(static), latched=True)
            for i in range(round(duration * 20) + 1):
                t = i / 20
                now = START_NS + i * NS // 20
                stamp = now + shift
                x = 0.2 * t
                moved = build.transforms([(stamp, "odom", "base_footprint", Transform2D(x, 0.0, 0.0), 0.0)])
                writer.write("/tf", kind, now, moved)
                odometry = build.odometry(stamp, "odom", "base_footprint", Pose2D(x, 0.0), Twist2D(0.2))
                if self.odometry:
                    writer.write("/odom", "nav_msgs/msg/Odometry", now, odometry)
                writer.write("/cmd_vel", "geometry_msgs/msg/Twist", now, build.twist(self.command))
                if i % 2 == 0 and not self.silent[0] <= t <= self.silent[1]:
                    message = build.scan(stamp, _scan(x, self.scan_frame))
                    writer.write(self.scan_topic, "sensor_msgs/msg/LaserScan", now, message)
                if i == 10 and self.goal is not None:
                    goal = build.pose_stamped(stamp, "map", self.goal)
                    writer.write("/move_base_simple/goal", "geometry_msgs/msg/PoseStamped", now, goal)
        return self.path


def _scan(x: float, frame: str) -> Any:
    from navstack.core import LaserScan

    angles = -0.5 + np.float32(0.01) * np.arange(101)
    ranges = ((4.0 - 0.1 - x) / np.cos(angles)).astype(np.float32)
    return LaserScan(ranges, -0.5, float(np.float32(0.01)), 0.1, 8.0, 0.0, frame)


Make = Callable[[], Maker]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    return lambda: Maker(tmp_path / "robot.bag")


def replayed(path: Path, options: ReplayOptions | None = None, grid: OccupancyGrid | None = None) -> LogReplay:
    log = open_log(path)
    found = grid or empty_map(log, find_topics(log, CONFIGURATION), Pose2D(0.0, 0.0), "map")
    done = LogReplay(log, CONFIGURATION, found, options)
    done.run()
    return done


def record_of(done: LogReplay) -> Record:
    assert done.run_recorder is not None
    return done.run_recorder.record()


def test_wall_is_marked_and_the_command_follows_the_plan(make: Make) -> None:
    done = replayed(make().write())
    record = record_of(done)
    costmap = record.costmap_at("local", 5.0)
    assert costmap is not None
    cell = costmap.geometry.world_to_cell(2.5, 0.0)
    assert cell is not None
    robot_x = record.pose_at(5.0).x
    assert robot_x == pytest.approx(1.0, abs=0.02)
    report = ReplayReport(done)
    assert report.commands is not None and report.commands.cycles > 20
    assert len(done.goals) == 1 and done.goals[0].pose == Pose2D(3.0, 0.0)
    assert record.plans and record.plans[0].poses[-1, 0] == pytest.approx(3.0, abs=0.1)


def test_silence_of_a_sensor_is_reported(make: Make) -> None:
    maker = make()
    maker.silent = (2.0, 4.0)
    done = replayed(maker.write())
    (silence,) = done.player.silences
    assert silence.topic == "/scan"
    assert silence.start == pytest.approx(1.9) and silence.duration == pytest.approx(2.2)
    assert any("the longest: /scan, 2.20 s from 1.90 s" in line for line in ReplayReport(done).lines())


def test_only_scan_with_another_name_is_used_with_a_note(make: Make) -> None:
    maker = make()
    maker.scan_topic = "/front/scan"
    done = replayed(maker.write())
    assert any("the log has no /scan; its only LaserScan /front/scan is used for it" in note for note in done.notes)
    assert len(record_of(done).arrays["scans"])


def test_chosen_topic_must_exist_and_have_the_type(make: Make) -> None:
    path = make().write()
    with pytest.raises(LogError, match=r"has no topic /laser; its topics are /cmd_vel, "):
        replayed(path, ReplayOptions(topics={"scan": "/laser"}))
    with pytest.raises(LogError, match=r"has no topic /odom of LaserScan for scan; those it has: /scan"):
        replayed(path, ReplayOptions(topics={"scan": "/odom"}))


def test_frame_that_is_not_in_the_log_needs_a_mounting(make: Make) -> None:
    maker = make()
    path = maker.write()
    content = path.read_bytes().replace(b"base_footprint", b"base_footprinT", 0)
    assert content == path.read_bytes()
    lost = ReplayOptions(mountings={"camera": ("base_footprint", (0.1, 0.0, 0.3, 0.0))})
    done = replayed(path, lost)
    assert done.robot.frames.lookup("base_footprint", "camera").x == 0.1


@pytest.mark.slow
def test_without_localization_the_initial_pose_places_the_robot(make: Make) -> None:
    maker = make()
    maker.localized = False
    path = maker.write()
    done = replayed(path)
    assert any("the log has no localization" in note for note in done.notes)
    placed = replayed(path, ReplayOptions(initial_pose=Pose2D(5.0, 6.0, 0.5)))
    assert record_of(placed).pose_at(0.0) == pytest.approx(Pose2D(5.0, 6.0, 0.5), abs=1e-9)
    with pytest.raises(LogError, match="leave --initial-pose out"):
        replayed(_localized(path), ReplayOptions(initial_pose=Pose2D(5.0, 6.0, 0.5)))


@pytest.mark.slow
def test_the_initial_pose_places_a_robot_whose_odometry_is_in_tf_only(make: Make) -> None:
    maker = make()
    maker.localized = maker.odometry = False
    path = maker.write()
    placed = replayed(path, ReplayOptions(initial_pose=Pose2D(5.0, 6.0, 0.5)))
    assert record_of(placed).pose_at(0.0) == pytest.approx(Pose2D(5.0, 6.0, 0.5), abs=1e-9)
    moved = record_of(placed).pose_at(5.0)
    assert (moved.x, moved.y) == pytest.approx((5.0 + np.cos(0.5), 6.0 + np.sin(0.5)), abs=0.02)
    with open_log(path) as log:
        assert last_pose(log, CONFIGURATION, {}, Pose2D(5.0, 6.0, 0.5)).x == pytest.approx(
            5.0 + 1.2 * np.cos(0.5), abs=1e-6
        )
    assert any("the log has no localization" in note for note in replayed(path).notes)


def _localized(path: Path) -> Path:
    return Maker(path.with_name("localized.bag")).write()


def test_stamps_of_another_clock_are_shifted(make: Make) -> None:
    maker = make()
    maker.shift_ns = -START_NS + 100 * NS
    done = replayed(maker.write())
    assert any("the stamps of the messages differ from the times of the recording" in note for note in done.notes)
    assert record_of(done).pose_at(5.0).x == pytest.approx(1.0, abs=0.02)


def test_part_of_a_log(make: Make) -> None:
    done = replayed(make().write(), ReplayOptions(start=2.0, end=4.0))
    assert next(cycle.time for cycle in done.cycles) == pytest.approx(2.0) and done.cycles.duration <= 2.0
    assert not done.goals  # the goal was sent before
    own = replayed(done.log.path, ReplayOptions(start=2.0, end=4.0, goals=((2.5, Pose2D(3.0, 0.0)),)))
    assert own.goals[0].time == pytest.approx(2.5)


def test_last_pose(make: Make) -> None:
    with open_log(make().write()) as log:
        assert last_pose(log, CONFIGURATION, {}, None) == pytest.approx(Pose2D(1.2, 0.0, 0.0))


@pytest.mark.slow
def test_goal_in_the_wall_is_given_up_and_sent_again_while_the_robot_drives(make: Make) -> None:
    maker = make()
    maker.goal = Pose2D(100.0, 0.0)
    done = replayed(maker.write(duration=60.0))
    (goal,) = done.goals
    assert len(goal.attempts) >= 1
    assert "outside" in goal.attempts[0]


def test_no_map_in_the_log(make: Make) -> None:
    with open_log(make().write()) as log:
        topics = find_topics(log, CONFIGURATION)
        assert logged_map(log, topics) is None
        grid = empty_map(log, topics, None, "map")
    assert grid.geometry.extent == pytest.approx((-20.0, 20.0, -20.0, 20.0))
    assert not grid.data.any()


# --- the record -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_explanations_of_a_replay(make: Make, tmp_path: Path) -> None:
    done = replayed(make().write())
    assert done.run_recorder is not None
    done.run_recorder.save(tmp_path / "out")
    record = Record.load(tmp_path / "out")
    assert explain_goals(record)
    report = explain_command(record, 3.0)
    assert report.time == pytest.approx(3.0, abs=0.2)
    again = replay(record, 5.0)
    wall = explain_cell(again, 4.0, 0.0, costmap="global")
    assert wall.robot == pytest.approx(record.pose_at(5.0))
    done.log.path.unlink()
    with pytest.raises(RecordError, match=r"is the replay of a log, which is needed again: .* does not exist"):
        replay(record, 5.0)


def test_moment_as_a_scenario(make: Make) -> None:
    path = make().write()
    with open_log(path) as log:
        grid = empty_map(log, find_topics(log, CONFIGURATION), Pose2D(0.0, 0.0), "map")
        scenario = snapshot(log, CONFIGURATION, grid, 5.0)
        assert scenario.start == pytest.approx(Pose2D(1.0, 0.0, 0.0), abs=0.011)
        assert scenario.goals == (Pose2D(3.0, 0.0),)
        assert scenario.configuration.navstack.sim.lidar("laser").beams == 640  # as the parameters describe it
        tree = CONFIGURATION.tree.as_dict()
        del tree["navstack"]["sim"]["laser"], tree["navstack"]["sim"]["lasers"]
        lidar = snapshot(log, load_configuration([tree]), grid, 5.0).configuration.navstack.sim.lidar("laser")
        assert (lidar.beams, lidar.fov, lidar.range_max) == (101, pytest.approx(1.0), 8.0)
        assert (lidar.x, lidar.yaw, lidar.height, lidar.frequency) == pytest.approx((0.1, 0.0, 0.3, 10.0), abs=0.2)
        with pytest.raises(LogError, match=r"has 6\.0 s; 7 s is not in it"):
            snapshot(log, CONFIGURATION, grid, 7.0)


def test_cells_are_joined_to_rectangles() -> None:
    cells = {(x, y) for x in range(3, 7) for y in range(2, 5)} | {(0, 0)}
    found = sorted(rectangles(cells))
    assert found == [pytest.approx((0.025, 0.025, 0.05, 0.05)), pytest.approx((0.25, 0.175, 0.2, 0.15))]
    covered = sum(width * height for _, _, width, height in found)
    assert covered == pytest.approx(len(cells) * 0.05**2)


# --- comparison -------------------------------------------------------------------------------------------------------


def _cycle(t: float, command: Twist2D, recorded: Twist2D | None) -> Cycle:
    return Cycle(t, "CONTROLLING", 0, command, recorded, rejected=False, controlled=True, planned=False)


def test_differences_of_commands() -> None:
    cycles = [
        _cycle(0.0, Twist2D(0.2), None),
        _cycle(0.1, Twist2D(0.2), Twist2D(0.2)),
        _cycle(0.2, Twist2D(0.2), Twist2D(0.23)),
        _cycle(0.3, Twist2D(0.2, 0.0, 0.5), Twist2D(0.2, 0.0, -0.5)),
        _cycle(0.4, Twist2D(0.3), Twist2D(0.1)),
    ]
    found = compare_commands(Cycles(cycles))
    assert found is not None
    assert (found.cycles, found.different, found.equal, found.opposite) == (4, 2, 1, 1)
    assert found.first == (0.3, cycles[3].command, cycles[3].recorded)
    assert found.mean_linear == pytest.approx((0.03 + 0.2) / 4) and found.mean_angular == pytest.approx(0.25)
    assert compare_commands(Cycles(cycles[:1])) is None
    assert list(Cycles(cycles)) == cycles


def test_deviation_of_plans() -> None:
    line = np.column_stack((np.linspace(0.0, 4.0, 41), np.zeros(41), np.zeros(41)))
    bent = line + (0.0, 0.5, 0.0)
    comparer = PlanComparer()
    for time, ours, recorded in ((0.0, line, None), (0.1, None, line), (1.0, bent, None), (1.2, None, line)):
        if ours is not None:
            comparer.add(time, ours)
        if recorded is not None:
            comparer.add_recorded(time, recorded)
        comparer.settle(time)
    comparer.add_recorded(9.0, line)
    comparer.settle()
    found = comparer.result()
    assert found is not None
    assert found.plans == 2 and found.length == pytest.approx(4.0)
    assert found.deviation == pytest.approx(0.25) and found.largest == pytest.approx(0.5) and found.largest_at == 1.2
    assert PlanComparer().result() is None
