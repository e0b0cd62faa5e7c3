# pyright: basic
"""Reachable velocities and trajectories of a batch. Arrays are (.., T, K) float32: a row is one time step of all trajectories."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel
from navstack.local_planner.mppi._sine_kernels import LANES, sine_cosine

f32 = np.float32


@kernel
def envelope(speed, up, down, turnover, as_nav2):
    """Return the lowest and the highest speed that is reachable from `speed` within a step.

    `up` and `down` (both positive): change of the speed by speeding up and slowing down. `turnover` is up / down: what is left
    of a step after slowing down to 0 is used for speeding up. ROS differs: Nav2 uses one limit for both parts, and from a speed
    of 0 speeds up by `down`.
    """
    slowed, raised = speed - down, speed + down
    if as_nav2:
        forward = speed > f32(0.0)
        return (slowed if forward else speed - up), (speed + up if forward else raised)
    below = slowed if slowed >= f32(0.0) else slowed * turnover
    above = raised if raised <= f32(0.0) else raised * turnover
    return (below if speed >= f32(0.0) else speed - up), (above if speed < f32(0.0) else speed + up)


@kernel
def reach_axis(noise, controls, start, rates, first, offset, as_nav2, out):
    """Write the velocities that an axis reaches on its way to the sampled controls `controls` (T,) + `noise` (T, K) to `out`.

    `start` is the speed before the first step. `rates` (3,): see `envelope`. Steps before `first` keep `start`; step t follows
    control t - `offset`.
    """
    steps, number = noise.shape
    up, down, turnover = rates[0], rates[1], rates[2]
    speed = np.empty(LANES, np.float32)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            speed[i] = start
        for t in range(steps):
            if t >= first:
                control = controls[t - offset]
                sampled = noise[t - offset, begin : begin + LANES]
                for i in range(LANES):
                    low, high = envelope(speed[i], up, down, turnover, as_nav2)
                    target = control + sampled[i]
                    target = target if target > low else low
                    speed[i] = target if target < high else high
            row = out[t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = speed[i]


@kernel
def integrate(speeds, start, dt, omni, points):
    """Write the points (3, T, K) x, y, yaw of velocities (3, T, K) from the pose `start` (3,) on; the first is `dt` later.

    A step is driven in the direction before it (Euler), as in Nav2.
    """
    steps, number = speeds.shape[1], speeds.shape[2]
    x = np.empty(LANES, np.float32)
    y = np.empty(LANES, np.float32)
    yaw = np.empty(LANES, np.float32)
    cosine = np.empty(LANES, np.float32)
    sine = np.empty(LANES, np.float32)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            x[i] = start[0]
            y[i] = start[1]
            yaw[i] = start[2]
        for t in range(steps):
            forward = speeds[0, t, begin : begin + LANES]
            turning = speeds[2, t, begin : begin + LANES]
            for i in range(LANES):
                sine[i], cosine[i] = sine_cosine(yaw[i])
            for i in range(LANES):
                x[i] += forward[i] * cosine[i] * dt
                y[i] += forward[i] * sine[i] * dt
            if omni:
                sideways = speeds[1, t, begin : begin + LANES]
                for i in range(LANES):
                    x[i] -= sideways[i] * sine[i] * dt
                    y[i] += sideways[i] * cosine[i] * dt
            for i in range(LANES):
                yaw[i] += turning[i] * dt
            row = points[0, t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = x[i]
            row = points[1, t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = y[i]
            row = points[2, t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = yaw[i]


@kernel
def integrate_one(controls, start, dt, points):
    """Write the trajectory (T, 3) of velocities (T, 3), as `integrate` does."""
    x, y, yaw = start[0], start[1], start[2]
    for t in range(len(controls)):
        sine, cosine = sine_cosine(yaw)
        x += (controls[t, 0] * cosine - controls[t, 1] * sine) * dt
        y += (controls[t, 0] * sine + controls[t, 1] * cosine) * dt
        yaw += controls[t, 2] * dt
        points[t, 0] = x
        points[t, 1] = y
        points[t, 2] = yaw
