"""Actions, zones and sources of the collision monitor, in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, InputError, LaserScan, PointCloud, RangeReading, Transform2D, Twist2D
from navstack.parameters import ExclusionZoneParams, MonitorSourceParams, SubPolygonParams
from navstack.safety import PolygonObservation, Shape
from tests.safety.rig import frames_at, monitor, scan_of, square, zone

FORWARD = Twist2D(0.5)
AHEAD = (0.3, 0.0)


def check(zones: dict[str, Any], command: Twist2D, *points: tuple[float, float], **values: Any) -> Twist2D:
    m = monitor(zones, **values)
    m.observe(scan_of(*points))
    return m.process(command, 0.0).command


STOP = zone(action_type="stop", points=square(0.4))
SLOW = zone(action_type="slowdown", slowdown_ratio=0.3, points=square(0.4))
LIMIT = zone(action_type="limit", linear_limit=0.4, angular_limit=0.5, points=square(0.4))


@pytest.mark.parametrize(
    ("zones", "command", "wanted", "action"),
    [
        ({"s": STOP}, Twist2D(0.5), (0.0, 0.0, 0.0), "stop"),
        ({"s": SLOW}, Twist2D(1.0, 0.0, 0.2), (0.3, 0.0, 0.06), "slowdown"),
        ({"s": LIMIT}, Twist2D(1.0), (0.4, 0.0, 0.0), "limit"),
        ({"s": LIMIT}, Twist2D(0.3), (0.3, 0.0, 0.0), "none"),
        ({"s": LIMIT}, Twist2D(0.0, 0.0, 1.0), (0.0, 0.0, 0.5), "limit"),
        ({"s": LIMIT}, Twist2D(0.2, 0.0, -1.0), (0.1, 0.0, -0.5), "limit"),  # the curvature is kept
        # the strictest one wins, in any order; nothing multiplies
        ({"a": SLOW, "b": LIMIT}, Twist2D(1.0), (0.3, 0.0, 0.0), "slowdown"),
        ({"a": SLOW, "b": LIMIT}, Twist2D(2.0), (0.4, 0.0, 0.0), "limit"),
        ({"a": LIMIT, "b": SLOW}, Twist2D(2.0), (0.4, 0.0, 0.0), "limit"),
        ({"a": SLOW, "b": STOP}, Twist2D(1.0), (0.0, 0.0, 0.0), "stop"),
        ({"a": STOP, "b": SLOW}, Twist2D(1.0), (0.0, 0.0, 0.0), "stop"),
        ({"a": SLOW, "b": SLOW}, Twist2D(1.0), (0.3, 0.0, 0.0), "slowdown"),
        ({"a": STOP}, Twist2D(), (0.0, 0.0, 0.0), "none"),
    ],
)
def test_actions(zones: dict[str, Any], command: Twist2D, wanted: tuple[float, ...], action: str) -> None:
    m = monitor(zones)
    m.observe(scan_of(AHEAD))
    decision = m.process(command, 0.0)
    assert decision.command == pytest.approx(wanted)
    assert decision.action == action
    assert (decision.reason != "") == (action != "none")
    # without an obstacle nothing changes
    assert check(zones, command) == command


def test_limit_of_the_reference() -> None:
    both = zone(action_type="limit", linear_limit=0.5, angular_limit=0.5, points=square(0.4))
    assert check({"s": both}, Twist2D(1.0, 0.0, 0.8), AHEAD) == pytest.approx((0.5, 0.0, 0.4))


# --- stop zones let the robot leave -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "passes"),
    [
        (Twist2D(0.2), False),
        (Twist2D(-0.2), True),  # back off
        (Twist2D(0.0, 0.0, 1.0), False),  # the corner of the rectangle would come nearer
        (Twist2D(0.2, 0.0, 1.0), False),
        (Twist2D(0.0, 0.2), True),  # sideways, along the obstacle
    ],
)
def test_a_stop_zone_lets_the_robot_back_off(command: Twist2D, passes: bool) -> None:
    points = [(0.35, 0.1), (0.35, -0.1)]
    assert (check({"s": STOP}, command, *points) == command) == passes
    strict = zone(action_type="stop", points=square(0.4), allow_moving_away=False)
    assert check({"s": strict}, command, *points) == Twist2D()
    assert check({"s": STOP}, command, *points, nav2_compatible=True) == Twist2D()


def test_a_stop_zone_lets_the_robot_turn_away() -> None:
    # an obstacle next to the left front corner: turning right moves the corner away from it
    assert check({"s": STOP}, Twist2D(0.0, 0.0, 1.0), (0.19, 0.25)) == Twist2D()
    assert check({"s": STOP}, Twist2D(0.0, 0.0, -1.0), (0.19, 0.25)) == Twist2D(0.0, 0.0, -1.0)


def test_obstacles_on_both_sides_hold_the_robot() -> None:
    for command in (Twist2D(0.2), Twist2D(-0.2)):
        assert check({"s": STOP}, command, (0.3, 0.0), (-0.3, 0.0)) == Twist2D()


# --- approach ---------------------------------------------------------------------------------------------------------


def approach(**values: Any) -> dict[str, Any]:
    return {"a": zone(action_type="approach", **{"time_before_collision": 1.2, **values})}


@pytest.mark.parametrize(
    ("gap", "exact", "nav2"),
    [
        (0.01, 0.5 * 0.02 / 1.2, 0.0),
        (0.06, 0.5 * 0.12 / 1.2, 0.0417),
        (0.11, 0.5 * 0.22 / 1.2, 0.0833),
        (0.25, 0.5 * 0.50 / 1.2, 0.2083),
        (0.50, 0.5 * 1.00 / 1.2, 0.4167),
        (0.66, 0.5, 0.5),
    ],
)
def test_straight_approach(gap: float, exact: float, nav2: float) -> None:
    point = (0.2 + gap, 0.0)
    assert check(approach(), FORWARD, point).vx == pytest.approx(exact, abs=1e-6)
    # a little farther, because the rounding of a float32 range decides about a step
    further = (point[0] + 1e-5, 0.0)
    assert check(approach(), FORWARD, further, nav2_compatible=True).vx == pytest.approx(nav2, abs=1e-4)


def test_repeated_approach_never_touches() -> None:
    gap = 0.6
    for k in range(60):
        m = monitor(approach())
        m.observe(scan_of((0.2 + gap, 0.0)))
        gap -= 0.05 * m.process(FORWARD, 0.0).command.vx
        # discrete form of g0 exp(-t / T)
        assert gap == pytest.approx(0.6 * (1.0 - 0.05 / 1.2) ** (k + 1), rel=1e-4)
    assert gap > 0.0


def test_a_circle_that_turns_never_collides() -> None:
    circle = {"c": zone(type="circle", radius=0.3, action_type="approach")}
    assert check(circle, Twist2D(0.0, 0.0, 2.0), (0.31, 0.0)) == Twist2D(0.0, 0.0, 2.0)


def test_a_corner_that_turns_reaches_a_point_after_the_angle() -> None:
    r, corner = math.hypot(0.2, 0.15), math.atan2(0.15, 0.2)
    ahead = 0.5
    point = (r * 0.99999 * math.cos(corner + ahead), r * 0.99999 * math.sin(corner + ahead))
    m = monitor(approach(time_before_collision=2.0))
    m.observe(scan_of(point))
    decision = m.process(Twist2D(0.0, 0.0, 1.0), 0.0)
    assert decision.time_to_contact == pytest.approx(ahead, abs=0.01)
    assert decision.command.wz == pytest.approx(ahead / 2.0, abs=0.005)


def test_an_arc_reaches_a_point_after_its_length() -> None:
    v, w, length = 0.5, 0.8, 0.7
    radius, turn = v / w, 0.7 * 0.8 / 0.5
    point = (radius * math.sin(turn), radius * (1.0 - math.cos(turn)))
    tiny = zone(type="circle", radius=0.01, action_type="approach", time_before_collision=3.0)
    m = monitor({"c": tiny})
    m.observe(scan_of(point))
    assert m.process(Twist2D(v, 0.0, w), 0.0).time_to_contact == pytest.approx((length - 0.01) / v, abs=0.002)


def test_points_inside_the_footprint_do_not_prevent_leaving() -> None:
    inside = (0.19, 0.0)
    assert check(approach(), FORWARD, inside) == Twist2D()
    assert check(approach(), Twist2D(-0.3), inside) == Twist2D(-0.3)
    assert check(approach(), Twist2D(-0.3), inside, nav2_compatible=True) == Twist2D()


def test_a_robot_that_cannot_brake_in_time_is_slowed_down_earlier() -> None:
    # 1 m/s, 0.5 m/s²: 0.1 s of reaction, 0.05 s to the next check, 1.0 m of braking
    fast = {"a": zone(action_type="approach", time_before_collision=0.2)}
    point = (0.2 + 1.0, 0.0)
    assert check(fast, Twist2D(1.0), point) == Twist2D(1.0)
    m = monitor(fast, max_decel=[-0.5, -0.5, -1.0])
    m.observe(scan_of(point))
    decision = m.process(Twist2D(1.0), 0.0, Twist2D(1.0))
    assert decision.action == "approach"
    assert decision.command.vx < 1.0
    assert "brake" in decision.reason
    free = (0.2 + 1.0 + 0.15 + 0.02, 0.0)  # and half of a simulated step
    m.observe(scan_of(free, stamp=0.1))
    assert m.process(Twist2D(1.0), 0.0, Twist2D(1.0)).action == "none"


@pytest.mark.parametrize("action", ["approach", "stop"])
def test_points_in_the_margin_of_a_zone_are_not_touched_while_the_robot_brakes(action: str) -> None:
    """Commands that move away from a point pass only if the robot does not touch it while it still drives towards it."""
    margin = "[[0.26, 0.21], [-0.26, 0.21], [-0.26, -0.21], [0.26, -0.21]]"
    back, turning = Twist2D(-0.3), Twist2D(-0.3, 0.0, -2.0)  # the left front corner swings forward at 0.2 m/s
    for command, velocity, passes in (
        (back, Twist2D(), True),
        (turning, Twist2D(), True),
        (back, Twist2D(0.2), True),  # brakes as hard as a stop: 3 of 5 cm
        (turning, Twist2D(0.2), False),
        (back, Twist2D(0.4), False),  # 10 cm
    ):
        limits: dict[str, Any] = {"max_decel": [-1.0, -1.0, -20.0], "reaction_time": 0.05, "check_frequency": 5.0}
        m = monitor({"z": zone(action_type=action, points=margin)}, **limits)
        m.observe(scan_of((0.25, 0.1)))
        sent = m.process(command, 0.0, velocity).command
        assert (sent == command) == passes, (command, velocity)
        if velocity.vx == 0.4:
            assert sent == Twist2D()


def test_min_points() -> None:
    three = zone(action_type="stop", points=square(0.4), min_points=3)
    assert check({"s": three}, FORWARD, (0.3, 0.0), (0.3, 0.1)) == FORWARD
    assert check({"s": three}, FORWARD, (0.3, 0.0), (0.3, 0.1), (0.3, -0.1)) == Twist2D()
    former = zone(action_type="stop", points=square(0.4), min_points=None, max_points=2)
    assert former.least_points == 3
    assert zone(action_type="stop", points=square(0.4), min_points=None).least_points == 4


def test_debounce() -> None:
    z = zone(action_type="stop", points=square(0.4), trigger_consecutive_points=3, release_consecutive_points=2)
    m = monitor({"s": z})
    stopped: list[bool] = []
    for k, hit in enumerate((1, 1, 0, 1, 1, 1, 0, 0)):
        m.observe(scan_of(*([AHEAD] if hit else []), stamp=0.01 * k))
        stopped.append(m.process(FORWARD, 0.01 * k).command == Twist2D())
    assert stopped == [False, False, False, False, False, True, True, False]


def test_switched_off_passes_everything() -> None:
    m = monitor({"s": STOP}, enabled=False)
    assert m.process(FORWARD, 0.0).command == FORWARD  # without any data
    assert check({"s": zone(action_type="stop", points=square(0.4), enabled=False)}, FORWARD, AHEAD) == FORWARD


def test_zeros_are_sent_for_a_while_only() -> None:
    m = monitor({"s": STOP}, source_timeout=0.0, stop_pub_timeout=1.0)
    sent = [m.process(Twist2D(), 0.25 * k).is_sent for k in range(8)]
    assert sent == [True] * 5 + [False] * 3
    assert m.process(FORWARD, 2.0).is_sent
    assert m.process(Twist2D(), 2.1).is_sent


def test_a_command_that_is_not_finite() -> None:
    with pytest.raises(InputError, match="not finite"):
        monitor({"s": STOP}).process(Twist2D(math.nan), 0.0)


def test_velocity_polygon() -> None:
    subs = {
        "slow": SubPolygonParams(points=square(0.25), linear_min=0.0, linear_max=0.3, theta_min=-1.0, theta_max=1.0),
        "fast": SubPolygonParams(points=square(0.5), linear_min=0.3, linear_max=1.0, theta_min=-1.0, theta_max=1.0),
    }
    z = zone(type="velocity_polygon", action_type="stop", velocity_polygons=list(subs), sub_polygons=subs)
    m = monitor({"v": z})
    m.observe(scan_of((0.4, 0.0)))
    assert m.process(Twist2D(0.2), 0.0).command == Twist2D(0.2)
    assert m.process(Twist2D(0.5), 0.0).command == Twist2D()
    assert m.process(Twist2D(1.5), 0.0).command == Twist2D()  # none fits: the previous one stays
    # none has ever fitted: the largest; Nav2 has no protection then
    first = monitor({"v": z})
    first.observe(scan_of((0.4, 0.0)))
    assert first.process(Twist2D(1.5), 0.0).command == Twist2D()
    nav2 = monitor({"v": z}, nav2_compatible=True)
    nav2.observe(scan_of((0.4, 0.0)))
    assert nav2.process(Twist2D(1.5), 0.0).command == Twist2D(1.5)


def test_velocity_polygon_of_a_holonomic_robot() -> None:
    left = SubPolygonParams(
        points="[[0.1, 0.1], [0.1, 0.6], [-0.1, 0.6], [-0.1, 0.1]]",
        linear_max=1.0,
        direction_start_angle=0.5,
        direction_end_angle=2.5,
    )
    back = SubPolygonParams(points=square(0.2), linear_max=1.0, direction_start_angle=2.5, direction_end_angle=-2.5)
    z = zone(
        type="velocity_polygon",
        action_type="stop",
        holonomic=True,
        velocity_polygons=["left", "back"],
        sub_polygons={"left": left, "back": back},
    )
    m = monitor({"v": z})
    m.observe(scan_of((0.0, 0.5)))
    assert m.process(Twist2D(0.0, 0.3), 0.0).command == Twist2D()
    assert m.process(Twist2D(-0.3), 0.0).command == Twist2D(-0.3)


def test_a_zone_without_a_shape_stops_until_it_gets_one() -> None:
    z = zone(action_type="stop", points=None, polygon_sub_topic="zone")
    m = monitor({"s": z})
    m.observe(scan_of((1.0, 0.0)))
    decision = m.process(FORWARD, 0.0)
    assert decision.command == Twist2D()
    assert "no shape" in decision.reason
    m.set_shape("s", Shape(np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])))
    assert m.process(FORWARD, 0.0).command == FORWARD
    with pytest.raises(InputError, match='no zone "t"'):
        m.set_shape("t", Shape(radius=1.0))


# --- sources ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("timeout", "now", "passes"),
    [(1.0, 1.0, True), (1.0, 1.01, False), (0.0, 100.0, True)],
)
def test_stale_data_stop_the_robot(timeout: float, now: float, passes: bool) -> None:
    m = monitor(
        {"s": STOP},
        {"scan": MonitorSourceParams(source_timeout=timeout)},
        base_shift_correction=False,
        source_timeout=9.0,
    )
    m.observe(scan_of((1.0, 0.0)))
    decision = m.process(FORWARD, now)
    assert (decision.command == FORWARD) == passes
    if not passes:
        assert decision.zone == "invalid source"
        assert "1.01 s old (source_timeout 1 s)" in decision.reason


def test_no_data_yet_stops_the_robot() -> None:
    decision = monitor({"s": STOP}).process(FORWARD, 0.0)
    assert decision.command == Twist2D()
    assert "no data on scan yet" in decision.reason
    assert monitor({"s": STOP}, source_timeout=0.0).process(FORWARD, 0.0).command == FORWARD


@pytest.mark.parametrize(
    ("ranges", "share", "zone"),
    [
        ([-math.inf] * 20, 0.1, "too near"),  # REP 117: something covers the sensor, or is close to it
        ([0.001] * 20, 0.1, "too near"),  # below range_min
        ([-math.inf] * 19 + [5.0], 0.1, "too near"),
        ([-math.inf] + [5.0] * 19, 1.0, "too near"),
        ([math.nan] * 20, 0.1, "invalid source"),
        ([], 0.1, "invalid source"),
        ([math.nan] * 19 + [5.0], 0.1, "invalid source"),
        ([math.nan] * 19 + [-math.inf], 0.1, "invalid source"),
        ([math.nan] * 18 + [-math.inf, 5.0], 1.0, "invalid source"),
        ([-math.inf] * 18 + [5.0] * 2, 0.1, ""),
        ([math.inf] * 20, 0.1, ""),  # REP 117: nothing is there
        ([50.0] * 20, 0.1, ""),  # beyond range_max
        ([-math.inf] * 20, 0.0, ""),
        ([math.nan] * 20, 0.0, ""),
    ],
)
def test_a_scan_without_valid_beams_is_not_a_free_one(ranges: list[float], share: float, zone: str) -> None:
    m = monitor({"s": STOP}, {"scan": MonitorSourceParams(min_valid_share=share)})
    m.observe(LaserScan(np.array(ranges, np.float32), 0.0, 0.1, 0.05, 30.0, 0.0, "laser", "scan"))
    decision = m.process(FORWARD, 0.0)
    assert decision.zone == zone
    assert decision.command == (Twist2D() if zone else FORWARD)
    if zone == "too near":
        near = sum(value < 0.05 for value in ranges)
        assert f"{near} of {len(ranges)} beams of scan hit something nearer than range_min (0.05 m)" in decision.reason
    elif zone:
        valid = sum(value >= 0.05 for value in ranges)
        assert f"{valid} of {len(ranges)} beams of scan are valid (min_valid_share {share:g})" in decision.reason
    # the next good scan ends it
    m.observe(scan_of((1.0, 0.0), stamp=0.1))
    assert m.process(FORWARD, 0.1).command == FORWARD


def test_without_a_timeout_a_covered_scan_does_not_stop_the_robot() -> None:
    m = monitor({"s": STOP}, {"scan": MonitorSourceParams(source_timeout=0.0)})
    m.observe(LaserScan(np.full(20, np.nan, np.float32), 0.0, 0.1, 0.05, 30.0, 0.0, "laser", "scan"))
    assert m.process(FORWARD, 0.0).command == FORWARD


def test_only_sources_of_a_zone_count() -> None:
    sources = {"scan": MonitorSourceParams(), "other": MonitorSourceParams(topic="other")}
    mine = zone(action_type="stop", points=square(0.4), sources_names=["scan"])
    m = monitor({"s": mine}, sources)
    m.observe(scan_of((1.0, 0.0)))
    assert m.process(FORWARD, 0.0).command == FORWARD  # "other" has never spoken
    nav2 = monitor({"s": mine}, sources, nav2_compatible=True)
    nav2.observe(scan_of((1.0, 0.0)))
    assert nav2.process(FORWARD, 0.0).command == Twist2D()
    theirs = monitor({"s": zone(action_type="stop", points=square(0.4), sources_names=["other"])}, sources)
    theirs.observe(scan_of(AHEAD))
    assert theirs.process(FORWARD, 0.0).zone == "invalid source"


def test_an_unknown_transform_stops_the_robot() -> None:
    m = monitor({"s": STOP}, frames=frames_at(stamp=5.0))
    m.observe(scan_of((1.0, 0.0), stamp=1.0))
    decision = m.process(FORWARD, 5.0)
    assert decision.zone == "invalid source"


def test_points_are_moved_by_the_motion_of_the_robot() -> None:
    frames = frames_at()
    frames.set("odom", "base", Transform2D(0.4, 0.0, 0.0), 1.0)
    for corrected, stops in ((True, True), (False, False)):
        m = monitor({"s": STOP}, frames=frames, base_shift_correction=corrected)
        m.observe(scan_of((0.7, 0.0), stamp=0.0))
        assert (m.process(FORWARD, 1.0).command == Twist2D()) == stops


def test_cloud_heights_and_range() -> None:
    sources = {"cloud": MonitorSourceParams(type="pointcloud", topic="points", min_range=0.25)}
    for point, stops in (
        ((0.3, 0.0, 0.2), True),
        ((0.3, 0.0, 0.04), False),
        ((0.3, 0.0, 0.51), False),
        ((0.24, 0.0, 0.2), False),
        ((math.nan, 0.0, 0.2), False),
    ):
        m = monitor({"s": STOP}, sources)
        m.observe(PointCloud(np.array([point], np.float32), 0.0, "laser", "points"))
        assert (m.process(FORWARD, 0.0).command == Twist2D()) == stops, point


@pytest.mark.parametrize(
    ("reading", "command", "reason"),
    [
        (0.3, Twist2D(), "stop"),
        (2.0, FORWARD, ""),  # beyond the range: nothing is there
        (math.inf, FORWARD, ""),
        (0.01, Twist2D(), "stop"),  # below the range: at the lowest range
        (math.nan, Twist2D(), "no data"),
    ],
)
def test_range_readings(reading: float, command: Twist2D, reason: str) -> None:
    m = monitor({"s": STOP}, {"sonar": MonitorSourceParams(type="range", topic="sonar")})
    m.observe(RangeReading(reading, 0.5, 0.02, 2.0, 0.0, "laser", "sonar"))
    decision = m.process(FORWARD, 0.0)
    assert decision.command == command
    assert reason in decision.reason


def test_range_arc_has_both_ends() -> None:
    m = monitor({"s": STOP}, {"sonar": MonitorSourceParams(type="range", topic="sonar", obstacles_angle=0.2)})
    m.observe(RangeReading(0.5, 0.5, 0.02, 2.0, 0.0, "laser", "sonar"))
    m.process(FORWARD, 0.0)
    points = m.field.points(("sonar",))
    assert len(points) == 4
    np.testing.assert_allclose(np.arctan2(points[:, 1], points[:, 0]), [-0.25, -0.05, 0.15, 0.25])


def test_polygons() -> None:
    sources = {"people": MonitorSourceParams(type="polygon", topic="polygons", source_timeout=1.0)}
    m = monitor({"s": STOP}, sources, base_shift_correction=False)
    assert m.process(FORWARD, 0.0).command == FORWARD  # no polygon is no obstacle
    far = PolygonObservation("a", np.array([[2.0, 0.0], [3.0, 0.0], [3.0, 1.0]]), 0.0, "base")
    around = PolygonObservation("b", np.array([[5.0, 5.0], [-5.0, 5.0], [-5.0, -5.0], [5.0, -5.0]]), 0.5, "base")
    m.observe(far)
    assert m.process(FORWARD, 0.5).command == FORWARD
    m.observe(around)  # the zone is wholly inside
    assert m.process(FORWARD, 0.5).command == Twist2D()
    assert m.process(FORWARD, 1.6).command == FORWARD  # both are stale, so nothing is there
    m.observe(PolygonObservation("c", np.array([[0.0, 0.0], [1.0, math.nan], [1.0, 1.0]]), 2.0, "base"))
    assert m.process(FORWARD, 2.0).command == FORWARD


@pytest.mark.parametrize(
    ("cost", "unknown", "stops"), [(254, True, True), (252, True, False), (255, True, True), (255, False, False)]
)
def test_costmap_cells(cost: int, unknown: bool, stops: bool) -> None:
    source = MonitorSourceParams(type="costmap", topic="local_costmap/costmap", treat_unknown_as_obstacle=unknown)
    m = monitor({"s": STOP}, {"cells": source})
    costmap = Costmap(GridGeometry(40, 40, 0.05, -1.0, -1.0), np.zeros((40, 40), np.uint8), "odom")
    costmap.data[20, 26] = cost  # its center is at (0.325, 0.025)
    m.field.observe_costmap("local_costmap", costmap, 0.0)
    assert (m.process(FORWARD, 0.0).command == Twist2D()) == stops


def test_exclusion_zones() -> None:
    area = ExclusionZoneParams(points="[[0.25, -0.1], [0.35, -0.1], [0.35, 0.1], [0.25, 0.1]]", enabled=True)
    circle = ExclusionZoneParams(type="circle", radius=0.31, enabled=True, frame_id="laser")
    for excluded, point, stops in (
        (area, (0.3, 0.0), False),
        (area, (0.38, 0.0), True),
        (circle, (0.3, 0.0), False),
        (circle, (0.35, 0.0), True),
        (area.model_copy(update={"enabled": False}), (0.3, 0.0), True),
        (area.model_copy(update={"frame_id": "nowhere"}), (0.3, 0.0), True),
    ):
        m = monitor({"s": STOP}, {"scan": MonitorSourceParams(exclusion_zones=["e"], exclusions={"e": excluded})})
        m.observe(scan_of(point))
        assert (m.process(FORWARD, 0.0).command == Twist2D()) == stops


def test_messages_of_other_topics_and_types_are_ignored() -> None:
    m = monitor({"s": STOP})
    m.observe(RangeReading(0.3, 0.5, 0.02, 2.0, 0.0, "laser", "scan"))
    m.observe(scan_of(AHEAD, stamp=math.nan))
    assert "no data" in m.process(FORWARD, 0.0).reason
