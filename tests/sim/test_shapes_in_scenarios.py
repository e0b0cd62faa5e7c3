"""Shapes of every kind in a scenario: driven, recorded, restored, driven again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import navstack as nav
from navstack.core import Pose2D
from navstack.parameters import load_configuration
from navstack.plot import animate_run, plot_run
from navstack.plot.run import obstacle_patches
from navstack.record import Record
from navstack.record.archive import check
from navstack.scenario import Run, Scenario, run_scenario
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
        configuration=load_configuration(["turtlebot"], overrides=[f"navstack/sim/{value}" for value in noise]),
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


@pytest.mark.slow
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
    # the polygon that stands for a round robot does not turn with it: a few millimeters more or less
    assert (record.clearances <= np.array(alone) + 0.005).all()
    assert (record.clearances < np.array(alone) - 0.005).any()
    assert (record.clearances < np.array(alone) - 0.01).any()


def test_a_record_contains_the_positions_of_obstacles(tmp_path: Path) -> None:
    run = Run(scenario())
    for _ in range(12):
        run.step()
    assert run.recorder is not None
    record = Record.load(run.recorder.save(tmp_path)["record"])
    assert record.has_moving_solids
    discs, polygons = record.solids_at(float(record.times[-1]))
    solids = run.robot.solids
    assert discs == pytest.approx(solids.discs, abs=1e-5)
    assert len(polygons) == 3
    for k, polygon in enumerate(polygons):
        assert polygon == pytest.approx(solids.polygon(k), abs=1e-5)
    before, _ = record.solids_at(0.0)
    assert np.hypot(*(discs - before)[0, :2]) > 0.5  # ann has walked
    # what stands still is kept once
    still = Run(replace(scenario(), shapes=SHAPES[:1]))
    still.step()
    still.step()
    assert still.recorder is not None
    kept = still.recorder.record()
    assert not kept.has_moving_solids
    assert len(kept.solids_at(0.0)[1]) == 1


def test_damaged_solids_are_detected() -> None:
    run = Run(scenario())
    run.step()
    run.step()
    assert run.recorder is not None
    record = run.recorder.record()
    check(record.meta, [], record.arrays)
    for name, damaged in (
        ("solid_first", np.array([0, 4, 3, 11], "<i8")),
        ("solid_discs", np.zeros((2, 1, 2), "<f4")),
        ("solid_corners", np.zeros((5, 11, 2), "<f4")),
        ("solid_corners", np.zeros((2, 11, 2), "<f8")),
    ):
        with pytest.raises(ValueError, match="solid"):
            check(record.meta, [], {**record.arrays, name: damaged})


@pytest.mark.slow
def test_pictures_show_static_and_moving_obstacles(tmp_path: Path) -> None:
    run = Run(scenario())
    for _ in range(12):
        run.step()
    assert run.recorder is not None
    record = run.recorder.record()
    still, moving = obstacle_patches(record, float(record.times[-1]))
    assert (len(still), len(moving)) == (1, 3)
    assert plot_run(record, tmp_path / "run.svg").read_text().count("moving obstacle (at the end), its path") == 1
    film = animate_run(record, tmp_path / "run.gif", fps=2.0, speed=4.0, dpi=40.0)
    assert film.stat().st_size > 1000
