"""Which topics and frames of a ROS log are the drive: scans, odometry, reference, map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from navstack.core.errors import LogError
from navstack.drives.messages import DriveOptions
from navstack.logs import Log, topic_name
from navstack.logs import messages as ros

LOOK_AHEAD_S: Final = 30.0
"""A log must show its transforms and its first odometry within this time (s)."""
TRUTH: Final = "/base_pose_ground_truth"
"""Odometry with the true pose of a simulated robot."""
POSE_WITH_COVARIANCE: Final = "geometry_msgs/msg/PoseWithCovarianceStamped"
REFERENCES: Final = (ros.ODOMETRY, ros.POSE, POSE_WITH_COVARIANCE)
"""Types of messages that can be the reference."""
_USUAL: Final = {"scan": ("/scan", "/base_scan", "/scan_filtered", "/laser"), "odom": ("/odom", "/odometry/filtered")}


@dataclass(slots=True)
class DriveTopics:
    """Topics and frames by role; an empty name: the log has none."""

    scan: str
    odometry: str = ""
    """Topic of the odometry; empty: its transform in /tf is used."""
    base: str = "base_link"
    """Frame of the base."""
    odom: str = "odom"
    """Frame of the odometry."""
    reference: str = ""
    """Topic of poses of the base in the map; `tf`: the transform of `map_frame`."""
    map: str = ""
    map_frame: str = "map"
    transforms: tuple[str, ...] = ()
    exported: str = ""
    """Topic with the exact fields of the scans of an exported run."""
    notes: list[str] = field(default_factory=list[str])

    @property
    def used(self) -> list[str]:
        """Every topic that is read."""
        reference = "" if self.reference == "tf" else self.reference
        return sorted({t for t in (self.scan, self.odometry, reference, self.exported, *self.transforms) if t})


def find_drive_topics(log: Log, options: DriveOptions) -> DriveTopics:
    """Return the topics of a log by role. Raises LogError for scans, odometry or a chosen topic that it does not have."""
    notes: list[str] = []
    topics = DriveTopics(_one(log, options, "scan", (ros.SCAN,), notes), notes=notes)
    topics.transforms = tuple(t for t in ("/tf", "/tf_static") if log.has(t))
    topics.exported = ros.EXPORTED_SENSORS if ros.EXPORTED_SENSORS in log.topics_of(ros.STRING) else ""
    topics.map = topic_name(options.topics.get("map", "/map"))
    if topics.map not in log.topics_of(ros.MAP):
        if "map" in options.topics:
            raise _missing(log, topics.map, "map", (ros.MAP,))
        topics.map = ""
    _find_odometry(log, options, topics)
    _find_reference(log, options, topics)
    return topics


def _find_odometry(log: Log, options: DriveOptions, topics: DriveTopics) -> None:
    """Find the odometry: that of /tf, which every localizer of ROS uses, or else the poses of a topic."""
    moving = _parents(log)
    has_topic = "odom" in options.topics or any(t != TRUTH for t in log.topics_of(ros.ODOMETRY))
    if has_topic:
        topics.odometry = _one(log, options, "odom", (ros.ODOMETRY,), topics.notes)
        first = _first(log, topics.odometry)
        if first is not None:
            topics.odom, topics.base = first.frame, first.child or topics.base
    else:
        topics.base = next((b for b in ("base_footprint", "base_link") if b in moving), topics.base)
    reached = {topics.base}
    frame = topics.base
    while frame in moving and moving[frame] not in reached:
        frame = moving[frame]
        reached.add(frame)
    if "odom" not in options.topics and topics.odom in reached and topics.odom != topics.base:
        topics.odometry = ""
    elif not topics.odometry:
        raise LogError(
            f'{log.path} has no odometry: neither a topic of {_short(ros.ODOMETRY)} nor a transform from "{topics.base}" to '
            f'"{topics.odom}" in /tf',
            path=str(log.path),
        )
    if frame not in (topics.base, topics.odom):
        topics.map_frame = frame


def _find_reference(log: Log, options: DriveOptions, topics: DriveTopics) -> None:
    """Find the reference: what was chosen, else the true pose of a simulation, else the localization that was recorded."""
    chosen = options.topics.get("reference", "")
    in_tf = topics.map_frame in _parents(log).values()
    if chosen == "none":
        return
    if chosen == "tf" and not in_tf:
        raise LogError(f'{log.path} has no transform from "{topics.odom}" to a map in /tf; use --reference none')
    if chosen and chosen != "tf":
        name = topic_name(chosen)
        if name not in log.topics_of(*REFERENCES):
            raise _missing(log, name, "reference", REFERENCES)
        topics.reference = name
    elif not chosen and TRUTH in log.topics_of(ros.ODOMETRY):
        topics.reference = TRUTH
        topics.notes.append(f"the reference is {TRUTH}")
    elif in_tf:
        topics.reference = "tf"
        if not chosen:
            topics.notes.append(
                f'the reference is the localization in the log (/tf, "{topics.map_frame}"), which has errors of its own; '
                "leave it out with --reference none"
            )


def _parents(log: Log) -> dict[str, str]:
    """Return the parent of each frame of the transforms at the beginning of the log."""
    found: dict[str, str] = {}
    for topic, end in (("/tf_static", None), ("/tf", LOOK_AHEAD_S)):
        if log.has(topic):
            for message in log.messages([topic], end=end):
                try:
                    found |= {child: parent for parent, child, _ in ros.edges_of(message.data)}
                except LogError:
                    continue
    return found


def _first(log: Log, topic: str) -> Any:
    """Return the first odometry that is valid; None if there is none."""
    for message in log.messages([topic]):
        try:
            return ros.odometry_of(message.data, ros.Clock(log.start_ns))
        except LogError:
            continue
    return None


def _one(log: Log, options: DriveOptions, role: str, kinds: Sequence[str], notes: list[str]) -> str:
    """Return the chosen topic, a usual one, or the only one of these types. Raises LogError."""
    found = [topic for topic in log.topics_of(*kinds) if topic != TRUTH]
    if role in options.topics:
        name = topic_name(options.topics[role])
        if name not in log.topics_of(*kinds):
            raise _missing(log, name, role, kinds)
        return name
    for name in _USUAL[role]:
        if name in found:
            return name
    if len(found) == 1:
        notes.append(f"the {role} is {found[0]}, the only topic of {_short(kinds[0])}")
        return found[0]
    if not found:
        raise LogError(
            f"{log.path} has no topic of {_short(kinds[0])}, so there is nothing to localize with", role=role
        )
    raise LogError(
        f"{log.path} has several topics of {_short(kinds[0])}: {', '.join(found)}; name one with --topic {role}=NAME",
        role=role,
    )


def _missing(log: Log, topic: str, role: str, kinds: Sequence[str]) -> LogError:
    known = ", ".join(log.topics_of(*kinds)) or "none"
    types = " or ".join(_short(kind) for kind in kinds)
    return LogError(f"{log.path} has no topic {topic} of {types} for {role}; those it has: {known}", topic=topic)


def _short(kind: str) -> str:
    return kind.rpartition("/")[2]
