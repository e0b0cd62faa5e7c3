"""The report of a run: one HTML file with everything in it."""

from __future__ import annotations

import base64
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from navstack.cli.app import run
from navstack.core import Footprint, OutputError, Pose2D, RobotState, Transform2D, Twist2D
from navstack.explain import explain_goals
from navstack.record import Record, RunRecorder
from navstack.scenario import load_scenario, run_scenario
from navstack.studies import write_run_report


@pytest.fixture(scope="module")
def recorder(tmp_path_factory: pytest.TempPathFactory) -> RunRecorder:
    file = tmp_path_factory.mktemp("report") / "corridor.yaml"
    file.write_text(
        "map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[2.3, 7.45, 0.0], [2.3, 7.45, 1.57]]\ntime_limit: 8\n"
    )
    found = run_scenario(load_scenario(file)).recorder
    assert found is not None
    return found


@pytest.fixture(scope="module")
def record(recorder: RunRecorder) -> Record:
    return recorder.record()


def pictures(page: str) -> list[Any]:
    found = re.findall(r'(?:src|srcset)="data:image/\w+;base64,([^"]+)"', page)
    return [Image.open(io.BytesIO(base64.b64decode(data))) for data in found]


def test_the_page_needs_no_other_file_and_no_network(record: Record, tmp_path: Path) -> None:
    page = write_run_report(record, tmp_path / "new" / "report.html", film=False).read_text()
    assert [f.name for f in (tmp_path / "new").iterdir()] == ["report.html"]
    assert not re.search(r'(?:src|srcset|href)="(?!data:)', page)
    assert not re.search(r"https?://|@import|<script", page)
    assert str(tmp_path) not in page
    for goal in explain_goals(record):
        assert f"Goal {goal.number} " in page
        assert page.count(">" + f"{goal.timeline[-1].begin:.1f} s</b>") >= 1
    wide, narrow, *_ = sorted(pictures(page), key=lambda image: -image.width)
    assert wide.width > narrow.width
    assert "max-width: 40rem" in page


@pytest.mark.slow
def test_the_film_is_part_of_the_page(record: Record, tmp_path: Path) -> None:
    counted: list[tuple[int, int]] = []
    page = write_run_report(
        record, tmp_path / "report.html", progress=lambda done, total: counted.append((done, total))
    )
    films = [image for image in pictures(page.read_text()) if image.format == "GIF"]
    assert films[0].n_frames == len(counted) > 10


@pytest.mark.slow
def test_a_run_without_goals_has_a_map_and_no_timeline(tmp_path: Path) -> None:
    recorder = RunRecorder(map=None, footprint=Footprint.from_radius(0.2), scenario={})
    for i in range(20):
        recorder.sample(
            0.2 * i,
            pose=Pose2D(0.1 * i, 0.0),
            odom=RobotState(Pose2D(0.1 * i, 0.0)),
            map_to_odom=Transform2D(),
            command=Twist2D(0.5, 0.0, 0.0),
            state="CONTROLLING",
            goal_index=0,
        )
    recorder.finish([])
    by_hand = recorder.record()
    page = write_run_report(by_hand, tmp_path / "report.html", film=False).read_text()
    assert "<h2>Map</h2>" in page
    assert "<h2>Timeline</h2>" not in page


@pytest.mark.slow
def test_names_of_a_scenario_cannot_become_markup(record: Record, tmp_path: Path) -> None:
    page = write_run_report(record, tmp_path / "r.html", film=False, title="<script>alert(1)</script>").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_another_suffix_is_refused(record: Record, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"a report is a \.html file"):
        write_run_report(record, tmp_path / "report.pdf")


@pytest.mark.slow
def test_the_command_writes_next_to_the_record(
    recorder: RunRecorder, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    recorder.save(tmp_path / "run")
    assert run(["report", str(tmp_path / "run"), "--no-film", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["files"] == {"report": str(tmp_path / "run" / "report.html")}
    assert "<h2>Timeline</h2>" in (tmp_path / "run" / "report.html").read_text()
