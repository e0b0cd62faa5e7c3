"""Mutated logs: bags and MCAP files with changed bytes, lengths and order, and what reads them."""

from __future__ import annotations

import bz2
import random
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np

from navstack.core import GridGeometry, LaserScan, LogError, OccupancyGrid, PointCloud, Pose2D, Transform2D, Twist2D
from navstack.logs import log_info, open_log
from navstack.logs.writer import BagWriter, McapWriter, typestore
from navstack.ros_messages import Clock, MessageBuilder
from navstack.ros_messages import messages as ros

FORMATS: Final = ("bag", "mcap", "compressed.bag")
_START_NS: Final = 1_600_000_000 * 10**9
_WORDS: Final = (
    *(b"compression=none", b"op=", b"size=", b"conn=", b"time=", b"index_pos=", b"chunk_count="),
    *(b"float64", b"uint32", b"[]", b"cdr"),
)
_LENGTHS: Final = (0, 1, 7, 255, 65535, 1 << 24, 1 << 31, (1 << 32) - 1)


def valid_logs(folder: Path) -> dict[str, bytes]:
    """Return small valid logs by format."""
    found: dict[str, bytes] = {}
    for name in FORMATS:
        path = folder / f"valid.{name}"
        path.unlink(missing_ok=True)
        ros1 = name != "mcap"
        store = typestore(ros1=ros1)
        writer: Any = McapWriter(path, store) if name == "mcap" else BagWriter(path, store, compress=name != "bag")
        _fill(writer, MessageBuilder(store, ros1=ros1))
        writer.close()
        found[name] = path.read_bytes()
    return found


def _fill(writer: Any, build: MessageBuilder) -> None:
    grid = OccupancyGrid(np.zeros((6, 8), np.int8), GridGeometry(8, 6, 0.05, 0.0, 0.0), raw=True)
    cloud = PointCloud(np.ones((5, 3), np.float32))
    scan = LaserScan(np.ones(20, np.float32), -0.5, 0.05, 0.1, 8.0, 0.0, "laser")
    writer.write("/map", ros.MAP, _START_NS, build.map(_START_NS, grid), latched=True)
    for i in range(12):
        now = _START_NS + i * 50_000_000
        moved = [(now, "odom", "base_link", Transform2D(0.1 * i, 0.0, 0.1), 0.0)]
        writer.write("/tf", ros.TRANSFORMS[0], now, build.transforms(moved))
        odometry = build.odometry(now, "odom", "base_link", Pose2D(0.1 * i, 0.0), Twist2D())
        writer.write("/odom", ros.ODOMETRY, now, odometry)
        writer.write("/scan", ros.SCAN, now, build.scan(now, scan))
        writer.write("/points", ros.CLOUD, now, build.cloud(now, cloud))
        writer.write("/cmd_vel", ros.TWIST, now, build.twist(Twist2D()))


def mutated_log(content: bytes, rng: random.Random) -> bytes:
    """Return a log with one to six changes."""
    data = bytearray(content)
    for _ in range(rng.randint(1, 6)):
        if not data:
            break
        at = rng.randrange(len(data))
        match rng.randrange(8):
            case 0:
                data[at] = rng.randrange(256)
            case 1:
                data[at : at + 4] = struct.pack("<I", rng.choice(_LENGTHS))
            case 2:
                data[at : at + 8] = struct.pack("<Q", rng.choice(_LENGTHS) << rng.choice((0, 31)))
            case 3:
                del data[at : at + rng.randint(1, 400)]
            case 4:
                data[at:at] = data[at : at + rng.randint(1, 400)]
            case 5:
                del data[at:]
            case 6:
                other = rng.randrange(len(data))
                size = rng.randint(1, 200)
                data[at : at + size], data[other : other + size] = data[other : other + size], data[at : at + size]
            case _:
                _change_a_word(data, rng)
    return bytes(data)


def _change_a_word(data: bytearray, rng: random.Random) -> None:
    """Change a name or a number that a parser looks for."""
    word = rng.choice(_WORDS)
    at = data.find(word, rng.randrange(len(data)))
    if at < 0:
        return
    other = rng.choice(
        (b"compression=bz2", b"float32[4000000000]", b"string", b"Header", b"\xff\xff\xff\xff", b"[99999999]")
    )
    if rng.random() < 0.3:
        other = bz2.compress(bytes(1000))
    data[at : at + len(word)] = other[: len(word)] if rng.random() < 0.7 else other


def read_log(path: Path, *, partial: bool) -> int:
    """Read a log as `bag info` and `replay` do; return the number of messages that could be decoded."""
    decoded = 0
    with open_log(path, partial=partial) as log:
        log_info(log)
        clock = Clock(log.start_ns)
        for message in log.messages():
            try:
                data = message.data
                if message.type in ros.TRANSFORMS:
                    ros.transforms_of(data, clock)
                elif message.type == ros.ODOMETRY:
                    ros.odometry_of(data, clock)
                elif message.type == ros.CLOUD:
                    ros.points_of(data)
                elif message.type == ros.MAP:
                    ros.map_of(data)
                elif message.type == ros.SCAN:
                    ros.scan_of(data, "scan", 0.0, height=0.3, upside_down=False)
                decoded += 1
            except LogError:
                continue
    return decoded
