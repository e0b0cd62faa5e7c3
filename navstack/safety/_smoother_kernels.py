# pyright: basic
"""Velocity limits and accelerations of one step of the velocity smoother.

`limits` (5, 3): maximum and minimum velocity, acceleration, deceleration (at most 0) and deadband of x, y and yaw.
"""

from __future__ import annotations

import math

from navstack.core.jit import kernel

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
