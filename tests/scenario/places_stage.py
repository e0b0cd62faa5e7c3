"""A drive along the corridor of the packaged office."""

from __future__ import annotations

from typing import Any

from navstack.core import Pose2D
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.scenario import Scenario


def office_scenario(goals: tuple[Pose2D, ...], **values: Any) -> Scenario:
    """A turtlebot in the corridor."""
    return Scenario(
        map=load_map(map_path("office")),
        configuration=load_configuration(["turtlebot"]),
        start=Pose2D(1.5, 7.5),
        goals=goals,
        **values,
    )
