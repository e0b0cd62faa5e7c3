"""A start where the robot does not fit, told without a kernel: the same answer as the simulated world's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Footprint, Pose2D
from navstack.scenario.file.start_check import collision_at_start
from navstack.sim import Shape, World
from tests.sim.worlds import random_map

OUTLINES = (
    Footprint.from_radius(0.2),
    Footprint(np.array([[0.5, 0.1], [-0.1, 0.2], [-0.3, 0.0], [-0.1, -0.2]])),
)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_what_the_world_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = random_map(seed, share=0.02)
    centre = grid.geometry.origin_x, grid.geometry.origin_y
    shapes = [
        Shape(radius=0.3, pose=[*(centre + rng.uniform(-3, 3, 2)).tolist(), 0.0]),
        Shape(name="box", box=[0.6, 0.2], pose=[*(centre + rng.uniform(-3, 3, 2)).tolist(), 1.0]),
    ]
    world = World(grid, shapes=shapes)
    answers: set[bool] = set()
    for outline in OUTLINES:
        for _ in range(150):
            x, y = (centre + rng.uniform(-5, 5, 2)).tolist()
            pose = Pose2D(x, y, float(rng.uniform(-math.pi, math.pi)))
            said = collision_at_start(outline, pose, grid, shapes)
            answers.add(said is None)
            assert (said is None) is world.is_free(outline, pose), (pose, said)
    assert answers == {True, False}
