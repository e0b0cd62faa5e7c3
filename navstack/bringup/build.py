"""Builds a running MoveBase or a simulated robot from a configuration: the only file that assembles the parts."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from navstack.behavior_trees import find_tree
from navstack.bringup.single_plan import build_costmap, make_global_planner
from navstack.core import (
    Event,
    Footprint,
    FrameError,
    InputError,
    Listener,
    OccupancyGrid,
    Pose2D,
    StartOccupiedError,
    Transform2D,
    clean_frame,
    require_finite_pose,
    start_outside_map,
)
from navstack.costmap import LayeredCostmap, apply_reconfigure, check_reconfigure
from navstack.docking import DockDatabase, docking_servers
from navstack.global_planner import is_smoothed_by, smoothed, unsmoothed
from navstack.localization import believed_start, make_filter, make_localizer
from navstack.move_base import MoveBase, Planning, TreeMoveBase, call, path_servers
from navstack.parameters import Configuration
from navstack.plugins import GlobalPlanner, LocalPlanner, Plugin, RecoveryBehavior, Robot
from navstack.safety import CollisionDetector, CollisionMonitor, CommandChain, CommandMultiplexer, VelocitySmoother
from navstack.sim import Estimation, Shape, SimulatedRobot, World, dock_shapes

RECOVERY_TIME_LIMIT_S: Final = 120.0
"""A recovery behavior that runs longer (s) fails."""


def build_chain(configuration: Configuration, robot: Robot) -> CommandChain:
    """Build what stands between the sources of commands and the robot: the sections that are written.

    A chain without sections passes commands on, of teleop before those of motions before those of the navigation.
    """
    safety = configuration.safety
    base, odom = configuration.local_costmap.params.robot_base_frame, odometry_frame(configuration)
    true, padded = configuration.local_costmap.true_footprint, configuration.local_costmap.footprint
    smoother, monitor, detector = safety.velocity_smoother, safety.collision_monitor, safety.collision_detector
    return CommandChain(
        robot,
        multiplexer=None if safety.twist_mux is None else CommandMultiplexer(safety.twist_mux),
        smoother=None if smoother is None else VelocitySmoother(smoother),
        monitor=None
        if monitor is None
        else CollisionMonitor(
            monitor,
            frames=robot.frames,
            base_frame=base,
            odom_frame=odom,
            footprint=true,
            padded_footprint=padded,
            max_decel=None if smoother is None else smoother.planar("max_decel"),
        ),
        detector=None
        if detector is None
        else CollisionDetector(detector, frames=robot.frames, base_frame=base, odom_frame=odom, footprint=padded),
    )


def build_move_base(
    configuration: Configuration,
    robot: Robot,
    *,
    static_map: OccupancyGrid | None = None,
    listeners: Sequence[Listener] = (),
    recovery_time_limit_s: float = RECOVERY_TIME_LIMIT_S,
    planning: Planning | None = None,
    stopwatch: Callable[[], float] | None = None,
    behavior_tree: str | os.PathLike[str] | None = None,
    trees_by_goal: bool = False,
) -> MoveBase:
    """Build a goal manager for `robot` with the planners, costmaps and recovery behaviors of a configuration.

    `static_map` is the map that map_server would publish; None for a robot without a map. If its frame is unknown to the
    robot, it is published in the global costmap's frame, with a warning.

    With sections for safety (`twist_mux`, `velocity_smoother`, `collision_monitor`, `collision_detector`), the robot gets its
    commands through a `CommandChain`, which is then `MoveBase.robot`; a robot that is a chain already is left as it is.
    `planning`, `stopwatch`: see `MoveBase`. With a `behavior_tree` (a file, or the name of a packaged one; default: that of the
    configuration), the tree drives the goals instead of move_base's states: see `TreeMoveBase`, which is also returned with
    `trees_by_goal`: its owner changes the tree between goals.
    """
    if configuration.safety.in_use and not isinstance(robot, CommandChain):
        robot = build_chain(configuration, robot)
    if static_map is not None and static_map.frame not in robot.frames.frames():
        published = _in_global_frame(configuration, static_map)
        if published is not static_map:
            _warn_of_frame(static_map.frame, published.frame, listeners)
        static_map = published
    behavior_tree = behavior_tree or configuration.navstack.behavior_tree or None
    kind = MoveBase if behavior_tree is None and not trees_by_goal else TreeMoveBase
    move_base = kind(
        configuration.move_base,
        robot=robot,
        global_costmap=build_costmap("global_costmap", configuration.global_costmap, robot.frames, static_map),
        local_costmap=build_costmap("local_costmap", configuration.local_costmap, robot.frames, static_map),
        global_planner=smoothed(make_global_planner(configuration.global_planner), configuration.smoother),
        local_planner=_local_planner(configuration.local_planner),
        recoveries=[_recovery(choice) for choice in configuration.recoveries],
        listeners=listeners,
        goal_time_limit_s=configuration.navstack.goal_time_limit or math.inf,
        stall_timeout_s=configuration.navstack.stall_timeout,
        recovery_time_limit_s=recovery_time_limit_s,
        planning=planning,
        stopwatch=stopwatch,
    )
    if isinstance(move_base, TreeMoveBase):
        smoothers = {choice.name: call(choice.cls, choice.cls, choice.params) for choice in configuration.smoothers}
        costmaps = move_base.global_costmap, move_base.local_costmap
        move_base.task_servers = path_servers(
            robot, costmaps, lambda: move_base.local_planner, smoothers, configuration.route_server
        )
        move_base.tree_behaviors = [_recovery(choice) for choice in configuration.behaviors]
        if configuration.docking is not None:
            move_base.behavior_servers = docking_servers(move_base, lambda: DockDatabase.of(configuration))
        if behavior_tree is not None:
            move_base.use_tree(find_tree(behavior_tree))
    _set_lost(move_base, configuration)
    return move_base


def _set_lost(move_base: MoveBase, configuration: Configuration) -> None:
    move_base.lost.action = configuration.navstack.lost_action
    move_base.lost.timeout_s = configuration.navstack.lost_timeout


def _in_global_frame(configuration: Configuration, static_map: OccupancyGrid) -> OccupancyGrid:
    """Return the map in the frame of the global costmap, as a map_server with that frame_id would publish it."""
    frame = clean_frame(true_frame(configuration))
    return static_map if static_map.frame == frame else replace(static_map, frame=frame)


def _warn_of_frame(unknown: str, frame: str, listeners: Sequence[Listener]) -> None:
    error = FrameError(
        f'the frame "{unknown}" of the map is not a frame of the robot, so the map is used in "{frame}", the global_frame of '
        f'global_costmap; on the robot, set the frame_id of map_server to "{frame}"',
        frame=unknown,
        used=frame,
    )
    for listener in listeners:
        listener.on_event(Event(0.0, "warning", error.message, error.as_dict()))


def _local_planner(choice: Plugin[LocalPlanner]) -> LocalPlanner:
    return call(choice.cls, choice.cls, choice.params)


def _recovery(choice: Plugin[RecoveryBehavior]) -> RecoveryBehavior:
    return call(choice.cls, choice.cls, choice.name, choice.params)


def reconfigure(move_base: MoveBase, configuration: Configuration) -> None:
    """Apply the parameters, planners and costmap parameters of a configuration to a running goal manager.

    A planner is replaced if its plugin or its parameters differ. Costmaps keep their observations and apply the parameters
    that dynamic_reconfigure can change in ROS (inflation, ranges, footprint, frequencies, size ..; see
    `navstack.costmap.layered_costmap`). Recovery behaviors remain. If anything raises, nothing has changed: a planner that cannot
    be created, or a costmap parameter that is fixed at run time.
    """
    costmaps = [
        (costmap, target)
        for costmap, target in (
            (move_base.global_costmap, configuration.global_costmap),
            (move_base.local_costmap, configuration.local_costmap),
        )
        if isinstance(costmap, LayeredCostmap)
    ]
    for costmap, target in costmaps:
        check_reconfigure(costmap, target.params, target.layers)
    new_global, new_local = configuration.global_planner, configuration.local_planner
    planner, smoother = move_base.global_planner, configuration.smoother
    replaced = not is_smoothed_by(planner, smoother) or _differs(unsmoothed(planner), new_global)
    move_base.reconfigure(
        configuration.move_base,
        global_planner=smoothed(make_global_planner(new_global), smoother) if replaced else None,
        local_planner=_local_planner(new_local) if _differs(move_base.local_planner, new_local) else None,
    )
    move_base.goal_time_limit_s = configuration.navstack.goal_time_limit or math.inf
    move_base.stall_timeout_s = configuration.navstack.stall_timeout
    _set_lost(move_base, configuration)
    changes = [
        apply_reconfigure(costmap, target.params, target.layers, target.footprint) for costmap, target in costmaps
    ]
    if any(changes):
        move_base.costmaps_changed()


def _differs(planner: GlobalPlanner | LocalPlanner, choice: Plugin[GlobalPlanner] | Plugin[LocalPlanner]) -> bool:
    return type(planner) is not choice.cls or planner.params != choice.params


def true_footprint(configuration: Configuration) -> Footprint:
    """Return the robot's footprint without the padding of the costmaps."""
    return configuration.local_costmap.true_footprint


def simulated_robot(
    configuration: Configuration,
    static_map: OccupancyGrid | World,
    start: Pose2D,
    *,
    obstacles: Sequence[tuple[float, float, float]] = (),
    low_obstacles: Sequence[tuple[float, float, float]] = (),
    shapes: Sequence[Shape] = (),
    seed: int = 0,
    known_map: OccupancyGrid | None = None,
) -> SimulatedRobot:
    """Build the robot of the section `navstack: sim:` at `start` (map frame), among walls and `obstacles` (x, y, radius; m).

    `low_obstacles` are below the plane of higher lidars, but bumpers detect them. `shapes` are other static or moving
    obstacles; the bodies of the docks of `navstack: sim:` are added. A `World` instead of a map has its own obstacles, and no
    others can be added.

    The robot localizes itself on `known_map` (default: the map of the world).

    Raises InputError, StartOutsideMapError, or StartOccupiedError if the robot collides at the start.
    """
    footprint = true_footprint(configuration)
    if isinstance(static_map, World):
        if obstacles or low_obstacles or shapes:
            raise InputError("a World already has obstacles; pass a map with obstacles, or a World without")
        world = static_map
    else:
        docks = dock_shapes(configuration.navstack.sim)
        world = World(static_map, obstacles, low_discs=low_obstacles, shapes=(*shapes, *docks))
    _check_start(world, footprint, start)
    sim, sections = configuration.navstack.sim, configuration.localization
    localizer = make_localizer(sim, sections, known_map or world.map, start, seed)
    estimation = Estimation(localizer, make_filter(sim, sections), believed_start(sim, start))
    robot = SimulatedRobot(
        configuration.navstack.sim,
        world,
        footprint,
        start,
        seed=seed,
        base_frame=configuration.local_costmap.params.robot_base_frame,
        odom_frame=odometry_frame(configuration),
        map_frame=true_frame(configuration),
        estimation=estimation,
    )
    _join_base_frames(robot, configuration)
    return robot


def _join_base_frames(robot: SimulatedRobot, configuration: Configuration) -> None:
    """Give the robot the base frame of the global costmap too: base_link and base_footprint are one pose in the plane."""
    other = configuration.global_costmap.params.robot_base_frame
    if other not in robot.frames.frames():
        robot.frames.set_static(robot.base_frame, other, Transform2D())


def odometry_frame(configuration: Configuration) -> str:
    """Return the frame of the odometry: the local costmap's frame, unless that is the map's frame."""
    local = configuration.local_costmap.params.global_frame
    return local if local != configuration.global_costmap.params.global_frame else "odom"


def true_frame(configuration: Configuration) -> str:
    """Return the frame of the simulated world: the global costmap's frame, or "map" for a robot with odometry only."""
    frame = configuration.global_costmap.params.global_frame
    return frame if frame != odometry_frame(configuration) else "map"


def _check_start(world: World, footprint: Footprint, start: Pose2D) -> None:
    require_finite_pose(start, "start")
    if not world.contains(start):
        raise start_outside_map(world.map, start)
    if not world.is_free(footprint, start):
        raise StartOccupiedError(
            f"the robot collides with an obstacle at the start ({start.x:g}, {start.y:g}, {start.yaw:g}): its footprint has "
            f"a circumscribed radius of {footprint.circumscribed_radius:.2f} m; {_nearest_free(world, footprint, start)}",
            pose=start,
        )


def _nearest_free(world: World, footprint: Footprint, pose: Pose2D) -> str:
    """Return a hint with the first free pose on rings around `pose`."""
    for ring in range(1, 21):
        radius = 0.1 * ring
        for k in range(6 * ring):
            angle = 2.0 * math.pi * k / (6 * ring)
            near = Pose2D(pose.x + radius * math.cos(angle), pose.y + radius * math.sin(angle), pose.yaw)
            if world.contains(near) and world.is_free(footprint, near):
                return f"it fits at ({near.x:.2f}, {near.y:.2f})"
    return "it fits nowhere within 2 m"
