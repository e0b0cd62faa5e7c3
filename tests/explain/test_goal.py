"""The time line of a goal: told from the record, in words that hold, drawn as it was."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.cli.app import run
from navstack.core import Pose2D
from navstack.core.errors import InputError, RecordError
from navstack.explain.goal import GoalAccount, Line, explain_goal, explain_goals
from navstack.parameters.configuration import load_configuration
from navstack.record import Record
from navstack.scenario import Run, Scenario
from tests.explain.conftest import scenario

WALL = Pose2D(2.0, 0.0, 0.0)


def driven(told: Scenario, *, cancel_at: float | None = None, replace_at: float | None = None) -> Record:
    drive = Run(told)
    while drive.step():
        time = drive.robot.time
        if cancel_at is not None and time >= cancel_at:
            drive.move_base.cancel_all_goals()
            cancel_at = None
        if replace_at is not None and time >= replace_at:
            drive.move_base.send_goal(Pose2D(0.0, -1.5, 1.5), goal_id="other")
            replace_at = None
    assert drive.recorder is not None
    return drive.recorder.record()


def impatient(*overrides: str) -> Scenario:
    configuration = load_configuration(["turtlebot"], overrides=["planner_patience=1.0", *overrides])
    return replace(scenario(), configuration=configuration, goals=(WALL,))


@pytest.fixture(scope="module")
def unreachable() -> Record:
    return driven(impatient())


def of(account: GoalAccount, kind: str) -> list[Line]:
    return [line for line in account.lines if line.kind == kind]


def test_a_goal_that_is_reached(record: Record) -> None:
    first, second = explain_goals(record)
    for account, result in zip((first, second), record.results, strict=True):
        assert account.status == "SUCCEEDED"
        assert account.duration == pytest.approx(result["time_s"])
        assert account.verdict.startswith(
            f"reached after {result['time_s']:.1f} s, {result['path_length_m']:.2f} m driven"
        )
        assert account.distance[-1] == pytest.approx(result["distance_left_m"], abs=0.01)
        assert account.pose == Pose2D(*result["goal"])
        # states cover the whole of it, without gaps
        assert [s.begin for s in account.spans][1:] == [s.end for s in account.spans][:-1]
        assert (account.spans[0].begin, account.spans[-1].end) == (account.accepted, account.ended)
        assert account.seconds("CONTROLLING") > 0.9 * account.duration
        # a plan at once, and every event of that kind told in some line
        assert account.plan_times[0] == account.accepted
        assert sum(line.count for line in of(account, "plan")) == len(account.plan_times)
        assert account.lines[-1].text == 'SUCCEEDED: "Goal reached."'
    assert len(first.plan_times) + len(second.plan_times) == len(record.events_of("plan"))
    assert first.ended == second.sent


def test_distance_along_the_plan_is_that_of_the_plan_in_force(record: Record) -> None:
    account = explain_goal(record, 1)
    plan = record.plans[0]
    step = np.hypot(*np.diff(plan.poses[:, :2], axis=0).T)
    assert account.remaining[0] == pytest.approx(float(step.sum()), abs=0.06)
    # never shorter than the straight line, but for the planner's cells
    assert (account.remaining >= account.distance - 0.15).all()
    k = int(np.searchsorted(account.times, 3.0))
    at, now = record.poses[k], next(p for p in reversed(record.plans) if p.t <= account.times[k])
    away = np.hypot(now.poses[:, 0] - at[0], now.poses[:, 1] - at[1])
    near = int(away.argmin())
    left = float(away[near]) + float(np.hypot(*np.diff(now.poses[near:, :2], axis=0).T).sum())
    assert account.remaining[k] == pytest.approx(left)


def test_a_goal_in_a_wall(unreachable: Record) -> None:
    (account,) = explain_goals(unreachable)
    assert account.status == "ABORTED"
    assert (account.error_code, account.error_name) == (206, "GOAL_OCCUPIED")
    assert [r.name for r in account.recoveries] == [
        "conservative_reset",
        "rotate_recovery",
        "aggressive_reset",
        "rotate_recovery",
    ][: len(account.recoveries)]
    assert [r.number for r in account.recoveries] == list(range(1, len(account.recoveries) + 1))
    assert account.recoveries[0].type == "ClearCostmapRecovery"
    failed = of(account, "plan_failed")
    assert sum(line.count for line in failed) == len(unreachable.events_of("plan_failed")) == len(account.failed_plans)
    assert failed[0].text.startswith("the global planner failed ")
    assert "GOAL_OCCUPIED (206): the goal (2.000, 0.000) is in a cell of cost" in failed[0].text
    assert failed[0].text.endswith("; patience with the global planner is used up (planner_patience 1)")
    assert any("GOAL_OCCUPIED (206), as before" in line.text for line in failed[1:])
    first = of(account, "recovery")[0]
    cleared = unreachable.events_of("recovery")[0].data["cells_cleared"]
    cells = sum(sum(layers.values()) for layers in cleared.values())
    assert account.recoveries[0].cleared == cells
    assert first.text.startswith(
        f"recovery 1 of {account.recoveries[0].total}, conservative_reset (ClearCostmapRecovery), "
    )
    turn = next(line for line in of(account, "recovery") if "rotate_recovery" in line.text)
    assert turn.end - turn.begin > 5.0
    assert f"done after {turn.end - turn.begin:.1f} s: Rotate recovery behavior finished." in turn.text
    assert account.lines[-1].text.startswith(
        'ABORTED: "Failed to find a valid plan. Even after executing recovery behaviors." The reason: GOAL_OCCUPIED (206): '
    )
    assert "because of GOAL_OCCUPIED (206); planning failed" in account.verdict
    assert [line.begin for line in account.lines] == sorted(line.begin for line in account.lines)


def test_a_robot_that_only_turns_is_held_up_and_gets_nowhere() -> None:
    told = impatient("DWAPlannerROS/max_vel_x=0.0", "oscillation_timeout=4.0", "recovery_behavior_enabled=false")
    (account,) = explain_goals(driven(replace(told, goals=(Pose2D(1.0, -2.5, 1.5),))))
    assert (account.status, account.error_name) == ("ABORTED", "FAILED_TO_MAKE_PROGRESS")
    (held,) = of(account, "held_up")
    assert "on the spot for" in held.text or "stood still for" in held.text
    assert "failed" not in held.text
    (line,) = of(account, "control_failed")
    assert line.text == (
        "the robot got nowhere: FAILED_TO_MAKE_PROGRESS (105): the robot moved less than 0.2 m in 4 s; patience with "
        "the robot's progress is used up (oscillation_timeout 4, oscillation_distance 0.2)"
    )
    assert "control failed once FAILED_TO_MAKE_PROGRESS" in account.verdict


def test_a_robot_that_finds_no_command() -> None:
    told = impatient(
        "local_costmap/footprint_padding=3.0", "controller_patience=1.0", "recovery_behavior_enabled=false"
    )
    (account,) = explain_goals(driven(replace(told, goals=(Pose2D(1.0, -2.5, 1.5),))))
    assert (account.status, account.error_name) == ("ABORTED", "NO_VALID_CONTROL")
    lines = of(account, "control_failed")
    assert sum(line.count for line in lines) == len(account.failed_commands) > 2
    assert lines[-1].text.endswith("; patience with the local planner is used up (controller_patience 1)")


def test_cancelled_and_replaced() -> None:
    (account,) = explain_goals(driven(replace(scenario(), goals=(Pose2D(0.0, 1.5, 1.5),)), cancel_at=2.0))
    assert account.status == "PREEMPTED"
    assert account.verdict.endswith("from the goal: cancelled")
    assert of(account, "cancel")[0].begin == pytest.approx(2.0, abs=0.25)
    goals = (Pose2D(0.0, 1.5, 1.5), Pose2D(0.0, -2.5, 1.5))
    replaced, other, _ = explain_goals(driven(replace(scenario(), goals=goals), replace_at=2.0))
    assert (replaced.status, other.id, other.status) == ("PREEMPTED", "other", "PREEMPTED")
    assert replaced.verdict.endswith("another goal took its place")
    assert other.spans[0].begin == other.accepted == replaced.ended


def test_a_record_that_stops_in_the_middle(record: Record) -> None:
    events = [e for e in record.events if e.time < 3.0]
    cut = Record(record.meta | {"results": []}, [], record.arrays)
    cut.events = tuple(events)
    account = explain_goal(cut, 1)
    assert account.status == "ACTIVE"
    assert account.lines[-1].text == "the record ends while the goal is ACTIVE"


def test_numbers_that_are_none(record: Record) -> None:
    with pytest.raises(InputError, match=r"--goal 3: this run has goals 1 to 2$"):
        explain_goal(record, 3)
    empty = Record(record.meta, [], record.arrays)
    with pytest.raises(RecordError, match="holds no goal"):
        explain_goals(empty)


def test_the_command_says_draws_and_writes(
    tmp_path: Path, unreachable: Record, run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "goals.png"
    assert run(["explain", "goal", str(run_folder), "--out", str(picture)]) == 0
    out = capsys.readouterr().out
    assert "goal 1: reached after" in out
    assert "goal 2: reached after" in out
    assert f"picture: {picture}" in out
    with Image.open(picture) as image:
        image.load()
        assert min(image.size) > 600
    assert run(["explain", "goal", str(run_folder), "--goal", "2", "--json"]) == 0
    (document,) = json.loads(capsys.readouterr().out)["goals"]
    assert document["number"] == 2
    assert document["seconds"]["CONTROLLING"] > 1.0
    assert document["lines"][0]["kind"] == "goal"
    assert run(["explain", "goal", str(run_folder), "--goal", "9"]) == 2
    assert "this run has goals 1 to 2" in capsys.readouterr().err
    assert run(["explain", "goal", str(run_folder), "--out", str(tmp_path / "goals.gif")]) == 2
    assert "its ending must be one of" in capsys.readouterr().err
    assert not (tmp_path / "goals.gif").exists()


def test_the_picture_shows_what_happened(tmp_path: Path, unreachable: Record) -> None:
    from navstack.cli.explain_goal import draw

    path = tmp_path / "wall.png"
    draw(unreachable, explain_goals(unreachable), path)
    again = tmp_path / "again.png"
    draw(unreachable, explain_goals(unreachable), again)
    assert path.read_bytes() == again.read_bytes()
    with Image.open(path) as image:
        shown = {rgb for n, rgb in image.convert("RGB").getcolors(1 << 24) or () if n > 50}
    vermillion, blue = (213, 94, 0), (0, 114, 178)
    assert {vermillion, blue} <= shown


def test_a_goal_that_was_never_begun() -> None:
    drive = Run(replace(scenario(), goals=(Pose2D(0.0, 1.5, 1.5),)))
    for _ in range(5):
        drive.step()
    late = drive.move_base.send_goal(Pose2D(0.0, -1.0), stamp=-1.0, goal_id="late")
    assert late.status.name == "RECALLED"
    drive.stop()
    assert drive.recorder is not None
    record = drive.recorder.record()
    account = explain_goals(record)[1]
    assert (account.id, account.status, account.accepted) == ("late", "RECALLED", None)
    assert account.spans == ()
    assert not len(account.times)
    assert math.isfinite(account.ended)
    assert account.lines[-1].text.startswith('RECALLED: "This goal was canceled because another goal was recieved')
