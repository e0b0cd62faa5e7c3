"""Layers that move_base does not have: range sensors, masks, denoising."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import Footprint, FrameTree, GridGeometry, InputError, Pose2D, RangeReading, Transform2D
from navstack.costmap import (
    BinaryMaskLayer,
    BinaryMaskLayerParams,
    CostmapParams,
    DenoiseLayer,
    DenoiseLayerParams,
    KeepoutMaskLayer,
    LayeredCostmap,
    MaskLayerParams,
    RangeSensorLayer,
    RangeSensorLayerParams,
    SpeedLimit,
    SpeedMaskLayer,
    SpeedMaskLayerParams,
)
from navstack.map_io import load_map
from navstack.plugins import Plugin
from tests.costmap.build import cloud, cloud_source, frames_at, grid_of, inflation, obstacle, rolling, static

HERE = Pose2D(0.0, 0.0)


def sonar(distance: float, stamp: float = 0.0, **changes: Any) -> RangeReading:
    values: dict[str, Any] = {"field_of_view": 0.5, "min_range": 0.1, "max_range": 3.0, "frame": "laser"}
    return RangeReading(distance, stamp=stamp, **(values | changes))


def with_sonar(**changes: Any) -> LayeredCostmap:
    return rolling(Plugin("sonar_layer", RangeSensorLayer, RangeSensorLayerParams(**changes)), track_unknown_space=True)


def test_cone_marks_its_arc_and_clears_the_space_before_it() -> None:
    costmap = with_sonar(phi=2.0)
    for k in range(6):
        costmap.observe(sonar(1.0, 0.0))
        costmap.update_at(HERE, 0.1 * k)
    assert costmap.master.cost_at(1.0, 0.0) == 254
    assert costmap.master.cost_at(0.5, 0.0) == 0
    assert costmap.master.cost_at(1.5, 0.0) == 255
    assert costmap.master.cost_at(0.0, 1.0) == 255
    explained = costmap.explain_cell(1.0, 0.0)
    assert explained.set_by == "sonar_layer"
    assert explained.layers[0].explanation is not None
    assert explained.layers[0].explanation.data["probability"] > 0.8


def test_range_layer_resets_and_becomes_stale() -> None:
    costmap = with_sonar(no_readings_timeout=1.0)
    for _ in range(6):
        costmap.observe(sonar(1.0))
        costmap.update_at(HERE, 0.0)
    marked = int((costmap.master.data == 254).sum())
    assert marked > 0
    assert costmap.is_current(1.0)
    assert not costmap.is_current(1.1)
    assert costmap.reset() == marked
    assert costmap.is_current(5.0)
    costmap.update_at(HERE, 1.1)
    assert (costmap.master.data == 255).all()


def test_readings_of_the_largest_range() -> None:
    for clears, expected in ((False, 254), (True, 0)):
        costmap = with_sonar(clear_on_max_reading=clears)
        for _ in range(6):
            costmap.observe(sonar(1.0))
            costmap.update_at(HERE, 0.0)
        costmap.observe(sonar(3.0))
        costmap.update_at(HERE, 0.1)
        assert costmap.master.cost_at(1.0, 0.0) == expected


def test_invalid_readings_are_rejected() -> None:
    costmap = with_sonar()
    for bad in (sonar(math.nan), sonar(1.0, field_of_view=0.0), sonar(1.0, max_range=math.inf)):
        with pytest.raises(InputError, match="must be numbers"):
            costmap.observe(bad)
    costmap.observe(sonar(1.0, topic="other"))
    costmap.observe(sonar(0.01))  # below min_range
    costmap.update_at(HERE, 0.0)
    assert (costmap.master.data == 255).all()


def masked(layer: Plugin, text: str, *more: Plugin, **mask_changes: Any) -> tuple[LayeredCostmap, Any]:
    costmap = LayeredCostmap(
        "global_costmap",
        CostmapParams(),
        [static(), layer, *more],
        footprint=Footprint.from_radius(0.2),
        frames=FrameTree(),
        static_map=grid_of("....\n..?.\n#..."),
    )
    mask = costmap.layer(layer.name)
    mask.set_mask(grid_of(text, **mask_changes))  # type: ignore[attr-defined]
    return costmap, mask


def test_keepout() -> None:
    layer = Plugin("keepout", KeepoutMaskLayer, MaskLayerParams())
    costmap, mask = masked(layer, "....\n.##.\n?...")
    costmap.update_at(HERE, 0.0)
    assert costmap.master.data[::-1].tolist() == [[0, 0, 0, 0], [0, 254, 254, 0], [254, 0, 0, 0]]
    explained = costmap.explain_cell(1.5, 1.5)
    assert (explained.set_by, explained.source) == ("keepout", "mask")
    # 50 of 100 is half the cost
    half = grid_of("....\n....\n....")
    half.data[0, 1] = 50
    mask.set_mask(half)
    costmap.reset()
    costmap.update_at(HERE, 1.0)
    assert costmap.master.data[0].tolist() == [254, 127, 0, 0]


def test_keepout_in_a_rolling_window() -> None:
    costmap = rolling(Plugin("keepout", KeepoutMaskLayer, MaskLayerParams()), resolution=0.5, frames=_with_map())
    costmap.layer("keepout").set_mask(grid_of("#" * 40, resolution=0.5))  # type: ignore[attr-defined]
    for x in (0.0, 3.0, 7.0):
        costmap.update_at(Pose2D(x, 0.0), 0.0)
        g = costmap.master.geometry
        row = costmap.master.data[round(-g.origin_y / 0.5)]
        expected = [254 if 0.0 <= g.origin_x + (i + 0.5) * 0.5 < 20.0 else 0 for i in range(g.nx)]
        assert row.tolist() == expected


def _with_map() -> FrameTree:
    frames = frames_at()
    frames.set_static("map", "odom", Transform2D())
    return frames


def test_speed_mask() -> None:
    params = SpeedMaskLayerParams(type="percent", base=100.0, multiplier=-1.0)
    costmap, mask = masked(Plugin("speed", SpeedMaskLayer, params), "....\n....\n....")
    grid = grid_of("....\n....\n....")
    grid.data[0] = [0, 30, 100, -1]
    mask.set_mask(grid)
    costmap.update_at(HERE, 0.0)
    assert costmap.master.data[0].tolist() == [254, 0, 0, 0]
    assert [mask.limit_at(x + 0.5, 0.5) for x in range(5)] == [
        None,
        SpeedLimit(70.0, True),
        SpeedLimit(0.0, True),
        None,
        None,
    ]
    assert costmap.limits_speed
    # as in Nav2, a limit of 0 is no limit
    assert [costmap.speed_limit(x + 0.5, 0.5, 2.0) for x in range(5)] == [None, pytest.approx(1.4), None, None, None]
    assert SpeedLimit(70.0, True).of(0.5) == pytest.approx(0.35)
    assert SpeedLimit(0.2, False).of(0.5) == 0.2


def test_binary_mask() -> None:
    """On above the threshold; where the mask is unknown the state stays; outside it is the default."""
    grid = grid_of("......")
    grid.data[0] = [0, 50, 51, -1, 100, 0]
    for default in (False, True):
        params = BinaryMaskLayerParams(default_state=default)
        costmap, mask = masked(Plugin("light", BinaryMaskLayer, params), "....\n....\n....")
        assert isinstance(mask, BinaryMaskLayer) and mask.state is default
        before = costmap.update_at(Pose2D(0.5, 0.5), 0.0)
        mask.set_mask(grid)
        states = []
        for k, x in enumerate((0.5, 1.5, 2.5, 3.5, 4.5, 7.5, 3.5)):
            costmap.update_at(Pose2D(x, 0.5), float(k))
            states.append(mask.state != default)
        assert states == [False, False, True, True, True, False, False]
        assert mask.changes == [(2.0, not default), (5.0, default)]
        assert before is not None and costmap.master.data[0].tolist() == [254, 0, 0, 0]  # it writes nothing
        told = mask.explain(2, 0, costmap.master)
        assert told.text == f"mask value 51: the state is {'off' if default else 'on'}" and told.cost is None


def test_a_binary_mask_scales_its_values_and_can_be_disabled() -> None:
    grid = grid_of("....")
    grid.data[0] = [10, 20, 30, 0]
    params = BinaryMaskLayerParams(base=100.0, multiplier=-2.0, flip_threshold=60.0)
    _, mask = masked(Plugin("light", BinaryMaskLayer, params), "....\n....\n....")
    mask.set_mask(grid)
    assert [mask.state_at(x + 0.5, 0.5) for x in range(4)] == [True, False, False, True]
    off, mask = masked(Plugin("light", BinaryMaskLayer, BinaryMaskLayerParams(enabled=False)), "....\n....\n....")
    mask.set_mask(grid_of("####"))
    off.update_at(Pose2D(0.5, 0.5), 0.0)
    assert mask.state is False


def test_masks_from_files(tmp_path: Path) -> None:
    from navstack.map_io import save_map

    yaml, _ = save_map(grid_of("#..."), tmp_path / "mask.yaml")
    layer = Plugin("keepout", KeepoutMaskLayer, MaskLayerParams(mask=str(yaml)))
    values: dict[str, Any] = {"footprint": Footprint.from_radius(0.2), "frames": FrameTree()}
    params = CostmapParams(width=4.0, height=1.0, resolution=1.0)
    with pytest.raises(InputError, match="has no read_map function"):
        LayeredCostmap("c", params, [layer], **values)
    costmap = LayeredCostmap("c", params, [layer], read_map=load_map, **values)
    costmap.update_at(HERE, 0.0)
    assert costmap.master.data.tolist() == [[254, 0, 0, 0]]


@pytest.mark.parametrize(("connectivity", "kept"), [(8, {(0.525, 1.025), (0.575, 1.075)}), (4, set())])
def test_denoise(connectivity: int, kept: set[tuple[float, float]]) -> None:
    denoise = Plugin("denoise", DenoiseLayer, DenoiseLayerParams(group_connectivity_type=connectivity))
    costmap = rolling(obstacle({"points": cloud_source()}), denoise, inflation())
    pair = [(1.025, 0.025), (1.075, 0.025)]
    diagonal = [(0.525, 1.025), (0.575, 1.075)]
    costmap.observe(cloud([(*p, 0.2) for p in (*pair, *diagonal, (-1.025, 0.025))]))
    costmap.update(0.0)
    lethal = {
        tuple(round(v, 3) for v in costmap.master.geometry.cell_to_world(int(x), int(y)))
        for y, x in np.argwhere(costmap.master.data == 254)
    }
    assert lethal == set(pair) | kept


def test_incremental_denoise_equals_a_full_update() -> None:
    rng = np.random.default_rng(2)
    denoise = Plugin("denoise", DenoiseLayer, DenoiseLayerParams(minimal_group_size=4))
    source = {"points": cloud_source(obstacle_range=10.0)}
    by_steps = rolling(obstacle(source, footprint_clearing_enabled=False), denoise)
    at_once = rolling(obstacle(source, footprint_clearing_enabled=False), denoise)
    for _ in range(30):
        x, y = rng.uniform(-1.5, 1.5, 2)
        points = np.column_stack((x + rng.normal(0, 0.1, 8), y + rng.normal(0, 0.1, 8), np.full(8, 0.2)))
        for costmap in (by_steps, at_once):
            costmap.observe(cloud([tuple(p) for p in points.tolist()]))
        by_steps.update_at(HERE, 0.0)
        at_once.update_at(HERE, 0.0)
        at_once.layer("obstacle_layer")._extra = (
            at_once.layer("obstacle_layer")._extra.including(-9, -9).including(9, 9)
        )  # type: ignore[attr-defined]
        at_once.update_at(HERE, 0.0)
        np.testing.assert_array_equal(by_steps.master.data, at_once.master.data)


def test_cone_outside_the_map() -> None:
    """A reading outside the map changes nothing."""
    costmap = with_sonar()
    away = frames_at(100.0, 100.0)
    costmap.layer("sonar_layer").context.frames._edges.update(away._edges)  # type: ignore[attr-defined]
    costmap.observe(sonar(1.0))
    costmap.update_at(HERE, 0.0)
    assert (costmap.master.data == 255).all()
    assert costmap.master.geometry.shape == GridGeometry(80, 80, 0.05).shape
