"""Dubins and Reeds-Shepp curves: the shortest curves of bounded curvature between two poses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navstack.core import Pose2D
from navstack.core.angles import normalize_angle
from navstack.core.errors import InputError
from navstack.curves import curve_kernels as kernels

_NAMES: Final = {kernels.LEFT: "L", kernels.STRAIGHT: "S", kernels.RIGHT: "R"}
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
            raise InputError(f"the step between the poses of a curve must be a positive length in metres, not {step}")
        counts = [max(1, math.ceil(abs(s.length) / step - 1e-9)) for s in self.segments]
        out = np.empty((1 + sum(counts), 3))
        out[0] = self.start
        first = 1
        for segment, count in zip(self.segments, counts, strict=True):
            kind = next(k for k, name in _NAMES.items() if name == segment.kind)
            kernels.sample_segment(kind, out[first - 1].copy(), segment.length, self.radius, count, out, first)
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
        raise InputError(f"turning radii must be positive lengths in metres; the smallest is {radii.min()}")
    out = np.empty(len(a))
    kernels.curve_lengths(np.ascontiguousarray(a), np.ascontiguousarray(b), radii, reverse, out)
    return out


def _curve(start: Pose2D, goal: Pose2D, radius: float, *, reverse: bool) -> Curve:
    for name, pose in (("start", start), ("end", goal)):
        if not pose.is_finite():
            raise InputError(
                f"the {name} {tuple(pose)} of a curve is not finite; give x, y (m) and yaw (rad)", pose=pose
            )
    if not (radius > 0.0 and math.isfinite(radius)):
        raise InputError(f"the turning radius must be a positive length in metres, not {radius}", radius=radius)
    dx, dy = (goal.x - start.x) / radius, (goal.y - start.y) / radius
    c, s = math.cos(start.yaw), math.sin(start.yaw)
    count, kinds, lengths, _ = kernels.curve(c * dx + s * dy, c * dy - s * dx, goal.yaw - start.yaw, reverse, math.inf)
    segments = tuple(
        Segment(_NAMES[int(kinds[i])], float(lengths[i]) * radius) for i in range(count) if abs(lengths[i]) > _NOTHING
    )
    return Curve(start, radius, segments)
