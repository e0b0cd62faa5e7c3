"""Decorators of BehaviorTree.CPP and of Nav2.

Sources of the rules: BehaviorTree.CPP 4.10 (src/decorators), Nav2 (nav2_behavior_tree/plugins/decorator).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from navstack.behavior_trees.blackboard import Port, StampedPose, inputs, outputs
from navstack.behavior_trees.errors import ScriptError
from navstack.behavior_trees.nodes import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Decorator,
    GoalWatch,
    Status,
    node,
)
from navstack.behavior_trees.scripts import Script
from navstack.core import Path

NANO: Final = 1_000_000_000


@node("Inverter")
class Inverter(Decorator):
    """SUCCESS for FAILURE and the other way round."""

    def tick(self) -> Status:
        """Tick the child."""
        self.status = RUNNING
        status = self.child.execute()
        if status is SUCCESS:
            self.reset_child()
            return FAILURE
        if status is FAILURE:
            self.reset_child()
            return SUCCESS
        return status


class _Force(Decorator):
    result: Status

    def tick(self) -> Status:
        """Tick the child."""
        self.status = RUNNING
        status = self.child.execute()
        if status is SUCCESS or status is FAILURE:
            self.reset_child()
            return self.result
        return status


@node("ForceSuccess")
class ForceSuccess(_Force):
    """SUCCESS when the child ends."""

    result = SUCCESS


@node("ForceFailure")
class ForceFailure(_Force):
    """FAILURE when the child ends."""

    result = FAILURE


@node("KeepRunningUntilFailure")
class KeepRunningUntilFailure(Decorator):
    """RUNNING until the child fails."""

    def tick(self) -> Status:
        """Tick the child."""
        self.status = RUNNING
        status = self.child.execute()
        if status is FAILURE or status is SUCCESS:
            self.reset_child()
        return FAILURE if status is FAILURE else RUNNING


class _Loop(Decorator):
    """The child again and again, until it returns `ends` or has run often enough."""

    __slots__ = ("count",)

    limit: str
    """Port of the limit; -1 is none."""
    ends: Status
    at_limit: Status

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def halt(self) -> None:
        """Count from 0."""
        self.count = 0
        super().halt()

    def tick(self) -> Status:
        """Tick the child, again in the same tick if it ends at once."""
        limit = self.integer(self.limit)
        self.status = RUNNING
        child = self.child
        while limit == -1 or self.count < limit:
            before = child.status
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            self.reset_child()
            if status is SKIPPED:
                return SKIPPED
            if status is self.ends:
                self.count = 0
                return status
            self.count += 1
            limit = self.integer(self.limit)
            if before is IDLE and (limit == -1 or self.count < limit) and self.tree.wake(self):
                return RUNNING
            self.tree.charge(self)
        self.count = 0
        return self.at_limit


@node("Repeat", ports=inputs(num_cycles="int!"))
class Repeat(_Loop):
    """SUCCESS after `num_cycles` successes of the child, FAILURE at its first failure."""

    limit, ends, at_limit = "num_cycles", FAILURE, SUCCESS


@node("RetryUntilSuccessful", "RetryUntilSuccesful", ports=inputs(num_attempts="int!"))
class RetryUntilSuccessful(_Loop):
    """SUCCESS at the first success of the child, FAILURE after `num_attempts` failures."""

    limit, ends, at_limit = "num_attempts", SUCCESS, FAILURE


@node("RunOnce", ports=inputs(then_skip=("bool", "true")))
class RunOnce(Decorator):
    """The child once, even across halts; afterwards SKIPPED, or its result with `then_skip` false."""

    __slots__ = ("result",)

    def __init__(self) -> None:
        super().__init__()
        self.result = IDLE

    def tick(self) -> Status:
        """Tick the child unless it has ended before."""
        if self.result is not IDLE:
            return SKIPPED if self.flag("then_skip", True) else self.result
        self.status = RUNNING
        status = self.child.execute()
        if status is SUCCESS or status is FAILURE:
            self.result = status
            self.reset_child()
        return status


@node("Delay", ports=inputs(delay_msec="unsigned!"))
class Delay(Decorator):
    """RUNNING for `delay_msec`, then the child."""

    __slots__ = ("due",)

    def __init__(self) -> None:
        super().__init__()
        self.due: int | None = None

    def halt(self) -> None:
        """Wait again."""
        self.due = None
        super().halt()

    def tick(self) -> Status:
        """Wait, then tick the child."""
        now = self.tree.now_ns
        if self.due is None:
            self.due = now + 1_000_000 * self.integer("delay_msec")
            self.status = RUNNING
        if now < self.due:
            return RUNNING
        status = self.child.execute()
        if status is SUCCESS or status is FAILURE:
            self.due = None
            self.reset_child()
        return status


@node("Timeout", ports=inputs(msec="unsigned!"))
class Timeout(Decorator):
    """FAILURE if the child still runs `msec` after its start; 0 is no limit."""

    __slots__ = ("due", "started")

    def __init__(self) -> None:
        super().__init__()
        self.due: int | None = None
        self.started = False

    def halt(self) -> None:
        """Forget the limit."""
        self.started = False
        self.due = None
        super().halt()

    def tick(self) -> Status:
        """Tick the child, or halt it after the limit."""
        now = self.tree.now_ns
        if not self.started:
            self.started = True
            self.status = RUNNING
            limit = self.integer("msec")
            self.due = now + 1_000_000 * limit if limit > 0 else None
        elif self.due is not None and now >= self.due:
            # C++ does this from a timer thread, between two ticks
            self.due = None
            if self.child.status is RUNNING:
                self.reset_child()
                self.started = False
                return FAILURE
        status = self.child.execute()
        if status is SUCCESS or status is FAILURE:
            self.started = False
            self.due = None
            self.reset_child()
        return status


_STATUSES: Final = {status.name: status for status in (RUNNING, SUCCESS, FAILURE, SKIPPED)}


@node("Precondition", ports=(Port("if", required=True), Port("else", default="FAILURE")))
class Precondition(Decorator):
    """The child if the script `if` is true, otherwise the status `else`."""

    __slots__ = ("other", "script")

    script: Script
    other: Status

    def setup(self) -> None:
        """Parse the script."""
        name = self.text("else")
        if name not in _STATUSES:
            raise self.failure(f'else is "{name}"; write one of {", ".join(_STATUSES)}')
        self.other = _STATUSES[name]
        try:
            self.script = Script(self.text("if"), self.tree.enums)
        except ScriptError as exc:
            raise self.failure(f'the script "{self.text("if"):.80}" is invalid: {exc}') from None

    def tick(self) -> Status:
        """Check, unless the child runs already."""
        if self.child.status is not RUNNING:
            try:
                if not self.script.is_true(self.blackboard):
                    return self.other
            except ScriptError as exc:
                raise self.failure(f"the script failed: {exc}") from None
        status = self.child.execute()
        if status is SUCCESS or status is FAILURE:
            self.reset_child()
        return status


class _Updated(Decorator):
    """The child if the entry has been written since the last time."""

    __slots__ = ("seen",)

    otherwise: Status

    def __init__(self) -> None:
        super().__init__()
        self.seen = 0

    def tick(self) -> Status:
        """Compare the number of writes."""
        child = self.child
        if child.status is not RUNNING:
            entry = self.inputs["entry"].entry
            if entry is None or entry.version == self.seen:
                return self.otherwise
            self.seen = entry.version
        return child.execute()


@node("SkipUnlessUpdated", ports=inputs(entry="any!"))
class SkipUnlessUpdated(_Updated):
    """SKIPPED unless the entry was written."""

    otherwise = SKIPPED


@node("WaitValueUpdate", ports=inputs(entry="any!"))
class WaitValueUpdate(_Updated):
    """RUNNING until the entry is written."""

    otherwise = RUNNING


@node("SubTree", "SubTreePlus")
class SubTree(Decorator):
    """Another tree, with a blackboard of its own."""

    def tick(self) -> Status:
        """Tick the tree."""
        if self.status is IDLE:
            self.status = RUNNING
        status = self.child.execute()
        if status is SUCCESS or status is FAILURE:
            self.reset_child()
        return status


# --- Nav2 --------------------------------------------------------------------------------------------------------------


def first_elapsed(period: float) -> int:
    """Return the least number of nanoseconds that Nav2's RateController takes for `period` (s): it compares in float32."""
    if not period > 0.0:
        return 0
    if not math.isfinite(period) or period > 1e9:
        return 2**62
    guess = int(period * NANO)
    low, high = max(0, guess - guess // 1_000_000 - 1000), guess + guess // 1_000_000 + 1000
    billion = np.float32(1e9)
    while low < high:
        middle = (low + high) // 2
        if float(np.float32(middle) / billion) >= period:
            high = middle
        else:
            low = middle + 1
    return low


@node("RateController", ports=inputs(hz=("double", "10.0")))
class RateController(Decorator):
    """The child at most `hz` times a second, counted from its last success; while it runs, in each tick."""

    __slots__ = ("first", "period", "period_of", "start")

    def __init__(self) -> None:
        super().__init__()
        self.first = False
        self.start = self.period = 0
        self.period_of = math.nan

    def tick(self) -> Status:
        """Tick the child if its time has come."""
        now = self.tree.now_ns
        if self.status is IDLE:
            hz = self.number("hz", 1.0)
            if hz != self.period_of:
                # ROS differs: C++ divides by 0
                self.period = first_elapsed(1.0 / hz if hz != 0.0 else math.inf)
                self.period_of = hz
            self.start = now
            self.first = True
        self.status = RUNNING
        child = self.child
        if self.first or child.status is RUNNING or now - self.start >= self.period:
            self.first = False
            status = child.execute()
            if status is SUCCESS:
                self.start = now
            return status
        return RUNNING


@node("DistanceController", ports=inputs(distance=("double", "1.0"), global_frame="string", robot_base_frame="string"))
class DistanceController(Decorator):
    """The child each time the robot is `distance` (m) from where it was at the last success."""

    __slots__ = ("base", "distance", "first", "frame", "start")

    def __init__(self) -> None:
        super().__init__()
        self.first = False
        self.distance = 1.0
        self.frame = self.base = ""
        self.start: StampedPose | None = None

    def setup(self) -> None:
        """Read the ports."""
        self.distance = self.number("distance", 1.0)
        self.frame, self.base = self.text("global_frame"), self.text("robot_base_frame")

    def tick(self) -> Status:
        """Tick the child if the robot has moved far enough."""
        pose = self.tree.robot_pose(self.frame, self.base)
        if pose is None:
            if self.status is not IDLE:
                self.status = RUNNING
            return FAILURE
        if self.status is IDLE:
            self.start = pose
            self.first = True
        self.status = RUNNING
        start, child = self.start, self.child
        assert start is not None
        if self.first or child.status is RUNNING or math.hypot(pose.x - start.x, pose.y - start.y) >= self.distance:
            self.first = False
            status = child.execute()
            if status is SUCCESS:
                self.start = pose
            return status
        return RUNNING


class _GoalDecorator(Decorator):
    """A decorator that sees when the goal changes."""

    PORTS = inputs(goal="pose", goals="poses")

    __slots__ = ("goals",)

    goals: GoalWatch

    def setup(self) -> None:
        """Connect to the goals."""
        self.goals = GoalWatch(self)


@node(
    "SpeedController",
    ports=inputs(
        min_rate=("double", "0.1"), max_rate=("double", "1.0"), min_speed=("double", "0.0"), max_speed=("double", "0.5")
    ),
)
class SpeedController(_GoalDecorator):
    """The child at a rate that is linear in the robot's speed."""

    __slots__ = ("first", "limits", "period", "start")

    def __init__(self) -> None:
        super().__init__()
        self.first = False
        self.period = 1.0
        self.start = 0
        self.limits = (0.1, 1.0, 0.0, 0.5)

    def setup(self) -> None:
        """Read the ports."""
        super().setup()
        self.limits = (
            self.number("min_rate", 0.1), self.number("max_rate", 1.0), self.number("min_speed"), self.number("max_speed", 0.5)
        )  # fmt: skip
        if min(self.limits[:2]) <= 0.0:
            raise self.failure(
                f"min_rate and max_rate are {self.limits[0]:g} and {self.limits[1]:g} Hz; set both above 0"
            )

    def _rate(self) -> float:
        low, high, slow, fast = self.limits
        velocity = self.tree.smoothed_velocity()
        speed = math.hypot(velocity.vx, velocity.vy)
        if fast == slow:  # ROS differs: C++ divides by 0
            return high if speed >= fast else low
        return max(min((speed - slow) / (fast - slow) * (high - low) + low, high), low)

    def tick(self) -> Status:
        """Tick the child if its time has come."""
        now = self.tree.now_ns
        is_new = self.goals.changed()
        if is_new or self.status is IDLE:
            self.period = 1.0 / self.limits[1]
            self.start = now
            self.first = True
        self.status = RUNNING
        is_due = (now - self.start) / NANO >= self.period
        if self.first or is_due or self.child.status is RUNNING:
            self.first = False
            if is_due:
                self.period = 1.0 / self._rate()
                self.start = now
            return self.child.execute()
        return RUNNING


@node("GoalUpdatedController")
class GoalUpdatedController(_GoalDecorator):
    """The child at the start and after each change of the goal."""

    __slots__ = ("updated",)

    def __init__(self) -> None:
        super().__init__()
        self.updated = False

    def tick(self) -> Status:
        """Tick the child if it runs or the goal is new."""
        is_new = self.goals.changed()
        if is_new or self.status is IDLE:
            self.updated = True
        self.status = RUNNING
        if self.updated or self.child.status is RUNNING:
            self.updated = False
            return self.child.execute()
        return RUNNING


@node(
    "GoalUpdater",
    ports=(*inputs(input_goal="pose", input_goals="poses"), *outputs(output_goal="pose", output_goals="poses")),
)
class GoalUpdater(Decorator):
    """Replaces the goal by the last one of the topic `goal_update` (`goals_update`), if that is not older."""

    def tick(self) -> Status:
        """Write the goals, then tick the child."""
        topics = self.tree.topics
        goal = self.get("input_goal")
        update = topics.get("goal_update")
        if isinstance(update, StampedPose) and update.stamp != 0.0:
            stamp = goal.stamp if isinstance(goal, StampedPose) else 0.0
            if update.stamp >= stamp:
                goal = update
        if goal is not None:
            self.outputs["output_goal"].set(goal)
        goals = self.get("input_goals")
        updates = topics.get("goals_update")
        if isinstance(updates, list) and updates:
            newest: list[StampedPose] = updates
            old = goals if isinstance(goals, list) else []
            if newest[0].stamp != 0.0 and newest[0].stamp >= (old[0].stamp if old else 0.0):
                goals = newest
        if goals is not None:
            self.outputs["output_goals"].set(goals)
        return self.child.execute()


@node("PathLongerOnApproach", ports=inputs(path="path", prox_len=("double", "3.0"), length_factor=("double", "2.0")))
class PathLongerOnApproach(Decorator):
    """The child if near the goal a new path to the same goal is much longer than the old one; otherwise SUCCESS."""

    __slots__ = ("first", "old")

    def __init__(self) -> None:
        super().__init__()
        self.first = True
        self.old: Path | None = None

    def tick(self) -> Status:
        """Compare the paths."""
        found = self.get("path")
        new = found if isinstance(found, Path) and len(found) else None
        old = self.old
        if old is None or new is None or tuple(old.poses[-1]) != tuple(new.poses[-1]):
            self.first = True
        self.status = RUNNING
        if not self.first and old is not None and new is not None and self._is_longer(new, old):
            status = self.child.execute()
            if status is SUCCESS or status is FAILURE:
                self.old = new
                self.reset_child()
            return status
        self.old = new
        self.first = False
        return SUCCESS

    def _is_longer(self, new: Path, old: Path) -> bool:
        # as in Nav2, a path counts as new if its number of poses is another one
        if new is old or len(new) == len(old):
            return False
        length = old.length
        return length < self.number("prox_len", 3.0) and new.length > self.number("length_factor", 2.0) * length


@node("SingleTrigger")
class SingleTrigger(Decorator):
    """The child once, then FAILURE until the node is reset."""

    __slots__ = ("first",)

    def __init__(self) -> None:
        super().__init__()
        self.first = True

    def tick(self) -> Status:
        """Tick the child for the first time, and while it runs."""
        if self.status is IDLE:
            self.first = True
        self.status = RUNNING
        if not self.first:
            return FAILURE
        status = self.child.execute()
        if status is SUCCESS or status is FAILURE:
            self.first = False
        return status
