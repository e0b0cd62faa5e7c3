"""Levels: splits, generated BARN worlds, paths, messages."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from navstack.core import InputError, Pose2D
from navstack.gym import Level, generated_barn_worlds, read_levels
from navstack.gym.levels import BARN_TOLERANCE_M, plan_path
from navstack.scenario import GOAL, START, shipped_scenarios
from navstack.sim import World


def test_generated_worlds_are_made_as_those_of_barn(data_dir: Path) -> None:
    """Extent, size and number of cylinders, against the published worlds."""
    generated = read_levels("barn", count=36)
    published = read_levels(data_dir / "barn")
    assert len(published) == 50
    for level in (*generated, *published):
        discs = level.world.solids_at(0.0).discs
        assert (discs[:, 2] == 0.075).all()
        assert discs[:, 0].min() == pytest.approx(-2.175, abs=1e-6) and discs[:, 1].max() == pytest.approx(
            6.525, abs=1e-6
        )
        assert discs[:, 1].min() == pytest.approx(-2.925, abs=1e-6)
        assert (level.start, level.goal, level.tolerance) == (START, GOAL, BARN_TOLERANCE_M)
        # no cylinder before the field but the walls
        assert (np.abs(discs[(discs[:, 1] < 2.1) & (discs[:, 1] > -2.9), 0]) > 2.1).all()
    counts = [np.array([len(level.world.solids_at(0.0).discs) for level in found]) for found in (generated, published)]
    # means of 36 and 50 worlds: within three standard errors
    error = math.sqrt(sum(c.var() / len(c) for c in counts))
    assert abs(counts[0].mean() - counts[1].mean()) < 3.0 * error


def test_the_splits_share_no_world_and_have_all_difficulties() -> None:
    train, held_out = (read_levels("barn", split=split, count=24) for split in ("train", "held_out"))
    assert {level.name for level in train}.isdisjoint(level.name for level in held_out)
    sizes = [sorted(len(level.world.solids_at(0.0).discs) for level in found) for found in (train, held_out)]
    assert all(found[0] < 230 and found[-1] > 320 for found in sizes)
    again = read_levels("barn", split="train", count=24)
    assert all((a.world.solids_at(0.0).discs == b.world.solids_at(0.0).discs).all() for a, b in zip(train, again))
    other = generated_barn_worlds([0], seed=1)[0]
    assert (
        len(other.discs) != len(train[0].world.solids_at(0.0).discs)
        or (other.discs != generated_barn_worlds([0])[0].discs).any()
    )


def test_a_path_keeps_its_distance_and_its_length_is_that_of_the_shortest() -> None:
    """Around a disc of 1 m: the shortest path of a disc of 0.2 m is two tangents and an arc."""
    world = World(None, [[2.0, 0.0, 1.0]])
    found = plan_path(world, Pose2D(0.0, 0.0), Pose2D(4.0, 0.0), 0.2)
    assert found is not None
    path, length = found
    radius, half = 1.2, 2.0
    tangent = math.sqrt(half * half - radius * radius)
    exact = 2.0 * tangent + radius * 2.0 * (math.pi / 2.0 - math.acos(radius / half))
    # steps in 8 directions: up to 8 % longer
    assert exact - 0.1 < length < 1.09 * exact
    clear = world.clearances(np.column_stack((path, np.zeros(len(path)))), None, world.solids_at(0.0))
    assert clear.min() >= 0.2 - 1e-9
    assert path[0].tolist() == [0.0, 0.0] and path[-1].tolist() == [4.0, 0.0]


def test_no_path_through_a_wall() -> None:
    wall = World(None, [[1.0, y, 0.3] for y in np.linspace(-3.0, 3.0, 31)])
    found = plan_path(wall, Pose2D(0.0, 0.0), Pose2D(2.0, 0.0), 0.2)
    assert found is None or found[1] > 6.0  # around the end of the wall


@pytest.mark.parametrize("source", ["office", "narrow", "map:office", next(iter(shipped_scenarios()))])
def test_sources_by_name(source: str) -> None:
    found = read_levels(source, count=2)
    assert found and all(level.length >= 0.9 * level.start.distance_to(level.goal) for level in found)
    assert all(level.spec is not None for level in found)


def test_a_list_adds_up() -> None:
    level = Level("mine", World(None), Pose2D(0.0, 0.0), Pose2D(1.0, 0.0))
    names = [found.name for found in read_levels(["barn", level], count=2, split="held_out")]
    assert names == ["world 1", "world 3", "mine"]


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        ("narow", {}, 'unknown levels "narow"; did you mean "narrow"'),
        ("barn", {"split": "tests"}, "known splits: train, held_out, all"),
        ("barn", {"count": 0}, "count is 0; it must be at least 1"),
        ([], {}, "has no level"),
        ("map:nowhere.yaml", {}, "nowhere.yaml"),
    ],
)
def test_wrong_levels(source: object, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        read_levels(source, **options)  # type: ignore[arg-type]
    assert message in caught.value.message


def test_a_message_lists_each_level_once() -> None:
    with pytest.raises(InputError) as caught:
        read_levels("zzzzz")
    known = caught.value.data["known"]
    assert "office" in known and len(known) == len(set(known))
