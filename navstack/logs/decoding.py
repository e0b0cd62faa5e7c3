"""Decodes messages with rosbags: the types come from the definitions in the file."""

from __future__ import annotations

from typing import Any

from navstack.core.bounded_reading import shortened
from navstack.core.errors import LogError
from navstack.core.optional_dependencies import require
from navstack.logs.log import Channel


class Decoder:
    """Decodes the messages of one log. Types with the same name and another definition do not disturb each other."""

    def __init__(self, *, ros1: bool) -> None:
        """`ros1`: messages are serialized as in ROS 1, else as CDR. Raises InputError if rosbags is not installed."""
        self._typesys = require("rosbags.typesys", "reading a log")
        self._ros1 = ros1
        self._decoders: dict[tuple[str, str], Any] = {}

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

    def _decoder(self, channel: Channel) -> Any:
        """Return the function that decodes a channel's messages. Raises LogError for a definition that is not valid."""
        typesys = self._typesys
        try:
            if channel.definition:
                store = typesys.get_typestore(typesys.Stores.EMPTY)
                store.register(typesys.get_types_from_msg(channel.definition, channel.type))
            else:
                stores = typesys.Stores
                store = typesys.get_typestore(stores.ROS1_NOETIC if self._ros1 else stores.ROS2_HUMBLE)
            store.get_msgdef(channel.type)
        except Exception as exc:
            # any error of the parser of definitions
            raise LogError(
                f"the definition of {channel.type}, the type of {channel.topic}, is not valid: {_reason(exc)}",
                topic=channel.topic,
                type=channel.type,
            ) from exc
        return store.deserialize_ros1 if self._ros1 else store.deserialize_cdr


def _reason(exc: Exception) -> str:
    return shortened(" ".join(str(exc).split()) or type(exc).__name__, 120)
