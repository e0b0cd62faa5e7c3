"""The critics of DWA if the parameters list none."""

from __future__ import annotations

DEFAULT_CRITICS: tuple[str, ...] = (
    "oscillation",
    "obstacle",
    "goal_front",
    "alignment",
    "path",
    "goal",
    "twirling",
)
"""The seven critics of move_base, in its order: the first that rejects a rollout gives the reason."""
