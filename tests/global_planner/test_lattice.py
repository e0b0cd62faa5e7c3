"""Primitive files: generation, reading, messages with file and line."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import InputError
from navstack.global_planner._lattice import MotionModel, sample
from navstack.global_planner._lattice_file import read_lattice, write_lattice
from navstack.global_planner._lattice_generate import generate_lattice

# what Nav2's generator writes for 16 headings and cells of 0.05 m, by radius, model and distinctness ratio
SIZES = [
    (0.5, "ackermann", 0.9, 72),
    (0.5, "diff", 0.9, 104),
    (0.5, "omni", 0.9, 136),
    (1.0, "ackermann", 0.9, 56),
    (0.5, "ackermann", 0.0, 80),
    (1.0, "omni", 0.0, 128),
]


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "model", "ratio", "count"), SIZES)
def test_as_many_primitives_as_nav2(radius: float, model: MotionModel, ratio: float, count: int) -> None:
    lattice = generate_lattice(radius, 0.05, motion_model=model, distinctness_ratio=ratio)
    assert len(lattice.primitives) == count


@pytest.mark.slow
@pytest.mark.parametrize("model", ["ackermann", "diff", "omni"])
@pytest.mark.parametrize(("radius", "headings"), [(0.5, 16), (0.73, 24), (0.2, 8)])
def test_properties_of_a_set(radius: float, headings: int, model: MotionModel) -> None:
    lattice = generate_lattice(radius, 0.05, headings=headings, motion_model=model)
    ends = set()
    for p in lattice.primitives:
        cells = p.poses[-1, :2] / 0.05
        assert np.abs(cells - np.round(cells)).max() < 1e-9
        assert abs(math.remainder(p.poses[-1, 2] - lattice.headings[p.end], 2.0 * math.pi)) < 1e-9
        assert all(abs(piece.curvature) <= 1.0 / radius + 1e-9 for piece in p.pieces)
        assert p.radius == 0.0 or p.radius >= radius - 1e-9
        steps = np.hypot(*np.diff(np.vstack([[0.0, 0.0], p.poses[:, :2]]), axis=0).T)
        assert steps.max() <= 0.05 * 1.5
        # chords of arcs at most a cell long are at most (0.05 / R)^2 / 24 shorter
        assert steps.sum() == pytest.approx(p.length, rel=(0.075 / radius) ** 2 / 20.0, abs=1e-9)
        assert sample(list(p.pieces), float(lattice.headings[p.start]), 7)[-1, :2] == pytest.approx(p.poses[-1, :2])
        ends.add((p.start, p.end, *np.round(cells).astype(int).tolist()))
    n = headings
    assert len(ends) == len(lattice.primitives)
    assert {(-a % n, -b % n, x, -y) for a, b, x, y in ends} == ends
    assert {((n // 2 - a) % n, (n // 2 - b) % n, -x, y) for a, b, x, y in ends} == ends
    assert {(n // 4 + a) % n for a, *_ in ends} == set(range(n))


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "headings"), [(0.2, 16), (2.0, 32), (0.3, 24), (5.0, 16)])
def test_from_every_heading_a_car_turns_to_both_sides(radius: float, headings: int) -> None:
    """Also where all turns pass the end of a straight line, or begin farther away than the last new end."""
    made = generate_lattice(radius, 0.05, headings=headings)
    assert made.headings_without_turns == ()
    straight_on = replace(made, primitives=tuple(p for p in made.primitives if p.start != 3 or not p.left_turn))
    assert straight_on.headings_without_turns == (3,)


@pytest.mark.parametrize("model", ["diff", "omni"])
def test_a_file_is_read_as_it_was_written(tmp_path: Path, model: MotionModel) -> None:
    made = generate_lattice(0.5, 0.05, motion_model=model)
    read = read_lattice(write_lattice(made, tmp_path / "primitives.json"))
    assert (read.motion_model, read.turning_radius, read.resolution) == (model, 0.5, 0.05)
    assert (read.headings == made.headings).all()
    assert len(read.primitives) == len(made.primitives)
    for a, b in zip(read.primitives, made.primitives, strict=True):
        assert (a.start, a.end, a.left_turn) == (b.start, b.end, b.left_turn)
        assert [p.kind for p in a.pieces] == [p.kind for p in b.pieces]
        for p, q in zip(a.pieces, b.pieces, strict=True):
            assert np.allclose(p[1:], q[1:], atol=1e-9)


def test_poses_of_another_generator(tmp_path: Path) -> None:
    """A clothoid-like primitive is no line, arc and line: the arcs between its poses are driven."""
    file = tmp_path / "primitives.json"
    content = json.loads(write_lattice(generate_lattice(0.5, 0.05), file).read_text())
    row = next(r for r in content["primitives"] if r["start_angle_index"] == 0 and r["end_angle_index"] == 0)
    # a lane change: two arcs of 1 m, 0.25 rad each
    first = [(math.sin(a), 1.0 - math.cos(a), a) for a in np.linspace(0.05, 0.25, 5)]
    x, y, _ = first[-1]
    second = [(2.0 * x - px, 2.0 * y - py, a) for px, py, a in first[-2::-1]] + [(2.0 * x, 2.0 * y, 0.0)]
    scale = 0.5 / (2.0 * x), 0.05 / (2.0 * y)
    ratio = scale[1] / scale[0]
    row["poses"] = [
        [px * scale[0], py * scale[1], math.atan(ratio * math.tan(a)) % (2.0 * math.pi)] for px, py, a in first + second
    ]
    row["trajectory_length"] = 0.503
    file.write_text(json.dumps(content))
    (primitive,) = [p for p in read_lattice(file).primitives if len(p.pieces) > 3]
    assert primitive.length == pytest.approx(0.503, abs=1e-3)
    assert sample(list(primitive.pieces), 0.0, 50)[-1, :2] == pytest.approx([0.5, 0.05], abs=2e-3)


def change(content: Any, path: str, value: Any) -> None:
    *parents, last = [int(s) if s.isdigit() else s for s in path.split("/")]
    for step in parents:
        content = content[step]
    if value is None:
        del content[last]
    else:
        content[last] = value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("lattice_metadata/motion_model", "tank", 'expected one of ackermann, diff, omni, not "tank"'),
        ("lattice_metadata/turning_radius", None, "the key turning_radius is missing"),
        ("lattice_metadata/grid_resolution", -1, "expected a number from 0.0001 to 100, not -1"),
        ("lattice_metadata/heading_angles/3", 0.1, "the angles must be ascending"),
        ("lattice_metadata/num_of_headings", 15, "num_of_headings is 15, but there are 16 angles"),
        ("lattice_metadata/number_of_trajectories", 5, "it is 5, but the file has 72 primitives"),
        ("primitives/7/end_angle_index", 16, "expected an integer from 0 to 15, not 16"),
        ("primitives/7/poses/2", [1.0, "x", 0.0], "expected a pose"),
        ("primitives/7/poses/2", [1.0, 0.3, 0.0], "neither an arc, nor a line"),
        ("primitives/9/trajectory_length", 3.0, "it is 3 m, but the poses are"),
        ("lattice_metadata/turning_radius", 2.0, "which is below turning_radius 2 m"),
        ("lattice_metadata/grid_resolution", 0.07, "which is no whole number of cells of 0.07 m"),
        ("primitives", [], "expected a list of 1 to"),
    ],
)
def test_messages_have_file_and_line(tmp_path: Path, path: str, value: Any, message: str) -> None:
    file = write_lattice(generate_lattice(0.5, 0.05), tmp_path / "primitives.json")
    content = json.loads(file.read_text())
    change(content, path, value)
    file.write_text(json.dumps(content, indent=1))
    with pytest.raises(InputError) as error:
        read_lattice(file)
    assert message in error.value.message
    text, line = file.read_text().splitlines(), error.value.data["line"]
    assert f"{file}:{line}: " in error.value.message
    if value is not None and not isinstance(value, list) and "below" not in message and "whole" not in message:
        near = text[line - 1]
        assert str(value) in near or path.split("/")[-1] in near or "heading_angles" in near


def test_files_that_are_no_json(tmp_path: Path) -> None:
    file = tmp_path / "primitives.json"
    with pytest.raises(InputError, match=r"cannot read the primitive file .*navstack lattice generate"):
        read_lattice(file)
    for text, line in (('{\n"a": ,\n}', 2), ("[" * 100_000, 1), ("[1]", 1)):
        file.write_text(text)
        with pytest.raises(InputError, match=rf"primitives\.json:{line}: "):
            read_lattice(file)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"turning_radius": 0.01}, "between 2 and 100 cells"),
        ({"headings": 12}, "multiple of 8"),
        ({"resolution": 0.0}, "resolution must be"),
        ({"motion_model": "tank"}, "must be one of"),
        ({"stopping_threshold": 0}, "threshold"),
        ({"distinctness_ratio": 1.0}, "ratio"),
    ],
)
def test_what_cannot_be_generated(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        generate_lattice(**values)
