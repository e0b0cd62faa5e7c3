"""The passage report against maps with known doors."""

from __future__ import annotations

import math
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from scipy import ndimage

from navstack.core import INSCRIBED, Footprint, GridGeometry, InputError, OccupancyGrid, Pose2D
from navstack.explain import PassageReport, find_passages, narrow_advice, print_passages
from navstack.explain.narrow_places import narrow_places
from navstack.explain.passages import own_width
from navstack.map_io import load_map
from navstack.parameters import Configuration, load_configuration
from navstack.scenario import Scenario, run_scenario
from tests.explain.rooms import RESOLUTION, bare_room, two_rooms, with_boxes


@pytest.fixture(scope="module")
def turtlebot() -> Configuration:
    return load_configuration(["turtlebot"])


def report(configuration: Configuration, grid: OccupancyGrid, **limits: float) -> PassageReport:
    return find_passages(configuration, grid, **({"narrowest": 0.1, "widest": 1.6} | limits))  # type: ignore[arg-type]


WIDTHS = [0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.65, 0.7, 0.8, 0.9, 0.95, 1.0, 1.1, 1.2]


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS)
def test_a_door_along_the_grid_has_its_width(turtlebot: Configuration, width: float) -> None:
    # the wall has whole cells: the middle of an even number of cells is on the edge of a cell
    odd = round(width / RESOLUTION) % 2
    middle = RESOLUTION / 2.0 if odd else 0.0
    for angle in (0.0, math.pi / 2.0):
        (door,) = report(turtlebot, two_rooms({middle: width}, angle=angle)).passages
        assert door.width == pytest.approx(width)
        at = (middle * math.cos(angle), middle * math.sin(angle))
        assert math.hypot(door.x - at[0], door.y - at[1]) <= 2.0 * RESOLUTION


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("degrees", [3, 10, 26.565, 37, 45, 58, 71, 88, 115, 140, 163])
@pytest.mark.parametrize("width", [0.3, 0.5, 0.75, 0.9, 1.2])
def test_a_door_in_a_turned_wall_is_true_to_a_cell(turtlebot: Configuration, width: float, degrees: float) -> None:
    angle = math.radians(degrees)
    (door,) = report(turtlebot, two_rooms({0.3: width}, angle=angle)).passages
    assert abs(door.width - width) <= RESOLUTION
    assert math.hypot(door.x - 0.3 * math.cos(angle), door.y - 0.3 * math.sin(angle)) <= 0.15
    (ax, ay), (bx, by) = door.ends
    off = (math.atan2(by - ay, bx - ax) - angle + math.pi / 2.0) % math.pi - math.pi / 2.0
    assert abs(off) < math.atan2(0.25, width)  # from jamb to jamb


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0, 17, 45, 74, 90])
@pytest.mark.parametrize("width", WIDTHS)
def test_not_passable_means_that_no_free_cells_connect(turtlebot: Configuration, width: float, degrees: float) -> None:
    angle = math.radians(degrees)
    found = report(turtlebot, two_rooms({0.0: width}, angle=angle))
    (door,) = found.passages
    label, _ = ndimage.label(found.costmap.data < INSCRIBED)
    ahead = [found.costmap.geometry.world_to_cell(s * -math.sin(angle), s * math.cos(angle)) for s in (2.0, -2.0)]
    (ax, ay), (bx, by) = (cell for cell in ahead if cell is not None)
    assert (door.rating != "blocked") == (label[ay, ax] == label[by, bx])
    lowest = (
        min(
            cost
            for cost in range(255)
            if np.unique(ndimage.label(found.costmap.data <= cost)[0][[ay, by], [ax, bx]]).size == 1
        )
        if door.rating != "blocked"
        else None
    )
    if lowest is not None and degrees in (0, 90):
        assert door.cost == lowest


def test_ratings_follow_the_cost(turtlebot: Configuration) -> None:
    found = report(turtlebot, two_rooms({-2.5: 0.3, 0.0: 0.5, 2.5: 1.2}))
    assert [(p.rating, p.can_turn, p.fits) for p in found.passages] == [
        ("blocked", False, False),
        ("costly", True, True),
        ("free", True, True),
    ]
    assert found.passages[0].cost == INSCRIBED
    assert 126 <= found.passages[1].cost <= 252
    assert found.passages[2].cost == 0
    assert "inscribed radius 0.21" in found.passages[0].reason
    assert f"cost {found.passages[1].cost} of 252" in found.passages[1].reason
    assert "inflation radius 0.50 m" in found.passages[2].reason


@pytest.mark.slow
def test_the_rating_changes_at_the_required_widths(turtlebot: Configuration) -> None:
    required = report(turtlebot, bare_room()).widths
    cells = [round(width / RESOLUTION) for width in (required.minimum, required.low_cost)]
    ratings = {}
    for n in range(3, 20):
        grid = two_rooms({RESOLUTION / 2.0 * (n % 2): n * RESOLUTION})
        (door,) = report(turtlebot, grid).passages
        ratings[n] = door.rating
    assert next(n for n in ratings if ratings[n] != "blocked") == cells[0]
    assert next(n for n in ratings if ratings[n] == "free") == cells[1]


def test_a_long_robot_is_reported_as_unable_to_turn(turtlebot: Configuration) -> None:
    long = load_configuration(
        ["turtlebot"],
        overrides=[f"{c}_costmap/footprint=[[-0.5,-0.2],[-0.5,0.2],[0.5,0.2],[0.5,-0.2]]" for c in ("local", "global")],
    )
    (door,) = report(long, two_rooms({0.0: 0.7})).passages
    assert door.rating != "blocked"
    assert not door.can_turn
    assert "too narrow to turn" in door.reason


def test_without_inflation_a_door_narrower_than_the_robot_is_reported() -> None:
    bare = load_configuration(["turtlebot"], overrides=["global_costmap/inflation_layer/enabled=false"])
    (door,) = report(bare, two_rooms({0.0: 0.3})).passages
    assert (door.rating, door.fits) == ("free", False)
    assert "no inflation layer" in door.reason
    assert "may collide" in door.reason


def test_two_doors_between_the_same_rooms_are_two(turtlebot: Configuration) -> None:
    found = report(turtlebot, two_rooms({-2.0: 0.8, 2.0: 0.9}, angle=0.5))
    assert len(found.passages) == 2


def test_a_deep_door_is_one_and_has_a_length(turtlebot: Configuration) -> None:
    (corridor,) = report(turtlebot, two_rooms({0.0: 0.9}, thickness=3.0)).passages
    assert corridor.width == pytest.approx(0.9)
    assert corridor.length == pytest.approx(3.0, abs=0.2)
    assert abs(corridor.y) <= 0.1
    (turned,) = report(turtlebot, two_rooms({0.0: 0.9}, thickness=3.0, angle=0.6)).passages
    assert turned.width == pytest.approx(0.9, abs=RESOLUTION)


def test_rough_walls_do_not_make_passages(turtlebot: Configuration) -> None:
    grid = two_rooms({0.0: 1.0}, thickness=3.0)
    data = grid.data.copy()
    random = np.random.default_rng(4)
    for side, step in ((69, -1), (90, 1)):  # remove random cells from the walls of the corridor
        rows = random.random(160) < 0.5
        column = side
        data[rows & (data[:, column] == 100), column] = 0
        del step
    found = report(turtlebot, OccupancyGrid(data, grid.geometry))
    assert len(found.passages) == 1


def test_gaps_beside_isolated_furniture_can_be_left_out(turtlebot: Configuration) -> None:
    chair = (2.0, 3.2, 2.4, 3.5)
    grid = with_boxes(bare_room(), chair)
    assert report(turtlebot, grid, smallest_obstacle=1.0).passages == ()
    (behind,) = report(turtlebot, grid).passages
    assert (behind.width, behind.obstacle) == pytest.approx((0.4, 0.4))
    sideboard = (0.0, 3.2, 2.4, 3.5)
    (beside,) = report(turtlebot, with_boxes(bare_room(), sideboard), smallest_obstacle=1.0).passages
    assert beside.width == pytest.approx(0.4)


def test_a_speck_in_a_doorway_divides_it(turtlebot: Configuration) -> None:
    speck = (0.1, 0.0, 0.15, 0.05)
    grid = with_boxes(two_rooms({0.0: 1.2}), speck)
    right, left = report(turtlebot, grid).passages
    assert (right.width, left.width) == pytest.approx((0.45, 0.7))
    assert left.x < 0.0 < right.x
    (door,) = report(turtlebot, grid, smallest_obstacle=1.0).passages
    assert door == left


def test_gaps_between_pillars_are_listed(turtlebot: Configuration) -> None:
    # three specks as close as 0.4 m enclose no wider space
    specks = [(x, y, x + 0.05, y + 0.05) for x, y in ((0.0, 0.0), (0.45, 0.0), (0.2, 0.4))]
    found = report(turtlebot, with_boxes(bare_room(), *specks)).passages
    assert {p.rating for p in found} <= {"costly", "blocked"}
    assert [p.width for p in found] == pytest.approx([0.4, 0.4, 0.4], abs=0.05)
    assert {p.obstacle for p in found} >= {0.05}


def disjoint_pillars(seed: int) -> np.ndarray:
    """(ny, nx) obstacles of all sizes from one cell on, in a walled or open room."""
    random = np.random.default_rng(seed)
    blocked = np.zeros((70, 80), bool)
    if seed % 2:
        blocked[[0, -1]] = blocked[:, [0, -1]] = True
    y, x = np.indices(blocked.shape)
    for _ in range(int(random.integers(2, 25))):
        cx, cy, a, b = *random.uniform(2, 68, 2), *random.uniform(0.0, 6.0, 2)
        shape = int(random.integers(3))
        if shape == 0:
            blocked |= np.hypot(x - cx, y - cy) <= a
        elif shape == 1:
            blocked |= (np.abs(x - cx) <= a) & (np.abs(y - cy) <= b)
        else:
            blocked[int(cy), int(cx)] = True
    return blocked


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(3.0, 20.0))
def test_every_gap_between_two_obstacles_is_listed(seed: int, needed: float) -> None:
    blocked = disjoint_pillars(seed)
    found = narrow_places(blocked, ~blocked, narrowest=2.0, widest=30.0, widening=3.0, relative=0.25, always=needed)
    label, count = ndimage.label(blocked, np.ones((3, 3), int))
    listed = {
        frozenset((int(label[ay, ax]), int(label[by, bx])))
        for place in found
        for (ax, ay), (bx, by) in place.bars
        if math.dist((ax, ay), (bx, by)) <= needed + 1e-6
    }
    cells = [np.argwhere(label == k + 1) for k in range(count)]
    everything = np.argwhere(blocked)
    for i in range(count):
        for j in range(i):
            apart = np.hypot(*(cells[i][:, None] - cells[j][None]).transpose(2, 0, 1))
            a, b = np.unravel_index(apart.argmin(), apart.shape)
            one, other = cells[i][a], cells[j][b]
            middle = (one + other) / 2.0
            if not 2.0 <= apart[a, b] <= needed or blocked[tuple(np.floor(middle + 0.5).astype(int))]:
                continue
            # a third obstacle in the circle over the gap divides it into two others
            inside = np.hypot(*(everything - middle).T) <= apart[a, b] / 2.0 + 1e-9
            if inside.sum() == 2:
                assert frozenset((i + 1, j + 1)) in listed, (one, other)


def test_the_number_of_narrower_openings_is_stated(turtlebot: Configuration) -> None:
    grid = two_rooms({-2.0: 0.1, 0.0: 0.15, 2.0: 0.9})
    found = find_passages(turtlebot, grid)
    assert ([p.width for p in found.passages], found.narrower) == (pytest.approx([0.9]), 2)
    assert find_passages(turtlebot, grid, narrowest=0.0).narrower == 0


def test_openings_beyond_the_limits_are_left_out(turtlebot: Configuration) -> None:
    grid = two_rooms({-2.5: 0.3, 0.0: 0.5, 2.5: 1.2})
    assert [p.width for p in report(turtlebot, grid, narrowest=0.3, widest=0.5).passages] == pytest.approx([0.3, 0.5])
    assert [p.width for p in report(turtlebot, grid, narrowest=0.31, widest=1.19).passages] == pytest.approx([0.5])
    with pytest.raises(InputError, match="--narrowest below --widest"):
        report(turtlebot, grid, narrowest=1.0, widest=0.5)


def test_unknown_space_is_a_wall_on_request(turtlebot: Configuration) -> None:
    grid = two_rooms({0.0: 0.9})
    data = grid.data.copy()
    data[data == 100] = -1
    foggy = OccupancyGrid(data, grid.geometry)
    seen = report(turtlebot, foggy)
    assert seen.passages == ()
    assert seen.unknown_border == 1.0
    taken = find_passages(turtlebot, foggy, unknown_is_wall=True)
    (door,) = taken.passages
    assert door.width == pytest.approx(0.9)
    assert door.cost == 0  # no layer inflates unknown space


def test_maps_without_passages(turtlebot: Configuration) -> None:
    for grid in (bare_room(), OccupancyGrid(np.full((40, 40), -1, np.int8), GridGeometry(40, 40, 0.05))):
        assert report(turtlebot, grid).passages == ()
    empty = OccupancyGrid(np.zeros((40, 40), np.int8), GridGeometry(40, 40, 0.05))
    assert report(turtlebot, empty).passages == ()
    full = OccupancyGrid(np.full((40, 40), 100, np.int8), GridGeometry(40, 40, 0.05))
    assert report(turtlebot, full).passages == ()
    row = OccupancyGrid(np.full((1, 40), 100, np.int8), GridGeometry(40, 1, 0.05))
    assert report(turtlebot, row).passages == ()


def test_a_turned_map_has_the_same_doors(turtlebot: Configuration) -> None:
    grid = two_rooms({0.0: 0.9})
    turned = OccupancyGrid(grid.data, grid.geometry, origin_yaw=0.4)
    (door,) = report(turtlebot, turned).passages
    # every costmap cell that overlaps a wall is lethal: up to one cell of free space less on either side
    assert 0.9 - 2.0 * RESOLUTION - 1e-9 <= door.width <= 0.9


def test_the_local_costmap_judges_by_its_own_inflation() -> None:
    differing = load_configuration(["turtlebot"], overrides=["local_costmap/inflation_layer/inflation_radius=0.2"])
    grid = two_rooms({0.0: 0.6})
    (by_global,) = find_passages(differing, grid).passages
    (by_local,) = find_passages(differing, grid, costmap="local").passages
    assert (by_global.rating, by_local.rating) == ("costly", "free")


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
def test_a_mirrored_or_turned_map_has_the_same_widths(seed: int, pose: int) -> None:
    random = np.random.default_rng(seed)
    blocked = np.zeros((60, 60), bool)
    blocked[[0, -1]] = blocked[:, [0, -1]] = True
    for _ in range(8):
        x, y = random.integers(0, 56, 2)
        w, h = random.integers(2, 24, 2)
        blocked[y : y + h, x : x + w] = True
    other = np.rot90(blocked[::-1] if pose & 4 else blocked, pose & 3)
    found = [narrow_places(m, ~m, narrowest=2.0, widest=20.0) for m in (blocked, np.ascontiguousarray(other))]
    assert [p.distance for p in found[0]] == pytest.approx([p.distance for p in found[1]])
    for place in found[0]:
        (ax, ay), (bx, by) = place.first, place.second
        assert blocked[ay, ax] and blocked[by, bx]
        rows, columns = np.nonzero(blocked)
        middle = (ax + bx) / 2.0, (ay + by) / 2.0
        nearest = np.hypot(columns - middle[0], rows - middle[1]).min()
        assert nearest == pytest.approx(place.distance / 2.0)  # its circle contains no obstacle


@pytest.mark.slow
@pytest.mark.parametrize("name", ["navigation_tutorials__willow-full-0.10/willow-full.yaml"])
def test_the_doors_of_willow_garage(turtlebot: Configuration, data_dir: Path, name: str) -> None:
    path = data_dir / "maps" / name
    if not path.is_file():
        pytest.skip("this map is not in the external data")
    found = find_passages(turtlebot, load_map(path))
    doors = [(p.x, p.y) for p in found.passages]
    # evident doors: of two offices in the south west, and of the room in the middle west
    for x, y in ((4.3, 8.8), (20.2, 8.5), (18.5, 34.3), (21.5, 34.6)):
        assert min(math.hypot(x - dx, y - dy) for dx, dy in doors) < 0.5, (x, y)
    for passage in found.passages:
        assert (passage.clearance <= found.inscribed_radius) == (passage.rating == "blocked"), passage
        assert passage.width <= 2.0 * (passage.clearance + found.costmap.geometry.resolution)


def test_the_widths_of_a_round_robot_agree(turtlebot: Configuration) -> None:
    """The polygon that stands for a circle is narrower between its sides; the robot is not."""
    room = OccupancyGrid(np.zeros((60, 60), np.int8), GridGeometry(60, 60, 0.05))
    configuration = load_configuration(["turtlebot"], overrides=["global_costmap/footprint_padding=0.0"])
    radius = configuration.global_costmap.true_footprint.circumscribed_radius
    widths = find_passages(configuration, room).widths
    assert widths.robot == widths.turning == pytest.approx(2.0 * radius)
    # a cost is that of a cell: without padding, the costs let the robot into openings that are a cell too narrow
    assert widths.minimum == pytest.approx(0.35) and widths.minimum < widths.robot
    out = Console(file=StringIO(), width=200)
    print_passages(out, find_passages(configuration, room), "room")
    assert "by the costs, less than the robot is wide" in out.file.getvalue()  # type: ignore[attr-defined]


def test_the_width_of_a_footprint_is_across_its_narrow_side() -> None:
    shape = Footprint(np.array([[-0.2, -0.5], [0.9, -0.5], [0.9, 0.1], [-0.2, 0.1]]))  # off center
    assert own_width(shape) == pytest.approx(0.6)
    turned = Footprint(shape.vertices @ np.array([[0.6, 0.8], [-0.8, 0.6]]))
    assert own_width(turned) == pytest.approx(0.6)


def test_the_search_is_as_wide_as_the_robot_needs_and_says_that_it_found_none() -> None:
    large = "[[-1.5,-1.0],[1.5,-1.0],[1.5,1.0],[-1.5,1.0]]"
    configuration = load_configuration(
        ["turtlebot"], overrides=[f"{c}_costmap/footprint={large}" for c in ("local", "global")]
    )
    room = OccupancyGrid(np.zeros((200, 200), np.int8), GridGeometry(200, 200, 0.05))
    report = find_passages(configuration, room)
    assert report.widest == pytest.approx(1.5 * 2.0 * np.hypot(1.5, 1.0))
    out = Console(file=StringIO(), width=200)
    print_passages(out, report, "room")
    shown = out.file.getvalue()  # type: ignore[attr-defined]
    assert shown.startswith(f"passages of room: none narrower than {report.widest:.2f} m") and "no." not in shown


# --- openings that stop a robot ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_failed_goal_names_the_opening_next_to_it_in_which_the_robot_cannot_turn() -> None:
    def advice(width: float, time_limit_s: float) -> tuple[str, ...]:
        room = two_rooms({0.0: width})
        ends: Any = {"start": Pose2D(0.0, -1.0, 1.57), "goals": (Pose2D(0.0, 1.5, 1.57),)}
        made = Scenario(map=room, configuration=long, time_limit_s=time_limit_s, **ends)
        result = run_scenario(made)
        assert result.recorder is not None
        return narrow_advice(result.recorder.record())

    outline = "[[0.1, 0.25], [0.1, -0.25], [-0.4, -0.25], [-0.4, 0.25]]"
    costmaps = ("global_costmap", "local_costmap")
    long = load_configuration(["turtlebot"], overrides=[f"{name}/footprint={outline}" for name in costmaps])
    (found,) = advice(0.8, 1.0)
    assert found.startswith("goal 1 ended next to the opening at (0.0")
    assert "which is 0.80 m wide: the robot is 0.50 m wide and needs 0.94 m to turn" in found
    assert advice(1.2, 1.0) == ()  # it can turn there
    assert advice(0.8, 60.0) == ()  # the goal is reached
