"""A robot in a simulated world: what `navstack.interfaces.Robot` asks for, and what only a simulator knows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Footprint,
    FrameTree,
    ImuReading,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    angle_between,
    normalize_angle,
)
from navstack.core.errors import InputError
from navstack.parameters.models.sim import SimParams
from navstack.sim import _body_kernels as body
from navstack.sim.body import body_model, steering
from navstack.sim.bumper import Bumper
from navstack.sim.imu import Imu
from navstack.sim.lidar import Lidar
from navstack.sim.localization import Localization
from navstack.sim.solids import Solids, joined
from navstack.sim.sonar import Sonar
from navstack.sim.world import World

_NO_NOISE = np.empty((0, 8))
_STOP = Twist2D()
_transform: Callable[[list[float]], Transform2D] = partial(tuple.__new__, Transform2D)  # pyright: ignore[reportAssignmentType]


@dataclass(frozen=True, slots=True)
class Collision:
    """The robot touched something; it counts once until it is left."""

    time: float
    """Seconds."""
    pose: Pose2D
    """Of the robot, in the map, where it was stopped."""
    kind: str
    """`map`, `disc` or `polygon`."""
    index: int
    """Of the cell (iy * nx + ix), of the disc or of the polygon."""
    at: tuple[float, float]
    """Centre of what was hit, in the map (m)."""
    name: str = ""
    """Of a shape that has one."""


class _Due(NamedTuple):
    """What a sensor measures that nobody has fetched yet."""

    sensor: Lidar | Sonar | Bumper
    number: int
    step: int
    pose: Pose2D
    """True pose of the base."""
    solids: Solids


class SimulatedRobot:
    """A body, its odometry and sensors, its localization, and the people around it, in a `World`.

    Time is counted in whole physics steps; nothing here reads a clock.

    A collision stops the robot where it was last free (to within 5 mm), wheels included; a round one (`from_radius`) goes on
    turning even then. What moves over it stops it where it is; then it may turn, and drive where its centre does not come
    nearer to that. A run is a pure function of the parameters, the world, the start, the seed and the commands.
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
    ) -> None:
        """`footprint` as it really is, without padding; `start` in the map (m, rad).

        Raises InputError when the robot does not fit there, and for sensors that share a frame but not a place.
        """
        if not start.is_finite():
            raise InputError(f"the start {tuple(start)} is not finite", pose=start)
        if seed < 0:
            raise InputError(f"the seed {seed} is below 0; give a whole number from 0 on", seed=seed)
        self._crowd = world.crowd(seed)
        self._solids = world.solids_at(0.0)
        if self._crowd is not None:
            self._solids = joined([self._solids, self._crowd.solids()])
        touched = world.collision(footprint, start, solids=self._solids)
        if touched is not None:
            raise InputError(
                f"the robot does not fit at the start ({start.x:g}, {start.y:g}, {start.yaw:g}): it touches the "
                f"{touched[0]} at ({touched[2]:.2f}, {touched[3]:.2f})",
                pose=start,
            )
        self.params = params
        self.world = world
        self.footprint = footprint
        self._body = body_model(params, footprint, start.yaw)
        self.base_frame, self.odom_frame, self.map_frame = base_frame, odom_frame, map_frame
        self.frames = FrameTree()
        self.collisions: list[Collision] = []

        self._step = 0
        self._frequency = params.physics_frequency
        self._dt = 1.0 / self._frequency
        self._delay_steps = math.ceil(params.command_delay * self._frequency - 1e-9)
        self._timeout_steps = (
            None if params.command_timeout is None else math.ceil(params.command_timeout * self._frequency - 1e-9)
        )
        # (step from which it holds, command), oldest first; the first one is in force
        self._commands: deque[tuple[int, Twist2D]] = deque([(0, _STOP)])
        self._steering = 0.0
        self._turning_noise = params.wheel_slip_turn > 0.0 or params.odometry_noise_turn > 0.0
        self._noisy = params.wheel_slip > 0.0 or params.odometry_noise > 0.0 or self._turning_noise
        self._turning_rng = np.random.Generator(np.random.PCG64([seed, 1 << 24]))
        self._rng = np.random.Generator(np.random.PCG64([seed, 0]))

        offset = Transform2D(params.map_to_odom[0], params.map_to_odom[1], normalize_angle(params.map_to_odom[2]))
        odometry = offset.inverse().apply(Pose2D(start.x, start.y, normalize_angle(start.yaw)))
        self._state = np.zeros(body.STATE_SIZE)
        self._state[body.X : body.YAW + 1] = start.x, start.y, normalize_angle(start.yaw)
        self._state[body.OX : body.OYAW + 1] = odometry
        self._now: list[float] = self._state.tolist()  # what is asked for again and again
        self._samples = np.empty((0, 10))
        self._collided = np.empty((0, 2), np.int64)

        self._localization = Localization(params, seed=seed, offset=offset)
        if self._localization.is_static:
            self.frames.set_static(map_frame, odom_frame, self._localization.start)
        self._rangers: list[Lidar | Sonar] = [
            *(Lidar(params.lidar(name), seed=seed, number=i) for i, name in enumerate(params.lasers)),
            *(Sonar(params.sonar(name), seed=seed, number=i) for i, name in enumerate(params.sonars)),
        ]
        self._imus = [Imu(params.imu(name), seed=seed, number=i) for i, name in enumerate(params.imus)]
        self._bumpers = [Bumper(params.bumper(name), footprint) for name in params.bumpers]
        mounted: dict[str, Transform2D] = {}
        for frame, mounting in [
            *((sensor.params.frame, sensor.mounting) for sensor in (*self._rangers, *self._imus)),
            *((bumper.params.frame, Transform2D()) for bumper in self._bumpers),
        ]:
            if mounted.setdefault(frame, mounting) != mounting:
                raise InputError(
                    f'two sensors share the frame "{frame}" but not its place; give each a frame of its own',
                    frame=frame,
                )
            if frame != base_frame:
                self.frames.set_static(base_frame, frame, mounting)
            elif not mounting.is_identity():
                raise InputError(
                    f"a sensor's frame \"{frame}\" is the robot's own, yet it is mounted elsewhere; name another frame",
                    frame=frame,
                )
        self._next_scan = [0] * len(self._rangers)
        self._scan_steps = [0] * len(self._rangers)
        self._next_imu = [1] * len(self._imus)
        self._imu_yaw = start.yaw
        # per bumper: the number of its next cloud while it is pressed, None otherwise
        self._next_cloud: list[int | None] = [None] * len(self._bumpers)
        self._pressed = False
        self._touched = False  # before or in the steps that were not observed yet
        self._pending: list[_Due] = []
        self._scan_due: float = 0
        self.frames.set(odom_frame, base_frame, Transform2D(*odometry), 0.0)
        if not self._localization.is_static:
            self.frames.set(map_frame, odom_frame, self._localization.start, 0.0)
        self._take_scans(0, self.pose)

    # --- time ---------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Seconds since the start: a whole number of physics steps."""
        return self._step / self._frequency

    def advance_to(self, time: float) -> NDArray[np.float64]:
        """Drives on to the first physics step at or after `time` (s).

        Returns the samples after each step, (n, 9): true x, y, yaw (map), odometry x, y, yaw (odom), vx, vy, wz. A view
        that the next call overwrites.
        """
        if not math.isfinite(time):
            raise InputError(f"cannot simulate until {time}", time=time)
        first = self._step
        last = max(first, math.ceil(time * self._frequency - 1e-6))
        steps = last - first
        if len(self._samples) < steps:
            self._samples = np.empty((steps, 10))
            self._collided = np.empty((2 * steps, 2), np.int64)
        observed = first
        while self._step < last:
            # among moving obstacles step by step, each at its place of the time
            self._drive(self._commanded_until(self._step + 1 if self.world.moves else last), first)
            if self.world.moves:
                self._observe(first, observed)
                observed = self._step
        if observed < last:
            self._observe(first, observed)
        return self._samples[:steps, :9]

    def _commanded_until(self, last: int) -> int:
        """The step up to which the command in force at the present step holds."""
        while len(self._commands) > 1 and self._commands[1][0] <= self._step:
            self._commands.popleft()
        until = min(last, self._commands[1][0]) if len(self._commands) > 1 else last
        if self._timeout_steps is not None:
            stale = self._commands[0][0] + self._timeout_steps
            if stale <= self._step:
                self._commands[0] = (self._commands[0][0], _STOP)
            else:
                until = min(until, stale)
        return until

    def _drive(self, until: int, first: int) -> None:
        steps, done = until - self._step, self._step - first
        samples = self._samples[done:]
        self._solids = self._solids_until(until)
        hits = body.drive(
            self._state,
            self._wheels_command(),
            steps,
            self._dt,
            *self._body,
            self._noise(steps) if self._noisy else _NO_NOISE,
            self.world.squares,
            self.world.grid,
            *self._solids,
            self.world.moves,
            samples,
            self._collided,
        )
        self._now = self._state.tolist()
        self._touched = self._touched or hits > 0 or self.in_collision
        for row in range(hits):
            step, hit = int(self._collided[row, 0]), int(self._collided[row, 1])
            kind, index, x, y = self.world.described(hit, self._solids)
            pose = Pose2D(*samples[step, :3].tolist())
            time, name = (self._step + step + 1) / self._frequency, self.world.name_of(kind, index)
            self.collisions.append(Collision(time, pose, kind, index, (x, y), name))
        self._step = until

    def _solids_until(self, until: int) -> Solids:
        """What stands beside the map at step `until`; people walk on to it."""
        solids = self.world.solids_at(until / self._frequency)
        crowd = self._crowd
        if crowd is None:
            return solids
        x, y, yaw, vx, vy = self._now[body.X : body.VY + 1]
        c, s = math.cos(yaw), math.sin(yaw)
        robot = np.array([x, y, c * vx - s * vy, s * vx + c * vy, self._body.radius])
        crowd.step((until - self._step) * self._dt, self.world.squares, self.world.grid, solids, robot)
        return solids._replace(
            discs=np.concatenate((solids.discs, crowd.solids().discs)), disc_tops=self._solids.disc_tops
        )

    def _wheels_command(self) -> NDArray[np.float64]:
        """The command in force as the kernel takes it: a car's with a steering angle."""
        twist = self._commands[0][1]
        if self.params.kinematics == "ackermann":
            self._steering = steering(self.params, twist, self._steering)
            return np.array([twist.vx, 0.0, self._steering])
        return np.array(twist)

    def _noise(self, steps: int) -> NDArray[np.float64]:
        """Errors per step, (steps, 8): relative ones, whose variances add up to the parameter's square over the steps of a
        second; and of the headings, for every root of a metre.
        """
        noise = np.zeros((steps, 8))
        relative = self._rng.standard_normal((steps, 6)) * math.sqrt(self._frequency)
        noise[:, :3] = relative[:, :3] * self.params.wheel_slip
        noise[:, 3:6] = relative[:, 3:] * self.params.odometry_noise
        if self._turning_noise:
            turning = self.params.wheel_slip_turn, self.params.odometry_noise_turn
            noise[:, 6:] = self._turning_rng.standard_normal((steps, 2)) * turning
        return noise

    # --- what the robot knows -----------------------------------------------------------------------------------------

    def state(self) -> RobotState:
        """Odometry: pose in the odometry frame, velocity of the wheels, at the present step."""
        now = self._now
        return RobotState(
            Pose2D(now[body.OX], now[body.OY], now[body.OYAW]),
            Twist2D(now[body.VX], now[body.VY], now[body.WZ]),
            self.time,
            self.odom_frame,
        )

    def scans(self) -> Sequence[SensorData]:
        """What the sensors measured since the last call, oldest first, each from where the robot was at its time.

        Lidars and sonars measure at their frequency. Bumpers give clouds while they are pressed, at once and then at
        theirs, and an empty one when they are released.
        """
        pending, self._pending = self._pending, []
        return [
            sensor.scan(self.world, pose, number, step / self._frequency, solids)
            for sensor, number, step, pose, solids in pending
        ]

    def imu_readings(self) -> Sequence[ImuReading]:
        """What the IMUs measured since the last call, one IMU after the other, each oldest first."""
        return [reading for imu in self._imus for reading in imu.fetch()]

    def command(self, twist: Twist2D) -> None:
        """Drive so from the present step on, after the dead time; only a holonomic base takes the sideways part."""
        if not twist.is_finite():
            raise InputError(f"cannot drive at {tuple(twist)}: a velocity is a finite number", command=twist)
        if self.params.kinematics != "holonomic" and twist.vy != 0.0:
            twist = Twist2D(twist.vx, 0.0, twist.wz)
        step = self._step + self._delay_steps
        if self._commands[-1][0] == step:
            self._commands.pop()
        self._commands.append((step, twist))

    # --- what only a simulator knows ----------------------------------------------------------------------------------

    @property
    def pose(self) -> Pose2D:
        """Where the robot truly is, in the map."""
        now = self._now
        return Pose2D(now[body.X], now[body.Y], now[body.YAW])

    @property
    def distance_travelled(self) -> float:
        """Length of the way truly driven, metres."""
        return self._now[body.DISTANCE]

    @property
    def steering_angle(self) -> float:
        """Of a car's front wheel, rad; 0 for any other base."""
        return self._now[body.STEER]

    @property
    def solids(self) -> Solids:
        """Everything beside the map at the present step, people last among the discs (m, map frame)."""
        return self._solids

    @property
    def clearance(self) -> float:
        """Distance (m) from the outline to the nearest obstacle now, people included; 0 in collision, inf when alone."""
        return float(self.clearances(np.array([self.pose]), self._solids)[0])

    def clearances(self, poses: NDArray[np.float64], solids: Solids) -> NDArray[np.float64]:
        """(n,) m: `clearance` as it was at each of the `poses` (n, 3) (m, rad, map frame) among `solids`."""
        facing = self._body.facing
        if not math.isnan(facing):
            poses = poses.copy()
            poses[:, 2] = facing
        return self.world.clearances(poses, self.footprint, solids)

    @property
    def in_collision(self) -> bool:
        """True from a collision until it is left."""
        return bool(self._now[body.TOUCHING] or self._now[body.OVERRUN])

    # --- publishing ---------------------------------------------------------------------------------------------------

    def _observe(self, first: int, observed: int) -> None:
        """Publishes the frames and takes the scans of the steps in (observed, now]; `samples` begin after step `first`."""
        frequency, last = self._frequency, self._step
        samples = self._samples[observed - first : last - first]
        rows: list[list[float]] = samples.tolist()
        stamps = [step / frequency for step in range(observed + 1, last + 1)]
        moved = list(map(_transform, samples[:, 3:6].tolist()))
        self.frames.extend(self.odom_frame, self.base_frame, moved, stamps)
        if not self._localization.is_static:
            found = [
                self._localization.at(step, Transform2D(row[0], row[1], row[2]), m)
                for step, (row, m) in enumerate(zip(rows, moved, strict=True), observed + 1)
            ]
            self.frames.extend(self.map_frame, self.odom_frame, found, stamps)
        if self._imus:
            self._turned(observed, rows)
        if not self._pressed and not self._touched:
            while self._scan_due <= last:
                step = max(int(self._scan_due), observed + 1)
                row = rows[step - observed - 1]
                self._take_scans(step, Pose2D(row[0], row[1], row[2]))
            return
        for step, row in enumerate(rows, observed + 1):
            if step >= self._scan_due:
                self._take_scans(step, Pose2D(row[0], row[1], row[2]))
            if row[9] != 0.0 or self._pressed:
                self._feel(step, Pose2D(row[0], row[1], row[2]), row[9] != 0.0)
        self._touched = self.in_collision

    def _turned(self, observed: int, rows: list[list[float]]) -> None:
        """Hands the IMUs the steps after `observed` that are theirs."""
        for step, row in enumerate(rows, observed + 1):
            rate = angle_between(self._imu_yaw, row[2]) * self._frequency
            self._imu_yaw = row[2]
            for number, imu in enumerate(self._imus):
                index = self._next_imu[number]
                if self._scan_step(imu, index) <= step:
                    imu.feel(row[2], rate, step / self._frequency)
                    self._next_imu[number] = self._after(index, step, imu)

    def _take_scans(self, step: int, pose: Pose2D) -> None:
        """Notes the scans that are due at `step`, and when the next one will be."""
        due = self._scan_steps
        for number, sensor in enumerate(self._rangers):
            if due[number] <= step:
                index = self._next_scan[number]
                self._pending.append(_Due(sensor, index, step, pose, self._solids))
                self._next_scan[number] = index = self._after(index, step, sensor)
                due[number] = self._scan_step(sensor, index)
        self._scan_due = min(due, default=math.inf)

    def _feel(self, step: int, pose: Pose2D, touching: bool) -> None:
        """Notes the clouds of the bumpers: the first at once, the others at their frequency, the last when it is over."""
        for number, bumper in enumerate(self._bumpers):
            index = self._next_cloud[number]
            if index is None:
                if not touching:
                    continue
            elif self._scan_step(bumper, index) > step:
                continue
            self._pending.append(_Due(bumper, int(touching), step, pose, self._solids))
            self._next_cloud[number] = self._after(0, step, bumper) if touching else None
        self._pressed = any(index is not None for index in self._next_cloud)

    def _after(self, index: int, step: int, sensor: Lidar | Sonar | Bumper | Imu) -> int:
        """The number of the scan that follows number `index`, taken at `step`; those that were missed are left out."""
        return max(index, math.floor(step * sensor.params.frequency / self._frequency + 1e-6)) + 1

    def _scan_step(self, sensor: Lidar | Sonar | Bumper | Imu, index: int) -> int:
        """The first physics step that is not before the time of that scan."""
        return math.ceil(index * self._frequency / sensor.params.frequency - 1e-6)
