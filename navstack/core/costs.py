"""The cost values of costmap_2d (cost_values.h)."""

from __future__ import annotations

from typing import Final

FREE: Final = 0
"""Nothing near."""
INSCRIBED: Final = 253
"""The robot's centre here means contact, whatever its heading."""
LETHAL: Final = 254
"""An obstacle is in this cell."""
UNKNOWN: Final = 255
"""Nobody has looked."""


def describe_cost(cost: int) -> str:
    """A cost in words, for messages: "lethal (254)"."""
    if cost == UNKNOWN:
        return "unknown (255)"
    if cost == LETHAL:
        return "lethal (254)"
    if cost == INSCRIBED:
        return "inscribed (253)"
    if cost == FREE:
        return "free (0)"
    return f"inflated ({cost})"
