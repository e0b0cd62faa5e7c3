"""Random reachable pairs on the packaged maps and on published maps: every planner finds a path without collisions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, MapError, Pose2D
from navstack.core import Path as RobotPath
from navstack.map_io import load_map, map_names, map_path
from navstack.parameters import Configuration, load_configuration
from navstack.plugins import GLOBAL_PLANNERS, Plan
from navstack.studies import SEARCHING
from navstack.studies.planners import blocked_points, costmap_of, reachable_pairs, run_pairs
from tests.conftest import data_files

MAX_BYTES = 200_000
"""Maps with larger images are skipped to limit the test time."""


def small_maps() -> list[Path]:
    """YAML files of maps whose images are not too large."""
    files = [f for f in data_files("maps/*/*.yaml") if f.name != "INDEX.tsv"]
    return [f for f in files if sum(o.stat().st_size for o in f.parent.iterdir()) < MAX_BYTES]


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return load_configuration(["turtlebot"])


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize(
    "file",
    [*(map_path(n) for n in map_names()), *small_maps()],
    ids=lambda f: f"{f.parent.name}-{f.stem}",
)
def test_every_planner_connects_every_pair_without_collision(file: Path, configuration: Configuration) -> None:
    try:
        grid = load_map(file)
    except MapError as error:  # published with an image path of another machine
        assert "does not exist" in str(error)
        return
    costmap = costmap_of(configuration, grid)
    pairs = reachable_pairs(costmap, 2, seed=7)
    assert pairs or (costmap.data >= 253).all()
    planners = {name: GLOBAL_PLANNERS.get(name).cls(GLOBAL_PLANNERS.get(name).cls.Params()) for name in SEARCHING}
    results = run_pairs(planners, costmap, pairs)
    assert not [r for r in results if r.error is not None or r.blocked > 0]
    assert [r.planner for r in results] == [name for name in SEARCHING for _ in pairs]


def test_the_check_rejects_a_path_through_a_wall() -> None:
    costmap = Costmap(GridGeometry(10, 10, 0.1))
    costmap.data[:, 5] = 253
    path = RobotPath(np.array([[0.05, 0.05, 0.0], [0.95, 0.05, 0.0]]))
    plan = Plan(path, 0.0, Pose2D(0.95, 0.05))
    assert blocked_points(plan, costmap, corners=False) > 10
    costmap.data[:] = 0
    assert blocked_points(plan, costmap, corners=False) == 0
