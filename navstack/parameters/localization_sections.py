"""The sections of localization: amcl, its supervision, and the odometry filter ekf."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from navstack.core.parameters import ParamModel
from navstack.parameters.binding import Binder
from navstack.parameters.findings import Finding
from navstack.parameters.models.amcl import AmclParams
from navstack.parameters.models.ekf import STATES, EkfParams, FilterParams
from navstack.parameters.models.supervision import SearchingParams
from navstack.parameters.safety_sections import SAFETY_MODELS, unwrap_ros2
from navstack.parameters.tree import Space

LOCALIZATION_MODELS: Final[dict[str, type[ParamModel]]] = {
    "amcl": AmclParams,
    "supervision": SearchingParams,
    "ekf": EkfParams,
}
"""Section -> its model."""
NODE_MODELS: Final[dict[str, type[ParamModel]]] = {**SAFETY_MODELS, **LOCALIZATION_MODELS}
"""Every section beside move_base's that belongs to a node of its own in ROS."""


def default_filter() -> FilterParams:
    """Return the parameters of a filter of wheels and a gyroscope."""
    config: dict[str, Any] = {
        "odom0_config": [state in ("vx", "vy", "vyaw") for state in STATES],
        "imu0_config": [state == "vyaw" for state in STATES],
    }
    return EkfParams(**config)


@dataclass(frozen=True, slots=True)
class LocalizationConfiguration:
    """The parameters of localization; None for what is not written."""

    amcl: AmclParams | None = None
    supervision: SearchingParams | None = None
    ekf: FilterParams | None = None

    def sections(self) -> list[tuple[str, ParamModel | None]]:
        """Return every section by name, with its parameters."""
        return [(name, getattr(self, name)) for name in LOCALIZATION_MODELS]


def load_localization(root: Space, binder: Binder, findings: list[Finding]) -> LocalizationConfiguration | None:
    """Return the sections that are written, None if one of them cannot be used."""
    made: dict[str, Any] = {}
    for name, model in LOCALIZATION_MODELS.items():
        if name in root.children:
            space = binder.child(root, name)
            unwrap_ros2(space, findings)
            made[name] = binder.bind(model, space)
    return None if any(params is None for params in made.values()) else LocalizationConfiguration(**made)
