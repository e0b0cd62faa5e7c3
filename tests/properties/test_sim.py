"""Collision and clearance against shapely, rays against geometry, over random worlds and outlines."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navstack.core import Footprint, OccupancyGrid, PointCloud, Pose2D, Twist2D
from navstack.sim import Lidar, LidarParams, Shape, SimParams, SimulatedRobot, World
from tests.sim.worlds import random_map, to_world

GIVEN = settings(deadline=None, max_examples=60)
seeds = st.integers(0, 10_000)

OUTLINES = {
    "round": Footprint.from_radius(0.18),
    "box": Footprint(np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]])),
    "arrow": Footprint(np.array([[-0.4, -0.3], [0.5, 0.0], [-0.4, 0.3], [-0.2, 0.0]])),
    "ell, its center outside": Footprint(
        np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.3], [0.3, 0.3], [0.3, 0.8], [0.1, 0.8]])
    ),
    "big": Footprint(np.array([[-2.0, -1.5], [2.0, -1.5], [2.0, 1.5], [-2.0, 1.5]])),
}
outlines = st.sampled_from(sorted(OUTLINES))


def solid(world: World) -> NDArray[np.object_]:
    """Everything that can be hit, as shapely geometries in the map frame."""
    grid: OccupancyGrid = world.map
    cells = np.argwhere(grid.data >= 100)[:, ::-1]
    corners = (cells[:, None, :] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])) * grid.geometry.resolution
    x, y = to_world(grid, corners[..., 0], corners[..., 1])
    squares = shapely.polygons(np.stack((x, y), axis=-1))
    discs = [shapely.Point(x, y).buffer(radius, quad_segs=256) for x, y, radius in world.discs_at(0.0)]
    solids = world.solids_at(0.0)
    polygons = [shapely.Polygon(solids.polygon(k)) for k in range(len(solids.circles))]
    return np.array([*squares, *discs, *polygons], dtype=object)


def world_and_pose(seed: int) -> tuple[World, Pose2D]:
    rng = np.random.default_rng(seed)
    grid = random_map(seed, share=float(rng.choice([0.0, 0.002, 0.02])), size=40)
    extent = grid.geometry.width_m
    discs = [
        (*to_world(grid, *rng.uniform(-1, extent + 1, 2).tolist()), float(rng.uniform(0.02, 0.5)))
        for _ in range(rng.integers(0, 4))
    ]
    x, y = to_world(grid, *rng.uniform(-1, extent + 1, 2).tolist())
    shapes: list[Shape] = []
    for _ in range(rng.integers(0, 4)):
        sx, sy = to_world(grid, *rng.uniform(-1, extent + 1, 2).tolist())
        at = [sx, sy, float(rng.uniform(-4, 4))]
        if rng.random() < 0.5:
            shapes.append(Shape(box=rng.uniform(0.01, 1.5, 2).tolist(), pose=at))
        else:  # an arrow head: not convex, its origin outside
            shapes.append(Shape(polygon=[[0.2, 0.0], [1.0, 0.5], [0.5, 0.0], [1.0, -0.4]], pose=at))
    return World(grid, discs, shapes=shapes), Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))


@GIVEN
@given(seeds, outlines)
def test_clearance_is_the_distance_to_the_nearest_solid(seed: int, outline: str) -> None:
    world, pose = world_and_pose(seed)
    footprint, obstacles = OUTLINES[outline], solid(world)
    for shape, found in (
        (shapely.Polygon(footprint.at(pose)), world.clearance(pose, footprint)),
        (shapely.Point(pose.x, pose.y), world.clearance(pose)),
    ):
        if len(obstacles) == 0:
            assert found == math.inf
        else:  # shapely's discs are polygons of 1024 sides, up to 1e-5 m too small
            assert abs(shapely.distance(obstacles, shape).min() - found) < 1e-5


@GIVEN
@given(seeds, outlines)
def test_collision_is_a_clearance_of_nothing(seed: int, outline: str) -> None:
    world, pose = world_and_pose(seed)
    footprint = OUTLINES[outline]
    room = world.clearance(pose, footprint)
    assert world.is_free(footprint, pose) == (room > 0.0)
    hit = world.collision(footprint, pose)
    if hit is not None:
        kind, index, x, y = hit
        touched = (
            shapely.Point(x, y).buffer(world.map.geometry.resolution * math.sqrt(0.5))
            if kind == "map"
            else shapely.Polygon(world.solids_at(0.0).polygon(index))
            if kind == "polygon"
            else shapely.Point(x, y).buffer(float(world.discs_at(0.0)[index, 2]))
        )
        assert shapely.Polygon(footprint.at(pose)).distance(touched) < 1e-9
        if kind == "map":
            assert world.map.data.flat[index] == 100


@pytest.mark.slow
@GIVEN
@given(seeds)
def test_a_range_ends_at_a_solid_and_meets_none_before(seed: int) -> None:
    world, pose = world_and_pose(seed)
    params = LidarParams(x=0.0, beams=24, fov=2 * math.pi, range_min=0.0, range_max=9.0)
    ranges = Lidar(params, seed=0, number=0).scan(world, pose, 0, 0.0).ranges.astype(float)
    obstacles = solid(world)
    for i, measured in enumerate(ranges):
        angle = pose.yaw + params.angle_min + i * params.angle_increment
        along = np.array([math.cos(angle), math.sin(angle)])
        before = max(min(measured, 9.0) - 2e-5, 0.0)
        way = shapely.LineString([[pose.x, pose.y], [pose.x, pose.y] + before * along])
        # a ray that grazes a corner is cut by less than the precision of shapely
        assert shapely.length(shapely.intersection(obstacles, way)).sum() < 1e-6
        if math.isfinite(measured):
            end = shapely.Point([pose.x, pose.y] + measured * along)
            assert shapely.distance(obstacles, end).min() < 2e-5


@pytest.mark.slow
@GIVEN
@given(seeds, outlines, st.floats(-3, 3), st.floats(-4, 4))
def test_the_robot_is_never_inside_of_anything(seed: int, outline: str, vx: float, wz: float) -> None:
    """Driven anyhow, the outline stays free at every step, and a collision says where it came from.

    The polygon of a round robot faces where it faced at the start, since a circle has no corners that could catch.
    """
    world, pose = world_and_pose(seed)
    footprint = OUTLINES[outline]
    if not world.is_free(footprint, pose):
        return
    robot = SimulatedRobot(SimParams(acc_lim_x=5.0), world, footprint, pose, seed=seed)
    robot.command(Twist2D(vx, 0.0, wz))
    obstacles = solid(world)
    turns = outline != "round"
    for x, y, yaw, *_ in robot.advance_to(1.5).tolist()[::5]:
        yaw = yaw if turns else pose.yaw
        placed = shapely.Polygon(footprint.at(Pose2D(x, y, yaw)))
        assert shapely.area(shapely.intersection(obstacles, placed)).sum() < 1e-9
    for collision in robot.collisions:
        # a point of the outline moves at most 5 mm between two tests
        at = collision.pose if turns else collision.pose._replace(yaw=pose.yaw)
        assert world.clearance(at, footprint) <= 0.005 + 1e-9


@pytest.mark.slow
@GIVEN
@given(seeds, st.integers(1, 7))
def test_the_same_run_however_it_is_cut(seed: int, cuts: int) -> None:
    params = SimParams(
        acc_lim_x=2.0,
        wheel_slip=0.05,
        odometry_noise=0.05,
        velocity_lag=0.05,
        sensors={"laser": LidarParams(beams=32, range_noise=0.01, dropout=0.05)},
    )
    world, pose = world_and_pose(seed)
    footprint = OUTLINES["round"]
    if not world.is_free(footprint, pose):
        return
    rng = np.random.default_rng(seed)
    commands = [Twist2D(*rng.uniform(-1, 1, 3).tolist()) for _ in range(4)]
    ends: list[tuple[object, ...]] = []
    for n in (1, cuts):
        robot = SimulatedRobot(params, world, footprint, pose, seed=seed)
        scans = list(robot.scans())
        for leg, command in enumerate(commands):
            robot.command(command)
            for k in range(n):
                robot.advance_to(0.4 * (leg + (k + 1) / n))
                scans += robot.scans()
        ends.append(
            (
                robot.pose,
                robot.state(),
                robot.collisions,
                [(s.points if isinstance(s, PointCloud) else s.ranges).tobytes() for s in scans],
            )
        )
    assert ends[0] == ends[1]
