"""Random scenarios by number: maps, robots, parameters, noise and obstacles, including unusual combinations.

`check_random` drives one and checks invariants: no exception, no hang, a terminal state and a reason for every goal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from navstack.core import InputError, OccupancyGrid, PlanningError, Pose2D
from navstack.scenario import random_maps
from navstack.scenario.outcome import RunResult
from navstack.scenario.random_maps import FreeSpace
from navstack.scenario.run import Run
from navstack.scenario.scenario import Scenario
from navstack.scenario.spec import ScenarioSpec
from navstack.scenario.success import TERMINAL_STATES
from navstack.sim import DoorMotion, OnTrack, PedestrianMotion, Shape

GLOBAL_PLANNERS: Final = (
    *("navfn/NavfnROS", "global_planner/GlobalPlanner", "astar", "theta_star", "carrot_planner/CarrotPlanner"),
)
LOCAL_PLANNERS: Final = ("dwa_local_planner/DWAPlannerROS", "base_local_planner/TrajectoryPlannerROS")


def random_scenario(number: int, *, time_limit_s: float = 12.0) -> ScenarioSpec:
    """Returns the scenario with that number, always the same. `time_limit_s`: maximum simulated seconds per goal."""
    rng = np.random.Generator(np.random.PCG64([number, 20]))
    kind, grid = _map(rng)
    footprint, radius = _footprint(rng)
    space = FreeSpace(grid, radius + 0.02)
    if space.is_empty:
        grid = random_maps.discs(rng, 6.0, 6.0, 0.02, (0.1, 0.2))
        space = FreeSpace(grid, radius + 0.02)
    start = space.draw(rng)
    goals = tuple(_goal(rng, space, grid) for _ in range(1 + int(rng.integers(2))))
    kinematics = _pick(rng, ("differential", "differential", "holonomic", "ackermann"))
    values = {
        "name": f"random {number} ({kind}, {kinematics})",
        "start": start,
        "goals": goals,
        "seed": int(rng.integers(1 << 31)),
        "time_limit_s": time_limit_s * float(rng.uniform(0.6, 1.0)),
        "pause_s": _pick(rng, (0.0, 0.0, 0.5)),
        "stop_on_failure": bool(rng.random() < 0.2),
    }
    overlays = [_parameters(rng, footprint, kinematics), {"navstack": {"sim": _body(rng, kinematics)}}]
    values["shapes"] = _shapes(rng, space, start, radius)
    names = ("",) * len(goals)
    return ScenarioSpec(values, grid=grid, sources=["turtlebot"], overlays=[*overlays], goal_names=names)


def _pick(rng: np.random.Generator, choices: tuple[Any, ...]) -> Any:
    return choices[int(rng.integers(len(choices)))]


def _map(rng: np.random.Generator) -> tuple[str, OccupancyGrid]:
    kind = _pick(rng, ("rooms", "maze", "discs", "caves"))
    width, height = rng.uniform(5.0, 10.0), rng.uniform(5.0, 10.0)
    if kind == "rooms":
        return kind, random_maps.rooms(rng, width, height, (0.5, 1.2))
    if kind == "maze":
        return kind, random_maps.maze(rng, width, height, rng.uniform(0.7, 1.4), rng.uniform(0.0, 0.5))
    if kind == "discs":
        return kind, random_maps.discs(rng, width, height, rng.uniform(0.05, 0.6), (0.05, 0.35))
    return kind, random_maps.caves(rng, width, height, rng.uniform(0.1, 0.3))


def _footprint(rng: np.random.Generator) -> tuple[dict[str, Any], float]:
    """Returns the footprint as parameters, and its circumscribed radius (m)."""
    shape = _pick(rng, ("round", "round", "box", "polygon"))
    if shape == "round":
        radius = round(rng.uniform(0.1, 0.3), 3)
        return {"robot_radius": radius}, radius
    if shape == "box":
        a, b, ahead = rng.uniform(0.12, 0.3), rng.uniform(0.1, 0.2), rng.uniform(-0.05, 0.1)
        points = [[ahead + a, b], [ahead - a, b], [ahead - a, -b], [ahead + a, -b]]
    else:
        turns = np.sort(rng.uniform(0.0, 2.0 * math.pi, 7)) + np.arange(7) * 1e-3
        # spread over the full circle, so that the center is inside
        turns = 0.3 * turns + 0.7 * np.arange(7) * (2.0 * math.pi / 7)
        points = [[r * math.cos(t), r * math.sin(t)] for t, r in zip(turns, rng.uniform(0.12, 0.28, 7), strict=True)]
    points = [[round(x, 3), round(y, 3)] for x, y in points]
    return {"footprint": points}, max(math.hypot(x, y) for x, y in points)


def _goal(rng: np.random.Generator, space: FreeSpace, grid: OccupancyGrid) -> Pose2D:
    """Draws a goal: usually in the free space, sometimes anywhere on the map, rarely outside of it."""
    chance = rng.random()
    if chance < 0.8:
        return space.draw(rng)
    left, right, bottom, top = grid.geometry.extent
    margin = 0.0 if chance < 0.93 else 2.0
    x, y = rng.uniform(left - margin, right + margin), rng.uniform(bottom - margin, top + margin)
    return Pose2D(round(x, 3), round(y, 3), round(rng.uniform(-math.pi, math.pi), 4))


def _shapes(rng: np.random.Generator, space: FreeSpace, start: Pose2D, radius: float) -> tuple[Shape, ...]:
    """Draws up to five obstacles that are not on the map, away from the start."""
    found: list[Shape] = []
    for _ in range(int(rng.integers(6))):
        at = space.draw(rng)
        size = round(rng.uniform(0.05, 0.3), 3)
        if at.distance_to(start) < radius + 2.5 * size + 0.3:
            continue
        other = space.draw(rng)
        kind = _pick(rng, ("disc", "low", "box", "track", "door", "pedestrian"))
        place = [at.x, at.y, at.yaw]
        if kind in ("disc", "low"):
            found.append(Shape(radius=size, pose=place, height=0.1 if kind == "low" else None))
        elif kind == "box":
            found.append(Shape(box=[2.0 * size, size], pose=place))
        elif kind == "track" and at.distance_to(other) > 0.2:
            motion = OnTrack(points=[[at.x, at.y], [other.x, other.y]], speed=round(rng.uniform(0.1, 0.8), 2))
            found.append(Shape(radius=size, motion=motion))
        elif kind == "door":
            ends = [[at.x, at.y], [at.x + 2.0 * size * math.cos(at.yaw), at.y + 2.0 * size * math.sin(at.yaw)]]
            style = _pick(rng, ("hinged", "sliding"))
            found.append(Shape(segment=ends, motion=DoorMotion(style=style, open=[[2.0, 6.0]], period=9.0)))
        elif kind == "pedestrian":
            walk = PedestrianMotion(goals=[[other.x, other.y], [at.x, at.y]], notices_robot=bool(rng.random() < 0.8))
            found.append(Shape(radius=0.2, pose=place, motion=walk))
    return tuple(found)


def _parameters(rng: np.random.Generator, footprint: Mapping[str, Any], kinematics: str) -> dict[str, Any]:
    """Draws the parameters of move_base, its costmaps and its planners. The order of the draws determines the scenario."""
    inflation = {
        "inflation_radius": round(rng.uniform(0.1, 0.8), 2),
        "cost_scaling_factor": round(rng.uniform(1.0, 15.0), 1),
    }
    limits = _Limits(
        max_vel_x=round(rng.uniform(0.2, 1.0), 2),
        max_vel_theta=round(rng.uniform(0.5, 3.0), 2),
        max_vel_y=round(rng.uniform(0.1, 0.5), 2) if kinematics == "holonomic" else 0.0,
        min_vel_x=_pick(rng, (0.0, 0.0, -0.1, -0.3)),
        acceleration=round(rng.uniform(0.3, 3.0), 2),
    )
    window = round(rng.uniform(2.0, 5.0), 1)
    planner = _pick(rng, GLOBAL_PLANNERS)
    controller = _pick(rng, LOCAL_PLANNERS)
    return {
        "base_global_planner": planner,
        "base_local_planner": controller,
        "controller_frequency": _pick(rng, (2.0, 4.0, 5.0, 10.0)),
        "planner_frequency": _pick(rng, (0.0, 0.5, 1.0, 3.0)),
        "planner_patience": round(rng.uniform(0.5, 3.0), 1),
        "controller_patience": round(rng.uniform(0.5, 3.0), 1),
        "oscillation_timeout": _pick(rng, (0.0, 2.0, 5.0)),
        "recovery_behavior_enabled": bool(rng.random() < 0.7),
        "global_costmap": {**footprint, "inflation_layer": inflation, "update_frequency": _pick(rng, (0.5, 1.0, 5.0))},
        "local_costmap": {
            **footprint,
            "inflation_layer": inflation,
            "update_frequency": _pick(rng, (1.0, 5.0)),
            "width": window,
            "height": window,
            "resolution": _pick(rng, (0.05, 0.05, 0.1)),
        },
        "DWAPlannerROS": _dwa(rng, limits),
        "TrajectoryPlannerROS": _trajectory_rollout(rng, limits, holonomic=kinematics == "holonomic"),
    }


@dataclass(frozen=True, slots=True)
class _Limits:
    """Velocity and acceleration limits that both local planners share (m/s, rad/s, m/s²)."""

    max_vel_x: float
    max_vel_theta: float
    max_vel_y: float
    min_vel_x: float
    acceleration: float


def _dwa(rng: np.random.Generator, limits: _Limits) -> dict[str, Any]:
    return {
        "max_vel_x": limits.max_vel_x,
        "min_vel_x": limits.min_vel_x,
        "max_vel_y": limits.max_vel_y,
        "min_vel_y": -limits.max_vel_y,
        "max_vel_trans": limits.max_vel_x,
        "max_vel_theta": limits.max_vel_theta,
        "acc_lim_x": limits.acceleration,
        "acc_lim_y": limits.acceleration,
        "acc_lim_theta": 2.0 * limits.acceleration,
        "sim_time": round(rng.uniform(0.7, 2.5), 1),
        "vx_samples": 1 + int(rng.integers(8)),
        "vy_samples": 1 + int(rng.integers(5)),
        "vth_samples": 1 + int(rng.integers(20)),
        "path_distance_bias": round(rng.uniform(0.0, 64.0), 1),
        "goal_distance_bias": round(rng.uniform(0.0, 32.0), 1),
        "occdist_scale": round(rng.uniform(0.0, 0.5), 3),
        "xy_goal_tolerance": round(rng.uniform(0.05, 0.4), 2),
        "yaw_goal_tolerance": round(rng.uniform(0.05, 1.0), 2),
        "latch_xy_goal_tolerance": bool(rng.integers(2)),
    }


def _trajectory_rollout(rng: np.random.Generator, limits: _Limits, *, holonomic: bool) -> dict[str, Any]:
    return {
        "max_vel_x": limits.max_vel_x,
        "min_vel_x": 0.1,
        "max_vel_theta": limits.max_vel_theta,
        "min_vel_theta": -limits.max_vel_theta,
        "min_in_place_vel_theta": 0.3,
        "acc_lim_x": limits.acceleration,
        "acc_lim_y": limits.acceleration,
        "acc_lim_theta": 2.0 * limits.acceleration,
        "holonomic_robot": holonomic,
        "dwa": bool(rng.integers(2)),
        "meter_scoring": True,
        "vx_samples": 2 + int(rng.integers(5)),
        "vtheta_samples": 2 + int(rng.integers(15)),
        "sim_time": round(rng.uniform(0.7, 2.0), 1),
        "xy_goal_tolerance": round(rng.uniform(0.05, 0.4), 2),
        "yaw_goal_tolerance": round(rng.uniform(0.05, 1.0), 2),
    }


def _body(rng: np.random.Generator, kinematics: str) -> dict[str, Any]:
    """Draws the parameters of the simulated robot: kinematics, noise and lidar."""
    noisy = rng.random() < 0.6
    laser = {
        "beams": _pick(rng, (1, 40, 90, 180)),
        "fov": round(rng.uniform(0.5, 2.0 * math.pi), 3),
        "range_min": 0.05,
        "range_max": round(rng.uniform(2.0, 8.0), 1),
        "frequency": _pick(rng, (2.0, 5.0, 10.0)),
        "range_noise": round(rng.uniform(0.0, 0.03), 4) if noisy else 0.0,
        "dropout": round(rng.uniform(0.0, 0.3), 3) if noisy else 0.0,
    }
    body: dict[str, Any] = {
        "kinematics": kinematics,
        "physics_frequency": _pick(rng, (20.0, 50.0)),
        "laser": laser,
        "command_delay": _pick(rng, (0.0, 0.0, 0.1)),
        "velocity_lag": _pick(rng, (0.0, 0.0, 0.2)),
        "acc_lim_x": _pick(rng, (None, 1.0, 2.5)),
        "acc_lim_theta": _pick(rng, (None, 2.0, 4.0)),
        "command_timeout": _pick(rng, (None, 0.6)),
    }
    if noisy:
        body |= {
            "odometry_noise": round(rng.uniform(0.0, 0.1), 3),
            "wheel_slip": round(rng.uniform(0.0, 0.1), 3),
            "localization": _pick(rng, ("truth", "truth", "odometry")),
            "localization_noise": round(rng.uniform(0.0, 0.05), 3),
            "localization_delay": _pick(rng, (0.0, 0.2)),
        }
    if kinematics == "ackermann":
        body |= {"wheelbase": 0.25, "max_steering_angle": 0.6}
    # None means that the parameter is not set
    return {name: value for name, value in body.items() if value is not None}


TIME_LIMIT_SLACK_S: Final = 5.0
"""Simulated seconds a goal may take to end after its time limit; a cancel takes effect within one control cycle."""


@dataclass(frozen=True, slots=True)
class RandomScenarioResult:
    """The result of checking a random scenario."""

    number: int
    outcome: str
    """The terminal states of its goals; `refused NAME` if it could not start; `exception`."""
    simulated_s: float
    collisions: int
    faults: tuple[str, ...]
    """Invariant violations."""


def check_random(number: int, *, time_limit_s: float = 12.0) -> RandomScenarioResult:
    """Drives the random scenario with that number and checks the invariants. An exception is a violation too."""
    faults: list[str] = []
    run: Run | None = None
    try:
        scenario = random_scenario(number, time_limit_s=time_limit_s).build()
        run = Run(scenario, record=False)
        # more cycles than any of them needs: a run that exceeds them would not end
        duration_s = len(scenario.items) * (scenario.time_limit_s + scenario.pause_s + TIME_LIMIT_SLACK_S)
        cycles_left = math.ceil(100.0 * duration_s)
        while run.step():
            cycles_left -= 1
            if cycles_left < 0:
                faults.append(f"the run does not end: still driving at {run.robot.time:.1f} s")
                break
        result = run.result(0.0)
    except (InputError, PlanningError) as error:
        # refused at the start: an obstacle at the start pose, contradictory parameters
        if run is None:
            return RandomScenarioResult(number, f"refused {error.name}", 0.0, 0, ())
        return _exception(number, run.robot.time, error)
    except Exception as error:
        # any exception that gets here is a violation
        return _exception(number, 0.0 if run is None else run.robot.time, error)
    faults += _violations(scenario, result)
    states = " ".join(goal.state for goal in result.goals)
    return RandomScenarioResult(number, states, result.simulated_s, result.collisions, tuple(faults))


def _exception(number: int, simulated_s: float, error: Exception) -> RandomScenarioResult:
    return RandomScenarioResult(number, "exception", simulated_s, 0, (f"{type(error).__name__}: {error}",))


def _violations(scenario: Scenario, result: RunResult) -> list[str]:
    faults: list[str] = []
    for i, goal in enumerate(result.goals, 1):
        if goal.state not in TERMINAL_STATES:
            faults.append(f"goal {i} is not in a terminal state: {goal.state}")
        if goal.state != "SUCCEEDED" and not (goal.message or goal.text):
            faults.append(f"goal {i} ended {goal.state} without a reason")
        if goal.time_s > scenario.time_limit_s + TIME_LIMIT_SLACK_S:
            faults.append(f"goal {i} took {goal.time_s:.1f} s, its time limit is {scenario.time_limit_s:.1f} s")
    stopped = scenario.stop_on_failure and any(not goal.succeeded for goal in result.goals)
    if len(result.goals) < len(scenario.items) and not stopped:
        faults.append(f"{len(scenario.items) - len(result.goals)} goals were not driven")
    if result.succeeded and result.collisions:
        faults.append(f"success despite {result.collisions} collisions")
    if result.min_clearance_m == 0.0 and not result.collisions:
        faults.append("the footprint overlapped an obstacle, but no collision was reported")
    for name, value in result.metrics.as_dict().items():
        if isinstance(value, float) and math.isnan(value) and name != "clearance_mean_m":
            faults.append(f"the metric {name} is NaN")
    return faults
