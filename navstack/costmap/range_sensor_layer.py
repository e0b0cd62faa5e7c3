"""Sonars and infrared sensors: a probability per cell, updated by Bayes' rule over the cone of each reading.

Source of the sensor model: range_sensor_layer (D. V. Lu), after "Probabilistic Robotics" (Thrun, Burgard, Fox), chapter 9.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, UNKNOWN, Bounds, Costmap, GridGeometry, Pose2D, RangeReading, SensorData, Window
from navstack.core.errors import FrameError, InputError
from navstack.core.parameters import ParamModel, param
from navstack.costmap import _kernels
from navstack.costmap.regions import forget_region, shift_cells, window_shift
from navstack.costmap.sensor_timeout import Silence
from navstack.interfaces import CellExplanation, Layer, LayerContext
from navstack.plugins import LAYERS

PENDING = 50
EVEN = 127
"""Cost of a cell as likely free as not."""


class RangeSensorLayerParams(ParamModel):
    """`<costmap>/range_sensor_layer:`."""

    enabled: bool = param(True, "apply this layer")
    ns: str = param("", "namespace before every topic")
    topics: list[str] = param(["/sonar"], "topics of the readings")
    phi: float = param(1.2, "distance up to which a reading is trusted", unit="m", ge=0.0)
    inflate_cone: float = param(
        1.0, "1: only the cone itself; 0: everything the triangle around it touches", ge=0.0, le=1.0
    )
    no_readings_timeout: float = param(
        0.0, "longest silence before the layer counts as stale; 0 = any", unit="s", ge=0.0
    )
    clear_threshold: float = param(0.2, "less likely cells are free", ge=0.0, le=1.0)
    mark_threshold: float = param(0.8, "likelier cells are obstacles", ge=0.0, le=1.0)
    clear_on_max_reading: bool = param(False, "a reading of the largest distance frees the cone")
    input_sensor_type: Literal["ALL", "VARIABLE", "FIXED"] = param(
        "ALL", "kind of the sensors: with distances, yes or no"
    )


@LAYERS.register("range_sensor", aliases=("range_sensor_layer/RangeSensorLayer",))
class RangeSensorLayer(Layer):
    """Obstacles seen by cones. 1 byte a cell: the probability times 254."""

    Params: ClassVar[type[ParamModel]] = RangeSensorLayerParams

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        prefix = params.ns.strip("/")
        self.topics = {f"{prefix}/{t.strip('/')}".strip("/") for t in params.topics}
        self.costs: NDArray[np.uint8] = np.zeros((1, 1), np.uint8)
        self.geometry = GridGeometry(1, 1, 1.0)
        self._pending: deque[RangeReading] = deque(maxlen=PENDING)
        self._silence = Silence()
        self._extra = Bounds()

    def match_size(self, geometry: GridGeometry) -> None:
        """Allocates; all cells are even."""
        self.geometry = geometry
        self.costs = np.full(geometry.shape, EVEN, np.uint8)

    def shift_to(self, geometry: GridGeometry) -> None:
        """Keeps the cells that the old and the new window share."""
        shift_cells(self.costs, *window_shift(self.geometry, geometry), EVEN)
        self.geometry = geometry

    def observe(self, data: SensorData) -> bool:
        """Takes readings of its topics; raises InputError for one that is not a number."""
        if not isinstance(data, RangeReading) or data.topic.strip("/") not in self.topics:
            return False
        cone = (data.field_of_view, data.min_range, data.max_range, data.stamp)
        if math.isnan(data.range_m) or not all(map(math.isfinite, cone)) or data.field_of_view <= 0.0:
            raise InputError(
                f"a range reading's distance, cone and stamp must be numbers and its cone wider than 0, not {data}",
                topic=data.topic,
            )
        self._pending.append(data)
        self._silence.arrived(data.stamp)
        return True

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Works the readings in; the box grows to hold their cones."""
        del robot, now
        if not self.params.enabled:
            return bounds
        bounds, self._extra = bounds.union(self._extra), Bounds()
        waiting: list[RangeReading] = []
        for reading in self._pending:
            try:
                bounds = bounds.union(self._work_in(reading))
            except FrameError:
                waiting.append(reading)
        self._pending.clear()
        self._pending.extend(waiting)
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Likely cells are lethal, unlikely ones free, the rest says nothing; the larger of master and layer."""
        if not self.params.enabled:
            return
        _kernels.combine_max(master.data, self._said(window), *window)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Forgets; returns how many cells were obstacles."""
        marked = np.where(self.costs > self.params.mark_threshold * LETHAL, LETHAL, 0)
        cleared, touched = forget_region(marked, self.geometry, region, invert, 0)
        forget_region(self.costs, self.geometry, region, invert, EVEN)
        self._extra = self._extra.union(touched)
        self._silence.restart()
        return cleared

    def is_current(self, now: float) -> bool:
        """False when no reading came for longer than no_readings_timeout."""
        return self._silence.is_within(self.params.no_readings_timeout, now)

    @property
    def clearable(self) -> bool:
        """Fed by sensors."""
        return True

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """The probability there."""
        del master
        chance = int(self.costs[iy, ix]) / LETHAL
        said = LETHAL if chance > self.params.mark_threshold else 0 if chance < self.params.clear_threshold else None
        return CellExplanation(said, f"occupied with probability {chance:.2f}", data={"probability": chance})

    def _said(self, window: Window) -> NDArray[np.uint8]:
        out = np.full(self.costs.shape, UNKNOWN, np.uint8)
        part = self.costs[window.slices]
        view = out[window.slices]
        view[part > self.params.mark_threshold * LETHAL] = LETHAL
        view[part < self.params.clear_threshold * LETHAL] = 0
        return out

    def _work_in(self, reading: RangeReading) -> Bounds:
        """Bayes' rule over the cells of one cone; the box (m) that holds them."""
        distance, clears_all = reading.range_m, False
        fixed = reading.min_range == reading.max_range
        kind = self.params.input_sensor_type
        if (kind == "FIXED") != fixed and kind != "ALL":
            return Bounds()
        if fixed:  # yes (-inf) or no (+inf)
            clears_all = distance > 0.0
            if clears_all and not self.params.clear_on_max_reading:
                return Bounds()
            distance = reading.max_range
        elif distance >= reading.max_range:
            if not self.params.clear_on_max_reading:
                return Bounds()
            distance, clears_all = reading.max_range, True
        elif distance < reading.min_range:
            return Bounds()
        at = self.context.frames.lookup(self.context.frame, reading.frame, reading.stamp, 0.3)
        g = self.geometry
        half = 0.5 * reading.field_of_view
        reach = distance + 2.0 * g.resolution
        angles = at.yaw + np.linspace(-half, half, 9)
        xs, ys = np.append(at.x + reach * np.cos(angles), at.x), np.append(at.y + reach * np.sin(angles), at.y)
        box = Bounds(float(xs.min()), float(ys.min()), float(xs.max()), float(ys.max())).grown(g.resolution)
        left, right, bottom, top = g.extent
        if box.max_x < left or box.min_x >= right or box.max_y < bottom or box.min_y >= top:
            return Bounds()
        window = g.window_of(box)
        x = g.origin_x + (np.arange(window.x0, window.x1) + 0.5) * g.resolution - at.x
        y = g.origin_y + (np.arange(window.y0, window.y1) + 0.5) * g.resolution - at.y
        away = np.hypot(x[None, :], y[:, None])
        aside = np.arctan2(y[:, None], x[None, :]) - at.yaw
        aside = np.abs((aside + np.pi) % (2.0 * np.pi) - np.pi)
        inside = (away <= reach) & (aside <= half + (1.0 - self.params.inflate_cone) * half)
        seen = np.zeros_like(away) if clears_all else self._likelihood(distance, away, aside, half, g.resolution)
        cells = self.costs[window.slices]
        prior = cells / LETHAL
        yes, no = seen * prior, (1.0 - seen) * (1.0 - prior)
        with np.errstate(invalid="ignore", divide="ignore"):
            posterior = np.where(yes + no > 0.0, yes / (yes + no), prior)
        cells[inside] = (posterior[inside] * LETHAL).astype(np.uint8)
        return box

    def _likelihood(
        self, distance: float, away: NDArray[np.float64], aside: NDArray[np.float64], half: float, width: float
    ) -> NDArray[np.float64]:
        """Chance that a cell is occupied given the reading alone: low before the arc, high on it, even behind."""
        trust = 1.0 - 0.5 * (1.0 + np.tanh(2.0 * (away - self.params.phi)))
        trust = trust * np.where(aside > half, 0.0, 1.0 - (aside / half) ** 2)
        thickness = width * max(distance, 1e-9)
        ramp = (away - (distance - 2.0 * thickness)) / thickness
        peak = (distance - away) / thickness
        return np.select(
            [away < distance - 2.0 * thickness, away < distance - thickness, away < distance + thickness],
            [
                (1.0 - trust) * 0.5,
                trust * 0.5 * ramp**2 + (1.0 - trust) * 0.5,
                trust * ((1.0 - 0.5 * peak**2) - 0.5) + 0.5,
            ],
            0.5,
        )
