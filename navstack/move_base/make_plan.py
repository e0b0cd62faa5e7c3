"""move_base's service make_plan: planning without driving.

Source: move_base/src/move_base.cpp (planService).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from navstack.core import Bounds, Path, Pose2D
from navstack.core.errors import FrameError, InputError, PlanningError
from navstack.interfaces import CostmapServer, GlobalPlanner, Plan
from navstack.move_base import plugin_calls
from navstack.move_base.occupied_cell import add_layer
from navstack.parameters.models.move_base import MoveBaseParams


def make_plan(
    planner: GlobalPlanner,
    costmap: CostmapServer,
    params: MoveBaseParams,
    goal: Pose2D,
    start: Pose2D | None,
    *,
    tolerance: float,
    now: float | None,
) -> Plan:
    """Return a plan in the costmap's frame from `start`, or from the robot's pose at `now` (s; None: the newest pose).

    See `MoveBase.make_plan`. Raises InputError, FrameError and the planner's error for the goal itself.
    """
    if not math.isfinite(tolerance) or tolerance < 0.0:
        raise InputError(f"tolerance must be a distance in metres (0 or more), not {tolerance}", tolerance=tolerance)
    master = costmap.master
    robot: Pose2D | None = None
    try:
        robot = plugin_calls.call(costmap, costmap.robot_pose, now)
    except FrameError:
        if start is None:
            raise
    if start is None:
        assert robot is not None
        start = robot
    if params.make_plan_clear_costmap and robot is not None:
        radius = params.clearing_radius
        half = costmap.footprint.circumscribed_radius if radius is None else radius
        window = master.geometry.window_of(Bounds(robot.x, robot.y, robot.x, robot.y).grown(half))
        master = master.copy()
        master.data[window.slices] = 0
    try:
        return plugin_calls.make_plan(planner, master, start, goal, costmap.footprint)
    except PlanningError as exc:
        error = exc
    for near, offset in rings(goal, master.geometry.resolution, tolerance):
        try:
            plan = plugin_calls.make_plan(planner, master, start, near, costmap.footprint)
        except PlanningError:
            continue
        path = plan.path
        if params.make_plan_add_unreachable_goal:
            path = Path(np.vstack((path.poses, [tuple(goal)])), path.frame)
        note = f"the goal is unreachable ({error.name}); the plan ends {offset:.2f} m from it"
        return replace(plan, path=path, goal=near, goal_moved_m=offset, notes=(*plan.notes, note))
    raise add_layer(costmap, error)


def rings(goal: Pose2D, resolution: float, tolerance: float) -> list[tuple[Pose2D, float]]:
    """Return poses on growing square rings around `goal` and their distances from it (m), in move_base's order.

    The step is three cells, or `tolerance` (m) if that is smaller.
    """
    if tolerance <= 0.0:
        return []
    increment = min(3.0 * resolution, tolerance)
    count = int(tolerance / increment + 1e-9)
    found: list[tuple[Pose2D, float]] = []
    for ring in range(1, count + 1):
        for iy in range(ring + 1):
            for ix in range(ring + 1):
                if ix < ring and iy < ring:
                    continue
                for sign_y in (-1.0, 1.0) if iy else (1.0,):
                    for sign_x in (-1.0, 1.0) if ix else (1.0,):
                        dx, dy = sign_x * ix * increment, sign_y * iy * increment
                        found.append((Pose2D(goal.x + dx, goal.y + dy, goal.yaw), math.hypot(dx, dy)))
    return found
