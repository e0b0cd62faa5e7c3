"""For any costmap, pose and plan: a command within limits, or the right exception."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import (
    ControlError,
    Costmap,
    Footprint,
    GridGeometry,
    InvalidPathError,
    NoValidControlError,
    Path,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
)
from navstack.local_planner import DWAParams, DWAPlanner, PathFollower
from navstack.local_planner.critics.obstacle import first_lethal_cell, highest_around
from navstack.local_planner.map_grid import MapGridBuilder
from navstack.local_planner.rollouts import shared_cells
from navstack.local_planner.trajectory_rollout.escape import perimeter_cost
from navstack.plugins import LOCAL_PLANNERS, ControlInput, LocalPlan, LocalPlanner, Rollouts, ScoringContext

PLANNERS = [entry.name for entry in LOCAL_PLANNERS if not issubclass(entry.cls, PathFollower)]
FOOTPRINTS = [
    Footprint.from_radius(0.18, 0.01),
    Footprint(np.array([[0.3, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.3, -0.2]])),
    Footprint(np.array([[0.5, 0.0], [-0.3, 0.25], [-0.1, 0.0], [-0.3, -0.25]])),
]
SETTINGS = settings(deadline=None, max_examples=60)


@st.composite
def costmaps(draw: st.DrawFn) -> Costmap:
    nx, ny = draw(st.integers(1, 60)), draw(st.integers(1, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = np.array([0, 50, 128, 252, 253, 255], np.uint8)
    costs = rng.choice(values, size=(ny, nx), p=[0.85, 0.05, 0.04, 0.02, 0.02, 0.02])
    lethal = rng.random((ny, nx)) < draw(st.sampled_from([0.0, 0.005, 0.1]))
    costs[lethal] = 254
    resolution = draw(st.sampled_from([0.02, 0.05, 0.1, 0.3]))
    return Costmap(GridGeometry(nx, ny, resolution, draw(st.floats(-3, 3)), draw(st.floats(-3, 3))), costs, "odom")


positions = st.floats(-4.0, 4.0)
speeds = st.floats(-2.0, 2.0)
poses = st.builds(Pose2D, positions, positions, st.floats(-math.pi, math.pi))
twists = st.builds(Twist2D, speeds, st.sampled_from([0.0, 0.1, -0.3]), speeds)


@st.composite
def plans(draw: st.DrawFn) -> np.ndarray[Any, Any]:
    """Empty, of one pose, far away, back and forth, all poses equal, or with NaN or inf."""
    n = draw(st.integers(0, 60))
    kind = draw(st.sampled_from(["walk", "back_and_forth", "same", "far"]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    start = rng.uniform(-3.0, 3.0, 2)
    if kind == "same":
        xy = np.tile(start, (n, 1))
    elif kind == "back_and_forth":
        xy = start + np.column_stack((np.abs(np.arange(n) % 20 - 10) * 0.1, np.zeros(n)))
    else:
        xy = start + rng.normal(0.0, 0.1, (n, 2)).cumsum(axis=0) + (50.0 if kind == "far" else 0.0)
    out = np.column_stack((xy, rng.uniform(-math.pi, math.pi, n)))
    if n and draw(st.integers(0, 7)) == 0:
        out[draw(st.integers(0, n - 1)), draw(st.integers(0, 2))] = draw(st.sampled_from([math.nan, math.inf]))
    return out


def make(name: str, draw: st.DrawFn) -> LocalPlanner:
    cls = LOCAL_PLANNERS.get(name).cls
    values: dict[str, Any] = {
        "controller_frequency": draw(st.sampled_from([1.0, 5.0, 20.0, 50.0])),
        "vx_samples": draw(st.integers(1, 6)),
        "vy_samples": draw(st.integers(1, 3)),
        "vth_samples": draw(st.integers(1, 8)),
        "vtheta_samples": draw(st.integers(1, 8)),
        "use_dwa": draw(st.booleans()),
        "dwa": draw(st.booleans()),
        "sum_scores": draw(st.booleans()),
        "prune_plan": draw(st.booleans()),
        "latch_xy_goal_tolerance": draw(st.booleans()),
        "heading_scoring": draw(st.booleans()),
        "simple_attractor": draw(st.sampled_from([False, False, True])),
        "meter_scoring": draw(st.booleans()),
        "ros_distro": draw(st.sampled_from(["noetic", "indigo"])),
    }
    return cls(cls.Params(**{k: v for k, v in values.items() if k in cls.Params.model_fields}))


def check(planner: LocalPlanner, plan: LocalPlan, measured: Twist2D) -> None:
    """Within the limits; a robot beyond them brakes, and never accelerates further."""
    limits, command = planner.limits, plan.command
    assert command.is_finite()
    for value, low, high, now in (
        (command.vx, limits.min_vel_x, limits.max_vel_x, measured.vx),
        (command.vy, limits.min_vel_y, limits.max_vel_y, measured.vy),
        (command.wz, -limits.max_vel_theta, limits.max_vel_theta, measured.wz),
    ):
        within = min(0.0, low, now) - 1e-6 <= value <= max(0.0, high, now) + 1e-6
        assert within or plan.mode == "brake"


def check_footprints(planner: LocalPlanner, plan: LocalPlan, footprint: Footprint, costmap: Costmap, seed: int) -> None:
    """No legal rollout has its footprint on a lethal or unknown cell or off the map; for the best and some other samples.

    Compared with `first_lethal_cell`, in Python. In an escape the footprint may remain in collision.
    """
    if plan.mode not in ("follow", "rotate_to_goal", "brake") or plan.best < 0:
        return
    details = planner.diagnostics()
    assert details is not None
    legal = np.flatnonzero(plan.rejected_by == -1).tolist()
    picked = np.random.default_rng(seed).choice(legal, size=min(3, len(legal)), replace=False).tolist()
    for k in {plan.best, *picked}:
        for row in details.rollouts.poses[k, : details.rollouts.counts[k]].tolist():
            pose = Pose2D(*row)
            assert all(costmap.cost_at(float(x), float(y)) is not None for x, y in footprint.at(pose))
            assert first_lethal_cell(costmap, footprint, pose, 1.0) is None


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANNERS)
@SETTINGS
@given(data=st.data())
def test_a_command_or_the_right_exception(name: str, data: st.DataObject) -> None:
    planner = make(name, data.draw)
    footprint = data.draw(st.sampled_from(FOOTPRINTS))
    raw = data.draw(plans())
    if len(raw) == 0 or not np.isfinite(raw).all():
        with pytest.raises(InvalidPathError):
            planner.set_plan(Path(raw, "map"), Pose2D(0.0, 0.0))
        return
    goal = Pose2D(*raw[-1])
    planner.set_plan(Path(raw, "map"), goal)
    moved = data.draw(st.sampled_from([Transform2D(), Transform2D(0.3, -0.2, 1.0)]))
    for _ in range(3):
        costmap = data.draw(costmaps())
        before = costmap.data.copy()
        inputs = ControlInput(RobotState(data.draw(poses), data.draw(twists)), costmap, footprint, moved)
        try:
            plan = planner.compute_command(inputs)
        except ControlError as error:
            assert type(error) in (InvalidPathError, NoValidControlError)
            assert error.message and error.as_dict()["code"] in (103, 106)
        else:
            check(planner, plan, inputs.state.velocity)
            assert plan.rejected_by is not None
            # an escape is selected if every sample was rejected, and remains marked as rejected
            assert plan.best == -1 or plan.rejected_by[plan.best] == -1 or plan.mode == "escape"
            check_footprints(planner, plan, footprint, costmap, data.draw(st.integers(0, 2**32 - 1)))
        assert np.array_equal(costmap.data, before)
        planner.goal_reached(inputs)


@pytest.mark.slow
@SETTINGS
@given(costmap=costmaps(), poses_=st.lists(poses, min_size=1, max_size=8), scale=st.floats(1.0, 1.5), data=st.data())
def test_no_footprint_costs_more_than_the_bound(
    costmap: Costmap, poses_: list[Pose2D], scale: float, data: st.DataObject
) -> None:
    """The bound that decides which footprints are rasterized holds for every position of the center in its cell."""
    g = costmap.geometry
    footprint = data.draw(st.sampled_from(FOOTPRINTS))
    rows, bound = np.empty_like(costmap.data), np.empty_like(costmap.data)
    reach = min(scale * footprint.circumscribed_radius / g.resolution + 1e-6, float(g.nx + g.ny))
    highest_around(costmap.data, 0, 0, g.nx, g.ny, reach, rows, bound)
    for pose in poses_:
        x = g.origin_x + abs(pose.x) / 4.0 * g.width_m
        y = g.origin_y + abs(pose.y) / 4.0 * g.height_m
        cell = g.world_to_cell(x, y)
        if cell is None:
            continue
        cost = perimeter_cost(
            costmap.data, g.origin_x, g.origin_y, g.resolution, footprint.vertices, x, y, pose.yaw, scale
        )
        limit = int(bound[cell[1], cell[0]])
        assert cost <= limit
        if cost < 0:
            assert limit >= 254


def scoring_context(costmap: Costmap, plan: np.ndarray[Any, Any], robot: Pose2D) -> ScoringContext:
    limits = DWAPlanner(DWAParams()).limits
    return ScoringContext(RobotState(robot), costmap, FOOTPRINTS[0], plan, robot, limits)


@SETTINGS
@given(
    costmap=costmaps(),
    line=plans(),
    robot=poses,
    last_only=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
    nose=st.booleans(),
)
def test_a_resumed_wavefront_gives_the_same_scores(
    costmap: Costmap, line: np.ndarray[Any, Any], robot: Pose2D, last_only: bool, seed: int, nose: bool
) -> None:
    """Grids are computed as far as critics need them; compared with the whole grid of C++, point by point."""
    line = line[np.isfinite(line).all(axis=1)]
    if len(line) == 0:
        return
    g = costmap.geometry
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 1.0, (12, 4, 3)) * (g.width_m * 1.02, g.height_m * 1.02, 6.0)
    points[:, :, 0] += g.origin_x
    points[:, :, 1] += g.origin_y
    rollouts = Rollouts(np.zeros((12, 3)), points, rng.integers(1, 5, 12))
    context = scoring_context(costmap, line, robot)
    grid = MapGridBuilder().build(context, line, robot[:2], last_only=last_only)
    cells = shared_cells(context, rollouts)
    ahead = 0.05 if nose else 0.0

    def scored() -> np.ndarray[Any, Any]:
        if nose:
            return grid.at_nose(rollouts, cells, ahead, np.empty(12))
        return grid.at_center(rollouts, cells, np.empty(12))

    lazy = scored()
    whole = grid.values()
    size = g.nx * g.ny
    for k in range(12):
        expected = 0.0
        for x, y, yaw in points[k, : rollouts.counts[k]].tolist():
            cell = g.world_to_cell(x + ahead * math.cos(yaw), y + ahead * math.sin(yaw))
            expected = -4.0 if cell is None else float(whole[cell[1], cell[0]])
            if expected == -4.0:
                break
            if not nose and expected >= size:
                expected = -3.0 if expected == size else -2.0
                break
        assert lazy[k] == expected
    np.testing.assert_array_equal(lazy, scored())


@SETTINGS
@given(costmap=costmaps(), robot=poses, at=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)))
def test_directed_and_undirected_wavefronts_have_the_same_distances(
    costmap: Costmap, robot: Pose2D, at: tuple[float, float]
) -> None:
    g = costmap.geometry
    end = np.array([[g.origin_x + at[0] * g.width_m * 0.999, g.origin_y + at[1] * g.height_m * 0.999, 0.0]])
    context = scoring_context(costmap, end, robot)
    directed = MapGridBuilder().build(context, end, robot[:2], last_only=True)
    undirected = MapGridBuilder().build(context, end, robot[:2], last_only=False)
    assert directed.seeds == undirected.seeds
    np.testing.assert_array_equal(directed.values(), undirected.values())


@pytest.mark.slow
@SETTINGS
@given(pose=poses, velocity=twists, side=st.floats(0.11, 0.9), ahead=st.floats(0.3, 1.4))
def test_mirrored_scenes_have_mirrored_tables(pose: Pose2D, velocity: Twist2D, side: float, ahead: float) -> None:
    """In an empty map, DWA scores a sample as its mirror image in the mirrored scene."""

    def table(sign: float) -> dict[tuple[float, float], float]:
        cls = LOCAL_PLANNERS.get("dwa").cls
        planner = cls(cls.Params(max_vel_y=0.0, min_vel_y=0.0, controller_frequency=5.0))
        assert isinstance(planner, DWAPlanner)
        x, y = 0.31 + 0.001 * pose.x, 0.0137 + 0.001 * pose.y
        line = np.linspace(0.0, 1.0, 40)[:, None] * np.array([[ahead, side * sign, 0.0]])
        line += np.array([[x, y * sign, 0.0]])
        costmap = Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0), frame="odom")
        state = RobotState(Pose2D(x, y * sign, pose.yaw * sign), Twist2D(velocity.vx, 0.0, velocity.wz * sign))
        try:
            plan = planner.search(state, costmap, FOOTPRINTS[0], line, Pose2D(*line[-1]))
        except NoValidControlError as error:
            plan = error.data["plan"]
        return {
            (round(float(s[0]), 5), round(float(s[2]) * sign, 5) + 0.0): float(t)
            for s, t in zip(plan.samples, plan.totals, strict=True)
        }

    left, right = table(1.0), table(-1.0)
    assert left.keys() == right.keys()
    # a point within float32's precision of a cell's border may fall on either side of it
    different = sum(not np.isclose(left[k], right[k], equal_nan=True) for k in left)
    assert different <= 0.02 * len(left) + 1
