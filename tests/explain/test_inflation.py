"""The inflation curve is what the inflation layer writes."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import GridGeometry, InputError, OccupancyGrid
from navstack.explain import find_passages, inflation_curves
from navstack.parameters import load_configuration


@pytest.mark.parametrize("overrides", [[], ["global_costmap/inflation_layer/inflation_radius=0.33"]])
def test_the_curve_is_what_a_costmap_holds(overrides: list[str]) -> None:
    configuration = load_configuration(["turtlebot"], overrides=overrides)
    curve = inflation_curves(configuration, map_resolution=0.05)[0]
    data = np.zeros((41, 81), np.int8)
    data[20, 40] = 100
    row = find_passages(configuration, OccupancyGrid(data, GridGeometry(81, 41, 0.05))).costmap.data[20, 40:]
    assert [cost for _, cost in curve.steps()] == row[: len(curve.cells)].tolist()
    assert curve.cell_costs[-1] == 0 and curve.cell_costs[-2] > 0
    assert curve.at(curve.cells).tolist() == curve.cell_costs.tolist()


def test_the_same_curve_is_shown_once() -> None:
    (both,) = inflation_curves(load_configuration(["turtlebot"]))
    assert both.costmaps == ("global", "local")
    apart = load_configuration(["turtlebot"], overrides=["local_costmap/inflation_layer/cost_scaling_factor=3"])
    assert [curve.costmaps for curve in inflation_curves(apart)] == [("global",), ("local",)]


def test_without_inflation_there_is_no_curve() -> None:
    none = load_configuration(
        ["turtlebot"], overrides=[f"{c}_costmap/inflation_layer/enabled=false" for c in ("global", "local")]
    )
    with pytest.raises(InputError, match="InflationLayer"):
        inflation_curves(none)
