"""How a component declares its parameters: a pydantic model beside the plugin, one field per ROS parameter.

The default of a field is the EFFECTIVE default: what a user of noetic really gets with an empty YAML.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field


class ParamModel(BaseModel):
    """Base of all parameter models: strict types (an int may stand for a float), no unknown keys, no NaN, immutable.

    What cannot be said by a field is said by class variables:

    - `RENAMED`: a name of former releases -> today's name. Honoured, with a note.
    - `NO_EFFECT`: a name that ROS reads or once read without any effect -> why. Accepted, with a note.
    - `SEARCHED`: fields looked up in the enclosing namespaces when absent (ROS searchParam).
    - `FROM_PARENT`: fields that the enclosing namespace overrides when it has them (costmap_2d copyParentParameters).
    - `FROM_NAVSTACK`: fields taken from the `navstack:` section, which is ours (`ros_distro`).
    - `CHILD_FIELD` with `child_models`: namespaces below this one whose names the values decide (observation sources).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    RENAMED: ClassVar[Mapping[str, str]] = {}
    NO_EFFECT: ClassVar[Mapping[str, str]] = {}
    SEARCHED: ClassVar[frozenset[str]] = frozenset()
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset()
    FROM_NAVSTACK: ClassVar[frozenset[str]] = frozenset()
    CHILD_FIELD: ClassVar[str | None] = None

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Names of the namespaces below this one and the model of each, given this namespace's own raw values.

        The loader puts the loaded children, by name, into the field that `CHILD_FIELD` names.
        """
        del values
        return {}


def param(
    default: Any,
    meaning: str,
    *,
    unit: str = "",
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    lt: float | None = None,
    ros_differs: str = "",
) -> Any:
    """A parameter: its effective default, its meaning in a sentence, unit and range (inclusive `ge`/`le`, else `gt`/`lt`).

    `ros_differs` says what the original does otherwise (parity).
    """
    bounds: dict[str, Any] = {k: v for k, v in {"ge": ge, "gt": gt, "le": le, "lt": lt}.items() if v is not None}
    extra: dict[str, Any] = {"unit": unit, "ros_differs": ros_differs}
    return Field(default, description=meaning, json_schema_extra=extra, **bounds)


class PluginSpec(ParamModel):
    """One entry of a plugin list: `{name: inflation_layer, type: "costmap_2d::InflationLayer"}`."""

    name: str = Field(description="instance name, which is also the namespace of its parameters", min_length=1)
    type: str = Field(description="plugin type, by its ROS name or navstack's", min_length=1)
