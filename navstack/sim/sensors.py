"""The sensors of a simulated robot and their timing: lidars, sonars, bumpers and IMUs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from navstack.core import Footprint, FrameTree, ImuReading, InputError, Pose2D, SensorData, Transform2D, angle_between
from navstack.parameters import SimParams
from navstack.sim.body import IN_COLLISION
from navstack.sim.bumper import Bumper
from navstack.sim.imu import Imu
from navstack.sim.lidar import Lidar, Sonar
from navstack.sim.solids import Solids
from navstack.sim.world import World


class _Measurement(NamedTuple):
    """A measurement that has not been fetched yet."""

    sensor: Lidar | Sonar | Bumper
    number: int
    step: int
    pose: Pose2D
    """True pose of the base."""
    solids: Solids


class SensorSuite:
    """Schedules the sensors by physics steps and computes measurements when they are fetched.

    Lidars, sonars and IMUs measure at their frequency. Bumpers publish a cloud when they are pressed, then at their frequency,
    and an empty cloud on release.
    """

    def __init__(self, params: SimParams, footprint: Footprint, start: Pose2D, *, seed: int) -> None:
        self._frequency = params.physics_frequency
        self._rangers: list[Lidar | Sonar] = [
            *(Lidar(params.lidar(name), seed=seed, number=i) for i, name in enumerate(params.lasers)),
            *(Sonar(params.sonar(name), seed=seed, number=i) for i, name in enumerate(params.sonars)),
        ]
        self._delays: dict[object, int] = {
            sensor: math.ceil(sensor.params.delay * self._frequency - 1e-9)
            for sensor in self._rangers
            if sensor.params.delay > 0.0
        }
        """Steps from a measurement to its arrival, of the sensors that have a delay."""
        self._imus = [Imu(params.imu(name), seed=seed, number=i) for i, name in enumerate(params.imus)]
        self._bumpers = [Bumper(params.bumper(name), footprint) for name in params.bumpers]
        self._next_scan = [0] * len(self._rangers)
        self._scan_steps = [0] * len(self._rangers)
        self._scan_due: float = 0
        """Physics step of the next scan of any ranger; inf without rangers."""
        self._next_imu = [1] * len(self._imus)
        self._imu_yaw = start.yaw
        self._next_cloud: list[int | None] = [None] * len(self._bumpers)
        """Per bumper: the number of its next cloud while it is pressed, else None."""
        self._pressed = False
        self._pending: list[_Measurement] = []

    def mount(self, frames: FrameTree, base_frame: str) -> None:
        """Adds the sensors' frames. Raises InputError for sensors in the same frame with different poses."""
        mountings: dict[str, Transform2D] = {}
        for frame, mounting in [
            *((sensor.params.frame, sensor.mounting) for sensor in (*self._rangers, *self._imus)),
            *((bumper.params.frame, Transform2D()) for bumper in self._bumpers),
        ]:
            if mountings.setdefault(frame, mounting) != mounting:
                raise InputError(
                    f'two sensors have the frame "{frame}" but different poses; give each its own frame', frame=frame
                )
            if frame != base_frame:
                frames.set_static(base_frame, frame, mounting)
            elif not mounting.is_identity():
                raise InputError(
                    f'a sensor has the base frame "{frame}" but is mounted at another pose; give it its own frame',
                    frame=frame,
                )

    def start(self, pose: Pose2D, solids: Solids) -> None:
        """Schedules the scans at time 0."""
        self._take_scans(0, pose, solids)

    def replace_solids(self, solids: Solids) -> None:
        """Lets the measurements that have not been fetched see these obstacles."""
        self._pending = [one._replace(solids=solids) for one in self._pending]

    def observe(
        self, before: int, rows: Sequence[Sequence[float]], solids: Callable[[int], Solids], *, collided: bool
    ) -> None:
        """Schedules the measurements of the steps after `before`, whose `samples` are `rows`.

        `solids`: the obstacles at a step. `collided`: the robot was in collision before or during these steps.
        """
        if self._imus:
            self._measure_imus(before, rows)
        if not self._pressed and not collided:
            last = before + len(rows)
            while self._scan_due <= last:
                step = max(int(self._scan_due), before + 1)
                row = rows[step - before - 1]
                self._take_scans(step, Pose2D(row[0], row[1], row[2]), solids(step))
            return
        for step, row in enumerate(rows, before + 1):
            if step >= self._scan_due:
                self._take_scans(step, Pose2D(row[0], row[1], row[2]), solids(step))
            colliding = row[IN_COLLISION] != 0.0
            if colliding or self._pressed:
                self._press_bumpers(step, Pose2D(row[0], row[1], row[2]), solids(step), colliding)

    def scans(self, world: World, now: int) -> list[SensorData]:
        """Computes the measurements of lidars, sonars and bumpers that arrived up to step `now` since the last call.

        In the order of their arrival; those that arrive at once, the oldest first.
        """
        pending, self._pending = self._pending, []
        if self._delays:
            self._pending = [one for one in pending if one.step + self._delays.get(one.sensor, 0) > now]
            pending = [one for one in pending if one.step + self._delays.get(one.sensor, 0) <= now]
            pending.sort(key=lambda one: one.step + self._delays.get(one.sensor, 0))
        return [
            sensor.scan(world, pose, number, step / self._frequency, solids)
            for sensor, number, step, pose, solids in pending
        ]

    def imu_readings(self) -> list[ImuReading]:
        """Returns the IMU readings since the last call, by IMU, oldest first."""
        return [reading for imu in self._imus for reading in imu.fetch()]

    def _measure_imus(self, before: int, rows: Sequence[Sequence[float]]) -> None:
        for step, row in enumerate(rows, before + 1):
            rate = angle_between(self._imu_yaw, row[2]) * self._frequency
            self._imu_yaw = row[2]
            for number, imu in enumerate(self._imus):
                index = self._next_imu[number]
                if self._step_of(imu, index) <= step:
                    imu.measure(row[2], rate, step / self._frequency)
                    self._next_imu[number] = self._index_after(index, step, imu)

    def _take_scans(self, step: int, pose: Pose2D, solids: Solids) -> None:
        """Adds the scans due at `step` and schedules the next ones."""
        due = self._scan_steps
        for number, sensor in enumerate(self._rangers):
            if due[number] <= step:
                index = self._next_scan[number]
                self._pending.append(_Measurement(sensor, index, step, pose, solids))
                self._next_scan[number] = index = self._index_after(index, step, sensor)
                due[number] = self._step_of(sensor, index)
        self._scan_due = min(due, default=math.inf)

    def _press_bumpers(self, step: int, pose: Pose2D, solids: Solids, colliding: bool) -> None:
        """Adds the bumpers' clouds: at once when pressed, then at their frequency, and one on release."""
        for number, bumper in enumerate(self._bumpers):
            index = self._next_cloud[number]
            if index is None:
                if not colliding:
                    continue
            elif self._step_of(bumper, index) > step:
                continue
            self._pending.append(_Measurement(bumper, int(colliding), step, pose, solids))
            self._next_cloud[number] = self._index_after(0, step, bumper) if colliding else None
        self._pressed = any(index is not None for index in self._next_cloud)

    def _index_after(self, index: int, step: int, sensor: Lidar | Sonar | Bumper | Imu) -> int:
        """Number of the measurement that follows number `index`, taken at `step`; skips missed ones."""
        return max(index, math.floor(step * sensor.params.frequency / self._frequency + 1e-6)) + 1

    def _step_of(self, sensor: Lidar | Sonar | Bumper | Imu, index: int) -> int:
        """The first physics step at or after the time of a measurement."""
        return math.ceil(index * self._frequency / sensor.params.frequency - 1e-6)
