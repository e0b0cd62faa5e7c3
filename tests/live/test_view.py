"""What the page is sent of a session."""

from __future__ import annotations

import numpy as np
from shapely import LineString, Point

from navstack.live.view import _points  # pyright: ignore[reportPrivateUsage]


def test_a_plan_is_thinned_but_keeps_its_shape() -> None:
    """5 cm between points: a circle of radius 0.3 m is off by 1 mm, and the end is the end of the plan."""
    turn = np.linspace(0.0, 1.9 * np.pi, 800)
    poses = np.column_stack((0.3 * np.cos(turn), 0.3 * np.sin(turn), turn))
    sent = np.array(_points(poses)).reshape(-1, 2)
    assert 30 <= len(sent) <= 45  # 1.8 m
    line = LineString(sent)
    assert max(line.distance(Point(p)) for p in poses[:, :2]) < 0.01  # rounded to centimeters
    assert np.hypot(*(sent[-1] - poses[-1, :2])) < 0.01
    assert _points(poses[:0]) == [] and _points(poses[:1]) == [0.3, 0.0]
