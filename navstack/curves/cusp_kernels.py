# pyright: basic
"""Curves of bounded curvature for robots to which a change of direction costs something. Units as in `curve_kernels`.

Candidates are the words of Reeds and Shepp and those of Dubins, driven forward or backward. They compete by length, in which
driving backward counts `backward` times (at least 1), plus `cusp` for each change of direction. Arcs of words may be driven
forward on the rest of their circle instead. `ends`: direction of travel before and after the curve, 1, -1, or 0 where it does
not matter; a change there counts as well.
"""

from __future__ import annotations

import math

from navstack.core.jit import plain_kernel
from navstack.curves.curve_kernels import (
    DUBINS_WORDS,
    EPSILON,
    SEGMENTS,
    STRAIGHT,
    TAU,
    dubins,
    reeds_shepp_goal,
    reeds_shepp_segments,
    reeds_shepp_word,
)


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
