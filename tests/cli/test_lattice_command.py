"""`navstack lattice`: files and messages."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.global_planner import generate_lattice, write_lattice


@pytest.mark.slow
def test_generate_and_check(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file, picture = tmp_path / "new" / "primitives.json", tmp_path / "primitives.png"
    command = ["lattice", "generate", "--motion-model", "diff", "--out", str(file), "--picture", str(picture)]
    assert run(command) == 0
    out = capfd.readouterr().out
    assert "104 primitives from 16 headings, 32 of them turns in place; 0.150 to 0.649 m long" in out
    assert f"primitives: {file}" in out and f"picture: {picture}" in out
    assert picture.stat().st_size > 10_000
    assert run(["lattice", "check", str(file), "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["primitives"] == 104 and document["smallest_radius_m"] >= 0.5
    file.write_text(file.read_text().replace('"turning_radius": 0.5', '"turning_radius": 0.9'))
    assert run(["lattice", "check", str(file)]) == 2
    assert "primitives.json:" in capfd.readouterr().err


def test_a_file_without_turns_is_warned_of(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    lattice = generate_lattice()
    forward = tuple(p for p in lattice.primitives if p.start != 0 or p.end == 0)
    file = write_lattice(replace(lattice, primitives=forward), tmp_path / "primitives.json")
    assert run(["lattice", "check", str(file)]) == 0
    assert "warning: from headings 0.0 degrees no primitive turns left, or none right" in capfd.readouterr().out
    assert run(["lattice", "check", str(file), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["headings_without_turns"] == [0.0]


@pytest.mark.parametrize(
    ("option", "message"), [("--radius=0.01", "2 and 100 cells"), ("--headings=12", "multiple of 8")]
)
def test_what_cannot_be_generated(option: str, message: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["lattice", "generate", option, "--out", str(tmp_path / "p.json")]) == 2
    assert message in capfd.readouterr().err
    assert not list(tmp_path.iterdir())
