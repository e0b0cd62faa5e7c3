"""Metrics of motions with known results, and their documentation."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from navstack.move_base import TickResult
from navstack.record import format as fmt
from navstack.record.metrics import RunMetrics, Timings, compute_metrics

ROOT = Path(__file__).resolve().parents[2]
GOAL = {"state": "SUCCEEDED", "path_length_m": 1.0, "recoveries": 2}


def metrics(t: np.ndarray, poses: np.ndarray, clearances: np.ndarray | None = None, collisions: int = 0) -> RunMetrics:
    states = ["PLANNING"] * (len(t) // 2) + ["CONTROLLING"] * (len(t) - len(t) // 2)
    clearances = np.full(len(t), 0.5) if clearances is None else clearances
    return compute_metrics(t, poses, states, clearances, results=[GOAL], collisions=collisions)


def test_a_straight_line_at_constant_speed() -> None:
    t = np.arange(0.0, 2.01, 0.1)
    m = metrics(t, np.column_stack((0.5 * t, 0.0 * t, 0.0 * t)))
    assert m.speed_mean_m_s == pytest.approx(0.5) and m.speed_max_m_s == pytest.approx(0.5)
    assert m.jerk_rms_m_s3 == pytest.approx(0.0, abs=1e-9) and m.curvature_mean_1_m == 0.0
    assert (m.time_s, m.turning_s, m.standing_s) == (pytest.approx(2.0), 0.0, 0.0)
    assert (m.goals, m.succeeded, m.recoveries, m.length_m) == (1, 1, 2, 1.0)
    assert m.state_s == pytest.approx({"CONTROLLING": 1.0, "PLANNING": 1.0})


def test_a_circle_has_its_curvature_across_the_jump_of_the_angle() -> None:
    t = np.arange(0.0, 20.0, 0.05)
    yaw = np.remainder(0.5 * t + math.pi, 2.0 * math.pi) - math.pi
    m = metrics(t, np.column_stack((2.0 * np.sin(0.5 * t), -2.0 * np.cos(0.5 * t), yaw)))
    assert m.curvature_mean_1_m == pytest.approx(0.5, rel=1e-3)
    assert m.turned_rad == pytest.approx(0.5 * t[-1]) and m.turning_s == 0.0
    # the acceleration v²/r turns with the circle: jerk v³/r²
    assert m.jerk_rms_m_s3 == pytest.approx(1.0 / 4.0, rel=1e-2)


def test_a_cubic_has_its_jerk() -> None:
    t = np.arange(0.0, 2.0, 0.02)
    m = metrics(t, np.column_stack((0.3 * t**3, 0.0 * t, 0.0 * t)))
    assert m.jerk_rms_m_s3 == pytest.approx(1.8, rel=1e-6)


def test_turning_in_place_and_standing() -> None:
    t = np.arange(0.0, 3.01, 0.1)
    yaw = np.minimum(t, 1.0)
    m = metrics(t, np.column_stack((0.0 * t, 0.0 * t, yaw)))
    assert m.turning_s == pytest.approx(1.0) and m.standing_s == pytest.approx(2.0)
    assert m.turned_rad == pytest.approx(1.0) and m.curvature_mean_1_m == 0.0 and m.speed_mean_m_s == 0.0


def test_clearance() -> None:
    t = np.arange(3.0)
    poses = np.zeros((3, 3))
    assert metrics(t, poses, np.array([0.2, 0.1, 0.6])).clearance_min_m == 0.1
    assert metrics(t, poses, np.array([0.2, 0.1, 0.6])).clearance_mean_m == pytest.approx(0.3)
    assert metrics(t, poses, np.array([0.2, 0.1, 0.6]), collisions=1).clearance_min_m == 0.0
    assert metrics(t, poses, np.full(3, math.inf)).clearance_min_m == math.inf
    assert math.isnan(metrics(t, poses, np.full(3, math.nan)).clearance_min_m)


@pytest.mark.parametrize("cycles", [0, 1, 2, 3])
def test_runs_of_a_few_cycles(cycles: int) -> None:
    m = metrics(np.arange(float(cycles)), np.zeros((cycles, 3)))
    assert m.speed_mean_m_s == m.jerk_rms_m_s3 == m.curvature_mean_1_m == 0.0


def test_timings_add_the_calls_of_a_tick() -> None:
    timings = Timings()
    timings.add(TickResult(0.0))
    timings.add(TickResult(0.2, planning_s=0.004, control_s=0.001))
    timings.add(TickResult(0.4, planning_s=0.002))
    reported = timings.as_dict()
    assert reported["planning_ms"]["count"] == 2 and reported["control_ms"]["count"] == 1
    assert reported["planning_ms"]["max"] == 4.0 and reported["control_ms"]["p50"] == 1.0
    assert set(reported["planning_ms"]) == {"count", "p50", "p95", "p99", "max"}
    assert Timings().as_dict()["control_ms"] == {"count": 0}


def test_the_documentation_names_every_metric_column_and_array() -> None:
    text = (ROOT / "docs" / "reference" / "record.md").read_text(encoding="utf-8")
    names = [field.name for field in fields(RunMetrics)]
    names += [column for columns in fmt.TABLES.values() for column, _ in columns]
    names += [*fmt.TABLES, *fmt.ARRAYS, *(column for column, _ in fmt.COSTMAP_TABLE), "clearances"]
    words = set(text.replace("`", " ").replace(",", " ").split())
    assert [name for name in names if name not in words] == []
