from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ValidationError

from navstack.behaviors import (
    ClearCostmapRecovery,
    ClearCostmapRecoveryParams,
    MoveSlowAndClear,
    MoveSlowAndClearParams,
    RotateRecovery,
    RotateRecoveryParams,
)
from navstack.core import (
    Bounds,
    CollisionAheadError,
    Footprint,
    ParameterError,
    Pose2D,
    RobotState,
    Twist2D,
    normalize_angle,
)
from navstack.plugins import BehaviorContext, BehaviorStatus, VelocityLimits
from tests.move_base.world import LIMITS, EmptyCostmap, KinematicRobot, TurnAndGo


class Scene:
    def __init__(self, start: Pose2D = Pose2D(1.0, 0.5, 0.3), limits: VelocityLimits = LIMITS) -> None:
        self.robot = KinematicRobot(start)
        self.planner = TurnAndGo(limits=limits)
        self.global_costmap = EmptyCostmap("global_costmap", "map", self.robot)
        self.local_costmap = EmptyCostmap("local_costmap", "odom", self.robot)
        self.context = BehaviorContext(self.global_costmap, self.local_costmap, self.planner, 5.0)

    @property
    def state(self) -> RobotState:
        return RobotState(self.robot.odom_pose, self.robot.twist, self.robot.time, "odom")

    def resets(self) -> dict[str, list[Any]]:
        return {
            f"{costmap.name}/{layer.name}": layer.resets
            for costmap in (self.global_costmap, self.local_costmap)
            for layer in costmap.layers
            if layer.resets
        }


# --- clear_costmap ----------------------------------------------------------------------------------------------------


def clear(scene: Scene, **params: Any) -> str:
    recovery = ClearCostmapRecovery("reset", ClearCostmapRecoveryParams(**params))
    recovery.check(scene.context)
    recovery.start(scene.context, 0.0)
    step = recovery.step(scene.state, 0.0)
    assert step.status is BehaviorStatus.DONE
    assert step.twist == Twist2D()
    return step.text


def test_layers_with_sensor_data_are_cleared_outside_the_square() -> None:
    scene = Scene()
    text = clear(scene)
    assert text == "Clearing both costmaps outside a square (3.00m) large centered on the robot."
    square = Bounds(-0.5, -1.0, 2.5, 2.0)
    assert scene.resets() == {
        "global_costmap/obstacle_layer": [(square, True)],
        "local_costmap/obstacle_layer": [(square, True)],
    }
    assert not scene.local_costmap.updates


@pytest.mark.parametrize(
    ("params", "text", "costmaps", "invert"),
    [
        ({"affected_maps": "local"}, "Clearing local costmap outside a square (3.00m)", ["local"], True),
        ({"affected_maps": "global"}, "Clearing global costmap outside a square (3.00m)", ["global"], True),
        (
            {"invert_area_to_clear": True, "reset_distance": 1.84},
            "Clearing both costmaps inside a square (1.84m)",
            ["global", "local"],
            False,
        ),
    ],
)
def test_which_and_where(params: dict[str, Any], text: str, costmaps: list[str], invert: bool) -> None:
    scene = Scene()
    assert clear(scene, **params) == f"{text} large centered on the robot."
    found = scene.resets()
    assert list(found) == [f"{name}_costmap/obstacle_layer" for name in costmaps]
    half = params.get("reset_distance", 3.0) / 2.0
    for ((region, inverted),) in found.values():
        assert region == Bounds(1.0 - half, 0.5 - half, 1.0 + half, 0.5 + half)
        assert inverted is invert


def test_layers_by_name_clearable_or_not() -> None:
    scene = Scene()
    clear(scene, layer_names=["static_layer", "somewhere/obstacle_layer"], affected_maps="global")
    assert set(scene.resets()) == {"global_costmap/static_layer", "global_costmap/obstacle_layer"}


def test_an_unknown_layer_name_is_an_error() -> None:
    scene = Scene()
    recovery = ClearCostmapRecovery("reset", ClearCostmapRecoveryParams(layer_names=["obstacles"]))
    with pytest.raises(ParameterError, match=r'reset/layer_names.*"obstacles".*static_layer, obstacle_layer') as caught:
        recovery.check(scene.context)
    assert caught.value.data["layer"] == "obstacles"
    with pytest.raises(ParameterError):
        recovery.start(scene.context, 0.0)


def test_force_updating() -> None:
    scene = Scene()
    clear(scene, force_updating=True, affected_maps="local")
    assert scene.local_costmap.updates == [0.0]
    assert not scene.global_costmap.updates


def test_unknown_affected_maps() -> None:
    for bad in ({"affected_maps": "all"}, {"reset_distance": -1.0}, {"layer_names": "obstacles"}, {"reset": 1.0}):
        with pytest.raises(ValidationError):
            ClearCostmapRecoveryParams.model_validate(bad)
    assert ClearCostmapRecoveryParams.RENAMED == {"layer_search_string": "layer_names"}


# --- rotate -----------------------------------------------------------------------------------------------------------


def turn(scene: Scene, recovery: RotateRecovery, limit: float = 60.0) -> tuple[list[Twist2D], list[str]]:
    """Run the behavior to its end; return the commands and the texts."""
    recovery.start(scene.context, scene.robot.time)
    commands: list[Twist2D] = []
    texts: list[str] = []
    k = 0
    while True:
        step = recovery.step(scene.state, scene.robot.time)
        texts.append(step.text)
        scene.robot.command(step.twist)
        if step.status is not BehaviorStatus.RUNNING:
            assert step.status is BehaviorStatus.DONE
            return commands, texts
        commands.append(step.twist)
        k += 1
        scene.robot.advance_to(k / recovery.frequency)
        assert scene.robot.time < limit


def rotate(**params: Any) -> RotateRecovery:
    return RotateRecovery("spin", RotateRecoveryParams(**params))


@pytest.mark.parametrize("yaw", [-3.1, 0.0, 0.3, math.pi])
def test_a_full_turn_counter_clockwise_then_a_stop(yaw: float) -> None:
    scene = Scene(Pose2D(0.0, 0.0, yaw))
    commands, texts = turn(scene, rotate())
    assert texts[0] == "Rotate recovery behavior started."
    assert all(c.vx == c.vy == 0.0 and 0.4 <= c.wz <= 1.0 for c in commands)
    # C++ sent 125 commands at 20 Hz for the same limits (golden e2e)
    assert len(commands) == pytest.approx(125, abs=1)
    turned = sum(c.wz for c in commands) / 20.0
    assert 2.0 * math.pi - 0.1 <= turned <= 2.0 * math.pi
    assert scene.robot.twist == Twist2D()
    assert abs(normalize_angle(scene.robot.odom_pose.yaw - yaw)) <= 0.1


def test_it_decelerates_at_the_limit() -> None:
    scene = Scene(limits=LIMITS._replace(acc_lim_theta=0.5, max_vel_theta=0.9, min_vel_theta=0.2))
    commands, _ = turn(scene, rotate(frequency=50.0))
    turned = 0.0
    for command in commands:
        left = 2.0 * math.pi - turned
        assert command.wz == pytest.approx(min(0.9, math.sqrt(2.0 * 0.5 * left)), abs=1e-6)
        turned += command.wz / 50.0
    assert commands[-1].wz < 0.4


def test_limits_of_the_local_planner_and_its_own() -> None:
    slow = Scene(limits=LIMITS._replace(max_vel_theta=0.5, min_vel_theta=0.1))
    assert max(c.wz for c in turn(slow, rotate())[0]) == 0.5
    fast = Scene(limits=LIMITS._replace(max_vel_theta=5.0))
    assert max(c.wz for c in turn(fast, rotate())[0]) == 1.0
    faster = Scene(limits=LIMITS._replace(max_vel_theta=5.0))
    assert max(c.wz for c in turn(faster, rotate(max_rotational_vel=3.0))[0]) == 3.0
    # a minimum above the maximum is ignored
    odd = Scene(limits=LIMITS._replace(max_vel_theta=0.3, min_vel_theta=0.4))
    assert {c.wz for c in turn(odd, rotate())[0]} == {0.3}


def test_a_wide_goal_tolerance_does_not_shorten_the_turn() -> None:
    scene = Scene(Pose2D(0.0, 0.0, 0.0), LIMITS._replace(yaw_goal_tolerance=1.5))
    commands, _ = turn(scene, rotate())
    assert sum(c.wz for c in commands) / 20.0 >= 2.0 * math.pi - 0.1


def test_a_square_robot_beside_a_wall_does_not_turn() -> None:
    scene = Scene(Pose2D(0.0, 0.0, 0.0))
    scene.local_costmap.footprint = Footprint([[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]])  # type: ignore[arg-type]
    ix, iy = scene.local_costmap.master.geometry.world_to_cell(0.36, 0.0) or (0, 0)
    scene.local_costmap.master.data[:, ix] = 254
    del iy
    recovery = rotate()
    recovery.start(scene.context, 0.0)
    with pytest.raises(CollisionAheadError, match="potential collision") as caught:
        recovery.step(scene.state, 0.0)
    assert caught.value.data["cost"] == 254
    # the corner hits the wall's cell (from 0.35 m) after acos(0.35 / 0.424) - (-45 degrees)
    expected = math.pi / 4.0 - math.acos(0.35 / math.hypot(0.3, 0.3))
    assert caught.value.data["collision_after_rad"] == pytest.approx(expected, abs=0.03)
    assert caught.value.code == 703


def test_a_new_obstacle_stops_it() -> None:
    scene = Scene(Pose2D(0.0, 0.0, 0.0))
    recovery = rotate()
    recovery.start(scene.context, 0.0)
    for k in range(20):
        step = recovery.step(scene.state, scene.robot.time)
        scene.robot.command(step.twist)
        scene.robot.advance_to((k + 1) / 20.0)
    cell = scene.local_costmap.master.geometry.world_to_cell(0.0, -0.19)
    assert cell is not None
    scene.local_costmap.master.data[cell[1], cell[0]] = 254
    with pytest.raises(CollisionAheadError):
        recovery.step(scene.state, scene.robot.time)


def test_unknown_cells_and_the_edge_stop_it() -> None:
    scene = Scene(Pose2D(4.9, 0.0, 0.0))
    recovery = rotate()
    recovery.start(scene.context, 0.0)
    with pytest.raises(CollisionAheadError, match="edge"):
        recovery.step(scene.state, 0.0)
    scene = Scene(Pose2D(0.0, 0.0, 0.0))
    scene.local_costmap.master.data[:] = 255
    recovery.start(scene.context, 0.0)
    with pytest.raises(CollisionAheadError, match="unknown"):
        recovery.step(scene.state, 0.0)


# --- move_slow_and_clear ------------------------------------------------------------------------------------------------


def test_it_clears_lowers_the_limits_and_restores_them() -> None:
    scene = Scene()
    recovery = MoveSlowAndClear("creep", MoveSlowAndClearParams())
    recovery.start(scene.context, 0.0)
    step = recovery.step(scene.state, 0.0)
    assert step.status is BehaviorStatus.DONE
    square = Bounds(0.5, 0.0, 1.5, 1.0)
    assert scene.resets() == {
        "global_costmap/obstacle_layer": [(square, False)],
        "local_costmap/obstacle_layer": [(square, False)],
    }
    assert scene.planner.limited == [(0.25, 0.45)]
    assert recovery.follow_up(scene.state, 1.0)
    near = RobotState(Pose2D(1.29, 0.5, 0.0))
    assert recovery.follow_up(near, 2.0)
    assert scene.planner.limited == [(0.25, 0.45)]
    far = RobotState(Pose2D(1.31, 0.5, 0.0))
    assert not recovery.follow_up(far, 3.0)
    assert scene.planner.limited == [(0.25, 0.45), (None, None)]
    assert not recovery.follow_up(far, 4.0)
    assert len(scene.planner.limited) == 2


def test_former_parameter_names_have_no_effect() -> None:
    assert set(MoveSlowAndClearParams.NO_EFFECT) == {
        "max_trans_param_name",
        "max_rot_param_name",
        "planner_namespace",
    }
