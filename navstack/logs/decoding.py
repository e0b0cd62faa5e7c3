"""Decodes messages with rosbags: the types come from the definitions in the file."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

from navstack.core.bounded_reading import shortened
from navstack.core.errors import LogError
from navstack.core.optional_dependencies import require
from navstack.logs.log import Channel

MOST_TYPES: Final = 500
"""Largest number of definitions whose decoders are kept."""

Decode = Callable[[bytes, str], Any]


class Decoder:
    """Decodes the messages of one log. Types with the same name and another definition do not disturb each other."""

    def __init__(self, *, ros1: bool) -> None:
        """`ros1`: messages are serialized as in ROS 1, else as CDR. Raises InputError if rosbags is not installed."""
        require("rosbags.typesys", "reading a log")
        self._ros1 = ros1
        self._decoders: dict[tuple[str, str], Decode] = {}

    def decode(self, channel: Channel, raw: bytes) -> Any:
        """Return a message. Raises LogError."""
        key = channel.type, channel.definition
        decode = self._decoders.get(key)
        if decode is None:
            decode = self._decoders[key] = self._decoder(channel)
        try:
            return decode(raw, channel.type)
        except Exception as exc:
            # any error of generated code on damaged bytes
            raise LogError(
                f"a message of {channel.topic} cannot be decoded as {channel.type}: {_reason(exc)}",
                topic=channel.topic,
                type=channel.type,
            ) from exc

    def _decoder(self, channel: Channel) -> Decode:
        """Return the function that decodes a channel's messages. Raises LogError for a definition that is not valid."""
        try:
            return _decode_of(channel.type, channel.definition, self._ros1)
        except Exception as exc:
            # any error of the parser of definitions
            raise LogError(
                f"the definition of {channel.type}, the type of {channel.topic}, is not valid: {_reason(exc)}",
                topic=channel.topic,
                type=channel.type,
            ) from exc


@lru_cache(MOST_TYPES)
def _decode_of(kind: str, definition: str, ros1: bool) -> Decode:
    """Return the function of a type; code is generated for it, which takes some milliseconds."""
    typesys = require("rosbags.typesys", "reading a log")
    if definition:
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        store.register(typesys.get_types_from_msg(definition, kind))
    else:
        store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
    store.get_msgdef(kind)
    return store.deserialize_ros1 if ros1 else store.deserialize_cdr


def _reason(exc: Exception) -> str:
    return shortened(" ".join(str(exc).split()) or type(exc).__name__, 120)
