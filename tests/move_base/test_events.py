"""Events that no listener needs are not composed."""

from __future__ import annotations

from navstack.core import Event, NavError
from navstack.move_base.events import EventPublisher


class Warnings:
    kinds = frozenset({"warning"})

    def __init__(self) -> None:
        self.events: list[Event] = []

    def on_event(self, event: Event) -> None:
        self.events.append(event)


class Everything(Warnings):
    kinds = None


class Costly:
    """Data that count how often they are converted."""

    def __init__(self) -> None:
        self.conversions = 0

    def as_dict(self) -> dict[str, int]:
        self.conversions += 1
        return {}


def test_a_failure_is_not_composed_for_a_listener_of_warnings() -> None:
    warnings, everything, costly = Warnings(), Everything(), Costly()
    publisher = EventPublisher([warnings])
    error = NavError("no command", plan=costly)
    publisher.failure(1.0, "control_failed", error)
    publisher.info(1.0, "reached")
    assert (warnings.events, costly.conversions) == ([], 0)
    publisher.warn(2.0, "stale", error)
    assert [event.kind for event in warnings.events] == ["warning"]

    publisher.listeners.append(everything)
    publisher.failure(3.0, "control_failed", error)
    assert [event.kind for event in everything.events] == ["control_failed"]
    assert costly.conversions == 2
