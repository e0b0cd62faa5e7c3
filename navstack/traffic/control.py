"""Traffic control: a rule behind a communication that delays and loses messages."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from navstack.core import InputError
from navstack.traffic.rules import Grant, RobotReport, TrafficRule

_EPSILON: Final = 1e-6
"""Times that differ by less are equal (s)."""


@dataclass(frozen=True, slots=True)
class Communication:
    """Messages between robots and traffic control, which arrive later or not at all; each robot's fate is its own.

    What is lost is drawn from the seed, the robot's name and the number of the message: the order of the robots does not matter.
    """

    delay_s: float = 0.0
    dropout: float = 0.0
    """Share of the messages that is lost, in each direction."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.delay_s) and self.delay_s >= 0.0):
            raise InputError(f"the delay of the communication is {self.delay_s} s; write 0 or more", value=self.delay_s)
        if not 0.0 <= self.dropout <= 1.0:
            raise InputError(
                f"the dropout of the communication is {self.dropout}; write a share, 0 to 1", value=self.dropout
            )

    def arrives(self, name: str, direction: str, number: int) -> bool:
        """Return whether message `number` of a robot gets through."""
        text = f"{self.seed}/{name}/{direction}/{number}".encode()
        return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest()) >= self.dropout * 2.0**64


class TrafficControl:
    """A rule behind a communication: takes what the robots report, and keeps the last grant that has reached each of them."""

    def __init__(self, rule: TrafficRule, communication: Communication | None = None) -> None:
        """Raises InputError if messages take so long that every grant ends before the next one arrives."""
        self.rule = rule
        self.communication = communication or Communication()
        missing = 2.0 * self.communication.delay_s - rule.lease_s
        if missing >= 0.0:
            raise InputError(
                f"messages take {self.communication.delay_s:g} s in each direction, but a grant ends {rule.lease_s:g} s after "
                f"the report that it answers; increase silence by more than {missing:g} s, or make the delay shorter",
                value=rule.lease_s,
            )
        self.grants: dict[str, Grant] = {}
        """By the name of the robot: what it knows."""
        self._registered: set[str] = set()
        """Robots whose first report has arrived: it is neither late nor lost."""
        self._reports: list[tuple[float, RobotReport]] = []
        """On their way, with the time of their arrival."""
        self._sent: list[tuple[float, str, Grant]] = []
        self._number = 0

    def update(self, now: float, reports: Iterable[RobotReport]) -> dict[str, Grant]:
        """Send the reports, run the rule on those that arrive, and return the grants that the robots have by now."""
        link, self._number = self.communication, self._number + 1
        for report in reports:
            if report.name not in self._registered:  # whom nobody knows of, others would be granted to drive into
                self._registered.add(report.name)
                self._reports.append((now, report))
            elif link.arrives(report.name, "report", self._number):
                self._reports.append((now + link.delay_s, report))
        arrived = [report for due, report in self._reports if due <= now + _EPSILON]
        self._reports = [each for each in self._reports if each[0] > now + _EPSILON]
        latest: dict[str, RobotReport] = {}
        for report in arrived:
            if report.name not in latest or latest[report.name].time <= report.time:
                latest[report.name] = report
        for name, grant in self.rule.update(now, latest.values()).items():
            if link.arrives(name, "grant", self._number):
                self._sent.append((now + link.delay_s, name, grant))
        for due, name, grant in self._sent:
            if due <= now + _EPSILON:
                self.grants[name] = grant
        self._sent = [each for each in self._sent if each[0] > now + _EPSILON]
        return dict(self.grants)
