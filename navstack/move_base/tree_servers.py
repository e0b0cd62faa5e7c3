"""What a behavior tree acts on in the goal manager: Nav2's servers, made of its planner, its behaviors and its costmaps.

A server starts, is polled and canceled; it never waits. `MoveBase` runs them: `TreeMoveBase` calls `control` of the controller
and steps the behaviors in its cycles. Error codes are those of nav2_msgs.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np

from navstack.behavior_trees import Action, ActionState, ActionTicket, ServerAction, ServiceAction, StampedPose
from navstack.behaviors import (
    AssistedTeleop,
    AssistedTeleopParams,
    BackUp,
    BackUpParams,
    BehaviorEnd,
    DriveOnHeading,
    DriveOnHeadingParams,
    Spin,
    SpinParams,
    Wait,
    WaitParams,
)
from navstack.core import (
    INSCRIBED,
    Bounds,
    FrameError,
    InvalidPathError,
    NavError,
    NoValidPathError,
    Path,
    Pose2D,
    SensorData,
    Transform2D,
    Twist2D,
    footprint_cost,
)
from navstack.move_base import planning as plans
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.costmaps import CostmapUpdater, transform_tolerance
from navstack.move_base.events import EventPublisher
from navstack.move_base.output import CommandOutput
from navstack.move_base.planning import PlanAnswer, Planning, PlanRequest
from navstack.move_base.plugin_calls import call, checked_pose, checked_state, lookup_transform
from navstack.move_base.recovery import Recoveries
from navstack.move_base.states import NavState
from navstack.plugins import Behavior, BehaviorStatus, CostmapServer, GlobalPlanner, LocalPlanner, Plan, Robot

SMOOTHING_S: Final = 0.3
"""Odometry of this time (s) is averaged, as with bt_navigator's `filter_duration`."""
UNKNOWN_COST: Final = 255
LETHAL_COST: Final = 254

_PLANNERS: Final = {"compute_path_to_pose": 200, "compute_path_through_poses": 300}
"""Servers of the planner, with the first of their error codes."""
_BEHAVIORS: Final[dict[str, tuple[type[Behavior], type[Any], int]]] = {
    "spin": (Spin, SpinParams, 700),
    "backup": (BackUp, BackUpParams, 710),
    "back_up": (BackUp, BackUpParams, 710),
    "drive_on_heading": (DriveOnHeading, DriveOnHeadingParams, 720),
    "assisted_teleop": (AssistedTeleop, AssistedTeleopParams, 730),
    "wait": (Wait, WaitParams, 740),
}
"""Servers of behaviors: class, parameters, first of their error codes."""
_FOLLOW: Final = "follow_path"
_VALIDATE: Final = ("ValidatePath", "IsPathValid")
_OCCUPANCY: Final = ("CheckPoseOccupancy", "RemoveInCollisionGoals")
_SERVICES: Final = frozenset({*_VALIDATE, *_OCCUPANCY})
"""Services by the kinds of their nodes, besides those that clear costmaps."""
_TF_ERROR: Final = 2


class BehaviorServer(Protocol):
    """A further server of a tree, whose goals are behaviors: docking, which is above the goal manager."""

    def observe(self, scans: Sequence[SensorData]) -> None:
        """Take what the sensors have reported since the last tick, while a behavior of `make` runs."""
        ...

    def make(self, goal: Mapping[str, object]) -> Behavior:
        """Return a behavior for a goal. Raises NavError."""
        ...

    def code_of(self, error: NavError) -> int:
        """Return the code of Nav2's result for an error."""
        ...

    def result(self, behavior: Behavior) -> Mapping[str, object]:
        """Return the values of Nav2's result after a behavior of `make` has succeeded."""
        ...


class TaskServer(Protocol):
    """A further server of a tree whose goals do not move the robot. A new goal replaces the goal that runs; no call waits."""

    @property
    def first_code(self) -> int:
        """The first error code of its action, which means an unknown error."""
        ...

    def prepare(self) -> None:
        """Read what its goals need, before the first one. Raises NavError."""
        ...

    def start(self, goal: Mapping[str, object], now: float) -> Mapping[str, object] | None:
        """Start a goal at `now` (s). Return its result, None while it runs. Raises NavError."""
        ...

    def update(self, now: float) -> Mapping[str, object] | None:
        """Go on with the goal that runs. Return its result, None while it runs. Raises NavError."""
        ...

    def feedback(self) -> Mapping[str, object]:
        """Return the feedback of the goal that runs."""
        ...

    def stop(self) -> None:
        """End the goal that runs: it has a result or an error, or is canceled."""
        ...


class _StandardServer:
    """The server of one of Nav2's behaviors: its parameters are those of the configured behavior of the class."""

    def __init__(self, name: str, configured: Sequence[Behavior]) -> None:
        self._name, self._configured = name, configured
        self._class, self._model, self._first_code = _BEHAVIORS[name]

    def observe(self, scans: Sequence[SensorData]) -> None:
        """Do nothing: the behavior looks at the costmap."""

    def make(self, goal: Mapping[str, object]) -> Behavior:
        """Return the behavior with the values of the goal."""
        configured: list[Any] = [b.params for b in self._configured if type(b) is self._class]
        known = configured[0] if configured else self._model()
        given = {name: value for name, value in goal.items() if name in self._model.model_fields}
        try:
            return self._class(self._name, self._model.model_validate({**known.model_dump(), **given}))
        except ValueError as exc:
            text = str(exc).replace("\n", " ")
            raise NavError(f"{self._name} cannot run with {dict(goal)}: {text:.300}") from None

    def code_of(self, error: NavError) -> int:
        """Return the error's own code if it is of this behavior."""
        first = self._first_code
        if first <= error.code < first + 10:
            return error.code
        return first + (_TF_ERROR if isinstance(error, FrameError) else 0)

    def result(self, behavior: Behavior) -> Mapping[str, object]:
        """Return nothing."""
        del behavior
        return {}


def _task_code(task: TaskServer, error: NavError) -> int:
    """Return the code of Nav2's result for an error of a task."""
    first = task.first_code
    return error.code if first <= error.code < first + 100 else first


@dataclass(slots=True)
class _PlanJob:
    """A goal of the planner: the poses that are left, and the plans so far."""

    ticket: ActionTicket
    base: int
    left: deque[StampedPose]
    start: StampedPose | None
    plans: list[Plan] = field(default_factory=list[Plan])


class TreeServers:
    """The servers of one goal manager."""

    def __init__(
        self,
        robot: Robot,
        global_costmap: CostmapServer,
        local_costmap: CostmapServer,
        *,
        planning: Planning,
        costmaps: CostmapUpdater,
        output: CommandOutput,
        events: EventPublisher,
        recoveries: Recoveries,
        behaviors: Sequence[Behavior] = (),
        further: Mapping[str, BehaviorServer],
        tasks: Mapping[str, TaskServer],
    ) -> None:
        """`behaviors` whose parameters count besides those of the recoveries; `further` servers and `tasks` by name."""
        self.now = 0.0
        """Time of the cycle (s)."""
        self.goal: ActiveGoal | None = None
        self.global_planner: GlobalPlanner | None = None
        self.local_planner: LocalPlanner | None = None
        self.following: ActionTicket | None = None
        """The path that is followed."""
        self.plan: Plan | None = None
        """That path."""
        self.follow_started = False
        """True until the first control cycle of a new start of the controller."""
        self.errors: dict[int, NavError] = {}
        """The last error of each code."""
        self.last_code = 0
        """Code of the last error."""
        self.behavior_begins = False
        """True until the first step of a behavior."""
        self.parameters: dict[str, float] = {}
        """Parameters of bt_navigator."""
        self._robot = robot
        self._global_costmap = global_costmap
        self._local_costmap = local_costmap
        self._planning = planning
        self._costmaps = costmaps
        self._output = output
        self._events = events
        self._recoveries = recoveries
        self._job: _PlanJob | None = None
        self._moving: ActionTicket | None = None
        """The behavior that runs."""
        configured = [*recoveries.behaviors, *behaviors]
        self._movers: dict[str, BehaviorServer] = {name: _StandardServer(name, configured) for name in _BEHAVIORS}
        self._movers |= further
        self._tasks = dict(tasks)
        self._at_work: dict[str, ActionTicket] = {}
        """Goals of the tasks that run, by the name of the server."""
        self._moving_server: BehaviorServer | None = None
        self._is_recovery = False
        """True if the next goal or call is a recovery."""
        self._moving_as: int | None = None
        """Index of the behavior that runs among the recoveries of the goal; None if it is none."""
        self._velocities: deque[tuple[float, Twist2D]] = deque()
        self._pose_at = -math.inf
        self._pose: Pose2D | None = None

    # --- the cycle ----------------------------------------------------------------------------------------------------

    def begin(self, goal: ActiveGoal, now: float) -> None:
        """Begin a cycle at `now` (s): read the odometry, and end what was abandoned from outside."""
        self.goal, self.now = goal, now
        try:
            velocity = call(self._robot, self._robot.state, check=checked_state).velocity
        except NavError:
            velocity = Twist2D()
        self._velocities.append((now, velocity))
        while self._velocities[0][0] < now - SMOOTHING_S:
            self._velocities.popleft()
        if self._moving is not None and self._recoveries.running is None:
            self._fail_moving(NavError("the behavior was abandoned"))
        if self._job is not None and not self._planning.is_busy:
            self._fail_job(self._job, NavError("the plan request was abandoned"))
        for server in list(self._at_work):
            self._run_task(server, self._at_work[server], lambda task: task.update(now))

    def observe(self, scans: Sequence[SensorData]) -> None:
        """Pass on what the sensors have reported since the last tick to the server whose behavior runs."""
        if self._moving is not None and self._moving_server is not None:
            self._moving_server.observe(scans)

    def forget(self) -> None:
        """Drop all goals: the tree has been halted and its goal ended."""
        self.following = self.plan = self._moving = self._job = None
        for server in self._at_work:
            self._tasks[server].stop()
        self._at_work.clear()
        self.goal = None
        self.errors.clear()
        self.last_code = 0

    @property
    def is_moving(self) -> bool:
        """True while a behavior moves the robot."""
        return self._moving is not None

    def offers(self, item: Action) -> bool:
        """Return False for a node whose action server or service is none of these."""
        if isinstance(item, ServerAction):
            return (
                item.server == _FOLLOW
                or item.server in _PLANNERS
                or item.server in self._movers
                or item.server in self._tasks
            )
        return not isinstance(item, ServiceAction) or item.type.startswith("Clear") or item.type in _SERVICES

    def prepare(self, items: Iterable[Action]) -> list[NavError]:
        """Prepare the tasks that nodes ask for; return what keeps their goals from success."""
        found: list[NavError] = []
        for server in dict.fromkeys(item.server for item in items if isinstance(item, ServerAction)):
            try:
                if server in self._tasks:
                    self._tasks[server].prepare()
            except NavError as exc:
                found.append(exc)
        return found

    # --- Servers ------------------------------------------------------------------------------------------------------

    def send(self, server: str, goal: Mapping[str, object]) -> ActionTicket | None:
        """Start a goal; None for a server that navstack offers to no tree."""
        ticket = ActionTicket()
        if server in _PLANNERS:
            self._start_plan(ticket, server, goal)
        elif server == _FOLLOW:
            self._start_following(ticket, goal.get("path"))
        elif server in self._movers:
            self._start_behavior(ticket, server, goal)
        elif server in self._tasks:
            if server in self._at_work:
                self.cancel(self._at_work[server])
            self._run_task(server, ticket, lambda task: task.start(goal, self.now))
        else:
            self._events.warn(
                self.now,
                f'the behavior tree asks for the server "{server}", which navstack offers to no tree '
                "(docs/concepts/behavior_trees.md lists those that it offers)",
            )
            return None
        return ticket

    def poll(self, ticket: ActionTicket) -> ActionState:
        """Return the state of a goal."""
        return ticket.state

    def cancel(self, ticket: ActionTicket) -> None:
        """Cancel a goal; the robot stops."""
        if ticket.state is not ActionState.ACTIVE:
            return
        if ticket is self.following:
            self.following = self.plan = None
            self._output.stop_if_moving(self.now)
        elif ticket is self._moving:
            self._moving = None
            self._recoveries.runner.drop(self.now)
            self._output.stop_if_moving(self.now)
        elif self._job is not None and ticket is self._job.ticket:
            self._job = None
            self._planning.abandon()
        else:
            for server in [name for name, its in self._at_work.items() if its is ticket]:
                del self._at_work[server]
                self._tasks[server].stop()
        ticket.end(ActionState.CANCELED)

    def cancel_all(self, server: str) -> bool:
        """Cancel the goal of a server."""
        if server == _FOLLOW:
            ticket = self.following
        elif server in _PLANNERS:
            ticket = self._job.ticket if self._job is not None else None
        elif server in self._movers:
            ticket = self._moving
        elif server in self._tasks:
            ticket = self._at_work.get(server)
        else:
            return False
        if ticket is not None:
            self.cancel(ticket)
        return True

    def call(self, service: str, kind: str, request: Mapping[str, object]) -> Mapping[str, object] | None:
        """Call a service."""
        try:
            if kind.startswith("Clear"):
                return self._clear(service, kind, request)
            if kind in _VALIDATE:
                return self._validate(request)
            if kind in _OCCUPANCY:
                return self._costs(request)
        except NavError as exc:
            self._events.warn(self.now, exc.message, exc)
            return {"success": False, "message": exc.message}
        return None

    def recovers(self) -> None:
        """Count the next goal or call as a recovery of the goal."""
        self._is_recovery = True

    def _counted(self, name: str) -> int | None:
        """Return the index of a goal or call among the recoveries of the goal, of which it becomes one; None if it is none."""
        is_recovery, self._is_recovery = self._is_recovery, False
        if not is_recovery or self.goal is None:
            return None
        recoveries = self.goal.statistics.recoveries
        recoveries.append(name)
        return len(recoveries) - 1

    def robot_pose(self, frame: str, base_frame: str) -> StampedPose | None:
        """Return the robot's pose."""
        del base_frame
        if self._pose_at != self.now:
            self._pose_at = self.now
            costmap = self._global_costmap
            try:
                self._pose = call(costmap, costmap.robot_pose, self.now, check=checked_pose)
            except NavError:
                self._pose = None
        pose, own = self._pose, self._global_costmap.frame
        if pose is None:
            return None
        if frame and frame != own:
            try:
                pose = self._transform(frame, own).apply(pose)
            except NavError:
                return None
        return StampedPose(pose.x, pose.y, pose.yaw, frame or own, self.now)

    def velocity(self) -> Twist2D:
        """Return the velocity of the last odometry."""
        return self._velocities[-1][1] if self._velocities else Twist2D()

    def smoothed_velocity(self) -> Twist2D:
        """Return the mean velocity of the last 0.3 s."""
        found = [velocity for _, velocity in self._velocities] or [Twist2D()]
        vx, vy, wz = (sum(values) / len(found) for values in zip(*found, strict=True))
        return Twist2D(vx, vy, wz)

    def can_transform(self, child: str, parent: str) -> bool:
        """Return True if the transform is known."""
        try:
            self._transform(parent, child)
        except NavError:
            return False
        return True

    def parameter(self, name: str, default: float) -> float:
        """Return a parameter of bt_navigator."""
        return self.parameters.get(name, default)

    # --- planner ------------------------------------------------------------------------------------------------------

    def _start_plan(self, ticket: ActionTicket, server: str, goal: Mapping[str, object]) -> None:
        if self._job is not None:
            self.cancel(self._job.ticket)
        poses = goal.get("goals") if server == "compute_path_through_poses" else goal.get("viapoints")
        found: list[StampedPose] = list(poses) if isinstance(poses, list) else []
        end = goal.get("goal")
        if isinstance(end, StampedPose):
            found.append(end)
        start = goal.get("start")
        wanted = isinstance(start, StampedPose) and bool(goal.get("use_start", True))
        job = _PlanJob(
            ticket, _PLANNERS[server], deque(found), start if wanted and isinstance(start, StampedPose) else None
        )
        self._job = job
        if not found:
            self._fail_job(job, NoValidPathError("the tree asks for a path without a goal; write the entry first"))
        else:
            self._request(job)

    def _request(self, job: _PlanJob) -> None:
        """Request the path to the next pose."""
        costmap, planner, goal = self._global_costmap, self.global_planner, self.goal
        assert planner is not None and goal is not None
        if self._planning.is_busy:
            self._planning.abandon()
        try:
            if self._costmaps.global_error is not None:
                raise self._costmaps.global_error
            if job.plans:
                start = job.plans[-1].goal
            elif job.start is not None:
                start = self._in_costmap(job.start)
            else:
                start = call(costmap, costmap.robot_pose, self.now, check=checked_pose)
            end = self._in_costmap(job.left[0])
        except NavError as exc:
            self._fail_job(job, exc)
            return
        self._planning.request(
            PlanRequest(planner, costmap.master, start, end, costmap.footprint, goal.handle.id, self.now)
        )
        answer = self._planning.poll(self.now)
        if answer is not None:
            self.take_answer(answer)

    def take_answer(self, answer: PlanAnswer) -> None:
        """Take the planner's answer."""
        job = self._job
        if job is None:
            return
        if answer.plan is None:
            error = answer.error or NavError("the planner gave no reason")
            self._fail_job(job, plans.add_layer(self._global_costmap, error))
            return
        job.plans.append(answer.plan)
        job.left.popleft()
        if job.left:
            self._request(job)
            return
        self._job = None
        plan = answer.plan
        if len(job.plans) > 1:
            poses = np.vstack([part.path.poses for part in job.plans])
            plan = Plan(Path(poses, plan.path.frame), math.fsum(part.cost for part in job.plans), plan.goal)
        goal = self.goal
        assert goal is not None
        goal.statistics.plans += 1
        goal.plan = self._output.tick.plan = plan
        self._events.plan(self.now, plan)
        job.ticket.end(ActionState.SUCCEEDED, path=plan.path, last_reached_index=-1)

    def _fail_job(self, job: _PlanJob, error: NavError) -> None:
        self._job = None
        code = error.code if 200 <= error.code < 300 else 200 + (_TF_ERROR if isinstance(error, FrameError) else 0)
        goal = self.goal
        if goal is not None:
            goal.statistics.add_failed_plan(error, self.now)
        self._events.failure(self.now, "plan_failed", error)
        self.abort(job.ticket, code - 200 + job.base, error)

    # --- tasks --------------------------------------------------------------------------------------------------------

    def _run_task(
        self, server: str, ticket: ActionTicket, step: Callable[[TaskServer], Mapping[str, object] | None]
    ) -> None:
        """Start a goal of a task, or go on with it: it ends with a result or an error, or runs on with its feedback."""
        task = self._tasks[server]
        try:
            result = step(task)
            ticket.feedback = task.feedback()
        except NavError as exc:
            self._at_work.pop(server, None)
            task.stop()
            if self.goal is not None:
                self.goal.statistics.add_failure(exc, self.now)
            self.abort(ticket, _task_code(task, exc), exc)
            return
        if result is None:
            self._at_work[server] = ticket
            return
        self._at_work.pop(server, None)
        task.stop()
        ticket.end(ActionState.SUCCEEDED, 0, "", **result)

    # --- controller ---------------------------------------------------------------------------------------------------

    def _start_following(self, ticket: ActionTicket, path: object) -> None:
        goal, planner = self.goal, self.local_planner
        assert goal is not None and planner is not None
        if not isinstance(path, Path) or not len(path):
            self.following = self.plan = None
            self.abort(ticket, 103, InvalidPathError("the tree asks to follow an empty path"))
            return
        self.follow_started = self.follow_started or self.following is None
        plan = goal.plan
        if plan is None or plan.path is not path:
            plan = Plan(path, 0.0, path[-1])
        try:
            if not goal.has_plan:
                call(planner, planner.reset)
                goal.has_plan = True
            call(planner, planner.set_plan, plan.path, plan.goal)
        except NavError as exc:
            self.following = self.plan = None
            goal.statistics.add_failure(exc, self.now)
            self.abort(ticket, exc.code if 100 <= exc.code < 200 else 103, exc)
            return
        self.following, self.plan = ticket, plan

    def refresh_plan(self) -> None:
        """Pass the path to a local planner that has replaced the one before."""
        planner, plan, ticket = self.local_planner, self.plan, self.following
        if planner is None or plan is None or ticket is None:
            return
        try:
            call(planner, planner.reset)
            call(planner, planner.set_plan, plan.path, plan.goal)
        except NavError as exc:
            self.abort_following(103, exc)

    def abort_following(self, code: int, error: NavError) -> None:
        """End the path that is followed with an error."""
        ticket, self.following, self.plan = self.following, None, None
        if ticket is not None:
            self._output.stop_if_moving(self.now)
            self.abort(ticket, code, error)

    def finish_following(self) -> None:
        """End the path that is followed: its goal is reached."""
        ticket, self.following, self.plan = self.following, None, None
        if ticket is not None:
            self._output.stop_if_moving(self.now)
            ticket.end(ActionState.SUCCEEDED)

    def abort(self, ticket: ActionTicket, code: int, error: NavError) -> None:
        """End a goal with an error, and remember the error by its code."""
        self.errors[code] = error
        self.last_code = code
        ticket.end(ActionState.ABORTED, code, error.message)

    # --- behaviors ----------------------------------------------------------------------------------------------------

    def _start_behavior(self, ticket: ActionTicket, server: str, request: Mapping[str, object]) -> None:
        goal, recoveries = self.goal, self._recoveries
        assert goal is not None
        if self._moving is not None:
            self.cancel(self._moving)
        index, mover = self._counted(server), self._movers[server]
        try:
            behavior = mover.make(request)
        except NavError as exc:
            goal.statistics.add_failure(exc, self.now)
            self.abort(ticket, mover.code_of(exc), exc)
            return
        self._moving, self._moving_server, self._moving_as = ticket, mover, index
        end = recoveries.start(behavior, self.now)
        self.behavior_begins = end is None
        if end is not None:
            self.end_behavior(end)

    def publish_step(self, behavior: Behavior, status: BehaviorStatus, text: str, data: dict[str, Any]) -> None:
        """Publish a message of the behavior that runs: as a recovery if it is one."""
        if self._moving_as is None:
            self._events.publish(self.now, "info", text, {**data, "name": behavior.name, "status": status.value})
        else:
            self._publish_recovery((behavior.name, type(behavior).__name__), status, text, data, self._moving_as)

    def _publish_recovery(
        self, names: tuple[str, str], status: BehaviorStatus, text: str, data: dict[str, Any], index: int
    ) -> None:
        self._recoveries.publish_named(names, status, text, data, (index, 0), NavState().trigger, self.now)

    def end_behavior(self, end: BehaviorEnd) -> None:
        """Take the end of the behavior that runs."""
        self.publish_step(end.behavior, end.status, end.text or f"{end.behavior.name} ends", end.data)
        self._recoveries.runner.drop(self.now)
        error = end.error
        if error is not None:
            if self.goal is not None:
                self.goal.statistics.add_failure(error, self.now)
            self._fail_moving(error)
            return
        server = self._moving_server
        self._end_moving(ActionState.SUCCEEDED, result=server.result(end.behavior) if server is not None else {})

    def _fail_moving(self, error: NavError) -> None:
        server = self._moving_server
        code = server.code_of(error) if server is not None else error.code
        self.errors[code] = error
        self.last_code = code
        self._end_moving(ActionState.ABORTED, code, error.message)

    def _end_moving(
        self, state: ActionState, code: int = 0, message: str = "", result: Mapping[str, object] | None = None
    ) -> None:
        ticket, self._moving = self._moving, None
        self._output.stop_if_moving(self.now)
        if ticket is not None:
            ticket.end(state, code, message, **(result or {}))

    # --- costmaps -----------------------------------------------------------------------------------------------------

    def _clear(self, service: str, kind: str, request: Mapping[str, object]) -> dict[str, object]:
        costmap = self._local_costmap if "local" in service.split("/")[0] else self._global_costmap
        names = request.get("plugins")
        wanted: list[str] | None = names if isinstance(names, list) and names else None
        layers = [
            layer
            for layer in costmap.layers
            if (layer.clearable if wanted is None else layer.name.rsplit("/", 1)[-1] in wanted)
        ]
        if wanted is not None and not layers:
            return {"success": False, "message": f"{costmap.name} has none of the layers {', '.join(wanted)}"}
        if kind == "ClearEntireCostmap":
            cells = (
                call(costmap, costmap.reset) if wanted is None else sum(call(layer, layer.reset) for layer in layers)
            )
        else:
            size = request.get("reset_distance", 1.0)
            half = 0.5 * float(size) if isinstance(size, (int, float)) else 0.5
            given = request.get("pose")
            at = (
                self._in_costmap(given, costmap)
                if isinstance(given, StampedPose)
                else call(costmap, costmap.robot_pose, self.now, check=checked_pose)
            )
            square = Bounds(at.x, at.y, at.x, at.y).grown(half)
            invert = kind == "ClearCostmapExceptRegion"
            reset: Callable[..., int]
            cells = 0
            for layer in layers:
                reset = layer.reset
                cells += call(layer, lambda reset=reset: reset(square, invert=invert))
        name = f"clear {costmap.name}"
        index = self._counted(name)
        # Nav2 updates the costmap in its own thread before the next plan; here the plan may follow at once
        call(costmap, costmap.update, self.now)
        if index is not None:
            text = f"the behavior tree cleared {costmap.name}"
            self._publish_recovery((name, kind), BehaviorStatus.DONE, text, {"cells_cleared": cells}, index)
        return {"success": True}

    def _validate(self, request: Mapping[str, object]) -> dict[str, object]:
        """Check the poses of a path from the one nearest to the robot, in the global costmap."""
        path, pose = request.get("path"), self.robot_pose("", "")
        if not isinstance(path, Path) or not len(path) or pose is None:
            return {"success": True, "is_valid": False, "invalid_pose_indices": []}
        poses = path.poses
        if path.frame != self._global_costmap.frame:
            poses = self._transform(self._global_costmap.frame, path.frame).apply_poses(poses)
        first = int(np.argmin(np.hypot(poses[:, 0] - pose.x, poses[:, 1] - pose.y)))
        max_cost, ahead = request.get("max_cost", LETHAL_COST), request.get("max_lookahead_distance", -1.0)
        last = len(poses)
        if isinstance(ahead, (int, float)) and ahead >= 0.0:
            driven = np.cumsum(np.hypot(np.diff(poses[first:, 0]), np.diff(poses[first:, 1])))
            last = first + 1 + int(np.searchsorted(driven, float(ahead), side="right"))
        limit = max_cost if isinstance(max_cost, int) else LETHAL_COST
        unknown = bool(request.get("consider_unknown_as_obstacle", False))
        invalid: list[int] = []
        for index in range(first, last):
            cost = pose_cost(self._global_costmap, Pose2D(*map(float, poses[index])), use_footprint=True)
            if cost is None or (unknown if cost == UNKNOWN_COST else cost >= limit):
                invalid.append(index)
                if request.get("stop_at_first_collision", True):
                    break
        return {"success": True, "is_valid": not invalid, "invalid_pose_indices": invalid}

    def _costs(self, request: Mapping[str, object]) -> dict[str, object]:
        poses = request.get("poses")
        costs: list[float] = []
        given: list[object] = list(poses) if isinstance(poses, list) else []
        for pose in given:
            if not isinstance(pose, StampedPose):
                return {"success": False, "message": "a pose is missing"}
            is_whole = bool(request.get("use_footprint", True))
            cost = pose_cost(self._global_costmap, self._in_costmap(pose), use_footprint=is_whole)
            if cost is None:
                return {"success": False, "message": "a pose is outside the costmap"}
            costs.append(float(cost))
        return {"success": True, "costs": costs}

    # --- frames -------------------------------------------------------------------------------------------------------

    def _transform(self, target: str, source: str) -> Transform2D:
        return lookup_transform(self._robot, target, source, self.now, transform_tolerance(self._global_costmap))

    def _in_costmap(self, pose: StampedPose, costmap: CostmapServer | None = None) -> Pose2D:
        frame = (costmap or self._global_costmap).frame
        return pose.pose if pose.frame in ("", frame) else self._transform(frame, pose.frame).apply(pose.pose)


def pose_cost(costmap: CostmapServer, pose: Pose2D, *, use_footprint: bool) -> int | None:
    """Return the cost of a pose in the frame of a costmap, as Nav2's services do; None outside.

    A round robot that touches an obstacle has a lethal one.
    """
    master = costmap.master
    geometry = master.geometry
    cell = geometry.world_to_cell(pose.x, pose.y)
    if cell is None or not geometry.contains_cell(*cell):
        return None
    cost = int(master.data[cell[1], cell[0]])
    if cost == INSCRIBED:
        return LETHAL_COST if use_footprint else cost
    if not use_footprint or cost >= INSCRIBED:
        return cost
    found = footprint_cost(master, costmap.footprint, pose, interior=False)
    return LETHAL_COST if found is not None and found == LETHAL_COST else cost
