"""`--out`: a name with a suffix is a file, otherwise a folder, in every command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navstack.cli.app import command_tree, run
from navstack.cli.options import chosen_files, file_in, folder_only, names_a_file
from navstack.core import OutputError

PRODUCTS = {"picture": "plan.png", "plan": "plan.json"}


def test_names_of_files_and_folders(tmp_path: Path) -> None:
    for name in ("a.png", "x/b.json", "c.PDF"):
        assert names_a_file(Path(name))
    for name in ("a", "runs/speed_0.5", "v2.1", ".hidden", "a.b c"):
        assert not names_a_file(Path(name))
    (tmp_path / "old.run").mkdir()
    assert not names_a_file(tmp_path / "old.run")


def test_one_product_by_its_suffix_or_all_in_a_folder(tmp_path: Path) -> None:
    assert chosen_files(tmp_path / "a", PRODUCTS) == {
        "picture": tmp_path / "a" / "plan.png",
        "plan": tmp_path / "a" / "plan.json",
    }
    assert chosen_files(tmp_path / "b" / "x.svg", PRODUCTS) == {"picture": tmp_path / "b" / "x.svg"}
    assert chosen_files(tmp_path / "x.json", PRODUCTS) == {"plan": tmp_path / "x.json"}
    with pytest.raises(
        OutputError, match=r"x\.txt: the suffix must be \.png, \.svg, \.pdf for the picture; \.json for the"
    ):
        chosen_files(tmp_path / "x.txt", PRODUCTS)
    assert file_in("run.png")(tmp_path / "a") == tmp_path / "a" / "run.png"
    assert file_in("run.png")(tmp_path / "a.svg") == tmp_path / "a.svg"
    assert folder_only(tmp_path / "v1.2") == tmp_path / "v1.2"
    with pytest.raises(OutputError, match=r"name a folder, without a suffix: .*run$"):
        folder_only(tmp_path / "run.npz")


@pytest.mark.slow
def test_commands_follow_the_rule(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plan = ["plan", "office", "--start", "1,7.45", "--goal", "3,7.45", "-q", "--out"]
    for arguments, expected in (
        ([*plan, "p"], {"p/plan.png", "p/plan.json"}),
        ([*plan, "p.json"], {"p.json"}),
        ([*plan, "q/p.svg"], {"q/p.svg"}),
        (["explain", "inflation", "--params", "turtlebot", "--out", "i.json"], {"i.json"}),
        (["params", "schema", "--out", "s"], {"s/navstack.schema.json"}),
        (["params", "reference", "--out", "r.md"], {"r.md"}),
        (["plot", "office", "--out", "m"], {"m/office.png"}),
    ):
        before = files(tmp_path)
        assert run(arguments) == 0
        assert files(tmp_path) - before == expected
    before = files(tmp_path)
    for arguments in (["simulate", "office", "--out", "run.npz"], ["tune", "--out", "t.yaml"], [*plan, "p.txt"]):
        assert run(arguments) == 2
    assert files(tmp_path) == before


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def commands(group: Any, name: str = "") -> list[tuple[str, Any]]:
    inner = getattr(group, "commands", None)
    if inner is None:
        return [(name, group)]
    return [found for key, one in inner.items() for found in commands(one, f"{name} {key}".strip())]


def test_every_out_option_states_what_it_takes() -> None:
    found = {
        name: option
        for name, command in commands(command_tree())
        for option in command.params
        if "--out" in option.opts
    }
    assert len(found) >= 15
    assert {option.metavar for option in found.values()} <= {"DIR", "DIR|FILE", "FILE|DIR"}


def test_every_out_option_is_checked_before_the_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    for name, command in commands(command_tree()):
        for option in command.params:
            if "--out" not in option.opts:
                continue
            assert option.callback is not None, name
            with pytest.raises(OutputError, match=r"file is not a folder; choose another place with --out$"):
                option.callback(None, option, blocked / "new" / "x")
    assert run(["map", "explore", "office", "--out", str(blocked / "new")]) == 2
    assert "is not a folder" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
