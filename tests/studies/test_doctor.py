"""`navstack doctor`: which causes it tries, how it compares drives, and that the fix it writes works."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from navstack.cli.app import run as command
from navstack.explain import find_passages
from navstack.map_io import load_map
from navstack.parameters import load_configuration, packaged_folder
from navstack.scenario import Scenario, load_places
from navstack.studies import Cause, doctor, make_drives
from navstack.studies.doctor import Drives, diagnose, drive, possible_causes
from navstack.studies.jobs import Job, JobResult

OFFICE = load_map("office")


def causes(*overrides: str, robot: str = "turtlebot") -> dict[str, Cause]:
    configuration = load_configuration([robot], overrides=overrides)
    return {c.name: c for c in possible_causes(configuration, find_passages(configuration, OFFICE))}


def steepness(factor: str) -> list[str]:
    return [f"{c}_costmap/inflation_layer/cost_scaling_factor={factor}" for c in ("global", "local")]


def drives(*rows: tuple[bool, float, float, int]) -> Drives:
    made = [
        {"reached": reached, "time_s": time, "turning_s": idle, "standing_s": 0.0, "collisions": contacts}
        for reached, time, idle, contacts in rows
    ]
    return Drives(tuple(made), (100.0,) * len(made))


@pytest.mark.slow
def test_each_cause_comes_with_the_parameters_that_remove_it() -> None:
    heavy = causes("DWAPlannerROS/occdist_scale=5.0")["heavy-obstacles"]
    assert heavy.settings == {"DWAPlannerROS/occdist_scale": 0.5}
    assert heavy.overrides == ("DWAPlannerROS/occdist_scale=0.5",)
    assert "heavy-obstacles" not in causes()
    rollout = ["base_local_planner=base_local_planner/TrajectoryPlannerROS", "TrajectoryPlannerROS/meter_scoring=true"]
    heavy = causes(*rollout, "TrajectoryPlannerROS/occdist_scale=5.0")["heavy-obstacles"]
    assert 0.0 < heavy.settings["TrajectoryPlannerROS/occdist_scale"] < 5.0
    assert causes(*rollout)["scoring-scale"].settings == {"navstack/ros_distro": "noetic"}
    weights = ("DWAPlannerROS/path_distance_bias=90", "DWAPlannerROS/goal_distance_bias=24")
    assert causes(*weights)["heavy-path"].settings == {"DWAPlannerROS/path_distance_bias": 32.0}
    assert "heavy-path" not in causes()
    assert causes("navstack/ros_distro=noetic")["scoring-scale"].settings == {"navstack/ros_distro": "indigo"}
    thin = causes("global_costmap/inflation_layer/inflation_radius=0.1")["thin-inflation"]
    assert set(thin.settings) == {f"{c}_costmap/inflation_layer/inflation_radius" for c in ("global", "local")}
    assert all(value >= 0.25 for value in thin.settings.values())
    long = "footprint=[[0.1, 0.2], [0.1, -0.2], [-0.4, -0.2], [-0.4, 0.2]]"
    steep = causes(*(f"{c}_costmap/{long}" for c in ("global", "local")), *steepness("10.0"))["steep-inflation"]
    assert set(steep.settings) == {f"{c}_costmap/inflation_layer/cost_scaling_factor" for c in ("global", "local")}
    assert "steep-inflation" not in causes()
    assert causes("DWAPlannerROS/sim_time=0.5")["sim_time"].fix == "DWAPlannerROS/sim_time: 2.0"
    assert causes("DWAPlannerROS/sim_time=4.0")["sim_time"].fix == "DWAPlannerROS/sim_time: 1.7"
    assert "scoring-scale" not in causes(robot="turtlebot_rpp")
    window = "DWBLocalPlanner/forward_prune_distance"
    speeds = [f"DWBLocalPlanner/{n}=0.5" for n in ("max_vel_x", "max_vel_theta", "max_speed_xy")]
    dwb = ("base_local_planner=dwb_core::DWBLocalPlanner", *speeds)
    assert "pulled-through-walls" not in causes(*dwb, f"{window}=1.0")
    assert causes(*dwb, f"{window}=2.0")["pulled-through-walls"].settings == {window: 1.0}


@pytest.mark.slow
def test_misspelt_keys_are_one_cause(tmp_path: Path) -> None:
    file = tmp_path / "more.yaml"
    file.write_text("DWAPlannerROS: {max_vel_rot: 0.7}\nrecovery_behaviour_enabled: false\n")
    configuration = load_configuration(["turtlebot", str(file)])
    found = possible_causes(configuration, find_passages(configuration, OFFICE))
    misspelt = next(c for c in found if c.name == "misspelt")
    assert misspelt.settings == {"DWAPlannerROS/max_vel_theta": 0.7, "recovery_behavior_enabled": False}


def test_better_is_fewer_contacts_more_goals_or_less_time() -> None:
    base = drives((True, 50.0, 30.0, 0), (False, 80.0, 70.0, 0))
    assert base.time_s == 150.0  # a missed goal counts with its limit
    assert drives((True, 50.0, 30.0, 0), (True, 99.0, 70.0, 0)).better_than(base)
    assert drives((True, 30.0, 30.0, 0), (False, 9.0, 70.0, 0)).better_than(base)
    assert not drives((True, 48.0, 30.0, 0), (False, 9.0, 70.0, 0)).better_than(base)
    assert drives((True, 50.0, 5.0, 0), (False, 80.0, 5.0, 0)).better_than(base)  # as long, but not in place
    assert not drives((True, 50.0, 30.0, 1), (True, 60.0, 70.0, 0)).better_than(base)
    touched = drives((True, 50.0, 0.0, 2), (True, 50.0, 0.0, 0))
    assert drives((True, 90.0, 0.0, 0), (True, 90.0, 0.0, 0)).better_than(touched)
    assert not drives((True, 90.0, 0.0, 0), (False, 90.0, 0.0, 0)).better_than(touched)


@pytest.mark.slow
def test_drives_have_room_at_both_ends_on_any_map() -> None:
    configuration = load_configuration(["jackal_dwa"])
    places = load_places("office")
    packaged = make_drives(OFFICE, configuration, places)
    assert [d.goals[0] for d in packaged] == list(places.goals)
    free = make_drives(OFFICE, configuration, None, seed=3)
    assert len(free) == 3
    assert all(d.start.distance_to(d.goals[0]) >= 3.0 for d in free)
    assert [d.start for d in free] == [d.start for d in make_drives(OFFICE, configuration, None, seed=3)]


@pytest.mark.slow
def test_a_drive_gives_its_figures() -> None:
    (first, *_) = make_drives(OFFICE, load_configuration(["turtlebot"]), load_places("office"))
    row = drive(first)
    assert row["reached"] and row["reason"] == "" and row["collisions"] == 0
    assert 0.0 <= row["turning_s"] < row["time_s"] < 60.0


@pytest.mark.slow
def test_the_doctor_finds_and_writes_the_fix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(packaged_folder("turtlebot"), "bot")
    file = Path("bot/dwa_local_planner_params.yaml")
    healthy = file.read_text()
    broken = healthy.replace("occdist_scale: 0.5 ", "occdist_scale: 5.0 ")
    assert broken != healthy
    file.write_text(broken)
    assert command(["doctor", "bot", "--workers", "1"]) == 0
    out = capfd.readouterr().out
    assert "diagnosis 1: occdist_scale = 5 makes obstacles outweigh progress" in " ".join(out.split())
    assert file.read_text() == broken
    saved: dict[str, Any] = json.loads(Path("navstack_doctor/doctor.json").read_text())
    assert saved["settings"] == {"DWAPlannerROS/occdist_scale": 0.5}
    assert saved["after"]["reached"] == 3 > saved["drives"]["reached"]
    assert saved["after"]["time_s"] < 0.5 * saved["drives"]["time_s"]
    assert {"before.png", "after.png", "params"} <= {p.name for p in Path("navstack_doctor").iterdir()}
    assert command(["doctor", "bot", "--workers", "1", "--apply"]) == 0
    assert file.read_text() == healthy  # comments and layout, too


def test_a_packaged_set_is_not_changed(capfd: pytest.CaptureFixture[str]) -> None:
    assert command(["doctor", "turtlebot", "--apply"]) == 2
    assert "--apply cannot change the packaged set turtlebot" in capfd.readouterr().err


@pytest.mark.slow
def test_the_second_of_two_causes_is_found_on_top_of_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second drive needs both fixes; that of controller_frequency alone helps nowhere."""

    def figures(scenario: Scenario) -> dict[str, Any]:
        configuration = scenario.configuration
        longer = configuration.local_planner.params.sim_time == 2.0
        often = configuration.move_base.controller_frequency == 10.0
        reached = longer and (often or scenario.goals[0] == goals[0])
        return {"reached": reached, "time_s": 40.0, "turning_s": 0.0, "standing_s": 0.0, "collisions": 0}

    def run_jobs(work: Any, jobs: list[Job], **_: Any) -> list[JobResult]:
        return [JobResult(job.key, figures(job.input)) for job in jobs]

    monkeypatch.setattr(doctor, "run_jobs", run_jobs)
    configuration = load_configuration(
        ["turtlebot"], overrides=["DWAPlannerROS/sim_time=0.5", "controller_frequency=5.0"]
    )
    drives = make_drives(OFFICE, configuration, load_places("office"))[:2]
    goals = [scenario.goals[0] for scenario in drives]
    found = diagnose(configuration, OFFICE, drives)
    assert [tried.cause.name for tried in found.chosen] == ["sim_time", "controller_frequency"]
    assert (found.drives.reached, found.chosen[0].after.reached, found.after.reached) == (0, 1, 2)
