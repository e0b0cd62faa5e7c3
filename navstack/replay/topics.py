"""Which topics of a log a replay uses, and what navigation needs but the log does not have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from navstack.core.errors import LogError
from navstack.logs import Log, topic_name
from navstack.logs import messages as ros
from navstack.parameters.configuration import Configuration

DATA_TYPES: Final = {"LaserScan": ros.SCAN, "PointCloud2": ros.CLOUD, "PointCloud": ros.OLD_CLOUD, "Range": ros.RANGE}
"""Type of the messages by data_type of an observation source."""
LOCAL_PLANS: Final = ("local_plan", "global_plan", "transformed_global_plan", "local_plan_smoothed")
"""Last parts of topics of paths that are not plans of a global planner."""


@dataclass(frozen=True, slots=True)
class SensorTopic:
    """A topic of sensor data that the costmaps use."""

    name: str
    """Name in the parameters."""
    type: str

    @property
    def types(self) -> tuple[str, ...]:
        """Types that can be read for it: clouds of either kind."""
        return ros.CLOUDS if self.type in ros.CLOUDS else (self.type,)


def sensor_topics(configuration: Configuration) -> dict[str, SensorTopic]:
    """Return the topics that the layers of both costmaps listen to."""
    found: dict[str, SensorTopic] = {}
    for costmap in (configuration.global_costmap, configuration.local_costmap):
        for layer in costmap.layers:
            for source in layer.cls.traits(layer.params).sources.values():
                found[topic_name(source.topic)] = SensorTopic(source.topic.strip("/"), DATA_TYPES[source.data_type])
            readings = getattr(layer.params, "topics", None)
            if isinstance(readings, list):  # the range layer
                prefix = str(getattr(layer.params, "ns", ""))
                for topic in readings:
                    name = f"{prefix}/{topic}".strip("/")
                    found[topic_name(name)] = SensorTopic(name, ros.RANGE)
    return found


@dataclass(slots=True)
class Topics:
    """The topics of a log by their role; empty if the log has none."""

    sensors: dict[str, SensorTopic] = field(default_factory=dict[str, SensorTopic])
    """Topic of the log -> topic of the parameters."""
    odometry: str = ""
    map: str = ""
    goals: tuple[str, ...] = ()
    cancels: str = ""
    results: str = ""
    commands: str = ""
    plans: tuple[str, ...] = ()
    truth: str = ""
    """Odometry with the true pose of a simulated robot."""
    transforms: tuple[str, ...] = ()
    exported: str = ""
    """Topic with the fields of the scans of an exported run."""
    notes: list[str] = field(default_factory=list[str])
    """What was chosen without being named, and what is missing."""

    @property
    def used(self) -> list[str]:
        """Every topic that is read."""
        single = (self.odometry, self.cancels, self.results, self.commands, self.truth, self.exported)
        names = [*self.sensors, *self.goals, *self.plans, *self.transforms, *single]
        return sorted({name for name in names if name})


def find_topics(log: Log, configuration: Configuration, chosen: Mapping[str, str] | None = None) -> Topics:
    """Return the topics of a log by their role.

    `chosen`: topic of the parameters -> topic of the log, for topics with other names; the roles `odom`, `map`, `goal`,
    `cmd_vel` and `plan` can be chosen as well. Raises LogError for a topic that the log does not have.
    """
    names = {topic_name(name): topic_name(topic) for name, topic in (chosen or {}).items()}
    for topic in names.values():
        if not log.has(topic):
            known = ", ".join(sorted({channel.topic for channel in log.channels})) or "none"
            raise LogError(f"{log.path} has no topic {topic}; its topics are {known}", topic=topic)
    topics = Topics()
    _find_sensors(log, sensor_topics(configuration), names, topics)
    topics.odometry = names.get("/odom") or _one(log, topics, "odometry", [ros.ODOMETRY], ["/odom"])
    truth = "/base_pose_ground_truth"
    if log.has(truth) and topics.odometry != truth:
        topics.truth = truth
    topics.map = names.get("/map") or ("/map" if "/map" in log.topics_of(ros.MAP) else "")
    topics.commands = names.get("/cmd_vel") or _one(
        log, topics, "velocity commands", [ros.TWIST, ros.TWIST_STAMPED], ["/cmd_vel"]
    )
    topics.goals = _goals(log, names)
    topics.cancels = "/move_base/cancel" if "/move_base/cancel" in log.topics_of(ros.GOAL_ID) else ""
    topics.results = next(iter(log.topics_of(ros.ACTION_RESULT)), "")
    topics.plans = (
        (names["/plan"],)
        if "/plan" in names
        else tuple(t for t in log.topics_of(ros.PATH) if t.endswith("plan") and t.split("/")[-1] not in LOCAL_PLANS)
    )
    topics.exported = ros.EXPORTED_SENSORS if ros.EXPORTED_SENSORS in log.topics_of(ros.STRING) else ""
    topics.transforms = tuple(t for t in ("/tf", "/tf_static") if log.has(t))
    return topics


def _goals(log: Log, names: Mapping[str, str]) -> tuple[str, ...]:
    if "/goal" in names:
        return (names["/goal"],)
    actions = log.topics_of(ros.ACTION_GOAL)
    if actions:
        # move_base sends itself the goals of move_base_simple/goal, so the action has them all
        return tuple(actions)
    poses = log.topics_of(ros.POSE)
    return tuple(t for t in ("/move_base_simple/goal", "/goal_pose") if t in poses)


def _find_sensors(log: Log, expected: Mapping[str, SensorTopic], names: Mapping[str, str], topics: Topics) -> None:
    """Find the topics of the sensors; one with another name is used if there is no doubt, with a note."""
    free: dict[tuple[str, ...], list[str]] = {}
    for kinds in {sensor.types for sensor in expected.values()}:
        free[kinds] = [t for t in log.topics_of(*kinds) if t not in expected and t not in names.values()]
    missing: list[tuple[str, SensorTopic]] = []
    for topic, sensor in expected.items():
        source = names.get(topic, topic)
        if source in log.topics_of(*sensor.types):
            topics.sensors[source] = sensor
        elif topic in names:
            kinds = sorted({channel.type for channel in log.channels if channel.topic == source})
            raise LogError(
                f"{source} of {log.path} has the type {', '.join(kinds)}, but {topic} needs {sensor.type}", topic=source
            )
        else:
            missing.append((topic, sensor))
    for topic, sensor in missing:
        others = free[sensor.types]
        alone = sum(1 for _, other in missing if other.types == sensor.types) == 1
        if len(others) == 1 and alone:
            topics.sensors[others[0]] = sensor
            topics.notes.append(f"the log has no {topic}; its only {_short(sensor.type)} {others[0]} is used for it")
        else:
            hint = f"; name one of {', '.join(others)} with --topic {topic}=NAME" if others else ""
            topics.notes.append(f"the log has no {topic} ({_short(sensor.type)}): the costmaps do not see it{hint}")


def _one(log: Log, topics: Topics, what: str, kinds: Sequence[str], usual: Sequence[str]) -> str:
    """Return the usual topic, or the only one of these types, with a note; empty if there is none."""
    found = log.topics_of(*kinds)
    for topic in usual:
        if topic in found:
            return topic
    found = [topic for topic in found if topic != "/base_pose_ground_truth"]
    if len(found) == 1:
        topics.notes.append(f"the log has no {usual[0]}; its only topic of {what}, {found[0]}, is used for it")
        return found[0]
    if found:
        topics.notes.append(
            f"the log has no {usual[0]}, but {', '.join(found)}; name one with --topic {usual[0].strip('/')}=NAME"
        )
    else:
        topics.notes.append(f"the log has no {what} ({_short(kinds[0])})")
    return ""


def _short(kind: str) -> str:
    return kind.rpartition("/")[2]
