"""The contract of costmap layers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import (
    Bounds,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    OccupancyGrid,
    Pose2D,
    Transform2D,
    Window,
)
from navstack.plugins import Layer, LayerContext
from navstack.testing.base import Contract, contract_of

GEOMETRY = GridGeometry(30, 20, 0.1, -1.0, -1.0)
WINDOWS = [Window(0, 0, 30, 20), Window(5, 4, 12, 9), Window(29, 19, 30, 20), Window(0, 0, 1, 20)]
BOUNDS = [Bounds(), Bounds(0.0, 0.0, 0.5, 0.5), Bounds(-99.0, -99.0, 99.0, 99.0)]


def random_costs() -> NDArray[np.uint8]:
    """A master grid with all kinds of costs."""
    return np.random.default_rng(9).choice(np.array([0, 0, 0, 30, 253, 254, 255], np.uint8), GEOMETRY.shape)


class LayerContract(Contract):
    """What every layer must do."""

    @classmethod
    def make(cls, *, rolling: bool = False, **values: Any) -> Layer:
        """The layer in a costmap of 3 m x 2 m with a random static map."""
        frames = FrameTree()
        frames.set_static("map", "odom", Transform2D())
        occupancy = np.random.default_rng(4).choice(np.array([0, 0, 0, 100, -1], np.int8), GEOMETRY.shape)
        context = LayerContext(
            name="under_test",
            frame="map",
            frames=frames,
            footprint=Footprint.from_radius(0.15),
            rolling_window=rolling,
            static_map=OccupancyGrid(occupancy, GEOMETRY),
        )
        layer: Layer = cls.plugin(cls.params(**values), context)
        layer.match_size(GEOMETRY)
        return layer

    def test_it_is_current_without_sensors(self) -> None:
        """A new layer does not block the robot."""
        layer = self.make()
        assert layer.name == "under_test"
        assert layer.is_current(0.0)
        assert isinstance(layer.clearable, bool)

    @pytest.mark.parametrize("given", BOUNDS)
    def test_bounds_only_grow(self, given: Bounds) -> None:
        """`update_bounds` returns a box that contains the one it was given."""
        layer = self.make()
        for step in range(3):
            grown = layer.update_bounds(Pose2D(0.1 * step, 0.0, 0.3), float(step), given)
            assert given.union(grown) == grown

    @pytest.mark.parametrize("window", WINDOWS)
    def test_costs_are_written_inside_the_window_only(self, window: Window) -> None:
        """`update_costs` leaves the rest of the master grid unchanged."""
        layer = self.make()
        layer.update_bounds(Pose2D(0.0, 0.0), 0.0, Bounds())
        master = Costmap(GEOMETRY, random_costs())
        layer.update_costs(master, window)
        outside = np.ones(GEOMETRY.shape, bool)
        outside[window.slices] = False
        np.testing.assert_array_equal(master.data[outside], random_costs()[outside])

    def test_it_is_reproducible(self) -> None:
        """The same input gives the same costs; writing twice changes nothing."""
        results: list[NDArray[np.uint8]] = []
        for _ in range(2):
            layer = self.make()
            layer.update_bounds(Pose2D(0.2, 0.1), 0.0, Bounds())
            master = Costmap(GEOMETRY, random_costs())
            layer.update_costs(master, GEOMETRY.window)
            results.append(master.data.copy())
            layer.update_costs(master, GEOMETRY.window)
            np.testing.assert_array_equal(master.data, results[-1])
        np.testing.assert_array_equal(results[0], results[1])

    def test_disabled(self) -> None:
        """With `enabled: false` (if the layer has it) nothing changes."""
        if "enabled" not in self.plugin.Params.model_fields:
            return
        layer = self.make()
        layer.params = layer.params.model_copy(update={"enabled": False})
        given = Bounds(0.0, 0.0, 0.5, 0.5)
        assert layer.update_bounds(Pose2D(0.0, 0.0), 0.0, given) == given
        master = Costmap(GEOMETRY, random_costs())
        layer.update_costs(master, GEOMETRY.window)
        np.testing.assert_array_equal(master.data, random_costs())

    def test_rolling_window_and_reset(self) -> None:
        """The window may move by any number of cells; a reset without observations clears nothing."""
        layer = self.make(rolling=True)
        layer.update_bounds(Pose2D(0.0, 0.0), 0.0, Bounds())
        for geometry in (GEOMETRY.moved_to(-0.5, -1.2), GEOMETRY.moved_to(100.0, 100.0)):
            layer.shift_to(geometry)
            master = Costmap(geometry, random_costs())
            layer.update_bounds(Pose2D(0.0, 0.0), 1.0, Bounds())
            layer.update_costs(master, geometry.window)
        box = Bounds(0.0, 0.0, 1.0, 1.0)
        for region, invert in ((None, False), (box, False), (box, True), (Bounds(), True)):
            assert layer.reset(region, invert=invert) == 0

    def test_explanations_have_a_text(self) -> None:
        """`explain` returns None or an explanation with a text."""
        layer = self.make()
        layer.update_bounds(Pose2D(0.0, 0.0), 0.0, Bounds())
        explanation = layer.explain(3, 4, Costmap(GEOMETRY, random_costs()))
        assert explanation is None or explanation.text


def layer_contract(plugin: type[Layer], **values: Any) -> type[LayerContract]:
    """The suite for a layer; `values` are parameters that differ from the defaults."""
    return contract_of(LayerContract, plugin, values)
