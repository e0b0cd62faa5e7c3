# pyright: basic
"""Shortest curves of bounded curvature between two poses, with the unit as turning radius.

Dubins (1957) drives forward only; Reeds and Shepp (1990) also backward. The goal is given in the frame of the start, in units of
the turning radius. A word is a record of up to five segments: kinds (LEFT, STRAIGHT, RIGHT) and signed lengths.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import plain_kernel

NONE, LEFT, STRAIGHT, RIGHT = 0, 1, 2, 3
SEGMENTS = 5
TAU = 2.0 * math.pi
HALF_PI = 0.5 * math.pi
EPSILON = 1e-9
"""Tolerance of signs and ranges: an exact test would miss words with a segment near zero."""
DUBINS_WORDS = np.array([[1, 2, 1], [3, 2, 3], [1, 2, 3], [3, 2, 1], [3, 1, 3], [1, 3, 1]], np.int64)
"""LSL, RSR, LSR, RSL, RLR, LRL."""
RS_WORDS = np.array(
    [
        [1, 2, 1, 0, 0],
        [1, 2, 3, 0, 0],
        [1, 3, 1, 0, 0],
        [1, 3, 1, 3, 0],
        [1, 3, 1, 3, 0],
        [1, 3, 2, 1, 0],
        [1, 3, 2, 3, 0],
        [1, 3, 2, 1, 3],
    ],
    np.int64,
)
"""Base words 8.1, 8.2, 8.3/8.4, 8.7, 8.8, 8.9, 8.10 and 8.11 of Reeds and Shepp."""
RS_COUNT = np.array([3, 3, 3, 4, 4, 4, 4, 5], np.int64)


@plain_kernel
def wrapped(angle):
    """Return an angle in [0, 2 pi); within EPSILON of 2 pi it is 0: an arc of almost a full turn is none."""
    turned = angle - TAU * math.floor(angle / TAU)
    return 0.0 if turned >= TAU - EPSILON else turned


@plain_kernel
def centred(angle):
    """Return an angle in (-pi, pi]; within EPSILON of -pi it is pi."""
    turned = angle - TAU * math.floor(angle / TAU + 0.5)
    return turned + TAU if turned <= EPSILON - math.pi else turned


@plain_kernel
def dubins_candidate(word, d, a, b, trig, bound):
    """Return (t, p, q) of a Dubins word; t is infinite without a solution, or if p alone is at least `bound`.

    `d`: distance; `a`, `b`: headings against it; `trig`: their sines and cosines, and the cosine of a - b.
    """
    sa, sb, ca, cb, cab = trig
    if word < 2:
        sign = 1.0 if word == 0 else -1.0
        squared = 2.0 + d * d - 2.0 * cab + sign * 2.0 * d * (sa - sb)
        if squared < -EPSILON:
            return np.inf, 0.0, 0.0
        p = math.sqrt(max(squared, 0.0))
        if p >= bound:
            return np.inf, 0.0, 0.0
        # with p = 0 both arcs are on one circle, and the direction between them is arbitrary
        eta = a if p < EPSILON else math.atan2(sign * (cb - ca), d + sign * (sa - sb))
        return wrapped(sign * (eta - a)), p, wrapped(sign * (b - eta))
    if word < 4:
        sign = 1.0 if word == 2 else -1.0
        squared = d * d - 2.0 + 2.0 * cab + sign * 2.0 * d * (sa + sb)
        if squared < -EPSILON:
            return np.inf, 0.0, 0.0
        p = math.sqrt(max(squared, 0.0))
        if p >= bound:
            return np.inf, 0.0, 0.0
        eta = math.atan2(-sign * (ca + cb), d + sign * (sa + sb)) - math.atan2(-sign * 2.0, p)
        return wrapped(sign * (eta - a)), p, wrapped(sign * (eta - b))
    sign = 1.0 if word == 4 else -1.0
    cosine = (6.0 - d * d + 2.0 * cab + sign * 2.0 * d * (sa - sb)) / 8.0
    if abs(cosine) > 1.0 or bound <= math.pi:  # the middle arc is longer than half a circle
        return np.inf, 0.0, 0.0
    p = TAU - math.acos(cosine)
    if p >= bound:
        return np.inf, 0.0, 0.0
    t = wrapped(sign * (a - math.atan2(sign * (ca - cb), d - sign * (sa - sb))) + 0.5 * p)
    return t, p, wrapped(sign * (a - b) - t + p)


@plain_kernel
def dubins(x, y, phi, bound):
    """Return (length, word, t, p, q) of the shortest Dubins curve to the goal (x, y, phi).

    Curves that are not shorter than `bound` need not be found: then the length is at least `bound`, and the rest has no meaning.
    """
    d, theta = math.hypot(x, y), math.atan2(y, x)
    a, b = wrapped(-theta), wrapped(phi - theta)
    trig = (math.sin(a), math.sin(b), math.cos(a), math.cos(b), math.cos(a - b))
    best, best_word, best_t, best_p, best_q = bound, 0, 0.0, 0.0, 0.0
    for word in range(6):
        # the middle arc of a shortest curve of three arcs joins poses less than four radii apart
        if word >= 4 and d > 4.0 + EPSILON:
            break
        t, p, q = dubins_candidate(word, d, a, b, trig, best)
        if t + p + q < best:
            best, best_word, best_t, best_p, best_q = t + p + q, word, t, p, q
    return best, best_word, best_t, best_p, best_q


@plain_kernel
def tau_omega(u, v, xi, eta, phi):
    """Return the outer arcs of a word of four arcs, given its inner ones."""
    delta = centred(u - v)
    a = math.sin(u) - math.sin(delta)
    b = math.cos(u) - math.cos(delta) - 1.0
    t1 = math.atan2(eta * a - xi * b, xi * a + eta * b)
    t2 = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0
    tau = centred(t1 + math.pi) if t2 < 0.0 else centred(t1)
    return tau, centred(tau - u + v - phi)


@plain_kernel
def reeds_shepp_base(family, x, y, phi, s, c, bound):
    """Return (accepted, t, u, v) of a base word; `family`: row of RS_WORDS; `s`, `c`: sine and cosine of phi.

    A word whose inner arcs alone are not shorter than `bound` is not accepted.
    """
    if family == 0 or family == 2 or family == 5:
        xi, eta = x - s, y - 1.0 + c
    else:
        xi, eta = x + s, y - 1.0 - c
    rho = math.hypot(xi, eta)
    t, u, v = -1.0, 0.0, 0.0
    if family == 0:
        if rho >= bound:
            return False, t, u, v
        t, u = centred(math.atan2(eta, xi)), rho
        v = centred(phi - t)
        return t >= -EPSILON and v >= -EPSILON, t, u, v
    if family == 1:
        if rho < 2.0 - EPSILON:
            return False, t, u, v
        u = math.sqrt(max(rho * rho - 4.0, 0.0))
        if u >= bound:
            return False, t, u, v
        t = centred(math.atan2(eta, xi) + math.atan2(2.0, u))
        v = centred(t - phi)
        return t >= -EPSILON and v >= -EPSILON, t, u, v
    if family == 2:
        if rho > 4.0 + EPSILON:
            return False, t, u, v
        u = -2.0 * math.asin(min(0.25 * rho, 1.0))
        if -u >= bound:
            return False, t, u, v
        t = centred(math.atan2(eta, xi) + 0.5 * u + math.pi)
        v = centred(phi - t + u)
        return t >= -EPSILON, t, u, v
    if family == 3:
        ratio = 0.25 * (2.0 + rho)
        if ratio > 1.0 + EPSILON:
            return False, t, u, v
        u = math.acos(min(ratio, 1.0))
        if 2.0 * u >= bound:
            return False, t, u, v
        t, v = tau_omega(u, -u, xi, eta, phi)
        return t >= -EPSILON and v <= EPSILON, t, u, v
    if family == 4:
        ratio = (20.0 - rho * rho) / 16.0
        if ratio < -EPSILON or ratio > 1.0 + EPSILON:
            return False, t, u, v
        u = -math.acos(min(max(ratio, 0.0), 1.0))
        if -2.0 * u >= bound:
            return False, t, u, v
        t, v = tau_omega(u, u, xi, eta, phi)
        return t >= -EPSILON and v >= -EPSILON, t, u, v
    if rho < 2.0 - EPSILON:
        return False, t, u, v
    if family == 5:
        r = math.sqrt(max(rho * rho - 4.0, 0.0))
        u = 2.0 - r
        if u > EPSILON or abs(u) + HALF_PI >= bound:
            return False, t, u, v
        t = centred(math.atan2(eta, xi) + math.atan2(r, -2.0))
        v = centred(phi - HALF_PI - t)
        return t >= -EPSILON and v <= EPSILON, t, u, v
    if family == 6:
        u = 2.0 - rho
        if u > EPSILON or abs(u) + HALF_PI >= bound:
            return False, t, u, v
        t = centred(math.atan2(xi, -eta))
        v = centred(t + HALF_PI - phi)
        return t >= -EPSILON and v <= EPSILON, t, u, v
    u = 4.0 - math.sqrt(max(rho * rho - 4.0, 0.0))
    if u > EPSILON or abs(u) + math.pi >= bound:
        return False, t, u, v
    t = centred(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    v = centred(t - phi)
    return t >= -EPSILON and v >= -EPSILON, t, u, v


@plain_kernel
def reeds_shepp_goal(x, y, phi, c, s, variant):
    """Return the goal (x, y, phi), and the sine of phi, for which a variant of a word is the base word; `c`, `s`: of phi."""
    if variant & 4:
        x, y = x * c + y * s, x * s - y * c
    if variant & 1:
        x, phi, s = -x, -phi, -s
    if variant & 2:
        y, phi, s = -y, -phi, -s
    return x, y, phi, s


@plain_kernel
def reeds_shepp_word(family, variant, goal, c, bound):
    """Return (accepted, t, u, v) of a variant of a word; `goal`: of `reeds_shepp_goal`, `c`: cosine of phi."""
    if variant >= 4 and family != 2 and family != 5 and family != 6:
        return False, 0.0, 0.0, 0.0  # backwards, the other words are themselves
    x, y, phi, s = goal
    return reeds_shepp_base(family, x, y, phi, s, c, bound)


@plain_kernel
def reeds_shepp(x, y, phi, bound):
    """Return (length, family, variant, t, u, v) of the shortest Reeds-Shepp curve to the goal (x, y, phi).

    `variant`: sum of 1 (time flip), 2 (reflection) and 4 (backwards). `bound`: as in `dubins`.
    """
    c, s = math.cos(phi), math.sin(phi)
    best, best_family, best_variant, best_t, best_u, best_v = bound, 0, 0, 0.0, 0.0, 0.0
    for variant in range(8):
        goal = reeds_shepp_goal(x, y, phi, c, s, variant)
        for family in range(8):
            accepted, t, u, v = reeds_shepp_word(family, variant, goal, c, best)
            if accepted:
                length = abs(t) + abs(u) + abs(v)
                if family == 3 or family == 4:
                    length += abs(u)
                elif family == 7:
                    length += math.pi
                elif family >= 5:
                    length += HALF_PI
                if length < best:
                    best, best_family, best_variant, best_t, best_u, best_v = length, family, variant, t, u, v
    return best, best_family, best_variant, best_t, best_u, best_v


@plain_kernel
def backwards(count, values):
    """Return a tuple of SEGMENTS entries with the first `count` of them (3 to 5) in reverse order."""
    a, b, c, d, e = values
    if count == 3:
        return c, b, a, d, e
    return (d, c, b, a, e) if count == 4 else (e, d, c, b, a)


@plain_kernel
def reeds_shepp_segments(family, variant, t, u, v):
    """Return (count, kinds, lengths) of a word that `reeds_shepp` returned, as `curve` does."""
    count = RS_COUNT[family]
    if count == 3:
        lengths = (t, u, v, 0.0, 0.0)
    elif family == 3:
        lengths = (t, u, -u, v, 0.0)
    elif family == 4:
        lengths = (t, u, u, v, 0.0)
    elif count == 4:
        lengths = (t, -HALF_PI, u, v, 0.0)
    else:
        lengths = (t, -HALF_PI, u, -HALF_PI, v)
    row = RS_WORDS[family]
    kinds = (row[0], row[1], row[2], row[3], row[4])
    if variant & 4:
        kinds, lengths = backwards(count, kinds), backwards(count, lengths)
    if variant & 1:
        lengths = (-lengths[0], -lengths[1], -lengths[2], -lengths[3], -lengths[4])
    if variant & 2:
        both = LEFT + RIGHT
        kinds = (both - kinds[0], both - kinds[1], both - kinds[2], both - kinds[3], both - kinds[4])
    return count, kinds, lengths


@plain_kernel
def curve(x, y, phi, reverse, bound):
    """Return (count, kinds, lengths, total) of the shortest curve to the goal (x, y, phi).

    `reverse`: Reeds-Shepp instead of Dubins. `kinds`, `lengths`: tuples of SEGMENTS entries, of which the first `count` count.
    `bound`: as in `dubins`.
    """
    if not reverse:
        total, word, t, p, q = dubins(x, y, phi, bound)
        row = DUBINS_WORDS[word]
        return 3, (row[0], row[1], row[2], 0, 0), (t, p, q, 0.0, 0.0), total
    total, family, variant, t, u, v = reeds_shepp(x, y, phi, bound)
    count, kinds, lengths = reeds_shepp_segments(family, variant, t, u, v)
    return count, kinds, lengths, total


@plain_kernel
def advance(kind, x, y, theta, length, radius):
    """Return the pose after a segment of signed `length` (same unit as `radius`) from (x, y, theta)."""
    if kind == STRAIGHT:
        return x + length * math.cos(theta), y + length * math.sin(theta), theta
    sign = 1.0 if kind == LEFT else -1.0
    turned = theta + sign * length / radius
    return (
        x + sign * radius * (math.sin(turned) - math.sin(theta)),
        y - sign * radius * (math.cos(turned) - math.cos(theta)),
        turned,
    )


@plain_kernel
def curve_lengths(starts, goals, radius, reverse, out):
    """Write the lengths (m) of the shortest curves between poses (n, 3) to `out` (n,); `radius` (n,) (m)."""
    for i in range(len(starts)):
        dx, dy = (goals[i, 0] - starts[i, 0]) / radius[i], (goals[i, 1] - starts[i, 1]) / radius[i]
        c, s = math.cos(starts[i, 2]), math.sin(starts[i, 2])
        x, y, phi = c * dx + s * dy, c * dy - s * dx, goals[i, 2] - starts[i, 2]
        out[i] = (reeds_shepp(x, y, phi, np.inf)[0] if reverse else dubins(x, y, phi, np.inf)[0]) * radius[i]


@plain_kernel
def sample_segment(kind, pose, length, radius, count, out, first):
    """Write `count` poses after `pose` (3,), evenly spaced along a segment, to the rows of `out` from `first` on."""
    for k in range(count):
        x, y, theta = advance(kind, pose[0], pose[1], pose[2], length * (k + 1) / count, radius)
        out[first + k, 0], out[first + k, 1], out[first + k, 2] = x, y, theta
