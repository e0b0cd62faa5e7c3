"""costmap_2d::InflationLayer: costs that decrease with the distance to the nearest obstacle (plugins/inflation_layer.cpp).

ROS propagates the nearest obstacle over the 4-neighborhood, which misses it for a few cells per map. Here the distance is the
exact Euclidean one (Felzenszwalb & Huttenlocher, "Distance Transforms of Sampled Functions", 2012: one pass along the columns,
then one along the rows; both limited to the inflation radius).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    Bounds,
    Costmap,
    Footprint,
    GridGeometry,
    Pose2D,
    Window,
    describe_cost,
    kernel,
)
from navstack.costmap.windows import EVERYWHERE
from navstack.plugins import (
    LAYERS,
    CellExplanation,
    CheckContext,
    Inflation,
    Issue,
    Layer,
    LayerContext,
    LayerTraits,
    ParamModel,
    param,
)

# ----------------------------------------------------------------------------------------------------------------------
# Inflation: costs by the exact distance to the nearest lethal cell.


# pyright: basic


@kernel
def count_up(lethal_row, counts, radius, out):
    """Advance one row: update the cells to the last lethal cell of each column, at most radius + 1; copy them to `out`."""
    for x in range(counts.size):
        further = np.uint8(min(counts[x], radius) + np.uint8(1))
        further = np.uint8(0) if lethal_row[x] == np.uint8(254) else further
        counts[x] = further
        out[x] = further


@kernel
def keep_nearer(distances, others):
    """Write the smaller of both into `distances`, cell by cell."""
    for x in range(others.size):
        distances[x] = min(distances[x], others[x])


@kernel
def keep_larger(costs, others):
    """Write the larger of both into `costs`, cell by cell."""
    for x in range(others.size):
        costs[x] = max(costs[x], others[x])


@kernel
def set_bytes(row, value):
    """Set all cells of a row."""
    for x in range(row.size):
        row[x] = value


@kernel
def raise_costs(row, costs, unknown_from):
    """Write the larger of both into `row`; overwrite unknown cells with costs of at least `unknown_from`."""
    for x in range(row.size):
        old, cost = row[x], costs[x]
        kept = np.uint8(cost if cost >= unknown_from else np.uint8(255))
        row[x] = kept if old == np.uint8(255) else max(old, cost)


@kernel
def inflate(master, x0, y0, x1, y1, ahead, behind, below, rows, near, near_words, unknown_from):
    """Raise the costs of the window to the inflation cost of the nearest lethal cell, by its exact Euclidean distance.

    `ahead` (radius + 1, n): cost at `row` cells across and 1 + `column` cells along, 0 beyond the radius; column n - 1: the
    cost at 0 cells along. `behind`: `ahead` mirrored. Unknown cells are overwritten with costs of at least `unknown_from`.
    Scratch: `below` (>= y1 - y0, >= nx), `rows` (2, >= nx + 2 n + 16), `near` (a multiple of 8, >= nx + 24), of
    which `near_words` is the view as uint64.

    The rows of the window are processed from the top down. `below` is the distance down to the nearest lethal cell of each
    column, `counts` the distance up, `near` the smaller of the two. A column affects the cells to its right only if its right
    neighbor is farther from an obstacle (left likewise). So few columns are propagated along the row, and in most of the row
    nothing is near. The loops over whole rows are functions of their own because they vectorize there.
    """
    radius = ahead.shape[0] - 1
    ny, nx = master.shape
    left, right = max(0, x0 - radius), min(nx, x1 + radius)
    bottom, top = max(0, y0 - radius), min(ny, y1 + radius)
    width = right - left
    reach = ahead.shape[1] - 1
    largest = np.uint8(radius)
    far = np.uint8(radius + 1)
    counts = rows[0, 0:width]
    set_bytes(counts, far)
    for y in range(bottom, y1):
        count_up(master[y, left:right], counts, largest, below[max(y - y0, 0), 0:width])
    # eight cells at a time: one word of `near` shows whether anything is near; one word of margin on both sides
    words = (width + 7) // 8 + 2
    set_bytes(near[0 : 8 * words], far)
    nothing = near_words[0]
    near_row = near[8 : 8 + width]
    margin = reach + 8
    costs = rows[1, 0 : width + 2 * margin]
    set_bytes(costs, np.uint8(0))
    set_bytes(counts, far)
    for y in range(top - 1, y0 - 1, -1):
        row = master[y, left:right]
        count_up(row, counts, largest, near_row)
        if y >= y1:
            continue
        keep_nearer(near_row, below[y - y0, 0:width])
        first, last = width, -1
        for word in range(1, words - 1):
            if near_words[word] == nothing:
                continue
            for at in range(8 * word, 8 * word + 8):
                d = near[at]
                if d == far:
                    continue
                first, last = min(first, at - 8), at - 8
                here = at - 8 + margin
                costs[here] = max(costs[here], ahead[d, reach])
                if near[at + 1] > d:
                    keep_larger(costs[here + 1 : here + 1 + reach], ahead[d, 0:reach])
                if near[at - 1] > d:
                    keep_larger(costs[here - reach : here], behind[d, 1 : reach + 1])
        if last >= 0:
            first, last = max(x0 - left, first - radius), min(x1 - left, last + radius + 1)
            if first < last:
                raise_costs(row[first:last], costs[margin + first : margin + last], unknown_from)
            set_bytes(costs, np.uint8(0))


MAX_CELLS = 253
"""Largest inflation radius in cells of the kernel, which stores distances along a column in a byte."""


CORNER_COST = 25
"""Cost at the circumscribed radius under which plans ignore corners: a tenth of that at the inscribed radius."""


class InflationLayerParams(ParamModel):
    """`<costmap>/inflation_layer:`."""

    enabled: bool = param(True, "apply this layer")
    cost_scaling_factor: float = param(10.0, "rate of the cost's exponential decay", unit="1/m", ge=0.0, le=100.0)
    inflation_radius: float = param(
        0.55, "cells farther from every obstacle are not inflated", unit="m", ge=0.0, le=50.0
    )
    inflate_unknown: bool = param(False, "inflate unknown cells too")

    CLAMPED: ClassVar[frozenset[str]] = frozenset({"cost_scaling_factor", "inflation_radius"})
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset({"cost_scaling_factor", "inflation_radius"})

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what makes the inflated costs misleading: a small radius, no gradient, obstacles added afterwards."""
        if self.enabled:
            yield from self._check_radius(context)
            yield from self._check_corners(context)
        yield from self._check_gradient(context)
        late = context.costmap.layers_after(context.name)
        if any(layer.traits.inflates for layer in late):
            return
        for layer in late:
            if layer.traits.enabled:
                message = (
                    f"{layer.name} is listed after {context.name} in the plugins of {context.costmap.name}, so the obstacles "
                    f"that it marks are not inflated; list {context.name} last"
                )
                yield Issue("warning", "inflation-not-last", (f"/{context.costmap.name}/plugins",), message)
                return

    def _check_radius(self, context: CheckContext) -> Iterator[Issue]:
        footprint = context.costmap.footprint
        inscribed, circumscribed = footprint.inscribed_radius, footprint.circumscribed_radius
        if self.inflation_radius >= circumscribed:
            return
        least = f"{math.ceil(circumscribed * 100.0) / 100.0:g}"
        effect = (
            "cut through the edges of walls"
            if self.inflation_radius < inscribed
            else "pass where the robot's corners collide"
        )
        message = (
            f"inflation_radius = {self.inflation_radius:g} m is less than the circumscribed radius of the footprint, "
            f"{circumscribed:.3g} m (inscribed {inscribed:.3g} m), so plans may {effect}; set it to {least} m or more"
        )
        yield Issue("warning", "inflation-under-radius", ("inflation_radius",), message, least)

    def _check_corners(self, context: CheckContext) -> Iterator[Issue]:
        """Yield that plans pass closer to obstacles than the corners of a long robot reach when it turns."""
        footprint = context.costmap.footprint
        inscribed, circumscribed = footprint.inscribed_radius, footprint.circumscribed_radius
        if context.costmap.name != context.global_costmap.name or self.inflation_radius < circumscribed:
            return
        cost = int(inflation_cost(circumscribed, inscribed, self.cost_scaling_factor))
        if cost >= CORNER_COST:
            return
        better = f"{math.log(2.0) / (circumscribed - inscribed):.2g}"
        message = (
            f"cost_scaling_factor = {self.cost_scaling_factor:g}: where a corner still reaches an obstacle as the robot turns "
            f"({circumscribed:.2f} m from its center), the cost is {cost} of 252, so plans pass closer than that (down to "
            f"{inscribed:.2f} m) and the robot cannot turn there; set it to {better}"
        )
        yield Issue("info", "steep-inflation", ("cost_scaling_factor",), message, better)

    def _check_gradient(self, context: CheckContext) -> Iterator[Issue]:
        factor, resolution = self.cost_scaling_factor, context.costmap.resolution
        reach = math.log(INSCRIBED - 1) / factor if factor > 0.0 else math.inf
        if factor == 0.0:
            effect = "gives every inflated cell the same cost"
        elif reach < resolution:
            effect = f"lets the cost fall to 0 within {reach:.2g} m, less than a cell ({resolution:g} m)"
        else:
            return
        message = f"cost_scaling_factor = {factor:g} {effect}, so plans keep no distance from obstacles; set it between 3 and 10"
        yield Issue("warning", "no-gradient", ("cost_scaling_factor",), message)


def inflation_cost(
    distance: NDArray[np.float64] | float, inscribed_radius: float, cost_scaling_factor: float
) -> NDArray[np.uint8]:
    """Return the cost at a distance (m) from a lethal cell: 254 at 0, 253 up to the inscribed radius, beyond it
    trunc(252 * exp(-cost_scaling_factor * (distance - inscribed_radius))).
    """
    d = np.asarray(distance, np.float64)
    decay = np.exp(np.minimum(-cost_scaling_factor * (d - inscribed_radius), 0.0))
    cost = np.where(d <= inscribed_radius, float(INSCRIBED), np.floor((INSCRIBED - 1) * decay))
    return np.where(d == 0.0, float(LETHAL), cost).astype(np.uint8)


def nearest_lethal(costs: NDArray[np.uint8], ix: int, iy: int, radius: int) -> tuple[int, int] | None:
    """Return the lethal cell nearest to (ix, iy) within `radius` cells. Ties go to the lowest row, then column."""
    x0, y0 = max(0, ix - radius), max(0, iy - radius)
    rows, columns = np.nonzero(costs[y0 : iy + radius + 1, x0 : ix + radius + 1] == LETHAL)
    if not len(rows):
        return None
    squared = (rows + y0 - iy) ** 2 + (columns + x0 - ix) ** 2
    best = int(squared.argmin())
    return (int(columns[best]) + x0, int(rows[best]) + y0) if squared[best] <= radius * radius else None


@LAYERS.register("inflation", aliases=("costmap_2d/InflationLayer",))
class InflationLayer(Layer):
    """Costs around obstacles, higher the nearer, which keep the robot's center away. 1 byte per cell."""

    Params: ClassVar[type[ParamModel]] = InflationLayerParams
    LIVE: ClassVar[frozenset[str]] = frozenset(
        {"enabled", "cost_scaling_factor", "inflation_radius", "inflate_unknown"}
    )

    @classmethod
    def traits(cls, params: InflationLayerParams) -> LayerTraits:
        """Inflation; no sensors."""
        return LayerTraits(enabled=params.enabled, fed_by_sensors=False, inflates=True)

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        self.inscribed_radius = context.footprint.inscribed_radius
        self.radius_cells = 0
        self._geometry: GridGeometry | None = None
        self._ahead = self._behind = np.zeros((1, 1), np.uint8)
        self._unknown_from = np.uint8(1 if params.inflate_unknown else INSCRIBED)
        self._below = self._rows = np.zeros((1, 1), np.uint8)
        self._margin = 0.0
        self._last = Bounds()
        self._everything = True
        self._around_unknown = False

    def match_size(self, geometry: GridGeometry) -> None:
        """Allocate; tabulate the costs."""
        self._geometry = geometry
        self._below = np.zeros(geometry.shape, np.uint8)
        self._inflate = inflate.compiled()
        self._tabulate()

    def set_footprint(self, footprint: Footprint) -> None:
        """Replace the inscribed radius; inflate everything again."""
        self.inscribed_radius = footprint.inscribed_radius
        self._tabulate()

    def set_params(self, params: Any) -> None:
        """Replace the parameters; inflate everything again."""
        self.params = params
        self._unknown_from = np.uint8(1 if params.inflate_unknown else INSCRIBED)
        self._tabulate()

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Grow the bounds of this and of the last update by the inflation radius."""
        del robot, now
        if not self.params.enabled:
            return bounds
        last, self._last = self._last, bounds
        if self._everything:
            self._everything = False
            return EVERYWHERE
        changed = last.union(bounds)
        return changed if changed.is_empty else changed.grown(self._margin)

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Raise the costs around every lethal cell in or near the window."""
        if not self.params.enabled or self.radius_cells == 0:
            return
        if self.radius_cells > MAX_CELLS or self._around_unknown:
            self._inflate_far(master, window)
            return
        self._inflate(
            master.data,
            *window,
            self._ahead,
            self._behind,
            self._below,
            self._rows,
            self._near,
            self._near_words,
            self._unknown_from,
        )

    def _inflate_far(self, master: Costmap, window: Window) -> None:
        """Inflate with scipy's distance transform, for radii above the kernel's limit, and around unknown cells."""
        from scipy import ndimage

        reach = self.radius_cells
        y0, x0 = max(0, window.y0 - reach), max(0, window.x0 - reach)
        around = master.data[y0 : window.y1 + reach, x0 : window.x1 + reach]
        lethal = around == LETHAL
        if self._around_unknown:
            lethal |= around == UNKNOWN
        if not lethal.any():
            return
        distance: Any = ndimage.distance_transform_edt
        cells: NDArray[np.float64] = distance(~lethal)
        cells = np.sqrt(np.rint(cells[window.y0 - y0 : window.y1 - y0, window.x0 - x0 : window.x1 - x0] ** 2))
        costs = self._costs_at(cells)
        costs[self._is_beyond(cells)] = 0
        old = master.data[window.slices]
        unknown = old == UNKNOWN
        np.maximum(old, costs, out=old)
        write = unknown & (costs >= self._unknown_from)
        old[write] = costs[write]

    @property
    def inflation(self) -> Inflation | None:
        """The costs in force; None while the layer is disabled."""
        p = self.params
        return Inflation(self.inscribed_radius, p.inflation_radius, p.cost_scaling_factor) if p.enabled else None

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the cost by the distance to the nearest lethal cell."""
        nearest = nearest_lethal(master.data, ix, iy, self.radius_cells)
        if nearest is None:
            return CellExplanation(0, f"no obstacle within {self.params.inflation_radius:g} m")
        resolution = master.geometry.resolution
        distance = math.hypot(nearest[0] - ix, nearest[1] - iy) * resolution
        cost = int(inflation_cost(distance, self.inscribed_radius, self.params.cost_scaling_factor))
        x, y = master.geometry.cell_to_world(*nearest)
        where = "in this cell" if distance == 0.0 else f"{distance:.3f} m away at ({x:.3f}, {y:.3f})"
        return CellExplanation(
            cost,
            f"the nearest obstacle is {where}; inscribed radius {self.inscribed_radius:.3f} m, {describe_cost(cost)}",
            data={"obstacle": [x, y], "obstacle_cell": list(nearest), "distance_m": distance},
        )

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Inflate everything again at the next update; there are no observations to clear."""
        self._everything = True
        return 0

    def _is_beyond(self, cells_away: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return where distances in cells are beyond the inflation radius."""
        return cells_away > self.radius_cells

    def _margin_of(self, radius: float, whole_cells: float) -> float:
        """Return by how much (m) bounds grow: the inflation radius, or that in whole cells."""
        return max(radius, whole_cells)

    def _costs_at(self, cells_away: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the costs at distances in cells from a lethal cell."""
        return inflation_cost(cells_away * self._resolution, self.inscribed_radius, self.params.cost_scaling_factor)

    def _tabulate(self) -> None:
        geometry = self._geometry
        if geometry is None:
            return
        self._everything = True
        resolution = geometry.resolution
        if self.context.static_map is not None and not self.context.rolling_window:
            # ROS passes the resolution of a map in a float32 message field: this decides how many cells 0.55 m are, and
            # whether 0.25 m reach the fifth cell
            resolution = float(np.float32(resolution))
        radius = self.params.inflation_radius
        # no cell of the grid is farther away than its width plus its height
        cells = max(0, math.ceil(radius / resolution))
        self.radius_cells = min(cells, geometry.nx + geometry.ny)
        self._resolution = resolution
        self._margin = self._margin_of(radius, cells * geometry.resolution)
        if self.radius_cells > MAX_CELLS:
            return
        # cost at `row` cells across and 1 .. n cells along, then 0 cells along; n in whole vectors of 16 bytes
        across = np.arange(self.radius_cells + 1.0)
        along = np.append(np.arange(1.0, 16 * math.ceil(max(self.radius_cells, 1) / 16) + 1.0), 0.0)
        cells_away = np.hypot(across[:, None], along[None, :])
        costs = self._costs_at(cells_away)
        costs[self._is_beyond(cells_away)] = 0
        self._ahead = np.ascontiguousarray(costs)
        self._behind = np.ascontiguousarray(costs[:, ::-1])
        self._rows = np.zeros((2, geometry.nx + 2 * costs.shape[1] + 16), np.uint8)
        self._near = np.zeros(8 * (geometry.nx // 8 + 4), np.uint8)
        self._near_words = self._near.view(np.uint64)


STEPS_PER_CELL = 100
"""Nav2 looks the cost up by the distance in hundredths of a cell."""

ROUNDED_UP = frozenset({7, 13, 15, 95, 105, 117, 119, 125, 223, 241, 253})
"""Radii (cells), and their products with powers of 2, at exactly which Nav2 does not inflate.

It takes roots by Eigen's fast square root: x86's approximate reciprocal root and one step of Newton's method, in float32. That
of the square of these numbers is the float32 above the number. Up to the radius of 253 cells there are no others.
"""


class Nav2InflationLayerParams(InflationLayerParams):
    """Parameters of Nav2's inflation layer."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {"num_threads": "one thread is used"}

    inflate_around_unknown: bool = param(False, "inflate around unknown cells too, as around lethal ones")
    custom_inscribed_radius: float = param(
        -1.0, "inscribed radius for the costs; negative: that of the footprint", unit="m"
    )

    CLAMPED: ClassVar[frozenset[str]] = frozenset()
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset()


@LAYERS.register("nav2_inflation", aliases=("nav2_costmap_2d/InflationLayer",))
class Nav2InflationLayer(InflationLayer):
    """Costs around obstacles, by Nav2's rules: the distance is rounded to a hundredth of a cell before the cost is computed, and
    cells at exactly the inflation radius are left out where Nav2's square root rounds it up.
    """

    Params: ClassVar[type[ParamModel]] = Nav2InflationLayerParams
    AS_NAV2 = True
    LIVE: ClassVar[frozenset[str]] = InflationLayer.LIVE | {"inflate_around_unknown", "custom_inscribed_radius"}

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self._around_unknown = bool(params.inflate_around_unknown)
        self.set_footprint(context.footprint)

    def set_footprint(self, footprint: Footprint) -> None:
        """Replace the inscribed radius; inflate everything again."""
        self._footprint = footprint
        custom = self.params.custom_inscribed_radius
        self.inscribed_radius = custom if custom >= 0.0 else footprint.inscribed_radius
        self._tabulate()

    def set_params(self, params: Any) -> None:
        """Replace the parameters; inflate everything again."""
        self._around_unknown = bool(params.inflate_around_unknown)
        super().set_params(params)
        self.set_footprint(self._footprint)

    def _is_beyond(self, cells_away: NDArray[np.float64]) -> NDArray[np.bool_]:
        radius = self.radius_cells
        odd = radius // max(radius & -radius, 1)
        return cells_away >= radius if odd in ROUNDED_UP else cells_away > radius

    def _margin_of(self, radius: float, whole_cells: float) -> float:
        return radius

    def _costs_at(self, cells_away: NDArray[np.float64]) -> NDArray[np.uint8]:
        steps = np.floor(cells_away.astype(np.float32) * np.float32(STEPS_PER_CELL) + np.float32(0.5))
        cells = np.minimum(steps, self.radius_cells * STEPS_PER_CELL + 1).astype(np.float64) / STEPS_PER_CELL
        return inflation_cost(cells * self._resolution, self.inscribed_radius, self.params.cost_scaling_factor)
