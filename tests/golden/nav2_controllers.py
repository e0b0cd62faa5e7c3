"""Jobs of Nav2's controllers: the nested parameters, the costmap and the plan of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.plugins import LocalPath


def nested_params(job: dict[str, Any]) -> dict[str, Any]:
    """The parameters of a job as a tree: `FollowPath.GoalDist.scale` is `["GoalDist"]["scale"]`."""
    tree: dict[str, Any] = {}
    for key, value in job["params"].items():
        *above, last = key.removeprefix("FollowPath.").split(".")
        at = tree
        for part in above:
            at = at.setdefault(part, {})
        at[last] = value
    return tree


class Scene:
    """Costmap and plan of a scene; `kind` names the costmap among those of the scene."""

    def __init__(self, data: dict[str, NDArray[Any]], name: str, kind: str) -> None:
        x, y, resolution = data[f"scene/{name}/info"].tolist()
        costs = data[f"scene/{name}/{kind}"]
        ny, nx = costs.shape
        self.costmap = Costmap(GridGeometry(nx, ny, resolution, x, y), costs.copy())
        self.plan = data[f"scene/{name}/plan"]
        self.goal = Pose2D(*self.plan[-1].tolist())

    def path(self, first: int, end: int) -> LocalPath:
        """The poses `first` to `end` of the plan, the last one excluded."""
        poses = np.ascontiguousarray(self.plan[first:end])
        length = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
        return LocalPath(poses, length, length, first, end)
