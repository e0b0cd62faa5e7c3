"""Pedestrians in a simulated world, by social forces; the same for the same seed and the same robot motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.sim import _crowd_kernels as kernels
from navstack.sim.shapes import PedestrianMotion, Shape
from navstack.sim.solids import Solids, solids_from_discs

DESIRED_SPEED: Final = (1.34, 0.26)
"""Mean and standard deviation of the desired speed (m/s), after Helbing and Molnár."""
MIN_DESIRED_SPEED: Final = 0.5
"""Lower limit of random desired speeds (m/s)."""
SWAY: Final = 0.1
"""Standard deviation of random accelerations (m/s² over one second); they resolve deadlocks."""
MAX_STEP: Final = 0.05
"""Longer simulation steps are divided into equal steps of at most this length (s)."""


class Crowd:
    """The pedestrians of a world during one run; their motion depends on the robot's."""

    def __init__(self, shapes: Sequence[Shape], seed: int, before: Crowd | None = None) -> None:
        """`shapes`: discs with the motion of a pedestrian. Those that are also in the crowd `before` continue from there."""
        people = [(shape, shape.motion) for shape in shapes if isinstance(shape.motion, PedestrianMotion)]
        self._shapes = [shape for shape, _ in people]
        self._rng = np.random.Generator(np.random.PCG64([seed, 1 << 20])) if before is None else before._rng
        drawn = DESIRED_SPEED[0] + DESIRED_SPEED[1] * self._rng.standard_normal(len(people))
        self._settings = np.zeros(len(people), kernels.PEDESTRIAN)
        self._settings["speed"] = [
            max(speed, MIN_DESIRED_SPEED) if motion.speed is None else motion.speed
            for (_, motion), speed in zip(people, drawn.tolist(), strict=True)
        ]
        self._settings["radius"] = [shape.radius for shape, _ in people]
        self._settings["notices_robot"] = [motion.notices_robot for _, motion in people]
        self._settings["goal_radius"] = [motion.goal_radius for _, motion in people]
        self._settings["pause"] = [motion.pause for _, motion in people]
        counts = np.array([len(motion.goals) for _, motion in people], np.int64)
        self._settings["goals"] = counts
        self._settings["first_goal"] = np.cumsum(counts) - counts
        self._goals = np.array([goal for _, motion in people for goal in motion.goals], np.float64).reshape(-1, 2)
        self._tops = np.array([shape.top for shape, _ in people])
        self._people = np.zeros((len(people), 6))
        self._people[:, :2] = np.array([shape.pose[:2] for shape, _ in people], np.float64).reshape(-1, 2)
        if before is not None:
            self._continue(before)

    def _continue(self, before: Crowd) -> None:
        """Copies the state and the speed of the pedestrians that are in both crowds."""
        old = list(before._shapes)
        for row, shape in enumerate(self._shapes):
            if shape in old:
                was = old.index(shape)
                self._people[row] = before._people[was]
                self._settings["speed"][row] = before._settings["speed"][was]

    @property
    def velocities(self) -> NDArray[np.float64]:
        """(n, 2) velocities in the map (m/s)."""
        return self._people[:, 2:4].copy()

    def solids(self) -> Solids:
        """Returns the pedestrians as discs at the current time."""
        return solids_from_discs(np.column_stack((self._people[:, :2], self._settings["radius"])), self._tops)

    def step(
        self,
        dt: float,
        squares: NDArray[np.uint8],
        grid: NDArray[np.float64],
        solids: Solids,
        robot: NDArray[np.float64],
    ) -> None:
        """Advances by `dt` (s) among the map's walls (`World.squares`, `World.grid`) and `solids`.

        `robot` = [x, y, vx, vy, radius] in the map (m, m/s).
        """
        parts = max(1, math.ceil(dt / MAX_STEP - 1e-9))
        for _ in range(parts):
            sway = self._rng.standard_normal((len(self._people), 2)) * (SWAY / math.sqrt(dt / parts))
            kernels.step_crowd(
                self._people, self._settings, self._goals, squares, grid, solids.geometry, robot, sway, dt / parts
            )
