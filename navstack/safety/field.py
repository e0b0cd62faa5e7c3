"""The points of all sources of a monitor at one time."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap
from navstack.parameters.models.collision_monitor import MonitorSourceParams
from navstack.safety.near_beams import NearBeams
from navstack.safety.sources import NO_POINTS, CostmapObservation, Frames, Observation, Source, build_source


class PointField:
    """The sources of a monitor, and their points in the base frame since the last `update`."""

    def __init__(self, params: Mapping[str, MonitorSourceParams], frames: Frames, timeout_s: float) -> None:
        """`timeout_s`: default age (s) from which on data are stale; 0 = never."""
        self.sources: dict[str, Source] = {
            name: build_source(name, source, frames, timeout_s) for name, source in params.items()
        }
        self._by_topic: dict[str, list[Source]] = {}
        for source in self.sources.values():
            self._by_topic.setdefault(source.topic, []).append(source)
        self.near: dict[str, NearBeams] = {}
        """Name -> beams of the sources that see hardly anything but something too near to measure, base frame."""
        self._parts: dict[str, NDArray[np.float64]] = {}
        self._joined: dict[tuple[str, ...], NDArray[np.float64]] = {}

    def observe(self, data: Observation) -> None:
        """Pass a message to the sources of its topic."""
        for source in self._by_topic.get(data.topic.strip("/"), ()):
            if source.enabled:
                source.observe(data)

    def observe_costmap(self, name: str, costmap: Costmap, stamp: float) -> None:
        """Pass a costmap to the sources whose topic is in its namespace (`local_costmap/costmap`)."""
        for topic, sources in self._by_topic.items():
            if topic.partition("/")[0] != name:
                continue
            for source in sources:
                if source.enabled and source.params.type == "costmap":
                    source.observe(CostmapObservation(costmap, stamp, topic))

    def update(self, now: float, used: Collection[str] | None = None) -> dict[str, str]:
        """Move the points to the base frame at `now` (s); return name -> problem of the sources that make the robot stop.

        A source without a `source_timeout` never does. `used` are the sources that count; None for all.
        """
        self.near, self._parts, self._joined = {}, {}, {}
        problems: dict[str, str] = {}
        for name, source in self.sources.items():
            if not source.enabled or (used is not None and name not in used):
                continue
            points, problem = source.points(now)
            if problem and source.timeout_s > 0.0:
                problems[name] = problem
                continue
            near = source.near_beams(now)
            if near is not None:
                self.near[name] = near
            if len(points):
                self._parts[name] = points
        return problems

    def points(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        """Return the points (k, 2) of some of the sources, base frame. Read-only."""
        joined = self._joined.get(names)
        if joined is None:
            parts = [part for name in names if (part := self._parts.get(name)) is not None]
            joined = NO_POINTS if not parts else parts[0] if len(parts) == 1 else np.concatenate(parts)
            self._joined[names] = joined
        return joined
