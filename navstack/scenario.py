"""A scenario: map, parameters, start, goals, obstacles, seed. Running one gives the same record every time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from navstack.configuration import Configuration
from navstack.core import Listener, OccupancyGrid, Pose2D, angle_between
from navstack.move_base import MoveBase
from navstack.navigator import build_move_base, odometry_frame, simulated_robot, true_footprint
from navstack.record import RunRecorder
from navstack.sim import SimulatedRobot

Progress = Callable[[float, int], None]
"""Called now and then with the simulated time (s) and the index of the present goal."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """What a run is made from. Poses in the map frame, obstacles as (x, y, radius), metres and radians."""

    map: OccupancyGrid
    configuration: Configuration
    start: Pose2D
    goals: tuple[Pose2D, ...]
    obstacles: tuple[tuple[float, float, float], ...] = ()
    seed: int = 0
    time_limit_s: float = 600.0
    """Simulated seconds a goal may take; then it is cancelled."""
    names: dict[str, Any] = field(default_factory=dict[str, Any])
    """Where map and parameters came from, for the record."""

    def described(self) -> dict[str, Any]:
        """The scenario as the record keeps it (JSON)."""
        return {
            **self.names,
            "ros_distro": self.configuration.navstack.ros_distro,
            "start": list(self.start),
            "goals": [list(goal) for goal in self.goals],
            "obstacles": [list(obstacle) for obstacle in self.obstacles],
            "seed": self.seed,
            "time_limit_s": self.time_limit_s,
        }


@dataclass(frozen=True, slots=True)
class GoalOutcome:
    """How one goal ended."""

    goal: Pose2D
    state: str
    text: str
    error_code: int
    error_name: str
    message: str
    """The reason in a sentence, beyond C++'s text."""
    time_s: float
    path_length_m: float
    distance_left_m: float
    yaw_left_rad: float
    recoveries: int

    @property
    def succeeded(self) -> bool:
        """True when the robot stands at the goal."""
        return self.state == "SUCCEEDED"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "goal": list(self.goal),
            "state": self.state,
            "text": self.text,
            "error_code": self.error_code,
            "error_name": self.error_name,
            "message": self.message,
            "time_s": round(self.time_s, 6),
            "path_length_m": self.path_length_m,
            "distance_left_m": self.distance_left_m,
            "yaw_left_rad": self.yaw_left_rad,
            "recoveries": self.recoveries,
        }


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended. `wall_s` is the only thing here that differs from run to run."""

    goals: tuple[GoalOutcome, ...]
    simulated_s: float
    wall_s: float
    collisions: int
    seed: int
    recorder: RunRecorder | None

    @property
    def succeeded(self) -> bool:
        """True when every goal SUCCEEDED."""
        return all(goal.succeeded for goal in self.goals)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds over wall seconds."""
        return self.simulated_s / self.wall_s if self.wall_s > 0.0 else math.inf

    def as_dict(self) -> dict[str, Any]:
        """The document of `navstack simulate --json`, without its files."""
        return {
            "goals": [goal.as_dict() for goal in self.goals],
            "simulated_s": round(self.simulated_s, 6),
            "wall_s": self.wall_s,
            "real_time_factor": self.real_time_factor,
            "collisions": self.collisions,
            "seed": self.seed,
        }


def _take_down(recorder: RunRecorder, robot: SimulatedRobot, move_base: MoveBase, goal: int) -> None:
    """Puts what the last tick did into the record."""
    turn = move_base.turn
    t = turn.time
    for name, costmap, window in (
        ("global", move_base.global_costmap, turn.global_window),
        ("local", move_base.local_costmap, turn.local_window),
    ):
        if window is not None:
            recorder.costmap(t, name, costmap.master, window)
    if turn.plan is not None:
        recorder.plan(t, turn.plan.path.poses, turn.plan.path.frame)
    if turn.local_plan is not None:
        recorder.local_plan(t, turn.local_plan)
    recorder.sample(
        t,
        pose=robot.pose,
        odom=robot.state(),
        map_to_odom=robot.frames.lookup(robot.map_frame, robot.odom_frame),
        command=move_base.command,
        state=move_base.state.name,
        goal_index=goal,
    )


def run_scenario(
    scenario: Scenario,
    *,
    record: bool = True,
    progress: Progress | None = None,
    listeners: Sequence[Listener] = (),
) -> RunResult:
    """Drives the simulated robot to every goal in turn; goes on to the next when one fails.

    Raises an InputError or PlanningError when the robot cannot stand at the start.
    """
    wall_start = time.perf_counter()
    configuration = scenario.configuration
    robot = simulated_robot(
        configuration, scenario.map, scenario.start, obstacles=scenario.obstacles, seed=scenario.seed
    )
    recorder: RunRecorder | None = None
    if record:
        recorder = RunRecorder(
            map=scenario.map,
            footprint=true_footprint(configuration),
            scenario=scenario.described(),
            global_frame=configuration.global_costmap.params.global_frame,
            local_frame=odometry_frame(configuration),
            base_frame=configuration.local_costmap.params.robot_base_frame,
        )
    heard = [recorder, *listeners] if recorder is not None else list(listeners)
    move_base = build_move_base(configuration, robot, static_map=scenario.map, listeners=heard)
    outcomes: list[GoalOutcome] = []
    for index, goal in enumerate(scenario.goals):
        begun, driven = robot.time, robot.distance_travelled
        handle = move_base.send_goal(goal)
        if recorder is not None:
            recorder.goal(begun, goal)
        while not handle.is_done:
            due = move_base.next_due(robot.time)
            robot.advance_to(due)
            move_base.tick(robot.time)
            if recorder is not None:
                _take_down(recorder, robot, move_base, index)
            if progress is not None:
                progress(robot.time, index)
            if robot.time - begun > scenario.time_limit_s:
                move_base.cancel_goal(handle)
        result = handle.result
        pose = robot.pose
        outcomes.append(
            GoalOutcome(
                goal=goal,
                state=handle.status.name,
                text=handle.text,
                error_code=result.error_code,
                error_name=result.error_name,
                message=result.message,
                time_s=robot.time - begun,
                path_length_m=robot.distance_travelled - driven,
                distance_left_m=pose.distance_to(goal),
                yaw_left_rad=abs(angle_between(pose.yaw, goal.yaw)),
                recoveries=result.recoveries,
            )
        )
    if recorder is not None:
        recorder.finish([outcome.as_dict() for outcome in outcomes], robot.collisions)
    return RunResult(
        goals=tuple(outcomes),
        simulated_s=robot.time,
        wall_s=time.perf_counter() - wall_start,
        collisions=len(robot.collisions),
        seed=scenario.seed,
        recorder=recorder,
    )
