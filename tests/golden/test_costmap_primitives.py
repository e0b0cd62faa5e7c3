"""Rays, polygons, cells and origins compared with Costmap2D (`primitives.npz`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from navstack.core import Bounds, Footprint, FrameTree, GridGeometry, Pose2D, clear_line
from navstack.costmap import CostmapParams, LayeredCostmap
from navstack.costmap.obstacle_layer import fill_convex


@pytest.fixture(scope="module")
def primitives(golden_dir: Path) -> dict[str, np.ndarray]:
    return dict(np.load(golden_dir / "primitives.npz"))


def test_rays_clear_the_same_cells(primitives: dict[str, np.ndarray]) -> None:
    nx, ny = 50, 40
    expected = np.split(primitives["ray_cells"], np.cumsum(primitives["ray_counts"])[:-1])
    for (x0, y0, x1, y1, longest), cells in zip(primitives["ray_query"].tolist(), expected, strict=True):
        grid = np.full(nx * ny, 255, np.uint8)
        clear_line(grid, nx, x0, y0, x1, y1, 0.0, float(longest))
        assert np.flatnonzero(grid == 0).tolist() == sorted(set(cells.tolist())), (x0, y0, x1, y1, longest)


@pytest.mark.slow
def test_slope_in_fixed_point_is_exact() -> None:
    """Every cell equals plain Bresenham, for lines of up to 3,000 cells."""
    rng = np.random.default_rng(1)
    nx, ny = 3000, 40
    for _ in range(200):
        x0, x1 = rng.integers(0, nx, 2).tolist()
        y0, y1 = rng.integers(0, ny, 2).tolist()
        grid = np.full((ny, nx), 255, np.uint8)
        clear_line(grid.reshape(-1), nx, x0, y0, x1, y1, 0.0, 1e9)
        da, db = abs(x1 - x0), abs(y1 - y0)
        steep = db > da
        if steep:
            da, db = db, da
        cells = set()
        error, x, y = da // 2, x0, y0
        for _ in range(da + 1):
            cells.add((x, y))
            error += db
            aside = error >= da
            error -= da if aside else 0
            x += (1 if x1 > x0 else -1) * (aside if steep else 1)
            y += (1 if y1 > y0 else -1) * (1 if steep else aside)
        ys, xs = np.nonzero(grid == 0)
        assert set(zip(xs.tolist(), ys.tolist(), strict=True)) == cells


def test_polygons_fill_the_same_cells(primitives: dict[str, np.ndarray]) -> None:
    nx, ny = 50, 40
    expected = np.split(primitives["poly_cells"], np.cumsum(primitives["poly_counts"])[:-1])
    polygons = np.split(primitives["poly_points"], np.cumsum(primitives["poly_npoints"])[:-1])
    for vertices, ok, cells in zip(polygons, primitives["poly_ok"].tolist(), expected, strict=True):
        grid = np.full((ny, nx), 255, np.uint8)
        corners = np.ascontiguousarray(vertices)
        # C++ fills every polygon as if it were convex
        spans = np.zeros((2, nx), np.int64)
        done = fill_convex(grid, corners, 0, len(corners), spans, -1.0, -0.5, 0.05, 0)
        assert done == bool(ok)
        assert np.flatnonzero(grid == 0).tolist() == sorted(set(cells.tolist()))


def test_world_to_cell(primitives: dict[str, np.ndarray]) -> None:
    geometry = GridGeometry(80, 80, 0.05)
    for x, y, ok, mx, my, ex, ey, ux, uy in primitives["worldtomap"].tolist():
        assert geometry.world_to_cell(x, y) == ((int(mx), int(my)) if ok else None)
        window = geometry.window_of(Bounds(x, y, x, y))
        assert (window.x0, window.y0) == (int(ex), int(ey))
        # C++ truncates toward zero navstack rounds down: both agree for points that are not left of the origin
        unbounded = geometry.world_to_cell_unbounded(x, y)
        assert tuple(int(v) for v in (x / 0.05, y / 0.05)) == (int(ux), int(uy))
        assert all(u == int(t) or t <= 0.0 for u, t in zip(unbounded, (ux, uy), strict=True))


def test_origins_of_a_rolling_window(primitives: dict[str, np.ndarray]) -> None:
    for ox, oy, new_x, new_y, res_x, res_y in primitives["updateorigin"].tolist():
        params = CostmapParams(
            rolling_window=True, width=4.0, height=4.0, resolution=0.05, origin_x=ox, origin_y=oy, global_frame="odom"
        )
        costmap = LayeredCostmap("local", params, [], footprint=Footprint.from_radius(0.2), frames=FrameTree())
        half = 79.5 * 0.05 / 2.0
        costmap.update_at(Pose2D(new_x + half, new_y + half), 0.0)
        geometry = costmap.master.geometry
        assert (geometry.nx, geometry.ny) == (80, 80)
        assert (geometry.origin_x, geometry.origin_y) == pytest.approx((res_x, res_y), abs=1e-12)


def test_radii_of_round_footprints(primitives: dict[str, np.ndarray]) -> None:
    for radius, padding, inscribed, circumscribed in primitives["footprint_radius"].tolist():
        footprint = Footprint.from_radius(radius, padding)
        assert footprint.inscribed_radius == pytest.approx(inscribed, abs=1e-12)
        assert footprint.circumscribed_radius == pytest.approx(circumscribed, abs=1e-12)
