"""Frontiers, and a robot that maps a world by driving to them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from navstack.cli.app import run
from navstack.core import Costmap, GridGeometry, InputError, OccupancyGrid, Pose2D
from navstack.map_io import load_map, save_map
from navstack.mapping import (
    Exploration,
    OnlineMapper,
    exploration_report,
    goals_on,
    overrides_for_exploration,
)
from navstack.mapping.frontiers import ExplorationParams, find_frontiers, travel_costs
from navstack.parameters import load_configuration
from navstack.scenario import Scenario

RESOLUTION = 0.1


def costmap_of(grid: OccupancyGrid, inflated: int = 2) -> Costmap:
    from scipy.ndimage import binary_dilation

    data = np.where(grid.data == 100, 254, np.where(grid.data == -1, 255, 0)).astype(np.uint8)
    near = np.asarray(binary_dilation(grid.data == 100, iterations=inflated), bool) & (data < 253)
    data[near] = 253
    return Costmap(grid.geometry, data)


def half_known() -> OccupancyGrid:
    """A room of 6 x 4 m of which the right half is unknown, with walls."""
    cells = np.zeros((40, 60), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    cells[:, 30:] = -1
    return OccupancyGrid(cells, GridGeometry(60, 40, RESOLUTION, -1.0, 2.0))


def two_rooms() -> OccupancyGrid:
    """5 x 3 m with a door of 0.9 m, in cells of 5 cm."""
    cells = np.zeros((60, 100), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    cells[:, 50] = 100
    cells[21:39, 50] = 0
    return OccupancyGrid(cells, GridGeometry(100, 60, 0.05, 0.0, 0.0))


def test_the_frontier_of_a_half_known_room() -> None:
    grid = half_known()
    found = find_frontiers(grid, costmap_of(grid), Pose2D(0.0, 4.0))
    assert len(found) == 1
    frontier = found[0]
    assert frontier.size == pytest.approx(3.8)
    assert (frontier.x, frontier.y) == (pytest.approx(1.95), pytest.approx(4.0, abs=0.06))
    assert frontier.goal is not None
    assert math.hypot(frontier.goal.x - frontier.x, frontier.goal.y - frontier.y) < 0.15
    assert frontier.goal.yaw == pytest.approx(0.0, abs=0.3)
    assert frontier.distance == pytest.approx(1.95, abs=0.15)
    assert frontier.is_near(1.95, 2.2, 0.1) and not frontier.is_near(0.5, 4.0, 0.5)


def test_a_goal_keeps_the_room_to_turn_where_there_is_some() -> None:
    grid = half_known()
    data = grid.data.copy()
    data[18:22, 27] = 100
    posted = OccupancyGrid(data, grid.geometry)
    for radius in (0.0, 0.45):
        frontier = find_frontiers(posted, costmap_of(posted), Pose2D(0.0, 4.0), turning_radius=radius)[0]
        assert frontier.goal is not None
        iy, ix = np.nonzero(posted.data == 100)
        away = np.hypot((ix + 0.5) * 0.1 - 1.0 - frontier.goal.x, (iy + 0.5) * 0.1 + 2.0 - frontier.goal.y).min()
        assert away > max(radius, 0.2)
        assert not frontier.tight
    narrow = find_frontiers(posted, costmap_of(posted), Pose2D(0.0, 4.0), turning_radius=2.5)[0]
    assert narrow.goal is not None and narrow.tight


def test_what_is_no_frontier_and_what_cannot_be_reached() -> None:
    grid = half_known()
    data = grid.data.copy()
    data[:, 30] = 100
    closed = OccupancyGrid(data.copy(), grid.geometry)
    assert find_frontiers(closed, costmap_of(closed), Pose2D(0.0, 4.0)) == []
    data[20, 30] = 0
    data[20, 31:40] = 0  # a beam through a gap of one cell
    assert find_frontiers(OccupancyGrid(data, grid.geometry), costmap_of(closed), Pose2D(0.0, 4.0)) == []
    data = closed.data.copy()
    data[10:20, 35:45] = 0  # seen through glass, say
    island = OccupancyGrid(data, grid.geometry)
    (frontier,) = find_frontiers(island, costmap_of(island), Pose2D(0.0, 4.0))
    assert frontier.goal is None
    assert frontier.reason == "no way there that is wide enough"
    assert find_frontiers(island, costmap_of(island), Pose2D(0.0, 4.0), ExplorationParams(min_size=5.0)) == []
    # a hole that is smaller than what counts as unknown
    data = np.where(np.arange(60) >= 0, 0, grid.data).astype(np.int8) * 0
    data[20:22, 30:32] = -1
    pierced = OccupancyGrid(data, grid.geometry)
    assert find_frontiers(pierced, costmap_of(pierced), Pose2D(0.0, 4.0)) == []


def test_the_length_of_ways() -> None:
    grid = OccupancyGrid(np.zeros((30, 40), np.int8), GridGeometry(40, 30, 0.1, 0.0, 0.0))
    costmap = costmap_of(grid)
    costs = travel_costs(costmap, Pose2D(0.05, 0.05))
    assert costs[0, 10] == pytest.approx(1.0)
    assert costs[10, 10] == pytest.approx(math.sqrt(2.0))
    assert costs[5, 20] == pytest.approx(0.5 * math.sqrt(2.0) + 1.5)
    costmap.data[:, 20] = 254
    walled = travel_costs(costmap, Pose2D(0.05, 0.05))
    assert np.isinf(walled[:, 20:]).all() and np.isfinite(walled[:, :20]).all()
    assert np.isinf(travel_costs(costmap, Pose2D(9.0, 9.0))).all()
    # in a forbidden cell, the nearest allowed one counts
    assert np.isfinite(travel_costs(costmap, Pose2D(2.05, 1.0))).any()


def scenario(world: OccupancyGrid, *overrides: str) -> Scenario:
    sets = ["navstack.sim.odometry_noise=0.02", *overrides, *overrides_for_exploration()]
    configuration = load_configuration(["omni_dwa"], overrides=sets)
    return Scenario(map=world, configuration=configuration, start=Pose2D(1.0, 1.5), goals=())


@pytest.mark.slow
def test_a_robot_maps_two_rooms_and_ends() -> None:
    world = two_rooms()
    exploration = Exploration(scenario(world), record=False, time_limit_s=300.0)
    while exploration.step():
        pass
    grid = exploration.final_map()
    report = exploration_report(exploration, grid)
    assert exploration.is_complete, exploration.ended
    assert report["complete"]
    assert report["contacts"] == 0
    assert report["reachable_known"] > 0.99
    assert report["walls_within_a_cell"] > 0.95
    assert report["position_error_m"] < 0.05
    assert report["distance_m"] > 1.5
    assert report["visits"]
    # the frame of the map is that of the first pose: places of the world are places of the map
    places = {"other room": Pose2D(4.0, 1.5, 0.0), "outside": Pose2D(9.0, 9.0, 0.0)}
    assert [name for name, _ in goals_on(exploration.scenario, grid, places, 5)] == ["other room"]
    assert len(goals_on(exploration.scenario, grid, {}, 3)) == 3


def test_a_map_that_is_wrong_is_not_explored() -> None:
    exploration = Exploration(scenario(two_rooms()), record=False)
    exploration.ended, exploration.is_exhausted = "nothing that the robot can reach is unknown", True
    assert exploration.is_complete
    first = np.where(np.arange(100) < 50, two_rooms().data, -1).astype(np.int8)
    report = exploration_report(exploration, OccupancyGrid(first, two_rooms().geometry))
    assert 0.4 < report["reachable_known"] < 0.6
    assert not report["complete"]
    assert report["ended"].startswith("the robot sees no way on, but 4")
    assert exploration_report(exploration, two_rooms())["complete"]


@pytest.mark.slow
def test_it_ends_in_time_and_says_so() -> None:
    exploration = Exploration(scenario(two_rooms()), record=False, time_limit_s=2.0)
    while exploration.step():
        pass
    assert exploration.ended == "the time limit of 2 s"
    assert not exploration.is_complete
    assert not exploration.is_exhausted
    assert not exploration_report(exploration, exploration.final_map())["complete"]
    assert all(left.reason for left in exploration.left())


def test_parameters_without_a_static_map_are_refused() -> None:
    configuration = load_configuration(["jackal_dwa"], overrides=overrides_for_exploration())
    with pytest.raises(InputError, match="needs a global costmap with the layer of the static map"):
        Exploration(
            Scenario(map=two_rooms(), configuration=configuration, start=Pose2D(1.0, 1.5), goals=()), record=False
        )


def test_an_online_mapper_gives_no_estimate_before_a_scan() -> None:
    mapper = OnlineMapper()
    assert mapper.grown_map(0.2) is None
    assert mapper.estimate is None
    assert mapper.keyframes == 0
    mapper.set_pose(Pose2D(3.0, 0.0), np.eye(3), 0.0)
    assert tuple(mapper.start) == (3.0, 0.0, 0.0)


@pytest.mark.slow
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, _ = save_map(two_rooms(), tmp_path / "world.yaml")
    out = tmp_path / "out"
    line = ["map", "explore", str(file), "--params", "omni_dwa", "--out", str(out)]
    assert run(line) == 2
    assert "give where the robot begins: --start" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()
    assert run([*line, "--start", "1,1.5,0", "--json", "--time-limit", "60", "--drive"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["ended"] == "nothing that the robot can reach is unknown"
    assert document["drive"]["reached"] == document["drive"]["goals"] == 5
    assert document["drive"]["contacts"] == document["contacts"] == 0
    assert load_map(out / "map.yaml").data.size
    assert {"explore.png", "explore.json", "map.yaml", "run.npz"} <= {each.name for each in out.iterdir()}


def test_a_map_that_grows_has_the_cells_of_one_that_is_made_at_once() -> None:
    from navstack.core import Transform2D
    from navstack.localization import LoggedScan
    from navstack.logs import GrowingMap, MappingModel, map_from_frames
    from tests.localization.rooms import free_pose, rooms, scan_from

    world = rooms()
    rng = np.random.default_rng(2)
    poses = [free_pose(world, rng) for _ in range(12)]
    frames = [
        LoggedScan(k, scan_from(world, pose, reach=3.0), Transform2D(), Transform2D(), Pose2D(*pose))
        for k, pose in enumerate(poses)
    ]
    model = MappingModel(max_range=2.9, clear_without_return=True)
    growing = GrowingMap(0.05, model)
    for k, frame in enumerate(frames):
        growing.add(frame)
        if k in (0, 5, 11):
            whole = map_from_frames(lambda k=k: frames[: k + 1], resolution=0.05, model=model)[0]
            grid = growing.grid()
            assert grid.geometry == whole.geometry
            assert (grid.data != whole.data).mean() < 1e-4  # a point on the border of two cells may fall into either
