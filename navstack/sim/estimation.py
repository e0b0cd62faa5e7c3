"""What the simulated robot believes: its pose in the map from a localizer, its odometry from a filter."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from navstack.core import FrameError, FrameTree, ImuReading, LaserScan, Pose2D, SensorData, Transform2D, Twist2D
from navstack.parameters import SimParams
from navstack.plugins import LocalizationStatus, Localizer, OdometryFilter, PoseEstimate

GIVEN_COVARIANCE = np.diag([0.01, 0.01, 0.003])
"""Of a pose that a person gives (m², rad²)."""


class Estimation:
    """A localizer and an odometry filter, fed with the simulated sensors; either may be absent."""

    def __init__(
        self,
        localizer: Localizer | None = None,
        odometry: OdometryFilter | None = None,
        believed: Pose2D | None = None,
    ) -> None:
        """The localizer has its map and its first pose; `believed` is where the robot takes itself to be at the start."""
        self._believed = believed
        self.localizer = localizer
        self.odometry = odometry
        self._topic = ""
        self._frames: tuple[str, str, str] = ("map", "odom", "base_link")
        self._unfetched: list[SensorData] = []
        self._correction = Transform2D()

    def begin(self, params: SimParams, frames: tuple[str, str, str], odometry: Transform2D) -> None:
        """Name the frames of map, odometry and base, and the first odometry."""
        self._topic = params.lidar(params.lasers[0]).topic if params.lasers else ""
        self._frames = frames
        if self._believed is not None:
            self._correction = Transform2D(*self._believed) @ odometry.inverse()

    @property
    def correction(self) -> Transform2D:
        """The current transform map -> odom."""
        return self._correction

    @property
    def estimate(self) -> PoseEstimate | None:
        """The localizer's last estimate."""
        return None if self.localizer is None else self.localizer.estimate

    @property
    def status(self) -> LocalizationStatus | None:
        """Whether the robot is localized; None without a localizer that watches it."""
        return None if self.localizer is None else self.localizer.status

    def set_pose(self, pose: Transform2D, odometry: Transform2D) -> None:
        """Set the pose of the base in the map, as a person does."""
        if self.localizer is not None:
            self.localizer.set_pose(Pose2D(*pose), GIVEN_COVARIANCE, math.inf)
            self._correction = pose @ odometry.inverse()

    def process(self, data: Sequence[SensorData], frames: FrameTree) -> bool:
        """Give new scans to the localizer; return True if map -> odom has changed. `fetch` returns the data later."""
        self._unfetched += data
        changed = False
        _, odom, base = self._frames
        if self.localizer is None:
            return False
        for scan in data:
            if not isinstance(scan, LaserScan) or scan.topic != self._topic:
                continue
            try:
                pose = frames.lookup(odom, base, scan.stamp, math.inf)
                sensor = frames.lookup(base, scan.frame)
            except FrameError:
                continue
            found = self.localizer.update(pose, scan, sensor)
            if found is not None:
                self._correction = found.map_to_odom
                changed = True
        return changed

    def fetch(self) -> list[SensorData]:
        """Return the data since the last call."""
        data, self._unfetched = self._unfetched, []
        return data

    def filtered(
        self, wheels: Sequence[Transform2D], stamps: Sequence[float], readings: Sequence[ImuReading]
    ) -> list[Transform2D]:
        """Return the odometry's poses at `stamps` (s) from those of the wheels."""
        return list(wheels) if self.odometry is None else self.odometry.run(wheels, stamps, readings)

    @property
    def twist(self) -> Twist2D | None:
        """Velocity by the filter; None without one."""
        return None if self.odometry is None else self.odometry.twist


class Localization:
    """Computes map -> odom from true poses, as ROS's fake_localization does.

    An update compares the true pose with the odometry at the same time, so a delay delays the correction, not the pose:
    between updates the robot follows its odometry. `delta_x`, `delta_y`, `delta_yaw` are those of fake_localization: the origin
    of the localization's map in the simulator's (a point p of the latter is R(-yaw) p - (x, y) in the former).
    """

    def __init__(self, params: SimParams, *, seed: int, offset: Transform2D) -> None:
        """`offset`: the pose of the odometry frame in the simulator's map at the start."""
        self._noise = (params.localization_noise, params.localization_noise, params.localization_yaw_noise)
        self._noisy = any(sigma > 0.0 for sigma in self._noise)
        self._seed = seed
        self._physics = params.physics_frequency
        self._frequency = params.localization_frequency
        self._delay_steps = math.ceil(params.localization_delay * self._physics - 1e-9)
        self._delta = Transform2D(-params.delta_x, -params.delta_y, -params.delta_yaw)
        self._shifted = not self._delta.is_identity()
        self.error = Transform2D()
        """From the true pose to the one that is taken for it, in the robot's frame."""
        self._update = 0
        self._next_step = 0
        # (step from which it is in force, map -> odom), oldest first
        self._delayed: deque[tuple[int, Transform2D]] = deque()
        truth = params.localization == "truth"
        self.start = self._delta @ offset if self._shifted and truth else offset
        """map -> odom before the first update."""
        drifts = (
            params.wheel_slip > 0.0
            or params.odometry_noise > 0.0
            or params.wheel_slip_turn > 0.0
            or params.odometry_noise_turn > 0.0
            or params.odometry_scale != 0.0
            or params.odometry_turn != 0.0
        )
        self.is_static = not (truth and (drifts or self._noisy))
        """True if map -> odom is constant."""
        self._current = self.start

    @property
    def current(self) -> Transform2D:
        """Current transform map -> odom."""
        return self._current

    def correct(self, truth: Transform2D, odometry: Transform2D) -> None:
        """Sets map -> odom at once for the base at `truth` (map) and, by its odometry, at `odometry`; drops delayed updates."""
        self._delayed.clear()
        self._current = self._correction(truth, odometry)

    def at(self, step: int, truth: Transform2D, odometry: Transform2D) -> Transform2D:
        """Returns map -> odom at a physics step with the base at `truth` (map) and, by its odometry, at `odometry`.

        Must be called for every step, in order.
        """
        if step >= self._next_step:
            self._delayed.append((step + self._delay_steps, self._correction(truth, odometry)))
            self._update += 1
            if self._frequency is None:
                self._next_step = step + 1
            else:
                passed = math.floor(step * self._frequency / self._physics + 1e-6)
                self._update = max(self._update, passed + 1)
                self._next_step = math.ceil(self._update * self._physics / self._frequency - 1e-6)
        while self._delayed and self._delayed[0][0] <= step:
            self._current = self._delayed.popleft()[1]
        return self._current

    def _correction(self, truth: Transform2D, odometry: Transform2D) -> Transform2D:
        if not self.error.is_identity():
            truth = truth @ self.error
        if self._shifted:
            truth = self._delta @ truth
        if self._noisy:
            rng = np.random.Generator(np.random.PCG64([self._seed, 1 << 23, self._update]))
            dx, dy, dyaw = (rng.standard_normal(3) * self._noise).tolist()
            truth = Transform2D(truth.x + dx, truth.y + dy, truth.yaw + dyaw)
        return truth @ odometry.inverse()
