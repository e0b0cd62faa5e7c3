"""The packaged car and mecanum base: maneuvers without contact, and no limit exceeded by a command or by the body."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from navstack.bringup import plan_on_map
from navstack.core import Pose2D
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.scenario import Run, load_scenario, run_scenario, shipped_scenarios

SLACK = 1e-6
"""Rounding of commands computed in float32 (m/s, rad/s)."""


def driven(name: str, params: str) -> tuple[Run, dict[str, Any]]:
    """The finished run, and per control cycle: time, commands (n, 3), velocities (n, 3), steering angles."""
    run = Run(load_scenario(shipped_scenarios()[name], params=[params]), record=True)
    rows: list[tuple[float, ...]] = []
    while run.step():
        robot = run.robot
        rows.append((robot.time, *run.move_base.command, *robot.state().velocity, robot.steering_angle))
    table = np.array(rows)
    return run, {"t": table[:, 0], "command": table[:, 1:4], "velocity": table[:, 4:7], "steering": table[:, 7]}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["car_reverse_out", "car_park"])
@pytest.mark.parametrize("params", ["car_mppi", "car_rpp"])
def test_a_car_drives_a_given_path_with_changes_of_direction(name: str, params: str) -> None:
    run, rows = driven(name, params)
    result = run.result(0.0)
    assert [str(c) for c in result.conditions if not c.holds] == []
    assert result.succeeded and result.collisions == 0
    assert rows["velocity"][:, 0].min() < -0.2 and rows["velocity"][:, 0].max() > 0.2  # both directions
    sim = run.scenario.configuration.navstack.sim
    limits = run.move_base.local_planner.limits
    # the body
    assert np.abs(rows["steering"]).max() <= sim.steering_limit + 1e-12
    dt = np.diff(rows["t"])
    assert (np.abs(np.diff(rows["steering"])) <= sim.max_steering_rate * dt + 1e-9).all()
    assert (np.abs(np.diff(rows["velocity"][:, 0])) <= sim.acc_lim_x * dt + 1e-9).all()
    assert (np.abs(rows["velocity"][:, 0]) >= sim.turning_radius * np.abs(rows["velocity"][:, 2]) - 1e-9).all()
    # the commands of the controller, but for the stop at the goal
    command = rows["command"][: np.flatnonzero(np.any(rows["command"] != 0.0, axis=1))[-1] + 1]
    assert limits.min_vel_x - SLACK <= command[:, 0].min() and command[:, 0].max() <= limits.max_vel_x + SLACK
    assert np.abs(command[:, 1]).max() == 0.0
    assert np.abs(command[:, 2]).max() <= limits.max_vel_theta + SLACK
    assert limits.min_turning_radius == 0.85 >= sim.turning_radius
    assert (np.abs(command[:, 0]) >= limits.min_turning_radius * np.abs(command[:, 2]) - SLACK).all()
    period = 0.05
    assert np.abs(np.diff(command[:, 0])).max() <= limits.acc_lim_x * period + SLACK
    assert np.abs(np.diff(command[:, 2])).max() <= limits.acc_lim_theta * period + SLACK


def test_the_steering_follows_the_closed_form_of_the_last_command() -> None:
    """Driving on the arc of the given path, the wheel is at atan(wheelbase * curvature)."""
    run, rows = driven("car_reverse_out", "car_rpp")
    sim = run.scenario.configuration.navstack.sim
    moving = np.abs(rows["velocity"][:, 0]) > 0.1
    curvature = rows["velocity"][moving, 2] / rows["velocity"][moving, 0]
    assert np.arctan(sim.wheelbase * curvature) == pytest.approx(rows["steering"][moving], abs=1e-9)
    assert math.atan(sim.wheelbase / sim.turning_radius) == pytest.approx(sim.steering_limit)


@pytest.mark.slow
@pytest.mark.parametrize("params", ["omni_mppi", "omni_dwa"])
def test_a_mecanum_base_drives_through_the_office(params: str) -> None:
    run, rows = driven("omni_office", params)
    result = run.result(0.0)
    assert [str(c) for c in result.conditions if not c.holds] == []
    assert result.succeeded and result.collisions == 0
    assert np.abs(rows["velocity"][:, 1]).max() > 0.05  # it uses its sideways motion
    limits = run.move_base.local_planner.limits
    command = rows["command"]
    assert np.abs(command[:, 0]).max() <= limits.max_vel_x + SLACK
    assert np.abs(command[:, 1]).max() <= limits.max_vel_y + SLACK
    assert np.abs(command[:, 2]).max() <= limits.max_vel_theta + SLACK


def test_a_path_that_is_too_tight_is_named_with_its_place() -> None:
    """A planner on cells begins with a corner; the plan says where, in the record and in `explain goal`."""
    scenario = load_scenario(
        shipped_scenarios()["car_park"],
        params=["car_rpp"],
        overrides=["base_global_planner=navfn"],
        goals=[Pose2D(7.0, 11.4, 0.0)],
        time_limit_s=0.5,
    )
    result = run_scenario(scenario)
    assert result.recorder is not None
    plans = [event for event in result.recorder.record().events if event.kind == "plan"]
    assert len(plans) == 1
    note = plans[0].data["notes"][-1]
    match = re.fullmatch(
        r"the path turns on (\S+) m at \((\S+), (\S+)\), but the base turns on 0.85 m at least, .*", note
    )
    assert match is not None, note
    assert float(match[1]) < 0.85


# --- braking after a cancel -------------------------------------------------------------------------------------------


def canceled(*overrides: str, again: bool = False) -> tuple[Run, list[tuple[float, float, str]]]:
    """A car that is canceled in full drive; per cycle time, speed commanded and activity. `again`: a new goal meanwhile."""
    run = Run(load_scenario(shipped_scenarios()["car_reverse_out"], params=["car_rpp"], overrides=overrides))
    robot, move_base = run.robot, run.move_base
    rows: list[tuple[float, float, str]] = []
    while run.step() and len(rows) < 40:
        rows.append((robot.time, move_base.command.vx, move_base.activity))
    move_base.cancel_all_goals()
    while len(rows) < 80:
        if again and len(rows) == 45:
            move_base.send_goal(Pose2D(13.4, 6.7, -1.57))
        robot.advance_to(move_base.next_due(robot.time + 1e-6))
        move_base.tick(robot.time)
        rows.append((robot.time, move_base.command.vx, move_base.activity))
    run.goals.finish_ended()
    return run, rows


def test_a_canceled_car_stops_at_once_or_brakes() -> None:
    _, rows = canceled()
    assert rows[39][1] == pytest.approx(-0.7)
    assert rows[40][1:] == (0.0, "IDLE")
    run, rows = canceled(
        "RegulatedPurePursuitController/use_cancel_deceleration=true",
        "RegulatedPurePursuitController/cancel_deceleration=1.0",
    )
    speeds = [speed for _, speed, _ in rows[39:]]
    # 0.7 m/s by 0.05 m/s a cycle: 13 commands, then the stop
    assert speeds[:16] == pytest.approx([*np.linspace(-0.7, -0.05, 14), 0.0, 0.0], abs=1e-9)
    assert [activity for _, _, activity in rows[39:54]] == [*["CONTROLLING"] * 14, "IDLE"]
    assert run.outcomes[0].state == "PREEMPTED" and run.outcomes[0].error_name == "CANCELED"


def test_a_new_goal_ends_the_braking() -> None:
    _, rows = canceled(
        "RegulatedPurePursuitController/use_cancel_deceleration=true",
        "RegulatedPurePursuitController/cancel_deceleration=1.0",
        again=True,
    )
    assert rows[44][1] == pytest.approx(-0.45)
    assert rows[60][1] == pytest.approx(-0.7)


def test_plan_names_the_place_where_a_path_is_too_tight() -> None:
    """`navstack plan` says so, too, without driving."""
    configuration = load_configuration(["car_rpp"], overrides=["base_global_planner=navfn"])
    assert configuration.turning_radius == 0.85
    found = plan_on_map(configuration, load_map(map_path("warehouse")), Pose2D(7.0, 8.0), Pose2D(7.0, 11.4))
    assert any(note.startswith("the path turns on ") for note in found.plan.notes)
    plain = load_configuration(["omni_dwa"])
    assert plain.turning_radius == 0.0
    assert plan_on_map(plain, load_map(map_path("warehouse")), Pose2D(7.0, 8.0), Pose2D(7.0, 11.4)).plan.notes == ()
