"""given_path: its arcs against closed forms, the rest of the path, and why it fails."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Costmap, Footprint, GridGeometry, NoValidPathError, Pose2D, StartOutsideMapError
from navstack.global_planner import GivenPath, GivenPathParams

BOX = Footprint(((-0.15, -0.25), (0.65, -0.25), (0.65, 0.25), (-0.15, 0.25)))
OUT = {"begin": [5.0, 5.0, 0.0], "segments": [[-2.0, 0.0], [-0.5 * math.pi, 1.0], [2.0, 0.0]]}
"""2 m back, a quarter circle back of radius 1 m, 2 m ahead: a robot that looked along x then looks along -y."""
END = Pose2D(2.0, 4.0, -0.5 * math.pi)


def costmap(*lethal: tuple[float, float]) -> Costmap:
    geometry = GridGeometry(100, 100, 0.1)
    data = np.zeros((100, 100), np.uint8)
    for x, y in lethal:
        ix, iy = geometry.world_to_cell(x, y) or (0, 0)
        data[iy, ix] = 254
    return Costmap(geometry, data)


def planner(**values: Any) -> GivenPath:
    return GivenPath(GivenPathParams(**values))


def test_the_arcs_end_where_their_closed_form_says() -> None:
    plan = planner(**OUT).make_plan(costmap(), Pose2D(5.0, 5.0, 0.0), END, footprint=BOX)
    assert tuple(plan.path.poses[-1]) == pytest.approx(tuple(END), abs=1e-12)
    assert tuple(plan.goal) == pytest.approx(tuple(END), abs=1e-12)
    assert plan.length_m == pytest.approx(2.0 + 0.5 * math.pi + 2.0, rel=1e-4)
    steps = np.hypot(*np.diff(plan.path.poses[:, :2], axis=0).T)
    assert steps.max() <= 0.05 + 1e-12
    # on the circle about (3, 6)
    arc = plan.path.poses[(plan.path.poses[:, 0] <= 3.0) & (plan.path.poses[:, 1] < 5.9)][1:20]
    assert np.hypot(arc[:, 0] - 3.0, arc[:, 1] - 6.0) == pytest.approx(1.0, abs=1e-9)


@settings(deadline=None, max_examples=50)
@given(
    segments=st.lists(
        st.tuples(st.floats(0.05, 3.0), st.sampled_from((1.0, -1.0)), st.floats(-1.2, 1.2)), min_size=1, max_size=6
    ),
    yaw=st.floats(-3.1, 3.1),
)
def test_the_heading_is_the_sum_of_the_turns_and_the_robot_never_slides(
    segments: list[tuple[float, float, float]], yaw: float
) -> None:
    params = GivenPathParams(begin=[0.0, 0.0, yaw], segments=[[sign * length, k] for length, sign, k in segments])
    poses = params.poses()
    turned = yaw + sum(sign * length * k for length, sign, k in segments)
    assert math.remainder(poses[-1, 2] - turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    d = np.diff(poses, axis=0)
    middle = poses[:-1, 2] + 0.5 * (np.remainder(d[:, 2] + math.pi, 2.0 * math.pi) - math.pi)
    assert d[:, 1] * np.cos(middle) - d[:, 0] * np.sin(middle) == pytest.approx(0.0, abs=1e-12)


def test_the_plan_is_the_rest_of_the_path() -> None:
    plan = planner(**OUT).make_plan(costmap(), Pose2D(4.02, 5.05, 0.1), END, footprint=BOX)
    assert tuple(plan.path.poses[0]) == pytest.approx((4.0, 5.0, 0.0), abs=1e-9)
    assert tuple(plan.path.poses[-1]) == pytest.approx(tuple(END), abs=1e-12)


def test_a_robot_beside_the_path_is_told_where_it_begins() -> None:
    with pytest.raises(NoValidPathError, match=r"1\.00 m from the given path.*first pose \(5\.00, 5\.00, 0\.00\)"):
        planner(**OUT).make_plan(costmap(), Pose2D(6.0, 5.0, 0.0), END)


def test_a_goal_beside_its_end_is_told_the_end() -> None:
    with pytest.raises(NoValidPathError, match=r"ends at \(2\.00, 4\.00, -1\.57\), 1\.00 m from the goal"):
        planner(**OUT).make_plan(costmap(), Pose2D(5.0, 5.0), Pose2D(3.0, 4.0))


def test_an_obstacle_on_the_path_is_named_with_its_place() -> None:
    """The footprint reaches 0.25 m to the side: an obstacle 0.2 m next to the path is hit, one at 0.4 m is not."""
    with pytest.raises(
        NoValidPathError, match=r"overlaps an obstacle on the given path at \(3\.[0-9]+, 5\.00, 0\.00\)"
    ):
        planner(**OUT).make_plan(costmap((3.05, 5.2)), Pose2D(5.0, 5.0), END, footprint=BOX)
    planner(**OUT).make_plan(costmap((4.05, 5.45)), Pose2D(5.0, 5.0), END, footprint=BOX)


def test_without_a_path_it_says_so() -> None:
    with pytest.raises(NoValidPathError, match="given_path has no path; set segments"):
        planner().make_plan(costmap(), Pose2D(5.0, 5.0), END)
    with pytest.raises(StartOutsideMapError):
        planner(**OUT).make_plan(costmap(), Pose2D(-5.0, 5.0), END)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"segments": [[1.0, 0.0], [0.0, 1.0]]}, "segment 2 is"),
        ({"segments": [[1.0]]}, r"write \[length, curvature\]"),
        ({"begin": [1.0, 2.0]}, "is not a pose"),
    ],
)
def test_wrong_values_are_named(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GivenPathParams(**values)
