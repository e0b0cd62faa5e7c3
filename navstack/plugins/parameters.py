"""How a component declares its parameters: a pydantic model next to the plugin, one field per ROS parameter.

The default of a field is the EFFECTIVE default: the value that a user of noetic gets with an empty YAML.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field
from typing_extensions import TypeVar

from navstack.plugins.checks import CheckContext, Issue, own_issues


class ParamModel(BaseModel):
    """Base of all parameter models: strict types (an int is accepted for a float), no unknown keys, no NaN, immutable.

    Class variables declare what a field cannot:

    - `RENAMED`: previous name -> current name. The value is used, with a note.
    - `NO_EFFECT`: a name that ROS reads, or read once, without any effect -> reason. Accepted, with a note.
    - `SEARCHED`: fields looked up in the enclosing namespaces if absent (ROS searchParam).
    - `FROM_PARENT`: fields that the enclosing namespace overrides (costmap_2d copyParentParameters).
    - `CLAMPED`: fields that ROS clamps to their range (dynamic_reconfigure, or its code). Such a value is clamped here too, with
      a warning; a value outside of any other range is an error.
    - `FROM_NAVSTACK`: fields taken from the `navstack:` section, which ROS does not read (`ros_distro`).
    - `CHILD_FIELD` with `child_models`: namespaces below this one whose names depend on values (observation sources).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)

    RENAMED: ClassVar[Mapping[str, str]] = {}
    NO_EFFECT: ClassVar[Mapping[str, str]] = {}
    SEARCHED: ClassVar[frozenset[str]] = frozenset()
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset()
    FROM_NAVSTACK: ClassVar[frozenset[str]] = frozenset()
    CLAMPED: ClassVar[frozenset[str]] = frozenset()
    CHILD_FIELD: ClassVar[str | None] = None

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the names of the namespaces below this one and their models, for this namespace's raw values.

        `values` has the namespaces below, too, as dictionaries: the type of a plugin may be written there.
        The loader stores the loaded children, by name, in the field that `CHILD_FIELD` names.
        """
        del values
        return {}

    @classmethod
    def shared_children(cls, values: Mapping[str, Any]) -> frozenset[str]:
        """Return those of `child_models` that may stand next to this namespace instead of below it."""
        del values
        return frozenset()

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield the combinations of parameters, these and the robot's others, that do not work together.

        Called for every plugin in use when parameters are loaded or checked. By default, what the methods with the decorator
        `rule` find: a rule belongs to the model of the plugin that it concerns.
        """
        return own_issues(self, context)


P = TypeVar("P", bound=ParamModel, default=Any)
"""The parameter model of a plugin: `class StaticLayer(Layer[StaticLayerParams])`."""


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
    """Declare a parameter: effective default, meaning in one sentence, unit and range (`ge`/`le` inclusive, `gt`/`lt` not).

    `ros_differs` describes a deliberate difference from ROS.
    """
    bounds: dict[str, Any] = {k: v for k, v in {"ge": ge, "gt": gt, "le": le, "lt": lt}.items() if v is not None}
    extra: dict[str, Any] = {"unit": unit, "ros_differs": ros_differs}
    return Field(default, description=meaning, json_schema_extra=extra, **bounds)


class PluginSpec(ParamModel):
    """One entry of a plugin list: `{name: inflation_layer, type: "costmap_2d::InflationLayer"}`."""

    name: str = Field(description="instance name, which is also the namespace of its parameters", min_length=1)
    type: str = Field(description="plugin type, by its ROS name or navstack's", min_length=1)
