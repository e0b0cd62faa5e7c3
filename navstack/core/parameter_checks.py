"""Checks across parameters: what `ParamModel.check` receives and reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from navstack.core.footprint import Footprint

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, slots=True)
class Issue:
    """A combination of parameters that does not work on this robot."""

    severity: Severity
    """`error`: the parameters cannot be loaded; `warning`: the robot will probably fail; `info`: worth knowing."""
    rule: str
    """Short stable name in kebab case: `scoring-scale`."""
    parameters: tuple[str, ...]
    """The parameters concerned; the first one that is written in a file gives the location.

    A name is relative to the namespace of the checked parameters (`scan/topic` for a namespace below), or to move_base's
    with a leading slash (`/local_costmap/width`).
    """
    message: str
    """What is wrong with which value, then how to fix it."""
    suggestion: str | None = None
    """The value or name to write instead."""


@dataclass(frozen=True, slots=True)
class SensorSource:
    """An observation source of a layer."""

    topic: str
    data_type: str = "LaserScan"
    min_height: float = float("-inf")
    """Lower points are dropped (m)."""
    max_height: float = float("inf")
    """Higher points are dropped (m)."""
    marking: bool = True
    sensor_frame: str = ""
    """Frame of the sensor's origin; empty: that of the message."""


@dataclass(frozen=True, slots=True)
class LayerTraits:
    """What a costmap layer does, as far as checks depend on it (`Layer.traits`)."""

    enabled: bool = True
    fed_by_sensors: bool = True
    """True if the layer marks obstacles from sensor data."""
    has_static_map: bool = False
    inflates: bool = False
    tracks_unknown_space: bool = False
    """True if the layer distinguishes unknown from free cells."""
    sources: Mapping[str, SensorSource] = field(default_factory=dict[str, SensorSource])
    """Observation sources by name."""


@dataclass(frozen=True, slots=True)
class LayerSetup:
    """A layer of a costmap: instance name and traits."""

    name: str
    traits: LayerTraits


@dataclass(frozen=True, slots=True)
class CostmapSetup:
    """A costmap of the robot: its parameters, padded footprint and layers in the order in which they write."""

    name: str
    robot_base_frame: str
    rolling_window: bool
    track_unknown_space: bool
    width: float
    height: float
    resolution: float
    update_frequency: float
    footprint: Footprint
    layers: tuple[LayerSetup, ...]

    def layers_after(self, name: str) -> tuple[LayerSetup, ...]:
        """The layers that write after the layer `name`."""
        names = [layer.name for layer in self.layers]
        return self.layers[names.index(name) + 1 :]


@dataclass(frozen=True, slots=True)
class CheckContext:
    """The robot around a plugin whose parameters are checked."""

    name: str
    """Instance name of the plugin."""
    ros_distro: str
    controller_frequency: float
    """Control cycles per second."""
    global_costmap: CostmapSetup
    local_costmap: CostmapSetup
    costmap: CostmapSetup
    """The costmap that a layer belongs to; the local costmap for every other plugin."""

    @property
    def costmaps(self) -> tuple[CostmapSetup, CostmapSetup]:
        """Both costmaps."""
        return self.global_costmap, self.local_costmap
