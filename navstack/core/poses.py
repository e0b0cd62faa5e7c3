"""Validation of poses passed by users."""

from __future__ import annotations

from navstack.core.errors import InputError
from navstack.core.geometry import Pose2D


def require_pose(value: object, what: str) -> Pose2D:
    """Return `value` if it is a Pose2D. Raises InputError for a plain tuple and all other types."""
    if isinstance(value, Pose2D):
        return value
    raise InputError(f"the {what} {value!r} is not a Pose2D; pass navstack.Pose2D(x, y, yaw) in metres and radians")
