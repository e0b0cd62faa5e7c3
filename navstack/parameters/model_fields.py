"""Facts about the fields of parameter models: nested models, ranges, names that a user may write."""

from __future__ import annotations

import types
from collections.abc import Iterator
from typing import Any, TypeGuard, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from navstack.core.parameters import ParamModel

_FRAMES = ("global_frame", "robot_base_frame", "sensor_frame", "global_frame_id", "frame", "frame_id")


def is_model(annotation: Any) -> TypeGuard[type[ParamModel]]:
    """Return True for a parameter model."""
    return isinstance(annotation, type) and issubclass(annotation, ParamModel)


def nested_model(info: FieldInfo) -> type[ParamModel] | None:
    """Return the model of a field that is itself a namespace."""
    if is_model(info.annotation):
        return info.annotation
    if get_origin(info.annotation) in (Union, types.UnionType):
        for arm in get_args(info.annotation):
            if is_model(arm):
                return arm
    return None


def is_frame(name: str) -> bool:
    """Return True for parameters that name a frame: `/map` and `map` are the same, tf2 accepts only the latter."""
    return name in _FRAMES


def unit_of(info: FieldInfo | None) -> str:
    """Return the unit of a field, empty if it has none."""
    extra = info.json_schema_extra if info is not None else None
    return str(extra.get("unit") or "") if isinstance(extra, dict) else ""


def bounds_of(info: FieldInfo) -> dict[str, float]:
    """Return the range of a field: `ge`, `gt`, `le`, `lt`."""
    found: dict[str, float] = {}
    for meta in info.metadata:
        for word in ("ge", "gt", "le", "lt"):
            limit = getattr(meta, word, None)
            if limit is not None:
                found[word] = limit
    return found


def iter_names(model: type[ParamModel]) -> Iterator[str]:
    """Yield every name that a user may write in the namespace of a model: current, former and without effect."""
    yield from (n for n in model.model_fields if n != model.CHILD_FIELD and n not in model.FROM_NAVSTACK)
    yield from model.RENAMED
    yield from model.NO_EFFECT


def is_value(model: type[ParamModel], name: str) -> bool:
    """Return True if the model has a parameter, not a namespace, of that name."""
    info = model.model_fields.get(name)
    return nested_model(info) is None if info is not None else name in iter_names(model)
