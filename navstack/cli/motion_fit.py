"""Where on a packaged map a shape has room."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.core import Pose2D
    from navstack.motion import Trajectory
    from navstack.places import Places
    from navstack.scenario import Scenario

HEADINGS = tuple(k * math.pi / 6.0 for k in range(12))
"""Headings that are tried at each place (rad)."""
CHECKS = 120
"""Number of poses of the trajectory that are checked."""
ROOM_M = 0.15
"""Distance that the footprint keeps from walls: a robot with slip leaves the trajectory by some centimetres."""


def roomy_start(scenario: Scenario, trajectory: Trajectory, places: Places) -> tuple[str, Pose2D] | None:
    """Returns the first place, with a heading, at which the footprint has ROOM_M along the trajectory; None if there is none.

    The start of the map comes first, with its own heading.
    """
    from navstack.core import Pose2D

    first = next((name for name, pose in places.places.items() if pose == places.start_pose), "the start")
    candidates = [(first, places.start)]
    candidates += [(name, Pose2D(p.x, p.y, yaw)) for name, p in places.places.items() for yaw in HEADINGS]
    return next(((name, pose) for name, pose in candidates if _is_free(scenario, trajectory, pose)), None)


def _is_free(scenario: Scenario, trajectory: Trajectory, start: Pose2D) -> bool:
    import numpy as np

    from navstack.core import Pose2D

    world, footprint = scenario.world(), scenario.configuration.global_costmap.true_footprint
    poses = trajectory.moved_to(start, "map").poses(np.linspace(0.0, trajectory.duration, CHECKS))
    if not all(world.contains(Pose2D(*pose)) for pose in poses.tolist()):
        return False
    return bool((world.clearances(poses, footprint, world.solids_at(0.0)) >= ROOM_M).all())
