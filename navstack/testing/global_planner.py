"""The contract of global planners, on small maps drawn as text."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from navstack.core import (
    Costmap,
    GoalOutsideMapError,
    GridGeometry,
    InputError,
    NoValidPathError,
    PlanningError,
    Pose2D,
    StartOutsideMapError,
)
from navstack.plugins import GlobalPlanner, Plan
from navstack.testing.base import Contract, contract_of

RESOLUTION = 0.1
COSTS = {".": 0, "-": 60, "+": 200, "i": 253, "#": 254, "?": 255}

ROOM = """
    ####################
    #..................#
    #..................#
    #.......#######....#
    #.......#...--#....#
    #.......#...--+....#
    #.......#...--#....#
    #.......#######....#
    #..................#
    #..................#
    ####################
"""
DIVIDED = """
    ############
    #....#.....#
    #....#.....#
    #....#.....#
    ############
"""


def ascii_map(text: str, origin: tuple[float, float] = (-1.0, 2.0)) -> Costmap:
    """A costmap from a drawing whose first line is the top row: `.` free, `#` lethal, `i` inscribed, `?` unknown."""
    rows = [line.strip() for line in text.strip().splitlines()][::-1]
    data = np.array([[COSTS[c] for c in row] for row in rows], np.uint8)
    return Costmap(GridGeometry(data.shape[1], data.shape[0], RESOLUTION, *origin), data)


def pose_in(costmap: Costmap, ix: int, iy: int, yaw: float = 0.0) -> Pose2D:
    """The center of a cell."""
    x, y = costmap.geometry.cell_to_world(ix, iy)
    return Pose2D(float(x), float(y), yaw)


class GlobalPlannerContract(Contract):
    """What every global planner must do."""

    searches = True
    """False for planners that do not search (`carrot_planner`): they need not find a path around obstacles."""

    @classmethod
    def make(cls, **values: Any) -> GlobalPlanner:
        """The planner."""
        return cls.plugin(cls.params(**values))

    def check(self, plan: Plan, costmap: Costmap, start: Pose2D, goal: Pose2D) -> None:
        """The parts of a plan fit each other, the costmap, and what was asked for."""
        poses = plan.path.poses
        assert poses.dtype == np.float64 and poses.ndim == 2 and len(poses) >= 1
        assert np.isfinite(poses).all()
        assert plan.path.frame == costmap.frame
        assert ((-math.pi < poses[:, 2]) & (poses[:, 2] <= math.pi)).all()
        assert math.dist(poses[0, :2], start[:2]) <= RESOLUTION
        assert tuple(poses[-1]) == pytest.approx(tuple(plan.goal))
        assert plan.goal_moved_m == pytest.approx(plan.goal.distance_to(goal), abs=1e-9)
        assert np.isfinite(plan.cost) and plan.cost >= 0.0 and plan.cells_expanded >= 0
        for x, y in poses[1:, :2]:
            cost = costmap.cost_at(float(x), float(y))
            assert cost is not None, f"the path leaves the map at ({x:.2f}, {y:.2f})"

    def test_a_path_without_obstacles(self) -> None:
        """A goal in sight: the path ends there and the costmap is unchanged."""
        costmap = ascii_map(ROOM)
        start, goal = pose_in(costmap, 2, 2, 0.3), pose_in(costmap, 17, 2, -2.0)
        before = costmap.data.copy()
        plan = self.make().make_plan(costmap, start, goal, keep_potential=True)
        self.check(plan, costmap, start, goal)
        assert (costmap.data == before).all()
        assert plan.goal.distance_to(goal) <= (0.0 if self.searches else RESOLUTION)
        if plan.potential is not None:
            assert plan.potential.shape == costmap.data.shape and plan.potential.dtype == np.float32

    def test_a_path_around_obstacles(self) -> None:
        """No point of the path lies in a lethal or inscribed cell."""
        if not self.searches:
            return
        costmap = ascii_map(ROOM)
        start, goal = pose_in(costmap, 2, 5), pose_in(costmap, 17, 5)
        plan = self.make().make_plan(costmap, start, goal)
        self.check(plan, costmap, start, goal)
        costs = [costmap.cost_at(float(x), float(y)) for x, y in plan.path.poses[1:, :2]]
        assert all(cost not in (253, 254) for cost in costs)

    def test_no_path(self) -> None:
        """A wall without a gap: NO_VALID_PATH (208)."""
        if not self.searches:
            return
        costmap = ascii_map(DIVIDED)
        with pytest.raises(NoValidPathError) as error:
            self.make().make_plan(costmap, pose_in(costmap, 2, 2), pose_in(costmap, 8, 2))
        assert error.value.code == 208 and len(error.value.message) > 20

    def test_start_equals_goal(self) -> None:
        """The plan has no length worth mentioning."""
        costmap = ascii_map(ROOM)
        pose = pose_in(costmap, 3, 3, 0.5)
        plan = self.make().make_plan(costmap, pose, pose)
        self.check(plan, costmap, pose, pose)
        assert plan.path.length <= 2.0 * RESOLUTION

    def test_it_is_reproducible(self) -> None:
        """The same input gives the same bytes, also after other plans in between."""
        costmap = ascii_map(ROOM)
        start, goal = pose_in(costmap, 2, 2), pose_in(costmap, 17, 8, 1.0)
        planner = self.make()
        first = planner.make_plan(costmap, start, goal)
        planner.make_plan(costmap, pose_in(costmap, 5, 8), pose_in(costmap, 3, 1))
        for plan in (planner.make_plan(costmap, start, goal), self.make().make_plan(costmap.copy(), start, goal)):
            assert plan.path.poses.tobytes() == first.path.poses.tobytes()
            assert plan.cost == first.cost

    def test_frame_and_origin_of_the_costmap(self) -> None:
        """The path moves with the origin and carries the costmap's frame; its poses may be at other places along it."""
        near, far = ascii_map(ROOM, (0.0, 0.0)), ascii_map(ROOM, (-100.0, 50.0))
        far.frame = "odom"
        a = self.make().make_plan(near, pose_in(near, 2, 2), pose_in(near, 17, 2))
        b = self.make().make_plan(far, pose_in(far, 2, 2), pose_in(far, 17, 2))
        assert b.path.frame == "odom"
        import shapely

        moved = shapely.LineString(b.path.poses[:, :2] - (-100.0, 50.0))
        assert shapely.hausdorff_distance(moved, shapely.LineString(a.path.poses[:, :2])) < 1e-6

    @pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
    def test_poses_that_are_not_finite(self, bad: float) -> None:
        """InputError, with the name of the pose."""
        costmap = ascii_map(ROOM)
        good = pose_in(costmap, 3, 3)
        wrong = Pose2D(bad, good.y, good.yaw)
        for start, goal, name in ((wrong, good, "start"), (good, wrong, "goal")):
            with pytest.raises(InputError, match=name):
                self.make().make_plan(costmap, start, goal)

    @pytest.mark.parametrize(("dx", "dy"), [(-5.0, 0.0), (5.0, 0.0), (0.0, -5.0), (0.0, 5.0)])
    def test_poses_outside_the_map(self, dx: float, dy: float) -> None:
        """START_OUTSIDE_MAP (203); GOAL_OUTSIDE_MAP (204), or a plan that ends inside the map and says so."""
        costmap = ascii_map(ROOM)
        good = pose_in(costmap, 3, 3)
        wrong = Pose2D(good.x + dx, good.y + dy)
        with pytest.raises(StartOutsideMapError):
            self.make().make_plan(costmap, wrong, good)
        try:
            plan = self.make().make_plan(costmap, good, wrong)
        except GoalOutsideMapError:
            return
        assert costmap.geometry.world_to_cell(plan.goal.x, plan.goal.y) is not None
        assert plan.goal_moved_m > 0.0
        assert plan.notes

    @pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (3, 3), (1, 40)])
    @pytest.mark.parametrize("cost", [0, 253, 254, 255])
    def test_tiny_and_uniform_maps(self, shape: tuple[int, int], cost: int) -> None:
        """A plan or a PlanningError, never another exception."""
        costmap = Costmap(GridGeometry(shape[1], shape[0], RESOLUTION), np.full(shape, cost, np.uint8))
        start, goal = pose_in(costmap, 0, 0), pose_in(costmap, shape[1] - 1, shape[0] - 1)
        try:
            plan = self.make().make_plan(costmap, start, goal)
        except PlanningError as error:
            assert 200 <= error.code <= 299
        else:
            assert np.isfinite(plan.path.poses).all()
        assert (costmap.data == cost).all()


def global_planner_contract(
    plugin: type[GlobalPlanner], *, searches: bool = True, **values: Any
) -> type[GlobalPlannerContract]:
    """The suite for a global planner; `searches=False` for one that does not search around obstacles."""
    suite = contract_of(GlobalPlannerContract, plugin, values)
    suite.searches = searches
    return suite
