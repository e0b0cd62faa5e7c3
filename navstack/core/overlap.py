"""Leaving lethal cells under the footprint: whether a motion leads away from what the robot touches, or nearly touches.

A mark can overlap a robot at rest: its cell is coarse, the footprint is padded, and a bumper marks what the robot has hit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core.collision import overlaps_obstacle
from navstack.core.costs import LETHAL
from navstack.core.footprint import Footprint
from navstack.core.geometry import Pose2D
from navstack.core.grid import Costmap, grid_record
from navstack.core.overlap_kernels import comes_nearer, free_scale, lethal_cells_under, place_scaled

ROUND = 0.95
"""A footprint whose inscribed radius exceeds this share of its circumscribed radius is round: turns bring it no nearer."""
PASSABLE = 252
"""Cost of the cells under the footprint while it leaves them, and of inscribed cells: the footprint itself is checked."""
MAX_CELLS = 4096
"""Lethal cells under the footprint, at most, for which a way out is looked for."""


def is_nearly_round(footprint: Footprint) -> bool:
    """True if turns in place bring the footprint no nearer to anything."""
    return footprint.inscribed_radius >= ROUND * footprint.circumscribed_radius


def without_lethal(costmap: Costmap) -> Costmap:
    """A copy in which lethal cells are passable: what else blocks a motion (unknown cells, the border)?"""
    data = costmap.data.copy()
    data[data == LETHAL] = PASSABLE
    return Costmap(costmap.geometry, data, costmap.frame)


def leads_away(costmap: Costmap, footprint: Footprint, poses: NDArray[np.float64]) -> bool:
    """True if a motion comes no nearer to the lethal cells under the footprint at its first pose, and overlaps no other.

    `poses` (n, 3): x, y (m) and yaw (rad) in the costmap's frame. For one command per cycle; controllers that sample
    velocities select among the samples.
    """
    grid, corners = grid_record(costmap.geometry), footprint.vertices.T.copy()
    placed, found = np.empty_like(corners), np.empty((MAX_CELLS, 2), np.int64)
    start = np.ascontiguousarray(poses[0])
    if costmap.cost_at(*start[:2].tolist()) == LETHAL or not footprint.contains_center:
        return False
    place_scaled(corners, 1.0, start, grid, placed)
    number = lethal_cells_under(costmap.data, placed, found)
    if number > MAX_CELLS:
        return False
    cells = found[:number].copy()
    others = costmap.data.copy()
    others[cells[:, 1], cells[:, 0]] = PASSABLE
    scale = 0.0 if is_nearly_round(footprint) else free_scale(corners, start, grid, cells)
    for pose in poses[1:]:
        if number and comes_nearer(corners, scale, pose, start, grid, cells, placed):
            return False
        place_scaled(corners, 1.0, pose, grid, placed)
        if lethal_cells_under(others, placed, found):
            return False
    return True


def excusing_overlap(costmap: Costmap, footprint: Footprint, poses: NDArray[np.float64]) -> Costmap:
    """The costmap for the check of a motion; without lethal cells if the motion leads away from those under the footprint.

    `poses` (n, 3): see `leads_away`. ROS differs: in ROS and Nav2 a robot whose footprint overlaps an obstacle may not move.
    """
    start = Pose2D(*poses[0].tolist())
    if overlaps_obstacle(costmap, footprint, start) and leads_away(costmap, footprint, poses):
        return without_lethal(costmap)
    return costmap
