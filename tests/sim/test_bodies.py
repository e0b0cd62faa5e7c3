"""Bodies against closed forms: jerk, cars, systematic errors of the odometry; collision with thin walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from navstack.core import Footprint, GridGeometry, InputError, OccupancyGrid, Pose2D, Twist2D
from navstack.sim import OnTrack, Shape, SimParams, SimulatedRobot, World

CIRCLE = Footprint.from_radius(0.18)
OUTLINES = {
    "round": CIRCLE,
    "box": Footprint(np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]])),
    "car": Footprint(np.array([[-0.1, -0.2], [0.6, -0.2], [0.6, 0.2], [-0.1, 0.2]])),
    "arrow": Footprint(np.array([[-0.4, -0.3], [0.5, 0.0], [-0.4, 0.3], [-0.2, 0.0]])),
    "needle": Footprint(np.array([[-0.3, -0.002], [0.3, 0.0], [-0.3, 0.002]])),
}


def robot(params: SimParams, world: World | None = None, start: Pose2D = Pose2D(0, 0, 0), *, seed: int = 0):
    return SimulatedRobot(params, world or World(), CIRCLE, start, seed=seed)


# --- jerk -------------------------------------------------------------------------------------------------------------


def stopping(v: float, a: float, j: float) -> tuple[float, float]:
    """Time and distance of a stop from `v` with limits `a` and `j`: the acceleration profile is a trapezium or a triangle."""
    time = v / a + a / j if v >= a * a / j else 2.0 * math.sqrt(v / j)
    return time, 0.5 * v * time


@pytest.mark.parametrize(("v", "a", "j"), [(1.0, 1.0, 2.0), (0.5, 1.0, 1.0), (2.0, 0.7, 5.0), (0.3, 10.0, 0.5)])
def test_stopping_distance_with_limited_jerk(v: float, a: float, j: float) -> None:
    it = robot(SimParams(acc_lim_x=a, jerk_lim_x=j, physics_frequency=1000.0))
    time, way = stopping(v, a, j)
    it.command(Twist2D(v))
    it.advance_to(2.0 * time + 0.1)
    assert it.state().velocity.vx == v
    begin = it.pose.x
    it.command(Twist2D())
    samples = it.advance_to(it.time + time + 0.1)
    # the way of a step or two more or less
    assert it.pose.x - begin == pytest.approx(way, abs=2.5 * v * 1e-3)
    standing = int(np.nonzero(samples[:, 6] <= 1e-12)[0][0]) * 1e-3
    assert standing == pytest.approx(time, abs=3e-3)
    velocity = np.concatenate(([v], samples[:, 6]))
    assert velocity.min() >= -1e-12 and velocity.max() <= v + 1e-12  # never beyond
    acceleration = np.diff(velocity) * 1000.0
    assert np.abs(acceleration).max() <= a * (1 + 1e-9)
    assert np.abs(np.diff(acceleration, prepend=0.0)).max() <= j * 1e-3 * (1 + 1e-6)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(st.lists(st.floats(-2, 2), min_size=1, max_size=8), st.floats(0.2, 5), st.floats(0.2, 50), st.floats(5, 200))
def test_arbitrary_commands_respect_both_limits_and_are_reached(
    commands: list[float], a: float, j: float, frequency: float
) -> None:
    it = robot(SimParams(kinematics="holonomic", acc_lim_y=a, jerk_lim_y=j, physics_frequency=frequency))
    found = [np.zeros(1)]
    for k, command in enumerate(commands, 1):
        it.command(Twist2D(0.0, command, 0.0))
        found.append(it.advance_to(0.4 * k)[:, 7].copy())
    rest = 4.0 / a + 3.0 * a / j + 4.0 * math.sqrt(4.0 / j) + 10.0 / frequency
    found.append(it.advance_to(it.time + rest)[:, 7].copy())
    velocity = np.concatenate(found)
    acceleration = np.diff(velocity, prepend=0.0) * frequency
    assert np.abs(acceleration).max() <= a * (1 + 1e-9) + 1e-9
    assert np.abs(np.diff(acceleration, prepend=0.0)).max() <= j / frequency * (1 + 1e-9) + 1e-9
    assert velocity[-1] == pytest.approx(commands[-1], abs=1e-9)
    assert np.abs(acceleration[-2:]).max() <= 1e-6


def test_jerk_limit_without_acceleration_limit_and_of_rotation() -> None:
    it = robot(SimParams(jerk_lim_theta=2.0))
    it.command(Twist2D(0.0, 0.0, 1.0))
    samples = it.advance_to(3.0)
    # the top of the triangle, sqrt(w j), after half of 2 sqrt(w / j)
    assert np.diff(samples[:, 8]).max() * 50.0 == pytest.approx(math.sqrt(2.0), abs=0.05)
    assert samples[-1, 8] == 1.0


# --- cars -------------------------------------------------------------------------------------------------------------


def car(**more: object) -> SimParams:
    return SimParams(kinematics="ackermann", wheelbase=0.5, max_steering_angle=0.6, **more)  # pyright: ignore


@pytest.mark.parametrize("v", [0.8, -0.8])
@pytest.mark.parametrize("w", [0.5, -0.5])
def test_a_car_follows_the_commanded_turning_rate(v: float, w: float) -> None:
    it = robot(car())
    it.command(Twist2D(v, 0.0, w))
    samples = it.advance_to(4.0)
    assert it.steering_angle == pytest.approx(math.atan(0.5 * w / v))
    assert it.state().velocity.wz == pytest.approx(w)
    radius = v / w
    assert np.hypot(samples[:, 0], samples[:, 1] - radius) == pytest.approx(abs(radius), abs=2e-5)


def test_the_turning_circle_of_a_car_is_limited_by_its_maximum_steering_angle() -> None:
    params = car()
    assert params.turning_radius == pytest.approx(0.5 / math.tan(0.6))
    it = robot(params)
    it.command(Twist2D(0.5, 0.0, 9.0))
    samples = it.advance_to(2.0 * math.pi * params.turning_radius / 0.5)
    assert np.hypot(samples[:, 0], samples[:, 1] - params.turning_radius) == pytest.approx(
        params.turning_radius, abs=2e-5
    )
    assert it.pose.distance_to(Pose2D(0, 0)) < 0.02
    wide = car(min_turning_radius=2.0)
    assert wide.turning_radius == pytest.approx(2.0)
    it = robot(wide)
    it.command(Twist2D(0.5, 0.0, 9.0))
    it.advance_to(1.0)
    assert it.state().velocity.wz == pytest.approx(0.25)


def test_a_car_neither_turns_in_place_nor_moves_sideways() -> None:
    it = robot(car())
    it.command(Twist2D(0.0, 0.5, 1.0))
    it.advance_to(2.0)
    assert it.pose == Pose2D(0, 0, 0)
    it.command(Twist2D(0.5, 0.0, 0.5))
    it.advance_to(3.0)
    turned = it.steering_angle
    it.command(Twist2D())
    it.advance_to(4.0)
    assert it.steering_angle == turned == pytest.approx(math.atan(0.5))
    assert it.state().velocity == Twist2D(0, 0, 0)


def test_the_wheels_of_a_car_turn_at_their_rate() -> None:
    it = robot(car(max_steering_rate=0.5))
    it.command(Twist2D(0.2, 0.0, 9.0))
    samples = it.advance_to(2.0)
    t = np.arange(1, 101) * 0.02
    expected = 0.2 * np.tan(np.minimum(0.5 * t, 0.6)) / 0.5
    assert samples[:, 8] == pytest.approx(expected)


def test_the_angular_command_can_be_the_steering_angle() -> None:
    it = robot(car(steering_command="angle"))
    it.command(Twist2D(0.0, 0.0, -0.3))
    it.advance_to(0.1)
    assert it.steering_angle == -0.3
    it.command(Twist2D(0.4, 0.0, -0.3))
    it.advance_to(0.2)
    assert it.state().velocity.wz == pytest.approx(0.4 * math.tan(-0.3) / 0.5)


def test_the_lag_of_a_car_applies_to_speed_and_steering() -> None:
    it = robot(car(velocity_lag=0.2))
    it.command(Twist2D(0.4, 0.0, 0.2))
    samples = it.advance_to(1.0)
    share = 1.0 - np.exp(-np.arange(1, 51) * 0.02 / 0.2)
    assert samples[:, 6] == pytest.approx(0.4 * share)
    assert samples[:, 8] == pytest.approx(0.4 * share * np.tan(math.atan(0.25) * share) / 0.5)


# --- odometry ---------------------------------------------------------------------------------------------------------


def test_systematic_errors_of_the_odometry() -> None:
    it = robot(SimParams(odometry_scale=0.02, odometry_turn=0.05))
    it.command(Twist2D(0.5))
    it.advance_to(10.0)
    assert tuple(it.pose) == pytest.approx((5.0, 0.0, 0.0))
    seen = it.state().pose
    assert seen.yaw == pytest.approx(0.05 * 5.0)
    # an arc as long as 1.02 times the way, turned by 0.25 rad
    radius = 5.1 / 0.25
    assert (seen.x, seen.y) == pytest.approx((radius * math.sin(0.25), radius * (1 - math.cos(0.25))), abs=1e-5)
    # localization makes up for it
    assert tuple(it.frames.lookup("map", "base_footprint", it.time)) == pytest.approx(tuple(it.pose), abs=1e-12)


@pytest.mark.slow
def test_wheel_slip_affects_the_true_motion_with_its_variance() -> None:
    """One second of driving: the relative error of the distance has the given deviation, at any speed and step."""
    for speed, frequency in ((0.5, 50.0), (1.0, 20.0)):
        params = SimParams(wheel_slip=0.05, physics_frequency=frequency)
        ways: list[float] = []
        for seed in range(250):
            it = robot(params, seed=seed)
            it.command(Twist2D(speed))
            it.advance_to(1.0)
            assert it.state().pose.x == pytest.approx(speed)
            ways.append(it.pose.x / speed - 1.0)
        assert np.std(ways) == pytest.approx(0.05, rel=4.0 / math.sqrt(500))
        assert np.mean(ways) == pytest.approx(0.0, abs=4.0 * 0.05 / math.sqrt(250))


# --- collision ----------------------------------------------------------------------------------------------------------


def wall_world(kind: str, angle: float) -> World:
    """A wall 1 cm thick, 8 m long, 1 m ahead of the origin, rotated by `angle` (rad) about (1, 0)."""
    if kind == "cells":
        data = np.zeros((400, 201), np.int8)
        data[:, 100] = 100
        c, s = math.cos(angle), math.sin(angle)
        # the wall's middle, 1.005 m and 2 m from the grid's corner, lies in (1, 0)
        x, y = 1.0 - (1.005 * c - 2.0 * s), -(1.005 * s + 2.0 * c)
        return World(OccupancyGrid(data, GridGeometry(201, 400, 0.01, x, y), angle))
    return World(None, shapes=[Shape(box=[0.01, 4.0], pose=[1.0, 0.0, angle])])


@pytest.mark.slow
@settings(deadline=None, max_examples=120)
@given(
    st.sampled_from(sorted(OUTLINES)),
    st.sampled_from(["differential", "holonomic", "ackermann"]),
    st.sampled_from(["cells", "polygon"]),
    st.floats(-1.2, 1.2),
    st.floats(-1.5, 1.5),
    st.floats(-0.5, 0.5),
    st.sampled_from([10.0, 50.0, 200.0]),
)
def test_no_body_passes_a_wall_of_one_centimeter_at_2_m_per_s(
    outline: str, kinematics: str, kind: str, angle: float, wz: float, vy: float, frequency: float
) -> None:
    world = wall_world(kind, angle)
    footprint = OUTLINES[outline]
    start = Pose2D(-0.3, 0.0, 0.0)
    if not world.is_free(footprint, start):
        return
    it = SimulatedRobot(
        SimParams(kinematics=kinematics, physics_frequency=frequency, lasers=[], bumpers=[]),  # pyright: ignore
        world,
        footprint,
        start,
    )
    wall = affinity.rotate(shapely.box(0.995, -1.99, 1.005, 1.99), angle, origin=(1.0, 0.0), use_radians=True)
    for k, way in enumerate((1.0, -1.0, 1.0), 1):  # to it, back and again
        it.command(Twist2D(2.0 * way, 2.0 * vy, wz))
        for row in it.advance_to(1.2 * k)[:, :3].tolist():
            pose = Pose2D(*row)
            # a round outline faces as at the start
            placed = shapely.Polygon(footprint.at(pose._replace(yaw=0.0) if outline == "round" else pose))
            assert placed.intersection(wall).area < 1e-9
            if abs(pose.y) < 1.0:  # it could have gone round the end of the wall
                side = (pose.x - 1.0) * math.cos(angle) + pose.y * math.sin(angle)
                assert side < 0.0 or abs(it.distance_travelled) > 3.0


def test_at_the_wall_a_car_neither_slides_nor_turns() -> None:
    it = SimulatedRobot(car(), wall_world("polygon", 0.3), OUTLINES["car"], Pose2D(0, 0, 0))
    it.command(Twist2D(1.0, 0.0, 0.4))
    it.advance_to(2.0)
    (collision,) = it.collisions
    assert (collision.kind, collision.index) == ("polygon", 0)
    held = it.pose
    assert collision.pose.distance_to(held) < 0.005
    it.advance_to(3.0)
    assert it.pose.distance_to(held) < 1e-3
    it.command(Twist2D(-0.5))
    it.advance_to(4.0)
    assert not it.in_collision


def test_a_blocked_round_car_does_not_turn() -> None:
    it = SimulatedRobot(car(), wall_world("polygon", 0.0), CIRCLE, Pose2D(0, 0, 0))
    it.command(Twist2D(1.0, 0.0, 0.2))
    it.advance_to(1.2)
    yaw = it.pose.yaw
    assert it.in_collision
    it.advance_to(3.0)
    assert it.pose.yaw == pytest.approx(yaw, abs=0.01)


def test_a_polygon_that_moves_over_a_stopped_robot_is_a_collision_with_its_name() -> None:
    cart = Shape(name="cart", box=[0.4, 0.4], motion=OnTrack(points=[[2, 0], [-2, 0]], speed=1.0))
    it = robot(SimParams(), World(None, [[9.0, 9.0, 0.1]], shapes=[cart]))
    it.advance_to(1.8)
    ((kind, index, name),) = [(c.kind, c.index, c.name) for c in it.collisions]
    assert (kind, index, name) == ("polygon", 0, "cart")
    assert it.collisions[0].time == pytest.approx(2.0 - 0.2 - 0.18 + 0.02, abs=0.021)
    assert it.pose == Pose2D(0, 0, 0)
    assert it.clearance == 0.0
    it.advance_to(3.0)
    assert not it.in_collision
    assert it.clearance == pytest.approx(1.0 - 0.2 - 0.18, abs=0.03)


def test_a_start_in_a_shape_is_rejected() -> None:
    world = World(None, shapes=[Shape(box=[1.0, 1.0], pose=[0.3, 0.0])])
    with pytest.raises(InputError, match="polygon"):
        robot(SimParams(), world)


def test_names_of_obstacles() -> None:
    shapes = [
        Shape(name="post", radius=0.1, pose=[5, 0]),
        Shape(name="cart", radius=0.1, motion=OnTrack(points=[[6, 0], [7, 0]])),
        Shape(name="box", box=[0.1, 0.1], pose=[8, 0]),
    ]
    world = World(None, [[1, 0, 0.1]], low_discs=[[2, 0, 0.1]], shapes=shapes)
    for x, expected in ((1, ""), (2, ""), (5, "post"), (6, "cart"), (8, "box")):
        touched = world.collision(CIRCLE, Pose2D(float(x), 0.0, 0.0))
        assert touched is not None
        assert world.name_of(touched[0], touched[1]) == expected
