"""A layer of layers with a grid of its own, which is combined with the master grid (nav2_costmap_2d's PluginContainerLayer)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar, cast

from navstack.core import (
    UNKNOWN,
    Bounds,
    Costmap,
    Footprint,
    GridGeometry,
    InputError,
    NavError,
    Pose2D,
    SensorData,
    Window,
)
from navstack.costmap.obstacle_layer import combine_as_nav2
from navstack.costmap.windows import clear_region, fill_window, shift_cells, window_shift
from navstack.parameters import section_model
from navstack.plugins import (
    LAYERS,
    CellExplanation,
    Inflation,
    Layer,
    LayerContext,
    LayerTraits,
    ParamModel,
    SensorSource,
    param,
)


@cache
def contained_model(plugin: str) -> type[ParamModel]:
    """Return the parameter model of a layer type, with the parameter `plugin` that names it in the section of a container."""
    base = LAYERS.get(plugin).cls.Params
    members: dict[str, Any] = {
        "__doc__": base.__doc__,
        "__module__": __name__,
        "__annotations__": {"plugin": "str"},
        "plugin": param(plugin, "type of the layer"),
    }
    metaclass: Any = type(base)
    return metaclass(f"Contained{base.__name__}", (base,), members)


class PluginContainerLayerParams(ParamModel):
    """Parameters of Nav2's plugin container: the names of its layers, each with a section that names its `plugin`."""

    enabled: bool = param(True, "apply this layer")
    plugins: list[str] = param([], "names of the layers of this layer, in the order in which they write")
    combination_method: int = param(
        1,
        "0 overwrites the layers below, 1 takes the larger cost, 2 the larger cost in known cells of the layers below; another "
        "value counts as 1, as in Nav2",
    )
    nav2_compatible: bool = param(
        False,
        "never clear the grid, and leave it where it is in a rolling window, as Nav2 does: costs inside it only grow",
    )
    sections: dict[str, Any] = param({}, "parameters of the layers, by name")

    CHILD_FIELD: ClassVar[str | None] = "sections"

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """One namespace for each of `plugins`, of the model of its type."""
        listed = values.get("plugins")
        names = [name for name in listed if isinstance(name, str)] if isinstance(listed, (list, tuple)) else []
        models: dict[str, type[ParamModel]] = {}
        for name in names:
            written = values.get(name)
            kind = written.get("plugin") if isinstance(written, Mapping) else None
            known = isinstance(kind, str) and kind in LAYERS
            models[name] = contained_model(cast("str", kind)) if known else section_model(LAYERS, values, name, "")
        return models


@LAYERS.register("plugin_container", aliases=("nav2_costmap_2d/PluginContainerLayer",))
class PluginContainerLayer(Layer):
    """Layers that write into a grid of their own; the result is combined with the master grid.

    An inflation layer in it sees only the obstacles of the same container. 1 byte per cell, besides the layers.

    # Nav2 differs: its grid is never cleared and does not follow a rolling window, so that costs inside it only grow
    # (`nav2_compatible` restores that).
    """

    Params: ClassVar[type[ParamModel]] = PluginContainerLayerParams
    AS_NAV2 = True
    LIVE: ClassVar[frozenset[str]] = frozenset({"enabled", "combination_method"})

    @classmethod
    def traits(cls, params: PluginContainerLayerParams) -> LayerTraits:
        """Those of its layers together."""
        parts = [LAYERS.get(p.plugin).cls.traits(p) for p in params.sections.values()] if params.enabled else []
        sources: dict[str, SensorSource] = {}
        for part in parts:
            sources.update(part.sources)
        return LayerTraits(
            enabled=params.enabled,
            fed_by_sensors=any(part.fed_by_sensors for part in parts),
            has_static_map=any(part.has_static_map for part in parts),
            inflates=any(part.inflates for part in parts),
            tracks_unknown_space=any(part.tracks_unknown_space for part in parts),
            sources=sources,
        )

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        self.layers: list[Layer] = []
        """The layers inside, in the order in which they write."""
        for name in params.plugins:
            own = params.sections.get(name)
            if own is None:
                raise InputError(
                    f'the layer "{context.name}" lists the plugin "{name}", which has no section with its type; write '
                    f"{name}: {{plugin: ..}} in it, or remove it from plugins",
                    layer=context.name,
                )
            if "track_unknown_space" in type(own).model_fields and "track_unknown_space" not in own.model_fields_set:
                own = own.model_copy(update={"track_unknown_space": context.track_unknown_space})
            inside = replace(context, name=f"{context.name}/{name}")
            self.layers.append(LAYERS.get(own.plugin).cls(own, inside))
        self._grid = Costmap(GridGeometry(1, 1, 1.0))

    def match_size(self, geometry: GridGeometry) -> None:
        """Allocate; set all cells to unknown."""
        self._grid = Costmap(geometry, frame=self.context.frame)
        self._grid.data.fill(UNKNOWN)
        for layer in self.layers:
            layer.match_size(geometry)

    def shift_to(self, geometry: GridGeometry) -> None:
        """Move the cells, and those of the layers."""
        grid = self._grid
        if not self.params.nav2_compatible:
            shift_cells(grid.data, *window_shift(grid.geometry, geometry), UNKNOWN)
        grid.geometry = geometry
        for layer in self.layers:
            layer.shift_to(geometry)

    def set_footprint(self, footprint: Footprint) -> None:
        """Replace the footprint of every layer."""
        for layer in self.layers:
            layer.set_footprint(footprint)

    def observe(self, data: SensorData) -> bool:
        """Pass a message to every layer; return True if one accepts it."""
        accepted = [layer.observe(data) for layer in self.layers]
        return any(accepted)

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Update the layers, each with the bounds of those before it."""
        if not self.params.enabled:
            return bounds
        for layer in self.layers:
            bounds = layer.update_bounds(robot, now, bounds)
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Let the layers write into the grid, then combine it with the master grid."""
        if not self.params.enabled:
            return
        grid = self._grid
        if not self.params.nav2_compatible:
            fill_window(grid.data, *window, UNKNOWN)
        for layer in self.layers:
            layer.update_costs(grid, window)
        combine_as_nav2(self.params.combination_method, master, grid.data, window)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Reset the layers, and the cells of the grid to unknown; return the number of obstacle cells cleared in the layers."""
        clear_region(self._grid.data, self._grid.geometry, region, invert, UNKNOWN)
        return sum(layer.reset(region, invert=invert) for layer in self.layers)

    def is_current(self, now: float) -> bool:
        """Return False if a sensor of a layer has timed out."""
        return all(layer.is_current(now) for layer in self.layers)

    def problems(self) -> Sequence[NavError]:
        """Return those of the layers."""
        return [problem for layer in self.layers for problem in layer.problems()]

    def speed_limit(self, x: float, y: float, max_speed: float) -> float | None:
        """Return the lowest limit of the layers."""
        limits = [layer.speed_limit(x, y, max_speed) for layer in self.layers]
        return min((limit for limit in limits if limit is not None), default=None)

    @property
    def inflation(self) -> Inflation | None:
        """That of the last layer that inflates; None without one."""
        found = [layer.inflation for layer in self.layers if layer.inflation is not None]
        return found[-1] if found and self.params.enabled else None

    @property
    def clearable(self) -> bool:
        """True if one of the layers holds sensor data."""
        return any(layer.clearable for layer in self.layers)

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the cost by the explanations of the layers."""
        del master
        found = [(layer.name, layer.explain(ix, iy, self._grid)) for layer in self.layers]
        texts = [f"{name.rpartition('/')[2]}: {told.text}" for name, told in found if told is not None]
        sources = [told for _, told in found if told is not None and told.source is not None]
        cost = int(self._grid.data[iy, ix])
        return CellExplanation(
            None if cost == UNKNOWN else cost,
            "; ".join(texts) or "no layer",
            sources[-1].source if sources else None,
            sources[-1].stamp if sources else None,
        )
