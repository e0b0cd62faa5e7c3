"""The collision detector: reports in which zones obstacles are, without changing commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from navstack.core import Footprint, FrameTree, Twist2D
from navstack.parameters.models.collision_monitor import CollisionDetectorParams
from navstack.safety.field import PointField
from navstack.safety.sources import Frames, Observation
from navstack.safety.zones import Zone


@dataclass(frozen=True, slots=True)
class Detections:
    """The result of one check."""

    time: float
    """Seconds."""
    zones: dict[str, bool] = field(default_factory=dict[str, bool])
    """Enabled zones -> obstacles are inside."""
    problems: dict[str, str] = field(default_factory=dict[str, str])
    """Sources without valid data -> why."""


class CollisionDetector:
    """Checks the zones at its frequency."""

    def __init__(
        self,
        params: CollisionDetectorParams,
        *,
        frames: FrameTree,
        base_frame: str = "base_footprint",
        odom_frame: str = "odom",
        footprint: Footprint | None = None,
    ) -> None:
        """`base_frame` and `odom_frame` count where the parameters set none; `footprint` as of the collision monitor."""
        self.params = params
        frame_names = (params.base_frame_id or base_frame, params.odom_frame_id or odom_frame)
        self.frames = Frames(frames, *frame_names, params.transform_tolerance, params.base_shift_correction)
        names = tuple(params.sources)
        self.zones = [Zone(name, zone, names, footprint) for name, zone in params.zones.items()]
        self.field = PointField(params.sources, self.frames, params.source_timeout)
        self.last: Detections | None = None
        """The last result."""
        self._due = -math.inf

    @property
    def due(self) -> float:
        """Time of the next check (s)."""
        return self._due

    def observe(self, data: Observation) -> None:
        """Take sensor data."""
        self.field.observe(data)

    def step(self, now: float, command: Twist2D | None = None) -> Detections:
        """Check all enabled zones at `now` (s). `command` chooses the polygon of a velocity polygon (default: standing)."""
        self._due += 1.0 / self.params.frequency
        if not self._due > now:
            self._due = now + 1.0 / self.params.frequency
        problems = self.field.update(now)
        problems |= {name: near.what for name, near in self.field.near.items()}
        found: dict[str, bool] = {}
        for zone in self.zones:
            if not zone.enabled:
                continue
            zone.choose(command or Twist2D(), largest=True)
            if zone.shape is None:
                problems[zone.name] = "the zone has no shape: nothing was received on its topic"
                continue
            count, _ = zone.inside(self.field.points(zone.sources))
            found[zone.name] = zone.debounce(count >= zone.least)
        self.last = Detections(now, found, problems)
        return self.last
