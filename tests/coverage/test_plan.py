"""Plans of coverage: they cover what can be reached, stay where the footprint fits, and are the same each time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import LETHAL, Costmap, Footprint, GridGeometry, Pose2D
from navstack.coverage import (
    CoverageDrive,
    CoverageParams,
    CoveragePlan,
    InvalidCoverageRequestError,
    InvalidModeError,
    NothingToCoverError,
    field_of_corners,
    figures_of,
    left_in,
    make_area,
    plan_coverage,
    read_params,
    roomy_start,
    visits_of,
)
from navstack.coverage.area import near
from navstack.coverage.tour import Choice, best_tour

RES = 0.05
ROBOT = Footprint.from_radius(0.2)


def room(width: float, height: float, blocks: Sequence[tuple[float, float, float, float]] = ()) -> Costmap:
    """A room of free space with walls at its border and rectangular blocks (x0, y0, x1, y1) (m)."""
    nx, ny = round(width / RES), round(height / RES)
    data = np.zeros((ny, nx), np.uint8)
    data[[0, -1]] = data[:, [0, -1]] = LETHAL
    for x0, y0, x1, y1 in blocks:
        data[round(y0 / RES) : round(y1 / RES), round(x0 / RES) : round(x1 / RES)] = LETHAL
    return Costmap(GridGeometry(nx, ny, RES), data)


def plan_of(costmap: Costmap, start: Pose2D | None = None, **values: object) -> CoveragePlan:
    params = read_params({"clearance": 0.0, **values})
    return plan_coverage(costmap, ROBOT, start or roomy_start(costmap, ROBOT), params)


def collisions(plan: CoveragePlan, costmap: Costmap, footprint: Footprint = ROBOT) -> float:
    """Area (m²) in which the footprint, turning anywhere on the way, overlaps obstacles: by shapely alone."""
    ys, xs = np.nonzero(costmap.data == LETHAL)
    g = costmap.geometry
    left, bottom = g.origin_x + xs * g.resolution, g.origin_y + ys * g.resolution
    squares = shapely.box(left, bottom, left + g.resolution, bottom + g.resolution)
    points, _ = plan.line()
    swept = shapely.LineString(points).buffer(footprint.circumscribed_radius, quad_segs=32)
    tree = shapely.STRtree(squares)
    hit = squares[tree.query(swept, predicate="intersects")]
    return float(shapely.area(shapely.intersection(hit, swept)).sum())


@pytest.mark.parametrize("angle", [None, 0.0, 0.7])
def test_an_empty_room_is_covered_in_straight_swaths(angle: float | None) -> None:
    costmap = room(6.0, 4.0)
    mode = {} if angle is None else {"mode": "SET_ANGLE", "best_angle": angle}
    plan = plan_of(costmap, swath_mode=mode)
    assert plan.figures.share >= 0.975
    assert plan.figures.overlap <= (0.12 if angle != 0.7 else 0.2)
    assert collisions(plan, costmap) == 0.0
    if angle is None:  # the fewest turns are along the long side
        assert min(plan.swath_angle, math.pi - plan.swath_angle) < 0.05
    else:
        assert plan.swath_angle == pytest.approx(angle)


def test_the_angle_of_fewest_turns_follows_the_room() -> None:
    tall = plan_of(room(3.0, 7.0))
    assert tall.swath_angle == pytest.approx(math.pi / 2.0, abs=0.05)


def test_segments_connect_and_only_passes_work() -> None:
    plan = plan_of(room(5.0, 5.0, [(2.0, 2.0, 3.0, 3.0)]))
    for before, after in zip(plan.segments[:-1], plan.segments[1:]):
        assert math.dist(before.points[-1], after.points[0]) < 1e-6
    for segment in plan.segments:
        assert segment.works == (segment.kind in ("headland", "swath"))
    assert {"headland", "swath", "turn"} <= {segment.kind for segment in plan.segments}


def test_a_plan_is_a_pure_function_of_its_input() -> None:
    costmap = room(5.0, 4.0, [(1.5, 1.0, 2.0, 3.0)])
    first, second = plan_of(costmap), plan_of(costmap)
    assert np.array_equal(first.line()[0], second.line()[0])
    assert np.array_equal(first.line()[1], second.line()[1])


def test_what_is_behind_a_narrow_gap_is_not_reached() -> None:
    costmap = room(6.0, 3.0, [(3.0, 0.0, 3.1, 1.35), (3.0, 1.65, 3.1, 3.0)])
    plan = plan_of(costmap, Pose2D(1.0, 1.0, 0.0))
    assert plan.line()[0][:, 0].max() < 3.0
    assert plan.area.wanted_m2 > 1.8 * plan.area.reachable_m2


def test_the_border_of_what_is_reachable_is_exact() -> None:
    blocked = np.zeros((21, 21), np.bool_)
    blocked[10, 10] = True
    radius = 4.3
    found = near(blocked, radius)
    square = shapely.box(9.5, 9.5, 10.5, 10.5)
    for iy in range(6, 15):
        for ix in range(6, 15):
            assert found[iy, ix] == (square.distance(shapely.Point(ix, iy)) < radius), (ix, iy)
    assert found[0].all(), "outside the grid is blocked"


def test_holes_of_a_polygon_are_never_entered() -> None:
    costmap = room(8.0, 6.0)
    hole = [(3.0, 2.0), (5.0, 2.0), (5.0, 4.0), (3.0, 4.0)]
    border = [(1.0, 1.0), (7.0, 1.0), (7.0, 5.0), (1.0, 5.0)]
    field = field_of_corners([border, hole])
    plan = plan_coverage(costmap, ROBOT, Pose2D(0.5, 0.5, 0.0), CoverageParams(clearance=0.0), polygon=field)
    body = shapely.LineString(plan.line()[0]).buffer(ROBOT.circumscribed_radius, quad_segs=32)
    assert not body.intersects(shapely.Polygon(hole))
    working = [shapely.LineString(s.points) for s in plan.segments if s.works]
    assert all(shapely.Polygon(border).contains(line.buffer(ROBOT.circumscribed_radius)) for line in working)
    assert plan.figures.share >= 0.97


def test_turns_of_a_base_with_a_turning_radius_are_curves() -> None:
    costmap = room(9.0, 7.0)
    for mode in ("DUBIN", "REEDS_SHEPP"):
        turns = {"mode": mode, "turn_point_distance": 0.05}
        plan = plan_of(costmap, min_turning_radius=0.3, path_mode=turns, headland_mode={"width": 1.1})
        curves = [segment for segment in plan.segments if segment.curved]
        assert len(curves) >= 8
        assert collisions(plan, costmap) == 0.0
        for curve in curves:
            steps = np.diff(curve.points, axis=0)
            headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
            bend = np.abs(np.diff(headings)) / 0.05
            assert np.median(bend) < 1.0 / 0.3 + 0.5, mode


def test_stages_can_be_left_out() -> None:
    costmap = room(6.0, 4.0)
    for values in ({"generate_path": False}, {"generate_route": False}):
        plan = plan_of(costmap, None, **values)
        assert all(segment.works for segment in plan.segments)
        with pytest.raises(InvalidModeError, match="needs generate_route and generate_path"):
            CoverageDrive(read_params(values))
    with pytest.raises(InvalidCoverageRequestError, match='frame_id is "odom", but the costmap is in "map"'):
        plan_of(costmap, frame_id="odom")


def test_rounds_without_headland_only_swaths() -> None:
    plan = plan_of(room(5.0, 4.0), generate_headland=False)
    assert "headland" not in {segment.kind for segment in plan.segments}


@pytest.mark.parametrize(
    ("mode", "order"),
    [
        ({"mode": "BOUSTROPHEDON"}, [0, 1, 2, 3, 4, 5]),
        ({"mode": "SNAKE"}, [0, 2, 4, 5, 3, 1]),
        ({"mode": "SPIRAL", "spiral_n": 4}, [0, 3, 1, 2, 4, 5]),
        ({"mode": "CUSTOM", "custom_order": [3, 1, 9, 3]}, [3, 1, 0, 2, 4, 5]),
    ],
)
def test_route_modes(mode: dict[str, object], order: list[int]) -> None:
    assert read_params({"route_mode": mode}).route_mode.order(6) == order


def test_visits_count_passes_not_samples() -> None:
    area = make_area(room(6.0, 4.0), ROBOT, Pose2D(1.0, 2.0, 0.0), 0.3)
    there = np.array([(1.0, 2.0), (4.0, 2.0)])
    once = visits_of(area, there, np.array([True, False]))
    assert once.max() == 1
    strip = 3.0 * 0.3 + math.pi * 0.15**2
    assert (once > 0).sum() * area.cell_area == pytest.approx(strip, rel=0.05)
    back = np.concatenate((there, there[:1]))
    twice = visits_of(area, back, np.array([True, True, False]))
    assert twice.max() == 2
    figures = figures_of(area, back, np.array([True, True, False]))
    assert 0.75 < figures.overlap < 1.0, "all but the end, at which the robot turns, is covered twice"
    assert figures.work_m == pytest.approx(6.0)
    off = visits_of(area, back, np.array([True, False, False]))
    assert np.array_equal(off, once)


def test_left_parts_have_a_place_and_a_reason() -> None:
    area = make_area(room(6.0, 4.0), ROBOT, Pose2D(1.0, 2.0, 0.0), 0.3)
    line = np.array([(1.0, 2.0), (4.0, 2.0)])
    planned = visits_of(area, line, np.array([True, False]))
    blocked = np.zeros(area.grid.shape, np.bool_)
    parts = left_in(area, np.zeros_like(planned), planned=planned, blocked=blocked)
    assert len(parts) == 1
    assert "repeat" in parts[0].reason
    assert sum(p.area_m2 for p in left_in(area, planned)) == pytest.approx(
        area.reachable_m2 - float((planned[area.reachable] > 0).sum()) * area.cell_area
    )
    part = np.zeros_like(planned)
    part[~area.reachable] = 1
    window = area.reachable.copy()
    window[:, : area.grid.nx // 2] = False
    part[window] = 1
    blocked[area.reachable] = True
    assert "obstacle" in left_in(area, part, planned=planned, blocked=blocked)[0].reason


def test_what_was_not_driven_yet_is_said() -> None:
    area = make_area(room(6.0, 4.0), ROBOT, Pose2D(1.0, 2.0, 0.0), 0.3)
    line = np.array([(1.0, 2.0), (4.0, 2.0)])
    ahead = visits_of(area, line, np.array([True, False]))
    other = np.where(ahead > 0, 0, 1).astype(np.int32)
    (part,) = left_in(area, other, planned=ahead, ahead=ahead)
    assert part.reason == "the drive ended before it came there"


def test_a_tour_of_points_on_a_line_is_driven_in_one_direction() -> None:
    at = np.array([0.0, 5.0, 2.0, 9.0, 7.0, 1.0])
    distances = np.abs(at[:, None] - at[None, :])
    units = [[Choice(k, k)] for k in range(1, 6)]
    order = [unit for unit, _ in best_tour(units, distances, 0)]
    assert at[1:][order].tolist() == [1.0, 2.0, 5.0, 7.0, 9.0]


def test_the_best_choice_of_each_unit_is_taken() -> None:
    at = np.array([0.0, 1.0, 4.0])
    distances = np.abs(at[:, None] - at[None, :])
    units = [[Choice(2, 1), Choice(1, 2)]]
    assert best_tour(units, distances, 0) == [(0, 1)]
    assert best_tour([], distances, 0) == []


def test_what_fits_nowhere_is_said() -> None:
    costmap = room(1.0, 1.0, [(0.4, 0.0, 0.6, 1.0)])
    with pytest.raises(NothingToCoverError, match="fits nowhere on this map; check robot_radius"):
        plan_coverage(costmap, ROBOT, Pose2D(0.2, 0.2, 0.0), CoverageParams())
    big = room(4.0, 4.0)
    with pytest.raises(InvalidCoverageRequestError, match=r"operation_width is 9 m, wider than the free space, 3\."):
        plan_of(big, operation_width=9.0)
    with pytest.raises(InvalidCoverageRequestError, match=r"the start \(9.00, 1.00\) is .* begin at"):
        plan_of(big, Pose2D(9.0, 1.0, 0.0))
    tiny = field_of_corners([[(1.0, 1.0), (1.3, 1.0), (1.3, 1.3)]])
    with pytest.raises(NothingToCoverError, match=r"inside the polygon, .*; enlarge the polygon"):
        plan_coverage(big, ROBOT, Pose2D(2.0, 2.0, 0.0), CoverageParams(), polygon=tiny)
    away = field_of_corners([[(10.0, 10.0), (13.0, 10.0), (13.0, 13.0)]])
    with pytest.raises(InvalidCoverageRequestError, match=r"the polygon \(x 10.00 to 13.00.* is outside the map"):
        plan_coverage(big, ROBOT, Pose2D(2.0, 2.0, 0.0), CoverageParams(), polygon=away)


BLOCK = st.tuples(st.floats(0.0, 6.0), st.floats(0.0, 5.0), st.floats(0.1, 2.5), st.floats(0.1, 2.0)).map(
    lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3])
)


@pytest.mark.slow
@settings(max_examples=40)
@given(blocks=st.lists(BLOCK, max_size=5), width=st.floats(0.2, 0.4), angle=st.sampled_from([None, 0.0, 0.4, 1.2]))
def test_random_rooms_are_covered_without_a_touch(
    blocks: list[tuple[float, float, float, float]], width: float, angle: float | None
) -> None:
    costmap = room(7.0, 6.0, blocks)
    try:
        start = roomy_start(costmap, ROBOT)
    except NothingToCoverError:
        return
    mode = {} if angle is None else {"mode": "SET_ANGLE", "best_angle": angle}
    plan = plan_of(costmap, start, operation_width=width, swath_mode=mode)
    assert collisions(plan, costmap) == 0.0
    assert plan.figures.share >= 0.95
    again = plan_of(costmap, start, operation_width=width, swath_mode=mode)
    assert np.array_equal(plan.line()[0], again.line()[0])
