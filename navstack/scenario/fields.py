"""Fields of a scenario: declared once on its dataclasses, for Python, for records and for files.

A field's type says how a record stores it. A field with a meaning (`described`) is a key of scenario files, too: its name without
the unit, so `time_limit_s` is `time_limit`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, Final, get_type_hints

from pydantic import Field, GetCoreSchemaHandler
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

from navstack.core import Pose2D
from navstack.parameters import bounds_of, unit_of
from navstack.plugins import ParamModel, param


def described(meaning: str, *, unit: str = "", **bounds: Any) -> Any:
    """Declare a field that scenario files may set, within `Annotated`: meaning, unit and range as in `param`."""
    return param(..., meaning, unit=unit, **bounds)


@dataclass(frozen=True, slots=True)
class Stored:
    """How a record stores a value: as a `form`, from which `read` makes the value; `write` inverts it."""

    form: Any
    read: Callable[[Any], Any]
    write: Callable[[Any], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema of the form, followed by `read`."""
        written = core_schema.plain_serializer_function_ser_schema(self.write)
        return core_schema.no_info_after_validator_function(
            self.read, handler.generate_schema(self.form), serialization=written
        )


class NotStored:
    """A field that is not part of the scenario in a record: taken as it is."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema of anything."""
        return core_schema.any_schema()


_Number = Annotated[float, Field(strict=True, ge=-1e9, le=1e9)]
_Three = Annotated[list[_Number], Field(strict=True, min_length=3, max_length=3)]
Pose = Annotated[Pose2D, Stored(_Three, lambda numbers: Pose2D(*numbers), list)]
"""x, y (m) and yaw (rad) in the map frame."""
Disc = Annotated[tuple[float, float, float], Stored(_Three, tuple, list)]
"""x, y and radius (m)."""


def file_fields(model: type, types: Mapping[str, Any] | None = None) -> dict[str, tuple[Any, Any]]:
    """Return the described fields of a dataclass as those of a model of a file: key -> (type, declaration).

    `types` replace those that differ in files.
    """
    hints = get_type_hints(model, include_extras=True)
    found: dict[str, tuple[Any, Any]] = {}
    for field in fields(model):
        info = next((m for m in getattr(hints[field.name], "__metadata__", ()) if isinstance(m, FieldInfo)), None)
        if info is not None and info.description is not None:
            kind = (types or {}).get(field.name, hints[field.name].__origin__)
            bounds: dict[str, Any] = {**bounds_of(info)}
            declared = param(field.default, info.description, unit=unit_of(info), **bounds)
            found[file_key(field.name)] = kind, declared
    return found


def file_key(name: str) -> str:
    """Return the key of a field in files: its name without the unit."""
    return name.removesuffix("_s").removesuffix("_m")


def file_model(
    name: str, doc: str, declared: Mapping[str, tuple[Any, Any]], renamed: Mapping[str, str]
) -> type[ParamModel]:
    """Return the model of a section of a file with these fields; `renamed`: previous key -> key."""
    annotations = {key: kind for key, (kind, _) in declared.items()}
    defaults = {key: declaration for key, (_, declaration) in declared.items()}
    body = {"__module__": __name__, "__doc__": doc, "__annotations__": annotations, "RENAMED": renamed, **defaults}
    make: Any = type(ParamModel)
    return make(name, (ParamModel,), body)


_NOT_FINITE: Final = {".inf": math.inf, "-.inf": -math.inf, ".nan": math.nan}


def encode_floats(value: Any) -> Any:
    """Replaces non-finite floats, which JSON does not have, by their YAML spelling."""
    if isinstance(value, dict):
        return {key: encode_floats(v) for key, v in value.items()}
    if isinstance(value, list):
        return [encode_floats(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0.0 else "-.inf"
    return value


def decode_floats(value: Any) -> Any:
    """Inverts `encode_floats`."""
    if isinstance(value, dict):
        return {key: decode_floats(v) for key, v in value.items()}
    if isinstance(value, list):
        return [decode_floats(v) for v in value]
    return _NOT_FINITE.get(value, value) if isinstance(value, str) else value
