"""Errors of trajectories: closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Transform2D, normalize_angles
from navstack.localization.metrics import (
    ErrorStatistics,
    absolute_errors,
    between,
    pairs_by_distance,
    relative_errors,
)


def test_statistics_of_known_numbers() -> None:
    found = ErrorStatistics.of(np.array([3.0, 4.0, 0.0, 5.0]))
    assert found.count == 4
    assert found.mean == 3.0
    assert found.median == 3.5
    assert found.max == 5.0
    assert found.rms == pytest.approx(math.sqrt(50.0 / 4.0))
    assert found.std == pytest.approx(np.std([3.0, 4.0, 0.0, 5.0], ddof=1))
    assert math.isnan(ErrorStatistics.of(np.empty(0)).mean)
    assert set(found.as_dict()) == {"count", "rms", "mean", "std", "median", "p95", "max"}


def test_an_offset_is_an_absolute_error_but_no_relative_one() -> None:
    rng = np.random.default_rng(1)
    reference = np.column_stack((rng.normal(size=(30, 2)), rng.uniform(-3.0, 3.0, 30)))
    moved = Transform2D(0.3, -0.4, 0.2).apply_poses(reference)
    shifted = reference + np.array([0.3, -0.4, 2.0 * math.pi])
    assert absolute_errors(shifted, reference).position.rms == pytest.approx(0.5)
    assert absolute_errors(shifted, reference).heading.max == pytest.approx(0.0, abs=1e-12)
    i = np.arange(29)
    relative = relative_errors(moved, reference, i, i + 1)
    assert relative.position.max == pytest.approx(0.0, abs=1e-12)
    assert relative.heading.max == pytest.approx(0.0, abs=1e-12)


def test_relations_agree_with_transforms() -> None:
    rng = np.random.default_rng(2)
    a, b = (np.column_stack((rng.normal(size=(5, 2)), rng.uniform(-3.0, 3.0, 5))) for _ in range(2))
    for row, u, v in zip(between(a, b), a, b, strict=True):
        assert tuple(row.tolist()) == pytest.approx(
            tuple(Transform2D(*u.tolist()).inverse() @ Transform2D(*v.tolist()))
        )


def test_pairs_by_distance() -> None:
    poses = np.zeros((6, 3))
    poses[:, 0] = 0.5 * np.arange(6)
    first, second = pairs_by_distance(poses, 1.0)
    assert first.tolist() == [0, 1, 2, 3]
    assert second.tolist() == [2, 3, 4, 5]


def test_normalize_angles() -> None:
    assert normalize_angles(
        np.array([math.pi, -math.pi, 3.0 * math.pi, 0.1 - 2.0 * math.pi])
    ).tolist() == pytest.approx([math.pi, math.pi, math.pi, 0.1])
