"""The contract of dock detectors."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any, ClassVar, Final

import numpy as np
import pytest

from navstack.core import DockDetection, PointCloud, Pose2D, SensorData, angle_between
from navstack.plugins import DockDetector
from navstack.testing.base import Contract, contract_of

Measure = Callable[[Pose2D, float], "SensorData | DockDetection"]
"""Returns what the sensor measures of a marker at a pose in its frame (m, rad; the x axis points into the dock) at a time (s)."""
MARKERS: Final = (Pose2D(1.0, 0.0, 0.0), Pose2D(0.8, 0.2, 0.3), Pose2D(0.6, -0.15, -0.3), Pose2D(1.2, 0.1, 0.1))
NEAR_M: Final = 0.02
NEAR_RAD: Final = math.radians(3.0)
"""An ideal measurement shows the marker within these."""


def heading_of(found: DockDetection) -> float:
    """Return the heading into the dock of a detection with the orientation of a tag (rad)."""
    x, y, z, w = found.orientation
    # the z axis of a tag points out of the dock
    return math.atan2(-2.0 * (y * z - w * x), -2.0 * (x * z + w * y))


class DockDetectorContract(Contract):
    """What every detector of docks must do."""

    measure: ClassVar[Measure]

    @classmethod
    def make(cls) -> DockDetector:
        """The detector under test."""
        detector = cls.plugin(cls.params())
        detector.reset()
        return detector

    @pytest.mark.parametrize("marker", MARKERS)
    def test_finds_the_marker(self, marker: Pose2D) -> None:
        """Position, heading, stamp and frame are those of the measurement, also if the marker is expected elsewhere."""
        data = type(self).measure(marker, 2.5)
        for expected in (marker, Pose2D(marker.x + 0.1, marker.y - 0.1, marker.yaw + 0.1)):
            found = self.make().detect(data, expected)
            assert found is not None
            assert math.hypot(found.x - marker.x, found.y - marker.y) <= NEAR_M
            assert abs(angle_between(heading_of(found), marker.yaw)) <= NEAR_RAD
            assert (found.stamp, found.frame) == (2.5, data.frame)

    def test_says_what_it_saw(self) -> None:
        """There is a remark after a measurement, and none after `reset`."""
        detector = self.make()
        detector.detect(type(self).measure(MARKERS[0], 0.0), MARKERS[0])
        assert detector.remark
        detector.reset()
        assert detector.remark == ""

    def test_a_marker_far_from_the_expected_one_is_of_another_dock(self) -> None:
        """It is not taken for the dock."""
        detector = self.make()
        assert detector.detect(type(self).measure(MARKERS[0], 0.0), Pose2D(-5.0, 4.0, 2.0)) is None

    def test_other_sensors_are_ignored(self) -> None:
        """A measurement of another kind shows nothing, and raises nothing."""
        cloud = PointCloud(np.zeros((3, 3), np.float32), stamp=0.0, frame="bumper", topic="bump")
        assert self.make().detect(cloud, MARKERS[0]) is None

    def test_the_same_measurements_give_the_same_detections(self) -> None:
        """And the measurement is left as it is."""
        data = type(self).measure(MARKERS[1], 1.0)
        before = copy.deepcopy(data)
        assert self.make().detect(data, MARKERS[1]) == self.make().detect(data, MARKERS[1])
        ranges: Any = getattr(data, "ranges", None)
        if ranges is None:
            assert data == before
        else:
            assert np.array_equal(ranges, before.ranges, equal_nan=True)  # type: ignore[union-attr]


def dock_detector_contract(plugin: type[Any], *, measure: Measure, **values: Any) -> type[DockDetectorContract]:
    """Return the suite for a detector; `measure` makes its ideal measurements, `values` are its parameters."""
    suite = contract_of(DockDetectorContract, plugin, values)
    suite.measure = staticmethod(measure)  # pyright: ignore[reportAttributeAccessIssue]
    return suite
