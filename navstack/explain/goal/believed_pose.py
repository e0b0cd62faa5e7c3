"""Timeline lines of a robot that was not where it believed to be. The record of a simulation has both poses."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import angle_between
from navstack.explain.goal.report import GoalReport, TimelineEntry
from navstack.record import Record

OFF_M: Final = 0.5
"""A believed pose that is this far (m) from the true one is reported."""
SAME_S: Final = 1.0
"""Times that are this near (s) share a line."""


def believed_lines(record: Record, report: GoalReport) -> list[TimelineEntry]:
    """Lines of the times in which the believed pose was far from the true one, within the goal.

    A replayed log has no true pose: its record repeats the believed one, which is never off.
    """
    first, last = (int(np.searchsorted(record.times, t)) for t in (report.sent, report.ended))
    rows = slice(first, last + 1)
    times, true = record.times[rows], record.poses[rows]
    believed = _believed(record.map_to_odom[rows], record.odom_poses[rows])
    off = np.hypot(believed[:, 0] - true[:, 0], believed[:, 1] - true[:, 1])
    edges = np.flatnonzero(np.diff(np.concatenate(([False], off > OFF_M, [False])).astype(np.int8)))
    spans: list[tuple[int, int]] = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if spans and times[begin] - times[spans[-1][1] - 1] < SAME_S:
            begin = spans.pop()[0]
        spans.append((begin, end))
    worst = [begin + int(off[begin:end].argmax()) for begin, end in spans]
    return [
        _line(times, begin, end, off, believed[k].tolist(), true[k].tolist())
        for (begin, end), k in zip(spans, worst, strict=True)
    ]


def _line(
    times: NDArray[np.float64],
    begin: int,
    end: int,
    off: NDArray[np.float64],
    believed: list[float],
    true: list[float],
) -> TimelineEntry:
    since, until = float(times[begin]), float(times[end - 1])
    most = float(off[begin:end].max())
    turned = math.degrees(abs(angle_between(believed[2], true[2])))
    text = f"believed pose {most:.1f} m and {turned:.0f} degrees off since {since:.1f} s"
    if end < len(times):
        text += f", until {until:.1f} s"
    text += f": at ({believed[0]:.2f}, {believed[1]:.2f}) instead of ({true[0]:.2f}, {true[1]:.2f})"
    return TimelineEntry(since, until, "lost", text, data={"off_m": most, "off_rad": math.radians(turned)})


def _believed(map_to_odom: NDArray[np.float64], odometry: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) poses of the base in the map by (n, 3) poses of the odometry frame and (n, 3) of the base in it."""
    c, s = np.cos(map_to_odom[:, 2]), np.sin(map_to_odom[:, 2])
    x = map_to_odom[:, 0] + c * odometry[:, 0] - s * odometry[:, 1]
    y = map_to_odom[:, 1] + s * odometry[:, 0] + c * odometry[:, 1]
    return np.column_stack((x, y, map_to_odom[:, 2] + odometry[:, 2]))
