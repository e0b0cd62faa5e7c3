"""The motion models of MPPI: `motion_model: diff_drive` and `diff_drive: {plugin: "mppi::DiffDriveMotionModel"}`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pydantic import field_validator

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import PluginSection

DIFF, OMNI, ACKERMANN = "mppi::DiffDriveMotionModel", "mppi::OmniMotionModel", "mppi::AckermannMotionModel"
FORMER: Final[Mapping[str, str]] = {"DiffDrive": DIFF, "Omni": OMNI, "Ackermann": ACKERMANN}
"""Names of the motion models in Nav2 up to Kilted, where they have no namespace."""
FORMER_CONSTRAINTS: Final = "AckermannConstraints"
USUAL: Final[Mapping[str, str]] = {"diff_drive": DIFF, "omni": OMNI, "ackermann": ACKERMANN}
"""The plugin of a motion model that has no namespace, by its name."""


class MotionModelParams(PluginSection):
    """The kind of the base."""

    plugin: str = param(DIFF, f"{DIFF}, {OMNI} or {ACKERMANN}")
    min_turning_r: float = param(0.2, "smallest turning radius of the Ackermann model", unit="m", gt=0.0)

    @field_validator("plugin")
    @classmethod
    def _check_plugin(cls, value: str) -> str:
        if value.replace("/", "::") not in FORMER.values():
            raise ValueError(f'unknown motion model "{value}"; known: {", ".join(FORMER.values())}')
        return value.replace("/", "::")


class FormerConstraints(ParamModel):
    """`AckermannConstraints` of Nav2 up to Kilted."""

    min_turning_r: float = param(0.2, "smallest turning radius", unit="m", gt=0.0)


def model_of_namespace(values: Mapping[str, Any]) -> tuple[str, type[ParamModel]]:
    """Return the namespace of the motion model that `values` select, and its parameter model."""
    name = values.get("motion_model", "diff_drive")
    if name in FORMER or not isinstance(name, str):
        return FORMER_CONSTRAINTS, FormerConstraints
    return name, MotionModelParams


def motion_model(name: str, sections: Mapping[str, Any]) -> MotionModelParams:
    """Return the motion model of a name, by the parameters of its namespace."""
    if name in FORMER:
        former = sections.get(FORMER_CONSTRAINTS) or FormerConstraints()
        return MotionModelParams(plugin=FORMER[name], min_turning_r=former.min_turning_r)
    written = sections.get(name)
    if isinstance(written, MotionModelParams) and "plugin" in written.model_fields_set:
        return written
    radius = written.min_turning_r if isinstance(written, MotionModelParams) else 0.2
    return MotionModelParams(plugin=USUAL.get(name, DIFF), min_turning_r=radius)
