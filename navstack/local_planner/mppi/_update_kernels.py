# pyright: basic
"""The update of the controls: control cost, weights, average, smoothing filter, limits."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel
from navstack.local_planner.mppi._rollout_kernels import envelope
from navstack.local_planner.mppi._sine_kernels import LANES

f32 = np.float32


@kernel
def add_control_cost(noise, controls, factors, costs):
    """Add the sum over axes and steps of `factors` (3,) * control * noise to `costs` (K,)."""
    steps, number = noise.shape[1], noise.shape[2]
    total = np.empty(LANES, np.float32)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            total[i] = f32(0.0)
        for axis in range(3):
            if factors[axis] == f32(0.0):
                continue
            for t in range(steps):
                scale = factors[axis] * controls[t, axis]
                row = noise[axis, t, begin : begin + LANES]
                for i in range(LANES):
                    total[i] += scale * row[i]
        row = costs[begin : begin + LANES]
        for i in range(LANES):
            row[i] += total[i]


@kernel
def softmax(costs, number, temperature, weights):
    """Write exp(-(cost - lowest) / temperature), divided by the sum, of the first `number` costs to `weights` (K,), 0 beyond.

    Returns the sum before the division; NaN if a cost is NaN.
    """
    lowest = costs[0]
    for k in range(number):
        lowest = min(lowest, costs[k])
    total = 0.0
    for k in range(number):
        weights[k] = np.exp(-(costs[k] - lowest) / temperature)
        total += np.float64(weights[k])
    for k in range(number):
        weights[k] = f32(np.float64(weights[k]) / total)
    for k in range(number, len(weights)):
        weights[k] = f32(0.0)
    return total


@kernel
def add_weighted_noise(noise, weights, omni, controls):
    """Add the average of the noise (3, T, K), weighted by `weights` (K,), to `controls` (T, 3)."""
    steps, number = noise.shape[1], noise.shape[2]
    total = np.empty(LANES, np.float32)
    for axis in range(3):
        if axis == 1 and not omni:
            continue
        for t in range(steps):
            for i in range(LANES):
                total[i] = f32(0.0)
            for begin in range(0, number, LANES):
                row = noise[axis, t, begin : begin + LANES]
                weight = weights[begin : begin + LANES]
                for i in range(LANES):
                    total[i] += weight[i] * row[i]
            width = LANES // 2
            while width > 0:
                for i in range(width):
                    total[i] += total[i + width]
                width //= 2
            controls[t, axis] += total[0]


@kernel
def smooth(controls, before, coefficients, out):
    """Filter `controls` (T, 3) with nine `coefficients` over time (Savitzky and Golay) into `out`; the last row is kept.

    `before` (4, 3) stands to the left of the first row, the last row repeated to the right of the last one.
    """
    steps = len(controls)
    for axis in range(3):
        for t in range(steps - 1):
            total = f32(0.0)
            for i in range(9):
                at = t + i - 4
                if at < 0:
                    value = before[at + 4, axis]
                else:
                    value = controls[min(at, steps - 1), axis]
                total += coefficients[i] * value
            out[t, axis] = total
        out[steps - 1, axis] = controls[steps - 1, axis]


@kernel
def clip_turn(controls, radius):
    """Lower the turning speeds of `controls` (T, 3) to what a turning radius (m) allows; 0: no limit."""
    if radius > f32(0.0):
        for t in range(len(controls)):
            highest = abs(controls[t, 0]) / radius
            controls[t, 2] = min(max(controls[t, 2], -highest), highest)


@kernel
def limit(controls, start, highest, lowest, first_rates, rates, shifting, as_nav2):
    """Clip `controls` (T, 3) to the limits `lowest` .. `highest` (3,) and to the envelope of the control before.

    The one before the first is `start` (3,); with `shifting` the first is `start` itself. `first_rates` and `rates` (3, 3):
    axis, then as for `envelope`, for the step to the first control and between controls.
    """
    if shifting:
        for axis in range(3):
            controls[0, axis] = start[axis]
    for axis in range(3):
        before = start[axis]
        for t in range(len(controls)):
            rate = first_rates[axis] if t == 0 else rates[axis]
            value = min(max(controls[t, axis], lowest[axis]), highest[axis])
            if as_nav2:
                forward = before >= f32(0.0)
                low = before - rate[1] if forward else before - rate[0]
                high = before + rate[0] if forward else before + rate[1]
            else:
                low, high = envelope(before, rate[0], rate[1], rate[2], False)
            before = min(max(value, low), high)
            controls[t, axis] = before
