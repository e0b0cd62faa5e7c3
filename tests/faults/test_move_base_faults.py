"""Faults of every part, in seeded combinations.

With any fault the robot never moves on a stale command for longer than one control period, every goal reaches a terminal
state with a code and a reason, and after the fault the next valid goal succeeds. NAVSTACK_SOAK sets the number of
combinations.
"""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from navstack.core import NoValidPathError, Path, Pose2D, RecoveryError, RobotState, Transform2D, Twist2D
from navstack.move_base import GoalHandle, GoalStatus, InlinePlanning, Mode
from navstack.plugins import LocalPlan, Plan, RecoveryStatus, RecoveryStep
from tests.move_base.world import (
    NOTHING,
    Bench,
    KinematicRobot,
    StraightPlanner,
    TurnAndGo,
    Waiting,
    no_control,
    occupied,
)

PERIOD = 0.2
COMBINATIONS = int(os.environ.get("NAVSTACK_SOAK", "500"))
BATCH = 50


def raising(problem: Exception) -> Callable[[int], Any]:
    def behave(n: int) -> None:
        raise problem

    return behave


NAN_PLAN = Plan(Path(np.full((3, 3), np.nan), "map"), 1.0, Pose2D(1.0, 0.0))
EMPTY_PLAN = Plan(Path(np.zeros((0, 3)), "map"), 1.0, Pose2D(1.0, 0.0))

PLANNERS: dict[str, Callable[[int], Any]] = {
    "good": lambda n: None,
    "raises": raising(ValueError("planner broke")),
    "raises without text": raising(RuntimeError()),
    "no path": raising(NoValidPathError("nothing connects")),
    "returns nothing": lambda n: NOTHING,
    "returns nonsense": lambda n: [(0, 0), (1, 1)],
    "returns NaN": lambda n: NAN_PLAN,
    "returns an empty plan": lambda n: EMPTY_PLAN,
    "fails at first": lambda n: occupied(n) if n < 3 else None,
    "fails sometimes": lambda n: occupied(n) if n % 2 else None,
}
PLANNING_TIMES = [0.0, 0.0, 0.0, 0.3, 1.7, math.inf]
DRIVERS: dict[str, Callable[[int], Any]] = {
    "good": lambda n: None,
    "raises": raising(ZeroDivisionError("driver broke")),
    "no control": no_control,
    "returns nothing": lambda n: NOTHING,
    "returns nonsense": lambda n: "go",
    "returns NaN": lambda n: LocalPlan(Twist2D(math.nan, 0.0, 0.0)),
    "returns inf": lambda n: LocalPlan(Twist2D(0.0, 0.0, math.inf)),
    "returns half a twist": lambda n: LocalPlan((1.0,)),  # type: ignore[arg-type]
    "halts": TurnAndGo.halt,
    "swings": lambda n: TurnAndGo.turn(0.5 if n % 4 < 2 else -0.5),
    "spins": lambda n: TurnAndGo.turn(0.9),
    "fails sometimes": lambda n: no_control(n) if n % 3 == 2 else None,
    "fails after a while": lambda n: no_control(n) if n > 6 else None,
    "takes long": lambda n: None,  # see `build`
}
TAKES_LONG_S = 1.6
"""Longer than the patience in half of the combinations."""
RECOVERIES: dict[str, Callable[[], list[Waiting]]] = {
    "none": list,
    "one": lambda: [Waiting("one")],
    "turns": lambda: [Waiting("short", 0.5, frequency=20.0), Waiting("long", 1.3, frequency=7.0)],
    "never ends": lambda: [Waiting("endless", math.inf, frequency=20.0)],
    "slow steps": lambda: [Waiting("slow", 1.0, frequency=0.7)],
    "raises": lambda: [
        Waiting("broken", 1.0, raising(KeyError("x"))),
        Waiting("sad", 1.0, raising(RecoveryError("no"))),
    ],
    "NaN": lambda: [Waiting("nan", 1.0, lambda n: RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, math.nan)))],
    "nonsense": lambda: [Waiting("odd", 1.0, lambda n: 42)],
    "fails": lambda: [Waiting("fails", 1.0, lambda n: RecoveryStep(RecoveryStatus.FAILED, text="could not"))],
    "cannot start": lambda: [NoStart("no start")],
}


class NoStart(Waiting):
    def start(self, context: Any, now: float) -> None:
        raise RecoveryError("not today")


def sensors(bench: Bench, kind: str, since: float) -> None:
    def broken(now: float) -> bool:
        raise RuntimeError("driver crashed")

    if kind == "stale":
        bench.local_costmap.stale = lambda now: now >= since
    elif kind == "stale for a while":
        bench.local_costmap.stale = lambda now: since <= now < since + 0.7
    elif kind == "late sometimes":
        bench.local_costmap.stale = lambda now: now >= since and int(now * 10.0) % 3 == 0
    elif kind == "update fails":

        def fails(now: float) -> None:
            if now >= since:
                raise ValueError("grid broke")

        bench.local_costmap.fails = bench.global_costmap.fails = fails
    elif kind == "check fails":
        bench.local_costmap.stale = broken


SENSORS = ["good", "good", "good", "stale", "stale for a while", "late sometimes", "update fails", "check fails"]


class Robot(KinematicRobot):
    nan_velocity = False

    def state(self) -> RobotState:
        state = super().state()
        return state._replace(velocity=Twist2D(math.nan, 0.0, 0.0)) if self.nan_velocity else state


def robot_trouble(bench: Bench, kind: str, since: float) -> Callable[[float], None]:
    """Return a function to call after every tick."""
    robot = bench.robot
    assert isinstance(robot, Robot)
    if kind in ("state", "scans", "command"):

        def broken(what: str) -> None:
            if what == kind and robot.time >= since:
                raise OSError("cable")

        robot.broken = broken
    elif kind == "odometry stops":
        robot.deaf_since = since

    done = False

    def trouble(now: float) -> None:
        nonlocal done
        if now < since or done:
            return
        done = True
        if kind == "odometry jumps":
            x, y, yaw = robot.odom_pose
            robot.odom_pose = Pose2D(x + 0.8, y - 0.5, yaw + 1.0)
        elif kind == "map vanishes":
            robot.frames.remove("odom")
        elif kind == "base vanishes":
            robot.frames.remove("base_link")
            robot.deaf_since = since
        elif kind == "NaN velocity":
            robot.nan_velocity = True
        elif kind == "NaN pose":
            robot.frames.set("odom", "base_link", Transform2D(math.nan, 0.0, 0.0), now + 100.0)
            robot.deaf_since = since

    return trouble


ROBOTS = [
    *("good", "good", "good", "good", "state", "scans", "command", "odometry stops", "odometry jumps"),
    *("map vanishes", "base vanishes", "NaN velocity", "NaN pose"),
]
CLIENTS = ["one goal", "one goal", "one goal", "cancels", "cancels all", "burst", "bad quaternion", "new goals"]


def repair(bench: Bench) -> None:
    robot = bench.robot
    assert isinstance(robot, Robot)
    robot.broken = lambda what: None
    robot.nan_velocity = False
    robot.deaf_since = math.inf
    pose = robot.odom_pose
    robot.frames.remove("base_link")
    robot.frames.set_static("map", "odom", Transform2D())
    robot.frames.set("odom", "base_link", Transform2D(*pose), robot.time)
    for costmap in (bench.global_costmap, bench.local_costmap):
        costmap.stale = lambda now: False
        costmap.fails = lambda now: None
    bench.planner.behave = lambda n: None  # type: ignore[attr-defined]
    bench.driver.behave = lambda n: None  # type: ignore[attr-defined]
    bench.driver.refuse = None  # type: ignore[attr-defined]


def build(seed: int) -> tuple[Bench, random.Random, dict[str, Any]]:
    rng = random.Random(seed)
    # one to three faults at a time, so that each takes effect
    faulty = set(
        rng.sample(["planner", "planning", "driver", "recovery", "sensors", "robot", "client"], rng.randint(1, 3))
    )

    def pick(what: str, choices: list[Any]) -> Any:
        return rng.choice(choices) if what in faulty else choices[0]

    about: dict[str, Any] = {
        "seed": seed,
        "planner": pick("planner", list(PLANNERS)),
        "planning": pick("planning", PLANNING_TIMES),
        "driver": pick("driver", list(DRIVERS)),
        "recovery": rng.choice(list(RECOVERIES)),
        "sensors": pick("sensors", SENSORS),
        "robot": pick("robot", ROBOTS),
        "client": pick("client", CLIENTS),
        "since": round(rng.uniform(0.0, 4.0), 2),
    }
    slow = [about["planning"]]
    bench = Bench(
        planner=StraightPlanner(PLANNERS[about["planner"]]),
        driver=TurnAndGo(DRIVERS[about["driver"]]),
        recoveries=RECOVERIES[about["recovery"]](),
        planning=InlinePlanning(lambda now: slow[0]),
        recovery_time_limit_s=3.0,
        planner_frequency=rng.choice([0.0, 1.0, 3.0]),
        planner_patience=rng.choice([0.0, 1.0]),
        controller_patience=rng.choice([0.0, 1.0]),
        oscillation_timeout=4.0,  # long enough to turn around for a near goal
        max_planning_retries=rng.choice([-1, 0, 3]),
        shutdown_costmaps=rng.random() < 0.2,
    )
    bench.robot.__class__ = Robot
    about["slow"] = slow
    if about["driver"] == "takes long":
        robot = bench.robot

        def thinks(n: int) -> None:
            if n % 7 == 3:
                robot.advance_to(robot.time + TAKES_LONG_S)

        bench.driver.behave = thinks  # type: ignore[attr-defined]
    return bench, rng, about


MEANT: dict[str, set[str]] = {
    "raises": {"INTERNAL"},
    "raises without text": {"INTERNAL"},
    "no path": {"NO_VALID_PATH"},
    "returns nothing": {"PLANNING_FAILED", "INTERNAL"},
    "returns nonsense": {"INTERNAL"},
    "returns NaN": {"INTERNAL"},
    "returns inf": {"INTERNAL"},
    "returns half a twist": {"INTERNAL"},
    "returns an empty plan": {"PLANNING_FAILED"},
    "fails at first": {"GOAL_OCCUPIED"},
    "no control": {"NO_VALID_CONTROL"},
    "fails after a while": {"NO_VALID_CONTROL"},
    "halts": {"FAILED_TO_MAKE_PROGRESS"},
    "swings": {"FAILED_TO_MAKE_PROGRESS"},
    "spins": {"FAILED_TO_MAKE_PROGRESS"},
    "takes long": {"FAILED_TO_MAKE_PROGRESS"},  # the turn continues meanwhile and overshoots: it may swing
    "stale": {"SENSOR_DATA_STALE"},
    "stale for a while": {"SENSOR_DATA_STALE"},
    "late sometimes": {"SENSOR_DATA_STALE"},
    "update fails": {"INTERNAL"},
    "check fails": {"INTERNAL"},
    "state": {"INTERNAL"},
    "command": {"INTERNAL"},
    "odometry stops": {"TF_ERROR"},
    "odometry jumps": {"IMPOSSIBLE_ODOMETRY"},  # with a controller_patience of 0
    "map vanishes": {"TF_ERROR"},
    "base vanishes": {"TF_ERROR"},
    "NaN velocity": {"INTERNAL"},
    "NaN pose": {"INTERNAL", "TF_ERROR"},
    "cancels": {"CANCELED"},
    "cancels all": {"CANCELED"},
    "burst": {"REPLACED"},
    "bad quaternion": {"REPLACED", "INVALID_GOAL"},
    "new goals": {"REPLACED"},
}
"""Error names with which a goal may end under each fault."""


def codes(about: dict[str, Any]) -> set[str]:
    """Return the error names of all faults in this combination; a working part must not be a reason to fail."""
    found = {"NONE"}.union(
        *(MEANT.get(str(about[part]), set()) for part in ("planner", "driver", "sensors", "robot", "client"))
    )
    if about["planner"] == "fails sometimes":
        found.add("GOAL_OCCUPIED")
    if about["driver"] == "fails sometimes":
        found.add("NO_VALID_CONTROL")
    if about["planning"] > 0.0:
        found.add("TIMEOUT")
    return found


def run_one(seed: int) -> None:
    bench, rng, about = build(seed)
    manager, robot = bench.move_base, bench.robot
    sensors(bench, about["sensors"], about["since"])
    trouble = robot_trouble(bench, about["robot"], about["since"])
    goals: list[GoalHandle] = [manager.send_goal(Pose2D(rng.uniform(1.0, 3.0), rng.uniform(-2.0, 2.0), 1.0))]
    moment = rng.uniform(0.0, 5.0)
    moving_since: float | None = None

    def turn() -> None:
        nonlocal moving_since
        before = len(robot.commands)
        bench.tick()
        trouble(robot.time)
        # no stale commands
        last = robot.commands[-1] if robot.commands else (0.0, Twist2D())
        assert all(math.isfinite(v) for v in last[1])
        if robot.twist == Twist2D() or len(robot.commands) > before:
            moving_since = robot.time
        elif about["robot"] != "command" or robot.time < about["since"]:
            assert moving_since is not None
            # a recovery's command holds until its next step, by contract
            held = 1.0 / 0.7 if manager.recovery == "slow" else 2.0 * PERIOD
            if about["driver"] == "takes long":
                held += TAKES_LONG_S  # no commands while the local planner computes
            assert robot.time - moving_since <= held + 0.021, about

    def client() -> None:
        kind = about["client"]
        if kind == "cancels":
            manager.cancel_goal(goals[0])
        elif kind == "cancels all":
            manager.cancel_all_goals()
        elif kind == "burst":
            goals.extend(manager.send_goal(Pose2D(rng.uniform(-2.0, 2.0), 1.0)) for _ in range(30))
        elif kind == "bad quaternion":
            goals.append(manager.send_goal(Pose2D(1.0, 1.0), orientation=(0.0, 0.0, 0.0, 0.0)))
        elif kind == "new goals":
            goals.append(manager.send_goal(Pose2D(rng.uniform(-2.0, 2.0), 1.0)))

    asked = False
    while not (all(goal.is_done for goal in goals) and (asked or about["client"] == "one goal")):
        if not asked and manager.next_due(robot.time) > moment:
            bench.run_to(max(moment, robot.time))
        else:
            turn()
        if not asked and robot.time >= moment:
            asked = True
            client()
            if about["client"] == "new goals" and len(goals) < 5:
                asked, moment = False, moment + rng.uniform(0.0, 1.0)
        if robot.time >= moment + 90.0:
            raise AssertionError(f"{[g for g in goals if not g.is_done]} has not ended in {manager.state}: {about}")

    for goal in goals:
        result = goal.result
        assert result.status is goal.status
        assert result.status.is_terminal
        assert (result.error_code == 0) == (result.status is GoalStatus.SUCCEEDED), about
        assert bool(result.message) == (result.error_code != 0), about
        assert result.error_name in codes(about), (about, result)
    if about["robot"] != "command":
        assert robot.twist == Twist2D(), about
    assert manager.state is Mode.IDLE
    # after the fault the next valid goal succeeds
    repair(bench)
    about["slow"][0] = 0.0
    bench.move_base._recoveries.behaviors = ()
    good = manager.send_goal(Pose2D(-1.0, -1.0, 0.5))
    bench.run(good, limit=60.0)
    assert good.status is GoalStatus.SUCCEEDED, (about, good.result)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, COMBINATIONS, BATCH))
def test_every_goal_ends_despite_faults(first: int) -> None:
    for seed in range(first, min(first + BATCH, COMBINATIONS)):
        run_one(seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in PLANNERS if n not in ("good", "fails at first", "fails sometimes")])
def test_a_faulty_global_planner(name: str) -> None:
    bench = Bench(planner=StraightPlanner(PLANNERS[name]), recoveries=[Waiting("a")])
    handle = bench.run(bench.move_base.send_goal(Pose2D(2.0, 0.0)))
    assert handle.text == "Failed to find a valid plan. Even after executing recovery behaviors."
    expected = {"no path": 208, "returns an empty plan": 200, "returns nothing": 200}.get(name, 9099)
    assert handle.result.error_code == expected
    assert "StraightPlanner" in handle.result.message or expected == 208


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "raises",
        "no control",
        "returns nothing",
        "returns nonsense",
        "returns NaN",
        "returns inf",
        "returns half a twist",
    ],
)
def test_a_faulty_local_planner(name: str) -> None:
    bench = Bench(driver=TurnAndGo(DRIVERS[name]), recoveries=[Waiting("a")])
    handle = bench.run(bench.move_base.send_goal(Pose2D(2.0, 0.0)))
    assert handle.text == "Failed to find a valid control. Even after executing recovery behaviors."
    assert handle.result.error_code == (106 if name == "no control" else 9099)
    assert {c for _, c in bench.robot.commands} == {Twist2D()}


def test_a_recovery_that_never_ends() -> None:
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[Waiting("endless", math.inf, frequency=20.0)])
    handle = bench.run(bench.move_base.send_goal(Pose2D(2.0, 0.0)))
    assert handle.status is GoalStatus.ABORTED
    assert handle.result.data["failures"]["RECOVERY_TIMEOUT"] == 1
    assert handle.result.time_s == pytest.approx(5.2 + 120.0 + 5.0 + 0.2, abs=0.1)


def test_cancels_at_every_tick_of_a_run() -> None:
    """A goal with a recovery, canceled at each of its ticks."""

    def scene() -> tuple[Bench, GoalHandle]:
        planner = StraightPlanner(lambda n: occupied(n) if n < 6 else None)
        bench = Bench(planner=planner, recoveries=[Waiting("turn", 1.0, frequency=20.0)], planner_patience=1.0)
        return bench, bench.move_base.send_goal(Pose2D(1.5, 0.5, 1.0))

    bench, handle = scene()
    times = [bench.tick()]
    while not handle.is_done:
        times.append(bench.tick())
    assert handle.status is GoalStatus.SUCCEEDED
    for k, time in enumerate(times[:-1]):
        bench, handle = scene()
        for _ in range(k + 1):
            bench.tick()
        bench.move_base.cancel_goal(handle)
        bench.run(handle)
        assert handle.status is GoalStatus.PREEMPTED
        assert bench.robot.time <= time + PERIOD + 1e-6
        assert bench.robot.twist == Twist2D()


def test_a_thousand_goals_at_the_same_time() -> None:
    bench = Bench()
    handles = [bench.move_base.send_goal(Pose2D(0.01 * n, 1.0)) for n in range(1000)]
    bench.run_to(1.0)
    handles += [bench.move_base.send_goal(Pose2D(1.0, 0.001 * n)) for n in range(1000)]
    bench.run(handles[-1])
    counts: dict[str, int] = {}
    for handle in handles:
        counts[handle.status.name] = counts.get(handle.status.name, 0) + 1
    assert counts == {"RECALLED": 1998, "PREEMPTED": 1, "SUCCEEDED": 1}
    # the status list is pruned
    bench.run_to(bench.robot.time + 10.0)
    bench.run(bench.move_base.send_goal(Pose2D(0.0, 0.0)))
    assert len(bench.move_base.server.statuses()) <= 2


def test_stopped_odometry_is_detected_by_its_age() -> None:
    bench = Bench()
    bench.robot.deaf_since = 2.0
    handle = bench.run(bench.move_base.send_goal(Pose2D(4.0, 0.0)))
    assert handle.status is GoalStatus.ABORTED
    assert (handle.result.error_code, handle.result.error_name) == (102, "TF_ERROR")
    stopped = next(t for t, c in bench.robot.commands if t > 2.0 and c == Twist2D())
    assert stopped <= 2.0 + 0.3 + PERIOD  # the costmap's tolerance and a cycle
