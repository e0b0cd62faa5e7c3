"""Checks before the robot or an obstacle is put somewhere."""

from __future__ import annotations

from navstack.core import Footprint, Pose2D
from navstack.core.errors import InputError
from navstack.sim.crowd import Crowd
from navstack.sim.solids import Solids, concatenate_solids
from navstack.sim.world import World


def all_solids(world: World, crowd: Crowd | None, time: float) -> Solids:
    """Returns the solids of the world at `time` (s), and the pedestrians."""
    solids = world.solids_at(time)
    return solids if crowd is None else concatenate_solids([solids, crowd.solids()])


def check_pose(world: World, footprint: Footprint, pose: Pose2D, solids: Solids, *, start: bool = False) -> None:
    """Raises InputError if the footprint collides at `pose` (map frame); `start` words the message for the start of a run."""
    hit = world.collision(footprint, pose, solids=solids)
    if hit is not None:
        kind, _, x, y = hit
        where = "the robot at the start " if start else "the robot at "
        hint = "move the start" if start else "put it elsewhere"
        raise InputError(
            f"{where}({pose.x:g}, {pose.y:g}, {pose.yaw:g}) collides with the {kind} at ({x:.2f}, {y:.2f}); {hint}",
            pose=pose,
        )


def check_obstacles(world: World, footprint: Footprint, pose: Pose2D, solids: Solids) -> None:
    """Raises InputError, naming the obstacle, if one of the solids overlaps the footprint at `pose` (map frame)."""
    hit = world.collision(footprint, pose, solids=solids)
    if hit is not None:
        kind, index, x, y = hit
        name = world.name_of(kind, index)
        what = f'"{name}"' if name else f"the {kind}"
        raise InputError(f"{what} at ({x:.2f}, {y:.2f}) would overlap the robot; put it elsewhere", at=[x, y])
