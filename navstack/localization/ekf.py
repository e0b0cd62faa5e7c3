"""Odometry from several sensors: an extended Kalman filter with the parameters of robot_localization."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import ImuReading, InputError, Pose2D, Transform2D, Twist2D, kernel
from navstack.parameters import PLANAR, FilterParams, SourceParams
from navstack.plugins import OdometryFilter

# ----------------------------------------------------------------------------------------------------------------------
# The extended Kalman filter of a planar robot: x, y, yaw, vx, vy, vyaw, ax, ay (m, rad, s; velocities in the base frame).


SIZE = 8
YAW = 2
LEAST_VARIANCE = 1e-9
"""Smaller variances of measurements count as this."""
NO_INFORMATION = 1e12
"""Larger variances of measurements say nothing: the element is left out."""
INFLATION = 1e-13
"""Relative growth of the variances per correction: more than the rounding errors, so that the covariance stays definite."""
LARGEST = 1e7
"""Larger values (m, rad, m/s ..) are no measurement."""
FUSED, OUTLIER, EMPTY, NOT_A_NUMBER, TOO_LARGE = 0, 1, 2, 3, 4


@kernel
def predict(state: NDArray[np.float64], covariance: NDArray[np.float64], noise: NDArray[np.float64], dt: float) -> None:
    """Move `state` (8,) and `covariance` (8, 8) by `dt` (s) with constant acceleration; `noise` (8, 8) is per second."""
    yaw, vx, vy, ax, ay = state[2], state[3], state[4], state[6], state[7]
    c, s = math.cos(yaw), math.sin(yaw)
    half = 0.5 * dt * dt
    forward, left = vx * dt + ax * half, vy * dt + ay * half
    jacobian = np.eye(SIZE)
    jacobian[0, 2] = -s * forward - c * left
    jacobian[1, 2] = c * forward - s * left
    jacobian[0, 3], jacobian[0, 4] = c * dt, -s * dt
    jacobian[1, 3], jacobian[1, 4] = s * dt, c * dt
    jacobian[0, 6], jacobian[0, 7] = c * half, -s * half
    jacobian[1, 6], jacobian[1, 7] = s * half, c * half
    jacobian[2, 5] = dt
    jacobian[3, 6] = dt
    jacobian[4, 7] = dt
    state[0] += c * forward - s * left
    state[1] += s * forward + c * left
    state[2] = wrapped(yaw + state[5] * dt)
    state[3] += ax * dt
    state[4] += ay * dt
    transform(jacobian, covariance)
    for i in range(SIZE):
        for k in range(SIZE):
            covariance[i, k] += noise[i, k] * dt


@kernel
def fuse(
    state: NDArray[np.float64],
    covariance: NDArray[np.float64],
    noise: NDArray[np.float64],
    dt: float,
    measured: NDArray[np.float64],
    variances: NDArray[np.float64],
    used: NDArray[np.bool_],
    threshold: float,
    innovation: NDArray[np.float64],
) -> int:
    """Predict by `dt` (s) and correct; see `correct`. Unless it returns FUSED, state and covariance are as before."""
    innovation[:] = math.nan
    for i in range(SIZE):
        if used[i]:
            if math.isnan(measured[i]) or math.isnan(variances[i, i]):
                return NOT_A_NUMBER
            if abs(measured[i]) > LARGEST:
                return TOO_LARGE
    x = state.copy()
    p = covariance.copy()
    if dt > 0.0:
        predict(x, p, noise, dt)
    result = correct(x, p, measured, variances, used, threshold, innovation)
    if result == FUSED:
        for i in range(SIZE):
            state[i] = x[i]
            for k in range(SIZE):
                covariance[i, k] = p[i, k]
    return result


@kernel
def wrapped(angle: float) -> float:
    """Return `angle` (rad) in (-pi, pi]."""
    if -math.pi < angle <= math.pi:
        return angle
    turned = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)
    return math.pi if turned <= -math.pi else turned


@kernel
def transform(matrix: NDArray[np.float64], covariance: NDArray[np.float64]) -> None:
    """Replace `covariance` by matrix @ covariance @ matrix.T, exactly symmetric."""
    half = np.zeros((SIZE, SIZE))
    for i in range(SIZE):
        for j in range(SIZE):
            factor = matrix[i, j]
            if factor != 0.0:
                for k in range(SIZE):
                    half[i, k] += factor * covariance[j, k]
    for i in range(SIZE):
        for k in range(i + 1):
            total = 0.0
            for j in range(SIZE):
                total += half[i, j] * matrix[k, j]
            covariance[i, k] = total
            covariance[k, i] = total


@kernel
def correct(
    state: NDArray[np.float64],
    covariance: NDArray[np.float64],
    measured: NDArray[np.float64],
    variances: NDArray[np.float64],
    used: NDArray[np.bool_],
    threshold: float,
    innovation: NDArray[np.float64],
) -> int:
    """Fuse the `used` (8,) elements of `measured` (8,) with covariance `variances` (8, 8), by Joseph's form.

    `innovation` (9,) receives the differences and, last, the Mahalanobis distance. From `threshold` on the measurement is an
    OUTLIER and the state stays; EMPTY without a usable element.
    """
    index = np.empty(SIZE, np.int64)
    m = 0
    for i in range(SIZE):
        innovation[i] = 0.0
        if used[i] and math.isfinite(measured[i]) and abs(variances[i, i]) <= NO_INFORMATION:
            index[m] = i
            m += 1
    innovation[SIZE] = 0.0
    if m == 0:
        return EMPTY
    r = np.zeros((m, m))
    lower = np.zeros((m, m))
    difference = np.empty(m)
    for a in range(m):
        i = index[a]
        difference[a] = measured[i] - state[i]
        if i == YAW:
            difference[a] = wrapped(difference[a])
        innovation[i] = difference[a]
        for b in range(m):
            value = variances[i, index[b]]
            r[a, b] = value if math.isfinite(value) else 0.0
        r[a, a] = max(abs(r[a, a]), LEAST_VARIANCE)
    for a in range(m):
        for b in range(a):
            bound = 0.999 * math.sqrt(r[a, a]) * math.sqrt(r[b, b])
            value = max(-bound, min(bound, 0.5 * (r[a, b] + r[b, a])))
            r[a, b] = value
            r[b, a] = value
    root = np.zeros((m, m))
    if not factorize(np.zeros((SIZE, SIZE)), r, index[:m], root):
        # correlations that no covariance has: the variances alone count
        root[:] = 0.0
        for a in range(m):
            root[a, a] = math.sqrt(r[a, a])
            r[a, :a] = 0.0
            r[a, a + 1 :] = 0.0
    if not factorize(covariance, r, index[:m], lower):
        return EMPTY
    distance = 0.0
    solved = np.empty(m)
    for a in range(m):
        total = difference[a]
        for b in range(a):
            total -= lower[a, b] * solved[b]
        solved[a] = total / lower[a, a]
        distance += solved[a] * solved[a]
    innovation[SIZE] = math.sqrt(distance)
    if innovation[SIZE] >= threshold:
        return OUTLIER
    update(state, covariance, root, index[:m], lower, difference)
    return FUSED


@kernel
def factorize(
    covariance: NDArray[np.float64], r: NDArray[np.float64], index: NDArray[np.int64], lower: NDArray[np.float64]
) -> bool:
    """Fill `lower` with the Cholesky factor of the innovation's covariance; return False if there is none."""
    m = len(index)
    for a in range(m):
        for b in range(a + 1):
            total = covariance[index[a], index[b]] + r[a, b]
            for k in range(b):
                total -= lower[a, k] * lower[b, k]
            if a == b:
                if not total > 0.0:
                    return False
                lower[a, a] = math.sqrt(total)
            else:
                lower[a, b] = total / lower[b, b]
    return True


@kernel
def update(
    state: NDArray[np.float64],
    covariance: NDArray[np.float64],
    root: NDArray[np.float64],
    index: NDArray[np.int64],
    lower: NDArray[np.float64],
    difference: NDArray[np.float64],
) -> None:
    """Apply the gain of `correct`: P = (I - K H) P (I - K H)' + K R K', with R = root @ root'."""
    m = len(index)
    gain = np.empty((SIZE, m))
    left = np.eye(SIZE)
    for i in range(SIZE):
        for a in range(m):
            total = covariance[i, index[a]]
            for b in range(a):
                total -= lower[a, b] * gain[i, b]
            gain[i, a] = total / lower[a, a]
        for a in range(m - 1, -1, -1):
            total = gain[i, a]
            for b in range(a + 1, m):
                total -= lower[b, a] * gain[i, b]
            gain[i, a] = total / lower[a, a]
        for a in range(m):
            state[i] += gain[i, a] * difference[a]
            left[i, index[a]] -= gain[i, a]
    state[YAW] = wrapped(state[YAW])
    transform(left, covariance)
    spread = np.zeros((SIZE, m))
    for i in range(SIZE):
        for a in range(m):
            for b in range(a, m):
                spread[i, a] += gain[i, b] * root[b, a]
    for i in range(SIZE):
        for k in range(i + 1):
            total = 0.0
            for a in range(m):
                total += spread[i, a] * spread[k, a]
            covariance[i, k] += total
            covariance[k, i] = covariance[i, k]
        covariance[i, i] *= 1.0 + INFLATION


Array = NDArray[np.float64]
LONGEST_GAP_S: Final = 1e5
KEPT: Final = 1000
POSE, TWIST, ACCELERATION = slice(0, 3), slice(3, 6), slice(6, 8)
REASONS: Final = (
    "",
    "outlier",
    "no usable element",
    "a value or a variance is NaN",
    f"a value is beyond {LARGEST:.0e}",
)


class Innovation(NamedTuple):
    """What became of a measurement."""

    stamp: float
    source: str
    """Name of the input and what it measured: `odom0 twist`."""
    differences: Array
    """(8,) measured minus predicted: x, y, yaw, vx, vy, vyaw, ax, ay; 0 for what was not used."""
    distance: float
    """Mahalanobis distance."""
    accepted: bool
    reason: str
    """Why it was rejected; empty if it was not."""


class _Measurement(NamedTuple):
    stamp: float
    source: str
    values: Array
    variances: Array
    used: NDArray[np.bool_]
    threshold: float


class Ekf:
    """An extended Kalman filter over x, y, yaw, vx, vy, vyaw, ax, ay of a planar robot, constant in acceleration.

    Tom Moore's robot_localization describes the inputs and their parameters; deliberate differences are on the parity page. Each
    call predicts to the stamp of the measurement and corrects. A measurement that is defective, late or an outlier is rejected:
    the state stays, `innovations` has the reason.
    """

    def __init__(self, params: FilterParams) -> None:
        self.params = params
        self.innovations: deque[Innovation] = deque(maxlen=KEPT)
        """The last measurements, accepted and rejected."""
        self._sources = params.sources()
        if not self._sources:
            raise InputError("the filter has no input: set odom0_config, imu0_config .. in the section ekf")
        self._masks: dict[tuple[tuple[bool, ...], int], NDArray[np.bool_]] = {}
        self._noise = _planar(params.process_noise_covariance)
        self._state = np.array(params.initial_state)[list(PLANAR)]
        self._covariance = _planar(params.initial_estimate_covariance)
        self._covariance[np.diag_indices(8)] += 1e-12
        self._stamp: float | None = None
        self._last: dict[str, float] = {}
        self._poses: dict[str, tuple[float, Transform2D, Array]] = {}
        self._origins: dict[str, Transform2D] = {}
        self._history: deque[tuple[_Measurement, float | None, Array, Array]] = deque()

    # --- the estimate -------------------------------------------------------------------------------------------------

    @property
    def stamp(self) -> float | None:
        """Time of the estimate (s); None before the first measurement."""
        return self._stamp

    @property
    def state(self) -> Array:
        """(8,) x, y, yaw, vx, vy, vyaw, ax, ay."""
        return self._state.copy()

    @property
    def covariance(self) -> Array:
        """(8, 8)."""
        return self._covariance.copy()

    @property
    def pose(self) -> Pose2D:
        """Pose in the world frame."""
        return Pose2D(*self._state[POSE].tolist())

    @property
    def twist(self) -> Twist2D:
        """Velocity in the base frame."""
        return Twist2D(*self._state[TWIST].tolist())

    def predicted(self, stamp: float) -> tuple[Array, Array]:
        """Return state (8,) and covariance (8, 8) at `stamp` (s), without changing the filter."""
        state, covariance = self._state.copy(), self._covariance.copy()
        if self._stamp is not None and 0.0 < stamp - self._stamp < LONGEST_GAP_S:
            predict(state, covariance, self._noise, stamp - self._stamp)
        return state, covariance

    def set_pose(self, pose: Pose2D, covariance: Array, stamp: float) -> None:
        """Restart at a pose with its covariance (3, 3); the velocities are 0. Raises InputError if it is not finite."""
        if not (pose.is_finite() and math.isfinite(stamp) and np.isfinite(covariance).all()):
            raise InputError(f"the pose {tuple(pose)} at {stamp} s and its covariance must be finite")
        self._state = np.array([*pose, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._covariance = _planar(self.params.initial_estimate_covariance)
        self._covariance[POSE, POSE] = covariance
        self._covariance[np.diag_indices(8)] += 1e-12
        self._stamp = stamp
        self._last.clear()
        self._poses.clear()
        self._history.clear()

    # --- measurements -------------------------------------------------------------------------------------------------

    def add_odometry(
        self, source: str, stamp: float, pose: Pose2D, pose_covariance: Array, twist: Twist2D, twist_covariance: Array
    ) -> bool:
        """Take an odometry message; covariances (3, 3). Return True if something of it was used."""
        settings = self._source(source)
        if not self._in_order(source, stamp):
            return False
        fused = self._add_pose(settings, stamp, pose, pose_covariance)
        return self._add(settings, "twist", stamp, TWIST, twist, twist_covariance, settings.twist_threshold) or fused

    def add_pose(self, source: str, stamp: float, pose: Pose2D, covariance: Array) -> bool:
        """Take a pose with its covariance (3, 3). Return True if it was used."""
        settings = self._source(source)
        return self._in_order(source, stamp) and self._add_pose(settings, stamp, pose, covariance)

    def add_twist(self, source: str, stamp: float, twist: Twist2D, covariance: Array) -> bool:
        """Take a velocity in the base frame with its covariance (3, 3). Return True if it was used."""
        settings = self._source(source)
        if not self._in_order(source, stamp):
            return False
        return self._add(settings, "twist", stamp, TWIST, twist, covariance, settings.twist_threshold)

    def add_imu(
        self,
        source: str,
        stamp: float,
        yaw: tuple[float, float],
        yaw_rate: tuple[float, float],
        acceleration: tuple[float, float, float] = (0.0, 0.0, math.inf),
    ) -> bool:
        """Take yaw (rad) and yaw rate (rad/s), each with its variance, and ax, ay (m/s²) with theirs. True if it was used."""
        settings = self._source(source)
        if not self._in_order(source, stamp):
            return False
        fused = self._add_pose(settings, stamp, Pose2D(0.0, 0.0, yaw[0]), np.diag((math.inf, math.inf, yaw[1])))
        rate = 0.0, 0.0, yaw_rate[0]
        spread = np.diag((math.inf, math.inf, yaw_rate[1]))
        fused |= self._add(settings, "twist", stamp, TWIST, rate, spread, settings.twist_threshold)
        push, variance = acceleration[:2], np.diag((acceleration[2], acceleration[2]))
        limit = settings.acceleration_threshold
        return self._add(settings, "acceleration", stamp, ACCELERATION, push, variance, limit) or fused

    def _source(self, name: str) -> SourceParams:
        found = self._sources.get(name)
        if found is None:
            raise InputError(
                f'the filter has no input "{name}"; known: {", ".join(self._sources)}; set {name}_config in the section ekf'
            )
        return found

    def _in_order(self, source: str, stamp: float) -> bool:
        """Return False, with a reason, for a message that is not newer than the last of its source, or from another time."""
        last = self._last.get(source)
        now = self._stamp
        if not math.isfinite(stamp):
            return self._reject(stamp, source, f"its stamp is {stamp}")
        if last is not None and stamp == last:
            return self._reject(stamp, source, f"a second message of {stamp} s")
        if last is not None and stamp < last:
            return self._reject(stamp, source, f"out of order: the last one is of {last} s")
        if now is not None and abs(stamp - now) > LONGEST_GAP_S:
            return self._reject(stamp, source, f"its stamp is {stamp - now:.3g} s from the filter's")
        if now is not None and now - stamp > self._patience:
            return self._reject(stamp, source, f"stale: {now - stamp:.3g} s older than the filter")
        self._last[source] = stamp
        return True

    @property
    def _patience(self) -> float:
        """Age up to which a measurement is used (s)."""
        timeout = self.params.sensor_timeout or 1.0 / self.params.frequency
        return max(timeout, self.params.history_length if self.params.smooth_lagged_data else 0.0)

    def _add_pose(self, settings: SourceParams, stamp: float, pose: Pose2D, covariance: Array) -> bool:
        if not any(settings.used[POSE]):
            return False
        values = np.asarray(covariance, np.float64)
        if settings.differential:
            return self._add_difference(settings, stamp, pose, values)
        if settings.relative and pose.is_finite():
            origin = self._origins.setdefault(settings.name, Transform2D(*pose).inverse())
            pose = origin.apply(pose)
            values = _rotated(values, origin.yaw)
        return self._add(settings, "pose", stamp, POSE, pose, values, settings.pose_threshold)

    def _add_difference(self, settings: SourceParams, stamp: float, pose: Pose2D, covariance: Array) -> bool:
        """Fuse the motion since the last pose as a velocity; the differences of its source count for x, y and yaw."""
        if not pose.is_finite():
            return self._reject(stamp, f"{settings.name} pose", f"the pose {tuple(pose)} is not finite")
        now = Transform2D(*pose)
        last = self._poses.get(settings.name)
        self._poses[settings.name] = stamp, now, covariance
        if last is None:
            return False
        dt = stamp - last[0]
        motion = last[1].inverse() @ now
        rate = motion.x / dt, motion.y / dt, motion.yaw / dt
        # ROS differs: the variance of a difference over dt is divided by dt², not multiplied by dt
        spread = _rotated(last[2] + covariance, -last[1].yaw) / (dt * dt)
        return self._add(settings, "difference", stamp, TWIST, rate, spread, settings.pose_threshold)

    def _add(
        self,
        settings: SourceParams,
        what: str,
        stamp: float,
        rows: slice,
        values: tuple[float, ...],
        covariance: Array,
        threshold: float,
    ) -> bool:
        used = settings.used[POSE] if what == "difference" else settings.used[rows]
        if True not in used:
            return False
        measured, variances = np.empty(8), np.empty((8, 8))
        measured[rows], variances[rows, rows] = values, covariance
        mask = self._mask(used, rows)
        return self._process(_Measurement(stamp, f"{settings.name} {what}", measured, variances, mask, threshold))

    def _mask(self, used: tuple[bool, ...], rows: slice) -> NDArray[np.bool_]:
        key = used, int(rows.start)
        mask = self._masks.get(key)
        if mask is None:
            mask = self._masks[key] = np.zeros(8, np.bool_)
            mask[rows] = used
        return mask

    # --- the filter ---------------------------------------------------------------------------------------------------

    def _process(self, measurement: _Measurement) -> bool:
        late = self._stamp is not None and measurement.stamp < self._stamp
        if self.params.smooth_lagged_data:
            return self._smooth(measurement) if late else self._remembered(measurement)
        return self._fuse(measurement)

    def _fuse(self, measurement: _Measurement) -> bool:
        """Predict to the stamp and correct; a measurement that is a little late corrects the current state."""
        if self._stamp is None:
            return self._start(measurement)
        out = np.empty(9)
        stamp, source, values, variances, used, threshold = measurement
        dt = stamp - self._stamp
        result = fuse(self._state, self._covariance, self._noise, dt, values, variances, used, threshold, out)
        distance = float(out[8])
        if result != FUSED:
            reason = REASONS[result]
            if result == OUTLIER:
                reason = f"outlier: Mahalanobis distance {distance:.3g}, threshold {threshold:.3g}"
            return self._reject(stamp, source, reason, distance)
        self._stamp = max(self._stamp, stamp)
        self.innovations.append(Innovation(stamp, source, out[:8], distance, True, ""))
        return True

    def _start(self, measurement: _Measurement) -> bool:
        """Take the first measurement as the state, where it measures it."""
        rows: list[int] = np.flatnonzero(measurement.used).tolist()
        values = np.concatenate((measurement.values[rows], np.diag(measurement.variances)[rows]))
        if np.isnan(values).any() or (np.abs(measurement.values[rows]) > LARGEST).any():
            return self._reject(measurement.stamp, measurement.source, "the first measurement is NaN or too large")
        for i in rows:
            variance = float(measurement.variances[i, i])
            if not abs(variance) <= NO_INFORMATION:
                continue
            self._state[i] = measurement.values[i]
            self._covariance[i, :] = self._covariance[:, i] = 0.0
            self._covariance[i, i] = max(abs(variance), LEAST_VARIANCE)
        self._stamp = measurement.stamp
        self.innovations.append(Innovation(measurement.stamp, measurement.source, np.zeros(8), 0.0, True, ""))
        return True

    def _remembered(self, measurement: _Measurement) -> bool:
        """Fuse, and keep what a late measurement needs."""
        before = measurement, self._stamp, self._state.copy(), self._covariance.copy()
        fused = self._fuse(measurement)
        if fused:
            self._history.append(before)
            while self._history and measurement.stamp - self._history[0][0].stamp > self.params.history_length:
                self._history.popleft()
        return fused

    def _smooth(self, measurement: _Measurement) -> bool:
        """Go back to the time of a late measurement, fuse it, and fuse again what came after it."""
        after: list[tuple[_Measurement, float | None, Array, Array]] = []
        while self._history and self._history[-1][0].stamp > measurement.stamp:
            after.append(self._history.pop())
        if not after or after[-1][1] is None or after[-1][1] > measurement.stamp:
            self._history.extend(reversed(after))
            return self._reject(measurement.stamp, measurement.source, "stale: older than the history")
        _, self._stamp, self._state, self._covariance = after[-1]
        fused = self._remembered(measurement)
        for later, _, _, _ in reversed(after):
            self._remembered(later)
        return fused

    def _reject(self, stamp: float, source: str, reason: str, distance: float = math.nan) -> bool:
        self.innovations.append(Innovation(stamp, source, np.zeros(8), distance, False, reason))
        return False


def _planar(values: list[float]) -> Array:
    """Return the (8, 8) covariance of 15 variances or of a 15 x 15 matrix."""
    matrix = np.diag(values) if len(values) == 15 else np.array(values).reshape(15, 15)
    chosen = matrix[np.ix_(PLANAR, PLANAR)].astype(np.float64)
    return np.ascontiguousarray(0.5 * (chosen + chosen.T))


def _rotated(covariance: Array, angle: float) -> Array:
    """Return a covariance (3, 3) of x, y, yaw in a frame that is turned by `angle` (rad)."""
    if not np.isfinite(covariance).all():
        return covariance
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ covariance @ turn.T


# ----------------------------------------------------------------------------------------------------------------------
# The odometry of wheels and inertial sensors through the extended Kalman filter.


WHEELS: Final = np.diag([4e-4, 1e-6, 1e-2])
"""Covariance of the wheels' velocities: 0.02 m/s, no sideways motion, 0.1 rad/s."""
WHEEL_POSE: Final = np.diag([1e-2, 1e-2, 1e-2])
GYRO: Final = 1e-5
"""Variance of the yaw rate (rad²/s²)."""
COMPASS: Final = 1e-3
"""Variance of the yaw (rad²)."""


class FilteredOdometry(OdometryFilter):
    """Feeds `Ekf` with the wheels' velocities as `odom0` and inertial readings as `imu0`, if they are configured."""

    def __init__(self, params: FilterParams) -> None:
        self.ekf = Ekf(params)
        sources = params.sources()
        self._wheels, self._imu = "odom0" in sources, "imu0" in sources
        self._last: tuple[float, Transform2D] | None = None

    def start(self, stamp: float, pose: Transform2D) -> None:
        """Begin at a pose of the wheels' odometry."""
        self._last = stamp, pose
        self.ekf.set_pose(Pose2D(*pose), np.diag([1e-9, 1e-9, 1e-9]), stamp)

    def run(
        self, wheels: Sequence[Transform2D], stamps: Sequence[float], readings: Sequence[ImuReading]
    ) -> list[Transform2D]:
        """Return the filtered poses at `stamps` (s); see `OdometryFilter.run`."""
        waiting = sorted(readings, key=lambda reading: reading.stamp)
        position = 0
        found: list[Transform2D] = []
        for stamp, pose in zip(stamps, wheels, strict=True):
            while position < len(waiting) and waiting[position].stamp <= stamp:
                self._add_reading(waiting[position])
                position += 1
            self._add_wheels(stamp, pose)
            state, _ = self.ekf.predicted(stamp)
            found.append(Transform2D(*state[:3].tolist()))
        return found

    @property
    def twist(self) -> Twist2D:
        """Filtered velocity in the base frame."""
        return self.ekf.twist

    def _add_wheels(self, stamp: float, pose: Transform2D) -> None:
        if self._last is None:
            self.start(stamp, pose)
            return
        before, last = self._last
        self._last = stamp, pose
        dt = stamp - before
        if not self._wheels or dt <= 0.0:
            return
        motion = last.inverse() @ pose
        twist = Twist2D(motion.x / dt, motion.y / dt, motion.yaw / dt)
        self.ekf.add_odometry("odom0", stamp, Pose2D(*pose), WHEEL_POSE, twist, WHEELS)

    def _add_reading(self, reading: ImuReading) -> None:
        if self._imu and self._last is not None:
            self.ekf.add_imu("imu0", reading.stamp, (reading.yaw, COMPASS), (reading.yaw_rate, GYRO))
