"""Speed masks: the limit where the robot stands, handed to the local planner, and taken back where it ends."""

from __future__ import annotations

import math
from collections.abc import Sequence

from navstack.interfaces import CostmapServer, LocalPlanner


class SpeedLimiter:
    """Those of the costmaps' layers that limit the speed. Without any, asking costs nothing.

    As Nav2's SpeedFilter: percents are of the planner's full speed, the lowest of all limits counts, and a limit of 0 is none.
    """

    def __init__(self, costmaps: Sequence[CostmapServer], planner: LocalPlanner) -> None:
        self._planner = planner
        self._masks = [costmap for costmap in costmaps if costmap.limits_speed]
        limits = planner.limits if self._masks else None
        self._full = (
            0.0 if limits is None else min(limits.max_vel_trans, math.hypot(limits.max_vel_x, limits.max_vel_y))
        )
        self.limit: float | None = None
        """m/s in force; None for none."""

    def apply(self, now: float, *, slowed: bool) -> bool:
        """Sets the limit of where the robot stands at `now` (s); True when it is another than before.

        `slowed`: a recovery behaviour may hold limits of its own; a lower one is left to it. Raises FrameError.
        """
        if not self._masks:
            return False
        limit = self._limit(now)
        held = self._planner.limits.max_vel_trans
        if limit == self.limit and (limit is None or held <= limit):
            return False
        if slowed and (limit is None or held <= limit):
            return False  # once the recovery has lifted its limits
        # the turning speed stays as it is: a recovery may have lowered that too
        turning = self._planner.limits.max_vel_theta if slowed else None
        self._planner.set_limits(max_vel_trans=limit, max_vel_theta=turning)
        changed = limit != self.limit
        self.limit = limit
        return changed

    def _limit(self, now: float) -> float | None:
        lowest = math.inf
        for costmap in self._masks:
            pose = costmap.robot_pose(now)
            limit = costmap.speed_limit(pose.x, pose.y, self._full)
            if limit is not None:
                lowest = min(lowest, limit)
        return lowest if lowest < self._full else None
