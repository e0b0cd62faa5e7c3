"""The connection records of bags, which name the type of each topic."""

from __future__ import annotations

import pytest

from navstack.logs.bag import (
    MAX_DEFINITION,
    BagFormatError,
    Record,
    _connection,  # pyright: ignore[reportPrivateUsage]
)

RECORD = Record(4117, {b"op": b"\x07", b"topic": b"/scan"}, 0, 0)


def header(**fields: bytes) -> bytes:
    parts = [name.encode() + b"=" + value for name, value in fields.items()]
    return b"".join(len(part).to_bytes(4, "little") + part for part in parts)


def test_a_connection() -> None:
    data = header(type=b"sensor_msgs/LaserScan", message_definition=b"float32 range_max", latching=b"1")
    channel = _connection(RECORD, data)
    assert (channel.topic, channel.type) == ("/scan", "sensor_msgs/msg/LaserScan")
    assert channel.definition == "float32 range_max" and channel.latched


@pytest.mark.parametrize(
    "fields",
    [
        {"type": b"", "message_definition": b""},
        {"type": b"LaserScan", "message_definition": b""},
        {"type": b"sensor_msgs/", "message_definition": b""},
        {"type": b"/LaserScan", "message_definition": b""},
        {"type": b"sensor_msgs/LaserScan", "message_definition": b" " * (MAX_DEFINITION + 1)},
    ],
)
def test_a_connection_without_a_valid_type_is_refused_with_its_offset(fields: dict[str, bytes]) -> None:
    with pytest.raises(BagFormatError) as error:
        _connection(RECORD, header(**fields))
    assert "4117" in str(error.value) or getattr(error.value, "offset", None) == 4117
