"""Mutated logs of scans, and the map that is built from them: times, poses and ranges that no robot sends."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Final

from navstack.logs import open_scan_log
from navstack.mapping import Mapper, MapperParams, load_session, report_document, save_session

_SCANS: Final = 36
_BEAMS: Final = 60
_NUMBERS: Final = (
    *("nan", "inf", "-inf", "0", "-0.0", "-1", "1e-320", "1e-9", "0.01", "65.5", "81.9", "1e4", "1e9", "1e17", "1e150"),
    *("1e308", "-1e308", "9" * 400, "0x10", "1_0", "x", "3.14159265358979", "-3.2", "1e22"),
)
_AFTER_RANGES: Final = 9
"""Fields of a FLASER line after its ranges: two poses, time, host, time."""


def valid_scans() -> list[str]:
    """Return the lines of a log of CARMEN: a drive there and back in a room of 6 x 4 m with a box."""
    lines: list[str] = []
    for n in range(_SCANS):
        s = 0.1 * min(n, _SCANS - n)
        x, y, yaw = 1.5 + s, 1.5 + 0.2 * math.sin(s), 0.3 * math.sin(0.4 * n)
        angles = [yaw - 0.5 * math.pi + math.pi * k / _BEAMS for k in range(_BEAMS)]
        ranges = " ".join(f"{_range(x, y, angle):.2f}" for angle in angles)
        stamp = 0.2 * n
        pose = f"{x * 1.02:.4f} {y:.4f} {yaw:.4f}"
        lines.append(f"ODOM {pose} 0.5 0.0 0.0 {stamp:.3f} robot {stamp:.3f}")
        lines.append(f"FLASER {_BEAMS} {ranges} {pose} {pose} {stamp:.3f} robot {stamp:.3f}")
    return lines


def _range(x: float, y: float, angle: float) -> float:
    """Return the distance to the walls or to the box in the corner (m)."""
    c, s = math.cos(angle), math.sin(angle)
    found = [((6.0 if c > 0.0 else 0.0) - x) / c if c else 99.0, ((4.0 if s > 0.0 else 0.0) - y) / s if s else 99.0]
    if s > 0.0 and 2.0 < x + (3.0 - y) / s * c < 3.0:
        found.append((3.0 - y) / s)
    return min(found)


def mutated_scans(lines: list[str], rng: random.Random) -> bytes:
    """Return a log with one to eight changes of lines and of their fields."""
    lines = list(lines)
    for _ in range(rng.randint(1, 8)):
        if not lines:
            break
        at = rng.randrange(len(lines))
        fields = lines[at].split()
        match rng.randrange(12):
            case 0:
                fields[rng.randrange(len(fields))] = rng.choice(_NUMBERS)
            case 1:
                # a time or a pose, which stand at the end
                fields[-rng.randint(1, min(_AFTER_RANGES, len(fields)))] = rng.choice(_NUMBERS)
            case 2:
                value, begin = rng.choice(_NUMBERS), rng.randrange(len(fields))
                fields[begin : begin + 40] = [value] * len(fields[begin : begin + 40])
            case 3:
                del fields[rng.randrange(len(fields))]
            case 4:
                lines[at:at] = lines[at : at + rng.randint(1, 10)]  # repeated times
            case 5:
                del lines[at : at + rng.randint(1, 30)]
            case 6:
                end = at + rng.randint(2, 20)
                lines[at:end] = lines[at:end][::-1]  # backward times
            case 7:
                _shift(lines, at, rng)
            case 8:
                lines = [line for line in lines if not line.startswith("ODOM" if rng.random() < 0.9 else "FLASER")]
            case 9:
                lines = [_with_beams(line, rng.choice((0, 1, 2, 14, 16))) for line in lines]
            case 10:
                other = rng.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
            case _:
                fields = [rng.choice(_NUMBERS) if rng.random() < 0.3 else field for field in fields]
        if at < len(lines) and fields and fields[0] in ("ODOM", "FLASER") and lines[at].split()[0] == fields[0]:
            lines[at] = " ".join(fields)
    return ("\n".join(lines) + "\n").encode()


def _shift(lines: list[str], first: int, rng: random.Random) -> None:
    """Move the poses, or the times, of all lines from one on: the odometry jumps, or the clock."""
    step = rng.choice((0.3, -2.0, 50.0, 1e6, 1e15, 1e300))
    places = rng.choice(((-6,), (-5,), (-4,), (-6, -5, -4), (-3, -1)))
    for n in range(first, len(lines)):
        fields = lines[n].split()
        for place in places:
            # the poses of an ODOM line stand before its speeds
            where = place - 3 if fields[0] == "ODOM" and place < -3 else place
            if len(fields) >= -where:
                try:
                    fields[where] = repr(float(fields[where]) + step)
                except ValueError:
                    continue
        lines[n] = " ".join(fields)


def _with_beams(line: str, count: int) -> str:
    fields = line.split()
    if not fields or fields[0] != "FLASER" or len(fields) < 2 + count + _AFTER_RANGES:
        return line
    return " ".join(["FLASER", str(count), *fields[2 : 2 + count], *fields[-_AFTER_RANGES:]])


def build_map(path: Path, rng: random.Random) -> int:
    """Build a map as `map build` does; return the number of its keyframes."""
    params = MapperParams(minimum_travel_distance=rng.choice((0.1, 0.3)), keyframes_per_place=rng.choice((0, 1, 2, 10)))
    mapper, blind = Mapper(params), rng.random() < 0.2
    for frame in open_scan_log(path):
        mapper.add_scan(frame.scan.stamp, None if blind else frame.odometry, frame.scan, frame.sensor)
    mapper.finish()
    grid = mapper.map()
    assert grid.data.shape == (grid.geometry.ny, grid.geometry.nx)
    assert all(map(math.isfinite, mapper.graph.poses.ravel().tolist()))
    report_document(mapper)
    if rng.random() < 0.1:
        load_session(save_session(mapper, path.with_suffix(".mapping.npz")))
    return len(mapper.keyframes)
