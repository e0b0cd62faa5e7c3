"""The record of a running node, in pieces that `plot` and `explain` open like that of a simulation."""

from __future__ import annotations

import shutil
import threading
import time
from pathlib import Path
from typing import Any, Final, NamedTuple

from navstack.bringup import odometry_frame, true_footprint
from navstack.core import Event, NavError, OccupancyGrid, Pose2D, RobotState, Transform2D, Twist2D, ensure_directory
from navstack.move_base import GoalHandle, MoveBase
from navstack.parameters import Configuration
from navstack.plugins import Robot
from navstack.record import RunRecorder, record_tick_outputs
from navstack.ros_node.log import Log
from navstack.scenario import Scenario

REST_S: Final = 1.0
"""A piece ends this long (s) after its goal."""
LONGEST_S: Final = 600.0
"""A piece ends after this time (s), also in a goal."""
LATEST: Final = "latest"
"""Name of the link to the newest piece."""


class RecordFolder(NamedTuple):
    """Where a node keeps its record."""

    folder: Path
    limit_mb: float


class LiveRecord:
    """Records the cycles of a node. Each piece is written by a thread of its own after its goal; the oldest are deleted."""

    def __init__(
        self,
        folder: Path,
        limit_mb: float,
        configuration: Configuration,
        static_map: OccupancyGrid | None,
        robot: Robot,
        *,
        name: str,
        log: Log,
    ) -> None:
        """Pieces are folders in `folder`; together they take at most `limit_mb` (MB), besides the newest.

        `name`: of the scenario in the records. Raises OutputError.
        """
        ensure_directory(folder)
        self._name, self._log = name, log
        self.folder, self._limit = folder, limit_mb * 1e6
        self._configuration, self._map, self._robot = configuration, static_map, robot
        self._base = configuration.local_costmap.params.robot_base_frame
        self._global = configuration.global_costmap.params.global_frame
        self._local = odometry_frame(configuration)
        self._writer: threading.Thread | None = None
        self._count = 0
        self._sensors: dict[str, Transform2D] = {}
        self._start(0.0)

    def _start(self, now: float) -> None:
        self._begin, self._idle_since = now, now
        self._first: Pose2D | None = None
        self._goals: list[Pose2D] = []
        self._handles: list[GoalHandle] = []
        self._recorder = RunRecorder(
            map=self._map,
            footprint=true_footprint(self._configuration),
            scenario={},
            global_frame=self._global,
            local_frame=self._local,
            base_frame=self._base,
            sensors=self._sensors,
        )

    # --- during the run -----------------------------------------------------------------------------------------------

    hears_feedback = False

    def on_event(self, event: Event) -> None:
        """Add an event of the goal manager."""
        self._recorder.on_event(event)

    def tick(self, move_base: MoveBase) -> None:
        """Add what the last tick did; a piece ends some time after its goal."""
        self._add(move_base)
        now = move_base.now
        if move_base.goal_handle is not None:
            self._idle_since = now
        ended = self._goals and now - self._idle_since > REST_S
        if ended or now - self._begin > LONGEST_S:
            self.save(move_base)

    def _add(self, move_base: MoveBase) -> None:
        recorder, t = self._recorder, move_base.last_tick.time
        handle = move_base.goal_handle
        if handle is not None and handle not in self._handles:
            self._handles.append(handle)
            pose = move_base.goal_pose or handle.goal.pose
            self._goals.append(pose)
            recorder.goal(t, pose)
        record_tick_outputs(recorder, move_base, self._mount)
        at = self._lookup(self._global, self._base)
        if at is None:
            return
        pose = Pose2D(*at)
        self._first = self._first or pose
        recorder.sample(
            t,
            pose=pose,
            odom=self._state(pose, t),
            map_to_odom=self._lookup(self._global, self._local) or Transform2D(),
            command=move_base.command,
            state=move_base.activity,
            goal_index=len(self._goals) - 1 if handle is not None else -1,
        )

    def _state(self, pose: Pose2D, t: float) -> RobotState:
        try:
            return self._robot.state()
        except NavError:
            return RobotState(pose, Twist2D(), t, self._local)

    def _lookup(self, target: str, source: str) -> Transform2D | None:
        try:
            return self._robot.frames.lookup(target, source)
        except NavError:
            return None

    def _mount(self, frame: str) -> None:
        at = None if frame in self._sensors else self._lookup(self._base, frame)
        if at is not None:
            self._sensors[frame] = at
            self._recorder.set_sensors(self._sensors)

    def set_map(self, static_map: OccupancyGrid, move_base: MoveBase) -> None:
        """Begin a piece with another map."""
        self.save(move_base)
        self._map = static_map
        self._start(move_base.now)

    # --- pieces -------------------------------------------------------------------------------------------------------

    def save(self, move_base: MoveBase, *, wait: bool = False) -> Path:
        """End the current piece and write it in a thread; return its folder. With `wait`, it has been written."""
        recorder, now = self._recorder, move_base.now
        if self._map is not None:
            goals = tuple(self._goals)
            start = self._first or Pose2D(0.0, 0.0)
            recorder.set_scenario(Scenario(self._map, self._configuration, start, goals, name=self._name).as_dict())
        recorder.finish([_result(handle, goal, now) for handle, goal in zip(self._handles, self._goals, strict=True)])
        self._count += 1
        piece = self.folder / f"{time.strftime('%Y%m%d-%H%M%S')}-{self._count:06d}"
        self._start(now)
        if self._writer is not None:
            self._writer.join()
        self._writer = threading.Thread(target=self._write, args=(recorder, piece), name="record", daemon=True)
        self._writer.start()
        if wait:
            self._writer.join()
        return piece

    def _write(self, recorder: RunRecorder, piece: Path) -> None:
        try:
            recorder.save(piece)
            link = self.folder / LATEST
            link.unlink(missing_ok=True)
            link.symlink_to(piece.name)
            self._rotate(piece)
        except (NavError, OSError) as exc:
            self._log.logerr("the record %s could not be written: %s", piece, exc)

    def _rotate(self, newest: Path) -> None:
        """Delete the oldest pieces beyond the limit."""
        pieces = sorted(path.parent for path in self.folder.glob("*/run.npz") if not path.parent.is_symlink())
        sizes = {piece: sum(file.stat().st_size for file in piece.iterdir()) for piece in pieces}
        for piece in pieces:
            if sum(sizes.values()) <= self._limit or piece == newest:
                return
            del sizes[piece]
            shutil.rmtree(piece, ignore_errors=True)


def _result(handle: GoalHandle, goal: Pose2D, now: float) -> dict[str, Any]:
    active = not handle.is_done
    return {
        "goal": list(goal),
        "state": handle.status.name,
        "text": handle.text,
        "error_code": 0 if active else handle.result.error_code,
        "error_name": "" if active else handle.result.error_name,
        "message": "the record ends before the goal" if active else handle.result.message,
        "time_s": round((now if handle.ended_at is None else handle.ended_at) - handle.goal.stamp, 6),
        "path_length_m": 0.0,
        "distance_left_m": 0.0,
        "yaw_left_rad": 0.0,
        "recoveries": 0 if active else handle.result.recoveries,
    }
