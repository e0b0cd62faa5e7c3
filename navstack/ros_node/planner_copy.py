"""Plans at any time, also while the robot drives, without a wait for the control cycle."""

from __future__ import annotations

import threading

from navstack.core import Costmap, Footprint, Pose2D
from navstack.global_planner import unsmoothed
from navstack.move_base import MoveBase, plugin_calls
from navstack.plugins import GlobalPlanner, Plan
from navstack.ros_node.inbox import Inbox


class PlannerCopy:
    """A planner of its own, with the parameters of the node's, on a copy of the costmap, for the threads of services.

    Neither the control cycle nor the plans of a goal wait for it.
    """

    def __init__(self, move_base: MoveBase, inbox: Inbox, *, with_smoother: bool = False) -> None:
        """`with_smoother`: plans are smoothed as those of goals; the service of move_base's planner does not."""
        self._move_base, self._inbox, self._with_smoother = move_base, inbox, with_smoother
        self._lock = threading.Lock()
        self._model: GlobalPlanner | None = None
        self._planner: GlobalPlanner | None = None

    def snapshot(self) -> tuple[GlobalPlanner, Costmap, Footprint]:
        """Return the node's planner, a copy of its costmap, and the footprint. Called in any thread but the node's."""
        return self._inbox.call(self._take)

    def _take(self) -> tuple[GlobalPlanner, Costmap, Footprint]:
        costmap = self._move_base.global_costmap
        planner = self._move_base.global_planner
        return planner if self._with_smoother else unsmoothed(planner), costmap.master.copy(), costmap.footprint

    def plan(self, model: GlobalPlanner, costmap: Costmap, footprint: Footprint, start: Pose2D, goal: Pose2D) -> Plan:
        """Plan with a planner like `model`. Raises a PlanningError."""
        with self._lock:
            if self._planner is None or self._model is not model:
                plain = unsmoothed(model)
                self._planner = plugin_calls.call(plain, type(plain), plain.params)
                self._model = model
            return plugin_calls.make_plan(self._planner, costmap, start, goal, footprint)
