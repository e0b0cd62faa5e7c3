"""One recorded run for all tests: through the door of two rooms, past an obstacle that is not on the map."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from navstack.core import Pose2D
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.scenario import Scenario, run_scenario
from tests.explain.rooms import two_rooms

OBSTACLE = (1.2, 1.6, 0.15)


def scenario() -> Scenario:
    return Scenario(
        map=two_rooms({0.0: 1.0}),
        configuration=load_configuration(["turtlebot", {"spare": {"value": math.inf, "other": [math.nan, ".inf x"]}}]),
        start=Pose2D(0.0, -2.0, 1.5),
        goals=(Pose2D(0.0, 1.5, 1.5), Pose2D(1.5, 2.4, 0.0)),
        obstacles=(OBSTACLE,),
        seed=7,
        time_limit_s=60.0,
        names={"map": "two_rooms.yaml", "params": ["turtlebot"]},
    )


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    recorder = run_scenario(scenario()).recorder
    assert recorder is not None
    recorder.save(folder)
    return folder


@pytest.fixture(scope="session")
def record(run_folder: Path) -> Record:
    return Record.load(run_folder)
