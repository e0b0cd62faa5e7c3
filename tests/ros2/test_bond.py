"""The bond of the navigator with a lifecycle_manager, message by message; `test_interface.py` has the real graph."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from navstack.ros2 import lifecycle, ros


class Node:
    """What a bond needs of a node; `tick` passes time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.sent: list[Any] = []
        self.is_running = False
        self.build = SimpleNamespace(
            of=lambda kind, **fields: SimpleNamespace(kind=kind, **fields), header=lambda stamp, frame: (stamp, frame)
        )
        self.handle = SimpleNamespace(get_name=lambda: "navigator", create_timer=self._create_timer)
        monkeypatch.setattr(lifecycle.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(lifecycle.time, "monotonic_ns", lambda: int(1e9 * self.now))
        steady = SimpleNamespace(Clock=lambda clock_type: clock_type, ClockType=SimpleNamespace(STEADY_TIME="steady"))
        monkeypatch.setattr(ros, "load", {"rclpy.clock": steady}.__getitem__)

    def _create_timer(self, period: float, beat: Callable[[], None], *, clock: str) -> Any:
        assert clock == "steady"  # not the simulated time
        self._period, self._beat = period, beat

        def run(runs: bool) -> None:
            self.is_running = runs

        return SimpleNamespace(reset=lambda: run(True), cancel=lambda: run(False))

    def publisher(self, topic: str, kind: str, *, depth: int) -> Any:
        assert (topic, kind) == ("bond", "bond/msg/Status")
        return SimpleNamespace(publish=self.sent.append)

    def subscribe(self, topic: str, kind: str, receive: Callable[[Any], None], *, depth: int) -> None:
        self.receive = receive

    def create(self, make: Callable[[], Any]) -> Any:
        return make()

    def tick(self, seconds: float) -> list[bool]:
        """Let time pass; return whether each message of it was of an active side."""
        self.sent.clear()
        for _ in range(round(seconds / lifecycle.HEARTBEAT_S)):
            self.now += self._period
            if self.is_running:
                self._beat()
        return [message.active for message in self.sent]

    def hear(self, active: bool, name: str = "navigator", instance: str = "manager") -> None:
        self.receive(SimpleNamespace(id=name, instance_id=instance, active=active))


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Node:
    return Node(monkeypatch)


def test_heartbeats_go_on_while_there_is_a_manager(node: Node) -> None:
    bond = lifecycle.Bond(node)  # type: ignore[arg-type]
    assert not node.tick(1.0)  # not active
    bond.begin()
    node.hear(True)
    assert node.tick(30.0) == [True] * 300
    message = node.sent[-1]
    assert (message.id, message.heartbeat_period, message.heartbeat_timeout) == ("navigator", 0.1, 4.0)
    bond.begin()  # it is active already
    assert node.tick(1.0) == [True] * 10 and node.sent[-1].instance_id == message.instance_id


def test_without_a_manager_the_bond_ends(node: Node) -> None:
    bond = lifecycle.Bond(node)  # type: ignore[arg-type]
    bond.begin()
    node.receive(SimpleNamespace(id="navigator", instance_id=bond._instance, active=True))  # its own heartbeat
    node.hear(True, name="amcl")  # another bond on the topic
    found = node.tick(lifecycle.CONNECT_S + 5.0)
    assert found[-1] is False and all(found[:-1]) and len(found) == pytest.approx(100, abs=1)


def test_the_end_of_a_side_is_said_and_answered_once(node: Node) -> None:
    bond = lifecycle.Bond(node)  # type: ignore[arg-type]
    bond.begin()
    node.hear(True)
    node.tick(1.0)
    node.hear(False)
    assert [message.active for message in node.sent[10:]] == [False]
    node.hear(False)
    assert not node.tick(1.0)
    bond.begin()  # activated again: another bond
    node.hear(True)
    assert node.tick(1.0) == [True] * 10
    bond.end()
    assert not node.sent[-1].active and not node.tick(1.0)
