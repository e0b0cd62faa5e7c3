"""Priorities, time-outs and locks of the multiplexer."""

from __future__ import annotations

import math

import pytest

from navstack.core import InputError, Twist2D
from navstack.parameters import MuxInputParams, MuxLockParams, TwistMuxParams
from navstack.safety import CommandMultiplexer

GO, TURN = Twist2D(0.5), Twist2D(0.0, 0.0, 1.0)


def mux(*inputs: tuple[str, float, int], locks: tuple[tuple[str, float, int], ...] = ()) -> CommandMultiplexer:
    return CommandMultiplexer(
        TwistMuxParams(
            topics=[MuxInputParams(name=n, topic=f"{n}_vel", timeout=t, priority=p) for n, t, p in inputs],
            locks=[MuxLockParams(name=n, topic=n, timeout=t, priority=p) for n, t, p in locks],
        )
    )


EXAMPLE = (("navigation", 0.5, 10), ("keyboard", 0.5, 90), ("joystick", 0.5, 100), ("tablet", 0.5, 100))
LOCKS = (("pause", 0.0, 100), ("joy_priority", 0.0, 100), ("loop_closure", 0.0, 200))


@pytest.mark.parametrize(
    ("source", "after", "passes"),
    [
        ("navigation", 0.4, False),  # the keyboard still drives
        ("navigation", 0.5, False),
        ("navigation", 0.51, True),  # it is silent
        ("joystick", 0.1, True),  # higher priority
        ("keyboard", 0.1, True),
    ],
)
def test_priority_and_timeout(source: str, after: float, passes: bool) -> None:
    m = mux(*EXAMPLE)
    assert m.command("keyboard", TURN, 1.0) == TURN
    assert (m.command(source, GO, 1.0 + after) == GO) == passes


def test_of_two_inputs_of_equal_priority_the_first_one_drives() -> None:
    m = mux(*EXAMPLE)
    assert m.command("tablet", GO, 0.0) == GO
    assert m.command("joystick", TURN, 0.1) == TURN
    assert m.command("tablet", GO, 0.2) is None
    assert m.command("tablet", GO, 0.61) == GO


@pytest.mark.parametrize(("lock", "passing"), [("pause", {"joystick", "tablet"}), ("loop_closure", set[str]())])
def test_a_lock_stops_lower_priorities(lock: str, passing: set[str]) -> None:
    for name, _, _ in EXAMPLE:
        m = mux(*EXAMPLE, locks=LOCKS)
        m.set_lock(lock, True, 0.0)
        assert (m.command(name, GO, 0.1) == GO) == (name in passing)
        m.set_lock(lock, False, 0.2)
        assert m.command(name, GO, 0.3) == GO


def test_a_lock_with_a_timeout_must_be_heard() -> None:
    m = mux(("navigation", 0.5, 10), locks=(("watchdog", 0.5, 100),))
    assert m.command("navigation", GO, 0.0) is None  # never heard
    m.set_lock("watchdog", False, 0.1)
    assert m.command("navigation", GO, 0.6) == GO
    assert m.command("navigation", GO, 0.61) is None


def test_a_silent_input_stops_the_robot_once() -> None:
    m = mux(*EXAMPLE)
    m.command("navigation", GO, 0.0)
    assert m.step(0.5) is None
    assert m.due == pytest.approx(0.5)
    assert m.step(0.51) == Twist2D()
    assert m.step(0.6) is None


def test_a_lock_stops_the_robot_once() -> None:
    m = mux(*EXAMPLE, locks=LOCKS)
    m.command("navigation", GO, 0.0)
    m.set_lock("pause", True, 0.1)
    assert m.step(0.1) == Twist2D()
    assert m.step(0.2) is None


def test_an_input_without_a_timeout_masks_others_only_after_it_has_spoken() -> None:
    m = mux(("high", 0.0, 50), ("low", 0.5, 10))
    assert m.command("low", GO, 0.0) == GO
    m.command("high", TURN, 0.1)
    assert m.command("low", GO, 100.0) is None
    assert m.due == math.inf


def test_priority_zero_drives_if_nothing_else_does() -> None:
    assert mux(("only", 0.5, 0)).command("only", GO, 0.0) == GO


def test_the_default_lets_teleop_override_motions_and_navigation() -> None:
    m = CommandMultiplexer(TwistMuxParams())
    assert m.command("navigation", GO, 0.0) == GO
    assert m.command("motion", TURN, 0.1) == TURN
    assert m.command("navigation", GO, 0.2) is None
    assert m.command("teleop", GO, 0.3) == GO
    assert m.command("motion", TURN, 0.4) is None
    assert m.command("motion", TURN, 0.9) == TURN


@pytest.mark.parametrize(
    ("source", "name"),
    [("navigation", "navigation"), ("teleop", "keyboard"), ("joystick_vel", "joystick"), ("motion", "navigation")],
)
def test_names_of_sources(source: str, name: str) -> None:
    assert mux(*EXAMPLE).resolve(source) == name


def test_an_unknown_source_names_the_known_ones() -> None:
    with pytest.raises(InputError, match=r'no input "gamepad" \(it has: navigation, keyboard'):
        mux(*EXAMPLE).command("gamepad", GO, 0.0)
    with pytest.raises(InputError, match=r'no lock "x" \(it has: none\)'):
        mux(*EXAMPLE).set_lock("x", True, 0.0)
    with pytest.raises(InputError, match="not finite"):
        mux(*EXAMPLE).command("joystick", Twist2D(math.nan), 0.0)


def test_why_a_source_does_not_drive() -> None:
    m = mux(*EXAMPLE, locks=LOCKS)
    assert m.why_not("navigation", 0.0) == "navigation is silent"
    m.command("keyboard", GO, 0.0)
    m.command("navigation", GO, 0.0)
    assert m.why_not("navigation", 0.1) == "keyboard (priority 90) drives instead of navigation (10)"
    m.set_lock("pause", True, 0.1)
    assert m.why_not("keyboard", 0.1) == "keyboard (priority 90) is locked by pause (priority 100)"
    assert m.why_not("navigation", 0.1).startswith("navigation (priority 10) is locked by pause")


def test_a_step_is_due_when_the_robot_must_stop() -> None:
    """At exactly the timeout an input is alive: a step there must not be due again at the same time."""
    it = CommandMultiplexer(TwistMuxParams())
    it.command("teleop", Twist2D(0.3), 2.0)
    assert it.due > 2.5 + 1e-7  # a simulated clock rounds to 1e-8 s
    assert it.step(2.5) is None
    assert it.step(it.due) == Twist2D()
    assert it.due == math.inf


def test_an_expired_lock_is_not_due_again_and_again() -> None:
    topics = [MuxInputParams(name="navigation", priority=10)]
    it = CommandMultiplexer(TwistMuxParams(topics=topics, locks=[MuxLockParams(name="quiet", timeout=0.5, priority=5)]))
    it.set_lock("quiet", False, 0.0)
    it.command("navigation", Twist2D(0.3), 0.0)
    assert it.due == pytest.approx(0.5, abs=1e-5)
    assert it.step(it.due) is None  # a lower priority: the navigation drives on
    assert it.due == math.inf
