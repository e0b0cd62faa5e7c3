"""What the actions of Nav2 do: drives, motions, and plans; each begins, is updated in every turn of the loop, and ends once."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from pydantic import ValidationError

from navstack.behavior_trees import BehaviorTreeError
from navstack.behaviors import (
    AssistedTeleop,
    AssistedTeleopParams,
    BackUp,
    BackUpParams,
    DriveOnHeading,
    DriveOnHeadingParams,
    Spin,
    SpinParams,
    Wait,
    WaitParams,
)
from navstack.bringup import FollowPath, PoseSequence, TargetPose, TaskResult
from navstack.core import CollisionAheadError, FrameError, InputError, NavError, ParameterError, Path, Pose2D
from navstack.move_base import GoalStatus, MotionHandle, MoveBase, TreeMoveBase
from navstack.plugins import Behavior, ParamModel
from navstack.ros_messages import MessageBuilder, time_ns
from navstack.ros_messages import messages as msg

M = TypeVar("M", bound=ParamModel)
SUCCEEDED, CANCELED, ABORTED = "succeeded", "canceled", "aborted"
NAVIGATION_CODES: Final = range(9000, 9004)
"""Codes of Nav2's navigators; codes of planners and controllers pass through them."""
UNKNOWN: Final = 0
TIMEOUT: Final = 1
TF_ERROR: Final = 2
"""What the codes of every action begin with, counted from its first one."""


class Outcome(NamedTuple):
    """How a task ended."""

    status: str
    code: int = 0
    """Of the result of the action."""
    text: str = ""


def outcome_of(status: GoalStatus, code: int, text: str) -> Outcome:
    """Return the end of a goal or a motion."""
    if status is GoalStatus.SUCCEEDED:
        return Outcome(SUCCEEDED)
    return Outcome(CANCELED if status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED) else ABORTED, code, text)


class Codes(NamedTuple):
    """The numbers of an action's errors: `first` is the one of an unknown cause."""

    first: int
    collision: int = 0
    """Counted from the first; 0: the action has none."""
    invalid: int = 0
    passed: range = range(0)
    """Codes of parts that go through, as those of planners through a navigator."""

    def of(self, error: NavError) -> int:
        """Return the number of an error."""
        code = error.code
        if self.first == 300 and 200 <= code < 210:
            code += 100  # a planner's codes are those of ComputePathToPose
        if code in range(self.first, self.first + 10):
            return code
        if isinstance(error, FrameError):
            return self.first + TF_ERROR
        if error.name in ("TIMEOUT", "GOAL_TIME_LIMIT") and code >= 9000:
            return self.first + TIMEOUT
        if self.collision and isinstance(error, CollisionAheadError):
            return self.first + self.collision
        if self.invalid and isinstance(error, (InputError, ParameterError)):
            return self.first + self.invalid
        return code if code in self.passed else self.first


NAVIGATOR: Final = Codes(9000, passed=range(100, 1000))
NAVIGATOR_THROUGH: Final = Codes(9100, passed=range(100, 1000))
CONTROLLER: Final = Codes(100)
PLANNER: Final = Codes(200)
PLANNER_THROUGH: Final = Codes(300)
SMOOTHER: Final = Codes(500)
WAYPOINTS: Final = Codes(600)
SPIN: Final = Codes(700, collision=3)
BACK_UP: Final = Codes(710, invalid=3, collision=4)
DRIVE: Final = Codes(720, collision=3, invalid=4)
TELEOP: Final = Codes(730)
WAIT: Final = Codes(740)


FEEDBACK_S: Final = 0.1
"""Time between two messages of feedback (s)."""


class Task(ABC):
    """One goal of an action, in the thread of the node. `goal` is its message."""

    codes: Codes
    takes_over = False
    """True for a task that needs no wait for the end of another one."""
    is_aside = False
    """True for a task that does not move the robot: it runs besides the one that does."""
    feedback_s = FEEDBACK_S
    """Time between two messages of feedback (s)."""

    def __init__(self, goal: Any, move_base: MoveBase, build: MessageBuilder) -> None:
        self.goal, self.move_base, self.build = goal, move_base, build
        self.started_at = 0.0

    @property
    def drives(self) -> bool:
        """True while the task has a goal of the goal manager; no motion can begin then."""
        return self.takes_over

    def refusal(self, running: Task) -> str:
        """Return why this task cannot take over from a running one; empty if it can."""
        del running
        return ""

    @abstractmethod
    def begin(self, now: float) -> None:
        """Start. Raises a NavError, and the goal is aborted."""

    @abstractmethod
    def update(self, now: float) -> Outcome | None:
        """Return the end, None before it."""

    @abstractmethod
    def cancel(self) -> None:
        """Stop; the end follows."""

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill a message of feedback; return False without any."""
        del message, now, stamp_ns
        return False

    def fill(self, result: Any, now: float) -> None:  # noqa: B027
        """Fill the fields of the result besides code and text."""


def target_of(pose: Any) -> TargetPose:
    """Return the target of a PoseStamped; its frame and rotation are checked where it is used."""
    at, q = pose.pose.position, pose.pose.orientation
    frame = msg.clean_frame(pose.header.frame_id) or None
    return TargetPose(Pose2D(float(at.x), float(at.y), 0.0), frame, (float(q.x), float(q.y), float(q.z), float(q.w)))


# --- drives -----------------------------------------------------------------------------------------------------------


class DriveTask(Task):
    """NavigateToPose, NavigateThroughPoses and FollowWaypoints."""

    codes = NAVIGATOR
    takes_over = True
    through = True
    stop_on_failure = True
    default_tree = ""
    """The behavior tree of a goal that names none; empty: the states of move_base drive it."""

    def __init__(self, goal: Any, move_base: MoveBase, build: MessageBuilder) -> None:
        super().__init__(goal, move_base, build)
        self.drive: PoseSequence | None = None
        self.first = self.loops = 0
        self.is_canceled = False

    def poses(self) -> list[Any]:
        """Return the poses (PoseStamped) of the goal."""
        return [self.goal.pose]

    @property
    def tree(self) -> str:
        """The file, or the name of a packaged one, of the behavior tree of the goal."""
        return str(getattr(self.goal, "behavior_tree", "")) or self.default_tree

    def refusal(self, running: Task) -> str:
        """Refuse to replace a drive of another behavior tree, as Nav2: its tree would have to be ended first."""
        if not isinstance(running, DriveTask) or running.tree == self.tree:
            return ""
        return (
            f'the running goal is driven by the behavior tree "{running.tree}", this one names "{self.tree}"; '
            "cancel the running goal first"
        )

    def _load_tree(self) -> None:
        """Let the goal manager drive by the tree of this goal. Raises TreeNotLoadedError."""
        move_base = self.move_base
        assert isinstance(move_base, TreeMoveBase)
        try:
            move_base.drive_by(self.tree)
        except BehaviorTreeError as exc:
            raise TreeNotLoadedError(exc.message, code=self.codes.first + 1) from exc

    def _check_frames(self, poses: list[Any]) -> None:
        """Raise FrameError for a pose whose frame has no transform, as Nav2's navigators do before they drive."""
        to = self.move_base.global_costmap.frame
        for frame in {msg.frame_of(pose) for pose in poses} - {"", to}:
            self.move_base.robot.frames.lookup(to, frame)

    def begin(self, now: float) -> None:
        """Send the first pose."""
        poses = self.poses()
        if not poses:
            raise InputError("the goal has no poses; give at least one")
        if self.through:  # waypoints are missed one by one
            self._check_frames(poses)
        self._load_tree()
        self.started_at = now
        self.drive = PoseSequence(
            self.move_base,
            [target_of(pose) for pose in poses],
            through=self.through,
            stop_on_failure=self.stop_on_failure,
            first=self.first,
            loops=self.loops,
            now=now,
        )

    def update(self, now: float) -> Outcome | None:
        """Go on to the next pose."""
        drive = self.drive
        assert drive is not None
        drive.update(now)
        if drive.result is None:
            return None
        code, text = drive.error
        return self.outcome(drive, drive.result, code, text)

    def outcome(self, drive: PoseSequence, result: TaskResult, code: int, text: str) -> Outcome:
        """Return the end of the drive."""
        if result is TaskResult.SUCCEEDED:
            return Outcome(SUCCEEDED)
        found = Outcome(CANCELED if result is TaskResult.CANCELED and self.is_canceled else ABORTED)
        return found if found.status == CANCELED else found._replace(code=self.code_of(code, drive), text=text)

    def code_of(self, code: int, drive: PoseSequence) -> int:
        """Return the code of the action for one of a goal's result."""
        error = drive.handle.result.data.get("error") or {}
        name = str(error.get("error_name", error.get("name", "")))
        if name in ("GOAL_TIME_LIMIT",):
            return self.codes.first + 3
        if code == FrameError.code:
            return self.codes.first + 2
        return code if code in self.codes.passed else self.codes.first

    def cancel(self) -> None:
        """Cancel the goal."""
        self.is_canceled = True
        if self.drive is not None:
            self.drive.cancel()

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the pose, the times and the distance."""
        drive, move_base = self.drive, self.move_base
        if drive is None or move_base.robot_pose is None:
            return False
        build, seen = self.build, move_base.feedback
        left, time_left = drive.remaining()
        frame = move_base.global_costmap.frame
        message.current_pose = build.pose_stamped(stamp_ns, frame, move_base.robot_pose)
        message.navigation_time = duration(build, now - self.started_at)
        message.estimated_time_remaining = duration(build, time_left or 0.0)
        message.distance_remaining = float(left) if math.isfinite(left) else 0.0
        message.number_of_recoveries = drive.past_recoveries + seen.recoveries
        if hasattr(message, "number_of_poses_remaining"):
            message.number_of_poses_remaining = len(drive.targets) - drive.index
        if hasattr(message, "waypoint_statuses"):
            message.waypoint_statuses = self.statuses()
        return True

    def statuses(self) -> list[Any]:
        """Return nav2_msgs/WaypointStatus of each pose."""
        drive = self.drive
        found: list[Any] = []
        if drive is None:
            return found
        missed = {report.waypoint_index: report for report in drive.missed}
        done = drive.result is TaskResult.SUCCEEDED
        for index, pose in enumerate(self.poses()):
            lost = missed.get(index)
            reached = index < drive.index or done
            found.append(
                self.build.of(
                    "nav2_msgs/msg/WaypointStatus",
                    waypoint_status=3 if lost else 1 if reached else 0,
                    waypoint_index=index,
                    waypoint_pose=pose,
                    error_code=self.code_of(lost.error_code, drive) if lost else 0,
                    error_msg=lost.error_msg if lost else "",
                )
            )
        return found

    def fill(self, result: Any, now: float) -> None:
        """Fill the statuses of the poses, where the distribution has them."""
        if hasattr(result, "waypoint_statuses"):
            result.waypoint_statuses = self.statuses()


class ThroughTask(DriveTask):
    """NavigateThroughPoses."""

    codes = NAVIGATOR_THROUGH

    def poses(self) -> list[Any]:
        """Return the poses: a list, or nav_msgs/Goals."""
        return list(getattr(self.goal.poses, "goals", self.goal.poses))


class WaypointsTask(DriveTask):
    """FollowWaypoints; `stop_on_failure` is that of Nav2's waypoint_follower."""

    codes = WAYPOINTS
    through = False

    def poses(self) -> list[Any]:
        """Return the waypoints."""
        return list(self.goal.poses)

    def begin(self, now: float) -> None:
        """Send the first waypoint."""
        if not self.goal.poses:
            raise InvalidChoiceError("the goal has no poses; give at least one", code=self.codes.first + 2)
        self.first = int(getattr(self.goal, "goal_index", 0))
        if not 0 <= self.first < len(self.goal.poses):
            raise InputError(f"goal_index {self.first} is not an index of the {len(self.goal.poses)} poses")
        self.loops = int(getattr(self.goal, "number_of_loops", 0))
        super().begin(now)

    def outcome(self, drive: PoseSequence, result: TaskResult, code: int, text: str) -> Outcome:
        """Return the end; as in Nav2, waypoints that were missed are no failure unless stop_on_failure is set."""
        if result is TaskResult.FAILED and not self.stop_on_failure:
            return Outcome(SUCCEEDED)
        found = super().outcome(drive, result, code, text)
        return found._replace(code=self.codes.first + 3) if result is TaskResult.FAILED else found

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the index of the current waypoint."""
        if self.drive is None:
            return False
        message.current_waypoint = self.drive.index
        return True

    def fill(self, result: Any, now: float) -> None:
        """Fill what was missed."""
        drive = self.drive
        if drive is None:
            return
        poses = self.poses()
        if self.codes_are_statuses:
            result.missed_waypoints = [status for status in self.statuses() if status.waypoint_status == 3]
            return
        result.missed_waypoints = [
            self.build.of(
                "nav2_msgs/msg/MissedWaypoint",
                index=report.waypoint_index,
                goal=poses[report.waypoint_index],
                error_code=report.error_code if report.error_code < 9000 else self.codes.first + 1,
            )
            for report in drive.missed
        ]

    codes_are_statuses = True
    """False where the result has nav2_msgs/MissedWaypoint."""


class TreeNotLoadedError(NavError):
    """The behavior tree that a goal names cannot be read."""

    name = "FAILED_TO_LOAD_BEHAVIOR_TREE"

    def __init__(self, message: str, *, code: int) -> None:
        super().__init__(message)
        self.__dict__["code"] = code  # of the action


# --- motions ----------------------------------------------------------------------------------------------------------


class MotionTask(Task):
    """Spin, BackUp, DriveOnHeading, AssistedTeleop, Wait and FollowPath."""

    configured: Mapping[type[Behavior], ParamModel] = {}
    """Parameters of the behaviors of the configuration, by class; a goal overlays them."""

    def __init__(self, goal: Any, move_base: MoveBase, build: MessageBuilder) -> None:
        super().__init__(goal, move_base, build)
        self.handle: MotionHandle | None = None

    @abstractmethod
    def behavior(self) -> Behavior:
        """Return what to do. Raises a NavError for a goal that cannot be done."""

    def params(self, of: type[Behavior], model: type[M], **given: Any) -> M:
        """Return the parameters of a behavior: those of the configuration, overlaid. Raises InputError for wrong ones."""
        known = self.configured.get(of)
        try:
            return model.model_validate({**({} if known is None else known.model_dump()), **given})
        except ValidationError as exc:
            first = exc.errors(include_url=False, include_context=False)[0]
            name, said = str(first["loc"][0]), str(first["msg"]).removeprefix("Value error, ")
            raise InputError(f"the goal is not valid: {name} = {first['input']}: {said}", parameter=name) from None

    def begin(self, now: float) -> None:
        """Start the motion."""
        self.started_at = now
        self.handle = self.move_base.motions.start(self.behavior())

    def update(self, now: float) -> Outcome | None:
        """Return the end of the motion."""
        handle = self.handle
        assert handle is not None
        if not handle.is_done:
            return None
        code = 0 if handle.error is None else self.codes.of(handle.error)
        found = outcome_of(handle.status, code, "" if handle.error is None else handle.text)
        return found._replace(code=0) if found.status == CANCELED else found

    def cancel(self) -> None:
        """Stop the robot."""
        if self.handle is not None and self.move_base.motions.running is self.handle:
            self.move_base.motions.cancel()

    def fill(self, result: Any, now: float) -> None:
        """Fill the time that the motion took."""
        handle = self.handle
        if hasattr(result, "total_elapsed_time") and handle is not None and handle.ended_at is not None:
            result.total_elapsed_time = duration(self.build, handle.ended_at - handle.sent_at)


class SpinTask(MotionTask):
    """Spin."""

    codes = SPIN

    def behavior(self) -> Behavior:
        """Return a turn by target_yaw."""
        given = {"spin_dist": float(self.goal.target_yaw), **allowances(self.goal)}
        return Spin("spin", self.params(Spin, SpinParams, **given))

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the angle."""
        assert self.handle is not None
        message.angular_distance_traveled = float(self.handle.data.get("turned_rad", 0.0))
        return True


class BackUpTask(MotionTask):
    """BackUp."""

    codes = BACK_UP

    def behavior(self) -> Behavior:
        """Return a drive backwards by the x of the target."""
        goal = self.goal
        distance, speed = straight_of(goal)
        given = {"backup_dist": abs(distance), "backup_speed": abs(speed), **allowances(goal)}
        return BackUp("backup", self.params(BackUp, BackUpParams, **given))

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the distance."""
        assert self.handle is not None
        message.distance_traveled = float(self.handle.data.get("driven_m", 0.0))
        return True


class DriveOnHeadingTask(BackUpTask):
    """DriveOnHeading."""

    codes = DRIVE

    def behavior(self) -> Behavior:
        """Return a drive by the x of the target."""
        distance, speed = straight_of(self.goal)
        given = {"dist_to_travel": distance, "speed": speed, **allowances(self.goal)}
        return DriveOnHeading("drive_on_heading", self.params(DriveOnHeading, DriveOnHeadingParams, **given))


class AssistedTeleopTask(MotionTask):
    """AssistedTeleop: `cmd_vel_teleop` drives, `preempt_teleop` ends it."""

    codes = TELEOP

    def behavior(self) -> Behavior:
        """Return the help for a person who drives."""
        params = self.params(AssistedTeleop, AssistedTeleopParams, **allowances(self.goal))
        return AssistedTeleop("assisted_teleop", params)

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the time since the start."""
        message.current_teleop_duration = duration(self.build, now - self.started_at)
        return True


class WaitTask(MotionTask):
    """Wait."""

    codes = WAIT

    def behavior(self) -> Behavior:
        """Return a wait."""
        return Wait("wait", WaitParams(wait_duration=max(0.0, seconds_of(self.goal.time))))

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the time left."""
        assert self.handle is not None
        message.time_left = duration(self.build, float(self.handle.data.get("left_s", 0.0)))
        return True


class FollowPathTask(MotionTask):
    """FollowPath."""

    codes = CONTROLLER
    controllers: tuple[str, ...] = ("",)
    """Names of the one controller."""

    def behavior(self) -> Behavior:
        """Return the drive along the path."""
        if str(self.goal.controller_id) not in self.controllers:
            known = ", ".join(name for name in self.controllers if name)
            raise InvalidChoiceError(f'there is no controller "{self.goal.controller_id}"; there is {known}', code=101)
        return FollowPath(self.move_base, path_of(self.goal.path))

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the distance and the speed."""
        assert self.handle is not None
        message.distance_to_goal = float(self.handle.data.get("left_m", 0.0))
        command = self.move_base.command
        message.speed = math.hypot(command.vx, command.vy)
        return True


class InvalidChoiceError(NavError):
    """The goal names a planner, controller or smoother that the navigator does not have."""

    name = "INVALID_CHOICE"

    def __init__(self, message: str, *, code: int) -> None:
        super().__init__(message)
        self.__dict__["code"] = code  # of the action


def allowances(goal: Any) -> dict[str, Any]:
    """Return the limits that goals of motions have: the time, and whether to check for collisions."""
    allowed = seconds_of(goal.time_allowance)
    found: dict[str, Any] = {"time_allowance": allowed if allowed > 0.0 else 1e6}
    if getattr(goal, "disable_collision_checks", False):
        found["disable_collision_checks"] = True
    return found


def straight_of(goal: Any) -> tuple[float, float]:
    """Return distance and speed of BackUp and DriveOnHeading. Raises InputError for another direction than forwards or back."""
    target, speed = goal.target, float(goal.speed)
    if target.y != 0.0 or target.z != 0.0:
        raise InputError(
            f"the target ({target.x:g}, {target.y:g}, {target.z:g}) is not straight ahead: give only its x"
        )
    return float(target.x), speed


def path_of(message: Any) -> Path:
    """Return a nav_msgs/Path."""
    frame, poses = msg.path_of(message)
    return Path(np.ascontiguousarray(poses), frame)


def seconds_of(duration: Any) -> float:
    """Return a duration in seconds."""
    return 1e-9 * time_ns(duration)


def duration(build: MessageBuilder, seconds: float) -> Any:
    """Return a builtin_interfaces/Duration."""
    total = round(max(0.0, seconds) * 1e9)
    return build.of("builtin_interfaces/msg/Duration", sec=total // 10**9, nanosec=total % 10**9)


# --- plans: they need neither the robot nor the thread of the node ----------------------------------------------------


class WorkTask(Task):
    """ComputePathToPose, ComputePathThroughPoses and SmoothPath: computed by a thread of their own."""

    is_aside = True
    submit: Callable[[Callable[[], Any]], Future[Any]]
    """Runs a function in that thread."""

    def __init__(self, goal: Any, move_base: MoveBase, build: MessageBuilder) -> None:
        super().__init__(goal, move_base, build)
        self.future: Future[Any] | None = None
        self.is_canceled = False
        self.found: Path | None = None

    @abstractmethod
    def work(self) -> Path:
        """Return the path; called in the thread. Raises a NavError."""

    def begin(self, now: float) -> None:
        """Hand the work to the thread."""
        self.started_at = now
        self.future = self.submit(self.work)

    def update(self, now: float) -> Outcome | None:
        """Return the end of the work."""
        future = self.future
        assert future is not None
        if not future.done():
            return None
        if self.is_canceled:
            return Outcome(CANCELED)
        try:
            self.found = future.result()
        except NavError as exc:
            return Outcome(ABORTED, self.codes.of(exc), exc.message)
        return Outcome(SUCCEEDED)

    def cancel(self) -> None:
        """Let the result be dropped."""
        self.is_canceled = True

    def fill(self, result: Any, now: float) -> None:
        """Fill the path and the time."""
        spent = duration(self.build, now - self.started_at)
        for name in ("planning_time", "smoothing_duration"):
            if hasattr(result, name):
                setattr(result, name, spent)
        if hasattr(result, "was_completed"):
            result.was_completed = self.found is not None
        if self.found is not None:
            result.path = self.build.path(self.stamp_ns(now), self.found.frame, self.found.poses)

    stamp_ns: Callable[[float], int]
    """ROS's time (ns) of a time of the node (s)."""
