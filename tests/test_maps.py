"""The packaged maps match their script, and all their places are reachable."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import label

from navstack.cli.arguments import map_of
from navstack.core import GridGeometry, MapError, OccupancyGrid
from navstack.map_io import load_map, map_names, map_path
from navstack.scenario import load_places
from navstack.sim import World

NAMES = ["clinic", "maze", "office", "warehouse"]
ROBOT_RADIUS = 0.25


def read(name: str) -> OccupancyGrid:
    """Reads a map from its YAML, independently of `navstack.map_io`."""
    description = yaml.safe_load(map_path(name).read_text())
    pixels = np.array(Image.open(map_path(name).with_name(description["image"])))[::-1]
    occupancy = (255.0 - pixels) / 255.0
    data = np.full(pixels.shape, -1, np.int8)
    data[occupancy > description["occupied_thresh"]] = 100
    data[occupancy < description["free_thresh"]] = 0
    x, y, yaw = description["origin"]
    return OccupancyGrid(data, GridGeometry(data.shape[1], data.shape[0], description["resolution"], x, y), yaw)


@pytest.fixture(scope="module")
def script() -> ModuleType:
    file = Path(__file__).resolve().parents[1] / "tools" / "draw_maps.py"
    spec = importlib.util.spec_from_file_location("draw_maps", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules["draw_maps"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_names() -> None:
    assert map_names() == NAMES
    with pytest.raises(MapError, match=r'unknown packaged map "ofice"; choose one of clinic, maze, office, warehouse'):
        map_path("ofice")


@pytest.mark.slow
def test_shipped_files_are_what_the_script_draws(script: ModuleType, tmp_path: Path) -> None:
    drawn = script.draw(tmp_path, [make() for make in script.PLANS])
    assert sorted(file.name for file in drawn) == sorted(
        file.name for file in map_path("maze").parent.iterdir() if file.suffix in (".png", ".yaml")
    )
    for file in drawn:
        shipped = map_path("maze").with_name(file.name)
        if file.suffix == ".png":  # the same pixels; how they are packed depends on zlib
            np.testing.assert_array_equal(np.array(Image.open(shipped)), np.array(Image.open(file)))
        else:
            assert shipped.read_text() == file.read_text()


@pytest.mark.parametrize("name", NAMES)
def test_users_read_the_same_map(name: str) -> None:
    loaded, expected = load_map(map_path(name)), read(name)
    np.testing.assert_array_equal(loaded.data, expected.data)
    assert (loaded.geometry, loaded.origin_yaw) == (expected.geometry, 0.0)


@pytest.mark.parametrize("name", NAMES)
def test_every_place_has_clearance(name: str) -> None:
    world = World(read(name))
    found = load_places(name)
    for place, pose in found.places.items():
        assert world.contains(pose), place
        assert world.clearance(pose) >= 0.35, place
        assert -math.pi < pose.yaw <= math.pi, place
    assert found.start in found.places.values()
    assert len(found.goals) == 3
    assert all(goal in found.places.values() for goal in found.goals)


def components(grid: OccupancyGrid, radius: float) -> NDArray[np.int32]:
    """Labels of the regions that a round robot's center can reach: cells with this clearance."""
    free = grid.data == 0
    from scipy.ndimage import distance_transform_edt

    # distance between cell centers less half a diagonal is a lower bound of the room at a center
    room = distance_transform_edt(~(grid.data >= 100)) * grid.geometry.resolution
    free &= room - grid.geometry.resolution / math.sqrt(2) >= radius
    labels, _ = label(free)
    return labels


@pytest.mark.parametrize("name", NAMES)
def test_all_places_are_connected(name: str) -> None:
    grid = read(name)
    labels = components(grid, ROBOT_RADIUS)
    found = set()
    for place, pose in load_places(name).places.items():
        cell = grid.geometry.world_to_cell(pose.x, pose.y)
        assert cell is not None
        assert labels[cell[1], cell[0]] > 0, place
        found.add(int(labels[cell[1], cell[0]]))
    assert len(found) == 1


def test_each_goal_of_the_office_is_behind_a_door_of_0_9_m() -> None:
    """A robot wider than such a door cannot leave the corridor; one of exactly its width can."""
    grid, found = read("office"), load_places("office")

    def reached(radius: float) -> list[bool]:
        labels = components(grid, radius - 0.05)  # `components` is too strict by up to 0.036 m
        at = [grid.geometry.world_to_cell(pose.x, pose.y) for pose in (found.start, *found.goals)]
        start, *goals = [labels[cell[1], cell[0]] for cell in at if cell is not None]
        return [bool(goal == start) for goal in goals]

    assert reached(0.45) == [True, True, True]
    assert reached(0.50) == [False, False, False]


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_known_outside_the_building(name: str) -> None:
    data = read(name).data
    assert (data[0] == -1).all()
    assert (data[:, 0] == -1).all()
    assert (data[-1] == -1).all()
    assert (data[:, -1] == -1).all()
    # free cells never touch unknown ones: the walls are closed
    free, unknown = data == 0, data == -1
    assert not (free[1:] & unknown[:-1]).any()
    assert not (free[:-1] & unknown[1:]).any()
    assert not (free[:, 1:] & unknown[:, :-1]).any()
    assert not (free[:, :-1] & unknown[:, 1:]).any()


def test_a_folder_of_the_same_name_does_not_hide_a_packaged_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "office").mkdir()
    monkeypatch.chdir(tmp_path)
    path, grid = map_of("office")
    assert path == map_path("office")
    assert grid.geometry.nx > 100
