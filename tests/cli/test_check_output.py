"""Output of `navstack check`: source lines, carets and severities."""

from __future__ import annotations

import json

import pytest

from navstack.cli.app import run


def test_a_caret_is_below_the_column(tmp_path, capsys) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("controller_frequency: 10.0\nplanner_frequenzy: 1.0\n")
    run(["check", str(file)])
    lines = capsys.readouterr().out.splitlines()
    at = next(i for i, line in enumerate(lines) if line.strip() == "planner_frequenzy: 1.0")
    assert lines[at + 1].index("^") == lines[at].index("planner")


@pytest.mark.slow
def test_severities_have_the_same_names_everywhere(tmp_path, capsys) -> None:
    more = tmp_path / "more.yaml"
    more.write_text("DWAPlannerROS: {max_vel_xx: 0.4}\n")
    run(["check", "turtlebot", str(more)])
    text = capsys.readouterr().out
    run(["check", "turtlebot", str(more), "--json"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    assert {found["severity"] for found in findings} == {"warning", "info"}
    for found in findings:
        assert f"{found['severity']}: {found['message']}" in " ".join(text.split())
    count = sum(found["severity"] == "info" for found in findings)
    assert text.splitlines()[-1] == f"0 errors, 1 warning, {count} infos"
    goal = ["--start", "0.8,7.45", "--goal", "1.2,7.45", "--out", str(tmp_path / "out")]
    goal += ["--params", "turtlebot", "--params", str(more)]
    assert run(["simulate", "office", *goal]) == 0
    shown = " ".join(capsys.readouterr().err.split())
    (warning,) = (found["message"] for found in findings if found["severity"] == "warning")
    assert "warning: " in shown and warning in shown
    assert "info: " not in shown


def test_findings_below_the_severity_are_not_printed(tmp_path, capsys) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("planner_frequenzy: 1.0\n")
    run(["check", str(file), "--json", "--severity", "error"])
    shown = json.loads(capsys.readouterr().out)["findings"]
    assert all(found["severity"] == "error" for found in shown)
    run(["check", str(file), "--json"])
    assert len(json.loads(capsys.readouterr().out)["findings"]) >= max(1, len(shown))
