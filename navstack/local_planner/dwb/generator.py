# pyright: basic
"""Velocity samples of DWB and their trajectories: dwb_plugins' StandardTrajectoryGenerator and LimitedAccelGenerator.

A sample is a velocity that the robot can reach: within `sim_time` (Standard), or within one period (LimitedAccel). Standard then
simulates how the robot accelerates towards it, LimitedAccel drives it from the start. Steps are those of Euler: position with the
heading before the step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, RobotState, plain_kernel
from navstack.local_planner.rollouts import MAX_POINTS
from navstack.plugins import Rollouts

STANDARD, LIMITED_ACCEL = "dwb_plugins::StandardTrajectoryGenerator", "dwb_plugins::LimitedAccelGenerator"
EPSILON = 1e-5
"""Ranges of a velocity below this one (m/s, rad/s) have a single value; the last value may be this far above the highest."""
SPEED_EPSILON = 1.1920928955078125e-07
"""Tolerance of the limits of speeds, squared for translation: that of float32 at 1."""


class Kinematics(NamedTuple):
    """Limits of the base in m/s, rad/s, m/s² and rad/s², by their names in YAML."""

    min_vel_x: float
    max_vel_x: float
    min_vel_y: float
    max_vel_y: float
    max_vel_theta: float
    min_speed_xy: float
    max_speed_xy: float
    min_speed_theta: float
    acc_lim_x: float
    acc_lim_y: float
    acc_lim_theta: float
    decel_lim_x: float
    decel_lim_y: float
    decel_lim_theta: float

    def scaled(self, ratio: float) -> Kinematics:
        """All highest speeds times `ratio`; a lowest speed stays below its highest.

        Nav2 differs: there a lowest speed above the lowered highest one is commanded in spite of the limit.
        """
        along, across = self.max_vel_x * ratio, self.max_vel_y * ratio
        return self._replace(
            max_vel_x=along,
            max_vel_y=across,
            max_vel_theta=self.max_vel_theta * ratio,
            max_speed_xy=self.max_speed_xy * ratio,
            min_vel_x=min(self.min_vel_x, along) if self.min_vel_x <= self.max_vel_x else self.min_vel_x,
            min_vel_y=min(self.min_vel_y, across) if self.min_vel_y <= self.max_vel_y else self.min_vel_y,
        )


SETTINGS = np.dtype(
    [(name, "f8") for name in Kinematics._fields]
    + [(name, "f8") for name in ("window", "sim_time", "linear_granularity", "angular_granularity", "time_granularity")]
    + [(name, "i8") for name in ("vx_samples", "vy_samples", "vtheta_samples")]
    + [(name, "?") for name in ("by_time", "last_again", "accelerates", "limits_command")]
)
"""Settings of the kernels. `window`: seconds within which a sample is reached."""


class DWBGenerator:
    """Both generators; samples and rollouts are views of buffers that the next call overwrites."""

    def __init__(self, params: Any, period: float) -> None:
        """`params`: those of the controller; `period`: the control period (s)."""
        p = params
        self._limited = p.trajectory_generator_name.endswith("LimitedAccelGenerator")
        window = (p.sim_period or period) if self._limited else p.sim_time
        self._settings = np.zeros(1, SETTINGS)
        values: Mapping[str, Any] = {
            "window": window,
            "sim_time": p.sim_time,
            "linear_granularity": p.linear_granularity,
            "angular_granularity": p.angular_granularity,
            "time_granularity": p.time_granularity,
            "vx_samples": max(2, p.vx_samples),
            "vy_samples": max(2, p.vy_samples),
            "vtheta_samples": max(2, p.vtheta_samples),
            "by_time": p.discretize_by_time,
            "last_again": p.include_last_point,
            "accelerates": not self._limited,
            "limits_command": p.limit_vel_cmd_in_traj and not self._limited,
        }
        for name, value in values.items():
            self._settings[0][name] = value
        # a range that is hardly wider than EPSILON has up to as many values again, between its end and EPSILON above it
        self._axes = np.empty((3, 2 * max(2, p.vx_samples, p.vy_samples, p.vtheta_samples) + 3))
        self._start = np.empty(6)
        self._samples = np.empty((0, 3))
        self._steps = np.empty(0, np.int64)
        self._counts = np.empty(0, np.int64)
        self._commands = np.empty((0, 3))
        self._points = np.empty(0)
        self._headings = np.empty((0, 3, 0))

    def set_limits(self, limits: Kinematics) -> None:
        """Use these limits from the next cycle on."""
        for name, value in zip(Kinematics._fields, limits, strict=True):
            self._settings[0][name] = value

    def rollouts(self, state: RobotState) -> tuple[NDArray[np.float64], Rollouts]:
        """(K, 3) samples in Nav2's order (vx outermost, wz innermost), and their rollouts from `state`.

        Raises InputError if there are more than MAX_POINTS points to simulate.
        """
        self._start[:3], self._start[3:] = state.pose, state.velocity
        number, longest = self._sample()
        if number > len(self._samples):
            self._samples, self._commands = np.empty((number, 3)), np.empty((number, 3))
            self._steps, self._counts = np.empty(number, np.int64), np.empty(number, np.int64)
            number, longest = self._sample()
        points = longest + 2
        if number * points > MAX_POINTS:
            raise InputError(
                f"{number} trajectories of up to {points} points are too many to simulate in a cycle; raise linear_granularity, "
                "angular_granularity or time_granularity, or lower sim_time or the numbers of samples",
                samples=number,
                points=points,
            )
        if number * points * 3 > len(self._points):
            self._points = np.empty(number * points * 3)
        if points > self._headings.shape[2]:
            self._headings = np.empty((self._axes.shape[1], 3, points))
        poses = self._points[: number * points * 3].reshape(number, points, 3)
        samples, steps = self._samples[:number], self._steps[:number]
        counts, commands = self._counts[:number], self._commands[:number]
        integrate(self._start, self._settings, samples, steps, self._headings, counts, commands, poses)
        seconds = self._settings[0]["sim_time"] / steps
        return samples, Rollouts(commands, poses, counts, seconds=seconds)

    def _sample(self) -> tuple[int, int]:
        number, longest = sample_twists(self._start, self._settings, self._axes, self._samples, self._steps)
        return int(number), int(longest)


# --- kernels --------------------------------------------------------------------------------------------------------


@plain_kernel
def reached(speed, target, acceleration, deceleration, seconds):
    """Return the speed after `seconds` of acceleration (at least 0) or deceleration (at most 0) from `speed` towards `target`."""
    if speed < target:
        return min(target, speed + acceleration * seconds)
    return max(target, speed + deceleration * seconds)


@plain_kernel
def axis_values(speed, lowest, highest, acceleration, deceleration, seconds, number, out):
    """Write the speeds of one axis that are reached from `speed` within `seconds` to `out`, ascending. Returns how many.

    `number` values from the lowest to the highest, and a 0 between a negative and a positive one (dwb_plugins'
    OneDVelocityIterator). No more than `out` holds.
    """
    speed = max(min(speed, highest), lowest)
    last = reached(speed, highest, acceleration, deceleration, seconds)
    value = reached(speed, lowest, acceleration, deceleration, seconds)
    step = 1.0 if abs(last - value) < EPSILON else (last - value) / (number - 1)
    count = 0
    zero_is_due = True
    while value <= last + EPSILON and count < len(out):
        out[count] = value
        count += 1
        following = value + step
        if zero_is_due and value < 0.0 and following > 0.0 and following <= last + EPSILON and count < len(out):
            out[count] = 0.0
            count += 1
            zero_is_due = False
        value = following
    return count


@plain_kernel
def sample_twists(start, settings_, axes, samples, steps):
    """Write the legal velocity samples (K, 3) and the number of steps of their rollouts (K,). Returns K and the most steps.

    `start` (6,): x, y, yaw, vx, vy, wz. `settings_` (1,): see `SETTINGS`. `axes` (3, m) is scratch. Nothing is written beyond
    the end of `samples`: the caller compares K with its length. A sample is too slow only below both lowest speeds; the sample
    without any motion is left out (dwb_plugins' XYThetaIterator).
    """
    p = settings_[0]
    seconds = p.window
    number_x = axis_values(
        start[3], p.min_vel_x, p.max_vel_x, p.acc_lim_x, p.decel_lim_x, seconds, p.vx_samples, axes[0]
    )
    number_y = axis_values(
        start[4], p.min_vel_y, p.max_vel_y, p.acc_lim_y, p.decel_lim_y, seconds, p.vy_samples, axes[1]
    )
    number_w = axis_values(
        start[5],
        -p.max_vel_theta,
        p.max_vel_theta,
        p.acc_lim_theta,
        p.decel_lim_theta,
        seconds,
        p.vtheta_samples,
        axes[2],
    )
    fastest, slowest = p.max_speed_xy * p.max_speed_xy + SPEED_EPSILON, p.min_speed_xy * p.min_speed_xy
    has_fastest, has_slowest = p.max_speed_xy >= 0.0, p.min_speed_xy >= 0.0 and p.min_speed_theta >= 0.0
    count, longest = 0, 1
    for i in range(number_x):
        vx = axes[0, i]
        for j in range(number_y):
            vy = axes[1, j]
            squared = vx * vx + vy * vy
            if has_fastest and squared > fastest:
                continue
            is_slow = has_slowest and squared + SPEED_EPSILON < slowest
            linear = math.hypot(vx, vy) * p.sim_time / p.linear_granularity
            for m in range(number_w):
                wz = axes[2, m]
                if is_slow and abs(wz) + SPEED_EPSILON < p.min_speed_theta:
                    continue
                if squared == 0.0 and wz == 0.0:
                    continue
                if count < len(samples):
                    samples[count, 0] = vx
                    samples[count, 1] = vy
                    samples[count, 2] = wz
                    wanted = max(linear, abs(wz) * p.sim_time / p.angular_granularity)
                    if p.by_time:
                        wanted = p.sim_time / p.time_granularity
                    # more steps than points that are allowed are refused by the caller
                    number = max(1, math.ceil(min(wanted, 1e9)))
                    steps[count] = number
                    longest = max(longest, number)
                count += 1
    return count, longest


@plain_kernel
def wrapped(yaw):
    """Return a heading (rad) in (-pi, pi]."""
    if -math.pi < yaw <= math.pi:
        return yaw
    return yaw - 2.0 * math.pi * math.ceil((yaw - math.pi) / (2.0 * math.pi))


@plain_kernel
def turn(headings, yaw, turning, target, p, number):
    """Write headings in (-pi, pi] to `headings` (3, T): before each of `number` steps, with cosine and sine, and the last one."""
    dt = p.sim_time / number
    yaw = wrapped(yaw)
    for i in range(number):
        headings[0, i] = yaw
        headings[1, i] = math.cos(yaw)
        headings[2, i] = math.sin(yaw)
        turning = reached(turning, target, p.acc_lim_theta, p.decel_lim_theta, dt) if p.accelerates else target
        yaw = wrapped(yaw + turning * dt)
    headings[0, number] = yaw


@plain_kernel
def integrate(start, settings_, samples, steps, headings, counts, commands, poses):
    """Write the rollouts of `samples` (K, 3) with `steps` (K,): points per row, command, poses (K, T, 3).

    The pose of `start`, that after every step and, with `last_again`, the last one twice. Headings depend on the turning speed
    and the number of steps alone: `headings` (m, 3, T) keeps those of m turning speeds, which most samples share. The command is
    the sample, or with `limits_command` the velocity of the first step.
    """
    p = settings_[0]
    used, at = 0, 0
    for k in range(len(samples)):
        tx, ty, tw = samples[k, 0], samples[k, 1], samples[k, 2]
        number = steps[k]
        dt = p.sim_time / number
        # the samples run through the turning speeds in order: the next one is usually that of the next sample
        at = at + 1 if at + 1 < used else 0
        if used == 0 or turning_of(headings, at) != tw:
            at = 0
            while at < used and turning_of(headings, at) != tw:
                at += 1
        row = headings[min(at, len(headings) - 1)]
        last = row.shape[1] - 1
        if at == used or row[1, last] != number:
            used = min(max(used, at + 1), len(headings))
            at = min(at, len(headings) - 1)
            row = headings[at]
            turn(row, start[2], start[5], tw, p, number)
            row[1, last] = number
            row[2, last] = tw
        vx, vy = start[3], start[4]
        if not p.accelerates:
            vx, vy = tx, ty
        x, y = start[0], start[1]
        points = poses[k]
        commands[k, 0] = tx
        commands[k, 1] = ty
        commands[k, 2] = tw
        if p.limits_command:
            commands[k, 0] = reached(vx, tx, p.acc_lim_x, p.decel_lim_x, dt)
            commands[k, 1] = reached(vy, ty, p.acc_lim_y, p.decel_lim_y, dt)
            commands[k, 2] = reached(start[5], tw, p.acc_lim_theta, p.decel_lim_theta, dt)
        for i in range(number):
            points[i, 0] = x
            points[i, 1] = y
            points[i, 2] = row[0, i]
            if vx != tx or vy != ty:
                vx = reached(vx, tx, p.acc_lim_x, p.decel_lim_x, dt)
                vy = reached(vy, ty, p.acc_lim_y, p.decel_lim_y, dt)
            x += (vx * row[1, i] - vy * row[2, i]) * dt
            y += (vx * row[2, i] + vy * row[1, i]) * dt
        count = number + 2 if p.last_again else number + 1
        for i in range(number, count):
            points[i, 0] = x
            points[i, 1] = y
            points[i, 2] = row[0, number]
        counts[k] = count


@plain_kernel
def turning_of(headings, at):
    """Return the turning speed whose headings are in row `at`."""
    return headings[at, 2, headings.shape[2] - 1]
