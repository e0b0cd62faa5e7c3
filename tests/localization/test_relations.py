"""Files of relations, and the errors by them: closed forms, damaged lines."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from navstack.core import LogError
from navstack.localization.evaluation import errors_by_relations
from navstack.localization.metrics import between
from navstack.logs import read_relations


def relation_line(first: float, second: float, pose: tuple[float, float, float]) -> str:
    x, y, yaw = pose
    return f"{first:.6f} {second:.6f} {x:.9f} {y:.9f} 0 0 0 {yaw:.9f}"


def test_errors_of_known_relations(tmp_path: Path) -> None:
    """A robot on a circle; each relation is wrong by a known pose, which the error then is, in the frame of the relation."""
    angles = np.linspace(0.0, 5.0, 26)
    stamps = 100.0 + np.arange(26.0)
    poses = np.column_stack((2.0 * np.cos(angles), 2.0 * np.sin(angles), angles + 0.5 * np.pi))
    first, second = np.array([0, 3, 10]), np.array([5, 9, 25])
    true = between(poses[first], poses[second])
    wrong = np.array([[0.3, 0.4, 0.1], [0.0, 0.0, -0.2], [0.0, 0.0, 0.0]])
    file = tmp_path / "circle.relations"
    known = [(true[k, 0] + wrong[k, 0], true[k, 1] + wrong[k, 1], true[k, 2] + wrong[k, 2]) for k in range(3)]
    texts = [relation_line(float(stamps[i]), float(stamps[j]), p) for i, j, p in zip(first, second, known, strict=True)]
    texts += ["", "# a comment", relation_line(50.0, 101.0, known[0])]
    file.write_text("\n".join(texts), encoding="utf-8")
    result = errors_by_relations(read_relations(file), stamps, poses)
    moved, turned = result.errors.position, result.errors.heading
    assert (moved.count, result.outside, result.interpolated) == (3, 1, 0)
    assert moved.mean == pytest.approx(0.5 / 3.0, abs=1e-8)
    assert moved.max == pytest.approx(0.5, abs=1e-8)
    assert moved.std == pytest.approx(np.std([0.5, 0.0, 0.0], ddof=1), abs=1e-8)
    assert turned.mean == pytest.approx(0.1, abs=1e-8)
    assert result.square_m2[0] == pytest.approx(0.25 / 3.0, abs=1e-8)
    assert result.square_rad2[0] == pytest.approx(0.05 / 3.0, abs=1e-8)


def test_poses_between_the_scans_are_interpolated(tmp_path: Path) -> None:
    stamps = np.array([0.0, 2.0, 4.0])
    poses = np.array([[0.0, 0.0, 3.0], [2.0, 0.0, -3.0], [4.0, 0.0, -3.0]])
    file = tmp_path / "line.relations"
    turn = 2.0 * math.pi - 6.0  # the shorter way from 3 to -3 rad
    middle = np.array([[1.0, 0.0, 3.0 + 0.5 * turn]])
    pose = between(middle, poses[2:])[0]
    file.write_text(relation_line(1.0, 4.0, tuple(pose.tolist())), encoding="utf-8")
    result = errors_by_relations(read_relations(file), stamps, poses)
    assert result.errors.position.max < 1e-8
    assert result.errors.heading.max < 1e-8
    assert result.interpolated == 1


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("1 2 3 4 5 6 7", '1: "1 2 3 4 5 6 7" is no relation; a line has eight numbers'),
        ("1 2 0 0 0 0 0 0\n1 2 x 0 0 0 0 0", ":2: "),
        ("1 2 0 0 0 0 0 inf", "is no relation"),
        ("1 2 0 0 0 0.5 0 0", "level ground"),
        ("# nothing", "has no relation"),
    ],
)
def test_files_that_hold_no_relations(text: str, named: str, tmp_path: Path) -> None:
    file = tmp_path / "bad.relations"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(LogError, match=named):
        read_relations(file)


def test_relations_of_another_log(tmp_path: Path) -> None:
    file = tmp_path / "other.relations"
    file.write_text(relation_line(1000.0, 1001.0, (1.0, 0.0, 0.0)), encoding="utf-8")
    with pytest.raises(LogError, match=r"no relation lies within the trajectory.* 1000\.000 \.\. 1001\.000 s"):
        errors_by_relations(read_relations(file), np.array([0.0, 1.0]), np.zeros((2, 3)))
    with pytest.raises(LogError, match="covers nothing"):
        errors_by_relations(read_relations(file), np.array([0.0]), np.full((1, 3), np.nan))
