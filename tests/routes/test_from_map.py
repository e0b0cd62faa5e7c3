"""Graphs from maps, checked independently: connections with scipy, distances to obstacles with shapely."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import label
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from navstack.core import Footprint, InputError, MapError, OccupancyGrid
from navstack.map_io import load_map, map_names, map_path
from navstack.routes import InvalidGraphError, RouteGraph, check_graph, graph_from_map
from navstack.routes.from_map import FreeSpace
from tests.conftest import SHARED

MAPS = sorted((SHARED / "data" / "maps").glob("*/*.yaml"))
OBSTACLE = 65


def squares(grid: OccupancyGrid) -> shapely.STRtree:
    """The squares of occupied and unknown cells, in the map frame, and a border around the map."""
    blocked = np.pad((grid.data >= OBSTACLE) | (grid.data < 0), 1, constant_values=True)
    ys, xs = np.nonzero(blocked)
    g = grid.geometry
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    corners = (
        np.stack([np.stack([xs - 1 + i, ys - 1 + j], axis=1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=1)
        * g.resolution
    )
    turned = corners @ np.array([[c, s], [-s, c]]) + (g.origin_x, g.origin_y)
    cells: Any = shapely.polygons(turned)
    return shapely.STRtree(cells)


def distances(graph: RouteGraph, tree: shapely.STRtree) -> np.ndarray:
    """Distance from each edge to the nearest square (m), by shapely."""
    xy = graph.xy.astype(np.float64)
    lines = shapely.linestrings(np.stack([xy[graph.starts], xy[graph.ends]], axis=1))
    (_, _), found = tree.query_nearest(lines, return_distance=True, all_matches=False)
    return found


def parts_of(graph: RouteGraph) -> np.ndarray:
    links = csr_matrix((np.ones(graph.edge_count), (graph.starts, graph.ends)), (len(graph), len(graph)))
    return connected_components(links, directed=True, connection="strong")[1]


def require_good(graph: RouteGraph, grid: OccupancyGrid, radius: float) -> None:
    found = distances(graph, squares(grid))
    assert found.min() >= radius
    stored = np.array([graph.edge_metadata[k]["clearance"] for k in range(graph.edge_count)])
    np.testing.assert_allclose(stored, found, atol=2e-4)
    # the places where the circle fits, by shapely's distance to the squares, as parts of neighboring cells
    space = FreeSpace.of(grid)
    free = space.distances >= math.sqrt((radius / space.resolution) ** 2 + 0.5) + 1e-4
    labels, count = cast("tuple[np.ndarray, int]", label(free, np.ones((3, 3))))
    cells = np.floor(space.to_cells(graph.xy.astype(np.float64))).astype(int)
    of = labels[cells[:, 1], cells[:, 0]]
    assert of.min() > 0
    parts = parts_of(graph)
    for part in range(1, count + 1):
        nodes = parts[of == part]
        assert len(set(nodes.tolist())) <= 1, "a region is connected in the graph"
        if not len(nodes):
            size = np.ptp(np.argwhere(labels == part), axis=0).max()
            assert size <= 1, "a region without a node is a place where the robot can only turn"


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.skipif(not MAPS, reason="the maps are absent (../shared/data/maps)")
@pytest.mark.parametrize("file", MAPS, ids=[file.parent.name for file in MAPS])
def test_real_maps(file: Path) -> None:
    try:
        grid = load_map(file)
    except MapError:
        pytest.skip("the image of the map is absent")
    graph = graph_from_map(grid, 0.22)
    require_good(graph, grid, 0.22)
    assert not [
        finding for finding in check_graph(graph, grid, Footprint.from_radius(0.2)) if finding.severity == "error"
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", map_names())
def test_packaged_maps(name: str) -> None:
    grid = load_map(map_path(name))
    require_good(graph_from_map(grid, 0.25), grid, 0.25)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.02, 0.3), st.floats(0.03, 0.25), st.floats(-3.2, 3.2))
def test_random_maps(seed: int, share: float, radius: float, yaw: float) -> None:
    rng = np.random.default_rng(seed)
    blocks = rng.random((8, 10)) < share
    cells = np.kron(blocks, np.ones((6, 6))).astype(np.int8) * 100
    cells[rng.random(cells.shape) < 0.01] = -1
    base = OccupancyGrid.from_array(cells, 0.05, origin=(-3.0, 1.0), values="occupancy")
    grid = OccupancyGrid(base.data, base.geometry, yaw)
    try:
        graph = graph_from_map(grid, radius)
    except InvalidGraphError:
        return
    require_good(graph, grid, radius)


def test_distances_to_squares_are_exact() -> None:
    rng = np.random.default_rng(3)
    grid = OccupancyGrid.from_array(rng.random((23, 31)) < 0.05, 1.0, values="occupied")
    space, tree = FreeSpace.of(grid), squares(grid)
    ys, xs = np.nonzero(~space.occupied)
    points = shapely.points(np.stack([xs - 0.5, ys - 0.5], axis=1))
    expected = shapely.distance(points, tree.geometries[tree.nearest(points)])
    np.testing.assert_allclose(space.distances[ys, xs], expected, atol=1e-9)
    starts, ends = rng.uniform((1.0, 1.0), (32.0, 24.0), (2, 200, 2))
    lines = shapely.linestrings(np.stack([starts - 1.0, ends - 1.0], axis=1))
    np.testing.assert_allclose(
        space.clearances(starts, ends), shapely.distance(lines, tree.geometries[tree.nearest(lines)]), atol=1e-9
    )


def test_a_square_room_gets_an_edge_and_a_corridor_its_middle() -> None:
    room = np.zeros((41, 41), np.bool_)
    room[[0, -1], :] = room[:, [0, -1]] = True
    graph = graph_from_map(OccupancyGrid.from_array(room, 0.1, values="occupied"), 0.3)
    assert len(graph) >= 2
    corridor = np.zeros((12, 200), np.bool_)  # an even number of free rows
    corridor[[0, -1], :] = corridor[:, [0, -1]] = True
    graph = graph_from_map(OccupancyGrid.from_array(corridor, 0.1, values="occupied"), 0.3, spacing=4.0)
    assert np.ptp(graph.xy[:, 1]) < 0.11
    assert graph.xy[:, 1] == pytest.approx(np.full(len(graph), 0.6), abs=0.051)
    assert np.ptp(graph.xy[:, 0]) > 18.0
    assert graph.lengths.max() <= 4.0


def test_wrong_arguments() -> None:
    grid = OccupancyGrid.from_array(np.zeros((5, 5), np.bool_), 0.1, values="occupied")
    with pytest.raises(InputError, match=r"radius \(0.0 m\) and spacing"):
        graph_from_map(grid, 0.0)
    with pytest.raises(InvalidGraphError, match="no way that keeps 2 m from obstacles; reduce the clearance"):
        graph_from_map(grid, 2.0)
