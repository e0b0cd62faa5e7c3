"""Searches that take long go on from the goal as well.

A search from the start may expand hundreds of thousands of states where the heuristic leads into a dead end, or where no path
enters the goal at all. From the goal, the same query often takes some hundred: either side of a narrow place may be the easy one,
and from a goal that cannot be entered the robot cannot leave, either.

The search from the goal is that from the start with both ends swapped and all headings turned around: along its path, driven the
other way round, the robot looks to where it came from.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from navstack.core import Window
from navstack.global_planner._se2 import search as kernels
from navstack.global_planner._se2.engine import UNLIMITED, PoseSearch
from navstack.global_planner._se2.primitives import PrimitiveTable
from navstack.global_planner._se2.search import Outcome, Pose, turned_around
from navstack.global_planner._se2.shape import Shape

FIRST: Final = 8192
"""States that the search from the start expands at least before that from the goal begins; then turns twice as long follow."""
PER_CELL: Final = 16
"""As many states per cell of the least way to the goal: a long way takes more of them although the search gets ahead."""
SHARE: Final = 4
"""Part of these states that the search from the goal may expand: 1 / SHARE."""
ENCLOSED: Final = 50_000
"""States after which the search from the start ends where the goal cannot be entered, and after which no other ends are tried."""
PARTS: Final = 3
"""Poses within the tolerance that are tried: so many steps from the goal, in position and heading."""


@dataclass(frozen=True)
class Motions:
    """What a planner supplies for a search from the goal."""

    table: Callable[[Shape, float, int], tuple[PrimitiveTable, int]]
    """Primitives and heading bin, for a footprint, a heading at the start, and a multiple of the usual number of headings."""
    heading_bin: Callable[[PrimitiveTable, float], int]
    finer: tuple[int, ...]
    """Multiples of the usual number of headings."""


class FromGoal:
    """The search from the goal, or, where the goal cannot be entered, from the poses within the tolerance, nearest first."""

    def __init__(self, forward: PoseSearch, start: Pose, goal: Pose, motions: Motions) -> None:
        self._engine, self._start, self._goal, self._motions = forward.turned_around(), start, goal, motions
        p = self._engine.settings
        self._tolerance, self._radius = float(p["tolerance"][0]), float(p["radius"][0])
        p["tolerance"], p["max_expansions"] = 0.0, UNLIMITED
        self._engine.set_goal(start[0], start[1], goal[:2], keep=False)
        self._ends = self._all_ends()
        self._end: Pose | None = None
        self.expanded = 0
        self.visited = 0
        self.goal_is_enclosed = False
        """Whether the goal itself cannot be reached from farther away, at least not with the usual headings."""
        self.is_exhausted = False
        """Whether no end can be reached from afar."""
        self.enclosed = 0.0
        """How far from the goal the poses are from which it can be reached (cells), if there are no others."""

    def _all_ends(self) -> Iterator[tuple[Pose, int]]:
        """Ends of the path, with multiples of the usual number of headings."""
        for finer in (1, *self._motions.finer):
            yield self._goal, finer
        if self._tolerance <= 0.0:
            return
        step, radius = self._tolerance / PARTS, self._radius
        apart = [
            (step * (math.hypot(i, j) + abs(k)), step * i, step * j, step / radius * k)
            for i in range(-PARTS, PARTS + 1)
            for j in range(-PARTS, PARTS + 1)
            for k in range(-PARTS, PARTS + 1)
        ]
        tried = self.expanded
        for distance, dx, dy, turn in sorted(apart)[1:]:
            if self.expanded - tried > ENCLOSED:
                return
            end = self._goal[0] + dx, self._goal[1] + dy, self._goal[2] + turn
            if distance <= self._tolerance and self._engine.pose_is_free(*_about(end)):
                yield end, 1

    def _begin(self) -> bool:
        """Begin at the next end; return False if there is none left."""
        end, finer = next(self._ends, (None, 1))
        if end is None:
            self.is_exhausted = True
            return False
        self._end = end
        first, last = _about(end), _about(self._start)
        table, start_bin = self._motions.table(self._engine.shape, first[2], finer)
        goals = np.array([[*last, self._motions.heading_bin(table, last[2])]])
        self._engine.begin(table, first, start_bin, goals)
        return True

    @property
    def window(self) -> Window:
        """Contains all cells that the search from the goal has read."""
        return self._engine.window

    @property
    def timed_out(self) -> bool:
        """Whether the time limit ended it."""
        return self._engine.timed_out

    def advance(self, states: int) -> int:
        """Expand at most so many states; return FOUND, PAUSED, EXHAUSTED, or LIMIT (time)."""
        upto = self.expanded + states
        while self.expanded < upto:
            if self._end is None and not self._begin():
                return kernels.EXHAUSTED
            p = self._engine.settings
            before = int(p["expanded"][0])
            status = self._engine.advance(before + upto - self.expanded)
            self.expanded += int(p["expanded"][0]) - before
            if status != kernels.EXHAUSTED:
                return status
            self.goal_is_enclosed = True
            if self._end == self._goal:
                self.enclosed = max(self.enclosed, self._engine.farthest_from(*self._goal[:2]))
            self._end, self.visited = None, self.visited + int(p["nodes"][0])
        return kernels.PAUSED

    def outcome(self, forward: PoseSearch, *, shorten: bool) -> Outcome:
        """The path that was found, from the start to the goal."""
        assert self._end is not None
        found = self._engine.outcome(kernels.FOUND, shorten=shorten)
        end = self._end
        forward.read_beside = self.window
        segments = turned_around(found.segments, found.end)
        if shorten:
            segments = forward.shortened(segments, end)
        status = kernels.FOUND if end == self._goal else kernels.APPROACHED
        return replace(found, status=status, segments=segments, end=end, cost=forward.cost_of(segments))


def _about(pose: Pose) -> Pose:
    """The pose with the opposite heading."""
    return pose[0], pose[1], pose[2] + math.pi


def search_both_ends(engine: PoseSearch, start: Pose, goal: Pose, motions: Motions, *, shorten: bool) -> Outcome:
    """Go on with the search that `engine` has begun; where it takes long, search from the goal in turns with it."""
    p, turn = engine.settings, max(FIRST, int(PER_CELL * min(engine.obstacle_cost(start[0], start[1]), 1e6)))
    most = int(p["max_expansions"][0])
    status = engine.advance(turn)
    if status != kernels.PAUSED:
        return engine.outcome(status, shorten=shorten)
    if p["best_cost"][0] == np.inf and not engine.may_connect(start):
        return replace(engine.outcome(kernels.EXHAUSTED, shorten=False), impossible=True)
    other = FromGoal(engine, start, goal, motions)
    left = most
    while status in (kernels.PAUSED, kernels.LIMIT):
        expanded, is_over = int(p["expanded"][0]), status == kernels.LIMIT
        left = most - expanded - other.expanded
        if p["best_cost"][0] == np.inf and not other.is_exhausted and not engine.timed_out:
            share = 1 if other.goal_is_enclosed else SHARE
            states = left if is_over else min(left, turn // share - other.expanded)
            if other.advance(states) == kernels.FOUND:
                found = other.outcome(engine, shorten=shorten)
                return replace(found, expanded=expanded + other.expanded, visited=int(p["nodes"][0]) + other.visited)
        if is_over:
            break
        p["max_expansions"] = min(most - other.expanded, ENCLOSED if other.goal_is_enclosed else UNLIMITED)
        turn *= 2
        status = engine.advance(turn)
    engine.read_beside = other.window
    engine.timed_out |= other.timed_out
    outcome = engine.outcome(status, shorten=shorten)
    if other.is_exhausted:
        final = (
            kernels.EXHAUSTED
            if outcome.status == kernels.LIMIT and left > 0 and not engine.timed_out
            else outcome.status
        )
        outcome = replace(outcome, status=final, enclosed=other.enclosed)
    return replace(outcome, expanded=outcome.expanded + other.expanded, visited=outcome.visited + other.visited)
