"""Driving to a node of a route graph as far as the traffic control grants it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from navstack.core import NavError, Path, Pose2D, RobotState, Twist2D
from navstack.plugins import Behavior, BehaviorContext, BehaviorStatus, BehaviorStep, Plan

PATIENCE_S: Final = 2.5
"""Time without a command of the local planner after which the local costmap forgets its obstacles (s)."""
STARTING: Final = "waits for the first grant of the traffic control"
EXPIRED: Final = "has had no word from the traffic control, and its grant has ended"

PathOf = Callable[[tuple[int, ...], Pose2D | None], Path]
"""Returns the path along nodes (ids) from a pose on."""


class GuidedDrive(Behavior[None]):
    """Drives along the granted nodes, waits at the end of the grant, and is done at its goal.

    The local planner follows the path; what stands in the way makes it wait. What a robot that has passed left in the local
    costmap, where no beam clears it, would make it wait for ever: after PATIENCE_S the obstacles there are forgotten, as by
    move_base's conservative reset. What still is there is marked again.
    """

    def __init__(self, goal: int | None, target: Pose2D, path_of: PathOf, frame: str, name: str = "") -> None:
        """`goal`: id of the node; None: make way, as far as the first grant goes. `target`: where that is."""
        super().__init__(name or f"drive to node {goal}", None)
        self.goal = goal
        self.frame = frame
        self.target = target
        self.nodes: tuple[int, ...] = ()
        """The granted nodes."""
        self.until = math.inf
        """When the grant ends (s): the robot stands from then on, unless there is a later one."""
        self.reason = STARTING
        """Why it does not drive on; empty while it may drive."""
        self.blocked_since: float | None = None
        """Time from which the local planner has had no command (s)."""
        self.clears = 0
        """How often the obstacles of the local costmap were forgotten."""
        self._cleared_at = 0.0
        self.blocked_by = ""
        """Why the local planner has no command."""
        self._path_of = path_of
        self._changed = False
        self._plan: Plan | None = None
        self._context: BehaviorContext | None = None
        self._told = ""

    def grant(self, nodes: tuple[int, ...], reason: str, until: float = math.inf) -> None:
        """Take a grant: the nodes from the last one passed on, why it goes no farther, and when it ends (s)."""
        self._changed = self._changed or (nodes != self.nodes and nodes[-1:] != self.nodes[-1:])
        self.nodes, self.reason, self.until = nodes, reason, until

    def start(self, context: BehaviorContext, now: float) -> None:
        """Prepare the first step."""
        del now
        self._context, self._plan, self._told = context, None, ""
        self._changed = bool(self.nodes)
        self.reference = None
        context.local_planner.reset()

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Follow the granted path; stand at its end until there is more."""
        del state
        context = self._context
        assert context is not None and context.control_input is not None
        if now >= self.until:
            self.reason = EXPIRED
        self._tell(context, now)
        if now >= self.until:
            return BehaviorStep(BehaviorStatus.RUNNING, Twist2D())
        if self._changed:
            self._changed = False
            path = self._path_of(self.nodes, context.global_costmap.robot_pose(now))
            self._plan, self.reference = Plan(path, path.length, path[-1]), path
            context.local_planner.set_plan(path, path[-1])
        if self._plan is None:
            return BehaviorStep(BehaviorStatus.RUNNING)
        inputs = context.control_input(self._plan, now)
        if context.local_planner.goal_reached(inputs):
            if self.goal is None or self.nodes[-1:] == (self.goal,):
                return BehaviorStep(BehaviorStatus.DONE, text=f"{self.name}: there", data=self.describe())
            return BehaviorStep(BehaviorStatus.RUNNING)
        try:
            command = context.local_planner.compute_command(inputs)
        except NavError as error:
            self.local_plan, self.blocked_by = None, error.message
            if self.blocked_since is None:
                self.blocked_since = self._cleared_at = now
            elif now - self._cleared_at >= PATIENCE_S:
                self._clear(context, now, error)
            return BehaviorStep(BehaviorStatus.RUNNING, Twist2D())
        self.blocked_since, self.local_plan = None, command
        return BehaviorStep(BehaviorStatus.RUNNING, command.command)

    def _clear(self, context: BehaviorContext, now: float, error: NavError) -> None:
        self._cleared_at, self.clears = now, self.clears + 1
        cells = sum(layer.reset() for layer in context.local_costmap.layers if layer.clearable)
        context.inform(now, f"{self.name}: forgets {cells} cells of the local costmap, because {error.message}")

    def describe(self) -> dict[str, Any]:
        """Return the goal and the grant for the record."""
        return {"goal": self.goal, "granted": list(self.nodes), "reason": self.reason}

    def _tell(self, context: BehaviorContext, now: float) -> None:
        if self.reason != self._told:
            context.inform(now, f"{self.name}: {self.reason or 'drives on'}")
            self._told = self.reason
