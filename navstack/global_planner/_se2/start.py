"""What to do when the robot overlaps obstacles where it starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from navstack.core import FREE, INSCRIBED, Costmap, Footprint, Pose2D, describe_cost
from navstack.core.errors import StartOccupiedError
from navstack.global_planner._se2.engine import PoseSearch
from navstack.global_planner._se2.footprint import FINE, Shape, shape_of
from navstack.global_planner._se2.params import PosePlannerParams
from navstack.global_planner._search.cells import cell_coordinates

_NOTE = "the robot overlaps obstacles at the start; the cells under its footprint were treated as free"


def cleared_start(
    engine: PoseSearch,
    grid: Costmap,
    start: Pose2D,
    footprint: Footprint | None,
    shape: Shape,
    params: PosePlannerParams,
) -> tuple[Costmap, str | None]:
    """Prepare the search over `grid`, in which cells under a blocked start count as free; return it with a note.

    Raises StartOccupiedError if the policy does not allow that.
    """
    engine.place(grid.data, shape)
    x, y = cell_coordinates(grid.geometry, start)
    if fits(engine, footprint, grid.geometry.resolution, lambda: engine.pose_is_free(x, y, start.yaw)):
        return grid, None
    cost = int(grid.data[int(y), int(x)])
    if params.start_policy in ("refuse", "nearest_free"):
        raise StartOccupiedError(
            f"the robot overlaps obstacles at the start ({start.x:.3f}, {start.y:.3f}, {start.yaw:.3f}), where the cost of its "
            f"cell is {describe_cost(cost)}, and start_policy is {params.start_policy}; this planner can start at the pose of "
            "the robot only: move it, or set start_policy: clear_footprint",
            x=start.x,
            y=start.y,
            yaw=start.yaw,
            cost=cost,
        )
    copy = grid.copy()
    copy.data[int(y), int(x)] = FREE
    if params.start_policy == "clear_footprint" and footprint is not None:
        under = _under(copy, footprint, start)
        copy.data[under] = np.where(copy.data[under] >= INSCRIBED, FREE, copy.data[under])
    engine.place(copy.data, shape)
    if engine.pose_is_free(x, y, start.yaw):
        return copy, _NOTE
    raise StartOccupiedError(
        f"the robot overlaps obstacles or the outside of the map at the start ({start.x:.3f}, {start.y:.3f}, {start.yaw:.3f}), "
        f"which start_policy: {params.start_policy} does not clear; move it"
        + ("" if params.start_policy == "clear_footprint" else ", or set start_policy: clear_footprint"),
        x=start.x,
        y=start.y,
        yaw=start.yaw,
        cost=cost,
    )


def fits(engine: PoseSearch, footprint: Footprint | None, resolution: float, is_free: Callable[[], bool]) -> bool:
    """Whether `is_free` returns True with one of the fine paddings; the search continues with the first one of them."""
    if is_free():
        return True
    if engine.shape.corners == 0:
        return False
    before = engine.shape
    for fine in FINE[1:]:
        engine.use(shape_of(footprint, resolution, fine))
        if engine.shape.fine_step < before.fine_step and is_free():
            return True
    engine.use(before)
    return False


def _under(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> tuple[np.ndarray, np.ndarray]:
    """Indices (iy, ix) of the cells that the footprint overlaps, with the fine padding: no others may be driven over."""
    g = costmap.geometry
    polygon = shapely.Polygon(footprint.at(pose)).buffer(
        1.01 * FINE[0] * g.resolution, join_style="mitre", mitre_limit=3.0
    )
    left, low, right, high = polygon.bounds
    x0, y0 = g.world_to_cell_unbounded(left, low)
    x1, y1 = g.world_to_cell_unbounded(right, high)
    xs, ys = np.meshgrid(np.arange(max(x0, 0), min(x1 + 1, g.nx)), np.arange(max(y0, 0), min(y1 + 1, g.ny)))
    x, y = g.origin_x + xs * g.resolution, g.origin_y + ys * g.resolution
    inside = shapely.intersects(polygon, shapely.box(x, y, x + g.resolution, y + g.resolution))
    return ys[inside], xs[inside]
