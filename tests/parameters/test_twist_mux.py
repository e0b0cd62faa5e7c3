"""Which input of the multiplexer takes the commands of a source."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.parameters import load_configuration

FILE = """
twist_mux:
  topics:
    - {name: joystick, topic: navigation, priority: 100, timeout: 0.5}
    - {name: navigation, topic: planner/cmd, priority: 10, timeout: 0.3}
    - {name: phone, topic: /tablet/, priority: 50, timeout: 0.7}
    - {name: web, topic: remote, priority: 60, timeout: 0.9}
"""


@pytest.mark.parametrize(
    ("source", "priority"),
    [
        ("navigation", 10),  # by its name, although the topic of an earlier input is called so
        ("joystick", 100),
        ("web", 60),
        ("tablet", 50),  # by its topic
        ("nav_vel", None),
    ],
)
def test_the_input_of_a_source(tmp_path: Path, source: str, priority: int | None) -> None:
    file = tmp_path / "mux.yaml"
    file.write_text(FILE, encoding="utf-8")
    mux = load_configuration(["turtlebot", str(file)]).safety.twist_mux
    assert mux is not None
    found = mux.input_of(source)
    assert (None if found is None else found.priority) == priority
