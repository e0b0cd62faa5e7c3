"""What plugins return and raise: nothing of it leaves `tick`, no command beyond the robot's limits, and the plugin is named."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import (
    Bounds,
    Costmap,
    GridGeometry,
    InternalError,
    OccupancyGrid,
    Path,
    Pose2D,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.costmap import InflationLayer
from navstack.docking.detectors import PoseTopicDetector
from navstack.docking.dock_types import SimpleChargingDock, SimpleChargingDockParams
from navstack.localization import DeadReckoning
from navstack.move_base import GoalHandle, GoalStatus
from navstack.parameters import load_configuration
from navstack.plugins import (
    CommandLimits,
    Critic,
    GoalChecker,
    Layer,
    LocalPath,
    LocalPlan,
    ParamModel,
    PathHandler,
    Plan,
    PoseEstimate,
    ProgressChecker,
    RecoveryStatus,
    RecoveryStep,
    Rollouts,
    param,
)
from navstack.sim import World
from tests.move_base.world import (
    LIMITS,
    Bench,
    StraightPlanner,
    TurnAndGo,
    Waiting,
    occupied,
)

MESS: list[Any] = [
    *(
        None,
        True,
        7,
        -1,
        math.nan,
        math.inf,
        "yes",
        "",
        b"x",
        (),
        (1.0,),
        [1, 2, 3],
        {},
        {1: 2},
        {"message": "m"},
        object(),
    ),
    *(np.zeros(3), np.array(["a"], object), np.zeros((0, 3)), np.float32(2.0), 1e300, Exception, lambda: None),
    *(Twist2D(99.0, 0.0, 0.0), Pose2D(math.nan, 0.0, 0.0), Transform2D(math.inf, 0.0, 0.0), Window(0, 0, 9999, 9999)),
    *(Bounds(-math.inf, -math.inf, math.inf, math.inf), Path(np.zeros((2, 3))), LocalPlan(Twist2D(99.0, 0.0, 0.0))),
]


class Odd:
    """An object none of whose operations works."""

    def __getattribute__(self, name: str) -> Any:
        if name in ("__class__", "__dict__"):
            return object.__getattribute__(self, name)
        raise RuntimeError(f"no {name}")

    def __bool__(self) -> bool:
        raise RuntimeError("no truth")

    def __repr__(self) -> str:
        raise RuntimeError("no text")


MESS.append(Odd())


def plan_of(poses: Any, **changes: Any) -> Plan:
    path = Path(np.zeros((2, 3)), "map")
    object.__setattr__(path, "poses", poses)
    return replace(Plan(path, 1.0, Pose2D(1.0, 0.0)), **changes)


STRAIGHT = np.column_stack((np.linspace(0.0, 2.0, 40), np.zeros(40), np.zeros(40)))
PLANS: list[Any] = [
    plan_of(STRAIGHT.astype(object)),
    plan_of(np.array([["a"] * 3] * 2)),
    plan_of(STRAIGHT.astype(complex)),
    plan_of(STRAIGHT[:, :2]),
    plan_of(STRAIGHT.tolist()),
    plan_of(None),
    *(plan_of(STRAIGHT, goal=goal) for goal in (None, (1.0, 0.0), Pose2D("a", 0.0, 0.0), Pose2D(math.nan, 0.0))),  # type: ignore[arg-type]
    *(plan_of(STRAIGHT, cost=cost) for cost in (None, "1", [1.0])),
    *(plan_of(STRAIGHT, notes=notes) for notes in (None, (1,), 3)),
    plan_of(STRAIGHT, potential="p"),
    plan_of(STRAIGHT, path=Path(STRAIGHT, 3)),  # type: ignore[arg-type]
    plan_of(STRAIGHT, path=STRAIGHT),
]
STEPS: list[Any] = [
    RecoveryStep(RecoveryStatus.RUNNING, Twist2D(99.0, 0.0, 0.0)),
    RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, -50.0)),
    RecoveryStep(RecoveryStatus.RUNNING, Twist2D("a", 0.0, 0.0)),  # type: ignore[arg-type]
    RecoveryStep("running", Twist2D()),  # type: ignore[arg-type]
    RecoveryStep(RecoveryStatus.FAILED, data={"message": "m", "recovery": 3, "self": 1}),
    RecoveryStep(RecoveryStatus.FAILED, data={1: 2}),  # type: ignore[dict-item]
    RecoveryStep(RecoveryStatus.FAILED, text=3, data=None),  # type: ignore[arg-type]
    RecoveryStep(RecoveryStatus.DONE, text=None),  # type: ignore[arg-type]
]
LOCAL_PLANS: list[Any] = [
    *(
        LocalPlan(Twist2D(*command))
        for command in ((50.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, -9.0), (0.7, 0.0, 0.0))
    ),
    *(LocalPlan(command) for command in (None, "go", (1.0, 0.0, 0.0), Twist2D("a", 0.0, 0.0), Twist2D(0.1, None, 0.0))),  # type: ignore[arg-type]
    LocalPlan(Twist2D(0.1, 0.0, 0.0), samples="s"),  # type: ignore[arg-type]
    LocalPlan(Twist2D(0.1, 0.0, 0.0), samples=np.zeros((2, 3)), best=5),
    LocalPlan(Twist2D(0.1, 0.0, 0.0), trajectory=np.array([None])),
    LocalPlan(Twist2D(0.1, 0.0, 0.0), local_plan=3),  # type: ignore[arg-type]
    LocalPlan(Twist2D(0.1, 0.0, 0.0), notes=3),  # type: ignore[arg-type]
    LocalPlan(Twist2D(0.1, 0.0, 0.0), mode=3),  # type: ignore[arg-type]
]


def ended(bench: Bench, limit_s: float = 60.0) -> GoalHandle:
    """Drive to a goal; it must end, whatever the parts return, without a command beyond the limits."""
    handle = bench.move_base.send_goal(Pose2D(1.5, 0.0, 0.0))
    while not handle.is_done and bench.robot.time < limit_s:
        bench.tick()
    assert handle.is_done
    assert bench.robot.twist == Twist2D()
    assert all(math.hypot(t.vx, t.vy) <= 0.54 and abs(t.wz) <= 1.1 for _, t in bench.robot.commands)
    return handle


def bench_with(part: str, method: str, value: Any) -> Bench:
    """Return a bench in which one method (or property) of one part returns a value, or raises it."""
    planner = StraightPlanner(occupied) if part == "behavior" else StraightPlanner()
    behaviors = [Waiting("odd_one", 0.4, frequency=20.0)]
    bench = Bench(
        planner=planner, recoveries=behaviors, planner_patience=0.5, controller_patience=0.5, oscillation_timeout=4.0
    )
    parts: dict[str, Any] = {
        "planner": planner,
        "driver": bench.driver,
        "behavior": behaviors[0],
        "layer": bench.local_costmap.layers[0],
        "costmap": bench.local_costmap,
        "robot": bench.robot,
    }
    target = parts[part]

    def answer(*_: Any, **__: Any) -> Any:
        if isinstance(value, type) and issubclass(value, BaseException):
            raise value("broke")
        return value

    is_property = isinstance(getattr(type(target), method, None), property)
    members = {method: property(answer) if is_property else answer}
    target.__class__ = type(type(target).__name__, (type(target),), members)
    return bench


METHODS = [
    ("planner", "make_plan"),
    *(("driver", name) for name in ("limits", "set_plan", "compute_command", "goal_reached", "brake", "reset")),
    *(("behavior", name) for name in ("start", "step", "frequency", "follow_up")),
    ("layer", "inflation"),
    *(("costmap", name) for name in ("update", "is_current", "problems", "robot_pose", "explain", "observe", "reset")),
    *(("robot", name) for name in ("state", "scans", "localization_status")),
]


@pytest.mark.slow
@pytest.mark.parametrize(("part", "method"), METHODS, ids=[f"{part}.{method}" for part, method in METHODS])
@pytest.mark.filterwarnings("ignore")
def test_no_result_leaves_the_tick(part: str, method: str) -> None:
    extra = {
        "make_plan": PLANS,
        "compute_command": LOCAL_PLANS,
        "step": STEPS,
        "limits": [LIMITS._replace(max_vel_x="a")],
    }
    for value in [*MESS, *extra.get(method, []), ValueError, RecursionError]:
        ended(bench_with(part, method, value))


@pytest.mark.parametrize("value", PLANS)
def test_a_broken_plan_names_its_planner(value: Any) -> None:
    handle = ended(bench_with("planner", "make_plan", value))
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert "StraightPlanner" in handle.result.message


def test_a_path_of_float32_is_a_path() -> None:
    plan = plan_of(STRAIGHT[:31].astype(np.float32), goal=Pose2D(1.5, 0.0))
    assert ended(bench_with("planner", "make_plan", plan)).status is GoalStatus.SUCCEEDED


@pytest.mark.parametrize("value", LOCAL_PLANS)
def test_a_broken_command_names_its_planner(value: Any) -> None:
    handle = ended(bench_with("driver", "compute_command", value))
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert "TurnAndGo" in handle.result.message


@pytest.mark.parametrize(
    "value", [None, ValueError, (1.0,), LIMITS._replace(max_vel_x=None), LIMITS._replace(max_vel_theta="a")]
)  # type: ignore[arg-type]
def test_broken_limits_name_their_planner(value: Any) -> None:
    handle = ended(bench_with("driver", "limits", value))
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert "TurnAndGo" in handle.result.message


@pytest.mark.parametrize("value", ["no", 1, None, [False], 0.0])
def test_a_goal_is_not_reached_by_what_counts_as_true(value: Any) -> None:
    handle = ended(bench_with("driver", "goal_reached", value))
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert "TurnAndGo returned" in handle.result.message


@pytest.mark.parametrize("value", STEPS[:3])
def test_a_recovery_keeps_the_limits(value: Any) -> None:
    bench = bench_with("behavior", "step", value)
    handle = ended(bench)
    assert handle.status is GoalStatus.ABORTED
    assert handle.result.data["failures"]["INTERNAL"] == 1
    assert any("odd_one commands" in event.text for event in bench.listener.of("recovery"))


class Fast(ParamModel):
    """Parameters of a recovery that is faster than the local planner."""

    turning: float = param(2.0, "speed of the turn", unit="rad/s")


@pytest.mark.parametrize(("turning", "succeeds"), [(2.0, True), (1.5, False)])
def test_a_recovery_may_be_as_fast_as_its_own_parameters(turning: float, succeeds: bool) -> None:
    fast = Waiting(
        "fast", 1.0, lambda n: RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, 2.0)) if n < 3 else None
    )
    fast.params = Fast(turning=turning)
    bench = Bench()
    handle = bench.move_base.motions.start(fast)
    while bench.move_base.motions.running is not None:
        bench.tick()
    assert handle.succeeded is succeeds, handle.text
    assert (Twist2D(0.0, 0.0, 2.0) in [twist for _, twist in bench.robot.commands]) is succeeds


def test_a_robot_that_is_too_fast_may_brake() -> None:
    """A command above the limits is allowed up to the current velocity, and while limits are lowered."""
    driver = TurnAndGo()
    limits = CommandLimits(driver)
    for speed in (0.9, 0.7):
        limits.check(driver, Twist2D(speed, 0.0, 0.0), Twist2D(speed + 0.1, 0.0, 0.0))
    with pytest.raises(InternalError, match=r"TurnAndGo commands .* beyond the limits of the robot"):
        limits.check(driver, Twist2D(0.9, 0.0, 0.0), Twist2D(0.5, 0.0, 0.0))
    driver._limits = LIMITS._replace(max_vel_x=0.1, max_vel_trans=0.1)
    limits.check(driver, Twist2D(0.5, 0.0, 0.0), Twist2D())


class OddChecker(ProgressChecker):
    """A progress checker that returns or raises something else."""

    Params = ParamModel

    def __init__(self, value: Any) -> None:
        super().__init__(None)
        self.value = value

    def reset(self) -> None:
        raise ValueError("reset")

    def makes_progress(self, pose: Pose2D, now: float) -> Any:
        if isinstance(self.value, type):
            raise self.value("broke")
        return self.value

    @property
    def failure(self) -> str:
        raise KeyError("failure")


@pytest.mark.parametrize("value", [None, "yes", 1, ValueError, False])
def test_a_broken_progress_checker_is_named(value: Any) -> None:
    bench = Bench(recoveries=[Waiting("a")])
    bench.move_base._progress_checker = OddChecker(value)
    handle = ended(bench)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert "OddChecker" in handle.result.message


# --- layers and critics -----------------------------------------------------------------------------------------------


def returns(value: Any) -> Callable[[Any], Any]:
    return lambda _: value


class OddLayer(Layer):
    """A layer that does to the grid what `act` does."""

    Params = ParamModel
    act: Callable[[Costmap], Any] = staticmethod(returns(None))
    bounds: Callable[[Bounds], Any] | None = None

    def match_size(self, geometry: GridGeometry) -> None:
        del geometry

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Any:
        change = type(self).bounds
        return bounds if change is None else change(bounds)

    def update_costs(self, master: Costmap, window: Window) -> None:
        type(self).act(master)


def replace_data(shape: tuple[int, int]) -> Callable[[Costmap], None]:
    def act(master: Costmap) -> None:
        master.data = np.zeros(shape, np.uint8)

    return act


def replace_geometry(master: Costmap) -> None:
    master.geometry = GridGeometry(40_000, 40_000, 0.01)


def fail(master: Costmap) -> None:
    raise ZeroDivisionError("odd")


ACTS: list[dict[str, Any]] = [
    {"act": replace_data((4000, 4000))},
    {"act": replace_data((3, 3))},
    {"act": replace_geometry},
    {"act": fail},
    *({"bounds": returns(value)} for value in (None, 3, "b", (0.0, 0.0, 1.0, 1.0), Bounds(math.nan, 0.0, 0.0, 0.0))),
]


@pytest.mark.parametrize("members", ACTS)
def test_a_layer_that_breaks_the_grid_is_named(members: dict[str, Any]) -> None:
    configuration = load_configuration(["turtlebot"], overrides=["controller_patience=1.0"])
    grid = OccupancyGrid(np.zeros((100, 100), np.int8), GridGeometry(100, 100, 0.05, -2.5, -2.5))
    robot = simulated_robot(configuration, World(grid), Pose2D(0.0, 0.0, 0.0))
    move_base = build_move_base(configuration, robot, static_map=grid)
    costmap: Any = move_base.local_costmap
    shape = costmap.master.data.shape
    (inflation,) = [layer for layer in costmap.layers if isinstance(layer, InflationLayer)]
    odd = OddLayer(inflation.params, inflation.context)
    odd.name = "odd_layer"
    odd.__class__ = type("OddLayer", (OddLayer,), {name: staticmethod(value) for name, value in members.items()})
    costmap._layers.append(odd)
    handle = move_base.send_goal(Pose2D(2.0, 0.0, 0.0))
    while not handle.is_done and robot.time < 20.0:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert "odd_layer" in handle.result.message
    assert costmap.master.data.shape == costmap.master.geometry.shape == shape
    assert robot.distance_travelled < 0.05


class OddCritic(Critic):
    """A critic that drives as fast as it likes."""

    Params = ParamModel
    name = "Odd"

    def __init__(self, act: Callable[[Rollouts], Any]) -> None:
        self.act = act

    @property
    def scale(self) -> float:
        return 1.0

    def prepare(self, context: Any) -> None:
        del context

    def reset(self) -> None:
        pass

    def score(self, rollouts: Rollouts) -> Any:
        return self.act(rollouts)


def faster(rollouts: Rollouts) -> Any:
    rollouts.commands[:] = 50.0, 0.0, 0.0
    return np.zeros(len(rollouts.counts))


def a_little_faster(rollouts: Rollouts) -> Any:
    rollouts.commands[:, 0] += 0.01
    return np.zeros(len(rollouts.counts))


def crash(rollouts: Rollouts) -> Any:
    raise IndexError("odd")


@pytest.mark.parametrize("act", [faster, a_little_faster, crash, returns(None), returns([0.0])])
def test_a_critic_that_breaks_the_rollouts_is_named(act: Callable[[Rollouts], Any]) -> None:
    configuration = load_configuration(
        ["turtlebot"], overrides=["controller_patience=1.0", "recovery_behavior_enabled=false"]
    )
    grid = OccupancyGrid(np.zeros((100, 100), np.int8), GridGeometry(100, 100, 0.05, -2.5, -2.5))
    robot = simulated_robot(configuration, World(grid), Pose2D(0.0, 0.0, 0.0))
    move_base = build_move_base(configuration, robot, static_map=grid)
    planner: Any = move_base.local_planner
    planner.critics.append(OddCritic(act))
    handle = move_base.send_goal(Pose2D(2.0, 0.0, 0.0))
    while not handle.is_done and robot.time < 20.0:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert "Odd" in handle.result.message
    assert robot.distance_travelled < 0.05


# --- what planners and the simulator call: goal checkers, path handlers, localizers, docks ----------------------------


def with_method(cls: Any, name: str, value: Any) -> Any:
    """Return a subclass in which one method (or property) returns a value, or raises it."""

    def answer(*_: Any, **__: Any) -> Any:
        if isinstance(value, type) and issubclass(value, BaseException):
            raise value("broke")
        return value

    is_property = isinstance(getattr(cls, name), property)
    return type("Odd" + cls.__name__, (cls,), {name: property(answer) if is_property else answer})


NO_TRUTHS = [None, "yes", 1, 0.0, [True], np.ones(1), ValueError]
FLAT = np.column_stack((np.linspace(0.0, 2.0, 9), np.zeros(9), np.zeros(9)))
NO_LOCAL_PATHS: list[Any] = [
    None,
    FLAT,
    ValueError,
    *(LocalPath(poses, 2.0, 2.0, 0, 9) for poses in (FLAT * math.nan, FLAT[:0], FLAT.tolist(), FLAT.astype(object))),
    LocalPath(FLAT, "2", 2.0, 0, 9),  # type: ignore[arg-type]
]
PARTS = [
    *(("_goal_checker", name, value) for name in ("at_position", "at_heading", "stopped") for value in NO_TRUTHS),
    *(("_path_handler", "local_path", value) for value in NO_LOCAL_PATHS),
]


@pytest.mark.parametrize(("part", "method", "value"), PARTS)
def test_a_part_of_a_planner_that_returns_something_else_is_named(part: str, method: str, value: Any) -> None:
    configuration = load_configuration(
        ["turtlebot_rpp"], overrides=["controller_patience=0.5", "recovery_behavior_enabled=false"]
    )
    grid = OccupancyGrid(np.zeros((100, 100), np.int8), GridGeometry(100, 100, 0.05, -2.5, -2.5))
    robot = simulated_robot(configuration, World(grid), Pose2D(0.0, 0.0, 0.0))
    move_base = build_move_base(configuration, robot, static_map=grid)
    target = next(
        v
        for v in vars(move_base.local_planner).values()
        if isinstance(v, (GoalChecker, PathHandler)) and hasattr(v, method)
    )
    target.__class__ = with_method(type(target), method, value)
    handle = move_base.send_goal(Pose2D(0.8, 0.0, 0.0))
    while not handle.is_done and robot.time < 20.0:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "INTERNAL")
    assert type(target).__name__ in handle.result.message


def estimate(**changes: Any) -> PoseEstimate:
    return replace(PoseEstimate(Pose2D(0.0, 0.0), np.eye(3), Transform2D(), 0.0), **changes)


NO_ESTIMATES = [
    "here",
    True,
    ValueError,
    estimate(pose=None),
    estimate(map_to_odom=Transform2D(math.nan, 0.0, 0.0)),
    estimate(covariance=np.eye(2)),
    estimate(stamp=math.nan),
]


@pytest.mark.parametrize("value", NO_ESTIMATES)
def test_a_localizer_that_returns_something_else_is_named(value: Any) -> None:
    localizer = with_method(DeadReckoning, "update", value)(DeadReckoning.Params(), seed=0)
    with pytest.raises(InternalError, match="OddDeadReckoning"):
        localizer.update(Transform2D(), None, Transform2D())


def test_other_results_of_localizers_are_checked() -> None:
    wrong = [("status", True), ("possible_poses", (np.zeros((3, 3)), np.zeros(2))), ("estimate", Pose2D(0.0, 0.0))]
    for name, value in wrong:
        localizer = with_method(DeadReckoning, name, value)(DeadReckoning.Params(), seed=0)
        with pytest.raises(InternalError, match=f"OddDeadReckoning returned .* from {name}"):
            found = getattr(localizer, name)
            found()


@pytest.mark.parametrize(
    ("method", "value"),
    [
        ("is_docked", "yes"),
        ("refined_pose", (1.0, 0.0, 0.0)),
        ("staging_pose", Pose2D(math.nan, 0.0)),
        ("is_docked", ValueError),
    ],
)
def test_a_type_of_dock_that_returns_something_else_is_named(method: str, value: Any) -> None:
    dock = with_method(SimpleChargingDock, method, value)("home", SimpleChargingDockParams())
    with pytest.raises(InternalError, match=r"home (returned|raised)"):
        getattr(dock, method)(None)


def test_a_detector_of_docks_that_returns_something_else_is_named() -> None:
    detector = with_method(PoseTopicDetector, "detect", Pose2D(0.0, 0.0))(PoseTopicDetector.Params())
    with pytest.raises(InternalError, match="OddPoseTopicDetector returned"):
        detector.detect(None, Pose2D(0.0, 0.0))
