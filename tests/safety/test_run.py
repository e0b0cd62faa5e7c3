"""A run through the chain: the record, its explanation and its pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import GridGeometry, InputError, OccupancyGrid, Pose2D, RecordError
from navstack.explain import explain_command
from navstack.explain.command import chain_sentence
from navstack.parameters import load_configuration
from navstack.plot import plot_commands, plot_run
from navstack.record import Record
from navstack.scenario import Scenario, run_scenario

SECTIONS: dict[str, Any] = {
    "velocity_smoother": {"max_accel": [1.0, 0.0, 2.0], "max_decel": [-1.0, 0.0, -2.0]},
    "collision_monitor": {
        "polygons": ["Slow", "Stop"],
        "observation_sources": ["scan"],
        "Slow": {"type": "circle", "action_type": "slowdown", "radius": 1.3, "slowdown_ratio": 0.5, "min_points": 2},
        "Stop": {
            "type": "polygon",
            "action_type": "stop",
            "points": "[[0.3, 0.15], [0.3, -0.15], [0.0, -0.15], [0.0, 0.15]]",
            "min_points": 2,
        },
        "scan": {"type": "scan", "topic": "scan"},
    },
}


def scenario(sections: dict[str, Any]) -> Scenario:
    """A drive past a disc."""
    grid = OccupancyGrid(np.zeros((80, 120), np.int8), GridGeometry(120, 80, 0.05, 0.0, 0.0))
    configuration = load_configuration(["turtlebot", sections])
    return Scenario(
        map=grid,
        configuration=configuration,
        start=Pose2D(1.0, 2.0, 0.0),
        goals=(Pose2D(4.5, 2.0, 0.0),),
        obstacles=((2.8, 2.3, 0.3),),
        time_limit_s=60.0,
    )


@pytest.fixture(scope="module")
def record() -> Record:
    result = run_scenario(scenario(SECTIONS))
    assert result.recorder is not None
    assert result.goals[0].state == "SUCCEEDED"
    return result.recorder.record()


def test_the_record_has_commands_before_and_after(record: Record, tmp_path: Path) -> None:
    rows = record.command_steps
    assert len(rows) > 50
    assert {"", "velocity_smoother", "collision_monitor"} == set(rows["changed_by"].tolist())
    slowed = rows[rows["action"] == "slowdown"]
    np.testing.assert_allclose(slowed["sent_vx"], 0.5 * slowed["smoothed_vx"], atol=1e-12)
    unchanged = rows[rows["changed_by"] == ""]
    assert (unchanged["sent_vx"] == unchanged["requested_vx"]).all()
    # the smoother continues from its output, or from what the robot got where the monitor held it
    held = (rows["sent_vx"] != rows["smoothed_vx"]) & (rows["action"] != "slowdown")
    base = np.concatenate(([0.0], np.where(held, rows["sent_vx"], rows["smoothed_vx"])[:-1]))
    steps = np.abs(rows["smoothed_vx"] - base)
    sent = np.diff(np.concatenate(([0.0], np.abs(rows["sent_vx"]))))
    dt = np.diff(np.concatenate(([rows["t"][0] - 0.05], rows["t"])))
    assert (steps <= 1.0 * np.minimum(dt, 0.1) + 1e-9).all()
    assert (sent <= 1.0 * np.minimum(dt, 0.1) + 1e-9).all()
    assert [(name, action, len(corners)) for name, action, corners in record.zones] == [
        ("Slow", "slowdown", 48),
        ("Stop", "stop", 4),
    ]


def test_the_run_is_the_same_again(record: Record) -> None:
    again = run_scenario(scenario(SECTIONS)).recorder
    assert again is not None
    assert again.record().command_steps.tobytes() == record.command_steps.tobytes()


def test_explain_command_says_who_changed_it(record: Record) -> None:
    rows = record.command_steps
    slowed = float(rows["t"][np.flatnonzero(rows["action"] == "slowdown")[5]])
    step = record.command_step_at(slowed)
    assert step is not None
    sentence = chain_sentence(step)
    assert "collision_monitor: slowdown to 0.5 of the command, because of" in sentence
    assert "in the zone Slow, the nearest at" in sentence
    first = record.command_step_at(float(rows["t"][np.flatnonzero(rows["changed_by"] == "velocity_smoother")[0]]))
    assert first is not None
    assert "velocity_smoother: max_accel" in chain_sentence(first)
    assert json.dumps(step.as_dict())


@pytest.mark.slow
def test_pictures(record: Record, tmp_path: Path) -> None:
    for name, draw in (("run.png", plot_run), ("commands.svg", plot_commands)):
        draw(record, tmp_path / name)
        assert (tmp_path / name).stat().st_size > 10_000


def test_without_sections_the_record_has_no_commands(tmp_path: Path) -> None:
    recorder = run_scenario(scenario({})).recorder
    assert recorder is not None
    plain = recorder.record()
    assert "commands" not in plain.arrays
    assert plain.command_step_at(1.0) is None
    with pytest.raises(InputError, match="no record of changed commands"):
        plot_commands(plain, tmp_path / "x.png")


def test_a_saved_record_is_checked(record: Record, tmp_path: Path) -> None:
    recorder = run_scenario(scenario(SECTIONS)).recorder
    assert recorder is not None
    recorder.save(tmp_path)
    loaded = Record.load(tmp_path)
    assert loaded.command_steps.tobytes() == record.command_steps.tobytes()
    report = explain_command(record, 1.0) if record.scenario.get("map") else None
    assert report is None or report.chain is not None
    from navstack.record.archive import write

    broken = {name: array.copy() for name, array in recorder.record().arrays.items()}
    broken["commands"]["t"][0] = np.nan
    with (tmp_path / "run.npz").open("wb") as out:
        write(out, recorder.record().meta, [], broken)
    with pytest.raises(RecordError):
        Record.load(tmp_path)
