"""Namespaces that name their plugin (`goal_checker: {plugin: ..}`): the model that reads them, and the plugin they make."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, TypeVar

from pydantic import field_validator

from navstack.core import UnknownPluginError
from navstack.plugins import ParamModel, PluginSection, Registry, param

T = TypeVar("T")


def section_model(registry: Registry[Any], values: Mapping[str, Any], name: str, default: str) -> type[ParamModel]:
    """Return the model of the namespace `name`, by the `plugin` written there or the type `default`.

    `values` are the raw values of the enclosing namespace, as `ParamModel.child_models` gets them.
    """
    written = values.get(name)
    kind = written.get("plugin", default) if isinstance(written, Mapping) else default
    if isinstance(kind, str) and kind in registry:
        return registry.get(kind).cls.Params
    return _unknown(registry)


def make_section(registry: Registry[T], sections: Mapping[str, Any], name: str, default: str) -> T:
    """Return the plugin of the namespace `name`, with its defaults if it is not written."""
    params = sections.get(name)
    entry = registry.get(getattr(params, "plugin", "") or default)
    return entry.cls(params if params is not None else entry.cls.Params())  # type: ignore[attr-defined, call-arg]


@cache
def _unknown(registry: Registry[Any]) -> type[ParamModel]:
    """A model that refuses the type that is written, with the known ones."""

    class UnknownPlugin(PluginSection):
        """The type is not registered."""

        plugin: str = param("", "type of the plugin")

        @field_validator("plugin")
        @classmethod
        def _refuse(cls, value: str) -> str:
            try:
                registry.get(value)
            except UnknownPluginError as exc:
                raise ValueError(exc.message) from None
            return value

    return UnknownPlugin


def first_of(values: Mapping[str, Any], key: str, default: str) -> str:
    """Return the first name of a list of plugins, as Nav2 writes them: `goal_checker_plugins: ["goal_checker"]`."""
    listed = values.get(key)
    first = listed[0] if isinstance(listed, (list, tuple)) and listed else default
    return first if isinstance(first, str) else default
