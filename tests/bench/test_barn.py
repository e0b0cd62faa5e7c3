"""BARN's rules, on fields made for the purpose: who arrives, who touches, who runs out of time, and what it is worth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from navstack.bench.barn import BarnWorld, barn_configuration, load_worlds, run_world
from navstack.core.errors import InputError


@pytest.fixture(scope="module")
def jackal(data_dir: Path) -> Path:
    folder = data_dir / "params" / "jackal_barn"
    if not folder.is_dir():
        pytest.skip("no parameters of the Jackal here")
    return folder


def field(*discs: tuple[float, float, float]) -> BarnWorld:
    return BarnWorld(7, np.array(discs, np.float64).reshape(-1, 3), 10.0)


def test_an_open_field_is_crossed_at_full_speed_and_the_same_every_time(jackal: Path) -> None:
    configuration = barn_configuration(jackal)
    world = field((3.0, 5.0, 0.1))
    first, recorder = run_world(world, configuration)
    assert recorder is None
    assert first.outcome == "success" and first.world == 7
    # 0.1 m are free and the last metre is not driven
    assert first.time_s == pytest.approx((10.0 - 1.0 - 0.1) / 0.5, abs=0.5)
    assert first.length_m == pytest.approx(9.0, abs=0.1)
    assert first.score == pytest.approx(5.0 / first.time_s)
    assert 2.0 < first.clearance_m < 3.0
    assert run_world(world, configuration)[0] == first


def test_a_wall_without_a_way_round_is_no_success(jackal: Path) -> None:
    ring = [(0.8 * np.cos(a), 0.8 * np.sin(a), 0.06) for a in np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)]
    outcome, recorder = run_world(
        field(*ring),
        barn_configuration(jackal, overrides=["planner_patience=1.0", "controller_patience=1.0"]),
        record=True,
    )
    assert outcome.outcome == "aborted" and outcome.score == 0.0 and outcome.text
    assert outcome.time_s < 60.0 and outcome.length_m < 3.0
    assert recorder is not None and len(recorder.record().times) > 10


def test_the_score_is_cut_at_both_ends() -> None:
    world = field()
    assert world.optimal_time_s == 5.0
    assert world.score(1.0) == 0.5
    assert world.score(20.0) == 0.25
    assert world.score(99.0) == 0.125


def test_what_is_no_file_of_worlds(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="BARN"):
        load_worlds(tmp_path / "worlds.npz")
    np.savez(tmp_path / "worlds.npz", world=np.arange(3))
    with pytest.raises(InputError, match="BARN"):
        load_worlds(tmp_path / "worlds.npz")


def test_one_world_as_published(jackal: Path, data_dir: Path) -> None:
    """World 31: C++ took 19.2 s for 9.25 m."""
    worlds = {world.number: world for world in load_worlds(data_dir / "barn" / "worlds.npz")}
    assert len(worlds) == 50
    outcome, _ = run_world(worlds[31], barn_configuration(jackal))
    assert outcome.succeeded
    assert outcome.time_s == pytest.approx(19.22, rel=0.1)
    assert outcome.length_m == pytest.approx(9.25, rel=0.03)
