# pyright: basic
"""Velocity samples and rollouts of base_local_planner's SimpleTrajectoryGenerator.

C++ stores poses and velocities as `Eigen::Vector3f`. Values stored between two steps are therefore rounded to float32 here,
too, while each step is computed in double precision: the samples, points and cells are the same.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

FEWEST = 4
"""Points of a rollout that is integrated by `integrate_forwards`: more."""
HALF_PI_HIGH, HALF_PI_LOW = 1.5707963267341256, 6.077100506506192e-11
"""pi / 2 in two parts: multiples of the first one are exact."""
HEADING_ERROR = 1e-14
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
def turned_steps(yaws, number, step, steps_x, steps_y):
    """Write `step` (m) in the directions of the first `number` of `yaws` (rad) to `steps_x`, `steps_y`; vectorized.

    Taylor polynomials after a reduction to at most pi / 4, with errors below HEADING_ERROR * step.
    """
    for i in range(np.uint64(number)):
        quarter = np.int32(yaws[i] * (2.0 / math.pi) + 4096.5) - np.int32(4096)
        r = (yaws[i] - quarter * HALF_PI_HIGH) - quarter * HALF_PI_LOW
        q = r * r
        s = 1 / 6227020800 + q * (-1 / 1307674368000 + q * (1 / 355687428096000))
        s = r * (1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 + q * (-1 / 39916800 + q * s))))))
        c = -1 / 3628800 + q * (1 / 479001600 + q * (-1 / 87178291200 + q * (1 / 20922789888000)))
        c = 1.0 + q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * c))))
        odd = (quarter & np.int32(1)) != 0
        a, b = s if odd else c, c if odd else s
        steps_x[i] = step * (-a if ((quarter + np.int32(1)) & np.int32(2)) != 0 else a)
        steps_y[i] = step * (-b if (quarter & np.int32(2)) != 0 else b)


@kernel
def integrate_forwards(x, y, yaw, vx, vw, dt, number, poses, k, buffers):
    """Write `number` poses with constant speeds vx, vw and vy = 0 to `poses[k]`, as `integrate`; return False if they are
    uncertain.

    Steps are computed with a small error. Where it does not change how a coordinate is rounded, the result is exact.
    `buffers` (3, T) is scratch.
    """
    yaws, steps_x, steps_y = buffers[0], buffers[1], buffers[2]
    farthest = abs(vx) * dt * number
    if not (abs(yaw) + abs(vw) * dt * number < 1000.0 and farthest < 1e6):
        return False
    f32 = np.float32
    error = np.float64(abs(vx)) * dt * HEADING_ERROR + 1e-15 * (abs(x) + abs(y) + farthest)
    for i in range(number):
        yaws[i] = yaw
        poses[k, i, 2] = yaw
        yaw = f32(yaw + vw * dt)
    turned_steps(yaws, number, np.float64(vx) * dt, steps_x, steps_y)
    differences = 0
    for i in range(number):
        poses[k, i, 0] = x
        poses[k, i, 1] = y
        next_x, next_y = x + steps_x[i], y + steps_y[i]
        x, y = f32(next_x - error), f32(next_y - error)
        differences += (x != f32(next_x + error)) | (y != f32(next_y + error))
    return differences == 0


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
    buffers = np.empty((3, poses.shape[1]))
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
        done = False
        if n > FEWEST and not accelerate and vy == f32(0.0) and vx != f32(0.0):
            done = integrate_forwards(x, y, yaw, vx, vw, dt, n, poses, k, buffers)
        if done:
            continue
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
