"""Pictures of the camera: closed forms of the pinhole camera, the lidar's ranges, rays in space, and when none is made."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navstack.core import Footprint, InputError, NavError, Pose2D, Transform2D, Twist2D
from navstack.parameters import load_configuration
from navstack.sim import (
    Camera,
    CameraImage,
    CameraParams,
    DoorMotion,
    Lidar,
    LidarParams,
    PedestrianMotion,
    Shape,
    SimParams,
    SimulatedRobot,
    World,
)
from navstack.sim import camera as camera_module
from tests.sim.test_lidar import occupied_at
from tests.sim.worlds import ascii_map, random_map

EYE = Pose2D(0.5, 3.5)
WALL_M = 6.0
"""Distance from `EYE` to the wall of `ROOM`."""
ROOM = World(ascii_map("\n".join(["      #"] * 7)))
"""A wall across x, in a map of cells of 1 m."""


def params(**values: Any) -> CameraParams:
    """A camera at the robot's center."""
    chosen: dict[str, Any] = {"x": 0.0, "range_min": 0.0, "range_max": 1e3, "width": 320, "height": 241, **values}
    return CameraParams(**chosen)


def looked(p: CameraParams, world: World = ROOM, eye: Pose2D = EYE) -> CameraImage:
    return Camera(p).image(world, eye, 0.0)


def asides(p: CameraParams) -> NDArray[np.float64]:
    """(width,) tangent of the direction of each column, to the left."""
    columns: NDArray[np.float64] = np.arange(p.width, dtype=np.float64)
    return (p.image_center[0] - columns) / p.focal_length


def test_the_depth_of_a_wall_is_its_distance_along_the_axis() -> None:
    """Wherever the wall is, not the length of the ray: that is longer by 1 / cos of the direction."""
    p = params()
    row = looked(p).depth[120]
    across = EYE.y + (WALL_M - 0.5) * asides(p)
    hit = (across > 0.01) & (across < 6.99)
    assert hit.sum() > 300
    np.testing.assert_allclose(row[hit], WALL_M - EYE.x, rtol=1e-6)


@pytest.mark.parametrize(("distance", "height"), [(1.0, 2.5), (2.5, 1.0), (5.0, 2.5)])
def test_the_slice_of_a_wall_has_the_height_of_the_pinhole_formula(distance: float, height: float) -> None:
    p = params(wall_height=height, height=961, width=640)
    image = looked(p, eye=Pose2D(WALL_M - distance, 3.5))
    column = image.depth[:, 320]
    rows = np.flatnonzero(np.abs(column - distance) < 1e-4)
    top = p.image_center[1] - p.focal_length * (height - p.z) / distance
    bottom = p.image_center[1] + p.focal_length * p.z / distance
    assert rows[0] == max(math.ceil(top), 0) and rows[-1] == math.floor(bottom)
    assert np.array_equal(rows, np.arange(rows[0], rows[-1] + 1))
    if top > 0.0:
        assert abs(len(rows) - p.focal_length * height / distance) <= 1.0
        assert np.isposinf(column[: rows[0]]).all()  # the sky


def test_the_floor_is_a_plane() -> None:
    p = params()
    rows = np.arange(200, 241)
    expected = p.focal_length * p.z / (rows - p.image_center[1])
    np.testing.assert_allclose(looked(p).depth[200:, 17], expected, rtol=1e-6)


def test_a_wall_at_the_left_is_at_the_left_of_the_picture() -> None:
    image = looked(params(), eye=Pose2D(EYE.x, EYE.y, -0.4))
    row = image.depth[120]
    assert np.isfinite(row[:200]).all() and np.isposinf(row[-60:]).all()
    assert np.all(np.diff(row[:200]) > 0.0)  # it goes away to the right


def scene(seed: int) -> World:
    """A rotated map with discs, boxes, a polygon that is not convex, and a door; low, high and without a height."""
    rng = np.random.default_rng(seed)
    grid = random_map(seed, share=0.01)
    x, y = grid.geometry.origin_x, grid.geometry.origin_y
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)

    def pose() -> list[float]:
        u, v = rng.uniform(0.0, 5.0, 2)
        return [x + c * u - s * v, y + s * u + c * v, float(rng.uniform(-3.0, 3.0))]

    heights = [None, 0.1, 0.25, 0.6, 2.0]
    shapes = [Shape(radius=float(rng.uniform(0.05, 0.3)), pose=pose(), height=heights[k % 5]) for k in range(5)]
    shapes += [Shape(box=[0.6, 0.3], pose=pose(), height=heights[k % 5]) for k in range(5)]
    star: list[list[float]] = [[0.5, 0.0], [0.1, 0.1], [0.0, 0.5], [-0.1, 0.1], [-0.5, 0.0], [0.0, -0.1]]
    shapes += [Shape(polygon=star, pose=pose(), height=height) for height in (None, 0.2)]
    shapes += [Shape(segment=[[0.0, 0.0], [0.8, 0.0]], pose=pose(), motion=DoorMotion())]
    return World(grid, shapes=shapes)


def eye_in(world: World, seed: int) -> Pose2D:
    grid = world.map
    u, v = np.random.default_rng(seed + 1000).uniform(0.5, 4.5, 2)
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    return Pose2D(grid.geometry.origin_x + c * u - s * v, grid.geometry.origin_y + s * u + c * v, 0.7 * seed)


@pytest.mark.parametrize("seed", range(8))
def test_the_row_of_the_horizon_has_the_ranges_of_a_lidar_at_the_same_place(seed: int) -> None:
    world, p = scene(seed), params(width=161, z=0.22, horizontal_fov=2.6)
    eye = eye_in(world, seed)
    row = looked(p, world, eye).depth[120]
    measured: list[float] = []
    for aside in asides(p):
        beam = LidarParams(x=0.0, yaw=math.atan(aside), beams=1, range_min=0.0, range_max=1e3, height=p.z)
        measured += Lidar(beam, seed=0, number=0).scan(world, eye, 0, 0.0).ranges.tolist()  # type: ignore[union-attr]
    assert np.isfinite(measured).any()
    np.testing.assert_allclose(row * np.hypot(1.0, asides(p)), measured, rtol=1e-6)


STEP = 0.004


def march(world: World, p: CameraParams, eye: Pose2D, u: NDArray[Any], v: NDArray[Any]) -> NDArray[np.float64]:
    """Depths (m) of pixels by steps along their rays in space; inf beyond 8 m."""
    t = np.arange(0.0, 8.0, STEP)
    aside = (p.image_center[0] - u) / p.focal_length
    x = eye.x + np.outer(math.cos(eye.yaw) - math.sin(eye.yaw) * aside, t)
    y = eye.y + np.outer(math.sin(eye.yaw) + math.cos(eye.yaw) * aside, t)
    z = p.z - np.outer((v - p.image_center[1]) / p.focal_length, t)
    solids = world.solids_at(0.0)
    shapes = [*(s for s in world.shapes if s.radius is not None), *(s for s in world.shapes if s.radius is None)]
    hit = (z < 0.0) | (occupied_at(world.map, x, y) & (z <= p.wall_height))
    for k, shape in enumerate(shapes):
        default = p.obstacle_height if shape.segment is None else p.wall_height
        below = z <= (default if shape.height is None else shape.height)
        if k < len(solids.discs):
            cx, cy, r = solids.discs[k]
            hit |= below & ((x - cx) ** 2 + (y - cy) ** 2 <= r * r)
        else:
            hit |= below & shapely.contains_xy(shapely.Polygon(solids.polygon(k - len(solids.discs))), x, y)
    return np.where(hit.any(axis=1), t[hit.argmax(axis=1)], np.inf)


def compare_with_rays(world: World, p: CameraParams, eye: Pose2D, seed: int) -> None:
    """The ray marcher misses corners shorter than its step."""
    rng = np.random.default_rng(seed)
    u, v = rng.integers(0, p.width, 150), rng.integers(0, p.height, 150)
    seen, expected = looked(p, world, eye).depth[v, u].astype(float), march(world, p, eye, u, v)
    seen[seen > 7.9] = np.inf
    expected[expected > 7.9] = np.inf
    with np.errstate(invalid="ignore"):
        right = (seen == expected) | ((seen <= expected + 1e-6) & (expected - seen <= STEP + 1e-6))
    assert (~right).sum() <= 2 and np.isfinite(seen).sum() > 50


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("z", [0.4, 1.3])
def test_every_pixel_has_the_depth_of_its_ray_in_space(seed: int, z: float) -> None:
    """Also where low obstacles hide one another and show their tops."""
    world = scene(seed)
    compare_with_rays(world, params(z=z, width=64, height=49), eye_in(world, seed), seed)


@pytest.mark.parametrize("x", [-1.0, 0.25])
@pytest.mark.parametrize("z", [0.4, 1.0])
def test_both_arms_of_a_horseshoe_are_seen_from_outside_and_from_above(x: float, z: float) -> None:
    """A ray crosses the first arm, the gap and the second arm; or it begins above the first one."""
    corners = [[0.0, 0.0], [0.5, 0.0], [0.5, 1.5], [1.5, 1.5], [1.5, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
    world = World(ROOM.map, shapes=[Shape(polygon=corners, pose=[2.0, 2.5, 0.0], height=0.3)])
    compare_with_rays(world, params(z=z, width=64, height=97, horizontal_fov=0.9), Pose2D(2.0 + x, 3.2, 0.0), 0)


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-3.0, 10.0), y=st.floats(-3.0, 10.0), yaw=st.floats(-3.2, 3.2), z=st.floats(0.01, 2.4),
    fov=st.floats(0.1, 3.0), width=st.integers(1, 40), height=st.integers(1, 40),
)  # fmt: skip
def test_any_pose_gives_a_picture(
    x: float, y: float, yaw: float, z: float, fov: float, width: int, height: int
) -> None:
    """Inside of walls and obstacles and outside of the map, too."""
    shapes = [Shape(box=[1.0, 2.0], pose=[2.0, 2.0, 0.3]), Shape(radius=0.7, pose=[4.0, 4.0, 0.0], height=0.3)]
    p = params(z=z, horizontal_fov=fov, width=width, height=height)
    image = looked(p, World(ROOM.map, shapes=shapes), Pose2D(x, y, yaw))
    assert image.rgb.shape == (height, width, 3) and not np.isnan(image.depth).any() and image.depth.min() > 0.0


def robot_among(shapes: list[Shape], **values: Any) -> SimulatedRobot:
    world = World(ROOM.map, shapes=shapes)
    return SimulatedRobot(SimParams(**values), world, Footprint.from_radius(0.2), EYE)


def test_people_and_shapes_are_seen_with_their_heights() -> None:
    person = Shape(name="p", radius=0.25, pose=[4.5, 3.5, 0.0], motion=PedestrianMotion(goals=[[4.5, 6.0]], speed=0.1))
    robot = robot_among([person, Shape(box=[0.5, 0.5], pose=[3.5, 4.6, 0.0], height=0.5)])
    empty = robot_among([]).camera()
    image = robot.camera()
    p = robot.params.camera("camera")
    near = 4.5 - 0.25 - 0.6
    rows = np.flatnonzero(image.depth[:, 320] < near + 0.01)
    rows = rows[np.abs(image.depth[rows, 320] - near) < 0.01]
    assert rows[0] == math.ceil(p.image_center[1] - p.focal_length * (p.person_height - p.z) / near)
    colors = {tuple(color) for color in image.rgb[rows, 320].tolist()}
    assert len(colors) == 3  # trousers, shirt, head
    above = Camera(params(z=2.2)).image(robot.world, Pose2D(2.5, 3.5), 0.0, robot.solids, people=1)
    r, g, b = above.rgb[np.abs(above.depth - 2.0) < 0.1].mean(axis=0)  # the top of the head
    assert r > g > b and r > 180.0
    differs = (image.rgb != empty.rgb).any(axis=2)
    box = np.flatnonzero(differs[:, : 320 - 60].any(axis=1))
    edge = 3.5 - 0.25 - 0.6  # the front of the box
    assert box[0] == math.ceil(p.image_center[1] - p.focal_length * (0.5 - p.z) / edge)
    robot.advance_to(4.0)
    assert (robot.camera().rgb != image.rgb).any()  # the person walks


def test_the_mounting_moves_the_picture() -> None:
    turned = robot_among([], sensors={"camera": CameraParams(yaw=0.3, x=0.4, y=0.1)}).camera()
    there = Transform2D(*EYE) @ Transform2D(0.4, 0.1, 0.3)
    same = looked(CameraParams(x=0.0), eye=Pose2D(*there))
    assert np.array_equal(turned.rgb, same.rgb) and np.array_equal(turned.depth, same.depth)


def test_depths_out_of_range_are_infinite() -> None:
    image = looked(params(range_min=1.0, range_max=5.0))
    assert np.isneginf(image.depth[-1]).all() and np.isposinf(image.depth[120]).all()
    assert not image.depth_mm[-1].any() and not image.depth_mm[120].any()
    finite = np.isfinite(image.depth)
    assert finite.any() and image.depth[finite].min() >= 1.0 and image.depth[finite].max() <= 5.0
    np.testing.assert_allclose(image.depth_mm[finite], 1000.0 * image.depth[finite], atol=0.5)


def test_no_picture_is_made_unless_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: Any) -> None:
        raise AssertionError("a picture")

    robot = robot_among([])
    monkeypatch.setattr(camera_module, "draw", forbidden)
    robot.command(Twist2D(0.2, 0.0, 0.1))
    robot.advance_to(2.0)
    robot.scans()
    with pytest.raises(AssertionError, match="a picture"):
        robot.camera()


def test_a_picture_changes_nothing_and_is_the_same_again() -> None:
    asked, other = robot_among([], odometry_noise=0.1), robot_among([], odometry_noise=0.1)
    for k in range(1, 6):
        for robot in (asked, other):
            robot.command(Twist2D(0.3, 0.0, 0.2))
            robot.advance_to(0.2 * k)
        first, second = asked.camera(), asked.camera()
        assert first.stamp == asked.time
        assert np.array_equal(first.rgb, second.rgb) and np.array_equal(first.depth, second.depth)
    assert asked.pose == other.pose and asked.state() == other.state()


def test_a_smaller_picture_has_the_same_view() -> None:
    robot = robot_among([])
    small, large = robot.camera("camera", width=160), robot.camera()
    assert small.rgb.shape == (120, 160, 3)
    assert small.params.horizontal_fov == large.params.horizontal_fov
    between = 0.5 * (large.depth[281] + large.depth[282])  # four of its rows are one of the small one
    np.testing.assert_allclose(small.depth[70], between[1::4], atol=0.01)


@pytest.mark.parametrize("width", [0, -1, 5000])
def test_a_width_out_of_range_is_refused(width: int) -> None:
    with pytest.raises(InputError, match="the width of a picture"):
        robot_among([]).camera(width=width)


def test_a_camera_that_the_robot_does_not_have_is_named() -> None:
    with pytest.raises(InputError, match='no camera named "front", but these: camera'):
        robot_among([]).camera("front")
    with pytest.raises(InputError, match="no camera, but these: none"):
        robot_among([], cameras=[]).camera()


@pytest.mark.parametrize(
    ("section", "text"),
    [
        ({"camera": {"z": 3.0}}, "wall_height"),
        ({"camera": {"range_min": 9.0}}, "range_min"),
        ({"cameras": ["a", "b"]}, "two cameras have the topic camera"),
        ({"cameras": ["laser"]}, "is the name of a lidar and of a camera"),
        ({"camera": {"horizontal_fov": 3.2}}, "horizontal_fov"),
    ],
)
def test_wrong_parameters_are_reported(section: dict[str, Any], text: str) -> None:
    with pytest.raises(NavError, match=text):
        load_configuration(["turtlebot", {"navstack": {"sim": section}}])


def test_the_parameters_of_two_cameras() -> None:
    section = {"cameras": ["front", "rear"], "rear": {"yaw": 3.14, "topic": "rear", "frame": "rear"}}
    sim = load_configuration(["turtlebot", {"navstack": {"sim": section}}]).navstack.sim
    assert sim.camera("front").yaw == 0.0 and sim.camera("rear").yaw == 3.14


def test_a_lidar_may_have_the_name_of_the_camera_that_nobody_asked_for() -> None:
    section = {"lasers": ["camera"], "camera": {"topic": "scan", "beams": 100}}
    sim = load_configuration(["turtlebot", {"navstack": {"sim": section}}]).navstack.sim
    assert sim.lidar("camera").beams == 100 and sim.camera("camera") == CameraParams()
