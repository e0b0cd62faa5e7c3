"""Scans and clouds with deferred measurement."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import DeferredCloud, DeferredScan, LaserScan, PointCloud


def deferred(calls: list[int]) -> DeferredScan:
    def measure() -> NDArray[np.float32]:
        calls.append(1)
        return np.arange(3, dtype=np.float32)

    return DeferredScan(measure, -1.0, 1.0, 0.1, 6.0, 2.5, "laser", "front/scan", 0.2)


def test_ranges_are_computed_once_at_the_first_access() -> None:
    calls: list[int] = []
    scan = deferred(calls)
    assert isinstance(scan, LaserScan)
    assert (scan.stamp, scan.frame, scan.topic, scan.height, scan.range_max) == (2.5, "laser", "front/scan", 0.2, 6.0)
    assert not calls
    assert scan.ranges.tolist() == [0.0, 1.0, 2.0]
    assert scan.ranges is scan.ranges
    assert calls == [1]


def test_copy_with_another_stamp_has_the_same_ranges() -> None:
    scan = deferred([])
    late = replace(scan, stamp=9.0)
    assert late.stamp == 9.0
    assert late.ranges is scan.ranges


def test_deferred_scan_is_immutable() -> None:
    with pytest.raises(AttributeError):
        deferred([]).stamp = 1.0  # pyright: ignore[reportAttributeAccessIssue]


def test_points_are_computed_once_and_copies_share_them() -> None:
    calls: list[int] = []

    def measure() -> NDArray[np.float32]:
        calls.append(1)
        return np.ones((2, 3), np.float32)

    cloud = DeferredCloud(measure, 2.5, "bumper", "front/points")
    assert isinstance(cloud, PointCloud)
    assert (cloud.stamp, cloud.frame, cloud.topic) == (2.5, "bumper", "front/points")
    waiting = copy.copy(cloud)
    assert not calls
    assert cloud.points is cloud.points
    assert calls == [1]
    assert replace(cloud, stamp=9.0).points is cloud.points
    assert waiting.points.tolist() == [[1.0] * 3] * 2
