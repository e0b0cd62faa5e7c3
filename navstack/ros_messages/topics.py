"""Names and times of topics, and the topics of a robot found by type."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final

from navstack.core import LogError
from navstack.ros_messages import messages as ros

TRUTH: Final = "/base_pose_ground_truth"
"""Odometry with the true pose of a simulated robot; never taken for the odometry."""
TRANSFORM_TOPICS: Final = ("/tf", "/tf_static")


class TopicFinder:
    """Finds topics of a log or of a robot by their types, with one rule for all that is missing.

    A topic that was chosen must be there, with the type of its role. Otherwise a usual name counts, or the only topic of the
    type, with a note. Without either, a topic that is needed is an error; one that is not is left out, with a note.
    """

    def __init__(self, source: str, types: Mapping[str, Collection[str]], chosen: Mapping[str, str]) -> None:
        """`source` is named in errors; `types`: types by topic; `chosen`: role or topic of the parameters -> topic."""
        self._source, self._types = source, types
        self.chosen = {topic_name(role): topic_name(topic) for role, topic in chosen.items()}
        """The chosen topics by role; roles have a leading slash, as topics."""
        self.notes: list[str] = []
        """What was found without being named, and what is missing."""

    def of(self, *types: str) -> list[str]:
        """Return the topics with one of these types, ordered."""
        return sorted(topic for topic, own in self._types.items() if not set(types).isdisjoint(own))

    def check_chosen(self) -> None:
        """Raise LogError if a chosen topic is not there."""
        for topic in self.chosen.values():
            if topic not in self._types:
                known = ", ".join(sorted(self._types)) or "none"
                raise LogError(f"{self._source} has no topic {topic}; its topics are {known}", topic=topic)

    def choice(self, role: str, types: Sequence[str]) -> str:
        """Return the topic that was chosen for a role; empty if none was. Raises LogError for one without these types."""
        topic = self.chosen.get(topic_name(role), "")
        if topic and topic not in self.of(*types):
            known = ", ".join(self.of(*types)) or "none"
            wanted = " or ".join(map(short_type, types))
            raise LogError(
                f"{self._source} has no topic {topic} of {wanted} for {role.strip('/')}; those it has: {known}",
                topic=topic,
            )
        return topic

    def named(self, role: str, types: Sequence[str], usual: Sequence[str]) -> str:
        """Return the chosen topic, or a usual one; empty if there is neither. Raises LogError for a wrong choice."""
        found = self.of(*types)
        return self.choice(role, types) or next((name for name in usual if name in found), "")

    def find(self, role: str, types: Sequence[str], usual: Sequence[str], *, what: str = "", needed: str = "") -> str:
        """Return the chosen topic, a usual one, or the only one of these types; empty, with a note, if there is none.

        `what` names the messages in a note; `needed` says why the topic is needed: without it, or in doubt, that is an error.
        Raises LogError.
        """
        topic = self.named(role, types, usual)
        if topic:
            return topic
        found = [name for name in self.of(*types) if name != TRUTH]
        kind = short_type(types[0])
        if len(found) == 1:
            self.notes.append(f"the log has no {usual[0]}; its only {kind} {found[0]} is used for it")
            return found[0]
        if found:
            text = f"several topics of {kind}: {', '.join(found)}; name one with --topic {role.strip('/')}=NAME"
        elif needed:
            text = f"no topic of {kind}, {needed}"
        else:
            text = f"no {what or kind} ({kind})"
        if needed:
            raise LogError(f"{self._source} has {text}", role=role)
        self.notes.append(f"the log has {text}")
        return ""

    def sensor_fields(self) -> str:
        """Return the topic with the exact fields of the sensors of an exported run; empty if there is none."""
        return ros.EXPORTED_SENSORS if ros.EXPORTED_SENSORS in self.of(ros.STRING) else ""

    def transforms(self) -> tuple[str, ...]:
        """Return the topics of tf that are there."""
        return tuple(topic for topic in TRANSFORM_TOPICS if topic in self._types)


def topic_name(topic: str) -> str:
    """Return a topic with a leading slash and no repeated ones: `scan` and `//scan` are `/scan`."""
    return "/" + "/".join(part for part in topic.split("/") if part)


def short_type(kind: str) -> str:
    """Return the name of a type without its package: `LaserScan`."""
    return kind.rpartition("/")[2]
