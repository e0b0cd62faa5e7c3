"""A scanner that stands too near to something: driving towards it is stopped, backing off is not."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from navstack.core import Footprint, FrameTree, LaserScan, Pose2D, Transform2D, Twist2D
from navstack.parameters import (
    CollisionDetectorParams,
    CollisionMonitorParams,
    ExclusionZoneParams,
    LidarParams,
    MonitorSourceParams,
    SimParams,
)
from navstack.safety import CollisionDetector, CollisionMonitor, CommandChain
from navstack.sim import Shape as Obstacle
from navstack.sim import SimulatedRobot, World
from tests.safety.rig import FOOTPRINT, zone

ROUND = Footprint.from_radius(0.2)
RANGE_MIN = 0.45
STOP_ZONE = zone(action_type="stop", points="[[0.4, 0.2], [0.15, 0.2], [0.15, -0.2], [0.4, -0.2]]")


def frames_with(sensor: Pose2D, base: Pose2D = Pose2D(0.0, 0.0), stamp: float = 0.0) -> FrameTree:
    tree = FrameTree()
    tree.set("odom", "base", Transform2D(*base), stamp)
    tree.set_static("base", "laser", Transform2D(*sensor))
    return tree


def blind(
    low: float,
    high: float,
    *,
    body: Footprint = ROUND,
    sensor: Pose2D = Pose2D(0.1, 0.0),
    value: float = -math.inf,
    **more: object,
) -> CollisionMonitor:
    """A monitor whose scan has too-near beams from `low` to `high` (rad) and no others."""
    angles = np.linspace(low, high, 41)
    source = MonitorSourceParams(**more)  # type: ignore[arg-type]
    params = CollisionMonitorParams(
        polygons=["s"], observation_sources=["scan"], blocks={"s": STOP_ZONE, "scan": source}
    )
    m = CollisionMonitor(params, frames=frames_with(sensor), base_frame="base", footprint=body)
    scan = LaserScan(
        np.full(41, value, np.float32), low, float(angles[1] - angles[0]), RANGE_MIN, 6.0, 0.0, "laser", "scan"
    )
    m.observe(scan)
    return m


@pytest.mark.parametrize("body", [ROUND, FOOTPRINT], ids=["round", "rectangle"])
@pytest.mark.parametrize(
    ("command", "passes"),
    [
        (Twist2D(0.3), False),
        (Twist2D(0.02, 0.0, 1.0), False),
        (Twist2D(0.0, 0.3), False),  # the beams to the left
        (Twist2D(-0.3), True),
        (Twist2D(-0.3, 0.0, 0.2), True),
        (Twist2D(-0.3, 0.0, -0.2), True),
    ],
)
def test_the_robot_backs_off_from_what_is_too_near(body: Footprint, command: Twist2D, passes: bool) -> None:
    decision = blind(-0.5, 0.5, body=body).process(command, 0.0)
    assert decision.command == (command if passes else Twist2D())
    if not passes:
        assert decision.zone == "too near"
        assert "41 of 41 beams of scan hit something nearer than range_min (0.45 m)" in decision.reason


@pytest.mark.parametrize("command", [Twist2D(0.0, 0.0, 1.0), Twist2D(0.0, 0.0, -2.0)])
def test_only_a_round_robot_turns_beside_what_is_too_near(command: Twist2D) -> None:
    assert blind(-0.5, 0.5).process(command, 0.0).command == command
    assert blind(-0.5, 0.5, body=FOOTPRINT).process(command, 0.0).command == Twist2D()


def test_a_turn_away_passes() -> None:
    """Beams to the front left: the right corner of the rectangle, in front of the base, turns away from them."""
    m = blind(1.2, 1.5, body=FOOTPRINT, sensor=Pose2D(0.0, 0.0))
    assert m.process(Twist2D(0.0, 0.0, -1.0), 0.0).command == Twist2D(0.0, 0.0, -1.0)
    assert m.process(Twist2D(0.0, 0.0, 1.0), 0.0).command == Twist2D()
    assert m.process(Twist2D(0.0, -0.2), 0.0).command == Twist2D(0.0, -0.2)
    assert m.process(Twist2D(0.0, 0.2), 0.0).command == Twist2D()


def test_a_covered_scanner_that_sees_all_around_stops_every_translation() -> None:
    for yaw in np.linspace(-math.pi, math.pi, 17):
        command = Twist2D(0.3 * math.cos(yaw), 0.3 * math.sin(yaw))
        for body in (ROUND, FOOTPRINT):
            m = blind(-math.pi, math.pi, body=body, sensor=Pose2D(0.0, 0.0))
            assert m.process(command, 0.0).command == Twist2D()


def test_what_is_too_near_stays_where_it_is_while_the_robot_moves() -> None:
    """The robot turns by 180 degrees before the next scan: what was ahead is behind."""
    m = blind(-0.5, 0.5)
    m.frames.tree.set("odom", "base", Transform2D(0.0, 0.0, math.pi), 0.1)
    assert m.process(Twist2D(0.3), 0.1).command == Twist2D(0.3)
    assert m.process(Twist2D(-0.3), 0.1).zone == "too near"


def test_a_valid_scan_ends_it_and_stale_data_stop() -> None:
    m = blind(-0.5, 0.5)
    assert m.process(Twist2D(-0.3), 2.5).zone == "invalid source"
    m.frames.tree.set("odom", "base", Transform2D(), 2.5)
    m.observe(LaserScan(np.full(41, 3.0, np.float32), -0.5, 0.025, RANGE_MIN, 6.0, 2.5, "laser", "scan"))
    assert m.process(Twist2D(0.3), 2.5).command == Twist2D(0.3)


def test_beams_in_an_exclusion_zone_do_not_count() -> None:
    mask = ExclusionZoneParams(
        type="polygon", points="[[0.3, -1.0], [1.0, -1.0], [1.0, 1.0], [0.3, 1.0]]", enabled=True
    )
    m = blind(-0.5, 0.5, exclusion_zones=["mask"], exclusions={"mask": mask})
    assert m.process(Twist2D(0.3), 0.0).command == Twist2D(0.3)


def test_as_nav2_such_a_scan_is_free() -> None:
    for value in (math.nan, -math.inf):
        params = CollisionMonitorParams(
            polygons=["s"],
            observation_sources=["scan"],
            nav2_compatible=True,
            blocks={"s": STOP_ZONE, "scan": MonitorSourceParams()},
        )
        m = CollisionMonitor(params, frames=frames_with(Pose2D(0.1, 0.0)), base_frame="base", footprint=ROUND)
        m.observe(LaserScan(np.full(9, value, np.float32), -0.5, 0.1, RANGE_MIN, 6.0, 0.0, "laser", "scan"))
        assert m.process(Twist2D(0.3), 0.0).command == Twist2D(0.3)


def test_the_detector_reports_it() -> None:
    params = CollisionDetectorParams(
        polygons=["s"],
        observation_sources=["scan"],
        blocks={"s": zone(action_type="none"), "scan": MonitorSourceParams()},
    )
    detector = CollisionDetector(params, frames=frames_with(Pose2D(0.1, 0.0)), base_frame="base")
    detector.observe(LaserScan(np.full(9, 0.2, np.float32), -0.5, 0.1, RANGE_MIN, 6.0, 0.0, "laser", "scan"))
    assert "9 of 9 beams of scan hit something nearer" in detector.step(0.0).problems["scan"]


# --- property ---------------------------------------------------------------------------------------------------------

VELOCITY = st.floats(-0.5, 0.5).map(lambda v: round(v, 3))


@pytest.mark.slow
@settings(max_examples=200)
@given(
    command=st.tuples(VELOCITY, VELOCITY, VELOCITY),
    middle=st.floats(-math.pi, math.pi),
    width=st.floats(0.05, 3.0),
    sensor=st.tuples(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12), st.floats(-math.pi, math.pi)),
    body=st.sampled_from([ROUND, FOOTPRINT]),
)
def test_no_command_towards_a_beam_passes_and_one_away_does(
    command: tuple[float, float, float],
    middle: float,
    width: float,
    sensor: tuple[float, float, float],
    body: Footprint,
) -> None:
    """Compared with the distances from the moved outline to both ends of every beam, by another library."""
    low, high = middle - 0.5 * width, middle + 0.5 * width
    m = blind(low, high, body=body, sensor=Pose2D(*sensor))
    passes = m.process(Twist2D(*command), 0.0).command == Twist2D(*command)
    outline = shapely.Point(0.0, 0.0).buffer(0.2, quad_segs=2048) if body is ROUND else body.polygon
    origin = np.array(sensor[:2])
    angles = sensor[2] + np.linspace(low, high, 41)
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    exits = np.array(
        [
            shapely.LineString([origin, origin + 2.0 * d])
            .intersection(outline.exterior)
            .distance(shapely.Point(origin))
            for d in directions
        ]
    )
    far = np.maximum(exits, RANGE_MIN)
    # places on the beams outside the outline: at the step below, a place on the outline would be inside it
    places = np.concatenate(
        [origin + (exits + share * (far - exits) + 1e-3)[:, None] * directions for share in (0.0, 0.5, 1.0)]
    )
    dt = 1e-4
    moved = affinity.translate(
        affinity.rotate(outline, command[2] * dt, (0.0, 0.0), use_radians=True), command[0] * dt, command[1] * dt
    )
    before, after = (shapely.distance(shape, shapely.points(places)) for shape in (outline, moved))
    rate = (after - before) / dt
    if rate.min() < -0.01:
        assert not passes
    if rate.min() > 0.01:
        assert passes


# --- a robot ----------------------------------------------------------------------------------------------------------


def test_a_turtlebot_in_front_of_a_box_gets_away() -> None:
    """The camera of a turtlebot sees only the box, too near: forwards the robot stands, backwards it drives."""
    sim = SimParams(
        sensors={"laser": LidarParams(fov=1.0, beams=64, range_min=RANGE_MIN, range_max=6.0, frequency=10.0, x=0.1)},
        physics_frequency=100.0,
    )
    box = Obstacle(name="box", box=[0.4, 2.0], pose=[0.7, 0.0, 0.0])  # its face is 0.4 m from the camera
    robot = SimulatedRobot(sim, World(shapes=(box,)), Footprint.from_radius(0.18), Pose2D(0.0, 0.0))
    params = CollisionMonitorParams(
        polygons=["s"], observation_sources=["scan"], blocks={"s": STOP_ZONE, "scan": MonitorSourceParams()}
    )
    monitor = CollisionMonitor(
        params, frames=robot.frames, base_frame=robot.base_frame, odom_frame=robot.odom_frame, footprint=ROUND
    )
    chain = CommandChain(robot, monitor=monitor)
    zones: list[str] = []

    def drive(command: Twist2D, seconds: float) -> None:
        begin = robot.time
        for k in range(round(20 * seconds)):
            robot.advance_to(begin + k / 20)
            chain.scans()
            chain.send("teleop", command, robot.time)
            step = chain.tick(robot.time)
            zones.append(step.decision.zone if step is not None and step.decision is not None else "")

    drive(Twist2D(0.3), 1.0)
    assert robot.pose.x == 0.0
    assert zones[-1] == "too near"
    drive(Twist2D(-0.2), 1.0)
    assert robot.pose.x == pytest.approx(-0.2, abs=0.03)
    drive(Twist2D(0.0, 0.0, 1.0), 1.6)
    assert robot.pose.yaw == pytest.approx(1.6, abs=0.1)
    assert not robot.collisions
