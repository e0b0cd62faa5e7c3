"""Voxels that decay with time, faster in the field of view of a clearing source."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Bounds, Footprint, FrameTree, PointCloud, Pose2D, Transform2D
from navstack.costmap import CostmapParams, DecayingSourceParams, DecayingVoxelLayer, LayeredCostmap
from navstack.costmap.decaying_voxel_layer import DecayingVoxelLayerParams, in_view
from navstack.costmap.observation_buffer import Observation, ObservationBuffer
from navstack.parameters import load_configuration
from navstack.plugins import CheckContext, Plugin

HERE = Pose2D(2.0, 2.0, 0.0)
CELLS, RESOLUTION = 40, 0.1


class Scene:
    """A costmap of 4 m with one decaying layer and one source."""

    def __init__(
        self, *, rolling: bool = False, track: bool = False, source: dict[str, Any] | None = None, **own: Any
    ) -> None:
        given = {
            "clearing": True,
            "sensor_frame": "base_link",
            "model_type": 1,
            "horizontal_fov_angle": 6.29,
            "vertical_fov_angle": 2.0,
        } | (source or {})
        values = {"voxel_decay": 10.0, "update_footprint_enabled": False} | own
        params = DecayingVoxelLayerParams(
            observation_sources="eye", sources={"eye": DecayingSourceParams(**given)}, **values
        )
        self.frames = FrameTree()
        size = CELLS * RESOLUTION
        costmap = CostmapParams(
            global_frame="map",
            width=size,
            height=size,
            resolution=RESOLUTION,
            rolling_window=rolling,
            track_unknown_space=track,
        )
        self.costmap = LayeredCostmap(
            "costmap",
            costmap,
            [Plugin("v", DecayingVoxelLayer, params)],
            footprint=Footprint.from_radius(0.2),
            frames=self.frames,
        )
        layer = self.costmap.layer("v")
        assert isinstance(layer, DecayingVoxelLayer)
        self.layer = layer

    def see(self, now: float, *points: tuple[float, float, float], at: Pose2D = HERE) -> np.ndarray:
        """Receive a cloud and update; without points, only an empty cloud, which is nothing seen."""
        self.frames.set("map", "base_link", Transform2D(*at), now)
        cloud = np.array(points, np.float32).reshape(-1, 3)
        self.costmap.observe(PointCloud(cloud, now, "map", "eye"))
        return self.update(now, at)

    def update(self, now: float, at: Pose2D = HERE) -> np.ndarray:
        self.costmap.update_at(at, now)
        return self.costmap.master.data

    def lethal(self) -> list[tuple[int, int]]:
        return [(ix, iy) for iy, ix in np.argwhere(self.costmap.master.data == 254).tolist()]


def lifetime(scene: Scene, until: float = 40.0, period: float = 0.1) -> float:
    """How long a voxel at the right of the robot stays that was seen once, at the time 0."""
    scene.see(0.0, (3.05, 2.05, 0.5))
    assert scene.lethal() == [(30, 20)]
    for k in range(1, round(until / period)):
        scene.see(k * period)
        if not scene.lethal():
            return k * period
    return math.inf


OUTSIDE = {"horizontal_fov_angle": 0.2, "sensor_frame": "base_link"}
"""A field of view that does not contain (3.05, 2.05) if the robot looks to the left."""


def test_a_voxel_that_is_not_seen_again_lives_for_its_decay() -> None:
    assert lifetime(Scene(voxel_decay=3.0)) == pytest.approx(3.1)
    assert lifetime(Scene(voxel_decay=0.25)) == pytest.approx(0.3)


@pytest.mark.parametrize(("decay", "acceleration"), [(15.0, 15.0), (30.0, 15.0), (0.5, 5.0), (10.0, 1.0)])
def test_in_the_field_of_view_the_decay_is_accelerated(decay: float, acceleration: float) -> None:
    """A voxel that stays keeps its accelerated age, so that the decay grows from update to update."""
    scene = Scene(voxel_decay=decay, source={"decay_acceleration": acceleration})
    found = lifetime(scene, until=decay + 1.0)
    age = elapsed = 0.0
    while True:
        age, elapsed = age + 0.1, elapsed + 0.1
        extra = acceleration * age**3 / 6.0
        if decay - age - extra < 0.0:
            break
        age += extra
    assert found == pytest.approx(elapsed, abs=0.01) and found <= decay


def test_outside_the_field_of_view_nothing_is_accelerated() -> None:
    scene = Scene(voxel_decay=4.0, source=OUTSIDE | {"decay_acceleration": 50.0})
    scene.see(0.0, (3.05, 2.05, 0.5))
    left = Pose2D(2.0, 2.0, math.pi / 2)
    for k in range(1, 40):
        scene.see(0.1 * k, at=left)
        assert scene.lethal() == [(30, 20)]
    scene.see(4.1, at=left)
    assert scene.lethal() == []


def test_models_of_decay() -> None:
    """The exponential one ends by acceleration only, and so does a persistent one."""
    for model in (1, 2, -1):
        assert lifetime(Scene(voxel_decay=0.5, decay_model=model), until=5.0) == math.inf
        assert lifetime(Scene(voxel_decay=0.5, decay_model=model, source={"decay_acceleration": 9.0}), until=5.0) < 1.0


def test_a_voxel_that_is_seen_again_stays() -> None:
    scene = Scene(voxel_decay=1.0)
    for k in range(40):
        scene.see(0.5 * k, (3.05, 2.05, 0.5))
        assert scene.lethal() == [(30, 20)]


@pytest.mark.parametrize(("after_reading", "stays"), [(False, True), (True, False)])
def test_without_a_new_message_the_last_one_counts_unless_it_is_cleared(after_reading: bool, stays: bool) -> None:
    scene = Scene(voxel_decay=1.0, source={"clear_after_reading": after_reading})
    scene.see(0.0, (3.05, 2.05, 0.5))
    for k in range(1, 30):
        scene.update(0.1 * k)
    assert bool(scene.lethal()) == stays


@pytest.mark.parametrize(("threshold", "lethal"), [(0, True), (2, True), (3, True), (4, False)])
def test_a_column_needs_enough_voxels(threshold: int, lethal: bool) -> None:
    scene = Scene(mark_threshold=threshold)
    scene.see(0.0, *((3.02, 2.02, z) for z in (0.1, 0.11, 0.5, 0.9)))  # the first two share a voxel
    assert len(scene.layer.voxels) == 3 and bool(scene.lethal()) == lethal


def test_filters_heights_and_ranges() -> None:
    scene = Scene(source={"filter": "voxel", "voxel_min_points": 2})
    scene.see(0.0, (3.02, 2.02, 0.5), (3.03, 2.02, 0.5), (3.52, 2.02, 0.5))
    assert scene.lethal() == [(30, 20)]
    scene = Scene(source={"min_obstacle_height": 0.2, "max_obstacle_height": 1.0, "obstacle_range": 1.5})
    scene.see(0.0, (3.05, 2.05, 0.1), (3.25, 2.05, 1.1), (2.55, 2.55, 0.6), (2.05, 3.65, 0.6))
    assert scene.lethal() == [(25, 25)]
    scene = Scene(source={"enabled": False})
    scene.see(0.0, (3.05, 2.05, 0.5))
    assert scene.lethal() == []


def test_a_rolling_window_keeps_what_is_inside() -> None:
    scene = Scene(rolling=True)
    scene.see(0.0, (3.05, 2.05, 0.5), (1.05, 2.05, 0.5))
    scene.see(0.5, at=Pose2D(4.0, 2.0))
    g = scene.costmap.master.geometry
    (cell,) = scene.lethal()
    assert g.cell_to_world(*cell) == pytest.approx((3.05, 2.05), abs=0.051) and len(scene.layer.voxels) == 1


def test_footprint_reset_and_explanation() -> None:
    scene = Scene(update_footprint_enabled=True, source={"clear_after_reading": True})
    scene.see(0.0, (2.05, 2.05, 0.5), (3.05, 2.05, 0.5))
    assert scene.lethal() == [(30, 20)]
    told = scene.costmap.explain(30, 20)
    assert told is not None and told.source == "eye" and 'marked by "eye" at 0.000 s' in told.text
    assert scene.layer.reset(Bounds(0.0, 0.0, 2.5, 4.0)) >= 0 and len(scene.layer.voxels) == 1
    assert scene.layer.reset() == 1 and not len(scene.layer.voxels)
    assert scene.update(0.1)[20, 30] == 0


def test_unknown_space() -> None:
    data = Scene(track=True).see(0.0, (3.05, 2.05, 0.5))
    assert data[20, 30] == 254 and data[5, 5] == 255


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_points_in_view_are_those_of_the_definition(seed: int) -> None:
    """Point by point, with plain trigonometry."""
    rng = np.random.default_rng(seed)
    source = DecayingSourceParams(
        min_z=float(rng.uniform(0.0, 1.0)),
        max_z=float(rng.uniform(1.0, 5.0)),
        vertical_fov_angle=float(rng.uniform(0.1, 2.0)),
        vertical_fov_offset=float(rng.uniform(-0.4, 0.4)),
        horizontal_fov_angle=float(rng.choice([rng.uniform(0.1, 3.0), 6.29])),
        model_type=int(rng.integers(0, 2)),
    )
    buffer = ObservationBuffer("b", source, frame="map", frames=FrameTree(), tolerance_s=0.1)
    seen = Observation(buffer, np.empty((0, 3), np.float32), 0, (0.3, -0.2, 0.5))
    seen.yaw = float(rng.uniform(-3.0, 3.0))
    places = rng.uniform(-4.0, 4.0, (50, 3))
    for place, found in zip(places, in_view(places, seen).tolist(), strict=True):
        at = Transform2D(seen.x, seen.y, seen.yaw).inverse().apply(Pose2D(place[0], place[1]))
        up, bearing = place[2] - seen.z, math.atan2(at.y, at.x)
        half = 0.5 * source.vertical_fov_angle
        if source.model_type == 0:
            inside = source.min_z <= at.x <= source.max_z and abs(math.atan2(up, at.x)) <= half
        else:
            away = math.hypot(at.x, at.y)
            middle = away * math.tan(source.vertical_fov_offset)
            inside = source.min_z <= away <= source.max_z and abs(up - middle) <= away * math.tan(half)
        around = source.model_type == 1 and source.horizontal_fov_angle > 6.27
        assert found == (inside and (around or abs(bearing) <= 0.5 * source.horizontal_fov_angle))


def test_checks_and_a_file() -> None:
    codes = {issue.rule for issue in DecayingVoxelLayerParams().check(_NO_CONTEXT)}
    assert codes == {"voxels-vanish"}
    persistent = DecayingVoxelLayerParams(decay_model=-1, voxel_decay=5.0)
    assert [issue.rule for issue in persistent.check(_NO_CONTEXT)] == ["voxels-never-decay"]
    layers = [{"name": "stvl", "type": "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer"}]
    stretch = {
        "voxel_decay": 15.0,
        "decay_model": 0,
        "voxel_size": 0.05,
        "mark_threshold": 0,
        "update_footprint_enabled": True,
        "publish_voxel_map": True,
        "observation_sources": "pointcloud",
        "pointcloud": {"topic": "/camera/depth/color/points", "clearing": True, "filter": "voxel", "max_z": 7.0},
    }
    made = load_configuration(["turtlebot", {"local_costmap": {"plugins": layers, "stvl": stretch}}]).local_costmap
    layer = made.layers[0]
    assert layer.cls is DecayingVoxelLayer and layer.params.sources["pointcloud"].max_z == 7.0
    assert layer.cls.traits(layer.params).fed_by_sensors


_NO_CONTEXT: CheckContext = None  # type: ignore[assignment]
