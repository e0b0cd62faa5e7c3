"""Passages for a robot with a shape, against closed forms and against what the planner finds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from navstack.bringup import plan_on_map
from navstack.core import OccupancyGrid, PlanningError, Pose2D
from navstack.explain import PassageReport, crossing, find_passages
from navstack.explain.crossing import ShapePassage
from navstack.parameters import Configuration, load_configuration
from tests.explain.passage_scenes import KINDS, crossings, disagreements
from tests.explain.passage_scenes import scene as random_scene
from tests.explain.rooms import RESOLUTION, two_rooms

pytestmark = pytest.mark.slow

RADIUS = 0.6
SCENES, QUERIES = [1, 4], 8


def robot(length: float, width: float, *overrides: str) -> Configuration:
    x, y = 0.5 * length, 0.5 * width
    footprint = f"[[{x},{y}],[{-x},{y}],[{-x},{-y}],[{x},{-y}]]"
    costmaps = ("global_costmap", "local_costmap")
    shape = [f"{name}/{key}" for name in costmaps for key in (f"footprint={footprint}", "footprint_padding=0.0")]
    planner = ["base_global_planner=smac_hybrid", "smac_hybrid/motion_model_for_search=REEDS_SHEPP"]
    planner += ["smac_hybrid/start_policy=refuse", f"smac_hybrid/minimum_turning_radius={RADIUS}"]
    return load_configuration(["turtlebot"], overrides=[*shape, *planner, *overrides])


@pytest.fixture(scope="module")
def long_robot() -> Configuration:
    return robot(1.2, 0.7)


def only(report: PassageReport) -> ShapePassage:
    assert report.shapes is not None and len(report.shapes) == 1
    return report.shapes[0]


def shapes(configuration: Configuration, grid: OccupancyGrid, radius: float) -> PassageReport:
    return find_passages(configuration, grid, narrowest=0.3, widest=1.6, turning_radius=radius)


@pytest.mark.parametrize("thickness", [0.2, 2.4])
def test_the_headings_of_a_straight_wall_have_a_closed_form(long_robot: Configuration, thickness: float) -> None:
    """A box of half sizes a, b turned by t fits in a slot of width w if its chord through the slot does.

    In a slot longer than the robot the whole box counts: a sin t + b cos t <= w / 2. In a thin wall (half thickness h), it is
    the chord at the edges of the wall: b / cos t + h tan t <= w / 2.
    """
    width = 0.9
    door = only(shapes(long_robot, two_rooms({0.0: width}, thickness=thickness), 0.0))
    # walls are of whole cells: 0.2 m is 4 cells
    a, b, h = 0.6, 0.35, 0.5 * thickness
    t = np.linspace(0.0, math.pi / 4.0, 100_000)
    need = a * np.sin(t) + b * np.cos(t) if h > 1.0 else b / np.cos(t) + h * np.tan(t)
    # the room of 0.01 cells around the footprint is less than 1 mm of width
    least, most = (float(t[np.flatnonzero(need <= limit)[-1]]) for limit in (0.5 * width - 0.001, 0.5 * width))
    assert door.changes is None and not door.searched
    assert len(door.headings) == 2
    step = math.radians(2.0)
    for found in door.headings:
        assert 2.0 * least - 2.0 * step <= found.high - found.low <= 2.0 * most + 1e-9
        middle = 0.5 * (found.low + found.high)
        assert abs(math.sin(middle)) == pytest.approx(1.0, abs=1e-3)  # across the wall


def test_a_door_is_as_narrow_as_the_robot_or_not(long_robot: Configuration) -> None:
    for width, fits in ((0.65, False), (0.7, False), (0.75, True)):
        door = only(shapes(long_robot, two_rooms({0.025: width}), RADIUS))
        assert bool(door.headings) is fits
        assert door.verdict == ("free" if fits else "blocked")


@pytest.mark.parametrize("padding", [0.0, 0.05])
def test_a_round_robot_has_no_headings(padding: float) -> None:
    both = [f"{costmap}/footprint_padding={padding}" for costmap in ("global_costmap", "local_costmap")]
    padded = load_configuration(["turtlebot"], overrides=both)
    assert find_passages(padded, two_rooms({0.0: 0.9})).shapes is None


def test_unknown_walls_are_walls_for_a_shape(long_robot: Configuration) -> None:
    """In a costmap without unknown space (`track_unknown_space: false`), too."""
    grid = two_rooms({0.0: 0.65})
    unknown = OccupancyGrid(np.where(grid.data == 100, -1, 0).astype(np.int8), grid.geometry)
    assert not long_robot.global_costmap.params.track_unknown_space
    found = find_passages(long_robot, unknown, narrowest=0.3, widest=1.6, unknown_is_wall=True, turning_radius=RADIUS)
    assert only(found).verdict == "blocked"


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(len(KINDS)))
def test_random_openings_agree_with_the_brute_force(seed: int) -> None:
    assert disagreements(random_scene(seed)) == []


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.1, 2.5])
def test_a_failed_plan_names_the_gap_that_is_too_narrow(angle: float) -> None:
    """Where it is, its direction and its width, for a footprint whose base is not in its middle; the cells connect."""
    across = np.array([-math.sin(angle), math.cos(angle)])
    door = 0.6 * np.array([math.cos(angle), math.sin(angle)])
    points = "[[0.8,0.5],[0.8,-0.2],[-0.3,-0.2],[-0.3,0.5]]"
    shape = [f"{name}_costmap/footprint={points}" for name in ("global", "local")]
    configuration = robot(1.2, 0.7, *shape)
    grid = two_rooms({0.6: 0.6}, angle=angle)
    start, goal = (Pose2D(side * across[0], side * across[1], angle) for side in (-2.0, 2.0))
    with pytest.raises(PlanningError) as error:
        plan_on_map(configuration, grid, start, goal)
    (spot,) = error.value.data["narrow"]
    assert math.dist((spot["x"], spot["y"]), door) < 0.1
    assert abs(math.remainder(spot["heading"] - angle, math.pi)) == pytest.approx(0.5 * math.pi, abs=math.radians(8.0))
    assert spot["width_m"] == pytest.approx(0.6, abs=0.08)


def test_a_search_that_ends_at_its_limit_says_so(long_robot: Configuration, monkeypatch: pytest.MonkeyPatch) -> None:
    rooms = two_rooms({0.0: 0.9})
    whole = only(shapes(long_robot, rooms, RADIUS))
    assert (whole.verdict, whole.limited) == ("free", False)
    monkeypatch.setattr(crossing, "_STATES", 100)
    part = only(shapes(long_robot, rooms, RADIUS))
    assert (part.verdict, part.limited) == ("stuck", True) and part.as_dict()["limit_reached"]
    blocked = only(shapes(long_robot, two_rooms({0.0: 0.6}), RADIUS))
    assert (blocked.verdict, blocked.limited) == ("blocked", False)


def test_progress_and_counts(long_robot: Configuration) -> None:
    grid = two_rooms({-1.8: 0.65, 1.8: 0.9})
    told: list[tuple[int, int]] = []

    def progress(done: int, total: int) -> None:
        told.append((done, total))

    found = find_passages(long_robot, grid, narrowest=0.3, widest=1.6, turning_radius=0.0, progress=progress)
    assert told == [(1, 2), (2, 2)]
    assert found.shape_counts == {"free": 0, "turns": 0, "fits": 1, "stuck": 0, "blocked": 1}
    assert found.as_dict()["footprint_counts"] == found.shape_counts


def scene(seed: int) -> OccupancyGrid:
    """A wall with two narrow doors in a room with boxes."""
    rng = np.random.default_rng(seed)
    doors = {-1.8: float(rng.uniform(0.6, 1.1)), 1.8: float(rng.uniform(0.6, 1.1))}
    grid = two_rooms(doors, angle=float(rng.uniform(0.0, math.pi)), thickness=float(rng.uniform(0.1, 0.8)))
    data = grid.data.copy()
    for x, y, half in zip(rng.uniform(-3.5, 3.5, 8), rng.uniform(-3.5, 3.5, 8), rng.uniform(0.05, 0.3, 8), strict=True):
        ix, iy, k = round((x + 4.0) / RESOLUTION), round((y + 4.0) / RESOLUTION), max(1, round(half / RESOLUTION))
        data[max(0, iy - k) : iy + k, max(0, ix - k) : ix + k] = 100
    return OccupancyGrid(data, grid.geometry)


@pytest.mark.parametrize("seed", SCENES)
def test_answers_agree_with_the_planner(long_robot: Configuration, seed: int) -> None:
    """No plan crosses an opening said impassable, or at another heading; and ways through are free, and plans follow them."""
    grid = scene(seed)
    report = shapes(long_robot, grid, RADIUS)
    assert report.shapes
    rows, columns = np.nonzero(report.costmap.data == 254)
    x, y = report.costmap.geometry.cell_to_world(0, 0)
    cells = shapely.box(
        *(np.array([columns, rows]) * RESOLUTION + [[x], [y]] - 0.5 * RESOLUTION + 1e-9),
        *(np.array([columns, rows]) * RESOLUTION + [[x], [y]] + 0.5 * RESOLUTION - 1e-9),
    )
    tree = shapely.STRtree(cells)
    ways = [shape.path for shape in report.shapes if shape.path is not None]
    for path in ways:
        outlines = shapely.polygons([report.footprint.at(Pose2D(*pose)) for pose in path.poses])
        assert not tree.query(outlines, predicate="intersects").size
        assert plan_on_map(long_robot, grid, path[0], path[len(path) - 1]).plan.path.length > 0.0
    rng = np.random.default_rng(seed)
    crossed = missed = 0
    for _ in range(QUERIES):
        start, goal = (Pose2D(*rng.uniform([-3.5, -3.5, -3.1], [3.5, 3.5, 3.1])) for _ in range(2))
        try:
            poses = plan_on_map(long_robot, grid, start, goal).plan.path.poses
        except PlanningError:
            continue
        for passage, shape in zip(report.passages, report.shapes, strict=True):
            through = crossings(poses, passage)
            crossed += len(through) % 2
            for i in through:
                assert shape.headings
                missed += len(through) % 2 and shape.verdict == "stuck"
                assert any(
                    r.low - 0.1 <= r.low + (poses[i, 2] - r.low) % (2.0 * math.pi) <= r.high + 0.1
                    or (r.low - poses[i, 2]) % (2.0 * math.pi) < 0.1
                    for r in shape.headings
                )
    assert missed == 0
    assert crossed > 0 or seed != 1
