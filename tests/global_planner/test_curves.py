"""Dubins and Reeds-Shepp curves: known lengths, brute force over words, OMPL's lengths, and their ends."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from navstack.core import InputError, Pose2D
from navstack.global_planner._curves import curve_lengths, dubins_curve, reeds_shepp_curve
from tests.conftest import golden_nav2_files
from tests.global_planner import brute_force

PI = math.pi
KNOWN = [
    ((4, 0, 0), 4, 4),
    ((-4, 0, 0), 2 * PI + 4, 4),
    ((0, 0, PI), 7 * PI / 3, PI),
    ((0, 0, PI / 2), 6.408513, PI / 2),
    ((0, 2, PI), PI, PI),
    ((0, 4, PI), PI + 2, PI + 2),
    ((0, 1, PI), 6.032530, PI),
    ((1, 1, PI / 2), PI / 2, PI / 2),
    ((2, 2, 0), PI, PI),
    ((4, 4, PI / 2), 5.813437, 5.813437),
    ((0, 1, 0), 2 * PI + 1, 2.636232),
    ((0, 2, 0), 2 * PI + 2, 3.646953),
    ((0, 4, 0), 2 * PI, 5.478121),
    ((0, 0.2, 0), 2 * PI + 0.2, 1.240833),
    ((2, 0, PI), 2 * PI, PI),
    ((4, 0, PI), 7.652892, 5.141593),
    ((-3, 0, PI), 6.837116, 4.141593),
    ((4, 3, 1), 5.053325, 5.053325),
    ((3, -1, 2.5), 6.517756, 4.305429),
]
ORIGIN = Pose2D(0.0, 0.0, 0.0)
coordinate = st.floats(-6.0, 6.0)
yaw = st.floats(-PI, PI)
radius = st.floats(0.05, 5.0)


@pytest.mark.parametrize(("goal", "dubins", "reeds_shepp"), KNOWN)
def test_known_lengths(goal: tuple[float, float, float], dubins: float, reeds_shepp: float) -> None:
    assert dubins_curve(ORIGIN, Pose2D(*map(float, goal)), 1.0).length == pytest.approx(dubins, abs=2e-6)
    assert reeds_shepp_curve(ORIGIN, Pose2D(*map(float, goal)), 1.0).length == pytest.approx(reeds_shepp, abs=2e-6)


def test_words_and_cusps() -> None:
    assert dubins_curve(ORIGIN, Pose2D(2.0, 2.0, 0.0), 1.0).word == "LR"
    assert dubins_curve(ORIGIN, Pose2D(0.0, 0.0, PI), 1.0).word in ("RLR", "LRL")
    turn = reeds_shepp_curve(ORIGIN, Pose2D(0.0, 0.0, PI), 1.0)
    assert turn.cusps == 2
    assert [abs(s.length) for s in turn.segments] == pytest.approx([PI / 3] * 3)
    assert reeds_shepp_curve(ORIGIN, Pose2D(-4.0, 0.0, 0.0), 1.0).word == "S-"
    assert reeds_shepp_curve(ORIGIN, Pose2D(2.0, 0.0, PI), 1.0).cusps == 1


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [False, True])
def test_brute_force_over_words(reverse: bool) -> None:
    """1e-9 radii; `python -m tests.global_planner.brute_force 1000000` compares more pairs."""
    rng = np.random.default_rng(21)
    goals = np.column_stack((rng.uniform(-6.0, 6.0, (20_000, 2)), rng.uniform(-PI, PI, 20_000)))
    goals[::2, :2] *= 0.25
    shortest = (brute_force.reeds_shepp if reverse else brute_force.dubins)(*goals.T)
    assert np.abs(curve_lengths(np.zeros_like(goals), goals, 1.0, reverse=reverse) - shortest).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [False, True])
def test_brute_force_where_segments_have_no_length(reverse: bool) -> None:
    """Goals on a lattice of half radii and quarter turns: there, words pass into each other and rounding decides their signs."""
    steps = np.arange(-8, 9) * 0.5
    goals = np.array([(x, y, k * PI / 2) for x in steps for y in steps for k in (-1, 0, 1, 2)])
    shortest = (brute_force.reeds_shepp if reverse else brute_force.dubins)(*goals.T)
    assert np.abs(curve_lengths(np.zeros_like(goals), goals, 1.0, reverse=reverse) - shortest).max() < 1e-8


@pytest.mark.parametrize("name", ["dubins", "reeds_shepp"])
def test_lengths_of_ompl(name: str) -> None:
    files = golden_nav2_files("tables.npz")
    if not files:
        pytest.skip("the golden data of Nav2 are absent (NAVSTACK_GOLDEN_NAV2)")
    with np.load(files[0]) as tables:
        pairs, expected = tables["in/pairs"], tables[f"{name}_length"]
    ours = curve_lengths(pairs[:, :3], pairs[:, 3:6], pairs[:, 6], reverse=name == "reeds_shepp")
    assert np.abs(ours - expected).max() < 1e-9


@given(coordinate, coordinate, yaw, yaw, radius)
def test_the_poses_end_at_the_goal_and_keep_to_the_radius(x: float, y: float, a: float, b: float, r: float) -> None:
    start, goal = Pose2D(1.0, -2.0, a), Pose2D(x, y, b)
    for curve in (dubins_curve(start, goal, r), reeds_shepp_curve(start, goal, r)):
        poses = curve.poses(0.1 * r)
        assert np.abs(poses[-1, :2] - goal[:2]).max() < 1e-7
        assert abs(math.remainder(poses[-1, 2] - b, 2.0 * PI)) < 1e-7
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        turns = np.abs(np.remainder(np.diff(poses[:, 2]) + PI, 2.0 * PI) - PI)
        # a chord is 2 r sin(turn / 2): turning by `turn` over it is a curvature of at most 1 / r
        assert (2.0 * r * np.sin(0.5 * turns) <= steps + 1e-9).all()
        assert curve.length >= steps.sum() - 1e-7


@given(coordinate, coordinate, yaw)
def test_order_of_lengths(x: float, y: float, b: float) -> None:
    # squared distances are rounded: a goal that is nearer than this may be the start itself for one of the curves
    assume(x == y == 0.0 or math.hypot(x, y) > 1e-6)
    goal = Pose2D(x, y, b)
    forward, both = dubins_curve(ORIGIN, goal, 1.0), reeds_shepp_curve(ORIGIN, goal, 1.0)
    assert math.hypot(x, y) - 1e-9 <= both.length <= forward.length + 1e-9
    assert both.length == pytest.approx(reeds_shepp_curve(goal, ORIGIN, 1.0).length, abs=1e-8)
    assert both.cusps <= 2
    assert forward.cusps == 0


def test_wrong_input() -> None:
    with pytest.raises(InputError, match="turning radius must be a positive length"):
        dubins_curve(ORIGIN, Pose2D(1.0, 0.0, 0.0), 0.0)
    with pytest.raises(InputError, match="is not finite"):
        reeds_shepp_curve(ORIGIN, Pose2D(math.nan, 0.0, 0.0), 1.0)
    with pytest.raises(InputError, match="step"):
        dubins_curve(ORIGIN, Pose2D(1.0, 0.0, 0.0), 1.0).poses(0.0)
    with pytest.raises(InputError, match="same shape"):
        curve_lengths(np.zeros((2, 3)), np.zeros((3, 3)), 1.0, reverse=False)
