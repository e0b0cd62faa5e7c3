"""Poses that users hand over."""

from __future__ import annotations

from navstack.core.errors import InputError
from navstack.core.geometry import Pose2D


def require_pose(value: object, what: str) -> Pose2D:
    """`value` if it is a Pose2D. Raises InputError, with the way out, for a plain tuple and anything else."""
    if isinstance(value, Pose2D):
        return value
    raise InputError(f"the {what} {value!r} is no Pose2D; give navstack.Pose2D(x, y, yaw) in metres and radians")
