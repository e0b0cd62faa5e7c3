"""Registers the environments with Gymnasium."""

from __future__ import annotations

from navstack.core import require

gymnasium = require("gymnasium", "navstack.gym")

_MODULES = {
    "LocalControl": ("local_control:LocalControlEnv", "local_control:LocalControlVectorEnv"),
    "PlannerParams": ("stack:PlannerParamsEnv", ""),
    "Residual": ("stack:ResidualEnv", ""),
}


def register() -> None:
    """Register `navstack/NAME-v0`; the classes are imported when an environment is made."""
    for name, (single, vector) in _MODULES.items():
        if f"navstack/{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                f"navstack/{name}-v0",
                entry_point=f"navstack.gym.{single}",
                vector_entry_point=f"navstack.gym.{vector}" if vector else None,
            )


register()
