"""The approach to a dock and the way out of it, as behaviors: one step of the state machine and one command per cycle.

States, codes and parameters: opennav_docking. The control law is that of the graceful controller (`SmoothControlLaw`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors import TimedBehavior
from navstack.core import (
    BatteryState,
    DockDetection,
    FrameError,
    FrameTree,
    InputError,
    NavError,
    Path,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    angle_between,
    normalize_angle,
    overlaps_obstacle,
)
from navstack.docking.database import Dock
from navstack.docking.errors import (
    DockingTimeoutError,
    DockNotValidError,
    FailedToChargeError,
    FailedToControlError,
    FailedToDetectDockError,
)
from navstack.local_planner import SmoothControlLaw
from navstack.parameters import DockingParams
from navstack.plugins import BehaviorContext, BehaviorStatus, BehaviorStep, DockType, LocalPlan

BEYOND_M: Final = 0.25
"""The controller's target lies this far behind the dock: close to a target the law's angles are ill-conditioned."""
SHORT_M: Final = 0.002
"""A robot without a charging current drives on if it is farther than this before the dock (m)."""


class DockingState(IntEnum):
    """What the robot does; numbers of Nav2's feedback."""

    NONE = 0
    NAV_TO_STAGING_POSE = 1
    INITIAL_PERCEPTION = 2
    CONTROLLING = 3
    WAIT_FOR_CHARGE = 4
    RETRY = 5


@dataclass(slots=True)
class StateVisit:
    """One stay in a state, for records and explanations."""

    state: str
    attempt: int
    """From 1; the first approach is attempt 1."""
    begin: float
    """s."""
    end: float
    distance_m: float
    """From the robot to the dock as it is known, at the end of the visit."""
    seen: str = ""
    """What the detector saw last."""
    error_code: int = 0
    """Why the attempt failed in this state; 0 if it did not."""
    message: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(slots=True)
class DockingLog:
    """The states of one docking or undocking, in order."""

    dock: str
    visits: list[StateVisit] = field(default_factory=list[StateVisit])
    retries: int = 0

    @property
    def state(self) -> DockingState:
        """The current state."""
        return DockingState[self.visits[-1].state] if self.visits else DockingState.NONE

    def enter(self, state: DockingState, now: float, distance: float) -> None:
        """Begin a visit at `now` (s), `distance` (m) from the dock."""
        self.visits.append(StateVisit(state.name, self.retries + 1, now, now, distance))

    def update(self, now: float, distance: float, seen: str) -> None:
        """Note what is the case at `now` (s)."""
        visit = self.visits[-1]
        visit.end, visit.distance_m, visit.seen = now, distance, seen

    def fail(self, error: NavError) -> None:
        """Note why the attempt failed in the current state."""
        if self.visits:
            self.visits[-1].error_code, self.visits[-1].message = error.code, error.message

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {"dock": self.dock, "num_retries": self.retries, "states": [visit.as_dict() for visit in self.visits]}


class DockSensing:
    """What the robot's sensors have reported since the last step: scans, detections of docks, the battery."""

    def __init__(self, frames: FrameTree) -> None:
        self.frames = frames
        self.battery: BatteryState | None = None
        self._data: list[SensorData | DockDetection] = []

    def add(self, data: list[SensorData | DockDetection], battery: BatteryState | None) -> None:
        """Add measurements, and the last state of the battery."""
        self._data += data
        self.battery = battery

    def take(self) -> list[SensorData | DockDetection]:
        """Return the measurements since the last call."""
        data, self._data = self._data, []
        return data


class DockMotion(TimedBehavior[DockingParams]):
    """What docking and undocking share: the fixed frame, the law, the check of the way ahead, the log."""

    Params = DockingParams

    def __init__(
        self, name: str, params: DockingParams, dock: Dock, dock_type: DockType, sensing: DockSensing, log: DockingLog
    ) -> None:
        super().__init__(name, params)
        self.dock, self.dock_type, self.sensing, self.log = dock, dock_type, sensing, log
        self._law: SmoothControlLaw | None = None
        self._turn_rate = self._max_turn = 0.0
        """Turning speed of the last command in place (rad/s)."""
        self._sent = Twist2D()
        self._pose = Pose2D(0.0, 0.0)
        self._known = dock.pose
        """Where the dock is as far as it is known, in the fixed frame."""

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.controller_frequency

    def start(self, context: BehaviorContext, now: float) -> None:
        """Check the frames. Raises InputError for a fixed frame, and DockNotValidError for a dock, in an unknown frame."""
        super().start(context, now)
        fixed, frames = self.params.fixed_frame.strip("/"), (context.local_costmap.frame, context.global_costmap.frame)
        if fixed not in frames:
            raise InputError(
                f"docking_server/fixed_frame is {fixed}, which is the frame of no costmap; set it to one of {', '.join(frames)}",
                fixed_frame=fixed,
            )
        if self.dock.frame.strip("/") not in frames:
            raise DockNotValidError(
                f'the pose of the dock "{self.dock.name}" is in the frame "{self.dock.frame}", which is not that of a costmap; '
                f"give it in one of {', '.join(frames)}",
                frame=self.dock.frame,
            )
        self.frame = fixed
        c, limits = self.params.controller, context.local_planner.limits
        self._law = SmoothControlLaw(
            k_phi=c.k_phi,
            k_delta=c.k_delta,
            beta=c.beta,
            exponent=getattr(c, "lambda"),
            v_min=c.v_linear_min,
            v_max=min(c.v_linear_max, limits.max_vel_trans or math.inf),
            w_max=min(c.v_angular_max, limits.max_vel_theta or math.inf),
            slowdown_radius=c.slowdown_radius,
            deceleration=c.deceleration_max,
        )
        self._max_turn = min(c.rotate_to_heading_angular_vel, limits.max_vel_theta or math.inf)
        self._sent, self._turn_rate = Twist2D(), 0.0

    def measured(self, state: RobotState, now: float) -> Pose2D:
        """Return the robot's pose in the fixed frame, and note where the dock is in it."""
        return self._in_frame(self.frame, state, now)

    def _in_frame(self, frame: str, state: RobotState, now: float) -> Pose2D:
        context = self.context
        return state.pose if frame == context.local_costmap.frame else context.global_costmap.robot_pose(now)

    def known_dock(self, state: RobotState, now: float) -> Pose2D:
        """Return the pose of the database in the fixed frame, by the localization of now."""
        here = Transform2D(*self._in_frame(self.dock.frame.strip("/"), state, now))
        return (Transform2D(*self.measured(state, now)) @ here.inverse()).apply(self.dock.pose)

    def take_measurements(self, now: float) -> None:
        """Pass what the sensors reported to the type of the dock; measurements without a transform are left out."""
        for data in self.sensing.take():
            try:
                at = self.sensing.frames.lookup(self.frame, data.frame, min(data.stamp, now))
            except FrameError:
                continue
            self.dock_type.observe(data, at)

    def drive_towards(self, pose: Pose2D, target: Pose2D, state: RobotState, *, backward: bool, left: float) -> Twist2D:
        """Return the command of the law, slower near the end of the way, which is `left` (m) away.

        Raises FailedToControlError for an obstacle on the way.

        ROS differs: in Nav2 the distance to the target behind the dock counts, so that the robot does not slow down.
        """
        c = self.params.controller
        assert self._law is not None
        way = self._law.trajectory(
            pose, target, backward=backward, seconds=c.projection_time, step=c.simulation_time_step
        )
        if c.use_collision_detection:
            self._check(pose, way, state)
        v, w = self._law.command(pose, target, backward=backward)
        most = max(c.v_linear_min, c.v_linear_max * left / c.slowdown_radius)
        if abs(v) > most:
            v, w = math.copysign(most, v), w * most / abs(v)
        self._turn_rate = 0.0
        local = Transform2D(*state.pose) @ Transform2D(*pose).inverse()
        self.local_plan = LocalPlan(Twist2D(v, 0.0, w), self.name, trajectory=local.apply_poses(way))
        return Twist2D(v, 0.0, w)

    def _check(self, pose: Pose2D, way: NDArray[np.float64], state: RobotState) -> None:
        """Raise FailedToControlError if the footprint collides on the way, in the fixed frame, outside of the dock."""
        costmap = self.context.local_costmap
        near = self.params.controller.dock_collision_threshold
        local = (Transform2D(*state.pose) @ Transform2D(*pose).inverse()).apply_poses(way)
        from_dock = np.hypot(way[:, 0] - self._known.x, way[:, 1] - self._known.y)
        # a pose behind the dock is never driven: the robot stops in the dock
        beyond = Transform2D(*self._known).inverse().apply_poses(way)[:, 0] > 0.0
        for k in np.flatnonzero((from_dock > near) & ~beyond).tolist():
            if overlaps_obstacle(costmap.master, costmap.footprint, Pose2D(*local[k].tolist())):
                length = float(np.hypot(*np.diff(way[: k + 1, :2], axis=0).T).sum())
                raise FailedToControlError(
                    f"the way is blocked: the footprint hits an obstacle of the {costmap.name} after {length:.2f} m, "
                    f"{from_dock[k]:.2f} m from the dock",
                    collision_ahead=[float(value) for value in local[k]],
                    collision_after_m=length,
                )

    def turn_towards(self, pose: Pose2D, heading: float) -> Twist2D:
        """Return the command of a turn in place towards a heading (rad) in the fixed frame."""
        c, dt = self.params.controller, 1.0 / self.params.controller_frequency
        error = angle_between(pose.yaw, heading)
        acceleration = c.rotate_to_heading_max_angular_accel
        fastest = min(self._max_turn, math.sqrt(2.0 * acceleration * abs(error)), abs(error) / dt)
        wanted = math.copysign(fastest, error)
        change = acceleration * dt
        self._turn_rate = min(max(wanted, self._turn_rate - change), self._turn_rate + change)
        return Twist2D(0.0, 0.0, self._turn_rate)

    def running(self, twist: Twist2D, note: str) -> BehaviorStep:
        """Return a step with a command."""
        self._sent = twist
        plan = self.local_plan
        if plan is None or plan.command != twist:
            self.local_plan = LocalPlan(twist, self.name, notes=(note,))
        else:
            self.local_plan = LocalPlan(twist, self.name, trajectory=plan.trajectory, notes=(note,))
        return BehaviorStep(BehaviorStatus.RUNNING, twist, data=self.data())

    def data(self) -> dict[str, Any]:
        """Return the figures of a step."""
        return {
            "left_m": self._pose.distance_to(self._known),
            "docking_state": self.log.state.name,
            "num_retries": self.log.retries,
        }

    def describe(self) -> dict[str, Any]:
        """Return the dock."""
        return {"dock": self.dock.name, "pose": list(self.dock.pose), "type": self.dock_type.name}

    @property
    def docked_yaw(self) -> float:
        """Heading of the docked robot in the fixed frame (rad)."""
        return normalize_angle(self._known.yaw + (math.pi if self.dock_type.drives_backward else 0.0))

    def back_to(self, staging: Pose2D, pose: Pose2D, state: RobotState) -> Twist2D | None:
        """Return the command on the way out of the dock to the staging pose; None if the robot is there.

        It drives out with the heading of the dock, then turns in place to that of the staging pose.
        """
        p, dock = self.params, Transform2D(*self._known).inverse()
        passed = dock.apply(pose).x <= dock.apply(staging).x
        if pose.distance_to(staging) <= p.undock_linear_tolerance or passed:
            if abs(angle_between(pose.yaw, staging.yaw)) <= p.undock_angular_tolerance:
                return None
            return self.turn_towards(pose, staging.yaw)
        out = math.atan2(staging.y - self._known.y, staging.x - self._known.x)
        target = Pose2D(staging.x + BEYOND_M * math.cos(out), staging.y + BEYOND_M * math.sin(out), self.docked_yaw)
        left = pose.distance_to(staging)
        return self.drive_towards(pose, target, state, backward=not self.dock_type.drives_backward, left=left)


class Approach(DockMotion):
    """Drives from near the staging pose into the dock, and repeats that from the staging pose if it fails.

    Perception, approach, wait for the charge. A dock that is not seen at first ends it with 904; what fails later is repeated
    up to max_retries times, and the last failure is its end.
    """

    def start(self, context: BehaviorContext, now: float) -> None:
        """Begin with the perception."""
        super().start(context, now)
        self._state = DockingState.NONE
        self._since = now
        self._staging: Pose2D | None = None
        self._turning = False

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Take the pose of the database for that of the dock."""
        self._pose, self._known = pose, self.known_dock(state, now)
        self.target = self._known
        self.sensing.take()  # what was measured on the way here counts for nothing
        self._perceive(now)
        self.reference = Path(np.array([pose, self._known]), self.frame)
        return math.inf

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step. Raises the error of the last attempt."""
        self._pose = pose
        self.take_measurements(now)
        try:
            step = self._steps[self._state](self, pose, state, now)
        except (FailedToDetectDockError, FailedToControlError, FailedToChargeError) as exc:
            self._note(now)
            self.log.fail(exc)
            first = self._state is DockingState.INITIAL_PERCEPTION
            if first or self.log.retries >= self.params.max_retries:
                raise type(exc)(self._told(exc), **exc.data) from None
            self.log.retries += 1
            self._staging = self.dock_type.staging_pose(self._known)
            self._enter(DockingState.RETRY, now)
            return self.running(Twist2D(), f"attempt {self.log.retries} failed: {exc.message}")
        if self.log.visits:
            self._note(now)
        return step

    def summary(self) -> str:
        """Return the end in one sentence."""
        error = Transform2D(*self._known).inverse().apply(self._pose)
        again = self.log.retries
        retries = f" after {again} {'retry' if again == 1 else 'retries'}" if again else ""
        return f"docked at {self.dock.name}{retries}, {math.hypot(error.x, error.y):.3f} m from its detected pose"

    # --- states -------------------------------------------------------------------------------------------------------

    def _perceive(self, now: float) -> None:
        self.dock_type.begin(self._known, now)
        self._turning = False
        self._enter(DockingState.INITIAL_PERCEPTION, now)

    def _enter(self, state: DockingState, now: float) -> None:
        if self._state is not DockingState.NONE:
            self._note(now)
        self._state, self._since = state, now
        self.log.enter(state, now, self._pose.distance_to(self._known))

    def _note(self, now: float) -> None:
        self.log.update(now, self._pose.distance_to(self._known), self.dock_type.seen())

    def _told(self, exc: NavError) -> str:
        """Return the message of the last failure with state and attempt."""
        tries = self.log.retries + 1
        which = f"attempt {tries} of {self.params.max_retries + 1}" if tries > 1 else "the first attempt"
        return f"{self.dock.name}: {exc.message} ({self._state.name}, {which})"

    def _refined(self, now: float) -> Pose2D | None:
        found = self.dock_type.refined_pose(now)
        if found is not None:
            self._known = found
            self.target = found
        return found

    def _initial_perception(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        p = self.params
        if self._turning or self._refined(now) is not None:
            if self.dock_type.rotates_to_dock and not self._has_turned(pose, now):
                note = "the dock is detected; turning around to drive in backward"
                return self.running(self.turn_towards(pose, self.docked_yaw), note)
            self._enter(DockingState.CONTROLLING, now)
            return self.running(Twist2D(), "the dock is detected")
        if now - self._since > p.initial_perception_timeout:
            raise FailedToDetectDockError(
                f"the dock was not detected within initial_perception_timeout ({p.initial_perception_timeout:g} s): "
                f"{self.dock_type.seen()}",
                distance_m=pose.distance_to(self._known),
                seen=self.dock_type.seen(),
            )
        return self.running(Twist2D(), f"looking for the dock: {self.dock_type.seen()}")

    def _has_turned(self, pose: Pose2D, now: float) -> bool:
        """Turn around; the detector cannot see the dock then. Raises FailedToControlError after rotate_to_dock_timeout."""
        if not self._turning:
            self._turning, self._since = True, now
        if abs(angle_between(pose.yaw, self.docked_yaw)) <= self.params.rotation_angular_tolerance:
            return True
        if now - self._since > self.params.rotate_to_dock_timeout:
            limit = self.params.rotate_to_dock_timeout
            raise FailedToControlError(f"the robot did not turn around within rotate_to_dock_timeout ({limit:g} s)")
        return False

    def _controlling(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        p, dock_type = self.params, self.dock_type
        seen = self._refined(now)
        docked = dock_type.is_docked(pose, state, self._sent)
        if docked or (dock_type.is_charger and dock_type.is_charging(self.sensing.battery, docked=docked)):
            if not dock_type.is_charger:
                return BehaviorStep(BehaviorStatus.DONE, text=self.summary(), data=self.data())
            self._enter(DockingState.WAIT_FOR_CHARGE, now)
            return self.running(Twist2D(), "docked")
        if seen is None and not self._turning:
            raise FailedToDetectDockError(
                f"the dock is lost {pose.distance_to(self._known):.2f} m before it: {dock_type.seen()}",
                distance_m=pose.distance_to(self._known),
                seen=dock_type.seen(),
            )
        if now - self._since > p.dock_approach_timeout:
            raise FailedToControlError(
                f"the robot did not arrive within dock_approach_timeout ({p.dock_approach_timeout:g} s): "
                f"{pose.distance_to(self._known):.2f} m are left",
                distance_m=pose.distance_to(self._known),
            )
        note = f"{pose.distance_to(self._known):.2f} m before the dock; {dock_type.seen()}"
        return self.running(self._into_dock(pose, state), note)

    def _into_dock(self, pose: Pose2D, state: RobotState) -> Twist2D:
        """Return the command towards the dock. Raises FailedToControlError for an obstacle on the way."""
        at = Transform2D(*self._known).apply(Pose2D(BEYOND_M, 0.0, 0.0))
        target, left = at._replace(yaw=self.docked_yaw), pose.distance_to(self._known)
        return self.drive_towards(pose, target, state, backward=self.dock_type.drives_backward, left=left)

    def _wait_for_charge(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Wait for the current; after half the time drive on if the robot is short of the dock, which is known better by then.

        ROS differs: in Nav2 it stands.
        """
        battery, limit = self.sensing.battery, self.params.wait_charge_timeout
        if self.dock_type.is_charging(battery, docked=True):
            return BehaviorStep(BehaviorStatus.DONE, text=self.summary(), data=self.data())
        if now - self._since > limit:
            flows = "no state of the battery arrives" if battery is None else f"the current is {battery.current:.2f} A"
            raise FailedToChargeError(
                f"the battery is not charged within wait_charge_timeout ({limit:g} s): {flows}",
                current_a=None if battery is None else battery.current,
            )
        self._refined(now)
        short = -Transform2D(*self._known).inverse().apply(pose).x
        if short > SHORT_M and now - self._since > 0.5 * limit:
            return self.running(self._into_dock(pose, state), f"no current; {short:.3f} m before the dock")
        return self.running(Twist2D(), "docked, waiting for the charging current")

    def _retry(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        staging = self._staging
        assert staging is not None
        twist = self.back_to(staging, pose, state)
        if twist is None:
            self._perceive(now)
            return self.running(Twist2D(), "back at the staging pose")
        if now - self._since > self.params.dock_approach_timeout:
            raise FailedToControlError(
                f"the robot did not get back to the staging pose within dock_approach_timeout "
                f"({self.params.dock_approach_timeout:g} s): {pose.distance_to(staging):.2f} m are left",
                distance_m=pose.distance_to(staging),
            )
        return self.running(twist, "back to the staging pose for another attempt")

    _steps: Final = {
        DockingState.INITIAL_PERCEPTION: _initial_perception,
        DockingState.CONTROLLING: _controlling,
        DockingState.WAIT_FOR_CHARGE: _wait_for_charge,
        DockingState.RETRY: _retry,
    }


class Leave(DockMotion):
    """Drives out of the dock to its staging pose."""

    def __init__(
        self,
        name: str,
        params: DockingParams,
        dock: Dock,
        dock_type: DockType,
        sensing: DockSensing,
        log: DockingLog,
        *,
        max_time_s: float,
    ) -> None:
        """`max_time_s`: time limit (s), Nav2's max_undocking_time."""
        super().__init__(name, params, dock, dock_type, sensing, log)
        self.max_time_s = max_time_s
        self._staging = Pose2D(0.0, 0.0)

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Take the robot's pose for that of the dock: it stands in it."""
        del state
        yaw = normalize_angle(pose.yaw + (math.pi if self.dock_type.drives_backward else 0.0))
        self._pose, self._known = pose, pose._replace(yaw=yaw)
        self._staging = self.target = self.dock_type.staging_pose(self._known)
        self.reference = Path(np.array([pose, self._staging]), self.frame)
        self.log.enter(DockingState.CONTROLLING, now, 0.0)
        return math.inf

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step. Raises DockingTimeoutError, and FailedToControlError for an obstacle."""
        self._pose = pose
        left = pose.distance_to(self._staging)
        self.log.update(now, pose.distance_to(self._known), "")
        try:
            twist = self.back_to(self._staging, pose, state)
            if twist is None:
                return BehaviorStep(BehaviorStatus.DONE, text=self.summary(), data=self.data())
            if now - self.started_at > self.max_time_s:
                raise DockingTimeoutError(
                    f"the robot did not leave the dock within max_undocking_time ({self.max_time_s:g} s): {left:.2f} m are left",
                    distance_m=left,
                )
            return self.running(twist, f"{left:.2f} m to the staging pose")
        except (DockingTimeoutError, FailedToControlError) as exc:
            self.log.fail(exc)
            raise

    def summary(self) -> str:
        """Return the end in one sentence."""
        return f"undocked from {self.dock.name}, {self._pose.distance_to(self._staging):.3f} m from the staging pose"
