"""Validation of poses passed by users."""

from __future__ import annotations

from navstack.core.errors import InputError, StartOutsideMapError
from navstack.core.geometry import Pose2D
from navstack.core.occupancy import OccupancyGrid


def require_pose(value: object, what: str) -> Pose2D:
    """Return `value` if it is a Pose2D. Raises InputError for a plain tuple and all other types."""
    if isinstance(value, Pose2D):
        return value
    raise InputError(f"the {what} {value!r} is not a Pose2D; pass navstack.Pose2D(x, y, yaw) in meters and radians")


def require_finite_pose(value: object, what: str) -> Pose2D:
    """Return `value` if it is a Pose2D of finite numbers. Raises InputError otherwise."""
    pose = require_pose(value, what)
    if not pose.is_finite():
        raise InputError(f"the {what} {tuple(pose)} is not finite; give x,y,yaw in meters and radians", pose=pose)
    return pose


def start_outside_map(grid: OccupancyGrid, start: Pose2D) -> StartOutsideMapError:
    """Return the error of a start that is outside the map."""
    left, right, bottom, top = grid.geometry.extent
    return StartOutsideMapError(
        f"the start ({start.x:g}, {start.y:g}) is outside the map, which covers x {left:g} .. {right:g}, "
        f"y {bottom:g} .. {top:g} m",
        pose=start,
    )
