"""Records that the kernels of the search over poses share. Lengths are in cells, angles in radians."""

from __future__ import annotations

import mmap
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

PRIMITIVE: Final = np.dtype(
    [
        ("dx", "f8"),  # end of the primitive, relative to its start
        ("dy", "f8"),
        ("length", "f8"),  # signed: negative when driven backward
        ("end", "i8"),  # heading bins turned (hybrid), or the number of the end heading (lattice)
        ("turn", "i8"),  # class for change_penalty: 0 straight, 1 left, 2 right
        ("reverse", "i8"),
        ("in_place", "i8"),
        ("first", "i8"),  # first row of its samples
        ("count", "i8"),  # number of samples, the end included
        ("piece", "i8"),  # first row of the pieces that it consists of
        ("pieces", "i8"),  # number of pieces
    ]
)
HEADING: Final = np.dtype([("cos", "f8"), ("sin", "f8"), ("yaw", "f8"), ("first", "i8"), ("count", "i8")])
"""Rotation of the primitives of a heading bin, its yaw, and the rows of its primitives."""
NODE: Final = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("key", "i8"),
        ("g", "f4"),
        ("parent", "i4"),
        ("heading", "i2"),
        ("primitive", "i2"),
        ("closed", "i2"),
        ("direction", "i2"),  # of travel on the way there: 1 forward, -1 backward, 0 at the start
    ]
)
"""A visited state: 40 bytes."""
ENTRY: Final = np.dtype([("next_entry", "i4"), ("node", "i4")])
"""An entry of the queue of the search, or of the obstacle heuristic: a linked list per bucket."""
FIELD: Final = np.dtype([("cost", "f4"), ("code", "u1")])
"""A cell of the obstacle heuristic, in 5 bytes: cost 0 untouched, negative open, positive closed; code of a step into it."""
SEGMENT: Final = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("yaw", "f8"),
        (
            "kind_",
            "i8",
        ),  # of navstack.global_planner._curves; 0 turns in place, -1 holonomic (a straight line in any direction)
        ("size", "f8"),  # signed length; the angle of a turn in place
        ("radius", "f8"),
        ("sideways", "f8"),  # direction of a holonomic line, relative to the yaw
        ("turn", "f8"),  # angle by which the yaw changes along a holonomic line
    ]
)
"""A piece of a path, from the pose where it begins."""

SETTINGS: Final = np.dtype(
    [
        # --- the grid and the robot
        ("unknown_blocked", "i8"),
        ("corners", "i8"),  # of the footprint; 0: round, the costs of the cells decide
        ("convex", "i8"),
        ("reach", "f8"),  # circumscribed radius of the padded footprint
        ("sample_step", "f8"),  # largest motion of a point of the footprint between samples of a primitive
        ("fine_step", "f8"),  # largest motion between checks with the fine padding
        ("bins", "i8"),
        ("rotates", "i8"),  # whether primitives turn with the heading (hybrid), or each heading has its own (lattice)
        ("turn_step", "f8"),  # largest angle of a turn in place, 0: there are none
        ("holonomic", "i8"),
        # --- costs
        ("cost_penalty", "f8"),
        ("base_cost", "f8"),  # of a cell: 1 - retrospective_penalty
        ("non_straight", "f8"),
        ("change", "f8"),
        ("reverse", "f8"),
        ("rotation", "f8"),
        ("cusp", "f8"),  # cost of a change between forward and backward; above 0, states have a direction of travel
        ("quadratic", "i8"),
        # --- curves to the goal
        ("radius", "f8"),
        ("reeds_shepp", "i8"),  # which curves are tried: FORWARD, SHORTEST or CHEAPEST
        ("expansion_ratio", "f8"),
        ("expansion_length", "f8"),
        ("expansion_cost", "f8"),
        ("expansion_override", "i8"),
        ("coarse", "i8"),  # coarse_search_resolution
        # --- heuristics
        ("factor", "i8"),  # cells per cell of the obstacle heuristic
        ("half", "i8"),  # half the side of the distance table
        ("weight", "f8"),
        ("patience", "i8"),  # expansions after which it grows
        ("slack", "f8"),  # a curve to the goal is accepted if it costs at most this factor times the least estimate
        # --- limits
        ("max_expansions", "i8"),
        ("pause_at", "i8"),
        ("tolerance", "f8"),
        ("approach_limit", "i8"),
        ("goal_x", "f8"),
        ("goal_y", "f8"),
        # --- state of the obstacle heuristic
        ("focus_x", "i8"),
        ("focus_y", "i8"),
        ("level", "i8"),
        ("open_cells", "i8"),
        ("closed_cells", "i8"),
        ("step_weights", "f4", (256,)),  # cost of a step into a cell, by its code
        ("front_used", "i8"),  # entries of its queue, the buckets included
        ("front_free", "i8"),  # first one of those that are free again
        ("low_x", "i8"),  # the box around them
        ("high_x", "i8"),
        ("low_y", "i8"),
        ("high_y", "i8"),
        # --- state of the search
        ("nodes", "i8"),
        ("entries", "i8"),
        ("free_entry", "i8"),
        ("queued", "i8"),
        ("bucket", "i8"),
        ("expanded", "i8"),
        ("countdown", "f8"),
        ("nearest_h", "f8"),
        ("best_node", "i8"),
        ("best_goal", "i8"),
        ("best_cost", "f8"),
        ("best_radius", "f8"),
        ("best_is_curve", "i8"),
        ("best_tail", "f8"),  # straight way after the curve, signed
        ("approach_node", "i8"),
        ("approach_distance", "f8"),
        ("approach_since", "i8"),
    ]
)


# ----------------------------------------------------------------------------------------------------------------------
# Large arrays of which a search touches little.


_SMALL: Final = 1 << 22
"""Bytes: numpy asks for huge pages from here on."""


def untouched_zeros(count: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return zeros (count,) whose pages are created when they are touched, 4 kB each.

    `np.zeros` of megabytes asks for huge pages: one access then clears 2 MB, which takes longer than a short search.
    """
    size = count * dtype.itemsize
    if size < _SMALL or not hasattr(mmap, "MAP_PRIVATE"):
        return np.zeros(count, dtype)
    return np.frombuffer(mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS), dtype)


@lru_cache(maxsize=6)
def curve_table(half: int, bins: int, radius: float, cusp: float | None) -> NDArray[np.float32]:
    """The lengths of curves that are known so far, shared by all searches for the same curves: a length is always the same."""
    del radius, cusp  # None: Dubins
    return untouched_zeros((2 * half + 1) * (half + 1) * bins, np.dtype(np.float32))
