"""Footprints in parameter files."""

from __future__ import annotations

from typing import Any

import pytest

from navstack.core import ParameterError
from navstack.parameters.configuration import load_configuration

SQUARE = [[0.2, 0.2], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.2]]


def with_footprint(**params: Any) -> Any:
    return load_configuration(["turtlebot", {"local_costmap": params}]).local_costmap


@pytest.mark.parametrize("value", [SQUARE, str(SQUARE)])
def test_footprint_as_list_or_text(value: Any) -> None:
    footprint = with_footprint(footprint=value, footprint_padding=0.05).footprint
    assert footprint.inscribed_radius == pytest.approx(0.25)


@pytest.mark.parametrize("empty", ["", "[]", []])
def test_empty_footprint_is_a_circle(empty: Any) -> None:
    assert len(with_footprint(footprint=empty, robot_radius=0.3).footprint.vertices) == 16


@pytest.mark.parametrize(
    "bad",
    [
        "[[1, 2",
        "round",
        "[1, 2, 3]",
        "[[0.1, nan], [0, 1], [1, 1]]",
        '{"a": 1}',
        "[[1,2,3],[1,2,3],[1,2,3]]",
        [[0.1, 0.1], [0.2, 0.2]],
        [[0.1], [0.2, 0.2], [1.0, 2.0]],
    ],
)
def test_invalid_footprints_are_rejected(bad: Any) -> None:
    with pytest.raises(ParameterError) as caught:
        with_footprint(footprint=bad)
    assert any(finding["rule"] == "footprint" for finding in caught.value.data["findings"])


def test_radius_must_be_positive() -> None:
    with pytest.raises(ParameterError, match="robot_radius"):
        with_footprint(robot_radius=0.0)


@pytest.mark.parametrize("padding", [0.0, 0.01, 0.3, -0.05])
def test_a_robot_radius_is_round_with_any_padding(padding: float) -> None:
    """As in costmap_2d, where the center of a robot with `robot_radius` keeps out of inscribed cells."""
    found = with_footprint(robot_radius=0.2, footprint_padding=padding)
    assert found.footprint.is_round
    assert not with_footprint(footprint=SQUARE, footprint_padding=padding).footprint.is_round
