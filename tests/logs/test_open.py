"""Logs of every format give the same messages in the order of their times; damaged ones give one message with the offset."""

from __future__ import annotations

import bz2
import re
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

import navstack as nav
from navstack.core import LogError
from navstack.logs import open_log
from tests.logs.samples import COUNT, PERIOD_NS, START_NS, write_rosbag2, write_sample

FORMATS = ("bag", "mcap", "sqlite3 folder", "db3", "mcap folder")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("logs")
    sqlite3 = write_rosbag2(folder / "sqlite3", "SQLITE3")
    return {
        "bag": write_sample(folder / "sample.bag"),
        "mcap": write_sample(folder / "sample.mcap"),
        "sqlite3 folder": sqlite3,
        "db3": next(sqlite3.glob("*.db3")),
        "mcap folder": write_rosbag2(folder / "mcap", "MCAP"),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_messages_are_ordered_and_typed(logs: dict[str, Path], name: str) -> None:
    with nav.logs.open(logs[name]) as log:
        assert log.start_ns == START_NS
        assert log.duration == pytest.approx((COUNT - 1) * 0.05)
        counts = {channel.topic: channel.count for channel in log.channels}
        assert counts["/tf"] == COUNT and counts["/scan"] == COUNT // 2
        messages = list(log.messages(["/scan", "tf"]))
        assert [m.time_ns for m in messages] == sorted(m.time_ns for m in messages)
        assert len(messages) == COUNT + COUNT // 2
        scans = [m for m in messages if m.topic == "/scan"]
        assert scans[3].data.header.frame_id == "laser"
        assert scans[3].data.ranges[0] == pytest.approx(1.06)
        assert {m.type for m in messages} == {"sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage"}


@pytest.mark.parametrize("name", FORMATS)
def test_range_of_time_includes_both_ends(logs: dict[str, Path], name: str) -> None:
    with open_log(logs[name]) as log:
        times = [m.time_ns - START_NS for m in log.messages(["/tf"], start=1.0, end=2.0)]
    assert times == [i * PERIOD_NS for i in range(20, 41)]


def test_unknown_topic_names_the_known_ones(logs: dict[str, Path]) -> None:
    with (
        open_log(logs["bag"]) as log,
        pytest.raises(LogError, match=r"no topic /odom; its topics are /scan, /tf, /tf_static"),
    ):
        next(log.messages(["/odom"]))


@pytest.mark.parametrize("name", ["bag", "mcap"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_truncated_file_says_what_can_be_read(logs: dict[str, Path], tmp_path: Path, name: str, share: float) -> None:
    content = logs[name].read_bytes()
    cut = tmp_path / f"cut.{name}"
    cut.write_bytes(content[: int(share * len(content))])
    with pytest.raises(LogError) as caught:
        open_log(cut)
    assert re.search(r"is truncated \(offset [\d,]+\); ", caught.value.message)
    assert caught.value.data["offset"] <= share * len(content)
    with open_log(cut, partial=True) as log:
        messages = list(log.messages())
        for message in messages:
            _ = message.data
    assert len(messages) == caught.value.data["messages"]
    if name == "bag" and share > 0.5:
        assert len(messages) > 100


def _mcap_of_several_chunks(path: Path) -> tuple[list[bytes], int, int]:
    """Write an MCAP file; return its messages, and where its last chunk and the compressed data of that begin."""
    from mcap.reader import make_reader

    write_sample(path, 6000)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and len(summary.chunk_indexes) > 1
    last = summary.chunk_indexes[-1]
    with open_log(path) as log:
        whole = [message.raw for message in log.messages()]
    # after kind and length: two times, size, checksum, the name and the length of what is compressed
    return whole, last.chunk_start_offset, last.chunk_start_offset + 9 + 28 + 4 + len(last.compression) + 8


@pytest.mark.slow
def test_damaged_chunk_of_an_indexed_mcap_is_an_error_where_it_is_read(tmp_path: Path) -> None:
    """The summary is enough to open a file: a chunk is read when its messages are wanted."""
    file = tmp_path / "long.mcap"
    whole, chunk, body = _mcap_of_several_chunks(file)
    content = bytearray(file.read_bytes())
    content[body : body + 4] = b"none"
    file.write_bytes(content)
    found: list[bytes] = []
    with open_log(file) as log:
        assert sum(channel.count for channel in log.channels) == len(whole) == 9001
        with pytest.raises(LogError, match="a chunk cannot be decompressed") as caught:
            found += (message.raw for message in log.messages())
        early = [message.raw for message in log.messages(end=1.0)]
    assert caught.value.data["offset"] == chunk
    assert early == whole[: len(early)] and len(early) > 20


@pytest.mark.slow
def test_chunk_that_expands_to_more_than_it_claims_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bomb.mcap"
    _, chunk, _ = _mcap_of_several_chunks(file)
    content = bytearray(file.read_bytes())
    content[chunk + 25 : chunk + 33] = (1000).to_bytes(8, "little")
    file.write_bytes(content)
    with open_log(file) as log, pytest.raises(LogError, match="a chunk has 1001 bytes instead of 1000"):
        for _ in log.messages():
            pass


def test_bag_without_index_is_read_in_part(logs: dict[str, Path], tmp_path: Path) -> None:
    content = bytearray(logs["bag"].read_bytes())
    at = content.index(b"index_pos=") + len(b"index_pos=")
    content[at : at + 8] = bytes(8)
    file = tmp_path / "run.bag.active"
    file.write_bytes(content)
    with pytest.raises(LogError, match=r"has no index, because its recording was interrupted \(offset .*use --partial"):
        open_log(file)
    with open_log(file, partial=True) as log, open_log(logs["bag"]) as whole:
        assert [m.raw for m in log.messages()] == [m.raw for m in whole.messages()]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"hello", "is not a log that navstack reads"),
        (b"#ROSBAG V1.2\n", "its version is '1.2', and only 2.0 is supported"),
        (b"#ROSBAG V2.0\n", "the file ends within a record"),
        (b"\x89MCAP0\r\n", "is truncated"),
        (b"SQLite format 3\0" + bytes(100), "is truncated or damaged"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / ("x.db3" if content.startswith(b"SQLite") else "x.bag")
    file.write_bytes(content)
    with pytest.raises(LogError, match=re.escape(message)):
        open_log(file)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="does not exist"):
        open_log(tmp_path / "nothing.bag")
    with pytest.raises(LogError, match=r"without metadata\.yaml"):
        open_log(tmp_path)


def test_messages_out_of_order_are_sorted(tmp_path: Path) -> None:
    from rosbags.rosbag1 import Writer

    from navstack.logs.writer import typestore

    store = typestore(ros1=True)
    string = store.types["std_msgs/msg/String"]
    times = [3, 1, 2, 0, 5, 4]
    with Writer(tmp_path / "mixed.bag") as writer:
        connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=store)
        for t in times:
            writer.write(connection, START_NS + t, store.serialize_ros1(string(data=str(t)), "std_msgs/msg/String"))
    with open_log(tmp_path / "mixed.bag") as log:
        assert [m.data.data for m in log.messages()] == ["0", "1", "2", "3", "4", "5"]


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_compressed_bags(tmp_path: Path, compression: str) -> None:
    from rosbags.rosbag1 import Writer

    from navstack.logs.writer import typestore

    store = typestore(ros1=True)
    string = store.types["std_msgs/msg/String"]
    file = tmp_path / "compressed.bag"
    writer = Writer(file)
    writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=store)
        for t in range(5000):
            message = store.serialize_ros1(string(data="x" * 1000), "std_msgs/msg/String")
            writer.write(connection, START_NS + t, message)
    with open_log(file) as log:
        assert sum(len(m.data.data) for m in log.messages()) == 5_000_000


def test_message_that_cannot_be_decoded_is_an_error_of_its_own(tmp_path: Path) -> None:
    from rosbags.rosbag1 import Writer

    file = tmp_path / "wrong.bag"
    with Writer(file) as writer:
        connection = writer.add_connection("/a", "pkg/msg/Odd", msgdef="float64[] values\n", md5sum="0" * 32)
        broken = writer.add_connection("/b", "pkg/msg/Bad", msgdef="this is no definition", md5sum="1" * 32)
        writer.write(connection, START_NS, b"\xff\xff\xff\xff")
        writer.write(broken, START_NS + 1, b"")
    with open_log(file) as log:
        first, second = log.messages()
        with pytest.raises(LogError, match="a message of /a cannot be decoded as pkg/msg/Odd"):
            _ = first.data
        with pytest.raises(LogError, match="the definition of pkg/msg/Bad"):
            _ = second.data


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_folder_whose_metadata_names_another_file(storage: str, tmp_path: Path) -> None:
    folder = write_rosbag2(tmp_path / "bag", storage)
    with open_log(folder) as log:
        before = [(m.topic, m.time_ns) for m in log.messages()]
        assert not log.notes
    (file,) = [file for file in folder.iterdir() if file.suffix in (".db3", ".mcap")]
    renamed = file.rename(file.with_stem("renamed"))
    with open_log(folder) as log:
        assert [(m.topic, m.time_ns) for m in log.messages()] == before
        assert log.notes == [
            f"{folder / 'metadata.yaml'} names {file.name}, and the folder has {renamed.name}: that is read instead"
        ]
    renamed.with_stem("second").write_bytes(renamed.read_bytes())
    with pytest.raises(LogError, match=r"has renamed\.\w+, second\.\w+: rename the files"):
        open_log(folder)


def _records(count: int, positions: Callable[[int], int]) -> bytes:
    """Return a bag of one chunk whose index has `count` entries for it, at the positions."""

    def record(fields: dict[str, bytes], data: bytes) -> bytes:
        header = b"".join(
            struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
            for name, value in fields.items()
        )
        return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data

    def u32(value: int) -> bytes:
        return struct.pack("<I", value)

    stamp = struct.pack("<II", 10, 0)
    definition = b"string data\n"
    inner = b"".join(
        struct.pack("<I", len(field)) + field
        for field in (b"topic=/a", b"type=std_msgs/String", b"md5sum=" + b"0" * 32, b"message_definition=" + definition)
    )
    connection = record({"op": b"\x07", "conn": u32(0), "topic": b"/a"}, inner)
    text = b"x" * 500_000
    message = record({"op": b"\x02", "conn": u32(0), "time": stamp}, struct.pack("<I", len(text)) + text)
    content = connection + message
    chunk = record({"op": b"\x05", "compression": b"bz2", "size": u32(len(content))}, bz2.compress(content))
    start = 13 + 4096
    index_at = start + len(chunk)
    header = {"op": b"\x03", "index_pos": struct.pack("<Q", index_at), "conn_count": u32(1), "chunk_count": u32(count)}
    first = record(header, b"")
    padding = 4096 - len(first)
    first = record(header, b" " * padding)
    infos = [
        record(
            {
                "op": b"\x06",
                "ver": u32(1),
                "chunk_pos": struct.pack("<Q", positions(i) + start),
                "start_time": stamp,
                "end_time": stamp,
                "count": u32(1),
            },
            u32(0) + u32(1),
        )
        for i in range(count)
    ]
    return b"#ROSBAG V2.0\n" + first + chunk + connection + b"".join(infos)


def test_many_index_entries_for_one_chunk(tmp_path: Path) -> None:
    """The chunk is read once; entries that point into it are refused."""
    file = tmp_path / "many.bag"
    file.write_bytes(_records(1, lambda i: 0))
    with open_log(file) as log:
        assert len(list(log.messages())) == 1
    file.write_bytes(_records(3000, lambda i: 0))
    with pytest.raises(LogError, match="has a damaged index: two entries of it are for the same chunk"):
        open_log(file)
    with open_log(file, partial=True) as log:
        assert len(list(log.messages())) == 1
    file.write_bytes(_records(2, lambda i: 5 * i))
    with open_log(file) as log, pytest.raises(LogError, match="the index points into a chunk"):
        list(log.messages())
