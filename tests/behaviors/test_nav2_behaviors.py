"""back_up, drive_on_heading, spin and wait: distance, duration and collisions."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from navstack.behaviors import BackUp, DriveOnHeading, Spin, Wait
from navstack.behaviors.errors import CannotTurnError
from navstack.core import LETHAL, CollisionAheadError, Footprint, NavError, ParameterError, Pose2D, RobotState, Twist2D
from navstack.move_base import GoalStatus
from navstack.plugins import RECOVERY_BEHAVIORS, Behavior, BehaviorContext, BehaviorStatus
from tests.move_base.world import LIMITS, Bench, EmptyCostmap, KinematicRobot, StraightPlanner, TurnAndGo, occupied

START = Pose2D(0.5, -0.5, 1.0)


class Stage:
    """A behavior on an empty costmap with optional obstacles."""

    def __init__(self, cls: type[Behavior], start: Pose2D = START, **params: Any) -> None:
        self.robot = KinematicRobot(start)
        self.local = EmptyCostmap("local_costmap", "odom", self.robot)
        self.known = EmptyCostmap("global_costmap", "map", self.robot)
        self.context = BehaviorContext(self.known, self.local, TurnAndGo(), 10.0)
        self.recovery = cls("it", cls.Params(**params))

    def wall(self, along: float, start: Pose2D = START, side: float = 0.0) -> None:
        """Add a lethal cell `along` meters in front of the start, behind it if negative."""
        x = start.x + along * math.cos(start.yaw) - side * math.sin(start.yaw)
        y = start.y + along * math.sin(start.yaw) + side * math.cos(start.yaw)
        cell = self.local.master.geometry.world_to_cell(x, y)
        assert cell is not None
        self.local.master.data[cell[1], cell[0]] = LETHAL

    def run(self) -> list[Twist2D]:
        """Run until the behavior is done or raises."""
        start = self.robot.time
        self.recovery.start(self.context, start)
        frequency = self.recovery.frequency or 10.0
        commands: list[Twist2D] = []
        self.texts: list[str] = []
        for k in range(1, 2000):
            step = self.recovery.step(RobotState(self.robot.odom_pose, self.robot.twist), self.robot.time)
            self.texts.append(step.text)
            commands.append(step.twist)
            self.robot.command(step.twist)
            if step.status is BehaviorStatus.DONE:
                return commands
            self.robot.advance_to(start + k / frequency)
        raise AssertionError("it does not end")

    @property
    def moved(self) -> float:
        """Distance along the heading of the start (m)."""
        pose = self.robot.odom_pose
        return (pose.x - START.x) * math.cos(START.yaw) + (pose.y - START.y) * math.sin(START.yaw)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_back_up_ignores_the_signs(sign: float) -> None:
    stage = Stage(BackUp, backup_dist=sign * 0.4, backup_speed=sign * 0.1)
    commands = stage.run()
    assert stage.moved == pytest.approx(-0.4, abs=0.005)  # half the distance of one command
    assert commands[0] == Twist2D(-0.1, 0.0, 0.0)
    assert commands[-1] == Twist2D()


@pytest.mark.parametrize("distance", [0.37, -0.37])
def test_drive_on_heading_follows_the_sign(distance: float) -> None:
    stage = Stage(DriveOnHeading, dist_to_travel=distance, speed=math.copysign(0.1, distance))
    stage.run()
    assert stage.moved == pytest.approx(distance, abs=0.005)


def test_the_local_planners_speed_limit_applies() -> None:
    stage = Stage(DriveOnHeading, dist_to_travel=1.0, speed=9.0)
    assert max(t.vx for t in stage.run()) == TurnAndGo().limits.max_vel_trans


def test_it_stops_before_a_wall() -> None:
    radius = 0.19  # padded
    for cls, params, code in (
        (BackUp, {"backup_dist": 2.0, "backup_speed": 0.2}, 714),
        (DriveOnHeading, {"dist_to_travel": 2.0, "speed": 0.2, "simulate_ahead_time": 1.0}, 723),
    ):
        stage = Stage(cls, **params)
        stage.wall(-1.0 if cls is BackUp else 1.0)
        with pytest.raises(CollisionAheadError) as failed:
            stage.run()
        assert (failed.value.code, failed.value.name) == (code, "COLLISION_AHEAD")
        look_ahead = 0.2 * (1.0 if cls is DriveOnHeading else 2.0)
        # the cell (0.05 m) is detected one command (0.02 m) before the footprint reaches it within the look-ahead time
        assert abs(stage.moved) == pytest.approx(1.0 - radius - look_ahead, abs=0.07)
        assert failed.value.data["driven_m"] == pytest.approx(abs(stage.moved))


def test_an_obstacle_inside_the_footprint_counts() -> None:
    stage = Stage(DriveOnHeading, dist_to_travel=0.3, speed=0.1)
    stage.wall(0.0)
    with pytest.raises(CollisionAheadError):
        stage.run()
    assert stage.moved == 0.0


@pytest.mark.parametrize("seen", [True, False], ids=["local", "global"])
@pytest.mark.parametrize("side", [0.0, 0.08])
def test_it_drives_away_from_what_its_footprint_overlaps_and_only_away(side: float, seen: bool) -> None:
    """A mark under the edge of the footprint ahead, as a bumper makes it: backward is free, forward is not."""
    back, ahead = Stage(BackUp), Stage(DriveOnHeading, dist_to_travel=0.15, speed=0.1)
    for stage in (back, ahead):
        stage.local, stage.known = (stage.local, stage.known) if seen else (stage.known, stage.local)
        stage.wall(0.16, side=side)
    back.run()
    assert back.moved == pytest.approx(-0.15, abs=0.005)
    with pytest.raises(CollisionAheadError):
        ahead.run()
    assert ahead.moved == 0.0
    # away from the mark, but into another one
    behind = Stage(BackUp)
    behind.wall(0.16)
    behind.wall(-0.22)
    with pytest.raises(CollisionAheadError):
        behind.run()


def test_collision_checks_can_be_switched_off() -> None:
    stage = Stage(BackUp, backup_dist=0.5, backup_speed=0.1, disable_collision_checks=True)
    stage.wall(-0.4)
    stage.run()
    assert stage.moved == pytest.approx(-0.5, abs=0.005)


@pytest.mark.parametrize(
    ("cls", "params", "code"),
    [
        (BackUp, {"backup_dist": 1.0, "time_allowance": 2.0}, 711),
        (DriveOnHeading, {"dist_to_travel": 1.0, "time_allowance": 2.0}, 721),
        (Spin, {"spin_dist": 6.0, "time_allowance": 2.0}, 701),
    ],
)
def test_time_allowance(cls: type[Behavior], params: dict[str, float], code: int) -> None:
    stage = Stage(cls, **params)
    with pytest.raises(NavError) as failed:
        stage.run()
    assert (failed.value.code, failed.value.name) == (code, "TIMEOUT")
    assert stage.robot.time == pytest.approx(2.1)


def test_opposite_signs_are_rejected_before_the_first_goal() -> None:
    wrong = DriveOnHeading("ahead", DriveOnHeading.Params(dist_to_travel=1.0, speed=-0.1))
    with pytest.raises(ParameterError, match="opposite directions") as failed:
        Bench(recoveries=[wrong])
    assert failed.value.code == 724


@pytest.mark.parametrize("angle", [1.57, -2.5, 7.0, 0.0])
def test_spin_turns_by_its_angle(angle: float) -> None:
    stage = Stage(Spin, spin_dist=angle, time_allowance=20.0)
    stage.run()
    # min_rotational_vel for half a period
    assert math.remainder(stage.robot.odom_pose.yaw - START.yaw - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=0.021)
    assert stage.moved == 0.0


def test_spin_checks_the_turn_ahead() -> None:
    from navstack.core import Footprint

    def long_robot(angle: float) -> Stage:
        stage = Stage(Spin, spin_dist=angle)
        stage.local.footprint = Footprint([(0.5, 0.1), (0.5, -0.1), (-0.2, -0.1), (-0.2, 0.1)])
        stage.wall(0.0, side=0.4)
        return stage

    with pytest.raises(CollisionAheadError) as failed:
        long_robot(1.57).run()
    assert failed.value.code == 703
    right = long_robot(-1.57)
    right.run()
    assert right.robot.odom_pose.yaw == pytest.approx(START.yaw - 1.57, abs=0.021)


@pytest.mark.parametrize(
    ("cls", "params", "first", "last"),
    [
        (BackUp, {"backup_dist": 0.3, "backup_speed": 0.1}, "it: driving -0.30 m at 0.1 m/s", "it: drove 0.30 m"),
        (DriveOnHeading, {"dist_to_travel": 0.3, "speed": 0.1}, "it: driving 0.30 m at 0.1 m/s", "it: drove 0.30 m"),
        (Spin, {"spin_dist": -1.5708}, "it: turning -90 degrees", "it: turned -90 degrees"),
        (Wait, {"wait_duration": 1.5}, "it: waiting for 1.5 s", "it: waited 1.5 s"),
    ],
)
def test_the_first_and_the_last_step_say_what_it_does(
    cls: type[Behavior], params: dict[str, float], first: str, last: str
) -> None:
    """Once each, also when the behavior runs again."""
    stage = Stage(cls, **params)
    for _ in range(2):
        stage.run()
        assert [text for text in stage.texts if text] == [first, last]
        assert (stage.texts[0], stage.texts[-1]) == (first, last)


def test_wait_lasts_its_duration() -> None:
    stage = Stage(Wait, wait_duration=3.0)
    assert set(stage.run()) == {Twist2D()}
    assert stage.robot.time == pytest.approx(3.0)


@pytest.mark.parametrize("cls", [BackUp, DriveOnHeading, Spin, Wait])
def test_canceled_at_any_cycle_it_stops_within_one(cls: type[Behavior]) -> None:
    for k in range(0, 12, 2):
        params = {"wait_duration": 5.0} if cls is Wait else {}
        bench = Bench(planner=StraightPlanner(occupied), recoveries=[cls("it", cls.Params(**params))])
        handle = bench.move_base.send_goal(Pose2D(2.0, 1.0))
        while bench.move_base.recovery is None:
            bench.tick()
        at = bench.robot.time + 0.05 * k
        bench.run_to(at)
        bench.move_base.cancel_goal(handle)
        bench.run(handle)
        if handle.status is GoalStatus.PREEMPTED:
            assert bench.robot.time <= at + 0.2 + 1e-6
        assert bench.robot.twist == Twist2D()


def wall_on_the_map(stage: Stage, x: float, y: float) -> None:
    """Add a lethal cell to the global costmap only."""
    master = stage.context.global_costmap.master
    cell = master.geometry.world_to_cell(x, y)
    assert cell is not None
    master.data[cell[1], cell[0]] = LETHAL


@pytest.mark.parametrize(
    ("cls", "params", "code"),
    [
        (BackUp, {"backup_dist": 0.5, "backup_speed": 0.1}, 714),
        (DriveOnHeading, {"dist_to_travel": -0.5, "speed": -0.1}, 723),
    ],
)
def test_a_wall_of_the_map_that_no_sensor_sees_refuses_the_motion(
    cls: type[Behavior], params: dict[str, float], code: int
) -> None:
    stage = Stage(cls, Pose2D(0.0, 0.0, 0.0), **params)
    wall_on_the_map(stage, -0.6, 0.0)
    with pytest.raises(CollisionAheadError, match=r"did not start.*global_costmap") as caught:
        stage.run()
    assert caught.value.code == code
    assert stage.robot.odom_pose.x == 0.0


def test_a_wall_that_appears_on_the_map_stops_the_motion() -> None:
    stage = Stage(BackUp, Pose2D(0.0, 0.0, 0.0), backup_dist=1.0, backup_speed=0.1)
    stage.recovery.start(stage.context, 0.0)
    with pytest.raises(CollisionAheadError, match=r"stopped after.*global_costmap"):
        for k in range(1, 200):
            step = stage.recovery.step(RobotState(stage.robot.odom_pose, stage.robot.twist), stage.robot.time)
            stage.robot.command(step.twist)
            stage.robot.advance_to(k / 10.0)
            if k == 20:
                wall_on_the_map(stage, -0.6, 0.0)
    assert -0.4 < stage.robot.odom_pose.x < -0.1


def test_spin_checks_the_map() -> None:
    stage = Stage(Spin, Pose2D(0.0, 0.0, 0.0))
    box = Footprint(np.array([[0.4, 0.1], [-0.4, 0.1], [-0.4, -0.1], [0.4, -0.1]]))
    stage.local.footprint = stage.context.global_costmap.footprint = box
    wall_on_the_map(stage, 0.0, 0.3)
    with pytest.raises(CollisionAheadError, match="global_costmap"):
        stage.run()
    assert stage.robot.odom_pose.yaw == 0.0


# --- bases with a turning radius ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["spin", "rotate_recovery"])
def test_a_car_does_not_turn_in_place(kind: str) -> None:
    cls = RECOVERY_BEHAVIORS.get(kind).cls
    assert cls.turns_in_place
    stage = Stage(cls)
    stage.context = replace(stage.context, local_planner=TurnAndGo(limits=LIMITS._replace(min_turning_radius=0.85)))
    with pytest.raises(
        CannotTurnError, match=r"it turns in place, which a base with a turning radius of 0\.85 m cannot"
    ):
        stage.run()


@pytest.mark.parametrize("kind", ["back_up", "drive_on_heading"])
def test_a_car_backs_up_and_drives_on_its_heading(kind: str) -> None:
    cls = RECOVERY_BEHAVIORS.get(kind).cls
    assert not cls.turns_in_place
    stage = Stage(cls)
    stage.context = replace(stage.context, local_planner=TurnAndGo(limits=LIMITS._replace(min_turning_radius=0.85)))
    assert all(command.wz == 0.0 for command in stage.run())
    assert abs(stage.moved) > 0.1
