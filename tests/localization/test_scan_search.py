"""The global search: against brute force, against known poses, and for odd inputs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import GridGeometry, LaserScan, MapError, OccupancyGrid, Transform2D
from navstack.localization.global_search import STRIDE, Beams, MatchMap, block_bounds, scan_beams, search_scan
from tests.localization.rooms import free_pose, rooms, scan_from

STEP = math.radians(6.0)


def brute_force(match_map: MatchMap, points: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    """(ny, nx) mean likelihood of every pose with this heading; -1 where it is not free."""
    field = match_map.pyramid
    ny, nx = field.free.shape
    scores = np.zeros((ny, nx))
    c, s = math.cos(heading) / field.resolution, math.sin(heading) / field.resolution
    for x, y in points.tolist():
        dy, dx = math.floor(s * x + c * y + 0.5) + field.pad, math.floor(c * x - s * y + 0.5) + field.pad
        scores += field.padded[dy : dy + ny, dx : dx + nx]
    return np.where(field.free == 1, scores / 255.0 / len(points), -1.0)


@pytest.fixture(scope="module")
def match_map() -> MatchMap:
    return MatchMap(rooms(), reach=8.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_best_poses_are_those_of_brute_force(match_map: MatchMap, seed: int) -> None:
    rng = np.random.default_rng(seed)
    scan = scan_from(match_map.grid, free_pose(match_map.grid, rng))
    beams = scan_beams(scan, Transform2D(0.1, -0.05, 0.2)).thinned(40)
    result = search_scan(match_map, beams, keep=15, angular_step=STEP, budget=10**9, lowest=0.0)
    headings = STEP * np.arange(60)
    exact = np.stack([brute_force(match_map, beams.points, heading) for heading in headings.tolist()])
    assert result.complete
    assert result.scores[0] == pytest.approx(exact.max(), abs=1e-12)
    # the best pose of each of the best bins: blocks of STRIDE x STRIDE cells and 10 degrees
    sector = 2
    ny, nx = exact.shape[1] // STRIDE * STRIDE, exact.shape[2] // STRIDE * STRIDE
    bins = (
        exact[:, :ny, :nx].reshape(60 // sector, sector, ny // STRIDE, STRIDE, nx // STRIDE, STRIDE).max(axis=(1, 3, 5))
    )
    best = np.sort(bins.ravel())[::-1][: len(result.scores)]
    assert len(result.scores) >= 15
    assert np.allclose(result.scores[:15], best[:15], atol=1e-12)


def test_bounds_are_never_below_a_score(match_map: MatchMap) -> None:
    rng = np.random.default_rng(7)
    field = match_map.pyramid
    points = rng.uniform(-5.0, 5.0, (50, 2))
    bounds = block_bounds(field.phases, field.has_free, points, np.array([0.3, 2.0]), field.resolution, field.pad)
    ny, nx = field.free.shape
    columns = field.phases.shape[3]
    for h, heading in enumerate((0.3, 2.0)):
        exact = brute_force(match_map, points, heading) * 255.0 * 50
        of_block = bounds[h].reshape(-1, columns)[np.arange(ny)[:, None] // STRIDE, np.arange(nx)[None, :] // STRIDE]
        free = field.free == 1
        assert (of_block[free] >= exact[free] - 1e-6).all()
        assert (
            bounds[h].reshape(-1, columns)[: field.has_free.shape[0], : field.has_free.shape[1]][field.has_free == 0]
            == 0
        ).all()


@pytest.mark.parametrize("yaw", [0.0, 0.7])
@pytest.mark.parametrize("resolution", [0.1, 0.05])
def test_a_scan_finds_its_pose(yaw: float, resolution: float) -> None:
    grid = rooms(yaw=yaw, resolution=resolution)
    match_map = MatchMap(grid, reach=8.0)
    sensor = Transform2D(0.2, 0.0, 0.5)
    for seed in range(5):
        truth = free_pose(grid, np.random.default_rng(100 + seed))
        result = search_scan(match_map, scan_beams(scan_from(grid, truth, sensor=sensor), sensor), keep=20)
        x, y, heading = match_map.to_map(result.poses[:1])[0].tolist()
        # half the diagonal of a cell of 0.1 m, half a degree, and the blur of the likelihood
        assert math.hypot(x - truth.x, y - truth.y) < 0.15
        assert abs(math.remainder(heading - truth.yaw, 2.0 * math.pi)) < math.radians(2.0)


def test_the_search_is_deterministic_and_says_when_the_budget_ended_it(match_map: MatchMap) -> None:
    beams = scan_beams(scan_from(match_map.grid, Transform2D(1.0, 5.0, 0.3)), Transform2D())
    first = search_scan(match_map, beams, keep=50, budget=200)
    again = search_scan(match_map, beams, keep=50, budget=200)
    assert not first.complete
    assert np.array_equal(first.poses, again.poses)
    assert np.array_equal(first.scores, again.scores)


def test_a_scan_without_returns_finds_nothing(match_map: MatchMap) -> None:
    scan = LaserScan(np.full(90, np.inf, np.float32), -1.5, 0.03, 0.1, 8.0)
    assert len(search_scan(match_map, scan_beams(scan, Transform2D())).poses) == 0


def test_beams_beyond_the_reach_are_left_out(match_map: MatchMap) -> None:
    ends = np.array([[1e6, 0.0, 1.0], [0.0, -1e9, 1.0], [1.0, 0.0, 1.0], [7.9, 0.5, 1.0]])
    found = search_scan(match_map, Beams(ends, np.zeros(2)), keep=5, angular_step=STEP)
    assert found.scores[0] == pytest.approx(1.0, abs=0.05)


def test_invalid_beams_are_left_out() -> None:
    ranges = np.array([np.nan, -1.0, 0.01, 2.0, 8.0, np.inf, 3.0, -np.inf], np.float32)
    beams = scan_beams(LaserScan(ranges, 0.0, 0.1, 0.05, 8.0), Transform2D(0.5, 0.0, 0.0))
    assert beams.ends[:, 2].tolist() == [1.0, 0.0, 0.0, 1.0]
    assert np.hypot(beams.ends[:, 0] - 0.5, beams.ends[:, 1]) == pytest.approx([2.0, 8.0, 8.0, 3.0])


@pytest.mark.parametrize(("value", "named"), [(0, "no obstacle"), (100, "no free cell"), (-1, "no obstacle")])
def test_a_map_that_cannot_be_matched_is_refused(value: int, named: str) -> None:
    grid = OccupancyGrid(np.full((10, 10), value, np.int8), GridGeometry(10, 10, 0.1))
    with pytest.raises(MapError, match=named):
        MatchMap(grid)
