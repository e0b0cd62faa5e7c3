"""Plans once, without a running MoveBase: on the costmap of a robot's configuration, or on an array."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from navstack.core import (
    FREE,
    LETHAL,
    Costmap,
    Footprint,
    FrameTree,
    InputError,
    OccupancyGrid,
    PlanningError,
    Pose2D,
    Transform2D,
    Values,
    clean_frame,
    is_number,
    lethal_cells_along,
    require_finite_pose,
    start_outside_map,
    turn_note,
)
from navstack.costmap import LayeredCostmap, costs_of_occupied
from navstack.global_planner import smoothed
from navstack.map_io import load_mask
from navstack.move_base import add_layer, call, make_plan
from navstack.parameters import Configuration, CostmapConfiguration, message_for, nearest
from navstack.plugins import GLOBAL_PLANNERS, GlobalPlanner, Plan, Plugin


def build_costmap(
    name: str, configuration: CostmapConfiguration, frames: FrameTree, static_map: OccupancyGrid | None
) -> LayeredCostmap:
    """Build `global_costmap` or `local_costmap` with the layers of its parameters."""
    return LayeredCostmap(
        name,
        configuration.params,
        configuration.layers,
        footprint=configuration.footprint,
        frames=frames,
        static_map=static_map,
        read_map=load_mask,
    )


def make_global_planner(choice: Plugin[GlobalPlanner]) -> GlobalPlanner:
    """Make the global planner of a configuration, without its smoother. Raises NavError if its constructor fails."""
    return call(choice.cls, choice.cls, choice.params)


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """A plan, and the costmap and the planner that made it."""

    plan: Plan
    costmap: LayeredCostmap
    planner: str
    lethal_cells: tuple[int, float] = (0, math.inf)
    """How many lethal cells the path crosses, and after how many meters first."""


def plan_on_map(
    configuration: Configuration,
    static_map: OccupancyGrid,
    start: Pose2D,
    goal: Pose2D,
    *,
    planner: Plugin[GlobalPlanner] | None = None,
    keep_potential: bool = False,
) -> PlannedPath:
    """Plan once on the global costmap of a robot at `start` that knows only the map.

    The poses are in the map frame. Raises InputError, and a PlanningError with code and data if there is no plan.
    """
    require_finite_pose(start, "start")
    require_finite_pose(goal, "goal")
    if static_map.geometry.world_to_cell(start.x, start.y) is None and static_map.origin_yaw == 0.0:
        raise start_outside_map(static_map, start)
    costmap = costmap_on_map(configuration, static_map, start)
    choice = planner or configuration.global_planner
    chosen = smoothed(make_global_planner(choice), configuration.smoother)
    try:
        plan = make_plan(chosen, costmap.master, start, goal, costmap.footprint, keep_potential=keep_potential)
    except PlanningError as error:
        raise add_layer(costmap, error) from None
    note = turn_note(plan.path, configuration.turning_radius)
    if note is not None:
        plan = replace(plan, notes=(*plan.notes, note))
    lethal, first = _lethal_cells(costmap.master, plan)
    if lethal:
        cells = "a lethal cell" if lethal == 1 else f"{lethal} lethal cells"
        text = (
            f"the path crosses {cells}, the first after {first:.2f} m: the robot cannot drive it; use another planner"
        )
        plan = replace(plan, notes=(*plan.notes, text))
    return PlannedPath(plan, costmap, choice.name, (lethal, first))


def _lethal_cells(costmap: Costmap, plan: Plan) -> tuple[int, float]:
    """Return how many lethal cells a plan crosses, and after how many meters first.

    The cell of the start does not count: the robot is there, and the planner says what it did about it.
    """
    start = costmap.geometry.world_to_cell(*plan.path.poses[0, :2].tolist())
    if start is not None and costmap.data[start[1], start[0]] == LETHAL:
        costmap = costmap.copy()
        costmap.data[start[1], start[0]] = FREE
    return lethal_cells_along(costmap, plan.path.poses)


def costmap_on_map(configuration: Configuration, static_map: OccupancyGrid, start: Pose2D) -> LayeredCostmap:
    """The global costmap of a robot at `start` that knows only the map."""
    frames = FrameTree()
    params = configuration.global_costmap.params
    static_map = replace(static_map, frame=clean_frame(params.global_frame))
    frames.set_static(params.global_frame, params.robot_base_frame, Transform2D(start.x, start.y, start.yaw))
    costmap = build_costmap("global_costmap", configuration.global_costmap, frames, static_map)
    costmap.update(0.0)
    return costmap


def plan(
    array: ArrayLike,
    resolution: float,
    start: Pose2D | tuple[float, ...],
    goal: Pose2D | tuple[float, ...],
    *,
    planner: str = "navfn",
    parameters: Mapping[str, Any] | None = None,
    values: Values | None = None,
    unknown: Literal["occupied", "free"] = "occupied",
    robot_radius: float = 0.0,
    footprint: Footprint | Sequence[tuple[float, float]] | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
) -> Plan:
    """Plan once on an array (ny, nx), without files. Row 0 has the smallest y.

    `resolution` is the size of a cell (m), `origin` the lower left corner of the array (x, y; m). A bool array is True where
    occupied; `values` names the meaning of other arrays, see `OccupancyGrid.from_array`. Unknown cells count as occupied unless
    `unknown` is "free". `start` and `goal` are (x, y) or (x, y, yaw) in meters and radians. No center of a cell on the path is
    within `robot_radius` (m) of an occupied cell's center; with 0, the robot is a point. Instead, `footprint` gives the robot's
    corners (x, y) in its own frame (m): `smac_hybrid` and `smac_lattice` keep all of it free, others its inscribed circle.

    `planner` is any registered name, `parameters` its parameters by name; the others have their defaults. The exception is
    `carrot_planner`: its path is a straight line, which may cross walls, because only the cell of the goal is checked, as in ROS.
    Use `plan_on_map` for the costs of a robot's own parameters.

    Raises InputError, UnknownPluginError, and a PlanningError with code and data if there is no plan.
    """
    ends = pose_of("start", start), pose_of("goal", goal)
    if unknown not in ("occupied", "free"):
        raise InputError(f'unknown={unknown!r} is neither "occupied" nor "free"', argument="unknown")
    shape, radius = _shape(footprint, robot_radius)
    chosen = _planner_of(planner, {} if parameters is None else parameters)
    grid = OccupancyGrid.from_array(array, resolution, origin=origin, values=values)
    if grid.geometry.world_to_cell(ends[0].x, ends[0].y) is None:
        raise start_outside_map(grid, ends[0])
    lethal = (grid.data == 100) | ((grid.data == -1) & (unknown == "occupied"))
    costmap = Costmap(grid.geometry, costs_of_occupied(lethal, radius / grid.geometry.resolution))
    return make_plan(chosen, costmap, *ends, shape)


def _shape(footprint: Footprint | Sequence[tuple[float, float]] | None, radius: Any) -> tuple[Footprint | None, float]:
    """Return the footprint, if there is one, and the radius around occupied cells (m). Raises InputError."""
    if not (is_number(radius) and math.isfinite(radius) and radius >= 0.0):
        raise InputError(f"robot_radius must be a length of 0 m or more, not {radius!r}", argument="robot_radius")
    if footprint is None:
        return None, radius
    if radius > 0.0:
        raise InputError("footprint and robot_radius exclude each other; give one of them", argument="footprint")
    if not isinstance(footprint, Footprint):
        try:
            footprint = Footprint(np.array(footprint, np.float64))
        except (TypeError, ValueError):
            raise InputError(
                f"footprint={footprint!r} is not a list of corners; give [(x, y), (x, y), (x, y), ..] in meters",
                argument="footprint",
            ) from None
    return footprint, footprint.inscribed_radius


def _planner_of(name: str, parameters: Any) -> GlobalPlanner:
    """Return a registered planner with its parameters. Raises UnknownPluginError, and InputError for a wrong parameter."""
    if not isinstance(parameters, Mapping):
        raise InputError(f"parameters={parameters!r} is not a dictionary of names and values", argument="parameters")
    entry = GLOBAL_PLANNERS.get(name)
    known = entry.cls.Params.model_fields
    for key in parameters:
        if key not in known:
            near = nearest(str(key), known)
            hint = f'did you mean "{near}"?' if near else f"`navstack params reference` lists those of {name}"
            raise InputError(f'{name} has no parameter "{key}"; {hint}', argument="parameters")
    try:
        params = entry.cls.Params(**parameters)
    except ValidationError as exc:
        error = exc.errors(include_url=False)[0]
        key = str(error["loc"][0]) if error["loc"] else ""
        text = message_for(error, key, known.get(key), None, of_ros=False)
        raise InputError(f"{name}: {text}", argument="parameters") from None
    return call(entry.cls, entry.cls, params)


def pose_of(name: str, value: Any) -> Pose2D:
    """Return a finite pose; a tuple is (x, y) or (x, y, yaw)."""
    try:
        if not isinstance(value, Pose2D):
            x, y, *yaw = (float(v) for v in value)
            value = Pose2D(x, y, *yaw)
    except (TypeError, ValueError):
        raise InputError(f"the {name} {value!r} is not (x, y) or (x, y, yaw) in meters and radians") from None
    return require_finite_pose(value, name)
