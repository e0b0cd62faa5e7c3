"""Switching to the user's own parameters, and saving into them: only files that the user named, or in the folder of --save-to."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from navstack.core import InputError
from navstack.live import messages, parameters
from navstack.live.checkpoints import Origin
from navstack.live.session import Session
from navstack.live.stage import Options, OwnFiles, Stage
from navstack.parameters import load_configuration, packaged_folder, parameters_of
from navstack.scenario import Scenario, load_scenario, run_scenario

SPEED = "DWAPlannerROS/max_vel_x"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A copy of the turtlebot's parameters in a folder of the user."""
    folder = tmp_path / "robot"
    shutil.copytree(packaged_folder("turtlebot"), folder / "mine")
    (folder / "notes.yaml").write_text("- this is no parameter file\n", encoding="utf-8")
    (folder / "readme.txt").write_text("nor this\n", encoding="utf-8")
    (tmp_path / "secret.yaml").write_text("move_base: {controller_frequency: 7.0}\n", encoding="utf-8")
    (folder / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    return folder


def request(**fields: Any) -> Any:
    return messages.read_request(json.dumps({"id": 1, **fields}))


def started(office: Scenario, folder: Path, *sources: str, **options: Any) -> Stage:
    session = Session(replace(office, configuration=load_configuration(list(sources))), origin=Origin(None, sources))
    return Stage([session], Options(save_to=folder, named=(sources,), **options))


def test_the_sets_to_switch_to(mine: Path) -> None:
    own = OwnFiles([("turtlebot",), (str(mine / "mine"), str(mine.parent / "secret.yaml"))], mine)
    names = own.names()
    assert "turtlebot" in names["packaged"]
    assert names["named"] == [f"{mine / 'mine'} + {mine.parent / 'secret.yaml'}"]
    assert names["folder"] == ["mine"]
    assert own.load("turtlebot") == "turtlebot"
    assert load_configuration([own.load("mine")]).move_base == load_configuration([str(mine / "mine")]).move_base
    loaded = own.load(names["named"][0])
    assert load_configuration([loaded]).move_base.controller_frequency == 7.0


@pytest.mark.parametrize(
    "name", ["../secret.yaml", "secret.yaml", "link.yaml", "/etc/passwd", "mine/../mine", "", "notes", "."]
)
def test_other_names_are_refused(mine: Path, name: str) -> None:
    with pytest.raises(InputError, match="is not one of the sets of this session"):
        OwnFiles([("turtlebot",)], mine).load(name)


@pytest.mark.slow
def test_switching_while_driving_is_part_of_the_run(office: Scenario, mine: Path, run_to: Any, tmp_path: Path) -> None:
    file = next(file for file in (mine / "mine").iterdir() if "max_vel_x:" in file.read_text(encoding="utf-8"))
    lines = [
        "  max_vel_x: 0.21" if line.strip().startswith("max_vel_x:") else line
        for line in file.read_text(encoding="utf-8").splitlines()
    ]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    stage = started(office, mine, "turtlebot")
    run_to(stage.main, 3.0)
    stage.request(request(type="set", params="mine"))
    assert stage.main.run.move_base.local_planner.limits.max_vel_x == 0.21
    run_to(stage.main, 6.0)
    shutil.rmtree(mine)  # the session does not need the files again
    stage.main.recorded()
    saved = stage.main.save_scenario(tmp_path / "saved.yaml")
    assert run_scenario(load_scenario(tmp_path / "saved.yaml"), record=False).simulated_s > 6.0
    assert saved.interactions


@pytest.mark.slow
def test_saving_in_place_keeps_layout_and_comments(office: Scenario, mine: Path) -> None:
    pytest.importorskip("ruamel.yaml")
    before = {file: file.read_text(encoding="utf-8") for file in (mine / "mine").iterdir()}
    stage = started(office, mine, str(mine / "mine"))
    stage.request(request(type="set", values={SPEED: 0.33}))
    shown = stage.request(request(type="difference")).text
    answer = stage.request(request(type="save", what="parameters", name="ignored", in_place=True))
    changed = [file for file, text in before.items() if file.read_text(encoding="utf-8") != text]
    assert len(changed) == 1 and str(changed[0]) in answer.text and str(changed[0]) in shown
    old, new = before[changed[0]].splitlines(), changed[0].read_text(encoding="utf-8").splitlines()
    assert len(old) == len(new) and sum(a != b for a, b in zip(old, new, strict=True)) == 1
    again = parameters_of(load_configuration([str(mine / "mine")]))
    assert {p.name: p.value for p in again}[SPEED] == 0.33
    assert "already" in stage.request(request(type="save", what="parameters", name="x", in_place=True)).text
    assert "already" in stage.request(request(type="difference")).text
    assert sorted(path.name for path in mine.iterdir()) == ["link.yaml", "mine", "notes.yaml", "readme.txt"]


@pytest.mark.slow
def test_files_outside_of_the_folder_are_not_written(office: Scenario, mine: Path, tmp_path: Path) -> None:
    pytest.importorskip("ruamel.yaml")
    before = {file: file.read_bytes() for file in (mine / "mine").iterdir()}
    stage = started(office, tmp_path / "elsewhere", str(mine / "mine"))
    stage.request(request(type="set", values={SPEED: 0.33}))
    with pytest.raises(InputError, match=r"is not in the folder .*elsewhere; start with --save-to"):
        stage.request(request(type="save", what="parameters", name="x", in_place=True))
    assert {file: file.read_bytes() for file in (mine / "mine").iterdir()} == before
    stage = started(office, mine, "turtlebot")
    stage.request(request(type="set", values={SPEED: 0.33}))
    with pytest.raises(InputError, match="turtlebot is a packaged set"):
        stage.request(request(type="save", what="parameters", name="x", in_place=True))


def test_requests_name_one_of_two_robots(office: Scenario) -> None:
    sessions = [Session(office, origin=Origin(None, ("turtlebot",))) for _ in range(2)]
    stage = Stage(sessions, Options(labels=("a", "b")))
    stage.request(request(type="set", values={SPEED: 0.2}, side=1))
    speeds = [session.run.move_base.local_planner.limits.max_vel_x for session in sessions]
    assert speeds[1] == 0.2 and speeds[0] != 0.2
    listed = [stage.request(request(type="parameters", side=side)).data for side in (0, 1)]
    assert [{p["name"]: p["changed"] for p in one}[SPEED] for one in listed] == [False, True]
    assert parameters.changed_values(sessions[1]) == {SPEED: 0.2}
    with pytest.raises(InputError, match="only one robot"):
        Stage(sessions[:1], Options()).request(request(type="parameters", side=1))


def test_the_kernels_of_another_set_are_compiled_ahead(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[Any] = []

    def note(uses: Any, progress: Any) -> None:
        compiled.append(uses)

    monkeypatch.setattr("navstack.live.stage.compile_ahead", note)
    stage = Stage([session], Options())
    assert stage.request(messages.Set(type="set", params="turtlebot")).ok
    assert compiled == [session.run.interventions.configuration.planner_names]
