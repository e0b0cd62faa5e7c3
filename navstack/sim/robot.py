"""A robot in a simulated world: implements `navstack.plugins.Robot` and gives access to the true state."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    BatteryState,
    DockDetection,
    Footprint,
    FrameTree,
    ImuReading,
    InputError,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    normalize_angle,
)
from navstack.parameters import SimParams
from navstack.plugins import LocalizationStatus
from navstack.sim.body import (
    DRIVEN_HIT,
    OVERRUN_HIT,
    SAMPLE_SIZE,
    STATE,
    BodyState,
    DriveNoise,
    body_settings,
    drive,
    steered_command,
)
from navstack.sim.camera import Camera, CameraImage
from navstack.sim.collision import Collision
from navstack.sim.crowd import Crowd
from navstack.sim.docks import Docks
from navstack.sim.estimation import Estimation, Localization
from navstack.sim.sensors import SensorSuite
from navstack.sim.shapes import ReplayMotion
from navstack.sim.solids import Solids, concatenate_solids
from navstack.sim.world import World

_STOP = Twist2D()


class CommandQueue:
    """Commands that take effect after the command delay; a command older than the timeout becomes a stop."""

    def __init__(self, params: SimParams) -> None:
        frequency = params.physics_frequency
        self._delay_steps = math.ceil(params.command_delay * frequency - 1e-9)
        self._timeout_steps = (
            None if params.command_timeout is None else math.ceil(params.command_timeout * frequency - 1e-9)
        )
        # (step from which it is in force, command), oldest first; the first one is in force
        self._commands: deque[tuple[int, Twist2D]] = deque([(0, _STOP)])

    @property
    def current(self) -> Twist2D:
        """The command in force."""
        return self._commands[0][1]

    def add(self, twist: Twist2D, now: int) -> None:
        """Adds a command given at step `now`."""
        step = now + self._delay_steps
        if self._commands[-1][0] == step:
            self._commands.pop()
        self._commands.append((step, twist))

    def advance(self, now: int, last: int) -> int:
        """Puts the command of step `now` in force; returns the step, at most `last`, up to which it remains in force."""
        commands = self._commands
        while len(commands) > 1 and commands[1][0] <= now:
            commands.popleft()
        until = min(last, commands[1][0]) if len(commands) > 1 else last
        if self._timeout_steps is not None:
            expiry = commands[0][0] + self._timeout_steps
            if expiry <= now:
                commands[0] = (commands[0][0], _STOP)
            else:
                until = min(until, expiry)
        return until


def all_solids(world: World, crowd: Crowd | None, time: float) -> Solids:
    """Returns the solids of the world at `time` (s), and the pedestrians."""
    solids = world.solids_at(time)
    return solids if crowd is None else concatenate_solids([solids, crowd.solids()])


def check_pose(world: World, footprint: Footprint, pose: Pose2D, solids: Solids, *, start: bool = False) -> None:
    """Raises InputError if the footprint collides at `pose` (map frame); `start` words the message for the start of a run."""
    hit = world.collision(footprint, pose, solids=solids)
    if hit is not None:
        kind, _, x, y = hit
        where = "the robot at the start " if start else "the robot at "
        hint = "move the start" if start else "put it elsewhere"
        raise InputError(
            f"{where}({pose.x:g}, {pose.y:g}, {pose.yaw:g}) collides with the {kind} at ({x:.2f}, {y:.2f}); {hint}",
            pose=pose,
        )


def check_obstacles(world: World, footprint: Footprint, pose: Pose2D, solids: Solids) -> None:
    """Raises InputError, naming the obstacle, if one of the solids overlaps the footprint at `pose` (map frame)."""
    hit = world.collision(footprint, pose, solids=solids)
    if hit is not None:
        kind, index, x, y = hit
        name = world.name_of(kind, index)
        what = f'"{name}"' if name else f"the {kind}"
        raise InputError(f"{what} at ({x:.2f}, {y:.2f}) would overlap the robot; put it elsewhere", at=[x, y])


_COMMAND: Final = slice(BodyState._fields.index("command_vx"), BodyState._fields.index("command_wz") + 1)
_AT_REST: Final = (
    *(f"{kind}{axis}" for kind in ("", "lagged_", "change_") for axis in ("vx", "vy", "wz")),
    *("collided", "overrun", "rim", "traction"),
)
"""Fields of the state that are 0 where the robot has been put."""

# a tenth of a microsecond instead of 0.4 per tuple, 50 of them per simulated second
_body_state: Callable[[list[float]], BodyState] = partial(tuple.__new__, BodyState)  # pyright: ignore[reportAssignmentType]
_transform: Callable[[list[float]], Transform2D] = partial(tuple.__new__, Transform2D)  # pyright: ignore[reportAssignmentType]


class Group(Protocol):
    """The robots of one world that advance together (`Lockstep`)."""

    @property
    def step(self) -> int:
        """The physics step up to which all bodies have moved."""
        ...

    @property
    def has_others(self) -> bool:
        """True with more than one robot."""
        ...

    def polygon_name(self, robot: SimulatedRobot, k: int) -> str:
        """Return the name of polygon `k` of what a robot has around it."""
        ...

    def robot_hit(self, hit: int, step: int) -> tuple[str, int, float, float] | None:
        """Return the name, the number and the position of the robot that a result of `find_collision` means; None: no robot."""
        ...


class SimulatedRobot:
    """A body with odometry, sensors and localization in a `World`, and the pedestrians around it.

    Time advances in whole physics steps; no clock is read.

    A collision stops the robot, wheels included, where it was last free (to within 5 mm); a round robot (`from_radius`) can
    still turn. An obstacle that moves over the robot stops it in place; then the robot can turn, and drive where its center
    does not approach that obstacle. A run is a pure function of the parameters, the world, the start, the seed and the commands.
    """

    def __init__(
        self,
        params: SimParams,
        world: World,
        footprint: Footprint,
        start: Pose2D,
        *,
        seed: int = 0,
        base_frame: str = "base_footprint",
        odom_frame: str = "odom",
        map_frame: str = "map",
        estimation: Estimation | None = None,
    ) -> None:
        """`footprint`: the real one, without padding; `start` in the map (m, rad); `estimation` instead of truth and wheels.

        Raises InputError if the robot collides there, and for sensors in the same frame with different poses.
        """
        if not start.is_finite():
            raise InputError(f"the start {tuple(start)} is not finite", pose=start)
        if seed < 0:
            raise InputError(f"the seed is {seed}; it must be at least 0", seed=seed)
        self._seed = seed
        self._crowd = world.crowd(seed)
        self._solids = all_solids(world, self._crowd, 0.0)
        check_pose(world, footprint, start, self._solids, start=True)
        self.params = params
        self.world = world
        self.footprint = footprint
        self.base_frame, self.odom_frame, self.map_frame = base_frame, odom_frame, map_frame
        self.frames = FrameTree()
        self.collisions: list[Collision] = []
        self._step = 0
        self._frequency = params.physics_frequency
        self._dt = 1.0 / self._frequency
        self._body = body_settings(params, footprint, start.yaw, moving_obstacles=world.moves)
        self._fixed_yaw = float(self._body["fixed_yaw"][0])
        self._vertices = footprint.vertices.copy()  # writable, as the kernels are compiled for
        self._commands = CommandQueue(params)
        self._by_hand: Twist2D | None = None
        self._group: Group | None = None
        self._steering = 0.0
        self._noise = DriveNoise(params, seed)

        offset = Transform2D(params.map_to_odom[0], params.map_to_odom[1], normalize_angle(params.map_to_odom[2]))
        odometry = offset.inverse().apply(Pose2D(start.x, start.y, normalize_angle(start.yaw)))
        self._state = np.zeros(1, STATE)
        self._scalars: NDArray[np.float64] = self._state.view(np.float64)[: len(BodyState._fields)]
        """View of the fields of `BodyState`."""
        self._state["x"], self._state["y"], self._state["yaw"] = start.x, start.y, normalize_angle(start.yaw)
        self._state["odom_x"], self._state["odom_y"], self._state["odom_yaw"] = odometry
        self._now = _body_state(self._scalars.tolist())
        """The state as Python floats, which are faster to read one by one."""
        self._samples = np.empty((0, SAMPLE_SIZE))
        self._collided = False
        """The robot was in collision before or during the steps that have not been observed yet."""

        self._localization = Localization(params, seed=seed, offset=offset)
        self.estimation = estimation or Estimation()
        """What the robot believes, by a localizer and an odometry filter."""
        self._filtered: Transform2D | None = None
        self._sensors = SensorSuite(params, footprint, start, seed=seed)
        uses_docks = bool(params.docks) or params.battery.capacity is not None
        self.docks: Docks | None = Docks(params, seed=seed) if uses_docks else None
        """The docks of the world and the battery; None for a world without docks and a robot without a battery."""
        self._begin(Transform2D(*odometry))

    def _begin(self, odometry: Transform2D) -> None:
        """Publishes the frames at time 0 and schedules the first scans."""
        estimation, localization, frames = self.estimation, self._localization, self.frames
        if estimation.localizer is not None:
            localization.is_static = False
        estimation.begin(self.params, (self.map_frame, self.odom_frame, self.base_frame), odometry)
        if localization.is_static:
            frames.set_static(self.map_frame, self.odom_frame, localization.start)
        self._sensors.mount(frames, self.base_frame)
        frames.set(self.odom_frame, self.base_frame, odometry, 0.0)
        if estimation.odometry is not None:
            self._filtered = odometry
            estimation.odometry.start(0.0, odometry)
        if not localization.is_static:
            start = localization.start if estimation.localizer is None else estimation.correction
            frames.set(self.map_frame, self.odom_frame, start, 0.0)
        self._sensors.start(self.pose, self._solids)
        if self.docks is not None:
            self.docks.mount(frames, self.base_frame)
            self.docks.start(self.pose)

    # --- time ---------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Seconds since the start: a whole number of physics steps."""
        return self._step / self._frequency

    def step_at(self, time: float) -> int:
        """Returns the first physics step at or after `time` (s). Raises InputError for a time that is not finite."""
        if not math.isfinite(time):
            raise InputError(f"cannot simulate until {time}", time=time)
        return max(self._step, math.ceil(time * self._frequency - 1e-6))

    def advance_to(self, time: float) -> NDArray[np.float64]:
        """Runs to the first physics step at or after `time` (s). A robot of a `Lockstep` advances with the others instead.

        Returns the samples after each step, (n, 9): true x, y, yaw (map), odometry x, y, yaw (odom), vx, vy, wz. A view that the
        next call overwrites.
        """
        if self._group is not None:
            raise InputError("this robot advances together with others; advance their Lockstep")
        first, last = self._step, self.step_at(time)
        steps = last - first
        if len(self._samples) < steps:
            self._samples = np.empty((steps, SAMPLE_SIZE))
        observed = first
        while self._step < last:
            # with moving obstacles step by step, each at its position at that time
            self._drive(self._commands.advance(self._step, self._step + 1 if self.world.moves else last), first)
            if self.world.moves:
                self._observe(self._samples[observed - first : self._step - first], self._solids_now)
                observed = self._step
        if observed < last:
            self._observe(self._samples[observed - first : last - first], self._solids_now)
        return self._samples[:steps, :9]

    def _drive(self, until: int, first: int) -> None:
        """Runs the physics steps up to `until`; `_samples` begins after step `first`."""
        steps = until - self._step
        samples = self._samples[self._step - first :]
        self._solids = solids = self._solids_until(until)
        self._set_command()
        hits = drive(
            self._state,
            self._body,
            self._vertices,
            steps,
            self._noise.of(steps),
            self.world.squares,
            self.world.grid,
            solids.discs,
            solids.circles,
            solids.corners,
            solids.first,
            samples,
        )
        self._now = _body_state(self._scalars.tolist())
        self._collided = self._collided or hits > 0 or self.in_collision
        if hits:
            self._add_collisions(samples[:steps])
        self._step = until

    # --- among other robots, see `Lockstep` ---------------------------------------------------------------------------

    def join(self, group: Group, state: NDArray[np.void], solids: Solids) -> tuple[NDArray[np.void], DriveNoise]:
        """Advances with a group from now on, with its state in `state` (1,) and among `solids`.

        Returns the settings (1,) of type `BODY` and the noise of its body.
        """
        state[:] = self._state
        self._state, self._scalars = state, state.view(np.float64)[: len(BodyState._fields)]
        self._group, self._solids = group, solids
        self._sensors.replace_solids(solids)
        self._body["moving_obstacles"] = self.moves
        return self._body, self._noise

    def polygon_name(self, k: int) -> str:
        """Returns the name of polygon `k` of `solids`: that of a shape, or of another robot."""
        return self.world.name_of("polygon", k) if self._group is None else self._group.polygon_name(self, k)

    @property
    def moves(self) -> bool:
        """True if any obstacle moves, or another robot."""
        return self.world.moves or (self._group is not None and self._group.has_others)

    def command_until(self, step: int, last: int) -> int:
        """Puts the command of physics step `step` in force; returns the step, at most `last`, up to which it remains so."""
        until = self._commands.advance(step, last)
        self._set_command()
        return until

    def take_steps(self, samples: NDArray[np.float64], hits: int, solids: Callable[[int], Solids]) -> None:
        """Takes over the steps (k, SAMPLE_SIZE) that the group has driven, with this number of new collisions.

        `solids`: the obstacles, other robots included, at a physics step.
        """
        last = self._step + len(samples)
        self._now = _body_state(self._scalars.tolist())
        self._solids = solids(last)
        self._collided = self._collided or hits > 0 or self.in_collision
        if hits:
            self._add_collisions(samples)
        self._step = last
        self._observe(samples, solids)

    def _add_collisions(self, samples: NDArray[np.float64]) -> None:
        """Adds the new collisions of the steps with these samples."""
        columns = (OVERRUN_HIT, DRIVEN_HIT)
        hits = [(step, int(row[k])) for step, row in enumerate(samples.tolist()) for k in columns if row[k] != -1]
        for step, hit in hits:
            pose, time = Pose2D(*samples[step, :3].tolist()), (self._step + step + 1) / self._frequency
            other = None if self._group is None else self._group.robot_hit(hit, self._step + step)
            if other is not None:
                self.collisions.append(Collision(time, pose, "robot", other[1], other[2:], other[0]))
                continue
            among = self._solids if self._group is None else self.world.solids_at(time)
            kind, index, x, y = self.world.identify(hit, among)
            name = self.world.name_of(kind, index)
            self.collisions.append(Collision(time, pose, kind, index, (x, y), name))

    def _solids_until(self, until: int) -> Solids:
        """Returns the solids at step `until`; advances the pedestrians to it."""
        solids = self.world.solids_at(until / self._frequency)
        crowd = self._crowd
        if crowd is None:
            return solids
        now = self._now
        c, s = math.cos(now.yaw), math.sin(now.yaw)
        vx, vy = c * now.vx - s * now.vy, s * now.vx + c * now.vy
        robot = np.array([now.x, now.y, vx, vy, self.footprint.circumscribed_radius])
        crowd.step((until - self._step) * self._dt, self.world.squares, self.world.grid, solids, robot)
        return solids._replace(discs=np.concatenate((solids.discs, crowd.solids().discs)), tops=self._solids.tops)

    def _set_command(self) -> None:
        """Writes the command in force into the state; a steered base's has a steering angle."""
        twist = self._commands.current
        if self.params.is_steered:
            speed, self._steering = steered_command(self.params, twist, self._steering)
            twist = Twist2D(speed, 0.0, self._steering)
        self._scalars[_COMMAND] = twist

    def _solids_now(self, step: int) -> Solids:
        del step
        return self._solids

    def _observe(self, samples: NDArray[np.float64], solids: Callable[[int], Solids]) -> None:
        """Publishes the frames and schedules the measurements of the last steps, which have these samples."""
        frequency, last = self._frequency, self._step
        observed = last - len(samples)
        rows: list[list[float]] = samples.tolist()
        stamps = [step / frequency for step in range(observed + 1, last + 1)]
        self._sensors.observe(observed, rows, solids, collided=self._collided)
        self._collided = self.in_collision
        if self.docks is not None:
            self.docks.observe(observed, rows, self._now.distance)
            if self.docks.is_empty:
                self._commands.add(_STOP, last)
        odometry = list(map(_transform, samples[:, 3:6].tolist()))
        if self.estimation.odometry is not None:
            odometry = self.estimation.filtered(odometry, stamps, self._sensors.imu_readings())
            self._filtered = odometry[-1]
        self.frames.extend(self.odom_frame, self.base_frame, odometry, stamps)
        if self.estimation.localizer is not None:
            self.frames.extend(self.map_frame, self.odom_frame, [self.estimation.correction] * len(stamps), stamps)
            if self.estimation.process(self._sensors.scans(self.world, self._step), self.frames):
                self.frames.set(self.map_frame, self.odom_frame, self.estimation.correction, stamps[-1])
        elif not self._localization.is_static:
            corrections = [
                self._localization.at(step, Transform2D(row[0], row[1], row[2]), pose)
                for step, (row, pose) in enumerate(zip(rows, odometry, strict=True), observed + 1)
            ]
            self.frames.extend(self.map_frame, self.odom_frame, corrections, stamps)

    # --- interface of a robot -----------------------------------------------------------------------------------------

    def state(self) -> RobotState:
        """Returns the odometry: pose in the odometry frame and velocity of the wheels, at the current step."""
        now = self._now
        twist = self.estimation.twist or Twist2D(now.vx, now.vy, now.wz)
        return RobotState(Pose2D(*self._odometry_pose), twist, self.time, self.odom_frame)

    @property
    def _odometry_pose(self) -> Transform2D:
        """Pose of the base in the odometry frame, by the filter if there is one."""
        if self._filtered is not None:
            return self._filtered
        now = self._now
        return Transform2D(now.odom_x, now.odom_y, now.odom_yaw)

    def scans(self) -> Sequence[SensorData]:
        """Returns the sensor data since the last call, oldest first, each as measured at its time."""
        scans = self._sensors.scans(self.world, self._step)
        return scans if self.estimation.localizer is None else [*self.estimation.fetch(), *scans]

    @property
    def localization_status(self) -> LocalizationStatus | None:
        """Whether the robot is localized; None for a robot that does not watch it."""
        return self.estimation.status

    def imu_readings(self) -> Sequence[ImuReading]:
        """Returns the IMU readings since the last call, by IMU, oldest first."""
        return self._sensors.imu_readings()

    def dock_detections(self) -> Sequence[DockDetection]:
        """Returns the detections of docks since the last call, oldest first."""
        return [] if self.docks is None else self.docks.fetch(self.time)

    @property
    def battery_state(self) -> BatteryState | None:
        """The state of the battery; None for a robot without one."""
        return None if self.docks is None else self.docks.battery

    def command(self, twist: Twist2D) -> None:
        """Commands a velocity from the current step on, after the command delay; only a holonomic base uses `vy`.

        A robot whose battery is empty stands still.
        """
        if not twist.is_finite():
            raise InputError(f"the command {tuple(twist)} is not finite", command=twist)
        if self._by_hand is None:
            self._give(twist)

    def _give(self, twist: Twist2D) -> None:
        if self.docks is not None and self.docks.is_empty:
            twist = _STOP
        if self.params.kinematics != "holonomic" and twist.vy != 0.0:
            twist = Twist2D(twist.vx, 0.0, twist.wz)
        self._commands.add(twist, self._step)

    # --- interventions ------------------------------------------------------------------------------------------------

    @property
    def by_hand(self) -> Twist2D | None:
        """The velocity of `drive_by_hand`; None if the robot follows `command`."""
        return self._by_hand

    def drive_by_hand(self, twist: Twist2D | None) -> None:
        """Commands a velocity that takes precedence over `command` until a call with None, which stops the robot.

        Raises InputError for a velocity that is not finite.
        """
        if twist is not None and not twist.is_finite():
            raise InputError(f"the command {tuple(twist)} is not finite", command=twist)
        self._by_hand = twist
        self._give(Twist2D() if twist is None else twist)

    def change_world(self, world: World) -> None:
        """Replaces the obstacles from the current step on; pedestrians that are in both worlds continue.

        Raises InputError for another map, or if an obstacle would overlap the robot; nothing has changed then.
        """
        if self._group is not None and self._group.has_others:
            raise InputError("the robots of a fleet share one world; its obstacles cannot be replaced during the run")
        if world.map is not self.world.map:
            raise InputError("a running world keeps its map; only its obstacles can be replaced")
        crowd = world.crowd(self._seed, self._crowd)
        solids = all_solids(world, crowd, self.time)
        if not self.in_collision:
            check_obstacles(world, self.footprint, self._collision_pose(self.pose), solids)
        self.world, self._crowd, self._solids = world, crowd, solids
        self._body["moving_obstacles"] = world.moves

    def place(self, pose: Pose2D, *, inform_localization: bool = True) -> None:
        """Puts the robot at `pose` (map frame), at rest; the odometry does not measure it.

        Its localization is set to the pose if `inform_localization`. Raises InputError if the robot
        collides there or the pose is not finite; nothing has changed then.
        """
        if not pose.is_finite():
            raise InputError(f"the pose {tuple(pose)} is not finite", pose=pose)
        check_pose(self.world, self.footprint, self._collision_pose(pose), self._solids)
        truth = Transform2D(pose.x, pose.y, normalize_angle(pose.yaw))
        state = self._state
        state["x"], state["y"], state["yaw"] = truth
        for name in _AT_REST:
            state[name] = 0.0
        self._now = _body_state(self._scalars.tolist())
        self._collided = False
        if not inform_localization and self.estimation.localizer is not None:
            return
        self._localization.error = Transform2D()
        self._believe(truth)

    def mislocalize(self, offset: Transform2D) -> None:
        """Lets the localization be off by `offset` (m, rad, in the robot's frame) from the true pose, from now on."""
        self._localization.error = offset
        self._believe(Transform2D(*self.pose) @ offset)

    def _believe(self, truth: Transform2D) -> None:
        """Sets the localization to a pose in the map."""
        self._localization.correct(Transform2D(*self.pose), self._odometry_pose)
        self.estimation.set_pose(truth, self._odometry_pose)
        localizes = self.estimation.localizer is not None
        current = self.estimation.correction if localizes else self._localization.current
        if self._localization.is_static:
            self.frames.set_static(self.map_frame, self.odom_frame, current)
        else:
            self.frames.set(self.map_frame, self.odom_frame, current, self.time)

    @property
    def fixed_yaw(self) -> float:
        """Yaw (rad) of a footprint that does not rotate with the robot; NaN: it rotates."""
        return self._fixed_yaw

    @property
    def collision_pose(self) -> Pose2D:
        """Where the footprint is in the map now: the pose, for a round robot with its fixed yaw."""
        return self._collision_pose(self.pose)

    def _collision_pose(self, pose: Pose2D) -> Pose2D:
        return pose if math.isnan(self._fixed_yaw) else pose._replace(yaw=self._fixed_yaw)

    def camera(self, name: str | None = None, *, width: int | None = None) -> CameraImage:
        """Return what a camera sees now: color and depth. Nothing is computed unless this is called.

        `name`: one of the parameter `cameras`, by default the first one. `width` (pixels): another size of the same view.
        Raises InputError for a name that the robot does not have, and for a width outside of 1 .. 4096.
        """
        names = self.params.cameras
        if not names or name not in (None, *names):
            wanted = "" if name is None else f' named "{name}"'
            raise InputError(
                f"the robot has no camera{wanted}, but these: {', '.join(names) or 'none'}; add it to navstack/sim/cameras",
                camera=name,
            )
        camera = self.params.camera(name or names[0])
        if width is not None:
            camera = camera.of_width(width)
        people = len(self.world.persons)
        return Camera(camera).image(self.world, self.pose, self.time, self._solids, people)

    # --- true state ---------------------------------------------------------------------------------------------------

    @property
    def pose(self) -> Pose2D:
        """True pose in the map."""
        now = self._now
        return Pose2D(now.x, now.y, now.yaw)

    @property
    def distance_travelled(self) -> float:
        """True length of the path driven (m)."""
        return self._now.distance

    @property
    def steering_angle(self) -> float:
        """Steering angle of a car or a tricycle (rad); 0 for any other base."""
        return self._now.steering

    @property
    def wheel_speeds(self) -> tuple[float, ...]:
        """Speeds of the wheels (rad/s), in the order of `navstack.core.kinematics`; empty for a base without wheels."""
        wheels = self.params.wheels
        return tuple(rim / wheels.radius for rim in self._state["rim"][0, : wheels.count].tolist())

    @property
    def encoder_ticks(self) -> tuple[int, ...]:
        """Counts of the wheels' encoders since the start; empty without `ticks_per_revolution`."""
        wheels = self.params.wheels
        if wheels.ticks_per_revolution is None:
            return ()
        return tuple(round(count) for count in self._state["ticks"][0, : wheels.count].tolist())

    @property
    def solids(self) -> Solids:
        """All obstacles that are not on the map at the current step, pedestrians last among the discs (m, map frame)."""
        return self._solids

    @property
    def people(self) -> NDArray[np.float64]:
        """(p, 2) positions of `World.persons` at the current step (m, map frame); NaN while one is absent. Read-only."""
        discs = self._solids.discs
        return discs[len(discs) - len(self.world.persons) :, :2]

    @property
    def groups(self) -> NDArray[np.int32]:
        """(p,) number of the group of each person, -1 without one."""
        replayed = np.full(len(self.world.replayed), -1, np.int32)
        return replayed if self._crowd is None else np.concatenate((replayed, self._crowd.groups))

    def walks(self) -> NDArray[np.float64]:
        """(p, 3) per person the time of its first arrival at a goal (s; inf: none), and how much longer it took to its last goal
        than in the same run without the robot: time (s) and path (m); NaN if unknown. The people walk that run now.
        """
        walks = np.full((len(self.world.persons), 3), math.nan)
        replayed, crowd = self.world.replayed, self._crowd
        ends = [shape.motion.points[-1][0] for shape in replayed if isinstance(shape.motion, ReplayMotion)]
        walks[: len(replayed), 0] = [end if end <= self.time else math.inf for end in ends]
        if crowd is None:
            return walks
        walks[len(replayed) :, 0] = crowd.first_arrivals
        if not crowd.notice_robot:
            walks[len(replayed) :, 1:] = np.where(crowd.arrivals > 0, 0.0, math.nan)[:, None]
        elif crowd.is_original:
            alone = self.world.crowd_without_robot(self._seed, crowd.arrivals, self._step, self._frequency)
            assert alone is not None
            walks[len(replayed) :, 1:] = crowd.delays(alone)
        return walks

    @property
    def clearance(self) -> float:
        """Distance (m) from the footprint to the nearest obstacle now, pedestrians included; 0 in collision, inf without any."""
        return float(self.clearances(np.array([self.pose]), self._solids)[0])

    def clearances(self, poses: NDArray[np.float64], solids: Solids) -> NDArray[np.float64]:
        """(n,) clearance (m) at each of the `poses` (n, 3) (m, rad, map frame) among `solids`."""
        if not math.isnan(self._fixed_yaw):
            poses = poses.copy()
            poses[:, 2] = self._fixed_yaw
        return self.world.clearances(poses, self.footprint, solids)

    @property
    def in_collision(self) -> bool:
        """True from a collision until the robot has left it."""
        return bool(self._now.collided or self._now.overrun)
