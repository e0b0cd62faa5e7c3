"""Several robots in one world, which advance together, in one compiled call for all bodies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import InputError, Pose2D
from navstack.sim.body import NEAREST_M, NEAREST_ROBOT, NEAREST_STEP, SAMPLE_SIZE, STATE, Outlines, drive_together
from navstack.sim.robot import SimulatedRobot
from navstack.sim.solids import Solids, pack_outlines, place_polygons

_HISTORY: Final = 256
"""Physics steps that are kept at first for robots that have not taken them over yet."""


class Nearest(NamedTuple):
    """The smallest distance of a robot from another one so far."""

    distance_m: float
    """Between the footprints; 0 in contact, inf without another robot."""
    robot: str
    time: float
    """s."""


class _Others(NamedTuple):
    """The part of `Lockstep._all_at` that contains the obstacles of one robot."""

    corners: slice
    circles: slice
    first: NDArray[np.int64]
    tops: NDArray[np.float64]


class Lockstep:
    """Robots in one world. In every physics step, each moves among the others as they were before the step.

    So their order does not matter. A robot takes over its steps when it is asked to (`catch_up`): its scans see the others where
    they were at the time of the scan. One robot alone moves as by `SimulatedRobot.advance_to`, to the bit.
    """

    def __init__(self, robots: Mapping[str, SimulatedRobot]) -> None:
        """`robots` by name, all new, in the same `World` and with the same `physics_frequency`.

        Raises InputError if they differ in it, if two of them overlap, or if pedestrians walk among several robots.
        """
        self.names = tuple(robots)
        self.robots = tuple(robots.values())
        first = self.robots[0]
        self.world, self._frequency = first.world, first.params.physics_frequency
        self._check()
        n = len(self.robots)
        self.step = 0
        """The physics step up to which all bodies have moved."""
        self._base = 0
        self._history = np.empty((n, _HISTORY, SAMPLE_SIZE))
        """Samples of the steps after `_base`."""
        self._taken = [0] * n
        self._hits = np.zeros(n, np.int64)
        corners, starts, centers = pack_outlines([robot.footprint.vertices for robot in self.robots])
        self._outlines = Outlines(corners, starts, centers)
        self._nearest: NDArray[np.float64] = np.tile([math.inf, -1.0, 0.0], (n, 1))
        still = self.world.solids_at(0.0)
        self._known = len(still.discs) + len(still.circles)
        self._others = [self._others_of(i, still) for i in range(n)]
        self._starts: NDArray[np.float64] = np.array([robot.pose for robot in self.robots], np.float64)
        self._fixed_yaws: NDArray[np.float64] = np.array([robot.fixed_yaw for robot in self.robots])
        self._placed: dict[int, tuple[Solids, NDArray[np.float64], NDArray[np.float64]]] = {}
        self._states = np.zeros(n, STATE)
        joined = [
            robot.join(self, self._states[i : i + 1], self.solids_of(i, 0)) for i, robot in enumerate(self.robots)
        ]
        self._settings = np.concatenate([settings for settings, _ in joined])
        self._noises = [noise for _, noise in joined]

    def _check(self) -> None:
        for name, robot in zip(self.names, self.robots, strict=True):
            if robot.world is not self.world:
                raise InputError(f"{name} is in another World; give all robots the same one", robot=name)
            if robot.params.physics_frequency != self._frequency:
                raise InputError(
                    f"{name} has navstack/sim/physics_frequency {robot.params.physics_frequency:g} Hz, and {self.names[0]} "
                    f"{self._frequency:g} Hz; give all robots of a world the same one",
                    robot=name,
                )
        if self.world.people:
            raise InputError("pedestrians walk among a single robot only; let them walk on tracks, or replay them")
        outlines = [shapely.Polygon(robot.footprint.at(robot.collision_pose)) for robot in self.robots]
        for (i, a), (j, b) in itertools.combinations(enumerate(outlines), 2):
            if a.intersects(b):
                raise InputError(
                    f"{self.names[i]} and {self.names[j]} overlap at their starts; move one of them",
                    robots=[self.names[i], self.names[j]],
                )

    @property
    def has_others(self) -> bool:
        """True with more than one robot."""
        return len(self.robots) > 1

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self.step / self._frequency

    def step_at(self, time: float) -> int:
        """Returns the first physics step at or after `time` (s), as `SimulatedRobot.step_at`."""
        return max(self.step, math.ceil(time * self._frequency - 1e-6))

    def advance_to(self, last: int) -> None:
        """Moves all bodies up to the physics step `last`."""
        while self.step < last:
            until = self.step + 1 if self.world.moves else last
            for robot in self.robots:
                until = min(until, robot.command_until(self.step, until))
            self._drive(until)
            if self.world.moves:
                self.catch_up()

    def _drive(self, until: int) -> None:
        steps, world = until - self.step, self.world
        errors = [noise.of(steps) for noise in self._noises]
        noise = np.zeros((len(errors), steps if any(len(each) for each in errors) else 0, 8))
        for row, each in zip(noise, errors, strict=True):
            if len(each):
                row[:] = each
        samples = np.empty((len(errors), steps, SAMPLE_SIZE))
        solids = world.solids_at(until / self._frequency).geometry
        fixed = self._states, self._settings, self._outlines, noise, world.squares, world.grid, solids
        self._hits += drive_together(*fixed, samples, self._nearest, self.step + 1)
        self._keep(samples)
        self.step = until

    def _keep(self, samples: NDArray[np.float64]) -> None:
        """Adds samples to the history, which begins where the last robot has caught up."""
        begin, end = self.step - self._base, self.step - self._base + samples.shape[1]
        if end > self._history.shape[1]:
            base = min(self._taken)
            kept = self._history[:, base - self._base : begin]
            begin, end = kept.shape[1], kept.shape[1] + samples.shape[1]
            size = max(2 * end, _HISTORY)
            history = np.empty((len(self.robots), size, SAMPLE_SIZE))
            history[:, :begin] = kept
            self._history, self._base = history, base
            self._placed.clear()
        self._history[:, begin:end] = samples

    def catch_up(self, number: int | None = None) -> None:
        """Lets a robot, or all of them, take over what their bodies have done: the frames, the measurements, the collisions."""
        for i in range(len(self.robots)) if number is None else (number,):
            taken = self._taken[i]
            if taken < self.step:
                samples = self._history[i, taken - self._base : self.step - self._base]
                self.robots[i].take_steps(samples, int(self._hits[i]), lambda step, i=i: self.solids_of(i, step))
                self._hits[i], self._taken[i] = 0, self.step

    @property
    def newest(self) -> NDArray[np.float64]:
        """(n, 9) samples of the robots after the last physics step, as `SimulatedRobot.advance_to` returns them."""
        return self._history[:, self.step - self._base - 1, :9].copy()

    # --- what a robot sees --------------------------------------------------------------------------------------------

    def poses_at(self, step: int) -> NDArray[np.float64]:
        """(n, 3) true poses in the map (m, rad) after a physics step that some robot has not taken over yet, or at the start."""
        return self._starts if step <= self._base and step == 0 else self._history[:, step - self._base - 1, :3]

    def _bodies_at(self, step: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the corners (m, 2) and bounding circles (n, 3) of all robots after a physics step."""
        poses = self.poses_at(step).copy()
        fixed = ~np.isnan(self._fixed_yaws)
        poses[fixed, 2] = self._fixed_yaws[fixed]
        return place_polygons(*self._outlines, poses)

    def _others_of(self, number: int, still: Solids) -> _Others:
        """Return where the obstacles of a robot are among the arrays of `_all_at`."""
        count = len(self.robots)
        sizes, tops = np.diff(self._outlines.first), [robot.params.body_height for robot in self.robots]
        heights = np.array([math.inf if top is None else top for top in tops], np.float64)
        lengths = np.concatenate((sizes, np.diff(still.first), sizes))
        chosen = slice(number + 1, count + len(still.circles) + number)
        begin = int(lengths[: chosen.start].sum())
        first = np.concatenate((np.zeros(1, np.int64), np.cumsum(lengths[chosen], dtype=np.int64)))
        return _Others(
            slice(begin, begin + int(first[-1])),
            chosen,
            first,
            np.concatenate((still.disc_tops, np.concatenate((heights, still.polygon_tops, heights))[chosen])),
        )

    def _all_at(self, step: int) -> tuple[Solids, NDArray[np.float64], NDArray[np.float64]]:
        """Return the solids of the world after a physics step; corners and circles of all robots, the world, and all robots.

        The obstacles of each robot are a part of them: the robots after it, the world, the robots before it.
        """
        placed = self._placed.get(step)
        if placed is None:
            still = self.world.solids_at(step / self._frequency)
            corners, circles = self._bodies_at(step)
            if len(self._placed) > _HISTORY:
                self._placed.clear()
            placed = self._placed[step] = (
                still,
                np.concatenate((corners, still.corners, corners)),
                np.concatenate((circles, still.circles, circles)),
            )
        return placed

    def solids_of(self, number: int, step: int) -> Solids:
        """Returns the obstacles of a robot after a physics step: the solids of the world, and the other robots."""
        if not self.has_others:
            return self.world.solids_at(step / self._frequency)
        still, corners, circles = self._all_at(step)
        others = self._others[number]
        return Solids(still.discs, circles[others.circles], corners[others.corners], others.first, others.tops)

    def polygon_name(self, robot: SimulatedRobot, k: int) -> str:
        """Return the name of polygon `k` of what a robot has around it: of a shape, or of another robot."""
        number, count = self.robots.index(robot), len(self.robots)
        place = number + 1 + k
        if place < count:
            return self.names[place]
        still = self._known - len(self.world.solids_at(0.0).discs)
        return (
            self.world.name_of("polygon", place - count) if place - count < still else self.names[place - count - still]
        )

    def robot_hit(self, hit: int, step: int) -> tuple[str, int, float, float] | None:
        """Return the name, the number and the position of the robot that a result of the kernel means; None for anything else."""
        number = -2 - hit - self._known
        if hit >= -1 or number < 0:
            return None
        x, y = self.poses_at(step)[number, :2].tolist() if step > self._base else self.robots[number].pose[:2]
        return self.names[number], number, x, y

    @property
    def poses(self) -> list[Pose2D]:
        """The true poses of all robots in the map (m, rad) now."""
        return [Pose2D(*row) for row in zip(*(self._states[name].tolist() for name in ("x", "y", "yaw")), strict=True)]

    def nearest(self, number: int) -> Nearest:
        """Returns how near a robot has come to another one, at any physics step."""
        row = self._nearest[number]
        other = int(row[NEAREST_ROBOT])
        name = "" if other < 0 else self.names[other]
        return Nearest(float(row[NEAREST_M]), name, float(row[NEAREST_STEP]) / self._frequency)
