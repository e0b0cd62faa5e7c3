"""The velocity smoother: limits velocities and accelerations of commands, and brakes when no command comes any more.

Behavior and parameters: nav2_velocity_smoother; deliberate differences: the parity page of the documentation.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, RobotState, Twist2D, kernel
from navstack.parameters import VelocitySmootherParams

# ----------------------------------------------------------------------------------------------------------------------
# Velocity limits and accelerations of one step of the velocity smoother.
#
# `limits` (5, 3): maximum and minimum velocity, acceleration, deceleration (at most 0) and deadband of x, y and yaw.


# pyright: basic


MAX_VELOCITY, MIN_VELOCITY, ACCEL, DECEL, DEADBAND = 0, 1, 2, 3, 4

# changes that differ by less are equal: velocities of the order of 1 have a resolution of 2e-16
ROUNDING = 1e-12


@kernel
def band(current, command, accel, decel, rate):
    """Return the lowest and highest change at `rate` (Hz) as in Nav2: braking if the command is slower or has another sign."""
    if abs(command) >= abs(current) and current * command >= 0.0:
        return -accel / rate, accel / rate
    return -abs(decel) / rate, abs(decel) / rate


@kernel
def eta_constraint(current, command, accel, decel, rate):
    """Return the share of the change from `current` to `command` that is allowed by `band`; -1 if all of it is."""
    change = command - current
    low, high = band(current, command, accel, decel, rate)
    if change > high:
        return high / change
    if change < low:
        return low / change
    return -1.0


@kernel
def apply_constraints(current, command, accel, decel, rate, eta):
    """Return the velocity after the share `eta` of the change, within `band`."""
    low, high = band(current, command, accel, decel, rate)
    return current + min(max(eta * (command - current), low), high)


@kernel
def reachable(current, command, accel, decel, dt):
    """Return the velocity nearest to `command` that can be reached within `dt`: it brakes to 0, then accelerates.

    A change through 0 takes the time |current| / |decel| for its first part; `band` has one limit for both.
    """
    decel = abs(decel)
    speed = abs(current)
    if current * command < 0.0 or abs(command) < speed:
        slowest = 0.0 if current * command <= 0.0 else abs(command)
        lost = decel * dt
        if speed - lost > slowest + ROUNDING or (decel == 0.0 and speed > slowest):
            return math.copysign(speed - lost, current)
        if current * command >= 0.0:
            return command
        gained = accel * max(dt - speed / decel, 0.0)
        return math.copysign(min(gained, abs(command)), command)
    if speed + accel * dt >= abs(command) - ROUNDING:
        return command
    return math.copysign(speed + accel * dt, command)


@kernel
def smooth_as_nav2(current, command, limits, rate, scale, out):
    """Write one step of Nav2's velocity smoother to `out` (3,), before the deadband."""
    eta = 1.0
    for i in range(3):
        out[i] = min(max(command[i], limits[MIN_VELOCITY, i]), limits[MAX_VELOCITY, i])
    if scale:
        for i in range(3):
            one = eta_constraint(current[i], out[i], limits[ACCEL, i], limits[DECEL, i], rate)
            if one > 0.0:
                eta = min(eta, one)
    for i in range(3):
        out[i] = apply_constraints(current[i], out[i], limits[ACCEL, i], limits[DECEL, i], rate, eta)


@kernel
def smooth(current, command, limits, dt, scale, out):
    """Write one step to `out` (3,), before the deadband; return the index of the axis whose limit decided, -1 for none.

    With `scale`, one factor brings the command into the velocity limits and one the change into the accelerations, so that
    neither bends an arc. An axis that cannot move at all (a limit or an acceleration of 0) takes no part in the factor.
    """
    factor, eta, decided = 1.0, 1.0, -1
    for i in range(3):
        within = min(max(command[i], limits[MIN_VELOCITY, i]), limits[MAX_VELOCITY, i])
        if within != command[i]:
            decided = i
            if scale and within != 0.0:
                factor = min(factor, within / command[i])
        out[i] = within
    if scale:
        for i in range(3):
            scaled = factor * command[i]
            out[i] = min(max(scaled, limits[MIN_VELOCITY, i]), limits[MAX_VELOCITY, i])
    for i in range(3):
        target = out[i]
        change = target - current[i]
        near = reachable(current[i], target, limits[ACCEL, i], limits[DECEL, i], dt) - current[i]
        if abs(near) < abs(change) - ROUNDING:
            if scale and near != 0.0:
                if near / change < eta:
                    eta, decided = near / change, i
            elif not scale:
                decided = i
    for i in range(3):
        target = out[i]
        near = reachable(current[i], target, limits[ACCEL, i], limits[DECEL, i], dt)
        change = eta * (target - current[i])
        # towards the target, at most as far as the axis can go
        most = abs(near - current[i])
        out[i] = target if eta == 1.0 and near == target else current[i] + min(max(change, -most), most)
    return decided


@kernel
def smooth_stream(commands, limits, dt, scale, out):
    """Write the outputs of a stream of commands (n, 3), one per step from rest, to `out` (n, 3)."""
    for k in range(commands.shape[0]):
        if k == 0:
            smooth(out[0] * 0.0, commands[0], limits, dt, scale, out[0])
        else:
            smooth(out[k - 1], commands[k], limits, dt, scale, out[k])


_AXES: Final = ("x", "y", "yaw")
_TIME_ROUNDING_S: Final = 1e-9
_MOST_PERIODS: Final = 2.0
"""A step after a pause changes the velocity by at most that many periods' worth."""


@dataclass(frozen=True, slots=True)
class SmoothedCommand:
    """One output of the smoother."""

    twist: Twist2D
    """The output, after the deadband."""
    target: Twist2D
    """The command that it follows; zero after the timeout."""
    reason: str
    """Why the output differs from the target, empty if it does not."""


class VelocitySmoother:
    """Follows commands within the limits of its parameters, one `step` per period."""

    def __init__(self, params: VelocitySmootherParams) -> None:
        self.params = params
        self._period = 1.0 / params.smoothing_frequency
        names = ("max_velocity", "min_velocity", "max_accel", "max_decel", "deadband_velocity")
        self._limits = np.array([params.planar(name) for name in names], np.float64)
        self._closed_loop = params.feedback == "CLOSED_LOOP"
        self._command: Twist2D | None = None
        self._received_at = -math.inf
        self._last: NDArray[np.float64] = np.zeros(3)
        """The last output before the deadband."""
        self._suppressed = np.zeros(3, np.bool_)
        """Axes whose last output was in the deadband."""
        self._stopped = True
        self._last_step = -math.inf
        self._due = math.inf
        self._measured: deque[tuple[float, Twist2D]] = deque()

    @property
    def due(self) -> float:
        """Time of the next step (s); inf before the first command and after the robot has come to rest without commands."""
        return self._due

    @property
    def limits(self) -> NDArray[np.float64]:
        """(5, 3) maximum and minimum velocity, acceleration, deceleration (at most 0) and deadband of x, y, yaw. A copy."""
        return self._limits.copy()

    def command(self, twist: Twist2D, now: float) -> None:
        """Take a command received at `now` (s). Raises InputError if it is not finite; it then has no effect."""
        if not twist.is_finite():
            raise InputError(f"the command {tuple(twist)} is not finite", command=twist)
        self._command = twist
        self._received_at = now
        if self._due == math.inf:
            self._due = now

    def reset(self) -> None:
        """Reset the commands: the robot stands."""
        self._command = None
        self._received_at = self._last_step = -math.inf
        self._last = np.zeros(3)
        self._suppressed = np.zeros(3, np.bool_)
        self._stopped, self._due = True, math.inf

    def observe(self, state: RobotState) -> None:
        """Take the odometry, which closed loop needs; open loop ignores it."""
        if not self._closed_loop or not state.velocity.is_finite():
            return
        measured = self._measured
        if not measured or state.stamp > measured[-1][0]:
            measured.append((state.stamp, state.velocity))
        while measured[0][0] < state.stamp - self.params.odom_duration - _TIME_ROUNDING_S:
            measured.popleft()

    def step(self, now: float) -> SmoothedCommand | None:
        """Return the output of the step at `now` (s); None if nothing is sent: no command yet, or at rest without commands."""
        if self._command is None:
            return None
        target = self._command
        timed_out = now - self._received_at > self.params.velocity_timeout + _TIME_ROUNDING_S
        if timed_out:
            if self._stopped:
                self._due = math.inf
                return None
            target = Twist2D()
        dt = self._time_step(now)
        # on the grid of the first step: a robot's cycle that does not divide the period must not lower the frequency
        self._due += self._period
        if not now < self._due < math.inf:
            self._due = now + self._period
        self._last_step = now
        current = self._current()
        out = np.empty(3)
        decided = self._smooth(current, np.array(target, np.float64), dt, out)
        self._last = out
        self._suppressed = (np.abs(out) < self._limits[DEADBAND]) & (out != 0.0)
        sent = Twist2D(*np.where(self._suppressed, 0.0, out).tolist())
        self._stopped = not out.any()
        return SmoothedCommand(sent, target, self._reason(target, sent, decided, current, timed_out=timed_out))

    def feed_back(self, sent: Twist2D, now: float) -> None:
        """Continue from what the robot got at `now` (s), because a later part has changed the output.

        Otherwise the output would rise while the collision monitor holds the robot, and be sent at once when it lets go. Closed
        loop continues from the odometry anyway; Nav2 does neither.
        """
        if self._closed_loop or self.params.nav2_compatible:
            return
        self._last = np.array(sent, np.float64)
        self._suppressed = np.zeros(3, np.bool_)
        self._stopped = not self._last.any()
        self._last_step = now

    def release(self, before: Twist2D, wanted: Twist2D, dt: float) -> SmoothedCommand:
        """Return as much of a command as `max_accel` allows `dt` (s) after `before`; the factor is the same for all axes.

        Braking is not limited: what is slower is at once.
        """
        if self._closed_loop or self.params.nav2_compatible:
            return SmoothedCommand(wanted, wanted, "")
        factor, axis = 1.0, 0
        for i in range(3):
            accel = float(self._limits[ACCEL, i])
            held = abs(before[i]) if before[i] * wanted[i] > 0.0 else 0.0
            reach = held + accel * min(max(dt, 0.0), _MOST_PERIODS * self._period)
            if abs(wanted[i]) > reach + ROUNDING and reach < factor * abs(wanted[i]):
                factor, axis = reach / abs(wanted[i]), i
        if factor >= 1.0:
            return SmoothedCommand(wanted, wanted, "")
        reason = f"max_accel {self._limits[ACCEL, axis]:g} of {_AXES[axis]} after the collision monitor"
        return SmoothedCommand(Twist2D(*(factor * v for v in wanted)), wanted, reason)

    def _time_step(self, now: float) -> float:
        """The time for which accelerations count (s)."""
        if self._last_step == -math.inf:
            return self._period
        return min(max(now - self._last_step, 0.0), _MOST_PERIODS * self._period)

    def _current(self) -> NDArray[np.float64]:
        """The velocity that the step starts from."""
        if not self._closed_loop or not self._measured:
            return self._last
        mean = np.array([velocity for _, velocity in self._measured], np.float64).mean(axis=0)
        if self.params.nav2_compatible:
            return mean
        # an output in the deadband does not move the robot: the ramp continues where it was
        return np.where(self._suppressed, self._last, mean)

    def _smooth(
        self, current: NDArray[np.float64], target: NDArray[np.float64], dt: float, out: NDArray[np.float64]
    ) -> int:
        scale = self.params.scale_velocities
        if not self.params.nav2_compatible:
            return smooth(current, target, self._limits, dt, scale, out)
        smooth_as_nav2(current, target, self._limits, self.params.smoothing_frequency, scale, out)
        return int(np.argmax(np.abs(out - target))) if (out != target).any() else -1

    def _reason(
        self, target: Twist2D, sent: Twist2D, decided: int, current: NDArray[np.float64], *, timed_out: bool
    ) -> str:
        if timed_out:
            return f"no command for more than velocity_timeout = {self.params.velocity_timeout:g} s: braking"
        if sent == target:
            return ""
        if self._suppressed.any():
            axis = int(np.argmax(self._suppressed))
            limit = self._limits[DEADBAND, axis]
            return f"below deadband_velocity {limit:g} of {_AXES[axis]}"
        axis = max(decided, 0)
        wanted = target[axis]
        low, high = self._limits[MIN_VELOCITY, axis], self._limits[MAX_VELOCITY, axis]
        if not low <= wanted <= high and math.isclose(self._last[axis], min(max(wanted, low), high), abs_tol=1e-9):
            name, value = ("max_velocity", high) if wanted > high else ("min_velocity", low)
        elif abs(wanted) > abs(current[axis]) and wanted * current[axis] >= 0.0:
            name, value = "max_accel", self._limits[ACCEL, axis]
        else:
            name, value = "max_decel", self._limits[DECEL, axis]
        return f"{name} {value:g} of {_AXES[axis]}"
