"""The steering of a car in the record, in pictures and in explanations."""

from __future__ import annotations

import io
import math
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from rich.console import Console

from navstack.core import InputError, RecordError
from navstack.explain import explain_command, print_command
from navstack.plot import plot_run, plot_steering
from navstack.plot.commands import wheel_lines
from navstack.plot.film import Film
from navstack.record import Record, SteeredBase
from navstack.record.archive import check
from navstack.scenario import load_scenario, run_scenario, shipped_scenarios
from navstack.sim import SimParams


@pytest.fixture(scope="module")
def parked(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """A car that has parked, read back from its file."""
    folder = tmp_path_factory.mktemp("park")
    result = run_scenario(load_scenario(shipped_scenarios()["car_park"], params=["car_rpp"]))
    assert result.recorder is not None
    result.recorder.save(folder)
    return Record.load(folder)


@pytest.mark.slow
def test_the_record_keeps_the_angle_and_the_base(parked: Record) -> None:
    base = parked.steered_base
    assert base == SteeredBase("ackermann", 0.5, 0.55, 2.0)
    assert len(parked.steering) == len(parked.times)
    moving = np.abs(parked.velocities[:, 0]) > 0.05
    curvature = parked.velocities[moving, 2] / parked.velocities[moving, 0]
    assert parked.steering[moving] == pytest.approx(np.arctan(0.5 * curvature), abs=1e-9)
    asked = base.asked(parked.commands)
    assert np.isnan(asked[0]) and np.nanmax(np.abs(asked)) <= math.atan(0.5 / 0.85) + 1e-9
    assert base.radius(0.55) == pytest.approx(0.5 / math.tan(0.55))


def test_wrong_steering_in_a_file_is_found(parked: Record) -> None:
    for meta, arrays in (
        ({**parked.meta, "steering": None}, parked.arrays),
        ({**parked.meta, "steering": {**parked.meta["steering"], "wheelbase": -1.0}}, parked.arrays),
        ({**parked.meta, "steering": {**parked.meta["steering"], "max_rate": "2"}}, parked.arrays),
        ({**parked.meta, "steering": {"wheelbase": 0.5}}, parked.arrays),
        (parked.meta, {**parked.arrays, "steering": parked.steering[:-1]}),
        (parked.meta, {k: v for k, v in parked.arrays.items() if k != "steering"}),
    ):
        with pytest.raises(ValueError, match="steering"):
            check(meta, [], arrays)
    assert issubclass(RecordError, InputError)


def test_the_front_wheels_meet_on_the_rear_axle() -> None:
    """Ackermann: the axes of both front wheels pass through one point of the rear axle, at the turning radius."""
    base = SteeredBase("ackermann", 0.5, 0.6, None)
    for angle in (0.3, -0.55):
        *_, left, right = base.wheels(0.5, angle)
        for x, y, direction in (left, right):
            assert y + x / math.tan(direction) == pytest.approx(base.radius(angle))
    assert SteeredBase("tricycle", 0.5, 1.5, None).wheels(0.5, 1.2)[2] == (0.5, 0.0, 1.2)
    assert SteeredBase.of(SimParams()) is None


def test_the_wheels_are_drawn_at_their_angle(parked: Record) -> None:
    row = int(np.argmax(np.abs(parked.steering)))
    lines = wheel_lines(parked, row).reshape(-1, 3, 2)
    directions = [math.atan2(*(line[1] - line[0])[::-1]) - parked.poses[row, 2] for line in lines]
    assert directions[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert min(directions[2:]) < parked.steering[row] < max(directions[2:])
    film = Film(parked, "park", 60.0)
    before = film.frame(float(parked.times[row]))
    parked.arrays["steering"][row] *= -1.0
    try:
        assert (film.frame(float(parked.times[row])) != before).any()
    finally:
        parked.arrays["steering"][row] *= -1.0


@pytest.mark.slow
def test_the_chart_of_speed_and_steering(parked: Record, tmp_path: Path) -> None:
    file = plot_steering(parked, tmp_path / "steering.png", dpi=60.0)
    assert matplotlib.image.imread(file).shape[1] == 600
    panels = plot_steering(parked)
    labels = panels[1].get_legend_handles_labels()[1]
    assert labels == ["commanded", "driven", "in reverse", "limit"]
    assert panels[1].get_ylabel() == "steering angle (rad)" and panels[0].get_ylabel() == "speed (m/s)"
    driven = panels[1].get_lines()[2].get_ydata()
    assert driven == pytest.approx(parked.steering)
    assert plot_run(parked, tmp_path / "run.png").exists()


def test_a_base_that_is_not_steered_has_no_chart(tmp_path: Path) -> None:
    scenario = load_scenario(shipped_scenarios()["holonomic_robot"], time_limit_s=0.5)
    recorder = run_scenario(scenario).recorder
    assert recorder is not None
    record = recorder.record()
    assert record.steered_base is None and np.isnan(record.steering).all() and "steering" not in record.arrays
    with pytest.raises(InputError, match="set navstack/sim/kinematics to ackermann or tricycle"):
        plot_steering(record, tmp_path / "steering.png")


def test_a_command_is_explained_with_its_steering(parked: Record) -> None:
    row = int(np.argmax(np.abs(parked.steering)))
    report = explain_command(parked, float(parked.times[row]))
    assert report.steering is not None
    assert report.steering.angle == pytest.approx(parked.steering[parked.index_at(report.time)])
    assert report.steering.turning_radius == pytest.approx(0.5 / math.tan(0.55))
    out = io.StringIO()
    print_command(Console(file=out, width=300), report)
    assert "steering (ackermann): the command asks for +0." in out.getvalue()
    assert "; the wheel is at +0." in out.getvalue()
    assert report.as_dict()["steering"]["kinematics"] == "ackermann"
