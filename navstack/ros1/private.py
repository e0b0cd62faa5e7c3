"""Private parameters (`~name`) of the helper nodes, checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

from navstack.core.bounded_reading import short_repr
from navstack.core.errors import InputError
from navstack.ros1 import ros


def number(name: str, default: float, *, positive: bool = False, low: float = -1e9, high: float = 1e9) -> float:
    """Return the number `~name` of `low` to `high`. Raises InputError for another value."""
    value = _value(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise _error(name, value, "a finite number")
    if positive and value <= 0.0:
        raise _error(name, value, "a positive number")
    if not low <= value <= high:
        raise _error(name, value, f"from {low:g} to {high:g}")
    return float(value)


def text(name: str, default: str) -> str:
    """Return the text `~name`. Raises InputError for another value, and for an empty one."""
    value = _value(name, default)
    if not isinstance(value, str) or not value.strip():
        raise _error(name, value, "a text")
    return value.strip()


def texts(name: str, default: Sequence[str]) -> list[str]:
    """Return the list of texts `~name`; one text counts as a list. Raises InputError for another value."""
    value = _value(name, list(default))
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list):
        raise _error(name, value, "a list of texts")
    listed = [str(item).strip() for item in cast("list[Any]", value) if isinstance(item, str)]
    if len(listed) != len(cast("list[Any]", value)) or not all(listed):
        raise _error(name, value, "a list of texts")
    return listed


def flag(name: str, default: bool) -> bool:
    """Return the switch `~name`. Raises InputError for another value."""
    value = _value(name, default)
    if not isinstance(value, (bool, int)):
        raise _error(name, value, "true or false")
    return bool(value)


def _value(name: str, default: Any) -> Any:
    return ros.rospy().get_param(f"~{name}", default)


def _error(name: str, value: Any, wanted: str) -> InputError:
    full = str(ros.rospy().resolve_name(f"~{name}"))
    return InputError(f"the parameter {full} is {short_repr(value)}, not {wanted}", parameter=full, value=value)
