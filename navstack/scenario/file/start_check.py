"""Checks the start and the goals of a scenario against its map, before anything is driven."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from navstack.core import Footprint, OccupancyGrid, Pose2D
from navstack.parameters.configuration import Configuration
from navstack.parameters.findings import Finding, finding
from navstack.scenario.file.models import Parts
from navstack.sim import Shape
from navstack.sim.shapes import PedestrianMotion, Still
from navstack.sim.world import OCCUPIED


def check_start_on_map(parts: Parts, grid: OccupancyGrid) -> list[Finding]:
    """Returns an error if the start is outside the map or in a wall."""
    problem = None if parts.start is None else _problem_on_map(grid, parts.start)
    if parts.start is None or problem is None:
        return []
    message = f"the start ({parts.start.x:g}, {parts.start.y:g}) {problem}; move it"
    return [finding("error", "start", parts.start_location, "start", message)]


def check_goals_on_map(parts: Parts, grid: OccupancyGrid) -> list[Finding]:
    """Returns a warning for each goal outside the map or in a wall, unless the scenario expects it to fail."""
    findings: list[Finding] = []
    expected = parts.success.goals
    for i, (goal, at) in enumerate(zip(parts.goals, parts.goal_locations)):
        state = expected if isinstance(expected, str) else expected[i] if i < len(expected) else "any"
        problem = _problem_on_map(grid, goal)
        if problem is not None and state == "SUCCEEDED":
            message = (
                f"goal {i + 1} ({goal.x:g}, {goal.y:g}) {problem} and cannot be reached; move it, or expect ABORTED under "
                "`success: goals:`"
            )
            findings.append(finding("warning", "goal", at, "goals", message))
    return findings


def check_start_collision(parts: Parts, grid: OccupancyGrid, configuration: Configuration) -> list[Finding]:
    """Returns an error if the robot's footprint collides with an obstacle at the start."""
    if parts.start is None:
        return []
    obstacle = collision_at_start(configuration.local_costmap.true_footprint, parts.start, grid, parts.shapes)
    if obstacle is None:
        return []
    x, y, yaw = parts.start
    message = f"the robot at the start ({x:g}, {y:g}, {yaw:g}) collides with {obstacle}; move the start"
    return [finding("error", "start", parts.start_location, "start", message)]


def collision_at_start(
    footprint: Footprint, start: Pose2D, grid: OccupancyGrid, shapes: Sequence[Shape] = ()
) -> str | None:
    """Describes what the footprint collides with at the start; None if it is free. Uses shapely: compiles no kernel.

    Checks static `shapes` and pedestrians; the simulation checks shapes on tracks and doors.
    """
    outline = shapely.Polygon(footprint.at(start))
    cell = _occupied_cell(footprint, start, grid)
    if cell is not None:
        return f"a wall of the map at ({cell[0]:.2f}, {cell[1]:.2f})"
    for number, shape in enumerate(shapes, 1):
        if not isinstance(shape.motion, (Still, PedestrianMotion)):
            continue
        x, y, yaw = shape.pose
        if shape.radius is not None:
            collides = outline.distance(shapely.Point(x, y)) < shape.radius
        else:
            c, s = math.cos(yaw), math.sin(yaw)
            collides = outline.intersects(
                shapely.Polygon([(x + c * u - s * v, y + s * u + c * v) for u, v in shape.outline()])
            )
        if collides:
            return f'shape {number} "{shape.name}"' if shape.name else f"shape {number}"
    return None


def _occupied_cell(footprint: Footprint, start: Pose2D, grid: OccupancyGrid) -> tuple[float, float] | None:
    """Returns the centre (m, map) of an occupied cell that the footprint overlaps."""
    geometry = grid.geometry
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = start.x - geometry.origin_x, start.y - geometry.origin_y
    # the footprint in cells of the unrotated grid
    pose = Pose2D(c * dx + s * dy, c * dy - s * dx, start.yaw - grid.origin_yaw)
    outline = footprint.at(pose) / geometry.resolution
    last = np.array([geometry.nx - 1, geometry.ny - 1])
    low = np.clip(np.floor(outline.min(axis=0)), 0, last).astype(np.int64)
    high = np.clip(np.floor(outline.max(axis=0)), 0, last).astype(np.int64)
    iy, ix = np.nonzero(grid.data[low[1] : high[1] + 1, low[0] : high[0] + 1] >= OCCUPIED)
    ix, iy = ix + low[0], iy + low[1]
    cells = shapely.box(ix, iy, ix + 1, iy + 1)
    hit = np.nonzero(shapely.intersects(shapely.Polygon(outline), cells))[0]
    if not len(hit):
        return None
    u = (float(ix[hit[0]]) + 0.5) * geometry.resolution
    v = (float(iy[hit[0]]) + 0.5) * geometry.resolution
    return geometry.origin_x + c * u - s * v, geometry.origin_y + s * u + c * v


def _problem_on_map(grid: OccupancyGrid, pose: Pose2D) -> str | None:
    """Describes why the robot cannot be at a position of the map; None if it can."""
    geometry = grid.geometry
    # rotate the position back about the corner of a rotated map
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = pose.x - geometry.origin_x, pose.y - geometry.origin_y
    cell = geometry.world_to_cell(geometry.origin_x + c * dx + s * dy, geometry.origin_y + c * dy - s * dx)
    if cell is None:
        left, right, bottom, top = geometry.extent
        rotated = f", rotated by {grid.origin_yaw:g} rad about its origin" if grid.origin_yaw != 0.0 else ""
        return f"is outside the map, which covers x {left:g} .. {right:g}, y {bottom:g} .. {top:g} m{rotated}"
    return "is in a wall of the map" if grid.data[cell[1], cell[0]] >= OCCUPIED else None
