"""Timed trajectories against closed forms, files, timing and feasibility."""

from __future__ import annotations

import json
import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navstack.behaviors import (
    InfeasibleTrajectoryError,
    InvalidTrajectoryError,
    MotionLimits,
    Trajectory,
    demands_of,
    figure_eight,
    from_path,
    heart,
    load_trajectory,
    poly_path,
    require_feasible,
    save_trajectory,
    slowest_factor,
    violations,
    with_rest,
)
from navstack.core import DifferentialDrive, Path, Pose2D, angle_between

CORNERS = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.5], [2.0, 1.5, 0.5], [0.5, 2.0, 0.0]])
LIMITS = MotionLimits(0.4, 1.5, 0.5, 2.0)


# --- poly_path --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("corner", ["edge", "next"])
def test_poly_path_is_continuous_and_passes_through_its_points(corner: str) -> None:
    path = poly_path(CORNERS, 0.5, corner=corner, dt=0.07)  # type: ignore[arg-type]
    lengths = np.linalg.norm(np.diff(CORNERS, axis=0), axis=1)
    times = np.concatenate(([0.0], np.cumsum(lengths / 0.5)))  # mean speed 0.5 on every edge
    assert path.duration == pytest.approx(times[-1], abs=1e-12)
    for t, point in zip(times, CORNERS):
        k = int(np.argmin(np.abs(path.t - t)))
        assert path.t[k] == pytest.approx(t, abs=1e-12)
        assert path.position[k] == pytest.approx(point, abs=1e-12)
        # the two sides of the corner: position and velocity agree to the order of the distance to it
        for h in (1e-4, 1e-6):
            before, after = path.at(t - h), path.at(t + h)
            if 0.0 < t < path.duration:
                assert before.pose.distance_to(after.pose) < 2.0 * h
                assert abs(before.speed - after.speed) < 20.0 * h
                assert abs(angle_between(before.pose.yaw, after.pose.yaw)) < 20.0 * h


def test_poly_path_is_the_formula_of_the_tutorial() -> None:
    """Its first edge from rest: s + v t + a t² + b t³ with a = (3 (e - s) - 2 T v - T w) / T², b likewise; peak 4/3 vmax."""
    vmax, s, e = 0.5, CORNERS[0], CORNERS[1]
    d = np.linalg.norm(e - s)
    duration, w = d / vmax, vmax * (e - s) / d
    a, b = (3 * (e - s) - duration * w) / duration**2, (-2 * (e - s) + duration * w) / duration**3
    path = poly_path(CORNERS, vmax)
    t = path.t[path.t <= duration][:, None]
    rows = slice(0, len(t))
    assert path.position[rows] == pytest.approx(s + a * t**2 + b * t**3, abs=1e-12)
    assert path.velocity[rows] == pytest.approx(2 * a * t + 3 * b * t**2, abs=1e-12)
    assert path.acceleration[rows] == pytest.approx(2 * a + 6 * b * t, abs=1e-12)
    fine = poly_path(CORNERS, vmax, dt=duration / 300.0)
    assert np.linalg.norm(fine.velocity[:301], axis=1).max() == pytest.approx(4.0 / 3.0 * vmax, rel=1e-4)


def test_poly_path_takes_velocities_at_both_ends_and_a_speed_per_edge() -> None:
    path = poly_path(CORNERS[:3], [0.5, 0.25], start_velocity=(0.1, 0.2), end_velocity=(0.0, 0.0, 0.0))
    assert path.velocity[0] == pytest.approx([0.1, 0.2, 0.0])
    assert path.velocity[-1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert path.duration == pytest.approx(math.hypot(2.0, 0.5) / 0.5 + 1.5 / 0.25)
    with pytest.raises(InvalidTrajectoryError, match="points 1 and 2 are equal"):
        poly_path([[0, 0], [0, 0], [1, 0]], 0.5)
    with pytest.raises(InvalidTrajectoryError, match="must be positive"):
        poly_path([[0, 0], [1, 0]], 0.0)


# --- closed curves ----------------------------------------------------------------------------------------------------

CURVES = {
    "heart": lambda dt: heart(1.3, 12.0, center=(8.0, 0.0, 2.0), dt=dt),
    "figure_eight": lambda dt: figure_eight(3.0, 2.0, 10.0, center=(4.0, 0.0, 2.0), dt=dt),
    "figure_eight_yz": lambda dt: figure_eight(3.0, 2.0, 10.0, center=(4.0, 0.0, 2.0), plane="yz", dt=dt),
}


@pytest.mark.parametrize("name", CURVES)
def test_velocities_and_accelerations_are_the_finite_differences(name: str) -> None:
    """Central differences over 0.5 ms steps are exact to h² / 6 times a third derivative of about 10: 1e-6."""
    it: Trajectory = CURVES[name](1e-3)
    h = 1e-3
    difference = (it.position[2:-1] - it.position[:-3]) / (2.0 * h)
    bound = h * h / 6.0 * np.abs(np.diff(it.acceleration, axis=0)).max() / h
    assert bound < 3e-6
    assert np.abs(difference - it.velocity[1:-2]).max() < max(1e-6, 1.05 * bound)
    # Richardson's extrapolation removes the term of h²: the velocities and accelerations agree to 1e-6
    for value, rate in ((it.position, it.velocity), (it.velocity, it.acceleration)):
        fine = (value[3:-3] - value[1:-5]) / (2.0 * h)
        coarse = (value[4:-2] - value[:-6]) / (4.0 * h)
        assert np.abs((4.0 * fine - coarse) / 3.0 - rate[2:-4]).max() < 1e-6


def test_figure_eight_and_heart_are_the_formulas_of_the_tutorial() -> None:
    w = 2.0 * math.pi / 10.0
    eight, it = (
        figure_eight(3.0, 2.0, 10.0, center=(4.0, 0.0, 2.0), plane="yz"),
        heart(1.0, 10.0, center=(8.0, 0.0, 2.0)),
    )
    t = eight.t
    assert eight.position == pytest.approx(
        np.column_stack((np.full_like(t, 4.0), 1.5 * np.sin(2 * w * t), 2.0 - np.cos(w * t))), abs=1e-12
    )
    assert it.position == pytest.approx(
        np.column_stack(
            (
                8.0 + 1.6 * np.cos(w * t) - 1.2 * np.cos(2 * w * t),
                1.9 * np.sin(w * t) - 0.95 * np.sin(2 * w * t),
                np.full_like(t, 2.0),
            )
        ),
        abs=1e-12,
    )
    assert it.start == pytest.approx((8.4, 0.0, 0.0), abs=1e-12)
    assert abs(it.end.yaw) == pytest.approx(math.pi, abs=1e-9)  # the notch is a cusp
    with pytest.raises(InvalidTrajectoryError, match="period = 0 must be positive"):
        heart(1.0, 0.0)


@pytest.mark.slow
@given(st.floats(0.0, 40.0))
def test_between_samples_the_trajectory_is_the_curve(time: float) -> None:
    """Hermite cubics of 0.1 s: h⁴ / 384 times the fourth derivative."""
    w = 2.0 * math.pi / 40.0
    at = heart(1.0, 40.0).at(time)
    x, y = (
        1.6 * math.cos(w * time) - 1.2 * math.cos(2 * w * time),
        1.9 * math.sin(w * time) - 0.95 * math.sin(2 * w * time),
    )
    assert math.hypot(at.pose.x - x, at.pose.y - y) < 1e-8
    vx, vy = (
        w * (-1.6 * math.sin(w * time) + 2.4 * math.sin(2 * w * time)),
        1.9 * w * (math.cos(w * time) - math.cos(2 * w * time)),
    )
    assert at.speed == pytest.approx(math.hypot(vx, vy), abs=1e-5)


@pytest.mark.parametrize("name", CURVES)
def test_many_poses_are_those_of_single_times(name: str) -> None:
    it: Trajectory = CURVES[name](0.1)
    times = np.linspace(-1.0, it.duration + 1.0, 333)
    single = np.array([it.at(t).pose for t in times.tolist()])
    many = it.poses(times)
    assert many[:, :2] == pytest.approx(single[:, :2], abs=1e-12)
    assert np.cos(many[:, 2] - single[:, 2]) == pytest.approx(1.0, abs=1e-12)
    assert (many[:, 2] > -np.pi).all()
    assert (many[:, 2] <= np.pi).all()


def test_placing_a_trajectory_keeps_its_speeds() -> None:
    it = heart(1.0, 40.0).moved_to(Pose2D(3.0, -1.0, 2.5), "odom")
    assert it.start == pytest.approx((3.0, -1.0, 2.5), abs=1e-12)
    assert it.frame == "odom"
    assert demands_of(it).speed == pytest.approx(demands_of(heart(1.0, 40.0)).speed, abs=1e-9)
    slow = it.slower(2.0)
    assert slow.duration == 80.0
    assert slow.at(20.0).speed == pytest.approx(0.5 * it.at(10.0).speed)


# --- timing -----------------------------------------------------------------------------------------------------------


def jagged() -> Path:
    """A plan of grid steps around a corner."""
    leg = [(0.05 * k, 0.05 * (k // 3)) for k in range(80)]
    turn = [(4.0 + 0.05 * (k // 4), 1.35 + 0.05 * k) for k in range(60)]
    return Path(np.array([(x, y, 0.0) for x, y in leg + turn]))


def test_a_timed_path_keeps_the_limits_and_stays_at_its_path() -> None:
    path = jagged()
    it = from_path(path, LIMITS)
    assert violations(it, LIMITS) == ()
    assert it.at(0.0).speed == it.at(it.duration).speed == 0.0
    assert it.position[0, :2] == pytest.approx(path.poses[0, :2], abs=5e-3)
    assert it.position[-1, :2] == pytest.approx(path.poses[-1, :2], abs=5e-3)
    away = np.hypot(*(it.position[:, None, :2] - path.poses[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    assert away.max() < 0.1
    # a straight line is a trapezoid: d / v + v / a, with 0.99 of the speed and 0.9 of the acceleration
    v = 0.99 * 0.4
    line = from_path(Path(np.array([[0.05 * k, 0.0, 0.0] for k in range(81)])), LIMITS)
    assert line.duration == pytest.approx(4.0 / v + v / (0.9 * 0.5), rel=1e-3)


def test_a_curve_below_the_turning_radius_is_named() -> None:
    limits = MotionLimits(0.4, 1.5, 0.5, 2.0, min_turning_radius=2.0)
    with pytest.raises(
        InfeasibleTrajectoryError, match=r"a curve of .+ m radius at \(.+below the turning radius of 2.00 m"
    ):
        from_path(jagged(), limits)
    with pytest.raises(InvalidTrajectoryError, match="too short"):
        from_path(Path(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])), LIMITS)


def test_rest_at_both_ends_keeps_path_and_limits() -> None:
    eight = figure_eight(3.0, 2.0, 60.0, dt=0.05)
    it = with_rest(eight, 0.3)
    v0 = float(np.linalg.norm(eight.velocity[0]))
    assert it.duration == pytest.approx(60.0 + v0 / 0.3, abs=1e-9)  # half of the rise and of the fall more
    assert it.at(0.0).speed == pytest.approx(0.0, abs=1e-12)
    assert it.at(it.duration).speed == pytest.approx(0.0, abs=1e-12)
    assert it.at(0.0).pose.yaw == pytest.approx(eight.start.yaw, abs=1e-3)
    curve = eight.position[None, :, :2]
    assert np.hypot(*(it.position[:, None, :2] - curve).transpose(2, 0, 1)).min(axis=1).max() < 0.01
    assert demands_of(it).acceleration.max() <= 0.3 * 1.1
    already = heart(1.0, 60.0)
    assert with_rest(already, 0.3) is already
    with pytest.raises(InvalidTrajectoryError, match="too short"):
        with_rest(figure_eight(30.0, 20.0, 1.0), 0.1)


# --- feasibility ------------------------------------------------------------------------------------------------------


def test_feasibility_gives_the_time_at_which_a_limit_breaks() -> None:
    """Speed of the figure of eight: w sqrt((W cos 2wt)² + (H / 2 sin wt)²), largest where cos 2wt = -1 and sin wt = 1."""
    it = figure_eight(3.0, 2.0, 20.0)
    w = 2.0 * math.pi / 20.0
    (found,) = violations(it, MotionLimits(max_speed=0.9))
    assert (found.quantity, found.time) == ("speed", 0.0)
    assert found.value == pytest.approx(3.0 * w, rel=1e-3)
    assert (found.worst_time, found.worst) == (
        pytest.approx(5.0, abs=0.02),
        pytest.approx(w * math.hypot(3.0, 1.0), rel=1e-3),
    )
    # a rising speed: from rest with 0.1 m/s², 0.25 m/s is exceeded after 2.5 s
    t = np.linspace(0.0, 5.0, 51)
    p, v, a = (np.column_stack((x, 0 * t, 0 * t)) for x in (0.05 * t**2, 0.1 * t, 0.1 + 0 * t))
    (found,) = violations(Trajectory(t, p, v, a), MotionLimits(max_speed=0.25))
    assert found.time == pytest.approx(2.5, abs=0.04)
    assert "speed 0.252 m/s at 2.52 s, limit 0.25 m/s; worst 0.5 at 5.00 s" in str(found)


def test_curvature_and_wheels_are_checked() -> None:
    """A circle of 0.5 m radius at 0.2 m/s: curvature 2, outer wheel 0.2 (1 + d)."""
    t = np.linspace(0.0, 10.0, 201)
    w = 0.4
    c, s, z = np.cos(w * t), np.sin(w * t), 0.0 * t
    circle = Trajectory(
        t,
        0.5 * np.column_stack((c, s, z)),
        0.5 * w * np.column_stack((-s, c, z)),
        -0.5 * w * w * np.column_stack((c, s, z)),
    )
    (found,) = violations(circle, MotionLimits(min_turning_radius=0.6))
    assert found.quantity == "curvature"
    assert found.value == pytest.approx(2.0, rel=1e-3)
    assert slowest_factor(circle, MotionLimits(min_turning_radius=0.6)) is None
    drive = DifferentialDrive(0.3)
    (found,) = violations(circle, MotionLimits(drive=drive, max_wheel_speed=0.25))
    assert (found.quantity, found.value) == ("wheel right", pytest.approx(0.2 + 0.4 * 0.15, rel=1e-3))
    assert violations(circle, MotionLimits(drive=drive, max_wheel_speed=0.27)) == ()
    assert slowest_factor(circle, MotionLimits(drive=drive, max_wheel_speed=0.13)) == pytest.approx(2.0, rel=5e-3)


def test_an_infeasible_trajectory_says_how_slow_it_must_be() -> None:
    fast = heart(1.0, 10.0)
    factor = slowest_factor(fast, LIMITS)
    assert factor is not None
    with pytest.raises(
        InfeasibleTrajectoryError, match=f"cannot follow heart: .+ it is feasible in {factor:.2f} times"
    ):
        require_feasible(fast, LIMITS)
    require_feasible(fast.slower(1.001 * factor), LIMITS)


# --- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".yaml", ".json", ".csv"])
def test_files_survive_the_round_trip(suffix: str, tmp_path: FilePath) -> None:
    it = poly_path(CORNERS, 0.5, frame="map")
    again = load_trajectory(save_trajectory(it, tmp_path / f"path{suffix}"))
    assert again.t == pytest.approx(it.t, abs=1e-9)  # times in whole nanoseconds
    for what in ("position", "velocity", "acceleration"):
        assert getattr(again, what) == pytest.approx(getattr(it, what), abs=1e-12)
    assert (again.frame, again.name) == ("map", "path")


def test_messages_of_both_ros_versions_and_missing_velocities(tmp_path: FilePath) -> None:
    def point(x: float, time: object) -> dict[str, object]:
        return {"transforms": [{"translation": {"x": x, "y": 0.0}}], "time_from_start": time}

    file = tmp_path / "path.json"
    points = [point(0.5 * k, {"sec": k, "nanosec": 500_000_000}) for k in range(5)]
    file.write_text(json.dumps({"header": {"frame_id": "odom"}, "points": points}))
    it = load_trajectory(file)
    assert (it.frame, it.duration) == ("odom", 4.0)
    assert it.velocity[:, 0] == pytest.approx(0.5)
    file.write_text(json.dumps({"points": [point(0.5 * k, 2.0 * k) for k in range(2)]}))
    assert load_trajectory(file).velocity[:, 0] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "points: 3", "is a mapping with a list"),
        ("a.yaml", "points: [1, 2]", r"points\[0\] is 1, not a mapping"),
        ("a.yaml", "{points: [", "neither YAML nor JSON"),
        ("a.json", '{"points": [{}, {}]}', r"points\[0\] has no transforms"),
        ("a.csv", "x,y\n1,2\n", "is not a header of columns"),
        ("a.csv", "t,x,y\n0,0,0\n1,nan,0\n", "must be finite"),
        ("a.csv", "t,x,y\n0,0,0\n0,1,0\n", "sample 2 does not"),
        ("a.csv", "t,x,y\n0,0,0\n1,a,0\n", "row 3: .+ are not numbers"),
        ("a.csv", "t,x,y\n", "must increase"),
    ],
)
def test_broken_files_are_named(name: str, text: str, message: str, tmp_path: FilePath) -> None:
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(InvalidTrajectoryError, match=message) as error:
        load_trajectory(file)
    assert str(file) in error.value.message


def test_wrong_arrays_are_refused(tmp_path: FilePath) -> None:
    t, zero = np.array([0.0, 1.0]), np.zeros((2, 3))
    for args, message in (
        ((t[:1], zero[:1], zero[:1], zero[:1]), "at least 2 samples"),
        ((t[::-1] * 1.0, zero, zero, zero), "must increase from 0"),
        ((t, zero[:, :2], zero, zero), r"position has the shape \(2, 2\)"),
        ((t, zero, zero + math.nan, zero), "velocity of sample 0 is not finite"),
    ):
        with pytest.raises(InvalidTrajectoryError, match=message):
            Trajectory(*args)
    with pytest.raises(InvalidTrajectoryError, match=r"use \.yaml, \.json or \.csv"):
        save_trajectory(Trajectory(t, zero, zero, zero), tmp_path / "path.txt")
    with pytest.raises(InvalidTrajectoryError, match="cannot read"):
        load_trajectory(tmp_path / "absent.yaml")


@pytest.mark.parametrize(
    ("acceleration", "degrees"),
    [((1.0, 0.0), 0.0), ((0.0, 2.0), 90.0), ((-1.0, -0.5), 45.0), ((1e-7, 0.0), 45.0), ((0.0, 0.0), 45.0)],
)
@pytest.mark.parametrize("end", [False, True], ids=["start", "end"])
def test_the_heading_at_rest_is_that_in_which_it_sets_off_or_comes_to_rest(
    end: bool, acceleration: tuple[float, float], degrees: float
) -> None:
    """Moving, it heads to 45 degrees. At rest the acceleration tells the direction, against it at the end, unless it is
    about zero or points away from the motion.
    """
    t = np.array([0.0, 1.0, 2.0])
    moving, rest = [0.3, 0.3, 0.0], [0.0, 0.0, 0.0]
    velocity = np.array([moving, moving, rest] if end else [rest, moving, moving])
    accelerations = np.zeros((3, 3))
    accelerations[2 if end else 0, :2] = np.negative(acceleration) if end else acceleration
    found = Trajectory(t, np.outer(t, moving), velocity, accelerations)
    assert math.degrees(found.yaw[2 if end else 0]) == pytest.approx(degrees)
    assert math.degrees(found.yaw[0 if end else 2]) == pytest.approx(45.0)
    pose = found.end if end else found.start
    assert math.degrees(pose.yaw) == pytest.approx(degrees)


def test_the_heading_of_a_longer_rest_is_that_of_the_motion_after_it() -> None:
    """The acceleration of a sample that is followed by another one at rest tells nothing."""
    velocity = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.3, 0.3, 0.0]])
    acceleration = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    found = Trajectory(np.array([0.0, 1.0, 2.0]), np.zeros((3, 3)), velocity, acceleration)
    assert np.degrees(found.yaw).tolist() == pytest.approx([45.0, 90.0, 45.0])
