"""Sonars and infrared sensors: an occupancy probability per cell, updated by Bayes' rule over the cone of each reading.

Source of the sensor model: range_sensor_layer (D. V. Lu), after "Probabilistic Robotics" (Thrun, Burgard, Fox), chapter 9.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    LETHAL,
    UNKNOWN,
    BlindSensorError,
    Bounds,
    Costmap,
    FrameError,
    GridGeometry,
    InputError,
    NavError,
    Pose2D,
    RangeReading,
    SensorData,
    Transform2D,
    Window,
)
from navstack.costmap.observation_buffer import SensorTimeout, untransformed
from navstack.costmap.windows import clear_region, combine_max, shift_cells, window_shift
from navstack.plugins import LAYERS, CellExplanation, Layer, LayerContext, ParamModel, param

PENDING = 50
TOLERANCE_S = 0.3
"""Time tolerance of a reading's transform (s)."""
UNDECIDED = 127
"""Cost of a cell with an occupancy probability of one half."""


class RangeSensorLayerParams(ParamModel):
    """`<costmap>/range_sensor_layer:`."""

    enabled: bool = param(True, "apply this layer")
    ns: str = param("", "namespace of all topics")
    topics: list[str] = param(["/sonar"], "topics of the readings")
    phi: float = param(1.2, "distance up to which readings are reliable", unit="m", ge=0.0)
    inflate_cone: float = param(1.0, "1: only the cone itself; 0: all cells of the triangle around it", ge=0.0, le=1.0)
    no_readings_timeout: float = param(
        0.0, "longest time without a reading before the layer is stale; 0 = no limit", unit="s", ge=0.0
    )
    clear_threshold: float = param(0.2, "cells with a lower probability are free", ge=0.0, le=1.0)
    mark_threshold: float = param(0.8, "cells with a higher probability are obstacles", ge=0.0, le=1.0)
    clear_on_max_reading: bool = param(False, "a reading of max_range clears the cone")
    input_sensor_type: Literal["ALL", "VARIABLE", "FIXED"] = param(
        "ALL", "sensors that report distances (VARIABLE), only detections (FIXED), or both"
    )


@LAYERS.register("range_sensor", aliases=("range_sensor_layer/RangeSensorLayer", "nav2_costmap_2d/RangeSensorLayer"))
class RangeSensorLayer(Layer):
    """Obstacles seen by range sensors. 1 byte per cell: the probability times 254."""

    Params: ClassVar[type[ParamModel]] = RangeSensorLayerParams

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        prefix = params.ns.strip("/")
        self.topics = {f"{prefix}/{t.strip('/')}".strip("/") for t in params.topics}
        self.costs: NDArray[np.uint8] = np.zeros((1, 1), np.uint8)
        self.geometry = GridGeometry(1, 1, 1.0)
        self._pending: deque[RangeReading] = deque(maxlen=PENDING)
        self._timeout = SensorTimeout()
        self._problems: dict[str, NavError] = {}
        self._extra = Bounds()

    def match_size(self, geometry: GridGeometry) -> None:
        """Allocate; set all cells to a probability of one half."""
        self.geometry = geometry
        self.costs = np.full(geometry.shape, UNDECIDED, np.uint8)

    def shift_to(self, geometry: GridGeometry) -> None:
        """Move the cells; keep the overlap of the old and the new window."""
        shift_cells(self.costs, *window_shift(self.geometry, geometry), UNDECIDED)
        self.geometry = geometry

    def observe(self, data: SensorData) -> bool:
        """Receive a reading of one of the topics. Raises InputError if it is invalid."""
        if not isinstance(data, RangeReading) or data.topic.strip("/") not in self.topics:
            return False
        cone = (data.field_of_view, data.min_range, data.max_range, data.stamp)
        if math.isnan(data.range_m) or not all(map(math.isfinite, cone)) or data.field_of_view <= 0.0:
            raise InputError(
                f"a range reading's distance, limits and stamp must be numbers and its field of view above 0, not {data}",
                topic=data.topic,
            )
        self._pending.append(data)
        return True

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Apply the readings; grow the bounds to contain their cones."""
        del robot, now
        if not self.params.enabled:
            return bounds
        bounds, self._extra = bounds.union(self._extra), Bounds()
        waiting: list[RangeReading] = []
        for reading in self._pending:
            try:
                at = self._lookup(reading)
            except FrameError as exc:
                waiting.append(reading)
                frames = self.context.frames
                self._problems[reading.topic] = untransformed(
                    reading.topic, reading.frame, self.context.frame, exc, frames
                )
                continue
            blind = _blindness(reading, self.params.no_readings_timeout)
            if blind is None:
                self._timeout.received(reading.stamp)
                self._problems.pop(reading.topic, None)
            else:
                self._problems[reading.topic] = blind
            bounds = bounds.union(self._apply(reading, at))
        self._pending.clear()
        self._pending.extend(waiting)
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Write the larger cost of master and layer: lethal above mark_threshold, free below clear_threshold, else unknown."""
        if not self.params.enabled:
            return
        combine_max(master.data, self._thresholded(window), *window)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Reset the probabilities; return the number of obstacle cells cleared."""
        marked = np.where(self.costs > self.params.mark_threshold * LETHAL, LETHAL, 0)
        cleared, changed = clear_region(marked, self.geometry, region, invert, 0)
        clear_region(self.costs, self.geometry, region, invert, UNDECIDED)
        self._extra = self._extra.union(changed)
        self._timeout.restart()
        return cleared

    def is_current(self, now: float) -> bool:
        """Return False if no valid reading with a known transform was received within no_readings_timeout."""
        allowed = self.params.no_readings_timeout
        if allowed > 0.0:
            for reading in reversed(self._pending):
                try:
                    self._lookup(reading)
                except FrameError:
                    continue  # `problems` reports it after the next update
                if _blindness(reading, allowed) is not None:
                    continue
                self._timeout.received(reading.stamp)
                break
        return self._timeout.is_within(allowed, now)

    def problems(self) -> Sequence[NavError]:
        """Return one error per topic whose readings cannot be transformed, or are below the sensor's range."""
        return tuple(self._problems.values())

    @property
    def clearable(self) -> bool:
        """True: the layer holds sensor data."""
        return True

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the probability of the cell."""
        del master
        chance = int(self.costs[iy, ix]) / LETHAL
        cost = LETHAL if chance > self.params.mark_threshold else 0 if chance < self.params.clear_threshold else None
        return CellExplanation(cost, f"occupied with probability {chance:.2f}", data={"probability": chance})

    def _thresholded(self, window: Window) -> NDArray[np.uint8]:
        out = np.full(self.costs.shape, UNKNOWN, np.uint8)
        part = self.costs[window.slices]
        view = out[window.slices]
        view[part > self.params.mark_threshold * LETHAL] = LETHAL
        view[part < self.params.clear_threshold * LETHAL] = 0
        return out

    def _lookup(self, reading: RangeReading) -> Transform2D:
        """Return the pose of the sensor in the costmap's frame. Raises FrameError."""
        return self.context.frames.lookup(self.context.frame, reading.frame, reading.stamp, TOLERANCE_S)

    def _apply(self, reading: RangeReading, at: Transform2D) -> Bounds:
        """Apply Bayes' rule to the cells of one cone, seen by a sensor at `at`; return its bounds (m)."""
        distance, clears_all = reading.range_m, False
        fixed = reading.min_range == reading.max_range
        kind = self.params.input_sensor_type
        if (kind == "FIXED") != fixed and kind != "ALL":
            return Bounds()
        if fixed:  # reports a detection (-inf) or none (+inf)
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
        """Return the occupancy probability given the reading alone: low before the arc, high on it, one half behind it."""
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


def _blindness(reading: RangeReading, timeout_s: float) -> BlindSensorError | None:
    """Return why a reading shows nothing: it is below the sensor's range; None if it shows something.

    A sensor with equal limits reports detections only: any reading below its range is one (REP 117).
    """
    lowest = reading.min_range
    if (reading.range_m > 0.0 and reading.range_m >= lowest) or lowest == reading.max_range:
        return None
    text = (
        f'a reading of "{reading.topic}" is no distance from its min_range = {lowest:g} m on, but {reading.range_m:g} m: '
        "something covers the sensor, or it is faulty. Obstacles that only this sensor sees are unknown; check the sensor"
    )
    if timeout_s == 0.0:
        text += ", or set no_readings_timeout (s), so that the robot stops when it is blind"
    return BlindSensorError(text, topic=reading.topic, source=reading.topic, range_m=reading.range_m)
