"""The check of the start without kernels agrees with the simulated world."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Footprint, Pose2D
from navstack.scenario.spec import collision_at_start
from navstack.sim import Shape, World
from tests.sim.worlds import random_map

OUTLINES = (
    Footprint.from_radius(0.2),
    Footprint(np.array([[0.5, 0.1], [-0.1, 0.2], [-0.3, 0.0], [-0.1, -0.2]])),
)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_it_agrees_with_the_simulated_world(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = random_map(seed, share=0.02)
    center = grid.geometry.origin_x, grid.geometry.origin_y
    shapes = [
        Shape(radius=0.3, pose=[*(center + rng.uniform(-3, 3, 2)).tolist(), 0.0]),
        Shape(name="box", box=[0.6, 0.2], pose=[*(center + rng.uniform(-3, 3, 2)).tolist(), 1.0]),
    ]
    world = World(grid, shapes=shapes)
    answers: set[bool] = set()
    for outline in OUTLINES:
        for _ in range(150):
            x, y = (center + rng.uniform(-5, 5, 2)).tolist()
            pose = Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))
            found = collision_at_start(outline, pose, grid, shapes)
            answers.add(found is None)
            assert (found is None) is world.is_free(outline, pose), (pose, found)
    assert answers == {True, False}
