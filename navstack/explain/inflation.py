"""Inflation cost against distance, for the costmaps of a parameter set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError
from navstack.costmap import InflationLayer, inflation_cost
from navstack.parameters import Configuration, CostmapConfiguration


@dataclass(frozen=True, slots=True)
class InflationCurve:
    """Cost against distance in one costmap, or in both if they agree. Lengths in meters."""

    costmaps: tuple[str, ...]
    """`global`, `local` or both."""
    resolution: float
    inscribed_radius: float
    """With padding."""
    circumscribed_radius: float
    inflation_radius: float
    cost_scaling_factor: float
    cells: NDArray[np.float64]
    """(k,) distances of whole cells, from 0 to the first cell beyond the inflation radius."""
    cell_costs: NDArray[np.uint8]
    """(k,) costs that the layer writes at these distances."""

    def at(self, distances: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Costs at any distances (m), by the formula of the layer."""
        costs = inflation_cost(distances, self.inscribed_radius, self.cost_scaling_factor)
        # the layer inflates whole cells
        costs[distances > self.cells[-2] + 1e-9 if len(self.cells) > 1 else distances > 0.0] = 0
        return costs

    def as_dict(self) -> dict[str, Any]:
        """Return the curve for JSON."""
        return {
            "costmaps": list(self.costmaps),
            "resolution_m": self.resolution,
            "inscribed_radius_m": self.inscribed_radius,
            "circumscribed_radius_m": self.circumscribed_radius,
            "inflation_radius_m": self.inflation_radius,
            "cost_scaling_factor": self.cost_scaling_factor,
            "curve": [{"cells": i, "distance_m": d, "cost": c} for i, (d, c) in enumerate(self.steps())],
        }

    def steps(self) -> list[tuple[float, int]]:
        """Return distance (m) and cost for every whole number of cells."""
        return [(round(float(d), 6), int(c)) for d, c in zip(self.cells, self.cell_costs)]


def inflation_curves(configuration: Configuration, *, map_resolution: float | None = None) -> list[InflationCurve]:
    """Return the curves of the global and the local costmap; one curve for both if they are equal.

    `map_resolution` (m) replaces the resolution of a costmap that takes it from its map. Raises InputError if neither
    costmap has an inflation layer.
    """
    curves: list[InflationCurve] = []
    for name, chosen in (("global", configuration.global_costmap), ("local", configuration.local_costmap)):
        curve = _curve(name, chosen, map_resolution)
        if curve is None:
            continue
        twin = next((i for i, other in enumerate(curves) if _same(other, curve)), None)
        if twin is None:
            curves.append(curve)
        else:
            curves[twin] = InflationCurve((*curves[twin].costmaps, name), *_values(curve))
    if not curves:
        raise InputError(
            "neither costmap has an enabled inflation layer; add a layer of type costmap_2d::InflationLayer to its plugins"
        )
    return curves


def _curve(name: str, chosen: CostmapConfiguration, map_resolution: float | None) -> InflationCurve | None:
    params: Any = next(
        (x.params for x in chosen.layers if issubclass(x.cls, InflationLayer) and x.params.enabled), None
    )
    if params is None:
        return None
    resolution = chosen.params.resolution
    if map_resolution is not None and not chosen.params.rolling_window:
        resolution = map_resolution
    reach = int(np.ceil(params.inflation_radius / resolution))
    cells: NDArray[np.float64] = (np.arange(reach + 2) * resolution).astype(np.float64)
    costs = inflation_cost(cells, chosen.footprint.inscribed_radius, params.cost_scaling_factor)
    costs[reach + 1 :] = 0
    return InflationCurve(
        (name,),
        resolution,
        chosen.footprint.inscribed_radius,
        chosen.footprint.circumscribed_radius,
        params.inflation_radius,
        params.cost_scaling_factor,
        cells,
        costs,
    )


def _values(curve: InflationCurve) -> tuple[Any, ...]:
    return (
        curve.resolution,
        curve.inscribed_radius,
        curve.circumscribed_radius,
        curve.inflation_radius,
        curve.cost_scaling_factor,
        curve.cells,
        curve.cell_costs,
    )


def _same(a: InflationCurve, b: InflationCurve) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(_values(a), _values(b)))
