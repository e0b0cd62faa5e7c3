"""The part of the simple commander besides tasks: plans, costmaps, maps, poses, logging."""

from __future__ import annotations

import itertools
import logging
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import numpy as np

from navstack.basic_navigator.task import NO_ERROR, PASSED_RADIUS_M
from navstack.core import Bounds, Costmap, OccupancyGrid, Path, Pose2D
from navstack.core.errors import InputError, NavError, NotSupportedError
from navstack.costmap import LayeredCostmap
from navstack.interfaces import CostmapServer
from navstack.map_io import load_map
from navstack.move_base import MoveBase, plugin_calls

_LOG = logging.getLogger("navstack.basic_navigator")


def not_supported(name: str, alternative: str) -> NoReturn:
    """Raise NotSupportedError: navstack has no part that could do what `name` does."""
    raise NotSupportedError(f"{name} is not supported: {alternative}", method=name)


class NavigatorServices(ABC):
    """Everything of the simple commander that is no task."""

    move_base: MoveBase
    _now: float
    _error: tuple[int, str]
    _place: Callable[[Pose2D], None] | None
    """Initializes the localization, if it can be initialized."""

    @abstractmethod
    def cancelTask(self) -> None:
        """Cancel the present task and wait for its end."""

    @abstractmethod
    def _tick(self, end: float) -> None:
        """Advance to the next due time, at most to `end` (s)."""

    # --- plans --------------------------------------------------------------------------------------------------------

    def getPath(self, start: Pose2D, goal: Pose2D, planner_id: str = "", use_start: bool = False) -> Path | None:
        """Plan without driving, from the robot unless `use_start`; None without a plan, with the reason in `getTaskError`."""
        if planner_id:
            not_supported(
                f'planner_id "{planner_id}"', "there is one global planner; choose it with base_global_planner"
            )
        self._error = NO_ERROR
        try:
            return self.move_base.make_plan(goal, start if use_start else None).path
        except NavError as exc:
            self._error = (exc.code, exc.message)
            return None

    def getPathThroughPoses(
        self, start: Pose2D, goals: Sequence[Pose2D], planner_id: str = "", use_start: bool = False
    ) -> Path | None:
        """Plan through all `goals` in order; None if a leg has no plan, with the reason in `getTaskError`."""
        if not goals:
            raise InputError("the list of goals is empty; give at least one")
        legs = [self.getPath(start, goals[0], planner_id, use_start)]
        for a, b in itertools.pairwise(goals):
            if legs[-1] is None:
                break
            legs.append(self.getPath(a, b, planner_id, True))
        found = [leg for leg in legs if leg is not None]
        return Path(np.concatenate([leg.poses for leg in found]), found[0].frame) if len(found) == len(legs) else None

    def getTaskError(self) -> tuple[int, str]:
        """Return code and reason of the last task's failure; (0, "") without a failure."""
        return self._error

    def setTaskError(self, error_code: int, error_msg: str) -> None:
        """Replace code and reason of the last task's failure."""
        self._error = (error_code, error_msg)

    def clearTaskError(self) -> None:
        """Clear the failure of the last task."""
        self._error = NO_ERROR

    # --- maps and poses -----------------------------------------------------------------------------------------------

    def changeMap(self, map_filepath: str | os.PathLike[str] | OccupancyGrid) -> bool:
        """Replace the static map of both costmaps; False if no layer accepts it. Raises MapError for an unreadable file."""
        grid = map_filepath if isinstance(map_filepath, OccupancyGrid) else load_map(os.fspath(map_filepath))
        costmaps = (self.move_base.global_costmap, self.move_base.local_costmap)
        taken = [isinstance(c, LayeredCostmap) and c.set_static_map(grid) for c in costmaps]
        self.move_base.costmaps_changed()
        return any(taken)

    def setInitialPose(self, initial_pose: Pose2D) -> None:
        """Set the robot's pose (global frame).

        A simulated robot is put there, if no time has passed since its start. Otherwise the localization is initialized by the
        function `place` of the constructor. Without it, the pose must be where the robot is localized, to PASSED_RADIUS_M.
        Raises InputError if it is not, and the errors of `navstack.simulated_robot`.
        """
        if self._place is not None:
            self._place(initial_pose)
            return
        self.waitUntilNav2Active()
        away = self.move_base.global_costmap.robot_pose(self._now).distance_to(initial_pose)
        if away > PASSED_RADIUS_M:
            raise InputError(
                f"the initial pose ({initial_pose.x:g}, {initial_pose.y:g}) is {away:.2f} m from where the robot is localized; "
                "set the pose of a simulated robot before it drives, and give BasicNavigator(place=..) a function that "
                "initializes the localization of your robot",
                distance_m=away,
            )

    # --- costmaps -----------------------------------------------------------------------------------------------------

    def clearAllCostmaps(self) -> None:
        """Reset every layer of both costmaps."""
        self.move_base.clear_costmaps()

    def clearLocalCostmap(self) -> None:
        """Reset every layer of the local costmap."""
        self.move_base.local_costmap.reset()

    def clearGlobalCostmap(self) -> None:
        """Reset every layer of the global costmap."""
        self.move_base.global_costmap.reset()

    def clearCostmapAroundRobot(self, reset_distance: float) -> None:
        """Clear the observations of both costmaps in a square of side `reset_distance` (m) around the robot."""
        for costmap in self._costmaps:
            self._clear(costmap, costmap.robot_pose(self._now), reset_distance)

    def clearCostmapExceptRegion(self, reset_distance: float) -> None:
        """Clear the observations of both costmaps outside a square of side `reset_distance` (m) around the robot."""
        for costmap in self._costmaps:
            self._clear(costmap, costmap.robot_pose(self._now), reset_distance, invert=True)

    def clearLocalCostmapAroundPose(self, pose: Pose2D, reset_distance: float) -> None:
        """Clear the local costmap's observations in a square of side `reset_distance` (m) around `pose`, in its frame."""
        self._clear(self.move_base.local_costmap, pose, reset_distance)

    def clearGlobalCostmapAroundPose(self, pose: Pose2D, reset_distance: float) -> None:
        """Clear the global costmap's observations in a square of side `reset_distance` (m) around `pose`, in its frame."""
        self._clear(self.move_base.global_costmap, pose, reset_distance)

    def getGlobalCostmap(self) -> Costmap:
        """Return the global master grid, which later updates change; copy it to keep it."""
        return self.move_base.global_costmap.master

    def getLocalCostmap(self) -> Costmap:
        """Return the local master grid, which later updates change; copy it to keep it."""
        return self.move_base.local_costmap.master

    @property
    def _costmaps(self) -> tuple[CostmapServer, CostmapServer]:
        return self.move_base.local_costmap, self.move_base.global_costmap

    def _clear(self, costmap: CostmapServer, pose: Pose2D, side: float, *, invert: bool = False) -> None:
        """Clear inside the square, or outside with `invert`; the master grid follows at its next update."""
        if not side >= 0.0:
            raise InputError(f"reset_distance must be 0 m or more, not {side}", reset_distance=side)
        square = Bounds(pose.x, pose.y, pose.x, pose.y).grown(0.5 * side)
        for layer in costmap.layers:
            plugin_calls.call(layer, lambda layer=layer: layer.reset(square, invert=invert))

    # --- life cycle and log -------------------------------------------------------------------------------------------

    def waitUntilNav2Active(self, navigator: str = "bt_navigator", localizer: str = "amcl") -> None:
        """Update both costmaps once, so that plans can be requested. The names of Nav2's nodes have no effect."""
        del navigator, localizer
        self._tick(self._now)

    def lifecycleStartup(self) -> None:  # noqa: B027
        """Do nothing: every part is active from the start."""

    def lifecycleShutdown(self) -> None:
        """End every task, stop the robot and reject later tasks."""
        self.cancelTask()
        self.move_base.shutdown()

    def destroyNode(self) -> None:
        """End the present task: there is no ROS node to destroy."""
        self.cancelTask()

    def destroy_node(self) -> None:
        """End the present task: there is no ROS node to destroy."""
        self.cancelTask()

    def info(self, msg: str) -> None:
        """Log a message with the logger `navstack.basic_navigator` of Python's `logging`."""
        _LOG.info(msg)

    def warn(self, msg: str) -> None:
        """Log a warning."""
        _LOG.warning(msg)

    def error(self, msg: str) -> None:
        """Log an error."""
        _LOG.error(msg)

    def debug(self, msg: str) -> None:
        """Log a message for debugging."""
        _LOG.debug(msg)

    # --- what navstack cannot do --------------------------------------------------------------------------------------

    def smoothPath(self, path: Path, smoother_id: str = "", *_: Any, **__: Any) -> Path:
        """Return a smoother path over the global costmap; `smoother_id`: simple, savitzky_golay, constrained or another plugin.

        Without one, the smoother of the parameters (`base_smoother`), or simple. The smoother of the parameters keeps its own;
        others have defaults. Raises UnknownPluginError.
        """
        from navstack.plugins import SMOOTHERS
        from navstack.smoother import SmoothedPlanner

        planner = self.move_base.global_planner
        smoother = planner.smoother if isinstance(planner, SmoothedPlanner) else None
        cls = SMOOTHERS.get(smoother_id or "simple").cls
        if smoother is None or (smoother_id and type(smoother) is not cls):
            smoother = cls(cls.Params())
        costmap = self.move_base.global_costmap
        return smoother.smooth(path, costmap.master, footprint=costmap.footprint)

    def assistedTeleop(self, time_allowance: float = 30.0) -> NoReturn:
        """Raise NotSupportedError."""
        not_supported("assistedTeleop", "driveOnHeading, backup and spin check for obstacles while they move")

    def dockRobot(self, *_: Any, **__: Any) -> NoReturn:
        """Raise NotSupportedError."""
        not_supported("docking", "goToPose to a pose in front of the dock, then driveOnHeading")

    dockRobotByPose = dockRobotByID = dockRobot

    def undockRobot(self, dock_type: str = "", max_undocking_time: float = 30.0) -> NoReturn:
        """Raise NotSupportedError."""
        not_supported("undockRobot", "backup drives the robot out of its dock")

    def followGpsWaypoints(self, gps_poses: Sequence[Any]) -> NoReturn:
        """Raise NotSupportedError."""
        not_supported("followGpsWaypoints", "convert the positions to the map's frame, then followWaypoints")

    def getRoute(self, *_: Any, **__: Any) -> NoReturn:
        """Raise NotSupportedError."""
        not_supported("a route graph", "getPathThroughPoses plans through the poses of a route")

    getAndTrackRoute = getRoute
