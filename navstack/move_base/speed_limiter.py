"""Speed limits of the costmaps (speed masks), applied to the local planner at the robot's position."""

from __future__ import annotations

import math
from collections.abc import Sequence

from navstack.interfaces import CostmapServer, LocalPlanner
from navstack.move_base import plugin_calls


class SpeedLimiter:
    """Applies the lowest speed limit of the costmaps. Costmaps without limits are not asked.

    As Nav2's SpeedFilter: percentages refer to the local planner's full speed, and a limit of 0 is ignored.
    """

    def __init__(self, costmaps: Sequence[CostmapServer], planner: LocalPlanner) -> None:
        self.limit: float | None = None
        """The present limit (m/s); None without a limit."""
        self._planner = planner
        self._costmaps = [costmap for costmap in costmaps if costmap.limits_speed]
        self.is_needed = bool(self._costmaps)
        """True if a costmap may limit the speed."""
        limits = plugin_calls.limits_of(planner) if self._costmaps else None
        self._full_speed = (
            0.0 if limits is None else min(limits.max_vel_trans, math.hypot(limits.max_vel_x, limits.max_vel_y))
        )

    def apply(self, now: float, *, slowed: bool) -> bool:
        """Apply the limit at the robot's position at `now` (s); return True if it has changed.

        `slowed`: a recovery behavior may have set limits; a lower limit of it is kept. Raises NavError.
        """
        limit = self._lowest(now)
        present = plugin_calls.limits_of(self._planner)
        if limit == self.limit and (limit is None or present.max_vel_trans <= limit):
            return False
        if slowed and (limit is None or present.max_vel_trans <= limit):
            return False  # applied once the recovery behavior has restored the limits
        # a recovery behavior may also have lowered the rotational speed: keep it
        plugin_calls.set_limits(self._planner, limit, present.max_vel_theta if slowed else None)
        changed = limit != self.limit
        self.limit = limit
        return changed

    def _lowest(self, now: float) -> float | None:
        lowest = math.inf
        for costmap in self._costmaps:
            pose = plugin_calls.robot_pose(costmap, now)
            limit = plugin_calls.call(costmap, costmap.speed_limit, pose.x, pose.y, self._full_speed)
            if limit is not None:
                lowest = min(lowest, limit)
        return lowest if lowest < self._full_speed else None
