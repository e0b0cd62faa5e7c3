"""Doors with timetables and polygons on tracks: poses, scans, collisions and clearances."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from navstack.core import Footprint, LaserScan, PointCloud, Pose2D, Twist2D
from navstack.sim import DoorMotion, LidarParams, OnTrack, PedestrianMotion, Shape, SimParams, SimulatedRobot, World
from navstack.sim.movers import Door

CIRCLE = Footprint.from_radius(0.18)
AHEAD = LidarParams(x=0.0, beams=1, range_min=0.0, range_max=20.0)


def polygon_at(shape: Shape, time: float) -> shapely.Polygon:
    return shapely.Polygon(World(None, shapes=[shape]).solids_at(time).polygon(0))


def test_a_hinged_door_turns_about_its_first_end() -> None:
    door = Shape(segment=[[1, 0], [2, 0]], thickness=0.1, motion=DoorMotion(open=[[5, 20]], moving_time=4.0))
    closed = shapely.box(1, -0.05, 2, 0.05)
    assert polygon_at(door, 0.0).symmetric_difference(closed).area == pytest.approx(0.0, abs=1e-12)
    half = polygon_at(door, 7.0)  # 45 degrees
    assert half.distance(shapely.Point(1 + math.sqrt(0.5), math.sqrt(0.5))) < 1e-9
    open_ = polygon_at(door, 9.0)
    assert open_.symmetric_difference(shapely.box(0.95, 0, 1.05, 1)).area == pytest.approx(0.0, abs=1e-9)
    assert polygon_at(door, 22.0).symmetric_difference(half).area == pytest.approx(0.0, abs=1e-9)
    assert polygon_at(door, 24.0).equals(polygon_at(door, 0.0))


def test_a_sliding_door_moves_beyond_its_first_end() -> None:
    door = Shape(segment=[[1, 0], [2, 0]], motion=DoorMotion(style="sliding", open=[[0, 10]], moving_time=1.0))
    assert polygon_at(door, 0.25).bounds == pytest.approx((0.75, -0.025, 1.75, 0.025))
    assert polygon_at(door, 3.0).bounds == pytest.approx((0.0, -0.025, 1.0, 0.025))
    aside = Shape(
        box=[1.0, 0.1], pose=[5, 5, 0], motion=DoorMotion(style="sliding", slide=[0, 2], open=[[0, 9]], moving_time=0.0)
    )
    assert polygon_at(aside, 1.0).bounds == pytest.approx((4.5, 6.95, 5.5, 7.05))


def test_a_timetable_repeats() -> None:
    door = Door(
        Shape(segment=[[0, 0], [1, 0]], motion=DoorMotion(open=[[1, 4], [6, 9.5]], period=10.0, moving_time=1.0))
    )
    for base in (10.0, 30.0, 1000.0):
        openness = [door.openness(base + t) for t in (1.0, 1.5, 3.0, 4.5, 5.5, 7.0, 9.75, 10.25, 10.75)]
        assert openness == pytest.approx([0.0, 0.5, 1.0, 0.5, 0.0, 1.0, 0.75, 0.25, 0.0])
    once = Door(Shape(segment=[[0, 0], [1, 0]], motion=DoorMotion(open=[[1, 4]], moving_time=1.0)))
    assert once.openness(100.0) == once.openness(0.5) == 0.0


def test_a_door_that_closes_before_it_is_open_reverses() -> None:
    door = Door(Shape(segment=[[0, 0], [1, 0]], motion=DoorMotion(open=[[1, 2]], moving_time=4.0)))
    openness = [door.openness(t) for t in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0)]
    assert openness == pytest.approx([0.0, 0.125, 0.25, 0.125, 0.0, 0.0], abs=1e-12)


def test_a_lidar_sees_the_door_where_it_was_at_its_time() -> None:
    door = Shape(
        segment=[[3, -1], [3, 1]],
        thickness=0.1,
        motion=DoorMotion(style="sliding", slide=[0, 2.1], open=[[1, 99]], moving_time=0.0),
    )
    robot = SimulatedRobot(
        SimParams(sensors={"laser": AHEAD}), World(None, [[9, 0, 0.5]], shapes=[door]), CIRCLE, Pose2D(0, 0, 0)
    )
    robot.advance_to(2.0)
    for scan in robot.scans():
        assert isinstance(scan, LaserScan)
        assert scan.ranges[0] == pytest.approx(2.95 if scan.stamp < 1.0 else 8.5)


def test_a_closed_door_stops_the_robot_an_open_one_does_not() -> None:
    door = Shape(
        name="gate", segment=[[1, -1], [1, 1]], motion=DoorMotion(angle=-1.57, open=[[3, 99]], moving_time=1.0)
    )
    robot = SimulatedRobot(SimParams(lasers=[]), World(None, shapes=[door]), CIRCLE, Pose2D(0, 0, 0))
    robot.command(Twist2D(0.5))
    robot.advance_to(2.9)
    (collision,) = robot.collisions
    assert (collision.kind, collision.name) == ("polygon", "gate")
    assert robot.pose.x == pytest.approx(1.0 - 0.025 - 0.18, abs=0.006)
    clouds = [data for data in robot.scans() if isinstance(data, PointCloud)]
    assert len(clouds[-1].points) == 1  # its bumper feels it
    assert robot.clearance <= 0.006
    robot.command(Twist2D(-0.5))
    robot.advance_to(4.5)
    robot.command(Twist2D(0.5))
    robot.advance_to(9.0)
    assert robot.pose.x > 1.5
    assert len(robot.collisions) == 1


def test_polygons_on_tracks() -> None:
    motion = OnTrack(points=[[0, 0], [4, 0], [4, 4], [0, 4]], speed=1.0, closed=True, heading="along")
    cart = Shape(box=[0.6, 0.2], motion=motion)
    for t, bounds in ((2, (1.7, -0.1, 2.3, 0.1)), (6, (3.9, 1.7, 4.1, 2.3)), (18, (1.7, -0.1, 2.3, 0.1))):
        assert polygon_at(cart, float(t)).bounds == pytest.approx(bounds)
    # next to the track, on its left
    beside = Shape(box=[0.6, 0.2], pose=[0.0, 1.0, 0.0], motion=motion)
    assert polygon_at(beside, 6.0).bounds == pytest.approx((2.9, 1.7, 3.1, 2.3))
    spinning = Shape(box=[0.6, 0.2], motion=OnTrack(points=[[0, 0], [4, 0]], speed=0.0, spin=math.pi / 4))
    assert polygon_at(spinning, 2.0).bounds == pytest.approx((-0.1, -0.3, 0.1, 0.3))
    disc = World(None, shapes=[Shape(radius=0.3, pose=[0.0, 1.0], motion=motion)])
    assert disc.discs_at(6.0).tolist() == [pytest.approx([3.0, 2.0, 0.3])]


def test_clearance_to_moving_obstacles_depends_on_time() -> None:
    cart = Shape(box=[0.6, 0.2], motion=OnTrack(points=[[5, 0], [2, 0]], speed=1.0))
    world = World(None, shapes=[cart])
    assert world.moves
    for t in (0.0, 0.7, 2.5, 3.0, 4.0):
        x = 5 - t if t <= 3 else t - 1
        assert world.clearance(Pose2D(0, 0, 0), time=t) == pytest.approx(x - 0.3)
        assert world.clearance(Pose2D(0, 0, 0), CIRCLE, time=t) == pytest.approx(x - 0.3 - 0.18)
        assert world.is_free(CIRCLE, Pose2D(x - 0.5, 0, 0), t)
        assert not world.is_free(CIRCLE, Pose2D(x - 0.45, 0, 0), t)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({}, "it has none"),
        ({"radius": 0.2, "box": [1, 2]}, "radius and box"),
        ({"box": [1.0]}, "length, width"),
        ({"segment": [[0, 0], [0, 0]]}, "two different ends"),
        ({"polygon": [[0, 0], [1, 1], [1, 0], [0, 1]]}, "intersects or touches itself"),
        ({"polygon": [[0, 0], [1, 1]]}, "at least three"),
        ({"radius": 0.2, "pose": [1]}, "is not a pose"),
        ({"radius": 0.2, "motion": {"kind": "walk"}}, "pedestrian"),
        ({"radius": 0.2, "motion": {"kind": "track", "points": [[0, 0], [0, 0]]}}, "two different points"),
        ({"radius": 0.2, "motion": {"kind": "door"}}, "a disc cannot be a door"),
        ({"box": [1, 1], "motion": {"kind": "door"}}, "no default hinge"),
        ({"box": [1, 1], "motion": {"kind": "door", "style": "sliding"}}, "no default slide"),
        ({"segment": [[0, 0], [1, 0]], "motion": {"kind": "door", "open": [[5, 3]]}}, "0 <= from < to"),
        (
            {"segment": [[0, 0], [1, 0]], "motion": {"kind": "door", "open": [[5, 30]], "period": 9}},
            "within the period",
        ),
        (
            {"segment": [[0, 0], [1, 0]], "motion": {"kind": "door", "style": "sliding", "hinge": [0, 0]}},
            "has no hinge; remove it",
        ),
        ({"segment": [[0, 0], [1, 0]], "motion": {"kind": "door", "style": "sliding", "angle": 1}}, "has no angle"),
        ({"segment": [[0, 0], [1, 0]], "motion": {"kind": "door", "slide": [0, 1]}}, "has no slide"),
        ({"radius": 0.2, "thickness": 0.1}, "a disc has no thickness"),
        ({"box": [1, 1], "thickness": 0.1}, "a box has no thickness"),
        ({"box": [1, 1], "motion": {"kind": "pedestrian", "goals": [[1, 1]]}}, "a pedestrian is a disc"),
        ({"radius": 1, "motion": {"kind": "pedestrian", "goals": []}}, "goals is empty"),
    ],
)
def test_invalid_shapes_are_rejected(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Shape.model_validate(wrong)


@pytest.mark.slow
def test_moving_shapes_do_not_depend_on_the_division_into_calls() -> None:
    shapes = [
        Shape(box=[0.5, 0.3], motion=OnTrack(points=[[1, -2], [1, 2]], speed=0.6, spin=1.0)),
        Shape(segment=[[2, -1], [2, 1]], motion=DoorMotion(open=[[1, 2]], period=3.0, moving_time=0.5)),
        Shape(radius=0.25, pose=[4, 1], motion=PedestrianMotion(goals=[[-4, 0], [4, 1]])),
    ]
    world = World(None, shapes=shapes)
    ends: list[object] = []
    for cuts in (1, 13):
        robot = SimulatedRobot(SimParams(acc_lim_x=1.0), world, CIRCLE, Pose2D(-1, 0, 0), seed=5)
        robot.command(Twist2D(0.4, 0.0, 0.05))
        for k in range(cuts):
            robot.advance_to(9.0 * (k + 1) / cuts)
        scans = [np.asarray(d.ranges).tobytes() for d in robot.scans() if isinstance(d, LaserScan)]
        ends.append((robot.pose, robot.collisions, robot.solids.discs.tobytes(), scans))
    assert ends[0] == ends[1]
