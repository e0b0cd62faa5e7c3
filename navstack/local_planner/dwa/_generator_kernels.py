# pyright: basic
"""Velocity samples and rollouts of base_local_planner's SimpleTrajectoryGenerator.

C++ stores poses and velocities as `Eigen::Vector3f`. Values stored between two steps are therefore rounded to float32 here,
too, while each step is computed in double precision: the samples, points and cells are the same.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

EPS = 1e-4  # tolerance of the speed limits (SimpleTrajectoryGenerator::generateTrajectory)


@kernel
def axis_values(low, high, number, out):
    """Write `number` values (at least 2), evenly spaced from low to high, to `out`, plus a 0 if the range crosses it.

    Returns how many (VelocityIterator of base_local_planner).
    """
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
    """Write all combinations of the values of the three axes, vx outermost, to `samples`. Returns how many.

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
def count_points(samples, settings, counts):
    """Write the points per rollout to `counts`, 0 for samples outside the speed limits. Returns the largest count."""
    longest = 0
    for k in range(len(samples)):
        speed = math.hypot(samples[k, 0], samples[k, 1])
        turn = abs(samples[k, 2])
        points = 0
        too_slow = speed + EPS < settings.min_vel_trans and turn + EPS < settings.min_vel_theta
        if not too_slow and not speed - EPS > settings.max_vel_trans:
            along = speed * settings.sim_time / settings.sim_granularity
            around = turn * settings.sim_time / settings.angular_sim_granularity
            points = math.ceil(max(along, around))
        counts[k] = points
        longest = max(longest, points)
    return longest


@kernel
def accelerate_towards(velocity, target, acceleration, dt):
    """Velocity of one axis after `dt` of acceleration towards `target`, rounded as C++ stores it."""
    if velocity < target:
        return np.float32(min(np.float64(target), velocity + acceleration * dt))
    return np.float32(max(np.float64(target), velocity - acceleration * dt))


@kernel
def integrate(samples, pose, velocity, settings, counts, commands, poses):
    """Write the rollouts to `poses` (K, T, 3): the poses BEFORE each step, from `pose` on; the last pose is not scored.

    With `accelerate` the velocity approaches the sample at the acceleration limits; otherwise it equals the sample from the
    start. `pose`, `velocity`: three numbers each. `commands` (K, 3): the velocity of the first step.
    """
    sim_time, accelerate = settings.sim_time, settings.accelerate
    acc_x, acc_y, acc_theta = settings.acc_lim_x, settings.acc_lim_y, settings.acc_lim_theta
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
            vx = accelerate_towards(f32(velocity[0]), tx, f32(acc_x), dt)
            vy = accelerate_towards(f32(velocity[1]), ty, f32(acc_y), dt)
            vw = accelerate_towards(f32(velocity[2]), tw, f32(acc_theta), dt)
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
                break  # the pose after the last step is not scored
            if accelerate:
                vx = accelerate_towards(vx, tx, f32(acc_x), dt)
                vy = accelerate_towards(vy, ty, f32(acc_y), dt)
                vw = accelerate_towards(vw, tw, f32(acc_theta), dt)
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
def simulate(samples, x, y, yaw, vx, vy, wz, settings_, counts, commands, points):
    """`count_points` and `integrate`, from the pose x, y, yaw at the velocity vx, vy, wz. Returns T, the points per row.

    `settings_` (1,): see `SIMULATION_SETTINGS`. The poses (K, T, 3), T at least 1, are written to the beginning of `points`;
    nothing is integrated if `points` is too small.
    """
    settings = settings_[0]
    longest = max(1, count_points(samples, settings, counts))
    number = len(samples)
    if number * longest * 3 <= len(points):
        poses = points[: number * longest * 3].reshape(number, longest, 3)
        integrate(samples, (x, y, yaw), (vx, vy, wz), settings, counts, commands, poses)
    return longest
