"""Dubins and Reeds-Shepp curves: the shortest curves of bounded curvature between two poses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navstack.core import InputError, Pose2D, normalize_angle, plain_kernel

# ----------------------------------------------------------------------------------------------------------------------
# Shortest curves of bounded curvature between two poses, with the unit as turning radius.
#
# Dubins (1957) drives forward only; Reeds and Shepp (1990) also backward. The goal is given in the frame of the start, in units
# of the turning radius. A word is a record of up to five segments: kinds (LEFT, STRAIGHT, RIGHT) and signed lengths.


# pyright: basic


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
def centered(angle):
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
    delta = centered(u - v)
    a = math.sin(u) - math.sin(delta)
    b = math.cos(u) - math.cos(delta) - 1.0
    t1 = math.atan2(eta * a - xi * b, xi * a + eta * b)
    t2 = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0
    tau = centered(t1 + math.pi) if t2 < 0.0 else centered(t1)
    return tau, centered(tau - u + v - phi)


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
        t, u = centered(math.atan2(eta, xi)), rho
        v = centered(phi - t)
        return t >= -EPSILON and v >= -EPSILON, t, u, v
    if family == 1:
        if rho < 2.0 - EPSILON:
            return False, t, u, v
        u = math.sqrt(max(rho * rho - 4.0, 0.0))
        if u >= bound:
            return False, t, u, v
        t = centered(math.atan2(eta, xi) + math.atan2(2.0, u))
        v = centered(t - phi)
        return t >= -EPSILON and v >= -EPSILON, t, u, v
    if family == 2:
        if rho > 4.0 + EPSILON:
            return False, t, u, v
        u = -2.0 * math.asin(min(0.25 * rho, 1.0))
        if -u >= bound:
            return False, t, u, v
        t = centered(math.atan2(eta, xi) + 0.5 * u + math.pi)
        v = centered(phi - t + u)
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
        t = centered(math.atan2(eta, xi) + math.atan2(r, -2.0))
        v = centered(phi - HALF_PI - t)
        return t >= -EPSILON and v <= EPSILON, t, u, v
    if family == 6:
        u = 2.0 - rho
        if u > EPSILON or abs(u) + HALF_PI >= bound:
            return False, t, u, v
        t = centered(math.atan2(xi, -eta))
        v = centered(t + HALF_PI - phi)
        return t >= -EPSILON and v <= EPSILON, t, u, v
    u = 4.0 - math.sqrt(max(rho * rho - 4.0, 0.0))
    if u > EPSILON or abs(u) + math.pi >= bound:
        return False, t, u, v
    t = centered(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    v = centered(t - phi)
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
def lengths_of_curves(starts, goals, radius, reverse, out):
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


_NAMES: Final = {LEFT: "L", STRAIGHT: "S", RIGHT: "R"}
_NOTHING: Final = 1e-9
"""Segments shorter than this, in radii, are left out of words."""


class Segment(NamedTuple):
    """An arc of the turning radius, or a straight line."""

    kind: str
    """L, S or R: left arc, straight line, right arc."""
    length: float
    """Length (m), negative when driven backward."""


@dataclass(frozen=True, slots=False)
class Curve:
    """A path of arcs and straight lines."""

    start: Pose2D
    radius: float
    """Turning radius of the arcs (m)."""
    segments: tuple[Segment, ...]

    @cached_property
    def length(self) -> float:
        """Length (m), both directions counted positive."""
        return sum(abs(s.length) for s in self.segments)

    @property
    def word(self) -> str:
        """The kinds of the segments, with a minus sign after those driven backward: `LR-L`."""
        return "".join(s.kind + ("-" if s.length < 0.0 else "") for s in self.segments)

    @property
    def cusps(self) -> int:
        """Number of changes between driving forward and backward."""
        return sum(a.length * b.length < 0.0 for a, b in zip(self.segments[:-1], self.segments[1:], strict=True))

    def poses(self, step: float) -> NDArray[np.float64]:
        """Return poses (n, 3) at most `step` (m) apart, the ends of all segments included; yaw in (-pi, pi]."""
        if not (step > 0.0 and math.isfinite(step)):
            raise InputError(f"the step between the poses of a curve must be a positive length in meters, not {step}")
        counts = [max(1, math.ceil(abs(s.length) / step - 1e-9)) for s in self.segments]
        out = np.empty((1 + sum(counts), 3))
        out[0] = self.start
        first = 1
        for segment, count in zip(self.segments, counts, strict=True):
            kind = next(k for k, name in _NAMES.items() if name == segment.kind)
            sample_segment(kind, out[first - 1].copy(), segment.length, self.radius, count, out, first)
            first += count
        out[:, 2] = [normalize_angle(float(yaw)) for yaw in out[:, 2]]
        return out


def dubins_curve(start: Pose2D, goal: Pose2D, radius: float) -> Curve:
    """Return the shortest curve from `start` to `goal` that is driven forward, with turning radius `radius` (m).

    L. Dubins, 1957; A. Shkel and V. Lumelsky, 2001. Raises InputError for poses that are not finite and for a radius that is
    not positive.
    """
    return _curve(start, goal, radius, reverse=False)


def reeds_shepp_curve(start: Pose2D, goal: Pose2D, radius: float) -> Curve:
    """Return the shortest curve from `start` to `goal`, driven forward and backward, with turning radius `radius` (m).

    J. Reeds and L. Shepp, 1990. Raises InputError as `dubins_curve`.
    """
    return _curve(start, goal, radius, reverse=True)


def curve_lengths(starts: ArrayLike, goals: ArrayLike, radius: ArrayLike, *, reverse: bool) -> NDArray[np.float64]:
    """Return the lengths (m) of the shortest curves between poses (n, 3); `radius` (m): a number or (n,).

    `reverse`: Reeds-Shepp curves instead of Dubins curves. Raises InputError as `dubins_curve`.
    """
    a, b = np.atleast_2d(np.asarray(starts, np.float64)), np.atleast_2d(np.asarray(goals, np.float64))
    radii = np.broadcast_to(np.asarray(radius, np.float64), (len(a),)).copy()
    if a.shape != b.shape or a.shape[1:] != (3,):
        raise InputError(f"starts and goals must be arrays of the same shape (n, 3), not {a.shape} and {b.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise InputError("the poses of a curve must be finite numbers: x, y (m) and yaw (rad)")
    if not (np.isfinite(radii).all() and (radii > 0.0).all()):
        raise InputError(f"turning radii must be positive lengths in meters; the smallest is {radii.min()}")
    out = np.empty(len(a))
    lengths_of_curves(np.ascontiguousarray(a), np.ascontiguousarray(b), radii, reverse, out)
    return out


def _curve(start: Pose2D, goal: Pose2D, radius: float, *, reverse: bool) -> Curve:
    for name, pose in (("start", start), ("end", goal)):
        if not pose.is_finite():
            raise InputError(
                f"the {name} {tuple(pose)} of a curve is not finite; give x, y (m) and yaw (rad)", pose=pose
            )
    if not (radius > 0.0 and math.isfinite(radius)):
        raise InputError(f"the turning radius must be a positive length in meters, not {radius}", radius=radius)
    dx, dy = (goal.x - start.x) / radius, (goal.y - start.y) / radius
    c, s = math.cos(start.yaw), math.sin(start.yaw)
    count, kinds, lengths, _ = curve(c * dx + s * dy, c * dy - s * dx, goal.yaw - start.yaw, reverse, math.inf)
    segments = tuple(
        Segment(_NAMES[int(kinds[i])], float(lengths[i]) * radius) for i in range(count) if abs(lengths[i]) > _NOTHING
    )
    return Curve(start, radius, segments)


# ----------------------------------------------------------------------------------------------------------------------
# Curves of bounded curvature for robots to which a change of direction costs something. Units as in `curve_kernels`.
#
# Candidates are the words of Reeds and Shepp and those of Dubins, driven forward or backward. They compete by length, in which
# driving backward counts `backward` times (at least 1), plus `cusp` for each change of direction. Arcs of words may be driven
# forward on the rest of their circle instead. `ends`: direction of travel before and after the curve, 1, -1, or 0 where it does
# not matter; a change there counts as well.


# pyright: basic


@plain_kernel
def changes_of_direction(lengths, ends):
    """Return how often the sign changes among the lengths, and between them and the directions `ends`."""
    changes, direction = 0, ends[0]
    for i in range(SEGMENTS):
        if abs(lengths[i]) >= EPSILON:
            sign = 1 if lengths[i] > 0.0 else -1
            changes += direction == -sign
            direction = sign
    return changes + (direction * ends[1] < 0)


@plain_kernel
def word_cost(lengths, cusp, backward, ends):
    """Return the cost of a curve with these signed lengths."""
    total = cusp * changes_of_direction(lengths, ends)
    for i in range(SEGMENTS):
        total += lengths[i] if lengths[i] > 0.0 else -backward * lengths[i]
    return total


@plain_kernel
def forward_arc(kind, length, backward):
    """Return the signed length of an arc, or of the rest of its circle where that costs less."""
    rest = TAU + length
    return rest if kind != STRAIGHT and rest < -backward * length else length


@plain_kernel
def with_forward_arcs(kinds, lengths, backward):
    """Return the signed lengths of a curve in which arcs backward are replaced by the rest of their circles."""
    return (
        forward_arc(kinds[0], lengths[0], backward),
        forward_arc(kinds[1], lengths[1], backward),
        forward_arc(kinds[2], lengths[2], backward),
        forward_arc(kinds[3], lengths[3], backward),
        forward_arc(kinds[4], lengths[4], backward),
    )


@plain_kernel
def cheapest_curve(x, y, phi, cusp, backward, ends, bound):
    """Return (count, kinds, lengths, cost) of the cheapest curve to the goal (x, y, phi).

    `kinds` and `lengths` as `curve` returns them. `bound`: a curve that does not cost less need not be found; then the cost is at
    least that, and the rest has no meaning.
    """
    best, count = bound, 3
    kinds, best_lengths = (0, 0, 0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)
    for sign in (1, -1):
        length, word, t, u, v = dubins(sign * x, y, sign * phi, best)
        lengths = (sign * t, sign * u, sign * v, 0.0, 0.0)
        cost = word_cost(lengths, cusp, backward, ends)
        if length < best and cost < best:
            row = DUBINS_WORDS[word]
            best, kinds, best_lengths = cost, (row[0], row[1], row[2], 0, 0), lengths
    c, s = math.cos(phi), math.sin(phi)
    for variant in range(8):
        goal = reeds_shepp_goal(x, y, phi, c, s, variant)
        for family in range(8):
            accepted, t, u, v = reeds_shepp_word(family, variant, goal, c, best)
            if accepted:
                n, word_kinds, lengths = reeds_shepp_segments(family, variant, t, u, v)
                for _ in range(2):
                    cost = word_cost(lengths, cusp, backward, ends)
                    if cost < best:
                        best, count, kinds, best_lengths = cost, n, word_kinds, lengths
                    lengths = with_forward_arcs(word_kinds, lengths, backward)
    return count, kinds, best_lengths, best
