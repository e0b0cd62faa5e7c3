"""Single stages in the scenes used to time the C++ stack: local costmap updates and DWA cycles.

Costmaps: S x S m at 0.05 m around the robot; walls at 0.45 S; twelve discs of radius 0.02 S, disc i at distance
0.35 S (0.6 + 0.05 i) in direction 0.7 i + 0.2 (rad); one scan of 640 beams over a full circle. DWA: 4 x 4 m, walls at 1.9 m,
three discs, range 3 m, inflation 0.5 m with cost scaling 5 / m; a plan of 42 poses; the turtlebot's limits.

Global planners are missing: C++ was timed on the Willow Garage map, which is not part of navstack, and times on other maps do
not compare. `tools/bench/global_planner.py` measures them where that map is available.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, Footprint, FrameTree, LaserScan, Path, Pose2D, RobotState, Transform2D, Twist2D
from navstack.costmap import (
    CostmapParams,
    InflationLayer,
    InflationLayerParams,
    LayeredCostmap,
    LayerSpec,
    ObservationSourceParams,
    ObstacleLayer,
    ObstacleLayerParams,
    VoxelLayer,
    VoxelLayerParams,
)
from navstack.interfaces import ControlInput
from navstack.local_planner import DWAParams, DWAPlanner

Stage = Callable[[int], object]
"""Performs the work; its argument is the number of the call."""
Disc = tuple[float, float, float]

BEAMS: Final = 640


def scan(walls: float, discs: Sequence[Disc], stamp: float = 0.0) -> LaserScan:
    """The scan of a lidar at the origin between walls at +-`walls` m and discs (x, y, radius)."""
    angles = -math.pi + np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
    c, s = np.cos(angles), np.sin(angles)
    ranges: NDArray[np.float64] = walls / np.maximum(np.abs(c), np.abs(s))
    for x, y, radius in discs:
        along, off = c * x + s * y, c * y - s * x
        hit = (along > 0.0) & (np.abs(off) < radius)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(radius**2 - off[hit] ** 2))
    return LaserScan(
        ranges.astype(np.float32),
        -math.pi,
        2.0 * math.pi / BEAMS,
        0.1,
        30.0,
        stamp=stamp,
        frame="laser",
        topic="scan",
        height=0.3,
    )


def room(size: float) -> list[Disc]:
    """The twelve discs of a costmap scene of `size` (m)."""
    reaches = [(0.35 * size * (0.6 + 0.05 * i), 0.7 * i + 0.2) for i in range(12)]
    return [(reach * math.cos(angle), reach * math.sin(angle), 0.02 * size) for reach, angle in reaches]


def rolling_costmap(
    size: float, reach: float, *, voxel: bool = False, inflate: bool = False, frames: FrameTree | None = None
) -> LayeredCostmap:
    """The local costmap of the scenes: `size` x `size` m at 0.05 m, marked and cleared within `reach` m by the topic `scan`.

    `frames` contains odom, base_link and the lidar's frame `laser`; by default, the robot is at the origin.
    """
    source = ObservationSourceParams(
        data_type="LaserScan", marking=True, clearing=True, obstacle_range=reach, raytrace_range=reach
    )
    common: dict[str, Any] = {"observation_sources": "scan", "sources": {"scan": source}, "track_unknown_space": voxel}
    layers = [
        LayerSpec("obstacle_layer", VoxelLayer, VoxelLayerParams(z_voxels=2, z_resolution=0.2, **common))
        if voxel
        else LayerSpec("obstacle_layer", ObstacleLayer, ObstacleLayerParams(**common))
    ]
    if inflate:
        params = InflationLayerParams(inflation_radius=0.5, cost_scaling_factor=5.0)
        layers.append(LayerSpec("inflation_layer", InflationLayer, params))
    if frames is None:
        frames = frames_at_origin()
    return LayeredCostmap(
        "local_costmap",
        CostmapParams(global_frame="odom", rolling_window=True, width=size, height=size, resolution=0.05),
        layers,
        footprint=Footprint.from_radius(0.18),
        frames=frames,
    )


def frames_at_origin() -> FrameTree:
    """odom, base_link and laser, all at the origin at time 0."""
    frames = FrameTree()
    frames.set_static("base_link", "laser", Transform2D())
    frames.set("odom", "base_link", Transform2D(), 0.0)
    return frames


def costmap_stage(size: float, reach: float, *, voxel: bool = False, whole: bool = False) -> Stage:
    """Clears and marks with a scan; with `whole`, also moves the rolling window and inflates."""
    costmap = rolling_costmap(size, reach, voxel=voxel, inflate=whole)
    seen = [scan(0.45 * size, room(size)) for _ in range(5)]
    layer = costmap.layer("obstacle_layer")
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)

    def work(i: int) -> None:
        costmap.observe(seen[i % 5])
        if whole:
            costmap.update_at(Pose2D(0.06 * (i % 5), 0.0), 0.0)
        else:
            layer.update_bounds(Pose2D(0.0, 0.0), 0.0, Bounds())

    return work


def dwa_stage(vx_samples: int, vth_samples: int, sim_time: float) -> Stage:
    """A cycle of DWA: sets the plan, then rolls out, scores and selects."""
    costmap = rolling_costmap(4.0, 3.0, inflate=True)
    costmap.observe(scan(1.9, [(0.9, 0.6, 0.15), (0.8, -0.7, 0.15), (-0.9, 0.8, 0.2)]))
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    planner = DWAPlanner(
        DWAParams(
            max_vel_trans=0.5, max_vel_x=0.5, min_vel_x=0.0, max_vel_y=0.0, min_vel_y=0.0, max_vel_theta=1.0,
            min_vel_theta=0.4, acc_lim_x=1.0, acc_lim_y=0.0, acc_lim_theta=2.0, controller_frequency=5.0,
            path_distance_bias=64.0, goal_distance_bias=24.0, occdist_scale=0.5, sim_granularity=0.025,
            vx_samples=vx_samples, vy_samples=1, vth_samples=vth_samples, sim_time=sim_time,
        )
    )  # fmt: skip
    i = np.arange(42)
    poses = np.column_stack((0.03 * i, 0.1 * np.sin(0.05 * i), np.zeros(42))).astype(np.float64)
    plan = Path(poses, "odom")
    goal = plan[len(plan) - 1]
    state = RobotState(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.1), 0.0)
    inputs = ControlInput(state, costmap.master, Footprint.from_radius(0.18))

    def work(_: int) -> None:
        planner.set_plan(plan, goal)
        planner.compute_command(inputs)

    return work


SCENES: Final[dict[str, Callable[[], Stage]]] = {
    "obstacle_update_4m": lambda: costmap_stage(4.0, 3.0),
    "obstacle_update_10m": lambda: costmap_stage(10.0, 10.0),
    "costmap_update_4m": lambda: costmap_stage(4.0, 3.0, whole=True),
    "costmap_update_10m": lambda: costmap_stage(10.0, 10.0, whole=True),
    "voxel_update_4m": lambda: costmap_stage(4.0, 3.0, voxel=True),
    "voxel_costmap_update_10m": lambda: costmap_stage(10.0, 10.0, voxel=True, whole=True),
    "dwa_turtlebot": lambda: dwa_stage(6, 20, 1.0),
    "dwa_6x20": lambda: dwa_stage(6, 20, 1.7),
    "dwa_20x20": lambda: dwa_stage(20, 20, 1.7),
    "dwa_20x40": lambda: dwa_stage(20, 40, 1.7),
}
"""By their names in files of reference times."""
