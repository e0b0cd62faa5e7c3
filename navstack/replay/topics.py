"""Which topics of a log a replay uses, and what navigation needs but the log does not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from navstack.logs import Log
from navstack.parameters import Configuration
from navstack.ros_messages import TRUTH, TopicFinder, short_type, topic_name
from navstack.ros_messages import messages as ros

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
    finder = TopicFinder(str(log.path), log.types, chosen or {})
    finder.check_chosen()
    topics = Topics(notes=finder.notes)
    _find_sensors(finder, sensor_topics(configuration), topics)
    topics.odometry = finder.find("/odom", (ros.ODOMETRY,), ("/odom",), what="odometry")
    if log.has(TRUTH) and topics.odometry != TRUTH:
        topics.truth = TRUTH
    topics.map = finder.named("/map", (ros.MAP,), ("/map",))
    topics.commands = finder.find("/cmd_vel", (ros.TWIST, ros.TWIST_STAMPED), ("/cmd_vel",), what="velocity commands")
    topics.goals = _goals(finder)
    topics.cancels = finder.named("/cancel", (ros.GOAL_ID,), ("/move_base/cancel",))
    topics.results = next(iter(finder.of(ros.ACTION_RESULT)), "")
    plan = finder.choice("/plan", (ros.PATH,))
    plans = [t for t in finder.of(ros.PATH) if t.endswith("plan") and t.split("/")[-1] not in LOCAL_PLANS]
    topics.plans = (plan,) if plan else tuple(plans)
    topics.exported = finder.sensor_fields()
    topics.transforms = finder.transforms()
    return topics


def _goals(finder: TopicFinder) -> tuple[str, ...]:
    chosen = finder.choice("/goal", (ros.ACTION_GOAL, ros.POSE))
    if chosen:
        return (chosen,)
    actions = finder.of(ros.ACTION_GOAL)
    if actions:
        # move_base sends itself the goals of move_base_simple/goal, so the action has them all
        return tuple(actions)
    poses = finder.of(ros.POSE)
    return tuple(topic for topic in ("/move_base_simple/goal", "/goal_pose") if topic in poses)


def _find_sensors(finder: TopicFinder, expected: Mapping[str, SensorTopic], topics: Topics) -> None:
    """Find the topics of the sensors; one with another name is used if there is no doubt, with a note."""
    names = finder.chosen
    free: dict[tuple[str, ...], list[str]] = {}
    for kinds in {sensor.types for sensor in expected.values()}:
        free[kinds] = [t for t in finder.of(*kinds) if t not in expected and t not in names.values()]
    missing: list[tuple[str, SensorTopic]] = []
    for topic, sensor in expected.items():
        used = finder.named(topic, sensor.types, (topic,))
        if used:
            topics.sensors[used] = sensor
        else:
            missing.append((topic, sensor))
    for topic, sensor in missing:
        others, kind = free[sensor.types], short_type(sensor.type)
        alone = sum(1 for _, other in missing if other.types == sensor.types) == 1
        if len(others) == 1 and alone:
            topics.sensors[others[0]] = sensor
            topics.notes.append(f"the log has no {topic}; its only {kind} {others[0]} is used for it")
        else:
            hint = f"; name one of {', '.join(others)} with --topic {topic}=NAME" if others else ""
            topics.notes.append(f"the log has no {topic} ({kind}): the costmaps do not see it{hint}")
