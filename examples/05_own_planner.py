"""A global planner of your own: straight to the goal; registered by a name, used like the others."""

import numpy as np

import navstack as nav
from navstack.plugins import GLOBAL_PLANNERS, GlobalPlanner, NoValidPathError, ParamModel, Path, Plan, param


class StraightParams(ParamModel):
    """Namespace `straight`."""

    spacing: float = param(0.05, "distance between the poses", unit="m", gt=0.0)


@GLOBAL_PLANNERS.register("straight")
class Straight(GlobalPlanner[StraightParams]):
    """A straight line, or an error that says where it is blocked."""

    Params = StraightParams

    def make_plan(self, costmap, start, goal, *, footprint=None, keep_potential=False) -> Plan:
        count = max(2, int(np.hypot(goal.x - start.x, goal.y - start.y) / self.params.spacing))
        points = np.linspace(start[:2], goal[:2], count)
        for x, y in points:
            if costmap.data[costmap.geometry.world_to_cell(x, y)[::-1]] >= 253:  # the robot's center may not be there
                raise NoValidPathError(f"the line is blocked at ({x:.2f}, {y:.2f})")
        return Plan(Path(np.column_stack([points, np.full(count, goal.yaw)]), costmap.frame), 0.0, goal)


print(nav.plan("office", (2.5, 7.5), (9.0, 7.5), planner="straight"))
