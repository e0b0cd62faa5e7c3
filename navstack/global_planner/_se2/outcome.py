"""What a search over poses found."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.curves.curve_kernels import LEFT, RIGHT
from navstack.global_planner._se2 import _path_kernels as paths
from navstack.global_planner._se2 import _search_kernels as kernels

Pose = tuple[float, float, float]
"""x, y (cells) and yaw."""


@dataclass(frozen=True)
class Outcome:
    """What a search found: a path, or why there is none."""

    status: int
    """Of the kernels: FOUND, EXHAUSTED, LIMIT, APPROACHED."""
    segments: NDArray[np.void]
    """Pieces of the path (SEGMENT), empty without one."""
    end: Pose
    """Where the path ends (cells, rad)."""
    cost: float
    expanded: int
    visited: int
    nearest: tuple[float, float]
    """The visited position nearest to the goal (cells)."""
    timed_out: bool
    enclosed: float | None = None
    """How far from the goal all poses are from which it can be reached (cells); None if that is not known."""
    impossible: bool = False
    """Whether the footprint itself does not fit through to the goal, whatever the turning radius."""

    @property
    def reached(self) -> bool:
        """Whether the path ends at a goal itself."""
        return self.status == kernels.FOUND

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return self.status in (kernels.FOUND, kernels.APPROACHED)


def poses_of(outcome: Outcome, spacing: float) -> NDArray[np.float64]:
    """Poses (n, 3) of a path, at most `spacing` cells apart (cells, rad)."""
    goal = outcome.end
    none = np.zeros((0, 3))
    turn = math.radians(10.0)
    out = np.zeros((int(paths.poses_of(outcome.segments, goal, spacing, turn, none)), 3))
    paths.poses_of(outcome.segments, goal, spacing, turn, out)
    return out


def turned_around(segments: NDArray[np.void], end: Pose) -> NDArray[np.void]:
    """Return the pieces of a path to `end` as those of the path back, of a robot that looks the other way.

    Where the one drives forward, so does the other; its arcs to the left are arcs to the right.
    """
    back = segments[::-1].copy()
    for name, last in zip(("x", "y", "yaw"), end, strict=True):
        back[name][0] = last
        back[name][1:] = segments[name][:0:-1]
    back["yaw"] -= math.pi
    kind = segments["kind_"][::-1]
    back["kind_"] = np.select([kind == LEFT, kind == RIGHT], [RIGHT, LEFT], kind)
    back["size"] = np.where(kind == paths.IN_PLACE, -back["size"], back["size"])
    back["turn"] = -back["turn"]
    course = (segments["yaw"] + segments["sideways"])[::-1]
    back["sideways"] = np.where(kind == paths.SIDEWAYS, course + math.pi - back["yaw"], 0.0)
    return back
