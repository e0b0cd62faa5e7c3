"""Costmap layers compared with Nav2's, step by step: the whole master grid, the update window, and the origin are equal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from navstack.core import Footprint, FrameTree, GridGeometry, OccupancyGrid, Pose2D, Transform2D
from navstack.costmap import (
    CostmapParams,
    LayeredCostmap,
    Nav2ObservationSourceParams,
    ObservationBuffer,
    ObstacleLayer,
    PluginContainerLayer,
)
from navstack.costmap.observation_buffer import Observation
from navstack.plugins import LAYERS, Layer, ParamModel, Plugin
from tests.golden.nav2_w3 import arrays, jobs, needs_data, split

pytestmark = needs_data
JOBS = jobs("layers")


def params_of(
    cls: type[Layer], own: dict[str, Any], common: dict[str, Any], source: Nav2ObservationSourceParams
) -> ParamModel:
    """Parameters of a layer: its own, those of the costmap that it reads, Nav2's defects, and one source of observations."""
    model = cls.Params
    values = {key: value for key, value in common.items() if key in model.FROM_PARENT} | own
    if "nav2_compatible" in model.model_fields:
        values["nav2_compatible"] = True
    if issubclass(cls, ObstacleLayer):
        values |= {"observation_sources": "points", "sources": {"points": source}}
    return model(**values)


def nested(params: dict[str, Any], name: str) -> dict[str, Any]:
    return {key[len(name) + 1 :]: value for key, value in params.items() if key.startswith(f"{name}.")}


def plugin_of(
    name: str, cls: type[Layer], params: dict[str, Any], common: dict[str, Any], source: Any
) -> Plugin[Layer]:
    own = nested(params, name)
    if issubclass(cls, PluginContainerLayer):
        sections: dict[str, Any] = {}
        for inner in own["plugins"]:
            plugin = own[f"{inner}.plugin"]
            inside = {key: value for key, value in nested(own, inner).items() if key != "plugin"}
            read = params_of(LAYERS.get(plugin).cls, inside, common, source)
            model = cls.Params.child_models({"plugins": [inner], inner: {"plugin": plugin}})[inner]
            sections[inner] = model.model_validate({**dict(read), "plugin": plugin})
        own = {key: value for key, value in own.items() if "." not in key} | {"sections": sections}
    return Plugin(name, cls, params_of(cls, own, common, source))


def source_of(job: dict[str, Any]) -> dict[str, Any]:
    """Parameters of the source of observations."""
    names = ("obstacle_max_range", "obstacle_min_range", "raytrace_max_range", "raytrace_min_range")
    ranges = {name: float(value) for name, value in zip(names, job["ranges"], strict=True)}
    return {"data_type": "PointCloud2", "clearing": True, **ranges}


def layers_of(job: dict[str, Any]) -> list[Plugin[Layer]]:
    """The layers with the parameters of a job."""
    params = job["params"]
    common = {key: value for key, value in params.items() if "." not in key}
    source = Nav2ObservationSourceParams(**source_of(job))
    return [
        plugin_of(name, LAYERS.get(f"nav2_costmap_2d::{kind}").cls, params, common, source)
        for name, kind in job["layers"]
    ]


def case_of(name: str) -> dict[str, np.ndarray]:
    """The arrays of a job."""
    return {key.split("/", 1)[1]: value for key, value in arrays("layers").items() if key.startswith(f"{name}/")}


def costmap_of(job: dict[str, Any], case: dict[str, np.ndarray], layers: list[Plugin[Layer]]) -> LayeredCostmap:
    nx, ny, resolution, x, y = job["grid"]
    static_map = None
    if "in_map" in case:
        info, cells = case["in_map_info"].tolist(), np.ascontiguousarray(case["in_map"])
        of_message = float(np.float32(info[2]))  # decides in which cell a point on an edge is
        rows, columns = cells.shape
        static_map = OccupancyGrid(cells, GridGeometry(columns, rows, of_message, info[0], info[1]))
    frames = FrameTree()
    frames.set_static("map", "base_link", Transform2D())
    return LayeredCostmap(
        "costmap",
        CostmapParams(
            global_frame="map",
            rolling_window=job["rolling"],
            width=nx * resolution,
            height=ny * resolution,
            resolution=resolution,
            origin_x=x,
            origin_y=y,
            track_unknown_space=job["params"]["track_unknown_space"],
        ),
        layers,
        footprint=Footprint(case["in_footprint"]),
        frames=frames,
        static_map=static_map,
    )


def buffers_of(layers: Any) -> list[ObservationBuffer]:
    found: list[ObservationBuffer] = []
    for layer in layers:
        found += layer.buffers if isinstance(layer, ObstacleLayer) else []
        found += buffers_of(layer.layers) if isinstance(layer, PluginContainerLayer) else []
    return found


def assert_equal_steps(name: str, layers: list[Plugin[Layer]]) -> None:
    """Compare every step of a job with Nav2's."""
    job, case = JOBS[name], case_of(name)
    costmap = costmap_of(job, case, layers)
    buffers = buffers_of(costmap.layers)
    clouds = split(case["in_points"].astype(np.float32), case["in_counts"])
    window = None
    for step, (x, y, yaw) in enumerate(case["in_poses"].tolist()):
        for buffer in buffers:
            points = np.ascontiguousarray(clouds[step])
            buffer.observations = [Observation(buffer, points, len(points), (x, y, job["sensor_z"]))]
        updated = costmap.update_at(Pose2D(x, y, yaw), float(step))
        # Nav2 keeps the window of the last update that changed anything
        window = window if updated.is_empty else updated
        assert window is not None
        g = costmap.master.geometry
        assert (g.origin_x, g.origin_y) == tuple(case["origin"][step].tolist()), f"origin of step {step}"
        assert [window.x0, window.x1, window.y0, window.y1] == case["bounds"][step].tolist(), f"window of step {step}"
        np.testing.assert_array_equal(costmap.master.data, case["master"][step], err_msg=f"step {step}")


@pytest.mark.parametrize("name", sorted(JOBS))
def test_layers(name: str) -> None:
    assert_equal_steps(name, layers_of(JOBS[name]))
