"""Shortest curves by geometry, independent of the product: circles, tangents and every sign of every segment, in numpy.

Each construction gives paths that end at the goal, among them all words of Dubins and of Reeds and Shepp, so the smallest length
is that of the shortest curve. Unit turning radius; poses are (n,) arrays of x, y and yaw.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
TAU = 2.0 * math.pi
Weights = tuple[float, float]
"""By which the lengths driven forward and backward count."""
SIDES = (1.0, -1.0)  # left, right


def ahead(angle: Array) -> Array:
    """The rotation that turns an angle counter-clockwise, in [0, 2 pi); rounding below a full turn counts as none."""
    turned = np.mod(angle, TAU)
    return np.where(turned > TAU - 1e-9, 0.0, turned)


def arc(side: float, turn: Array, weights: Weights) -> Array:
    """The lesser weighted length of the arcs on a side, forward and backward, that turn the heading by an angle."""
    return np.minimum(weights[0] * ahead(side * turn), weights[1] * ahead(-side * turn))


def weighted(length: Array, weights: Weights) -> Array:
    """The weighted length of a segment of signed length."""
    return np.where(length > 0.0, weights[0] * length, -weights[1] * length)


def center(pose: tuple[Array, Array, Array], side: float) -> Complex:
    """Center of the turning circle on a side, as complex numbers."""
    x, y, yaw = pose
    return x + 1j * y + side * 1j * np.exp(1j * yaw)


def dubins(x: Array, y: Array, yaw: Array) -> Array:
    """Length from (0, 0, 0), forward only."""
    start = (np.zeros_like(x), np.zeros_like(x), np.zeros_like(x))
    best = np.full(x.shape, np.inf)
    with np.errstate(invalid="ignore"):
        for a in SIDES:
            for b in SIDES:
                c = center((x, y, yaw), b) - center(start, a)
                straight = np.abs(c) if a == b else np.sqrt(np.abs(c) ** 2 - 4.0)
                # c = s h - (a - b) i h for the heading h of the straight
                heading = np.angle(c) - np.angle(straight - 1j * (a - b))
                best = np.fmin(best, ahead(a * heading) + straight + ahead(b * (yaw - heading)))
            c = center((x, y, yaw), a) - center(start, a)
            for z in SIDES:
                # the middle circle touches both outer ones; the heading where circles touch is at right angles to their centers
                to_middle = np.angle(c) + z * np.arccos(np.abs(c) / 4.0)
                first = to_middle + a * math.pi / 2.0
                second = np.angle(2.0 * np.exp(1j * to_middle) - c) + a * math.pi / 2.0
                length = ahead(a * first) + ahead(-a * (second - first)) + ahead(a * (yaw - second))
                best = np.fmin(best, length)
    return best


def reeds_shepp(x: Array, y: Array, yaw: Array, backward: float = 1.0) -> Array:
    """Length from (0, 0, 0), forward and backward, in which driving backward counts `backward` times."""
    zero = np.zeros_like(x)
    there = _one_way((zero, zero, zero), (x, y, yaw), (1.0, backward))
    return np.fmin(there, _one_way((x, y, yaw), (zero, zero, zero), (backward, 1.0)))


def _one_way(start: tuple[Array, Array, Array], goal: tuple[Array, Array, Array], w: Weights) -> Array:
    yaw0, yaw1 = start[2], goal[2]
    best = np.full(yaw0.shape, np.inf)
    with np.errstate(invalid="ignore", divide="ignore"):
        for a in SIDES:
            for b in SIDES:
                c = center(goal, b) - center(start, a)
                for z in SIDES:
                    straight = z * (np.abs(c) if a == b else np.sqrt(np.abs(c) ** 2 - 4.0))
                    heading = np.angle(c) - np.angle(straight - 1j * (a - b))
                    arcs = arc(a, heading - yaw0, w) + arc(b, yaw1 - heading, w)
                    best = np.fmin(best, arcs + weighted(straight, w))
                best = np.fmin(best, _right_angle(c, (a, b), (yaw0, yaw1), w))
            same, other = center(goal, a) - center(start, a), center(goal, -a) - center(start, a)
            best = np.fmin(best, _three_arcs(same, a, (yaw0, yaw1), w))
            best = np.fmin(best, _four_arcs(other, a, (yaw0, yaw1), w))
            best = np.fmin(best, _two_right_angles(other, a, (yaw0, yaw1), w))
    return best


def _three_arcs(c: Complex, a: float, yaws: tuple[Array, Array], w: Weights) -> Array:
    best = np.full(yaws[0].shape, np.inf)
    for z in SIDES:
        to_middle = np.angle(c) + z * np.arccos(np.abs(c) / 4.0)
        first = to_middle + a * math.pi / 2.0
        second = np.angle(2.0 * np.exp(1j * to_middle) - c) + a * math.pi / 2.0
        total = arc(a, first - yaws[0], w) + arc(-a, second - first, w) + arc(a, yaws[1] - second, w)
        best = np.fmin(best, total)
    return best


def _right(heading: Array, a: float) -> Complex:
    """Unit vector from the center of the circle on side `a` to the robot."""
    return -a * 1j * np.exp(1j * heading)


def _four_arcs(c: Complex, a: float, yaws: tuple[Array, Array], weights: Weights) -> Array:
    """C C_u C_u C: the middle arcs have equal length, and the same or the opposite direction of travel."""
    best = np.full(yaws[0].shape, np.inf)
    for z in SIDES:
        for kind in ("same", "opposite +", "opposite -"):
            if kind == "same":
                u = z * np.arccos((20.0 - np.abs(c) ** 2) / 16.0)
            else:
                u = z * np.arccos((2.0 + (1.0 if kind == "opposite +" else -1.0) * np.abs(c)) / 4.0)
            # headings after the first arc h, the second h - a u, the third h - a u + a w with w = u or -u
            w = u if kind == "same" else -u
            unit = 2.0 * (_right(0.0 * u, a) - _right(-a * u, a) + _right(-a * u + a * w, a))
            heading = np.angle(c / unit)
            outer = arc(a, heading - yaws[0], weights) + arc(-a, yaws[1] - (heading - a * u + a * w), weights)
            best = np.fmin(best, outer + weighted(u, weights) + weighted(w, weights))
    return best


def _right_angle(c: Complex, sides: tuple[float, float], yaws: tuple[Array, Array], w: Weights) -> Array:
    """C C(pi/2) S C with the first and the last circle on these sides."""
    a, b = sides
    best = np.full(yaws[0].shape, np.inf)
    for z in SIDES:
        u = z * math.pi / 2.0
        turn = -a * u
        fixed = 2.0 * _right(np.zeros(1), a) + (2.0 * -_right(np.full(1, turn), a) if b == a else 0.0)
        along = np.exp(1j * turn)
        # |fixed + s along| = |c|
        product = (fixed * np.conj(along)).real
        root = np.sqrt(product**2 - np.abs(fixed) ** 2 + np.abs(c) ** 2)
        for s in (-product + root, -product - root):
            heading = np.angle(c / (fixed + s * along))
            arcs = arc(a, heading - yaws[0], w) + weighted(np.full(1, u), w) + arc(b, yaws[1] - heading - turn, w)
            best = np.fmin(best, arcs + weighted(s, w))
    return best


def _two_right_angles(c: Complex, a: float, yaws: tuple[Array, Array], weights: Weights) -> Array:
    """C C(pi/2) S C(pi/2) C."""
    best = np.full(yaws[0].shape, np.inf)
    for z in SIDES:
        for w in SIDES:
            turn, back = -a * z * math.pi / 2.0, a * w * math.pi / 2.0
            one = np.zeros(1)
            fixed = 2.0 * (_right(one, a) - _right(one + turn, a) + _right(one + turn + back, a))
            along = np.exp(1j * turn)
            product = (fixed * np.conj(along)).real
            root = np.sqrt(product**2 - np.abs(fixed) ** 2 + np.abs(c) ** 2)
            for s in (-product + root, -product - root):
                heading = np.angle(c / (fixed + s * along))
                outer = arc(a, heading - yaws[0], weights) + arc(-a, yaws[1] - heading - turn - back, weights)
                right = weighted(0.5 * math.pi * np.array([z, w]), weights).sum()
                best = np.fmin(best, outer + right + weighted(s, weights))
    return best


def main() -> None:
    """`python -m tests.global_planner.brute_force 1000000`: compare that many random pairs with the product."""
    import sys

    from navstack.global_planner._curves import curve_lengths

    total = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    rng = np.random.default_rng(0)
    worst = {False: 0.0, True: 0.0}
    for first in range(0, total, 100_000):
        n = min(100_000, total - first)
        goals = np.column_stack((rng.uniform(-6.0, 6.0, (n, 2)), rng.uniform(-math.pi, math.pi, n)))
        goals[::2, :2] *= 0.25
        for reverse, shortest in ((False, dubins), (True, reeds_shepp)):
            error = np.abs(curve_lengths(np.zeros((n, 3)), goals, 1.0, reverse=reverse) - shortest(*goals.T))
            worst[reverse] = max(worst[reverse], float(error.max()))
    print(f"{total} pairs, largest difference: Dubins {worst[False]:.2e}, Reeds-Shepp {worst[True]:.2e} radii")


if __name__ == "__main__":
    main()
