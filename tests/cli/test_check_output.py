"""Output of `navstack check`: source lines, carets and severities."""

from __future__ import annotations

import json

from navstack.cli.app import run


def test_a_caret_is_below_the_column(tmp_path, capsys) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("controller_frequency: 10.0\nplanner_frequenzy: 1.0\n")
    run(["check", str(file)])
    lines = capsys.readouterr().out.splitlines()
    at = next(i for i, line in enumerate(lines) if line.strip() == "planner_frequenzy: 1.0")
    assert lines[at + 1].index("^") == lines[at].index("planner")


def test_findings_below_the_severity_are_not_printed(tmp_path, capsys) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("planner_frequenzy: 1.0\n")
    run(["check", str(file), "--json", "--severity", "error"])
    shown = json.loads(capsys.readouterr().out)["findings"]
    assert all(found["severity"] == "error" for found in shown)
    run(["check", str(file), "--json"])
    assert len(json.loads(capsys.readouterr().out)["findings"]) >= max(1, len(shown))
