"""The timeline of a goal, from the record: text, numbers and picture."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.cli.app import run
from navstack.core import Event, InputError, Pose2D, RecordError
from navstack.explain.goal import GoalReport, TimelineEntry, collision_text, explain_goal, explain_goals, plan_lines
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.scenario import Run, Scenario
from navstack.scenario.interactions import Kidnap
from tests.explain.conftest import scenario

WALL = Pose2D(2.0, 0.0, 0.0)


def driven(scenario_: Scenario, *, cancel_at: float | None = None, replace_at: float | None = None) -> Record:
    drive = Run(scenario_)
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


def of(report: GoalReport, kind: str) -> list[TimelineEntry]:
    return [line for line in report.timeline if line.kind == kind]


def test_reached_goal(record: Record) -> None:
    first, second = explain_goals(record)
    for report, result in zip((first, second), record.results, strict=True):
        assert report.status == "SUCCEEDED"
        assert report.duration == pytest.approx(result["time_s"])
        assert report.summary.startswith(
            f"reached after {result['time_s']:.1f} s, {result['path_length_m']:.2f} m driven"
        )
        assert report.distance[-1] == pytest.approx(result["distance_left_m"], abs=0.01)
        assert report.pose == Pose2D(*result["goal"])
        # the states cover the goal without gaps
        assert [s.begin for s in report.spans][1:] == [s.end for s in report.spans][:-1]
        assert (report.spans[0].begin, report.spans[-1].end) == (report.accepted, report.ended)
        assert report.seconds("CONTROLLING") > 0.9 * report.duration
        # a plan at once, and every plan event in some line
        assert report.plan_times[0] == report.accepted
        assert sum(line.count for line in of(report, "plan")) == len(report.plan_times)
        assert report.timeline[-1].text == 'SUCCEEDED: "Goal reached."'
    assert len(first.plan_times) + len(second.plan_times) == len(record.events_of("plan"))
    assert first.ended == second.sent


def test_distance_along_the_plan_is_that_of_the_plan_in_force(record: Record) -> None:
    report = explain_goal(record, 1)
    plan = record.plans[0]
    step = np.hypot(*np.diff(plan.poses[:, :2], axis=0).T)
    assert report.remaining[0] == pytest.approx(float(step.sum()), abs=0.06)
    # at least the straight-line distance, up to the size of cells
    assert (report.remaining >= report.distance - 0.15).all()
    k = int(np.searchsorted(report.times, 3.0))
    at, now = record.poses[k], next(p for p in reversed(record.plans) if p.t <= report.times[k])
    away = np.hypot(now.poses[:, 0] - at[0], now.poses[:, 1] - at[1])
    near = int(away.argmin())
    left = float(away[near]) + float(np.hypot(*np.diff(now.poses[near:, :2], axis=0).T).sum())
    assert report.remaining[k] == pytest.approx(left)


def test_goal_in_a_wall(unreachable: Record) -> None:
    (report,) = explain_goals(unreachable)
    assert report.status == "ABORTED"
    assert (report.error_code, report.error_name) == (206, "GOAL_OCCUPIED")
    assert [r.name for r in report.recoveries] == [
        "conservative_reset",
        "rotate_recovery",
        "aggressive_reset",
        "rotate_recovery",
    ][: len(report.recoveries)]
    assert [r.number for r in report.recoveries] == list(range(1, len(report.recoveries) + 1))
    assert report.recoveries[0].type == "ClearCostmapRecovery"
    failed = of(report, "plan_failed")
    assert sum(line.count for line in failed) == len(unreachable.events_of("plan_failed")) == len(report.failed_plans)
    assert failed[0].text.startswith("planning failed ")
    assert "GOAL_OCCUPIED (206): the goal (2.000, 0.000) is in a cell of cost" in failed[0].text
    assert failed[0].text.endswith("; planner patience exhausted (planner_patience 1)")
    assert any("GOAL_OCCUPIED (206), as before" in line.text for line in failed[1:])
    first = of(report, "recovery")[0]
    cleared = unreachable.events_of("recovery")[0].data["cells_cleared"]
    cells = sum(sum(layers.values()) for layers in cleared.values())
    assert report.recoveries[0].cleared == cells
    assert first.text.startswith(
        f"recovery 1 of {report.recoveries[0].total}, conservative_reset (ClearCostmapRecovery): "
    )
    turn = next(line for line in of(report, "recovery") if "rotate_recovery" in line.text)
    assert turn.end - turn.begin > 5.0
    assert f"done after {turn.end - turn.begin:.1f} s: Rotate recovery behavior finished." in turn.text
    assert report.timeline[-1].text.startswith(
        'ABORTED: "Failed to find a valid plan. Even after executing recovery behaviors." Error GOAL_OCCUPIED (206): '
    )
    assert ": GOAL_OCCUPIED (206); planning failed" in report.summary
    assert [line.begin for line in report.timeline] == sorted(line.begin for line in report.timeline)


def test_a_robot_that_only_rotates_is_stuck_and_makes_no_progress() -> None:
    blocked = impatient("DWAPlannerROS/max_vel_x=0.0", "oscillation_timeout=4.0", "recovery_behavior_enabled=false")
    (report,) = explain_goals(driven(replace(blocked, goals=(Pose2D(1.0, -2.5, 1.5),))))
    assert (report.status, report.error_name) == ("ABORTED", "FAILED_TO_MAKE_PROGRESS")
    (stuck,) = of(report, "stuck")
    assert "in place for" in stuck.text or "did not move for" in stuck.text
    assert "failed" not in stuck.text
    (line,) = of(report, "control_failed")
    assert line.text == (
        "no progress: FAILED_TO_MAKE_PROGRESS (105): the robot moved less than 0.2 m in 4 s; oscillation timeout reached "
        "(oscillation_timeout 4, oscillation_distance 0.2)"
    )
    assert "control failed once (FAILED_TO_MAKE_PROGRESS)" in report.summary


def test_no_valid_command() -> None:
    blocked = impatient(
        "local_costmap/footprint_padding=3.0", "controller_patience=1.0", "recovery_behavior_enabled=false"
    )
    (report,) = explain_goals(driven(replace(blocked, goals=(Pose2D(1.0, -2.5, 1.5),))))
    assert (report.status, report.error_name) == ("ABORTED", "NO_VALID_CONTROL")
    lines = of(report, "control_failed")
    assert sum(line.count for line in lines) == len(report.failed_commands) > 2
    assert lines[-1].text.endswith("; controller patience exhausted (controller_patience 1)")


def test_plans_between_failures_of_the_controller_share_a_line() -> None:
    def event(kind: str, time: float, length: float = 2.0) -> Event:
        return Event(time, kind, "", {"length_m": length} if kind == "plan" else {})

    kinds = ["plan", "plan", "control_failed", "plan", "control_failed", "plan", "recovery", "plan"]
    lines = plan_lines([event(kind, 0.1 * k, 2.0 - 0.1 * k) for k, kind in enumerate(kinds)])
    assert [line.text for line in lines] == [
        "plan found: 2.00 m",
        "replanned: 1.90 m",
        "replanned 2 times: from 1.70 m to 1.50 m",
        "plan found: 1.30 m",
    ]


def test_canceled_and_replaced_goals() -> None:
    (report,) = explain_goals(driven(replace(scenario(), goals=(Pose2D(0.0, 1.5, 1.5),)), cancel_at=2.0))
    assert report.status == "PREEMPTED"
    assert report.summary.endswith("from the goal: canceled")
    assert of(report, "cancel")[0].begin == pytest.approx(2.0, abs=0.25)
    goals = (Pose2D(0.0, 1.5, 1.5), Pose2D(0.0, -2.5, 1.5))
    replaced, other, _ = explain_goals(driven(replace(scenario(), goals=goals), replace_at=2.0))
    assert (replaced.status, other.id, other.status) == ("PREEMPTED", "other", "PREEMPTED")
    assert replaced.summary.endswith(": replaced by another goal")
    assert other.spans[0].begin == other.accepted == replaced.ended


def test_record_without_terminal_state(record: Record) -> None:
    events = [e for e in record.events if e.time < 3.0]
    cut = Record(record.meta | {"results": []}, [], record.arrays)
    cut.events = tuple(events)
    report = explain_goal(cut, 1)
    assert report.status == "ACTIVE"
    assert report.timeline[-1].text == "the record ends while the goal is ACTIVE"


def test_unknown_goal_number(record: Record) -> None:
    with pytest.raises(InputError, match=r"--goal 3: this run has goals 1 to 2$"):
        explain_goal(record, 3)
    empty = Record(record.meta, [], record.arrays)
    with pytest.raises(RecordError, match="contains no goal"):
        explain_goals(empty)


@pytest.mark.slow
def test_command_prints_draws_and_writes(
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
    assert document["timeline"][0]["kind"] == "goal"
    assert run(["explain", "goal", str(run_folder), "--goal", "9"]) == 2
    assert "this run has goals 1 to 2" in capsys.readouterr().err
    assert run(["explain", "goal", str(run_folder), "--out", str(tmp_path / "goals.gif")]) == 2
    assert "the suffix must be one of" in capsys.readouterr().err
    assert not (tmp_path / "goals.gif").exists()


@pytest.mark.slow
def test_picture_shows_failures_and_plans(tmp_path: Path, unreachable: Record) -> None:
    from navstack.plot import plot_goal_reports

    path = tmp_path / "wall.png"
    plot_goal_reports(explain_goals(unreachable), path, record=unreachable)
    again = tmp_path / "again.png"
    plot_goal_reports(explain_goals(unreachable), again, record=unreachable)
    assert path.read_bytes() == again.read_bytes()
    with Image.open(path) as image:
        shown = {rgb for n, rgb in image.convert("RGB").getcolors(1 << 24) or () if n > 50}
    vermillion, blue = (213, 94, 0), (0, 114, 178)
    assert {vermillion, blue} <= shown


def test_goal_that_never_became_active() -> None:
    drive = Run(replace(scenario(), goals=(Pose2D(0.0, 1.5, 1.5),)))
    for _ in range(5):
        drive.step()
    late = drive.move_base.send_goal(Pose2D(0.0, -1.0), stamp=-1.0, goal_id="late")
    assert late.status.name == "RECALLED"
    drive.stop()
    assert drive.recorder is not None
    record = drive.recorder.record()
    report = explain_goals(record)[1]
    assert (report.id, report.status, report.accepted) == ("late", "RECALLED", None)
    assert report.spans == ()
    assert not len(report.times)
    assert math.isfinite(report.ended)
    assert report.timeline[-1].text.startswith('RECALLED: "This goal was canceled because another goal was recieved')


def test_an_expired_time_limit_is_not_called_a_cancel() -> None:
    far = replace(scenario(), goals=(Pose2D(0.0, 1.5, 1.5),), time_limit_s=2.0)
    (report,) = explain_goals(driven(far))
    assert (report.status, report.expired_limit_s) == ("ABORTED", 2.0)
    assert report.summary.endswith("from the goal: time limit of 2 s exceeded")
    assert "cancel" not in report.summary
    assert (report.error_code, report.error_name) == (9016, "GOAL_TIME_LIMIT")
    assert of(report, "cancel") == []
    assert report.timeline[-1].text == (
        "ABORTED: GOAL_TIME_LIMIT (9016): the goal was not reached within its time limit of 2 s"
    )
    assert report.as_dict()["expired_limit_s"] == 2.0
    (canceled,) = explain_goals(driven(replace(far, time_limit_s=60.0), cancel_at=1.0))
    assert canceled.expired_limit_s is None
    assert canceled.summary.endswith(": canceled")


@pytest.mark.slow
def test_a_kidnapped_robot_finds_itself_and_the_timeline_says_so() -> None:
    overrides = ["navstack/sim/localization=amcl", "navstack/sim/laser/fov=4.0", "navstack/sim/laser/beams=90"]
    overrides += ["amcl/max_particles=800", "recovery_behaviors=[{name: localize, type: spin_to_localize}]"]
    overrides += ["navstack/sim/laser/range_max=10.0"]
    configuration = load_configuration(["turtlebot"], overrides=overrides)
    kidnap = Kidnap(time=3.0, pose=[16.9, 9.6, 0.5])
    start, goal = Pose2D(0.8, 7.45, 0.0), Pose2D(16.9, 11.0, 1.57)
    grid = load_map(map_path("office"))
    found = driven(Scenario(map=grid, configuration=configuration, start=start, goals=(goal,), interactions=(kidnap,)))
    report = explain_goal(found, 1)
    assert report.status == "SUCCEEDED"
    (off,) = of(report, "lost")
    assert re.match(r"believed pose \d+\.\d m and \d+ degrees off since 3\.\d s, until ", off.text)
    assert off.begin == pytest.approx(3.2, abs=0.3)
    assert off.data["off_m"] > 14.0
    (warned,) = of(report, "warning")
    assert re.match(r"lost since 3\.\d s: from the believed pose the map explains \d+% of the scan", warned.text)
    assert warned.begin < 8.0
    (recovery,) = report.recoveries
    assert (recovery.name, recovery.trigger) == ("localize", "LOST_R")
    assert [line for line in of(report, "info") if "is localized again" in line.text]


def test_a_goal_names_the_sensor_that_went_blind() -> None:
    rates = [f"{name}/obstacle_layer/scan/expected_update_rate=0.5" for name in ("local_costmap", "global_costmap")]
    record = driven(impatient(*rates, "controller_patience=2.0", "navstack/sim/laser/dropout=0.98"))
    report = explain_goal(record, 1)
    assert 'of "scan" are valid' in of(report, "warning")[0].text
    assert 'of "scan" are valid' in of(report, "end")[0].text


def test_a_collision_says_whether_the_local_costmap_had_the_obstacle(record: Record) -> None:
    t = record.duration
    costmap = record.costmap_at("local", t)
    assert costmap is not None
    g = costmap.geometry
    iy, ix = np.argwhere(costmap.data == 254)[0].tolist()
    to_global = record.to_global(record.costmap_frame("local"), t)
    [(x, y)] = to_global.apply_points(np.array([g.cell_to_world(ix, iy)])).tolist()
    # the footprint touches the marked cell, with any heading
    for yaw in (0.0, 2.0):
        near = collision_text(record, t, Pose2D(x - record.footprint.inscribed_radius, y, yaw))
        assert re.fullmatch(r"collision at \(.*\) with an obstacle that the local costmap had, marked at \(.*\)", near)
    far = collision_text(record, t, Pose2D(x + 100.0, y, 0.0))
    assert "an obstacle that the local costmap did not have; the nearest one that it had, at" in far
    assert collision_text(record, -1.0, Pose2D(1.0, 2.0, 0.0)) == "collision at (1.00, 2.00)"
