"""The extended Kalman filter of a planar robot: x, y, yaw, vx, vy, vyaw, ax, ay (m, rad, s; velocities in the base frame)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel

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
