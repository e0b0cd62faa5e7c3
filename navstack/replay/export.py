"""Exports a simulated run as a ROS 1 bag or an MCAP file.

The run is simulated again, which gives the same run to the bit and takes less time than writing it: the record rounds scans
to the millimeter and has no transforms between two control cycles.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import LaserScan, PointCloud, Pose2D, RecordError, Transform2D, Twist2D
from navstack.logs import LogWriter, open_writer
from navstack.move_base import GoalHandle, GoalStatus
from navstack.record import Record
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as ros
from navstack.scenario import Run, Scenario

EPOCH_NS: Final = 1_600_000_000 * 10**9
"""Time of the start of a run (ns since 1970): the same in every export."""
COSTMAP_PERIOD_S: Final = 5.0
"""A whole costmap is written at least this often (s); between, the changed windows."""


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written."""

    path: Path
    messages: int
    duration: float
    """s"""
    topics: tuple[str, ...]


def export_run(record: Record, path: Path, progress: Callable[[float], None] | None = None) -> Exported:
    """Write a recorded run to `path` (.bag or .mcap). `progress` is called with the simulated time (s).

    Raises RecordError for a record that is not that of a simulation, OutputError, InputError for a suffix without a format.
    """
    if "log" in record.scenario:
        raise RecordError(f"{record.path or 'the record'} is the replay of a log, which has no simulation to export")
    scenario = Scenario.from_record(record)
    target = open_writer(path)
    run = Run(scenario, record=True, scans=False)
    with target as writer:
        tap = _Tap(run, writer, MessageBuilder(target.store, ros1=target.is_ros1), ros1=target.is_ros1)
        while run.step():
            tap.after_step()
            if progress is not None:
                progress(run.robot.time)
        tap.after_end()
        _check_equal(record, run)
    return Exported(path, tap.count, run.robot.time, tuple(sorted(tap.topics)))


def _check_equal(record: Record, run: Run) -> None:
    """Raise RecordError if the run differs from the record: another version of navstack recorded it."""
    assert run.recorder is not None
    again = run.recorder.record()
    if len(again.samples) < len(record.samples) or not np.array_equal(
        again.samples[: len(record.samples)], record.samples
    ):
        raise RecordError(
            f"{record.path or 'the record'} was recorded by another version of navstack, or with other kernels: the run is not "
            "the same when it is simulated again; record it again",
            path=str(record.path),
        )


class _Tap:
    """Writes what a run does."""

    def __init__(self, run: Run, writer: LogWriter, build: MessageBuilder, *, ros1: bool) -> None:
        self.count = 0
        self.topics: set[str] = set()
        self._run, self._writer, self._build, self._ros1 = run, writer, build, ros1
        self._robot = run.robot
        self._frequency = run.scenario.configuration.navstack.sim.physics_frequency
        self._step = 0
        self._last_tick = -1.0
        self._goals: dict[int, GoalHandle] = {}
        self._ended: set[int] = set()
        self._full_at: dict[str, tuple[float, Any]] = {}
        self._dynamic_map = False
        self._names = _Names(run, ros1=ros1)
        robot = self._robot
        advance = robot.advance_to

        def advance_to(time: float) -> NDArray[np.float64]:
            samples = advance(time)
            self._write_steps(samples)
            return samples

        robot.advance_to = advance_to
        cancel = run.move_base.cancel_goal

        def cancel_goal(goal: GoalHandle | str) -> None:
            self._write_cancel(goal)
            cancel(goal)

        run.move_base.cancel_goal = cancel_goal
        self._write_start()

    # --- writing ------------------------------------------------------------------------------------------------------

    def _write(self, topic: str, kind: str, time: float, message: Any, *, latched: bool = False) -> None:
        self._writer.write(topic, kind, _ns(time), message, latched=latched)
        self.count += 1
        self.topics.add(topic)

    def _write_start(self) -> None:
        """Write the map, the static transforms and the state at time 0."""
        robot, build = self._robot, self._build
        map_frame, odom, base = robot.map_frame, robot.odom_frame, robot.base_frame
        static: list[tuple[int, str, str, Transform2D, float]] = []
        heights = _heights(self._run)
        for frame in robot.frames.frames():
            if frame in (map_frame, odom, base):
                continue
            static.append((_ns(0.0), base, frame, robot.frames.lookup(base, frame), heights.get(frame, 0.0)))
        # static if it is known before the robot moves, at any time
        self._dynamic_map = robot.frames.latest_stamp(map_frame, odom) != np.inf
        if not self._dynamic_map:
            static.append((_ns(0.0), map_frame, odom, robot.frames.lookup(map_frame, odom), 0.0))
        kind = ros.TRANSFORMS[0]
        self._write("/tf_static", kind, 0.0, build.transforms(static), latched=True)
        sim = self._run.scenario.configuration.navstack.sim
        scans = {
            "/" + lidar.topic.strip("/"): {name: getattr(lidar, name) for name in ros.ScanFields._fields}
            for lidar in (sim.lidar(name) for name in sim.lasers)
        }
        ranges = {
            sonar.frame: ros.RangeFields(sonar.fov, sonar.range_min, sonar.range_max)._asdict()
            for sonar in (sim.sonar(name) for name in sim.sonars)
        }
        text = build.of(ros.STRING, data=json.dumps({"scans": scans, "ranges": ranges}))
        self._write(ros.EXPORTED_SENSORS, ros.STRING, 0.0, text, latched=True)
        self._write("/map", ros.MAP, 0.0, build.map(_ns(0.0), self._run.scenario.map), latched=True)
        state = robot.state()
        self._write_state(0.0, robot.pose, state.pose, state.velocity)

    def _write_steps(self, samples: NDArray[np.float64]) -> None:
        for row in samples.tolist():
            self._step += 1
            time = self._step / self._frequency
            self._write_state(time, Pose2D(*row[:3]), Pose2D(*row[3:6]), Twist2D(*row[6:9]))

    def _write_state(self, time: float, true: Pose2D, pose: Pose2D, velocity: Twist2D) -> None:
        robot, build, stamp = self._robot, self._build, _ns(time)
        odom, base, map_frame = robot.odom_frame, robot.base_frame, robot.map_frame
        moving = [(stamp, odom, base, Transform2D(*pose), 0.0)]
        if self._dynamic_map:
            moving.append((stamp, map_frame, odom, robot.frames.lookup(map_frame, odom, time), 0.0))
        self._write("/tf", ros.TRANSFORMS[0], time, build.transforms(moving))
        self._write("/odom", ros.ODOMETRY, time, build.odometry(stamp, odom, base, pose, velocity))
        truth = build.odometry(stamp, map_frame, base, true, velocity)
        self._write("/base_pose_ground_truth", ros.ODOMETRY, time, truth)

    def after_step(self) -> None:
        """Write what the last cycle received, computed and commanded."""
        run, build = self._run, self._build
        tick = run.move_base.last_tick
        now, stamp = tick.time, _ns(tick.time)
        for data in tick.scans:
            # a measurement arrives when it is taken, unless the robot got it later
            time = data.stamp if data.stamp > self._last_tick else now
            topic = "/" + data.topic.strip("/")
            if isinstance(data, LaserScan):
                self._write(topic, ros.SCAN, time, build.scan(_ns(data.stamp), data))
            elif isinstance(data, PointCloud):
                self._write(topic, ros.CLOUD, time, build.cloud(_ns(data.stamp), data))
            else:
                self._write(topic, ros.RANGE, time, build.range(_ns(data.stamp), data))
        for reading in self._robot.imu_readings():
            topic = "/" + reading.topic.strip("/")
            self._write(topic, "sensor_msgs/msg/Imu", reading.stamp, build.imu(_ns(reading.stamp), reading))
        self._write_goals()
        if tick.command is not None:
            self._write("/cmd_vel", ros.TWIST, now, build.twist(run.move_base.command))
        self._write_costmaps(now)
        names = self._names
        if tick.plan is not None:
            plan = tick.plan.path
            self._write(names.plan, ros.PATH, now, build.path(stamp, plan.frame, plan.poses))
        local = tick.local_plan
        frame = run.move_base.local_costmap.frame
        if local is not None and local.trajectory is not None:
            poses = np.asarray(local.trajectory, np.float64)
            self._write(names.local_plan, ros.PATH, now, build.path(stamp, frame, poses))
            marker = build.line_marker(stamp, frame, "trajectory", poses)
            self._write("/navstack/trajectory", "visualization_msgs/msg/MarkerArray", now, marker)
        self._last_tick = now

    def after_end(self) -> None:
        """Write the ends of the last goals."""
        self._write_results()

    # --- goals --------------------------------------------------------------------------------------------------------

    def _write_goals(self) -> None:
        run, build = self._run, self._build
        self._write_results()
        for sent in run.goals.under_way:
            handle = sent.handle
            if sent.index in self._goals or not isinstance(handle, GoalHandle) or sent.pose is None:
                continue
            self._goals[sent.index] = handle
            time, frame = sent.time, run.move_base.global_costmap.frame
            pose = build.pose_stamped(_ns(time), frame, sent.pose)
            if not self._ros1:
                self._write("/goal_pose", ros.POSE, time, pose)
                continue
            goal = build.of("move_base_msgs/msg/MoveBaseGoal", target_pose=pose)
            header = build.header(_ns(time), frame)
            message = build.of(ros.ACTION_GOAL, header=header, goal_id=self._id(time, handle.id), goal=goal)
            self._write("/move_base/goal", ros.ACTION_GOAL, time, message)
        self._write_results()

    def _id(self, time: float, name: str) -> Any:
        return self._build.of("actionlib_msgs/msg/GoalID", stamp=self._build.time(_ns(time)), id=name)

    def _write_cancel(self, goal: GoalHandle | str) -> None:
        if self._ros1:
            time = self._robot.time
            name = goal if isinstance(goal, str) else goal.id
            self._write("/move_base/cancel", ros.GOAL_ID, time, self._id(time, name))

    def _write_results(self) -> None:
        for index, handle in self._goals.items():
            if index in self._ended or not handle.is_done:
                continue
            self._ended.add(index)
            if self._ros1:
                self._write_result(handle)

    def _write_result(self, handle: GoalHandle) -> None:
        build, time = self._build, self._run.move_base.last_tick.time
        status = build.of(
            "actionlib_msgs/msg/GoalStatus",
            goal_id=self._id(time, handle.id),
            status=int(GoalStatus(handle.status)),
            text=handle.text,
        )
        result = build.of("move_base_msgs/msg/MoveBaseResult")
        message = build.of(ros.ACTION_RESULT, header=build.header(_ns(time), ""), status=status, result=result)
        self._write("/move_base/result", ros.ACTION_RESULT, time, message)

    # --- costmaps -----------------------------------------------------------------------------------------------------

    def _write_costmaps(self, now: float) -> None:
        move_base, build = self._run.move_base, self._build
        tick = move_base.last_tick
        for name, server, window in (
            (self._names.global_costmap, move_base.global_costmap, tick.global_window),
            (self._names.local_costmap, move_base.local_costmap, tick.local_window),
        ):
            if window is None:
                continue
            costmap = server.master
            at, geometry = self._full_at.get(name, (-np.inf, None))
            if geometry != costmap.geometry or now - at >= COSTMAP_PERIOD_S:
                self._full_at[name] = now, costmap.geometry
                self._write(f"{name}/costmap", ros.MAP, now, build.costmap(_ns(now), costmap), latched=True)
            elif not window.is_empty:
                update = build.costmap_update(_ns(now), costmap, window)
                self._write(f"{name}/costmap_updates", "map_msgs/msg/OccupancyGridUpdate", now, update)
        if tick.local_window is not None:
            pose = self._robot.frames.lookup(move_base.local_costmap.frame, self._robot.base_frame)
            corners = pose.apply_points(move_base.local_costmap.footprint.vertices)
            footprint = build.polygon(_ns(now), move_base.local_costmap.frame, corners)
            kind = "geometry_msgs/msg/PolygonStamped"
            self._write(self._names.footprint, kind, now, footprint)


class _Names:
    """Names of the topics, as move_base and as Nav2 have them."""

    def __init__(self, run: Run, *, ros1: bool) -> None:
        configuration = run.scenario.configuration
        prefix = "/move_base" if ros1 else ""
        self.global_costmap = f"{prefix}/global_costmap"
        self.local_costmap = f"{prefix}/local_costmap"
        self.footprint = f"{self.local_costmap}/{'footprint' if ros1 else 'published_footprint'}"
        planner, controller = configuration.global_planner, configuration.local_planner
        self.plan = f"{prefix}/{planner.namespace or planner.name}/plan" if ros1 else "/plan"
        self.local_plan = f"{prefix}/{controller.namespace or controller.name}/local_plan" if ros1 else "/local_plan"


def _heights(run: Run) -> dict[str, float]:
    """Return the height (m) of the frames of lidars: in the plane of the simulation, scans carry it."""
    sim = run.scenario.configuration.navstack.sim
    return sim.scan_heights


def _ns(time: float) -> int:
    return EPOCH_NS + round(time * 1e9)


# --- a layout for Foxglove that shows an exported run -----------------------------------------------------------------


def foxglove_layout(*, is_ros1: bool) -> dict[str, Any]:
    """Return the layout as JSON data; the topics are those of `navstack bag export`."""
    prefix = "/move_base" if is_ros1 else ""
    grids = {
        "/map": {"visible": True, "colorMode": "map"},
        f"{prefix}/global_costmap/costmap": {"visible": True, "colorMode": "costmap", "alpha": 0.4},
        f"{prefix}/local_costmap/costmap": {"visible": True, "colorMode": "costmap", "alpha": 0.6},
    }
    lines = {
        f"{prefix}/local_costmap/{'footprint' if is_ros1 else 'published_footprint'}": {
            "visible": True,
            "color": "#0072b2ff",
        },
        "/scan": {"visible": True, "colorMode": "flat", "flatColor": "#d55e00ff", "pointSize": 4},
        "/navstack/trajectory": {"visible": True},
        "/goal_pose": {"visible": True},
    }
    if not is_ros1:  # a live session has these instead of the two above
        lines |= {"/marker": {"visible": True}, "/current_goal": {"visible": True}}
    plans = {f"{prefix}/{name}/plan": {"visible": True, "gradient": ["#009e73ff", "#009e73ff"]} for name in _PLANNERS}
    paths = plans if is_ros1 else {"/plan": {"visible": True}, "/local_plan": {"visible": True}}
    scene = {
        "cameraState": {"perspective": False, "distance": 20, "phi": 0, "thetaOffset": 0},
        "followMode": "follow-position",
        "followTf": "base_footprint",
        "topics": {**grids, **lines, **paths},
        "layers": {},
    }
    chart = {
        "title": "commands",
        "paths": [
            {"value": path, "enabled": True, "timestampMethod": "receiveTime", "label": label}
            for path, label in (
                ("/cmd_vel.linear.x", "commanded, m/s"),
                ("/odom.twist.twist.linear.x", "measured, m/s"),
                ("/cmd_vel.angular.z", "commanded, rad/s"),
                ("/odom.twist.twist.angular.z", "measured, rad/s"),
            )
        ],
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "xAxisVal": "timestamp",
    }
    return {
        "configById": {"3D!navstack": scene, "Plot!navstack": chart},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "column", "first": "3D!navstack", "second": "Plot!navstack", "splitPercentage": 70},
    }


_PLANNERS = ("NavfnROS", "GlobalPlanner")
