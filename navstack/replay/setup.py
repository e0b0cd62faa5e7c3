"""What a replay finds out before its first cycle: the clock, the first transforms, the map, where the robot is."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from statistics import median
from typing import Any, Final

import numpy as np

from navstack.core import GridGeometry, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import LogError, NavError
from navstack.core.frames import clean_frame
from navstack.logs import Log
from navstack.logs import messages as ros
from navstack.logs.log import NS_PER_S, seconds
from navstack.logs.messages import Clock, StampedTransform
from navstack.logs.rotations import Transform3D, quaternion_of_yaw
from navstack.parameters.configuration import Configuration
from navstack.parameters.models.sim import SimParams
from navstack.replay.logged_robot import LoggedRobot
from navstack.replay.player import Player
from navstack.replay.topics import Topics, find_topics

LOOK_AHEAD_S: Final = 30.0
"""A log must show its transforms and its first messages within this time (s)."""
LOOK_BACK_S: Final = 10.0
"""The last poses are known from this much of a log (s)."""
CLOCKS_DIFFER_S: Final = 600.0
"""Stamps that differ more from the time of the recording (s) belong to another clock."""
FREE_EXTENT_M: Final = 40.0
"""Width and height of the map of a robot without a map (m)."""


def find_clock(log: Log, topics: Topics) -> tuple[Clock, str]:
    """Return the clock of a log, and a note if the stamps belong to another clock than the times of the recording."""
    shifts: list[int] = []
    for message in log.messages(topics.used, end=LOOK_AHEAD_S):
        if message.topic not in (topics.odometry, *topics.sensors):
            continue
        with suppress(LogError):
            shifts.append(message.time_ns - ros.header_ns(message.data))
        if len(shifts) >= 50:
            break
    shift = round(median(shifts)) if shifts else 0
    if abs(shift) < CLOCKS_DIFFER_S * NS_PER_S:
        return Clock(log.start_ns), ""
    return Clock(log.start_ns, shift), (
        f"the stamps of the messages differ from the times of the recording by {seconds(shift):.0f} s (a simulation recorded "
        "with wall time?); they are shifted by the median difference of the first messages"
    )


def periods_of(log: Log, topics: Topics) -> dict[str, float]:
    """Return the mean time (s) between two messages of the topics of sensors and odometry."""
    counts = {channel.topic: channel.count for channel in log.channels}
    return {
        topic: log.duration / counts[topic]
        for topic in (topics.odometry, *topics.sensors)
        if topic and counts.get(topic, 0) > 1
    }


def first_transforms(
    log: Log, player: Player, configuration: Configuration, mountings: Mapping[str, tuple[str, tuple[float, ...]]]
) -> list[str]:
    """Add the static transforms, those of `mountings` and those of sensors that only the parameters describe; return notes.

    Static transforms are valid at all times, so all of them are read before the first cycle.
    """
    if "/tf_static" in player.frames_topics:
        for message in log.messages(["/tf_static"]):
            player.play(message)
    for frame, (parent, (x, y, z, yaw)) in mountings.items():
        transform = Transform3D(x, y, z, quaternion_of_yaw(yaw))
        player.frames.add_static([StampedTransform(clean_frame(parent), clean_frame(frame), 0.0, transform)])
    known = {*_moving_parents(log, player), *player.frames.parents}
    base = configuration.local_costmap.params.robot_base_frame
    notes: list[str] = []
    for topic, frame in _sensor_frames(log, player).items():
        if frame in known or frame == base:
            continue
        lidar = _lidar(configuration.navstack.sim, player.sensor_name(topic), frame)
        if lidar is None:
            notes.append(
                f'the frame "{frame}" of {topic} is not in the log, so its messages are not used; give its pose with '
                f"--mount {frame}=x,y,z,yaw"
            )
            continue
        transform = Transform3D(lidar.x, lidar.y, lidar.height, quaternion_of_yaw(lidar.yaw))
        player.frames.add_static([StampedTransform(base, frame, 0.0, transform)])
        notes.append(
            f'the frame "{frame}" of {topic} is not in the log; its pose on {base} is that of the simulated lidar: '
            f"x {lidar.x:g}, y {lidar.y:g}, z {lidar.height:g} m, yaw {lidar.yaw:g} rad; another one: --mount "
            f"{frame}=x,y,z,yaw"
        )
    return notes


def _sensor_frames(log: Log, player: Player) -> dict[str, str]:
    """Return the frame of the first message of each topic of a sensor."""
    found: dict[str, str] = {}
    wanted = set(player.sensor_topics)
    if wanted:
        for message in log.messages(sorted(wanted), end=LOOK_AHEAD_S):
            if message.topic not in found:
                try:
                    found[message.topic] = ros.frame_of(message.data)
                except LogError:
                    continue
            if len(found) == len(wanted):
                break
    return found


def _lidar(sim: SimParams, topic: str, frame: str) -> Any:
    """Return the simulated lidar with this frame, or, if there is none, of this topic."""
    lidars = [sim.lidar(name) for name in sim.lasers]
    same_frame = [lidar for lidar in lidars if lidar.frame == frame]
    same_topic = [lidar for lidar in lidars if lidar.topic.strip("/") == topic.strip("/")]
    return next(iter(same_frame or same_topic), None)


def place_robot(log: Log, player: Player, configuration: Configuration, initial_pose: Pose2D | None) -> list[str]:
    """Connect the map to the odometry if the log does not; return notes.

    Raises LogError for an initial pose in a log with a localization.
    """
    map_frame = configuration.global_costmap.params.global_frame
    moving = _moving_parents(log, player)
    parents = {**player.frames.parents, **moving}
    root = configuration.local_costmap.params.robot_base_frame
    seen: set[str] = set()
    odometry = _first_odometry(log, player)
    if player.derives_odometry_frame and odometry is not None:
        parents[odometry.child or root] = odometry.frame
    while root in parents and root not in seen:
        seen.add(root)
        root = parents[root]
    if root == map_frame or map_frame in seen:
        if initial_pose is not None:
            raise LogError(f'the log has a localization ("{map_frame}" is in its tf); leave --initial-pose out')
        return []
    if odometry is None:
        return [
            f'the log has neither odometry nor a transform from "{root}" to "{map_frame}": the robot\'s pose is unknown'
        ]
    offset = Transform2D()
    if initial_pose is not None:
        offset = Transform2D(*initial_pose) @ Transform2D(*odometry.pose).inverse()
    player.robot.frames.set_static(map_frame, root, offset)
    if initial_pose is not None:
        return []
    note = (
        f'the log has no localization (no transform from "{root}" to "{map_frame}"): "{root}" is used as "{map_frame}"; give '
        "the robot's first pose in the map with --initial-pose x,y,yaw"
    )
    return [note]


def _moving_parents(log: Log, player: Player) -> dict[str, str]:
    """Return the parent of each child of the first transforms of /tf."""
    found: dict[str, str] = {}
    if "/tf" in player.frames_topics:
        for message in log.messages(["/tf"], end=LOOK_AHEAD_S):
            try:
                found |= {child: parent for parent, child, _ in ros.edges_of(message.data)}
            except LogError:
                continue
    return found


def _first_odometry(log: Log, player: Player) -> ros.Odometry | None:
    topic = player.odometry_topic
    if topic:
        for message in log.messages([topic]):
            try:
                return ros.odometry_of(message.data, player.clock)
            except LogError:
                continue
    return None


def logged_map(log: Log, topics: Topics) -> OccupancyGrid | None:
    """Return the first map of a log; None if it has none. Raises LogError for one that is not valid."""
    if not topics.map:
        return None
    for message in log.messages([topics.map]):
        return ros.map_of(message.data)
    return None


def empty_map(log: Log, topics: Topics, initial_pose: Pose2D | None, frame: str) -> OccupancyGrid:
    """Return a free map of 40 x 40 m around the first pose of the robot."""
    centre = initial_pose
    if centre is None and topics.odometry:
        for message in log.messages([topics.odometry]):
            try:
                centre = ros.odometry_of(message.data, Clock(log.start_ns)).pose
            except NavError:
                continue
            break
    centre = centre or Pose2D(0.0, 0.0)
    cells = round(FREE_EXTENT_M / 0.05)
    x, y = (round(value - 0.5 * FREE_EXTENT_M, 2) for value in (centre.x, centre.y))
    data = np.zeros((cells, cells), np.int8)
    return OccupancyGrid(data, GridGeometry(cells, cells, 0.05, x, y), 0.0, frame, raw=True)


def last_pose(log: Log, configuration: Configuration, chosen: Mapping[str, str], initial_pose: Pose2D | None) -> Pose2D:
    """Return the pose of the robot in the global frame at the end of a log. Raises LogError if it is not known."""
    topics = find_topics(log, configuration, chosen)
    clock, _ = find_clock(log, topics)
    robot = LoggedRobot()
    base = configuration.local_costmap.params.robot_base_frame
    player = Player(robot, topics, clock, base_frame=base, periods={})
    first_transforms(log, player, configuration, {})
    place_robot(log, player, configuration, initial_pose)
    wanted = [topic for topic in (*topics.transforms, topics.odometry) if topic]
    for message in log.messages(wanted, start=max(0.0, log.duration - LOOK_BACK_S)):
        player.play(message)
    frame = configuration.global_costmap.params.global_frame
    pose = robot.pose_in(frame, base)
    if pose is None:
        raise LogError(
            f'the pose of the robot in "{frame}" is not known at the end of {log.path}; give the goal as x,y,yaw'
        )
    return pose
