"""Sensor data that arrives but cannot be transformed: the robot must not drive on it, and must say so."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import (
    Event,
    FrameTree,
    GridGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    RangeReading,
    SensorData,
    Transform2D,
)
from navstack.costmap import LayeredCostmap, RangeSensorLayer, RangeSensorLayerParams
from navstack.move_base import GoalHandle, GoalStatus
from navstack.parameters import load_configuration
from navstack.plugins import Plugin
from navstack.sim import World
from tests.costmap.build import cloud, cloud_source, frames_at, obstacle, rolling, scan, scan_source

BOX = (3.0, 0.0, 0.3)
"""An obstacle that the map does not show (x, y, radius; m), between start and goal."""
RATES = tuple(
    f"{costmap}/obstacle_layer/scan/expected_update_rate=0.5" for costmap in ("global_costmap", "local_costmap")
)


def empty_map() -> OccupancyGrid:
    return OccupancyGrid(np.zeros((120, 160), np.int8), GridGeometry(160, 120, 0.05, -1.0, -3.0))


class Corridor:
    """The packaged turtlebot before a box that only its lidar sees; `bend` changes each message."""

    def __init__(self, bend: Callable[[LaserScan], LaserScan], *overrides: str) -> None:
        configuration = load_configuration(["turtlebot"], overrides=overrides)
        grid = empty_map()
        self.robot = simulated_robot(configuration, World(grid, [BOX]), Pose2D(0.0, 0.0, 0.0))
        scans = self.robot.scans

        def bent() -> Sequence[SensorData]:
            return [bend(s) if isinstance(s, LaserScan) else s for s in scans()]

        self.robot.scans = bent  # type: ignore[method-assign]
        self.events: list[Event] = []
        self.move_base = build_move_base(configuration, self.robot, static_map=grid, listeners=[self])

    def on_event(self, event: Event) -> None:
        self.events.append(event)

    def drive(self, limit_s: float = 60.0) -> GoalHandle:
        handle = self.move_base.send_goal(Pose2D(5.0, 0.0, 0.0))
        while not handle.is_done and self.robot.time < limit_s:
            self.robot.advance_to(self.move_base.next_due(self.robot.time))
            self.move_base.tick(self.robot.time)
        return handle

    def warnings(self, costmap: str = "local_costmap") -> list[Event]:
        return [e for e in self.events if e.kind == "warning" and e.text.startswith(costmap) and "topic" in e.data]


def unknown_frame(s: LaserScan) -> LaserScan:
    return replace(s, frame="lost_laser")


def old_stamp(s: LaserScan) -> LaserScan:
    return replace(s, stamp=s.stamp - 1000.0)


def new_stamp(s: LaserScan) -> LaserScan:
    return replace(s, stamp=s.stamp + 1000.0)


@pytest.mark.parametrize("bend", [unknown_frame, old_stamp, new_stamp])
def test_with_an_expected_update_rate_the_robot_stops_within_it(bend: Callable[[LaserScan], LaserScan]) -> None:
    corridor = Corridor(bend, *RATES)
    handle = corridor.drive()
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "SENSOR_DATA_STALE")
    assert not corridor.robot.collisions
    # from rest, the robot does not drive farther than half a second at its top speed
    assert corridor.robot.distance_travelled < 0.5
    assert bend(scan([1.0])).frame in handle.result.message


def all_at(value: float) -> Callable[[LaserScan], LaserScan]:
    return lambda s: replace(s, ranges=np.full(len(s.ranges), value, np.float32))


def without_beams(s: LaserScan) -> LaserScan:
    return replace(s, ranges=np.zeros(0, np.float32))


def covered(s: LaserScan) -> LaserScan:
    """Return a scan of which one beam in twenty is left."""
    ranges = np.full(len(s.ranges), np.nan, np.float32)
    ranges[::20] = 5.0
    return replace(s, ranges=ranges)


def impossible_range(s: LaserScan) -> LaserScan:
    return replace(s, range_max=0.0)


BLIND = {
    "zero": all_at(0.0),
    "negative": all_at(-1.0),
    "too near": all_at(-np.inf),
    "below range_min": all_at(0.01),
    "NaN": all_at(np.nan),
    "no beams": without_beams,
    "covered": covered,
    "range_max 0": impossible_range,
}


@pytest.mark.parametrize("bend", BLIND.values(), ids=list(BLIND))
def test_a_scan_that_shows_nothing_does_not_count(bend: Callable[[LaserScan], LaserScan]) -> None:
    corridor = Corridor(bend, *RATES)
    handle = corridor.drive()
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "SENSOR_DATA_STALE")
    assert not corridor.robot.collisions
    assert corridor.robot.distance_travelled < 0.5
    (warning, *_) = corridor.warnings()
    assert (warning.data["name"], warning.data["topic"]) == ("SENSOR_BLIND", "scan")
    assert 'of "scan" are valid' in warning.text
    assert 'of "scan" are valid' in handle.result.message


def test_a_scan_that_goes_blind_under_way_stops_the_robot_within_the_rate() -> None:
    corridor = Corridor(lambda s: all_at(0.0)(s) if s.stamp > 3.0 else s, *RATES)
    handle = corridor.drive()
    assert (handle.result.error_name, corridor.robot.collisions) == ("SENSOR_DATA_STALE", [])
    stopped = next(e.time for e in corridor.events if "Sensor data is out of date" in e.text)
    assert 3.0 < stopped < 3.7


@pytest.mark.parametrize("value", [np.inf, 70.0])
def test_an_open_field_is_no_blind_scan(value: float) -> None:
    corridor = Corridor(all_at(value), *RATES)
    handle = corridor.drive(4.0)
    assert handle.status is GoalStatus.ACTIVE
    assert corridor.robot.distance_travelled > 0.5
    assert not [e for e in corridor.events if e.kind == "warning"]


def test_without_a_rate_a_blind_scan_is_a_warning() -> None:
    corridor = Corridor(all_at(0.0))
    corridor.drive(3.0)
    assert corridor.robot.distance_travelled > 0.2
    assert "set expected_update_rate" in corridor.warnings()[0].text


def test_a_share_of_0_lets_every_message_count() -> None:
    shares = (rate.replace("expected_update_rate=0.5", "min_valid_share=0.0") for rate in RATES)
    corridor = Corridor(all_at(0.0), *RATES, *shares)
    corridor.drive(3.0)
    assert corridor.robot.distance_travelled > 0.2
    assert not corridor.warnings()


@pytest.mark.slow
@pytest.mark.parametrize("bend", [unknown_frame, old_stamp, new_stamp])
def test_without_one_it_warns_at_once_and_every_10_s(bend: Callable[[LaserScan], LaserScan]) -> None:
    corridor = Corridor(bend)
    corridor.drive(25.0)
    for costmap in ("local_costmap", "global_costmap"):
        times = [e.time for e in corridor.warnings(costmap)]
        assert times[0] < 1.5, "the first update with a scan warns"
        assert 2 <= len(times) <= 3
        assert all(10.0 - 1e-6 <= b - a < 11.1 for a, b in itertools.pairwise(times))
    data = corridor.warnings()[0].data
    assert data["name"] == "TF_ERROR"
    assert data["source"] in ("lost_laser", *corridor.robot.frames.frames())
    assert {"map", "odom"} <= set(data["known_frames"])
    assert all(frame in corridor.warnings()[0].text for frame in (data["source"], "map", "odom"))


def test_no_warning_while_the_sensors_are_used() -> None:
    corridor = Corridor(lambda s: s)
    handle = corridor.drive()
    assert handle.status is GoalStatus.SUCCEEDED
    assert not [e for e in corridor.events if e.kind == "warning"]


# --- layers -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("voxel", [False, True])
def test_a_scan_counts_once_it_can_be_transformed(voxel: bool) -> None:
    frames = frames_at()
    costmap = rolling(obstacle({"scan": scan_source(expected_update_rate=0.5)}, voxel=voxel), frames=frames)
    for k in range(11):
        now = 0.1 * k
        frames.set("odom", "base_link", Transform2D(), now)
        costmap.observe(scan([1.0] * 8, now, frame="late_laser"))
        if k % 5 == 0:
            costmap.update(now)
        assert costmap.is_current(now) is (now <= 0.5)
    (problem,) = costmap.problems()
    assert problem.data["source"] == "late_laser"
    assert problem.data["known_frames"] == ["base_link", "laser", "odom"]
    frames.set_static("base_link", "late_laser", Transform2D())
    # between two updates: the waiting scans can be transformed now
    assert costmap.is_current(1.1)
    costmap.update(1.1)
    assert not costmap.problems()


def test_waiting_messages_count_between_updates() -> None:
    frames = frames_at()
    costmap = rolling(obstacle({"scan": scan_source(expected_update_rate=0.3)}), frames=frames)
    for k in range(30):
        now = 0.1 * k
        frames.set("odom", "base_link", Transform2D(), now)
        costmap.observe(scan([1.0] * 8, now))
        if k % 10 == 0:
            costmap.update(now)
        assert costmap.is_current(now)


def test_each_source_is_reported_on_its_own() -> None:
    sources = {
        "scan": scan_source(),
        "points": cloud_source(),
        "aside": scan_source(sensor_frame="no_such_sensor"),
    }
    costmap = rolling(obstacle(sources))
    costmap.observe(scan([1.0] * 8))
    costmap.observe(scan([1.0] * 8, topic="aside"))
    costmap.update(0.0)
    (problem,) = costmap.problems()
    assert problem.data["topic"] == "aside"
    assert "no_such_sensor" in problem.message


def sonar_costmap(frames: FrameTree) -> LayeredCostmap:
    params = RangeSensorLayerParams(topics=["/sonar", "/infrared"], no_readings_timeout=0.5)
    return rolling(Plugin("range_sensor_layer", RangeSensorLayer, params), frames=frames)


def reading(stamp: float, frame: str, *, topic: str = "/sonar", range_m: float = 1.0) -> RangeReading:
    return RangeReading(
        range_m=range_m, min_range=0.1, max_range=3.0, field_of_view=0.5, frame=frame, stamp=stamp, topic=topic
    )


@pytest.mark.parametrize("range_m", [1.0, 5.0])
def test_range_readings_count_once_they_can_be_transformed(range_m: float) -> None:
    frames = frames_at()
    costmap = sonar_costmap(frames)
    for k in range(11):
        now = 0.1 * k
        frames.set("odom", "base_link", Transform2D(), now)
        costmap.observe(reading(now, "sonar_frame", range_m=range_m))
        costmap.update(now)
        assert costmap.is_current(now) is (now <= 0.5)
    (problem,) = costmap.problems()
    assert (problem.data["topic"], problem.data["source"]) == ("/sonar", "sonar_frame")
    costmap.observe(reading(1.0, "laser", topic="/infrared"))
    assert costmap.is_current(1.0)
    costmap.update(1.0)
    assert [p.data["topic"] for p in costmap.problems()] == ["/sonar"], "the other sonar is still blind"
    frames.set_static("base_link", "sonar_frame", Transform2D())
    costmap.update(1.1)
    assert not costmap.problems()


NAN3 = (np.nan, np.nan, np.nan)
NO_POINTS: list[tuple[float, float, float]] = []


@pytest.mark.parametrize("voxel", [False, True])
@pytest.mark.parametrize("clearing", [False, True])
@pytest.mark.parametrize(
    ("points", "blind"),
    [
        ([NAN3] * 20, True),
        ([NAN3] * 20 + [(1.0, 0.0, 0.5)], True),
        ([NAN3] * 5 + [(1.0, 0.0, 0.5)], False),
        ([(0.0, 0.0, 0.5)] * 20, True),
        ([(np.inf, 0.0, 0.5)] * 20, True),
        (NO_POINTS, None),  # a list of obstacles may be empty, the picture of a depth camera may not
    ],
)
def test_a_cloud_that_shows_nothing_does_not_count(
    points: list[tuple[float, float, float]], blind: bool | None, clearing: bool, voxel: bool
) -> None:
    frames = frames_at()
    source = cloud_source(expected_update_rate=0.5, clearing=clearing)
    costmap = rolling(obstacle({"points": source}, voxel=voxel), frames=frames)
    expected = clearing if blind is None else blind
    for k in range(11):
        now = 0.1 * k
        frames.set("odom", "base_link", Transform2D(), now)
        costmap.observe(cloud(points, now))
        if k % 5 == 0:
            costmap.update(now)
        assert costmap.is_current(now) is (now <= 0.5 or not expected)
    assert [p.name for p in costmap.problems()] == (["SENSOR_BLIND"] if expected else [])


def test_one_good_scan_in_three_is_enough() -> None:
    frames = frames_at()
    costmap = rolling(obstacle({"scan": scan_source(expected_update_rate=0.35)}), frames=frames)
    for k in range(30):
        now = 0.1 * k
        frames.set("odom", "base_link", Transform2D(), now)
        costmap.observe(scan([1.0 if k % 3 == 0 else 0.0] * 8, now))
        if k % 3 == 2:
            costmap.update(now)
        assert costmap.is_current(now)


@pytest.mark.parametrize(
    ("range_m", "blind"), [(0.0, True), (-1.0, True), (-np.inf, True), (0.05, True), (np.inf, False)]
)
def test_range_readings_below_the_range_do_not_count(range_m: float, blind: bool) -> None:
    frames = frames_at()
    costmap = sonar_costmap(frames)
    for k in range(11):
        now = 0.1 * k
        frames.set("odom", "base_link", Transform2D(), now)
        costmap.observe(reading(now, "laser", range_m=range_m))
        costmap.update(now)
        assert costmap.is_current(now) is (now <= 0.5 or not blind)
    assert [p.name for p in costmap.problems()] == (["SENSOR_BLIND"] if blind else [])


def test_a_sensor_of_detections_is_not_blind() -> None:
    frames = frames_at()
    costmap = sonar_costmap(frames)
    for k, range_m in enumerate([-np.inf, np.inf] * 6):
        now = 0.1 * k
        frames.set("odom", "base_link", Transform2D(), now)
        costmap.observe(replace(reading(now, "laser", range_m=range_m), min_range=1.0, max_range=1.0))
        costmap.update(now)
        assert costmap.is_current(now)
    assert not costmap.problems()
