"""Suites: reproducible by name and number, with separate training and held-out splits."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from navstack.cli.app import run
from navstack.core import InputError
from navstack.scenario import ScenarioSpec, load_suite, random_maps, suite_names
from navstack.sim import PedestrianMotion


def contents(specs: list[ScenarioSpec]) -> list[object]:
    return [(s.name, s.start, s.goals, s.shapes, s.map().data.tobytes()) for s in specs]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["office", "narrow", "crowd", "warehouse", "circle_crossing"])
def test_a_suite_is_the_same_every_time_and_splits_by_number(name: str) -> None:
    whole = load_suite(name, count=6)
    assert contents(load_suite(name, count=6)) == contents(whole)
    train, held_out = load_suite(name, split="train", count=3), load_suite(name, split="held_out", count=3)
    assert contents(train) == contents(whole)[0::2] and contents(held_out) == contents(whole)[1::2]
    assert len({s.name for s in whole}) == 6
    assert len({s.start for s in whole}) > 1 or name == "circle_crossing"


def test_the_crossings_are_those_of_crowdnav() -> None:
    """500 cases; in each, people start apart near a circle of 4 m and walk through its center, and the robot across."""
    whole = load_suite("circle_crossing")
    assert len(whole) == 500
    assert len(load_suite("circle_crossing", split="held_out")) == 250
    for spec in whole[::25]:
        assert spec.start is not None
        ends = [(spec.start.x, spec.start.y), (spec.goals[0].x, spec.goals[0].y)]
        assert ends == [(0.0, -4.0), (0.0, 4.0)]
        assert len(spec.shapes) == 5
        for shape in spec.shapes:
            assert isinstance(shape.motion, PedestrianMotion)
            at, goal = shape.pose[:2], shape.motion.goals[0]
            assert goal == [-at[0], -at[1]]
            assert 4.0 - math.sqrt(0.5) <= math.hypot(*at) <= 4.0 + math.sqrt(0.5)
            assert min(math.dist(at, end) for end in ends) >= 0.8
            assert shape.motion.model == "orca"
            assert not shape.motion.notices_robot
            ends += [(at[0], at[1]), (goal[0], goal[1])]
    # the first draw of case 0: seed 1000
    angle, x, y = np.random.RandomState(1000).random_sample(3)
    expected = 4 * math.cos(angle * 2 * math.pi) + x - 0.5, 4 * math.sin(angle * 2 * math.pi) + y - 0.5
    assert tuple(whole[0].shapes[0].pose[:2]) == pytest.approx(expected)


@pytest.mark.slow
def test_barn_needs_a_directory(data_dir: Path) -> None:
    with pytest.raises(InputError, match=r"needs the folder of the BARN worlds"):
        load_suite("barn")
    folder = data_dir / "barn"
    if not folder.is_dir():
        pytest.skip("no BARN worlds here")
    train, held_out = (load_suite("barn", split=s, directory=folder) for s in ("train", "held_out"))
    assert len(train) == len(held_out) == 25
    assert not {s.name for s in train} & {s.name for s in held_out}
    built = train[0].build()
    assert built.start.yaw == 1.57 and built.goals[0].y == 10.0 and len(built.shapes) > 50


@pytest.mark.slow
def test_a_shipped_scenario_is_simulated_by_its_name(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "unreachable_goal", "--json", "--out", str(tmp_path)]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["success"] and document["goals"][0]["state"] == "ABORTED"


def test_unknown_suites_are_rejected() -> None:
    with pytest.raises(InputError, match=r'unknown suite "ofice"; did you mean "office"\?'):
        load_suite("ofice")
    with pytest.raises(InputError, match=r"count is 0; it must be at least 1"):
        load_suite("office", count=0)
    with pytest.raises(InputError, match=r'unknown split "test"; known splits: train, held_out, all'):
        load_suite("office", split="test")  # pyright: ignore[reportArgumentType]
    assert suite_names() == ["barn", "circle_crossing", "crowd", "narrow", "office", "shipped", "warehouse"]


@pytest.mark.parametrize("seed", range(30))
def test_rooms_and_mazes_are_connected_and_enclosed(seed: int) -> None:
    from scipy import ndimage

    rng = np.random.Generator(np.random.PCG64([seed, 1]))
    for grid in (
        random_maps.rooms(rng, rng.uniform(4, 10), rng.uniform(4, 10), (0.5, 1.0)),
        random_maps.maze(rng, rng.uniform(3, 8), rng.uniform(3, 8), rng.uniform(0.6, 1.3)),
    ):
        found: tuple[object, int] = ndimage.label(grid.data == 0)
        assert found[1] == 1
        assert (grid.data[[0, -1]] == 100).all() and (grid.data[:, [0, -1]] == 100).all()


def test_fields_and_caves_have_free_space_and_obstacles() -> None:
    rng = np.random.Generator(np.random.PCG64(5))
    for grid in (random_maps.discs(rng, 6.0, 5.0, 0.3, (0.1, 0.3)), random_maps.caves(rng, 6.0, 5.0, 0.25)):
        inner = grid.data[1:-1, 1:-1]
        assert 0.02 < (inner == 100).mean() < 0.6
