"""Where a value is in JSON text: for messages about values that parse but are wrong."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Final

_SPACE: Final = re.compile(r"[ \t\r\n]*")
_DECODER: Final = json.JSONDecoder()


def line_of(text: str, path: Sequence[str | int]) -> int:
    """Return the line (from 1) of the value at `path` (keys and indices), or of the deepest value on the way there.

    `text` must be valid JSON.
    """
    at = _skip(text, 0)
    for step in path:
        found = _child(text, at, step)
        if found is None:
            break
        at = found
    return text.count("\n", 0, at) + 1


def _skip(text: str, at: int) -> int:
    match = _SPACE.match(text, at)
    assert match is not None
    return match.end()


def _child(text: str, at: int, step: str | int) -> int | None:
    """Position of a child of the object or array at `at`."""
    if text[at] not in "{[" or (text[at] == "{") != isinstance(step, str):
        return None
    is_object = text[at] == "{"
    at = _skip(text, at + 1)
    index = 0
    found: int | None = None
    while text[at] not in "}]":
        key: str | int = index
        if is_object:
            key, at = _DECODER.raw_decode(text, at)
            at = _skip(text, _skip(text, at) + 1)
        if key == step:
            found = at  # the last of equal keys counts, as in json
            if not is_object:
                return found
        _, at = _DECODER.raw_decode(text, at)
        at = _skip(text, at)
        if text[at] == ",":
            at = _skip(text, at + 1)
        index += 1
    return found
