"""Ranges against a ray marcher with small steps and closed forms; noise; the special values of REP 117."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from navstack.core import OccupancyGrid, Pose2D
from navstack.map_io import map_names
from navstack.scenario import load_places
from navstack.sim import Lidar, LidarParams, Shape, World
from navstack.sim.map_cells import free_rectangles, free_squares
from tests.sim.worlds import ascii_map, random_map, to_world
from tests.test_maps import read

STEP = 0.01


def occupied_at(grid: OccupancyGrid, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Occupancy at points of the map frame, by look-up."""
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = x - grid.geometry.origin_x, y - grid.geometry.origin_y
    ix = np.floor((c * dx + s * dy) / grid.geometry.resolution).astype(int)
    iy = np.floor((c * dy - s * dx) / grid.geometry.resolution).astype(int)
    inside = (ix >= 0) & (iy >= 0) & (ix < grid.geometry.nx) & (iy < grid.geometry.ny)
    found = np.zeros(x.shape, bool)
    found[inside] = grid.data[iy[inside], ix[inside]] >= 100
    return found


def in_polygons(world: World, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points of the map frame are in one of the world's polygons, by shapely."""
    solids = world.solids_at(0.0)
    found = np.zeros(x.shape, bool)
    for k in range(len(solids.circles)):
        found |= shapely.contains_xy(shapely.Polygon(solids.polygon(k)), x, y)
    return found


def march(world: World, eye: Pose2D, angles: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Ranges by steps of 1 cm; inf beyond `reach`."""
    t = np.arange(0.0, reach, STEP)
    x = eye.x + np.outer(np.cos(eye.yaw + angles), t)
    y = eye.y + np.outer(np.sin(eye.yaw + angles), t)
    hit = occupied_at(world.map, x, y)
    for dx, dy, r in world.discs_at(0.0):
        hit |= (x - dx) ** 2 + (y - dy) ** 2 <= r * r
    hit |= in_polygons(world, x, y)
    first = hit.argmax(axis=1)
    return np.where(hit.any(axis=1), t[first], np.inf)


def compare(world: World, eye: Pose2D, reach: float) -> None:
    """The marcher finds a hit within one step behind the exact one; it can miss only corners shorter than its step."""
    params = LidarParams(x=0.0, beams=360, fov=2 * math.pi, range_min=0.0, range_max=reach)
    lidar = Lidar(params, seed=0, number=0)
    exact = lidar.scan(world, eye, 0, 0.0).ranges.astype(float)
    angles = params.angle_min + params.angle_increment * np.arange(params.beams)
    marched = march(world, eye, angles, reach)
    assert not np.isnan(exact).any()
    assert (exact >= 0).all()
    seen = np.isfinite(marched)
    # never behind what the marcher found; a micrometer for float32
    assert (exact[seen] <= marched[seen] + 1e-6).all()
    agree = (np.where(seen, marched, reach) - np.where(np.isfinite(exact), exact, reach)) <= STEP + 1e-6
    # where they differ by more, the exact hit is real: a point just behind it is occupied, the stretch is a cut corner
    for i in np.nonzero(~agree)[0]:
        x = eye.x + np.cos(eye.yaw + angles[i]) * (exact[i] + np.linspace(0.0, STEP, 2001))
        y = eye.y + np.sin(eye.yaw + angles[i]) * (exact[i] + np.linspace(0.0, STEP, 2001))
        inside = occupied_at(world.map, x, y)
        for dx, dy, r in world.discs_at(0.0):
            inside |= (x - dx) ** 2 + (y - dy) ** 2 <= r * r
        inside |= in_polygons(world, x, y)
        assert inside.any(), (i, exact[i], marched[i])
    assert agree.mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_equals_a_marcher_in_random_worlds(seed: int) -> None:
    grid = random_map(seed, share=0.02 if seed % 2 else 0.15)
    rng = np.random.default_rng(seed)
    extent = grid.geometry.width_m
    discs = [
        [*to_world(grid, *rng.uniform(-1, extent + 1, 2).tolist()), float(rng.uniform(0.03, 0.4))] for _ in range(seed)
    ]
    shapes = [
        Shape(box=[0.4, 1.1], pose=[*to_world(grid, *rng.uniform(0, extent, 2).tolist()), float(rng.uniform(-3, 3))]),
        Shape(
            polygon=[[0, 0], [0.8, 0.5], [0.4, 0], [0.8, -0.4]],
            pose=[*to_world(grid, *rng.uniform(0, extent, 2).tolist())],
        ),
    ]
    world = World(grid, discs, shapes=shapes[: seed % 3])
    for _ in range(8):  # also from outside of the map
        x, y = to_world(grid, *rng.uniform(-2, extent + 2, 2).tolist())
        compare(world, Pose2D(x, y, float(rng.uniform(-4, 4))), reach=5.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", map_names())
def test_equals_a_marcher_on_the_packaged_maps(name: str) -> None:
    world = World(read(name))
    for pose in load_places(name).places.values():
        compare(world, pose, reach=12.0)


@pytest.mark.parametrize("seed", range(10))
def test_free_rectangles_contain_only_free_cells(seed: int) -> None:
    """Every rectangle is on the map and contains no occupied cell; an empty one means an occupied cell."""
    rng = np.random.default_rng(seed)
    ny, nx = rng.integers(1, 50, 2).tolist() if seed else (3, 700)  # beyond what a byte holds
    occupied = rng.random((ny, nx)) < rng.choice([0.0, 0.005, 0.03, 0.2])
    total = np.zeros((ny + 1, nx + 1), np.int64)
    total[1:, 1:] = occupied.cumsum(axis=0).cumsum(axis=1)
    leaps = free_rectangles(free_squares(occupied)).astype(np.int64)
    iy, ix = np.mgrid[:ny, :nx]
    for octant in range(8):
        along_x = octant % 2 == 0
        short = leaps[octant] & 127
        long = np.where(leaps[octant] > 127, 4 * short, short)
        assert ((short == 0) == occupied).all()
        w, h = (long, short) if along_x else (short, long)
        x0 = ix - w + 1 if octant & 2 else ix
        y0 = iy - h + 1 if octant & 4 else iy
        x1, y1 = x0 + w, y0 + h
        on_map = (x0 >= 0) & (y0 >= 0) & (x1 <= nx) & (y1 <= ny)
        assert on_map[~occupied].all()
        keep = ~occupied
        x0, x1, y0, y1 = x0[keep], x1[keep], y0[keep], y1[keep]
        assert (total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0] == 0).all()


def test_along_the_axes_and_through_corners() -> None:
    world = World(
        ascii_map(
            """
            #######
            #     #
            #     #
            #     #
            #######
            """.replace(" " * 12, "")
        )
    )
    params = LidarParams(x=0.0, beams=8, fov=2 * math.pi, range_min=0.0, range_max=50.0, yaw=math.pi / 8)
    ranges = Lidar(params, seed=0, number=0).scan(world, Pose2D(3.5, 2.5, 0.0), 0, 0.0).ranges
    assert params.angle_min + params.yaw == pytest.approx(-0.75 * math.pi)
    # south-west, south, south-east, east, north-east, north, north-west, west
    diagonal = 1.5 * math.sqrt(2)
    assert ranges == pytest.approx([diagonal, 1.5, diagonal, 2.5, diagonal, 1.5, diagonal, 2.5], abs=1e-5)


def test_unknown_cells_are_transparent() -> None:
    world = World(ascii_map(" ??#"))
    params = LidarParams(x=0.0, beams=1, range_min=0.0)
    assert Lidar(params, seed=0, number=0).scan(world, Pose2D(0.5, 0.5, 0.0), 0, 0.0).ranges[0] == 2.5


def test_too_near_is_minus_inf_and_no_hit_is_plus_inf() -> None:
    world = World(ascii_map("#     "), [[4.0, 0.5, 0.5]])
    params = LidarParams(x=0.0, beams=2, fov=math.pi * 0.999, range_min=0.45, range_max=6.0)
    forward = LidarParams(x=0.0, beams=1)
    scan = Lidar(forward, seed=0, number=0).scan(world, Pose2D(2.0, 0.5, 0.0), 0, 0.0)
    assert scan.ranges[0] == pytest.approx(1.5)
    assert Lidar(forward, seed=0, number=0).scan(world, Pose2D(3.2, 0.5, 0.0), 0, 0.0).ranges[0] == -np.inf
    assert Lidar(forward, seed=0, number=0).scan(world, Pose2D(4.1, 0.5, 0.0), 0, 0.0).ranges[0] == -np.inf
    assert Lidar(params, seed=0, number=0).scan(world, Pose2D(2.0, 0.5, 0.0), 0, 0.0).ranges[0] == np.inf


def test_mounting() -> None:
    """A lidar at the stern looking back."""
    world = World(ascii_map("#     #"))
    params = LidarParams(x=-0.3, y=0.1, yaw=math.pi, beams=1, range_min=0.0)
    scan = Lidar(params, seed=0, number=0).scan(world, Pose2D(3.0, 0.5, 0.0), 0, 1.5)
    assert scan.ranges[0] == pytest.approx(1.7)
    turned = Lidar(params, seed=0, number=0).scan(world, Pose2D(3.0, 0.5, math.pi), 0, 1.5)
    assert turned.ranges[0] == pytest.approx(2.7)
    assert (scan.stamp, scan.frame, scan.topic, scan.height) == (1.5, "base_laser_link", "scan", 0.3)


def test_disc_in_closed_form() -> None:
    """Ranges on a circle: d cos(a) - sqrt(r² - d² sin(a)²)."""
    world = World(None, [[3.0, 0.0, 0.5]])
    params = LidarParams(x=0.0, beams=201, fov=0.6, range_min=0.0)
    ranges = Lidar(params, seed=0, number=0).scan(world, Pose2D(0.0, 0.0, 0.0), 0, 0.0).ranges
    angles = params.angle_min + params.angle_increment * np.arange(201)
    under = 0.25 - (3.0 * np.sin(angles)) ** 2
    expected = np.where(under >= 0, 3.0 * np.cos(angles) - np.sqrt(np.maximum(under, 0)), np.inf)
    np.testing.assert_allclose(ranges, expected, atol=1e-6)
    assert np.isfinite(ranges).sum() == 111  # asin(1/6) = 0.167 rad on either side


@pytest.mark.parametrize("seed", range(6))
def test_discs_are_seen_as_if_every_beam_were_tested_against_every_disc(seed: int) -> None:
    """To the bit, although only the beams between the tangents are tested: small, large, near and distant discs, any lidar."""
    rng = np.random.default_rng(seed)
    where, radii = rng.uniform(-12.0, 12.0, (150, 2)), np.exp(rng.uniform(math.log(1e-4), math.log(2.0), 150))
    away = np.hypot(*where.T)
    discs = np.column_stack((where, radii))[away > radii]
    near = away[away > radii].argmin()
    discs[near, 2] = np.hypot(*discs[near, :2]) * (1.0 - 1e-9)  # all but touches the lidar
    beams = int(rng.integers(2, 900))
    params = LidarParams(
        x=0.0, y=0.0, yaw=0.0, beams=beams, fov=rng.uniform(0.01, 2 * math.pi), range_min=0.0, range_max=30.0
    )
    lidar = Lidar(params, seed=0, number=0)
    ranges = lidar.scan(World(None, discs), Pose2D(0.0, 0.0, 0.0), 0, 0.0).ranges
    angles = params.angle_min + params.angle_increment * np.arange(beams)
    along = discs[:, 0] * np.cos(angles)[:, None] + discs[:, 1] * np.sin(angles)[:, None]
    left = discs[:, 2] ** 2 - (discs[:, 0] ** 2 + discs[:, 1] ** 2 - along * along)
    hits = (left >= 0.0) & (along > 0.0)
    exact = np.where(hits, along - np.sqrt(np.where(hits, left, 0.0)), np.inf).min(axis=1)
    assert np.isfinite(exact).any()
    assert (ranges == exact.astype(np.float32)).all()


def test_a_full_circle_has_no_duplicate_direction() -> None:
    assert LidarParams(beams=360, fov=2 * math.pi).angle_increment == pytest.approx(math.radians(1))
    assert LidarParams(beams=720, fov=4.71238).angle_increment == pytest.approx(4.71238 / 719)
    assert LidarParams().angle_min == pytest.approx(-0.5)


def test_noise_has_the_given_deviation_and_no_bias() -> None:
    world = World(None, [[0.0, 0.0, 1.0]])
    params = LidarParams(x=0.0, beams=1000, fov=0.0001, range_min=0.0, range_noise=0.03, dropout=0.2)
    lidar = Lidar(params, seed=5, number=0)
    ranges = np.concatenate([lidar.scan(world, Pose2D(-3.0, 0.0, 0.0), i, 0.0).ranges for i in range(40)])
    lost = np.isnan(ranges)
    n = len(ranges)
    assert lost.mean() == pytest.approx(0.2, abs=4 * math.sqrt(0.16 / n))
    errors = ranges[~lost].astype(float) - 2.0
    assert errors.mean() == pytest.approx(0.0, abs=4 * 0.03 / math.sqrt(len(errors)))
    assert errors.std() == pytest.approx(0.03, rel=4 / math.sqrt(2 * len(errors)))


def test_noise_is_a_function_of_seed_lidar_and_number_of_the_scan() -> None:
    world = World(None, [[0.0, 0.0, 1.0]])
    params = LidarParams(x=0.0, beams=50, fov=0.1, range_noise=0.03, dropout=0.1)
    at = Pose2D(-3.0, 0.0, 0.0)

    def ranges(seed: int, number: int, index: int) -> bytes:
        return Lidar(params, seed=seed, number=number).scan(world, at, index, 0.0).ranges.tobytes()

    assert ranges(1, 0, 7) == ranges(1, 0, 7)
    assert len({ranges(1, 0, 7), ranges(2, 0, 7), ranges(1, 1, 7), ranges(1, 0, 8)}) == 4
