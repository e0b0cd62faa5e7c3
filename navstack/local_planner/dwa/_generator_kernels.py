# pyright: basic
"""Velocity samples and simulated trajectories of base_local_planner's SimpleTrajectoryGenerator.

C++ keeps poses and velocities in `Eigen::Vector3f`: what is stored between two steps is rounded to float32 here as well,
while each step itself is computed in double precision. Same samples, same points, same cells.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

EPS = 1e-4  # tolerance of the speed limits in SimpleTrajectoryGenerator::generateTrajectory


@kernel
def axis_values(low, high, number, out):
    """VelocityIterator: `number` values (at least 2) evenly from low to high, plus a 0 where the range crosses it."""
    if low == high:
        out[0] = low
        return 1
    number = max(2, number)
    step = (high - low) / float(max(1, number - 1))
    value = low
    count = 0
    for _ in range(number - 1):
        out[count] = value
        count += 1
        following = value + step
        if value < 0.0 and following > 0.0:
            out[count] = 0.0
            count += 1
        value = following
    out[count] = high
    return count + 1


@kernel
def sample_velocities(window, number_x, number_y, number_w, scratch, samples):
    """All combinations of the three axes' values, vx outermost, into `samples`; how many.

    `window` (3, 2): low and high of vx, vy, wz. `scratch` (3, m) holds the values of each axis.
    """
    f32 = np.float32
    nx = axis_values(np.float64(f32(window[0, 0])), np.float64(f32(window[0, 1])), number_x, scratch[0])
    ny = axis_values(np.float64(f32(window[1, 0])), np.float64(f32(window[1, 1])), number_y, scratch[1])
    nw = axis_values(np.float64(f32(window[2, 0])), np.float64(f32(window[2, 1])), number_w, scratch[2])
    k = 0
    for i in range(nx):
        vx = np.float64(f32(scratch[0, i]))
        for j in range(ny):
            vy = np.float64(f32(scratch[1, j]))
            for m in range(nw):
                samples[k, 0] = vx
                samples[k, 1] = vy
                samples[k, 2] = np.float64(f32(scratch[2, m]))
                k += 1
    return k


@kernel
def count_steps(samples, min_trans, max_trans, min_theta, sim_time, granularity, angular_granularity, counts):
    """Points per trajectory into `counts`, 0 for what is too slow or too fast; the largest count."""
    longest = 0
    for k in range(len(samples)):
        speed = math.hypot(samples[k, 0], samples[k, 1])
        turn = abs(samples[k, 2])
        steps = 0
        if not (speed + EPS < min_trans and turn + EPS < min_theta) and not speed - EPS > max_trans:
            steps = math.ceil(max(speed * sim_time / granularity, turn * sim_time / angular_granularity))
        counts[k] = steps
        longest = max(longest, steps)
    return longest


@kernel
def toward(velocity, target, acceleration, dt):
    """One axis' velocity after `dt` on the way to `target`, rounded as C++ stores it."""
    if velocity < target:
        return np.float32(min(np.float64(target), velocity + acceleration * dt))
    return np.float32(max(np.float64(target), velocity - acceleration * dt))


@kernel
def simulate(samples, pose, velocity, acceleration, sim_time, accelerate, counts, commands, poses):
    """Trajectories into `poses` (K, T, 3): the poses BEFORE each step, so the first is `pose` and the last is not scored.

    With `accelerate` the velocity grows toward the sample at the limits; otherwise it is the sample from the start.
    `pose`, `velocity`, `acceleration`: three numbers each. `commands` (K, 3): the velocity of the first step.
    """
    f32 = np.float32
    half_pi = 0.5 * math.pi
    x0, y0, yaw0 = f32(pose[0]), f32(pose[1]), f32(pose[2])
    cos0, sin0 = math.cos(np.float64(yaw0)), math.sin(np.float64(yaw0))
    for k in range(len(samples)):
        tx, ty, tw = f32(samples[k, 0]), f32(samples[k, 1]), f32(samples[k, 2])
        n = counts[k]
        vx, vy, vw = tx, ty, tw
        dt = 0.0
        if n > 0:
            dt = sim_time / n
        if accelerate and n > 0:
            vx = toward(f32(velocity[0]), tx, f32(acceleration[0]), dt)
            vy = toward(f32(velocity[1]), ty, f32(acceleration[1]), dt)
            vw = toward(f32(velocity[2]), tw, f32(acceleration[2]), dt)
        commands[k, 0] = vx
        commands[k, 1] = vy
        commands[k, 2] = vw
        x, y, yaw = x0, y0, yaw0
        c, s, at = cos0, sin0, yaw0
        for i in range(n):
            poses[k, i, 0] = x
            poses[k, i, 1] = y
            poses[k, i, 2] = yaw
            if i + 1 == n:
                break  # where the last step leads is not scored
            if accelerate:
                vx = toward(vx, tx, f32(acceleration[0]), dt)
                vy = toward(vy, ty, f32(acceleration[1]), dt)
                vw = toward(vw, tw, f32(acceleration[2]), dt)
            if vx != f32(0.0) or vy != f32(0.0):
                if yaw != at:
                    c, s, at = math.cos(np.float64(yaw)), math.sin(np.float64(yaw)), yaw
                if vy == f32(0.0):
                    x = f32(x + (vx * c) * dt)
                    y = f32(y + (vx * s) * dt)
                else:
                    left = half_pi + np.float64(yaw)
                    x = f32(x + (vx * c + vy * math.cos(left)) * dt)
                    y = f32(y + (vx * s + vy * math.sin(left)) * dt)
            yaw = f32(yaw + vw * dt)


@kernel
def roll_out(
    samples,
    x,
    y,
    yaw,
    vx,
    vy,
    wz,
    limits,
    sim_time,
    granularity,
    angular_granularity,
    accelerate,
    counts,
    commands,
    points,
):
    """`count_steps` and `simulate`: the points of a row, at least 1. Nothing is simulated where `points` cannot hold them.

    From the pose x, y, yaw at the velocity vx, vy, wz. `limits` (6,): acc_lim_x, acc_lim_y, acc_lim_theta, min_vel_trans,
    max_vel_trans, min_vel_theta. The poses (K, T, 3) fill the beginning of `points`, T as returned.
    """
    longest = max(
        1,
        count_steps(samples, limits[3], limits[4], limits[5], sim_time, granularity, angular_granularity, counts),
    )
    number = len(samples)
    if number * longest * 3 <= len(points):
        simulate(
            samples,
            (x, y, yaw),
            (vx, vy, wz),
            (limits[0], limits[1], limits[2]),
            sim_time,
            accelerate,
            counts,
            commands,
            points[: number * longest * 3].reshape(number, longest, 3),
        )
    return longest
