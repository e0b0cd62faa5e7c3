"""Smoothers: what happens to a plan between the global planner and the local planner."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from navstack.core import Costmap, Footprint, Path
from navstack.core.parameters import ParamModel


class Smoother(ABC):
    """Replaces the poses of a path by smoother ones that the robot can drive as well."""

    Params: ClassVar[type[ParamModel]]

    def __init__(self, params: Any) -> None:
        self.params = params

    @abstractmethod
    def smooth(self, path: Path, costmap: Costmap, *, footprint: Footprint | None = None) -> Path:
        """Return a smoother path with the same ends, in the frame of the costmap; `path` and `costmap` are unchanged.

        No pose of the result is in collision (cost 253 or 254 at its centre, or `footprint` over a lethal cell) unless the path
        was there already. A path that cannot be smoothed is returned as it is. Raises InputError for a path that is not finite.
        """
