"""People who walk through a simulated world, by social forces; the same for the same seed and the same robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.sim import _crowd_kernels as kernels
from navstack.sim.shapes import PedestrianMotion, Shape
from navstack.sim.solids import Solids, discs_only

USUAL_SPEED: Final = (1.34, 0.26)
"""Mean and deviation of what pedestrians like to walk (m/s), after Helbing and Molnár."""
SLOWEST: Final = 0.5
"""Nobody who is drawn likes to walk slower (m/s)."""
SWAY: Final = 0.1
"""Deviation of accelerations without a reason (m/s² over a second); they end stand-offs."""
LONGEST_STEP: Final = 0.05
"""A longer step of the simulation is cut into equal ones no longer than this (s)."""


class Crowd:
    """The people of a world while one robot drives: where they are depends on where it was."""

    def __init__(self, shapes: Sequence[Shape], seed: int) -> None:
        """`shapes`: discs whose motion is that of pedestrians."""
        people = [(shape, shape.motion) for shape in shapes if isinstance(shape.motion, PedestrianMotion)]
        self._rng = np.random.Generator(np.random.PCG64([seed, 1 << 20]))
        drawn = USUAL_SPEED[0] + USUAL_SPEED[1] * self._rng.standard_normal(len(people))
        self._speeds = np.array(
            [
                max(speed, SLOWEST) if motion.speed is None else motion.speed
                for (_, motion), speed in zip(people, drawn.tolist(), strict=True)
            ]
        )
        self._bodies = np.array([shape.radius for shape, _ in people], np.float64)
        self._notices = np.array([motion.notices_robot for _, motion in people], np.bool_)
        self._goal_radii = np.array([motion.goal_radius for _, motion in people])
        self._pauses = np.array([motion.pause for _, motion in people])
        self._goals = np.array([goal for _, motion in people for goal in motion.goals], np.float64).reshape(-1, 2)
        self._first_goal = np.cumsum([0, *(len(motion.goals) for _, motion in people)], dtype=np.int64)
        self._tops = np.array([shape.top for shape, _ in people])
        self._people = np.zeros((len(people), 6))
        self._people[:, :2] = np.array([shape.pose[:2] for shape, _ in people], np.float64).reshape(-1, 2)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """(n, 2) m/s in the map."""
        return self._people[:, 2:4].copy()

    def solids(self) -> Solids:
        """The people as discs, now."""
        return discs_only(np.column_stack((self._people[:, :2], self._bodies)), self._tops)

    def step(
        self,
        dt: float,
        squares: NDArray[np.uint8],
        grid: NDArray[np.float64],
        solids: Solids,
        robot: NDArray[np.float64],
    ) -> None:
        """On by `dt` (s) among the map's walls (as `World` has them) and `solids`.

        `robot` = [x, y, vx, vy, radius] in the map (m, m/s).
        """
        parts = max(1, math.ceil(dt / LONGEST_STEP - 1e-9))
        for _ in range(parts):
            sway = self._rng.standard_normal((len(self._people), 2)) * (SWAY / math.sqrt(dt / parts))
            kernels.step_crowd(
                self._people,
                self._speeds,
                self._bodies,
                self._notices,
                self._goal_radii,
                self._pauses,
                self._goals,
                self._first_goal,
                squares,
                grid,
                solids,
                robot,
                sway,
                dt / parts,
            )
