"""The last plan, returned again as long as nothing that it depends on has changed."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D, Window
from navstack.plugins import Plan

CHUNK: Final = 1 << 20
"""Number of cells compared at once: a comparison of a map of millions of cells at once would need as many bytes."""


class Request(NamedTuple):
    """The arguments of `make_plan`, except for the costs."""

    start: Pose2D
    goal: Pose2D
    geometry: GridGeometry
    frame: str
    keep_potential: bool
    footprint: Footprint | None


class PlanCache:
    """The last plan; valid while the request and all cells that its search read are the same."""

    def __init__(self) -> None:
        self._request: Request | None = None
        self._plan: Plan | None = None
        self._window = Window(0, 0, 0, 0)
        self._costs = np.empty((0, 0), np.uint8)

    def lookup(self, costmap: Costmap, request: Request) -> Plan | None:
        """The cached plan for this request; if there is none, clear the cache and return None."""
        if request == self._request and _are_equal(costmap.data[self._window.slices], self._costs):
            return self._plan
        self._request, self._plan, self._costs = None, None, np.empty((0, 0), np.uint8)
        return None

    def store(
        self,
        costmap: Costmap,
        request: Request,
        plan: Plan,
        window: Window,
        snapshot: NDArray[np.uint8] | None = None,
    ) -> None:
        """Cache a plan with the costs in `window`, which contains all cells that its search read.

        `snapshot`: a copy of all costs that will not change before the next `lookup`; without one the costs are copied.
        """
        plan.path.poses.setflags(write=False)  # the plan may be returned more than once
        self._request, self._plan, self._window = request, plan, window
        part = window.slices
        self._costs = costmap.data[part].copy() if snapshot is None else snapshot[part]


def _are_equal(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> bool:
    rows = max(1, CHUNK // max(1, a.shape[1]))
    return a.shape == b.shape and all(
        np.array_equal(a[y : y + rows], b[y : y + rows]) for y in range(0, a.shape[0], rows)
    )
