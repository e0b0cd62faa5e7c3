"""Contract of every registered layer, including the layers of installed third-party packages."""

from __future__ import annotations

import numpy as np
import pytest

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
from navstack.core.parameters import ParamModel
from navstack.interfaces import Layer, LayerContext
from navstack.plugins import LAYERS, PluginEntry

ENTRIES = list(LAYERS)
GEOMETRY = GridGeometry(30, 20, 0.1, -1.0, -1.0)


def made(entry: PluginEntry[Layer], *, rolling: bool = False) -> Layer:
    frames = FrameTree()
    frames.set_static("map", "odom", Transform2D())
    rng = np.random.default_rng(4)
    occupancy = rng.choice(np.array([0, 0, 0, 100, -1], np.int8), (20, 30))
    context = LayerContext(
        name="under_test",
        frame="map",
        frames=frames,
        footprint=Footprint.from_radius(0.15),
        rolling_window=rolling,
        static_map=OccupancyGrid(occupancy, GEOMETRY),
    )
    layer = entry.cls(entry.cls.Params(), context)
    layer.match_size(GEOMETRY)
    return layer


def noise() -> np.ndarray:
    return np.random.default_rng(9).choice(np.array([0, 0, 0, 30, 253, 254, 255], np.uint8), (20, 30))


@pytest.fixture(params=ENTRIES, ids=lambda e: e.name)
def entry(request: pytest.FixtureRequest) -> PluginEntry[Layer]:
    return request.param


def test_default_parameters_construct_a_layer(entry: PluginEntry[Layer]) -> None:
    assert issubclass(entry.cls.Params, ParamModel)
    layer = made(entry)
    assert layer.name == "under_test"
    assert layer.is_current(0.0)
    assert isinstance(layer.clearable, bool)
    assert entry.cls.__doc__
    for name, field in entry.cls.Params.model_fields.items():
        assert field.description, f"{name} has no description"


@pytest.mark.parametrize("given", [Bounds(), Bounds(0.0, 0.0, 0.5, 0.5), Bounds(-99.0, -99.0, 99.0, 99.0)])
def test_bounds_only_grow(entry: PluginEntry[Layer], given: Bounds) -> None:
    layer = made(entry)
    for step in range(3):
        grown = layer.update_bounds(Pose2D(0.1 * step, 0.0, 0.3), float(step), given)
        assert given.union(grown) == grown


@pytest.mark.parametrize(
    "window", [Window(0, 0, 30, 20), Window(5, 4, 12, 9), Window(29, 19, 30, 20), Window(0, 0, 1, 20)]
)
def test_costs_are_written_inside_the_window_only(entry: PluginEntry[Layer], window: Window) -> None:
    layer = made(entry)
    layer.update_bounds(Pose2D(0.0, 0.0), 0.0, Bounds())
    master = Costmap(GEOMETRY, noise())
    layer.update_costs(master, window)
    outside = np.ones(GEOMETRY.shape, bool)
    outside[window.slices] = False
    np.testing.assert_array_equal(master.data[outside], noise()[outside])


def test_update_is_deterministic_and_idempotent(entry: PluginEntry[Layer]) -> None:
    results = []
    for _ in range(2):
        layer = made(entry)
        layer.update_bounds(Pose2D(0.2, 0.1), 0.0, Bounds())
        master = Costmap(GEOMETRY, noise())
        layer.update_costs(master, GEOMETRY.window)
        results.append(master.data)
        # a second write changes nothing
        layer.update_costs(master, GEOMETRY.window)
        np.testing.assert_array_equal(master.data, results[-1])
    np.testing.assert_array_equal(*results)


def test_disabled_layers_do_nothing(entry: PluginEntry[Layer]) -> None:
    if "enabled" not in entry.cls.Params.model_fields:
        return
    layer = made(entry)
    layer.params = layer.params.model_copy(update={"enabled": False})
    given = Bounds(0.0, 0.0, 0.5, 0.5)
    assert layer.update_bounds(Pose2D(0.0, 0.0), 0.0, given) == given
    master = Costmap(GEOMETRY, noise())
    layer.update_costs(master, GEOMETRY.window)
    np.testing.assert_array_equal(master.data, noise())


def test_reset_and_rolling(entry: PluginEntry[Layer]) -> None:
    layer = made(entry, rolling=True)
    layer.update_bounds(Pose2D(0.0, 0.0), 0.0, Bounds())
    for geometry in (GEOMETRY.moved_to(-0.5, -1.2), GEOMETRY.moved_to(100.0, 100.0)):
        layer.shift_to(geometry)
        master = Costmap(geometry, noise())
        layer.update_bounds(Pose2D(0.0, 0.0), 1.0, Bounds())
        layer.update_costs(master, geometry.window)
    for region, invert in ((None, False), (Bounds(0, 0, 1, 1), False), (Bounds(0, 0, 1, 1), True), (Bounds(), True)):
        assert layer.reset(region, invert=invert) == 0
    found = layer.explain(3, 4, Costmap(GEOMETRY.moved_to(100.0, 100.0)))
    assert found is None or found.text
