"""Parameters + registries -> a running MoveBase: the only file that puts the parts together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from navstack.core import Footprint, FrameTree, Listener, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import InputError, PlanningError, StartOccupiedError, StartOutsideMapError
from navstack.core.poses import require_pose
from navstack.costmap import LayeredCostmap
from navstack.costmap.reconfigure import apply_reconfigure, check_reconfigure
from navstack.interfaces import GlobalPlanner, Plan, Robot
from navstack.map_io import load_mask
from navstack.move_base import MoveBase
from navstack.move_base.occupied_cell import add_layer
from navstack.parameters.configuration import Configuration, CostmapConfiguration, PluginChoice
from navstack.sim import Shape, SimulatedRobot, World


def build_costmap(
    name: str, configuration: CostmapConfiguration, frames: FrameTree, static_map: OccupancyGrid | None
) -> LayeredCostmap:
    """`global_costmap` or `local_costmap`, with the layers its parameters name."""
    return LayeredCostmap(
        name,
        configuration.params,
        configuration.layers,
        footprint=configuration.footprint,
        frames=frames,
        static_map=static_map,
        read_map=load_mask,
    )


def build_move_base(
    configuration: Configuration,
    robot: Robot,
    *,
    static_map: OccupancyGrid | None = None,
    listeners: Sequence[Listener] = (),
) -> MoveBase:
    """A goal manager that drives `robot` with the planners, costmaps and recoveries that `configuration` names.

    `static_map` is what map_server would publish; None for a robot without a map.
    """
    return MoveBase(
        configuration.move_base,
        robot=robot,
        global_costmap=build_costmap("global_costmap", configuration.global_costmap, robot.frames, static_map),
        local_costmap=build_costmap("local_costmap", configuration.local_costmap, robot.frames, static_map),
        global_planner=configuration.global_planner.cls(configuration.global_planner.params),
        local_planner=configuration.local_planner.cls(configuration.local_planner.params),
        recoveries=[choice.cls(choice.name, choice.params) for choice in configuration.recoveries],
        listeners=listeners,
        goal_time_limit_s=configuration.navstack.goal_time_limit or math.inf,
    )


def reconfigure(move_base: MoveBase, configuration: Configuration) -> None:
    """Gives a running goal manager the parameters, planners and costmap parameters of `configuration`.

    A planner is made anew when its plugin or its parameters differ. Costmaps keep what they have seen and take what
    dynamic_reconfigure can change in ROS (inflation, ranges, footprint, frequencies, size ..; `navstack.costmap.reconfigure`);
    recoveries stay as they are. Everything or nothing: when a planner cannot be made, or a costmap would have to be built
    anew, nothing is changed and the error is raised.
    """
    costmaps = [
        (costmap, given, given.layers)
        for costmap, given in (
            (move_base.global_costmap, configuration.global_costmap),
            (move_base.local_costmap, configuration.local_costmap),
        )
        if isinstance(costmap, LayeredCostmap)
    ]
    for costmap, given, layers in costmaps:
        check_reconfigure(costmap, given.params, layers)
    made_global = made_local = None
    choice = configuration.global_planner
    if type(move_base.global_planner) is not choice.cls or move_base.global_planner.params != choice.params:
        made_global = choice.cls(choice.params)
    driver = configuration.local_planner
    if type(move_base.local_planner) is not driver.cls or move_base.local_planner.params != driver.params:
        made_local = driver.cls(driver.params)
    move_base.reconfigure(configuration.move_base, global_planner=made_global, local_planner=made_local)
    move_base.goal_time_limit_s = configuration.navstack.goal_time_limit or math.inf
    changes = [apply_reconfigure(costmap, given.params, layers, given.footprint) for costmap, given, layers in costmaps]
    if any(changes):
        move_base.costmaps_changed()


def true_footprint(configuration: Configuration) -> Footprint:
    """The robot's outline without the padding that costmaps add."""
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
) -> SimulatedRobot:
    """A robot at `start` (map frame) among the map's walls and `obstacles` (x, y, radius; m), as `navstack: sim:` says.

    Lidars above them do not see `low_obstacles`; bumpers feel them. `shapes`: whatever else stands or moves there. A `World`
    in the place of the map has its own obstacles, to which none can be added.

    Raises StartOutsideMapError or StartOccupiedError when it cannot stand there.
    """
    footprint = true_footprint(configuration)
    if isinstance(static_map, World):
        if obstacles or low_obstacles or shapes:
            raise InputError("a world has its obstacles already; give a map with obstacles, or a world without")
        world, static_map = static_map, static_map.map
    else:
        world = World(static_map, obstacles, low_discs=low_obstacles, shapes=shapes)
    if not require_pose(start, "start").is_finite():
        raise InputError(f"the start {tuple(start)} is not finite; give x,y,yaw in metres and radians", pose=start)
    if not world.contains(start):
        left, right, bottom, top = static_map.geometry.extent
        raise StartOutsideMapError(
            f"the start ({start.x:g}, {start.y:g}) lies outside the map, which covers x {left:g} .. {right:g}, "
            f"y {bottom:g} .. {top:g} m",
            pose=start,
        )
    if not world.is_free(footprint, start):
        raise StartOccupiedError(
            f"the robot does not fit at the start ({start.x:g}, {start.y:g}, {start.yaw:g}): its outline "
            f"(circumscribed radius {footprint.circumscribed_radius:.2f} m) touches an obstacle; "
            f"{_nearest_free(world, footprint, start)}",
            pose=start,
        )
    return SimulatedRobot(
        configuration.navstack.sim,
        world,
        footprint,
        start,
        seed=seed,
        base_frame=configuration.local_costmap.params.robot_base_frame,
        odom_frame=odometry_frame(configuration),
        map_frame=true_frame(configuration),
    )


def odometry_frame(configuration: Configuration) -> str:
    """The frame odometry lives in: the local costmap's, unless that is the map's own."""
    local = configuration.local_costmap.params.global_frame
    return local if local != configuration.global_costmap.params.global_frame else "odom"


def true_frame(configuration: Configuration) -> str:
    """The frame of the simulated world: the global costmap's, or "map" above it for a robot that knows only odometry."""
    frame = configuration.global_costmap.params.global_frame
    return frame if frame != odometry_frame(configuration) else "map"


def _nearest_free(world: World, footprint: Footprint, pose: Pose2D) -> str:
    """A hint where the robot would fit, searched on rings around `pose`."""
    for ring in range(1, 21):
        radius = 0.1 * ring
        for k in range(6 * ring):
            angle = 2.0 * math.pi * k / (6 * ring)
            near = Pose2D(pose.x + radius * math.cos(angle), pose.y + radius * math.sin(angle), pose.yaw)
            if world.contains(near) and world.is_free(footprint, near):
                return f"it would fit at ({near.x:.2f}, {near.y:.2f})"
    return "it fits nowhere within 2 m"


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """A plan and the costmap it was made on."""

    plan: Plan
    costmap: LayeredCostmap
    planner: str


def plan_on_map(
    configuration: Configuration,
    static_map: OccupancyGrid,
    start: Pose2D,
    goal: Pose2D,
    *,
    planner: PluginChoice[GlobalPlanner] | None = None,
    keep_potential: bool = False,
) -> PlannedPath:
    """One plan on the global costmap of a robot that stands at `start` and has seen nothing but the map.

    Poses in the map's frame. Raises a PlanningError with code and data when there is none.
    """
    for what, pose in (("start", start), ("goal", goal)):
        if not require_pose(pose, what).is_finite():
            raise InputError(f"the {what} {tuple(pose)} is not finite; give x,y,yaw in metres and radians", pose=pose)
    if static_map.geometry.world_to_cell(start.x, start.y) is None and static_map.origin_yaw == 0.0:
        left, right, bottom, top = static_map.geometry.extent
        raise StartOutsideMapError(
            f"the start ({start.x:g}, {start.y:g}) lies outside the map, which covers x {left:g} .. {right:g}, "
            f"y {bottom:g} .. {top:g} m",
            pose=start,
        )
    frames = FrameTree()
    params = configuration.global_costmap.params
    frames.set_static(params.global_frame, params.robot_base_frame, Transform2D(start.x, start.y, start.yaw))
    costmap = build_costmap("global_costmap", configuration.global_costmap, frames, static_map)
    costmap.update(0.0)
    choice = planner or configuration.global_planner
    try:
        plan = choice.cls(choice.params).make_plan(
            costmap.master, start, goal, footprint=costmap.footprint, keep_potential=keep_potential
        )
    except PlanningError as error:
        raise add_layer(costmap, error) from None
    return PlannedPath(plan, costmap, choice.name)
