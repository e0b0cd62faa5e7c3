"""Shapes of every kind in a scenario: driven, recorded, read back, driven again."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import navstack as nav
from navstack.core import Pose2D
from navstack.record import Record
from navstack.scenario import Scenario, run_scenario
from navstack.sim import DoorMotion, OnTrack, PedestrianMotion, Shape

SHAPES = (
    Shape(name="crate", box=[0.3, 0.2], pose=[2.9, 6.6, 0.3], height=0.2),
    Shape(
        name="truck", polygon=[[0, 0], [0.4, 0], [0.2, 0.3]], motion=OnTrack(points=[[7.0, 6.8], [7.0, 8.0]], spin=0.2)
    ),
    Shape(name="gate", segment=[[4.4, 6.5], [4.4, 8.5]], motion=DoorMotion(open=[[1.0, 9.0]], period=20.0)),
    Shape(name="ann", radius=0.25, pose=[6.0, 7.9], motion=PedestrianMotion(goals=[[2.0, 8.0], [6.0, 8.0]])),
)


def scenario() -> Scenario:
    noise = ["localization_noise=0.01", "localization_yaw_noise=0.01", "localization_delay=0.1", "wheel_slip=0.02"]
    return Scenario(
        map=nav.load_map(nav.map_path("office")),
        configuration=nav.load_configuration(["turtlebot"], overrides=[f"navstack/sim/{value}" for value in noise]),
        start=Pose2D(2.0, 7.45, 0.0),
        goals=(Pose2D(3.6, 7.3, 0.0),),
        shapes=SHAPES,
        seed=4,
        time_limit_s=20.0,
    )


def test_shapes_survive_json() -> None:
    for shape in SHAPES:
        assert Shape.model_validate(shape.model_dump(mode="json")) == shape
        assert Shape.model_validate(shape.model_dump(mode="json", exclude_none=True)) == shape


def test_a_record_with_shapes_and_people_replays_byte_for_byte(tmp_path: Path) -> None:
    first = run_scenario(scenario())
    assert first.recorder is not None
    file = first.recorder.save(tmp_path / "first")["record"]
    record = Record.load(file)
    again = Scenario.from_record(record)
    assert again.shapes == SHAPES
    second = run_scenario(again)
    assert second.recorder is not None
    assert second.recorder.save(tmp_path / "second")["record"].read_bytes() == file.read_bytes()
    # somebody walked by: the clearance is not that of the walls and the door alone
    world = scenario().world()
    footprint = again.configuration.local_costmap.true_footprint
    alone = [
        world.clearance(Pose2D(*pose), footprint, t)
        for pose, t in zip(record.poses.tolist(), record.times.tolist(), strict=True)
    ]
    # the polygon that stands for a round robot does not turn with it: a few millimetres more or less
    assert (record.clearances <= np.array(alone) + 0.005).all()
    assert (record.clearances < np.array(alone) - 0.005).any()
    assert (record.clearances < np.array(alone) - 0.01).any()
