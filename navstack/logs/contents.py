"""What a log contains: topics with rates and gaps, the tf tree with its breaks, and what navigation needs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

from navstack.core import LogError, clean_frame
from navstack.logs.log import Log, LogMessage
from navstack.ros_messages import NS_PER_S, seconds
from navstack.ros_messages import messages as ros

BREAK_FACTOR: Final = 5.0
"""A gap of this many median periods of a transform is a break."""
MIN_BREAK_S: Final = 0.5
"""Shorter gaps of a transform (s) are not breaks."""
HEADERS_PER_TOPIC: Final = 200
"""Number of messages of a topic whose header is read."""
LOOK_AHEAD_S: Final = 30.0
"""A log must show its transforms and its first messages within this time (s)."""
CLOCKS_DIFFER_S: Final = 600.0
"""Stamps that differ more from the time of the recording (s) belong to another clock."""


def first_parents(log: Log, topics: Sequence[str]) -> dict[str, str]:
    """Return the parent of each frame of the transforms at the beginning of the log, on these topics in this order."""
    found: dict[str, str] = {}
    for topic in topics:
        if log.has(topic):
            # static transforms are valid at all times, so they may come late
            for message in log.messages([topic], end=None if topic == "/tf_static" else LOOK_AHEAD_S):
                with suppress(LogError):
                    found |= {child: parent for parent, child, _ in ros.edges_of(message.data)}
    return found


def first_odometry(log: Log, topic: str, clock: ros.Clock) -> ros.Odometry | None:
    """Return the first odometry of a topic that is valid; None if there is none."""
    for message in log.messages([topic]):
        with suppress(LogError):
            return ros.odometry_of(message.data, clock)
    return None


@dataclass(slots=True)
class TopicInfo:
    """A topic of a log."""

    topic: str
    types: tuple[str, ...]
    count: int = 0
    first: float = math.nan
    """Time of the first message (s since the first message of the log)."""
    last: float = math.nan
    longest_gap: float = 0.0
    """Longest time between two messages (s)."""
    gap_at: float = math.nan
    """When that gap began (s)."""
    frames: tuple[str, ...] = ()
    """Frames of its headers."""
    delay: float = math.nan
    """Mean time (s) between the stamp of a message and its recording."""
    problem: str = ""
    """Why its messages cannot be decoded; empty if they can."""

    @property
    def rate(self) -> float:
        """Mean number of messages per second; nan with fewer than two."""
        return (self.count - 1) / (self.last - self.first) if self.count > 1 and self.last > self.first else math.nan

    def as_dict(self) -> dict[str, Any]:
        """Return the topic for JSON."""
        return {
            "topic": self.topic,
            "types": list(self.types),
            "count": self.count,
            "rate_hz": self.rate,
            "first_s": self.first,
            "last_s": self.last,
            "longest_gap_s": self.longest_gap,
            "gap_at_s": self.gap_at,
            "frames": list(self.frames),
            "delay_s": self.delay,
            "problem": self.problem,
        }


@dataclass(slots=True)
class TransformInfo:
    """A transform between two frames."""

    parent: str
    child: str
    is_static: bool
    count: int = 0
    first: float = math.nan
    """First stamp (s)."""
    last: float = math.nan
    longest_gap: float = 0.0
    """Longest time between two stamps (s)."""
    gap_at: float = math.nan
    breaks: int = 0
    """Number of gaps of more than 0.5 s and 5 mean periods."""
    parents: tuple[str, ...] = ()
    """All parents, if the log has several: two programs publish the frame."""

    def as_dict(self) -> dict[str, Any]:
        """Return the transform for JSON."""
        return {
            "parent": self.parent,
            "child": self.child,
            "static": self.is_static,
            "count": self.count,
            "first_s": self.first,
            "last_s": self.last,
            "longest_gap_s": self.longest_gap,
            "gap_at_s": self.gap_at,
            "breaks": self.breaks,
            "parents": list(self.parents),
        }


@dataclass(frozen=True, slots=True)
class Need:
    """Something that navigation needs."""

    what: str
    found: bool
    text: str
    """Which topics there are, or what to do without."""


@dataclass(slots=True)
class LogInfo:
    """What a log contains."""

    path: str
    format: str
    duration: float
    start_ns: int
    messages: int
    topics: list[TopicInfo] = field(default_factory=list[TopicInfo])
    transforms: list[TransformInfo] = field(default_factory=list[TransformInfo])
    needs: list[Need] = field(default_factory=list[Need])

    @property
    def roots(self) -> list[str]:
        """The roots of the tf trees; several: the frames are not connected."""
        children = {item.child for item in self.transforms}
        return sorted({item.parent for item in self.transforms} - children)

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return {
            "path": self.path,
            "format": self.format,
            "duration_s": self.duration,
            "start_ns": self.start_ns,
            "messages": self.messages,
            "topics": [topic.as_dict() for topic in self.topics],
            "transforms": [item.as_dict() for item in self.transforms],
            "roots": self.roots,
            "needs": [{"what": need.what, "found": need.found, "text": need.text} for need in self.needs],
        }


def log_info(log: Log, progress: Callable[[float], None] | None = None) -> LogInfo:
    """Read a whole log once. `progress` is called about once per second of the log with its time (s).

    Raises LogError at a part that cannot be read.
    """
    collector = _Collector(log)
    shown = -math.inf
    for message in log.messages():
        now = seconds(message.time_ns, log.start_ns)
        collector.add(message, now)
        if progress is not None and now - shown >= 1.0:
            shown = now
            progress(now)
    return collector.result()


class _Collector:
    """Collects the information message by message."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._topics: dict[str, TopicInfo] = {}
        self._delays: dict[str, list[float]] = {}
        self._frames: dict[str, set[str]] = {}
        self._edges: dict[str, TransformInfo] = {}
        for channel in log.channels:
            known = self._topics.get(channel.topic)
            types = (channel.type,) if known is None else tuple(sorted({*known.types, channel.type}))
            self._topics[channel.topic] = TopicInfo(channel.topic, types)
        self._count = 0

    def add(self, message: LogMessage, now: float) -> None:
        self._count += 1
        topic = self._topics[message.topic]
        if topic.count:
            gap = now - topic.last
            if gap > topic.longest_gap:
                topic.longest_gap, topic.gap_at = gap, topic.last
        else:
            topic.first = now
        topic.count, topic.last = topic.count + 1, now
        if topic.problem:
            return
        try:
            if message.type in ros.TRANSFORMS:
                self._add_transforms(message)
            elif topic.count <= HEADERS_PER_TOPIC:
                self._add_header(message, topic)
        except LogError as exc:
            topic.problem = exc.message

    def _add_header(self, message: LogMessage, topic: TopicInfo) -> None:
        header = getattr(message.data, "header", None)
        stamp = getattr(header, "stamp", None)
        if stamp is None:
            return
        stamp_ns = ros.stamp_ns(header)
        if stamp_ns:
            self._delays.setdefault(topic.topic, []).append((message.time_ns - stamp_ns) / NS_PER_S)
        frame = str(getattr(header, "frame_id", ""))
        if frame:
            self._frames.setdefault(topic.topic, set()).add(frame)

    def _add_transforms(self, message: LogMessage) -> None:
        is_static = message.topic.endswith("_static")
        for parent, child, stamp_ns in ros.edges_of(message.data):
            stamp = seconds(stamp_ns, self._log.start_ns)
            edge = self._edges.get(child)
            if edge is None:
                edge = self._edges[child] = TransformInfo(parent, child, is_static, parents=(parent,))
            if parent not in edge.parents:
                edge.parents = (*edge.parents, parent)
            edge.is_static = edge.is_static and is_static
            if edge.count:
                gap, mean = stamp - edge.last, (edge.last - edge.first) / max(edge.count - 1, 1)
                if gap > edge.longest_gap:
                    edge.longest_gap, edge.gap_at = gap, edge.last
                edge.breaks += edge.count > 2 and gap > max(MIN_BREAK_S, BREAK_FACTOR * mean)
                edge.last = max(edge.last, stamp)
            else:
                edge.first = edge.last = stamp
            edge.count += 1

    def result(self) -> LogInfo:
        for name, topic in self._topics.items():
            topic.frames = tuple(sorted(self._frames.get(name, ())))
            delays = self._delays.get(name)
            topic.delay = sum(delays) / len(delays) if delays else math.nan
        info = LogInfo(
            str(self._log.path),
            self._log.format,
            self._log.duration,
            self._log.start_ns,
            self._count,
            sorted(self._topics.values(), key=lambda topic: topic.topic),
            sorted(self._edges.values(), key=lambda edge: (edge.parent, edge.child)),
        )
        info.needs = _needs(self._log, info)
        return info


def _needs(log: Log, info: LogInfo) -> list[Need]:
    """Return what navigation needs, and whether the log has it."""
    by_topic = {topic.topic: topic for topic in info.topics}
    sensors = log.topics_of(ros.SCAN, *ros.CLOUDS, ros.RANGE)
    odometry = [topic for topic in log.topics_of(ros.ODOMETRY) if topic != "/base_pose_ground_truth"]
    maps = [topic for topic in log.topics_of(ros.MAP) if "costmap" not in topic]
    goals = [t for t in log.topics_of(ros.POSE, ros.ACTION_GOAL) if t.endswith(("goal", "/goal_pose"))]
    commands = [topic for topic in log.topics_of(ros.TWIST, ros.TWIST_STAMPED) if "cmd_vel" in topic]
    children = {edge.child: edge.parent for edge in info.transforms}
    needs = [
        _need("sensor data", sensors, "the costmaps then show the map only"),
        _need("odometry", odometry, "the velocity of the robot is unknown, so no command can be computed"),
    ]
    unknown = sorted(
        {frame for topic in sensors for frame in by_topic[topic].frames if clean_frame(frame) not in children}
    )
    connected = bool(sensors) and not unknown
    frames_text = (
        "all frames of the sensors are in tf"
        if connected
        else (
            f"not in tf: {', '.join(unknown)}; give the pose with --mount FRAME=x,y,z,yaw" if unknown else "no sensor"
        )
    )
    needs.append(Need("frames of the sensors", connected, frames_text))
    bases = [t for t in ("base_footprint", "base_link") if t in children]
    base_text = f"{children[bases[0]]} -> {bases[0]}" if bases else "taken from the poses of the odometry"
    needs.append(Need("transform of the base", bool(bases), base_text))
    localized = "odom" in children
    text = f"{children['odom']} -> odom" if localized else "give the first pose in the map with --initial-pose x,y,yaw"
    needs.append(Need("localization", localized, text))
    needs.append(_need("map", maps, "give one with --map"))
    needs.append(_need("goals", goals, "give them with --goal"))
    needs.append(_need("velocity commands", commands, "there is nothing to compare the commands with"))
    return needs


def _need(what: str, topics: list[str], otherwise: str) -> Need:
    return Need(what, bool(topics), ", ".join(topics) if topics else otherwise)
