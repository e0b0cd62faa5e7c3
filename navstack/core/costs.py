"""The cost values of costmap_2d (cost_values.h)."""

from __future__ import annotations

from typing import Final

FREE: Final = 0
"""No obstacle nearby."""
INSCRIBED: Final = 253
"""The robot is in collision if its center is in this cell, at any heading."""
LETHAL: Final = 254
"""The cell contains an obstacle."""
UNKNOWN: Final = 255
"""The cell has not been observed."""


def describe_cost(cost: int) -> str:
    """Describe a cost for messages: "lethal (254)"."""
    if cost == UNKNOWN:
        return "unknown (255)"
    if cost == LETHAL:
        return "lethal (254)"
    if cost == INSCRIBED:
        return "inscribed (253)"
    if cost == FREE:
        return "free (0)"
    return f"inflated ({cost})"
