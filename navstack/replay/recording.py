"""The record of a replay, which `plot`, `explain` and `live` open like that of a simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from navstack.bringup import odometry_frame, true_footprint
from navstack.core import NavError, OccupancyGrid, Pose2D, RobotState, Transform2D, Twist2D
from navstack.logs import Log
from navstack.move_base import GoalHandle, MoveBase
from navstack.parameters import Configuration
from navstack.record import RunRecorder, record_tick_outputs
from navstack.replay.player import LoggedRobot
from navstack.scenario import Scenario


class EndedGoal(Protocol):
    """A goal of the log."""

    @property
    def pose(self) -> Pose2D:
        """The goal."""
        ...

    @property
    def handle(self) -> GoalHandle:
        """Its handle."""
        ...

    @property
    def time(self) -> float:
        """When it was sent (s)."""
        ...

    @property
    def ended(self) -> float:
        """When it ended (s)."""
        ...


class ReplayRecorder:
    """Records a replay."""

    def __init__(
        self,
        log: Log,
        configuration: Configuration,
        static_map: OccupancyGrid | None,
        robot: LoggedRobot,
        options: Mapping[str, Any],
        *,
        scans: bool,
        spool: Path | None,
    ) -> None:
        """`spool`: as in `RunRecorder`."""
        self._robot = robot
        self._base = configuration.local_costmap.params.robot_base_frame
        self._global = configuration.global_costmap.params.global_frame
        self._local = odometry_frame(configuration)
        self._configuration = configuration
        self._map = static_map
        self._log = {"path": str(log.path.resolve()), "partial": log.problem is not None, "options": dict(options)}
        self._first: Pose2D | None = None
        self._goals: list[Pose2D] = []
        self._sensors: dict[str, Transform2D] = {}
        self.recorder = RunRecorder(
            map=static_map,
            footprint=true_footprint(configuration),
            scenario={},
            global_frame=self._global,
            local_frame=self._local,
            base_frame=self._base,
            sensors=self._sensors,
            keep_scans=scans,
            spool=spool,
        )

    def goal(self, t: float, pose: Pose2D) -> None:
        """Add a goal."""
        self._goals.append(pose)
        self.recorder.goal(t, pose)

    def tick(self, move_base: MoveBase, goal: int) -> None:
        """Add what the last tick did."""
        recorder, robot, t = self.recorder, self._robot, move_base.last_tick.time
        record_tick_outputs(recorder, move_base, self._mount)
        pose = robot.true_pose or robot.pose_in(self._global, self._base) or robot.pose_in(self._local, self._base)
        if pose is None:
            return
        self._first = self._first or pose
        recorder.sample(
            t,
            pose=pose,
            odom=robot.odometry or RobotState(pose, Twist2D(), t, self._local),
            map_to_odom=self._map_to_odom(),
            command=move_base.command,
            state=move_base.activity,
            goal_index=goal,
        )

    def _mount(self, frame: str) -> None:
        if frame not in self._sensors:
            try:
                self._sensors[frame] = self._robot.frames.lookup(self._base, frame)
            except NavError:
                return
            self.recorder.set_sensors(self._sensors)

    def _map_to_odom(self) -> Transform2D:
        try:
            return self._robot.frames.lookup(self._global, self._local)
        except NavError:
            return Transform2D()

    def finish(self, goals: Sequence[EndedGoal], move_base: MoveBase) -> None:
        """Complete the record."""
        configuration = self._configuration
        if self._map is not None:
            scenario = Scenario(
                map=self._map,
                configuration=configuration,
                start=self._first or Pose2D(0.0, 0.0),
                goals=tuple(self._goals),
                name=Path(str(self._log["path"])).name,
                names={"log": self._log},
            )
            self.recorder.set_scenario(scenario.as_dict())
        self.recorder.finish([_result(goal, move_base) for goal in goals])


def _result(goal: EndedGoal, move_base: MoveBase) -> dict[str, object]:
    handle = goal.handle
    active = not handle.is_done
    return {
        "goal": list(goal.pose),
        "state": handle.status.name,
        "text": handle.text,
        "error_code": 0 if active else handle.result.error_code,
        "error_name": "" if active else handle.result.error_name,
        "message": "the log ends before the goal" if active else handle.result.message,
        "time_s": round((move_base.now if math.isnan(goal.ended) else goal.ended) - goal.time, 6),
        "path_length_m": 0.0,
        "distance_left_m": 0.0,
        "yaw_left_rad": 0.0,
        "recoveries": 0 if active else handle.result.recoveries,
    }
