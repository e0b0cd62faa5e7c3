"""A tenth of the movingai problems, with independent checks: legal steps, the published optimum, theta_star never longer."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.studies.movingai import TOLERANCE, Answer, Problem, build, read_problems, run, summary

TENTH = 114


@pytest.fixture(scope="module")
def folder(data_dir: Path) -> Path:
    if not (data_dir / "movingai").is_dir():
        pytest.skip("no movingai problems here")
    return data_dir / "movingai"


@pytest.fixture(scope="module")
def problems(folder: Path) -> list[Problem]:
    """Six of the sixty problems of every map."""
    rng = np.random.default_rng(20)
    by_map: dict[str, list[Problem]] = {}
    for problem in read_problems(folder):
        by_map.setdefault(problem.map, []).append(problem)
    chosen = [group[i] for group in by_map.values() for i in np.sort(rng.permutation(len(group))[: len(group) // 10])]
    assert len(chosen) >= TENTH
    return chosen


@pytest.fixture(scope="module")
def astar(folder: Path, problems: list[Problem]) -> list[Answer]:
    return run(folder, build("astar"), problems)


def walls(folder: Path, name: str) -> list[str]:
    """The rows of the map, read without code of navstack."""
    lines = (folder / "maps" / f"{name}.map").read_text("ascii").splitlines()
    return lines[lines.index("map") + 1 :]


def legal_length(rows: list[str], problem: Problem, xy: NDArray[np.float64]) -> float:
    """Length of a path from start to goal; fails if a step is not legal."""
    cells = [(round(float(x)), round(float(y))) for x, y in xy]
    assert np.abs(np.array(cells) - xy).max() < 1e-6
    assert cells[0] == (problem.sx, problem.sy)
    assert cells[-1] == (problem.gx, problem.gy)
    length = 0.0
    for (ax, ay), (bx, by) in itertools.pairwise(cells):
        assert max(abs(ax - bx), abs(ay - by)) == 1
        for x, y in {(bx, by), (ax, by), (bx, ay)}:  # all four cells next to a diagonal step, both of a straight one
            assert rows[y][x] in ".GS", f"{problem}: through ({x}, {y})"
        length += math.hypot(ax - bx, ay - by)
    return length


@pytest.mark.slow
def test_astar_is_optimal_and_legal(folder: Path, astar: list[Answer]) -> None:
    rows = {name: walls(folder, name) for name in {a.problem.map for a in astar}}
    for answer in astar:
        length = legal_length(rows[answer.problem.map], answer.problem, answer.xy)
        assert abs(length - answer.problem.optimal) <= TOLERANCE, answer.problem
        assert length == pytest.approx(answer.length)


def test_the_check_rejects_a_cut_corner() -> None:
    problem = Problem("-", "-", 0, 0, 1, 1, 1.4)
    with pytest.raises(AssertionError, match="through"):
        legal_length([".@", ".."], problem, np.array([[0.0, 0.0], [1.0, 1.0]]))


@pytest.mark.slow
def test_theta_star_is_never_longer_and_legal(folder: Path, astar: list[Answer]) -> None:
    """On a third of the problems; ten points per cell along the lines are all in passable cells."""
    some = astar[::3]
    rows = {name: walls(folder, name) for name in {a.problem.map for a in some}}
    shorter = 0
    for answer, other in zip(run(folder, build("theta_star"), [a.problem for a in some]), some, strict=True):
        assert answer.length <= other.length * (1.0 + 1e-9)
        shorter += answer.length < 0.99 * other.length
        grid = rows[answer.problem.map]
        for a, b in zip(answer.xy[:-1], answer.xy[1:], strict=True):
            for t in np.linspace(0.013, 0.987, 10):
                x, y = np.rint(a + t * (b - a)).astype(int)
                assert grid[y][x] in ".GS", f"{answer.problem}: through ({x}, {y})"
    assert shorter > len(some) // 2


def test_the_summary_counts_the_answers(astar: list[Answer]) -> None:
    rows = summary(astar)
    assert rows[-1]["map"] == "all"
    assert rows[-1]["problems"] == rows[-1]["found"] == rows[-1]["optimal"] == len(astar)
    assert sum(r["problems"] for r in rows[:-1]) == len(astar)
