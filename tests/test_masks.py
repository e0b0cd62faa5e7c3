"""Masks end to end: plans avoid keepout areas, the robot obeys speed limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import navstack as nav
from navstack.bringup import build_costmap, build_move_base, plan_on_map, simulated_robot
from navstack.core import Event, GridGeometry, OccupancyGrid, Pose2D, Transform2D
from navstack.map_io import load_map, load_mask
from navstack.move_base import SpeedLimiter
from navstack.parameters import load_configuration

STATIC = {"name": "static_layer", "type": "costmap_2d::StaticLayer"}
OBSTACLES = {"name": "obstacle_layer", "type": "costmap_2d::VoxelLayer"}
INFLATION = {"name": "inflation_layer", "type": "costmap_2d::InflationLayer"}

# map, its mask, and straight lines through its forbidden areas (m)
REAL = [
    ("fetch_ros__9_16_15/9_16_15.yaml", "fetch_ros__9_16_15_keepout/9_16_15_keepout.yaml", (16.625, 29.375), (38.775, 26.625)),
    ("fetch_ros__9_16_15/9_16_15.yaml", "fetch_ros__9_16_15_keepout/9_16_15_keepout.yaml", (30.575, 15.775), (16.875, 35.225)),
    ("navigation2__depot/depot.yaml", "navigation2__depot_keepout/depot_keepout.yaml", (20.125, 6.825), (21.075, 0.975)),
    ("navigation2__depot/depot.yaml", "navigation2__depot_keepout/depot_keepout.yaml", (26.175, 11.525), (9.625, 6.575)),
]  # fmt: skip


def keepout(mask: Path | str, kind: str = "keepout_mask") -> dict[str, Any]:
    layers = [STATIC, {"name": "keepout", "type": kind}, INFLATION]
    return {"global_costmap": {"plugins": layers, "keepout": {"mask": str(mask)}}}


def masked_poses(mask: OccupancyGrid, poses: np.ndarray) -> int:
    cells = [mask.geometry.world_to_cell(x, y) for x, y, _ in poses.tolist()]
    return sum(cell is not None and int(mask.data[cell[1], cell[0]]) == 100 for cell in cells)


@pytest.mark.slow
@pytest.mark.parametrize(("map_file", "mask_file", "start", "goal"), REAL)
def test_plan_avoids_a_keepout_mask(
    data_dir: Path, map_file: str, mask_file: str, start: tuple[float, float], goal: tuple[float, float]
) -> None:
    """With the mask before the inflation layer, no pose is within the inscribed radius of a forbidden cell."""
    grid, mask = load_map(data_dir / "maps" / map_file), load_mask(data_dir / "maps" / mask_file)
    ends = Pose2D(*start), Pose2D(*goal)
    free = plan_on_map(load_configuration(["turtlebot"]), grid, *ends).plan.path
    kept = plan_on_map(load_configuration(["turtlebot", keepout(data_dir / "maps" / mask_file)]), grid, *ends)
    assert masked_poses(mask, free.poses) > 10
    assert masked_poses(mask, kept.plan.path.poses) == 0
    assert kept.plan.path.length > free.length
    for x, y, _ in kept.plan.path.poses.tolist():
        cost = kept.costmap.master.cost_at(x, y)
        assert cost is not None and cost < 253


def test_mask_by_override_and_by_its_nav2_name(data_dir: Path) -> None:
    mask = data_dir / "maps" / "navigation2__depot_keepout" / "depot_keepout.yaml"
    grid = load_map(data_dir / "maps" / "navigation2__depot" / "depot.yaml")
    given = [f"global_costmap/keepout/mask={mask}"]
    parameters = ["turtlebot", keepout("", "nav2_costmap_2d::KeepoutFilter")]
    configuration = load_configuration(parameters, overrides=given)
    found = plan_on_map(configuration, grid, Pose2D(20.125, 6.825), Pose2D(21.075, 0.975))
    assert masked_poses(load_mask(mask), found.plan.path.poses) == 0
    # disabled: no effect
    off = load_configuration(parameters, overrides=[*given, "global_costmap/keepout/enabled=false"])
    without = plan_on_map(off, grid, Pose2D(20.125, 6.825), Pose2D(21.075, 0.975))
    assert masked_poses(load_mask(mask), without.plan.path.poses) > 10


def test_missing_mask_file_is_one_error() -> None:
    configuration = load_configuration(["turtlebot", keepout("nowhere/mask.yaml")])
    grid = nav.load_map(nav.map_path("office"))
    with pytest.raises(nav.NavError, match=r"nowhere.mask\.yaml"):
        plan_on_map(configuration, grid, Pose2D(0.8, 7.45), Pose2D(22.2, 7.45))


def test_white_in_mode_scale_is_no_limit(data_dir: Path) -> None:
    """ROS 1's map_server converts it to 1, a limit of 1 %."""
    file = data_dir / "maps" / "navigation2__depot_speed" / "depot_speed.yaml"
    assert load_map(file).data.min() == 1
    mask = load_mask(file)
    assert sorted(np.unique(mask.data)) == [0, 20, 25, 50, 100]


# --- speed ------------------------------------------------------------------------------------------------------------

SLOW = (3.0, 5.0)
"""Extent of the speed limit along x (m)."""


def speed_mask(folder: Path, value: int) -> Path:
    """Return a mask for a map of 10 m x 4 m: `value` in the zone, 0 elsewhere."""
    data = np.zeros((40, 100), np.int8)
    data[:, 30:50] = value
    return nav.save_map(OccupancyGrid(data, GridGeometry(100, 40, 0.1)), folder / f"mask{value}.yaml")[0]


class Ear:
    """Stores the log lines about speed limits."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def on_event(self, event: Event) -> None:
        if "speed mask" in event.text:
            self.said.append(event.text)


def room() -> OccupancyGrid:
    return OccupancyGrid(np.zeros((80, 200), np.int8), GridGeometry(200, 80, 0.05))


def drive(where: str, mask: Path | None, **layer: Any) -> tuple[list[tuple[float, float]], list[str], nav.MoveBase]:
    """x and speed at every physics step on the way through an empty room, and the log of what the masks said."""
    layers = [STATIC, OBSTACLES, INFLATION] if where == "global_costmap" else [OBSTACLES, INFLATION]
    parameters: dict[str, Any] = {}
    if mask is not None:
        listed = [*layers, {"name": "slow", "type": "speed_mask"}]
        parameters = {where: {"plugins": listed, "slow": {"mask": str(mask), **layer}}}
    configuration = load_configuration(["turtlebot", parameters])
    robot = simulated_robot(configuration, room(), Pose2D(1.0, 2.0, 0.0))
    ear = Ear()
    move_base = build_move_base(configuration, robot, static_map=room(), listeners=[ear])
    handle = move_base.send_goal(Pose2D(8.0, 2.0, 0.0))
    track: list[tuple[float, float]] = []
    while not handle.is_done:
        samples = robot.advance_to(move_base.next_due(robot.time))
        track += [(row[0], float(np.hypot(row[6], row[7]))) for row in samples.tolist()]
        move_base.tick(robot.time)
        assert robot.time < 300.0
    assert handle.status.name == "SUCCEEDED"
    return track, ear.said, move_base


def fastest(track: list[tuple[float, float]], left: float, right: float) -> float:
    return max(speed for x, speed in track if left <= x <= right)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "value", "layer", "limit"),
    [
        ("local_costmap", 40, {}, 0.2),  # percent of 0.5 m/s
        ("global_costmap", 40, {}, 0.2),
        ("local_costmap", 10, {"type": "absolute", "multiplier": 0.01, "base": 0.05}, 0.15),
    ],
)
def test_slow_inside_the_zone_only(tmp_path: Path, where: str, value: int, layer: dict[str, Any], limit: float) -> None:
    track, said, move_base = drive(where, speed_mask(tmp_path, value), **layer)
    period = 1.0 / move_base.params.controller_frequency
    # the limit is updated once per control cycle: the robot may enter the zone by the distance of one period
    # sampled velocities are float32, as in C++
    assert fastest(track, SLOW[0] + 0.5 * period, SLOW[1]) <= float(np.nextafter(np.float32(limit), np.float32(1.0)))
    assert fastest(track, SLOW[0] + 0.5 * period, SLOW[1]) > 0.5 * limit
    assert fastest(track, 1.0, SLOW[0]) > 0.4
    assert fastest(track, SLOW[1], 8.0) > 0.4
    assert move_base.local_planner.limits.max_vel_trans == 0.5
    assert said == [f"speed mask: speed limit {limit:.2f} m/s", "speed mask: no speed limit"]


def test_no_speed_limit_without_a_mask() -> None:
    track, said, _ = drive("local_costmap", None)
    assert fastest(track, *SLOW) > 0.4
    assert said == []


def test_mask_of_zeros_changes_nothing(tmp_path: Path) -> None:
    assert drive("local_costmap", speed_mask(tmp_path, 0))[0] == drive("local_costmap", None)[0]


def test_costmaps_read_their_mask_files(tmp_path: Path) -> None:
    listed = [{"name": "slow", "type": "speed_mask"}]
    parameters = {"local_costmap": {"plugins": listed, "slow": {"mask": str(speed_mask(tmp_path, 30))}}}
    configuration = load_configuration(["turtlebot", parameters])
    robot = simulated_robot(configuration, room(), Pose2D(1, 2, 0))
    costmap = build_costmap("local_costmap", configuration.local_costmap, robot.frames, None)
    assert costmap.limits_speed
    assert costmap.speed_limit(4.0, 2.0, 0.5) == pytest.approx(0.15)
    assert costmap.speed_limit(2.0, 2.0, 0.5) is None


def test_mask_and_recovery_limits_combine(tmp_path: Path) -> None:
    """The lower limit applies, and each one removes only its own."""
    listed = [{"name": "slow", "type": "speed_mask"}]
    parameters = {"local_costmap": {"plugins": listed, "slow": {"mask": str(speed_mask(tmp_path, 40))}}}
    configuration = load_configuration(["turtlebot", parameters])
    robot = simulated_robot(configuration, room(), Pose2D(1.0, 2.0, 0.0))
    costmap = build_costmap("local_costmap", configuration.local_costmap, robot.frames, None)
    planner = configuration.local_planner.cls(configuration.local_planner.params)
    masks = SpeedLimiter([costmap], planner)
    turning = planner.limits.max_vel_theta
    times = iter(range(1, 20))

    def at(x: float, *, slowed: bool) -> tuple[float, float]:
        now = next(times)
        robot.frames.set("odom", "base_footprint", Transform2D(x, 2.0, 0.0), now)
        masks.apply(now, slowed=slowed)
        return planner.limits.max_vel_trans, planner.limits.max_vel_theta

    assert at(2.0, slowed=False) == (0.5, turning)
    planner.set_limits(max_vel_trans=0.25, max_vel_theta=0.45)  # as move_slow_and_clear
    assert at(2.5, slowed=True) == (0.25, 0.45)
    assert at(3.5, slowed=True) == (0.2, 0.45)  # the mask is slower and does not limit the rotation
    planner.set_limits()  # the recovery removes its limits: the mask applies its own again
    assert at(4.0, slowed=False) == (0.2, turning)
    planner.set_limits(max_vel_trans=0.1, max_vel_theta=0.45)
    assert at(4.2, slowed=True) == (0.1, 0.45)  # slower than the mask's limit
    assert at(6.0, slowed=True) == (0.1, 0.45)  # outside the zone, but the recovery continues
    planner.set_limits()
    assert at(6.2, slowed=False) == (0.5, turning)
    assert masks.limit is None
