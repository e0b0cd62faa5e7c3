"""The action `approach`: keeps a time to the first contact, and a command from which the robot can still brake."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import Twist2D, kernel
from navstack.safety import zones as kernels
from navstack.safety.zones import MOST_SHOWN, TINY, Shape, Zone, in_shape, shape_distance

# ----------------------------------------------------------------------------------------------------------------------
# When points enter a zone while the robot moves: exactly, in steps as Nav2, and while it brakes.
#
# Shapes and points as in `_zone_kernels`. A point fixed in the world moves, in the base frame of a robot with constant velocity
# (vx, vy, w), along a circle around (-vy / w, vx / w) with the angular velocity -w, or along a line.


# pyright: basic


STRAIGHT = 1e-9  # slower turns are straight motion, rad/s


@kernel
def angle_ahead(x, y, qx, qy, sign):
    """Return the angle in [0, 2 pi) from the direction (x, y) to (qx, qy), counted in the direction of `sign`."""
    angle = sign * math.atan2(x * qy - y * qx, x * qx + y * qy)
    return angle if angle >= 0.0 else angle + 2.0 * math.pi


@kernel
def arc_to_polygon(corners, x, y, cx, cy, w):
    """Return the time at which a point outside a polygon reaches it on its circle around (cx, cy); inf if it never does."""
    rx, ry = x - cx, y - cy
    square = rx * rx + ry * ry
    sign = -1.0 if w > 0.0 else 1.0
    best = math.inf
    n = corners.shape[0]
    px, py = corners[n - 1, 0] - cx, corners[n - 1, 1] - cy
    for i in range(n):
        qx, qy = corners[i, 0] - cx, corners[i, 1] - cy
        dx, dy = qx - px, qy - py
        length = dx * dx + dy * dy
        if length > 0.0:
            along = -(px * dx + py * dy) / length
            fx, fy = px + along * dx, py + along * dy
            rest = (square - fx * fx - fy * fy) / length
            if rest >= 0.0:
                half = math.sqrt(rest)
                for s in (along - half, along + half):
                    if s >= -TINY and s <= 1.0 + TINY:
                        best = min(best, angle_ahead(rx, ry, px + s * dx, py + s * dy, sign))
        px, py = qx, qy
    return best / abs(w)


@kernel
def line_to_polygon(corners, x, y, vx, vy):
    """Return the time at which a point reaches a polygon that moves with (vx, vy); inf if it never does."""
    best = math.inf
    n = corners.shape[0]
    px, py = corners[n - 1, 0], corners[n - 1, 1]
    for i in range(n):
        qx, qy = corners[i, 0], corners[i, 1]
        dx, dy = qx - px, qy - py
        # (x, y) - t (vx, vy) = p + s d
        cross = dx * vy - dy * vx
        if abs(cross) > TINY:
            ax, ay = x - px, y - py
            t = (dx * ay - dy * ax) / cross
            s = (vy * ax - vx * ay) / -(vx * dy - vy * dx)
            if t >= 0.0 and s >= -TINY and s <= 1.0 + TINY:
                best = min(best, t)
        px, py = qx, qy
    return best


@kernel
def time_to_circle(radius, x, y, vx, vy, w):
    """Return the time at which a point outside a circle around the base reaches it; inf if it never does."""
    if abs(w) < STRAIGHT:
        a = vx * vx + vy * vy
        b = x * vx + y * vy
        rest = b * b - a * (x * x + y * y - radius * radius)
        if a < TINY or rest < 0.0 or b <= 0.0:
            return math.inf
        return (b - math.sqrt(rest)) / a
    cx, cy = -vy / w, vx / w
    far = math.hypot(cx, cy)
    rx, ry = x - cx, y - cy
    turn = math.hypot(rx, ry)
    if far < TINY or turn < TINY:
        return math.inf
    cosine = (radius * radius - far * far - turn * turn) / (2.0 * far * turn)
    if cosine > 1.0 or cosine < -1.0:
        return math.inf
    half = math.acos(cosine)
    toward = math.atan2(cy, cx)
    sign = -1.0 if w > 0.0 else 1.0
    first = angle_ahead(rx, ry, math.cos(toward + half), math.sin(toward + half), sign)
    other = angle_ahead(rx, ry, math.cos(toward - half), math.sin(toward - half), sign)
    return min(first, other) / abs(w)


@kernel
def first_contacts(points, corners, radius, reach, command, horizon, times):
    """Write the times (s) at which points enter a shape to `times` (k,); return how many do within `horizon`.

    0 for points inside; inf for points that do not enter within `horizon`. `command` (3,) is constant.
    """
    vx, vy, w = command[0], command[1], command[2]
    straight = abs(w) < STRAIGHT
    cx, cy = 0.0, 0.0
    if not straight:
        cx, cy = -vy / w, vx / w
    count = 0
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        times[i] = math.inf
        travel = horizon * math.hypot(vx - w * y, vy + w * x)
        limit = reach + travel
        if x * x + y * y > limit * limit:
            continue
        if in_shape(corners, radius, x, y):
            t = 0.0
        elif corners.shape[0] == 0:
            t = time_to_circle(radius, x, y, vx, vy, w)
        elif straight:
            t = line_to_polygon(corners, x, y, vx, vy)
        else:
            t = arc_to_polygon(corners, x, y, cx, cy, w)
        if t <= horizon:
            times[i] = t
            count += 1
    return count


# --- Nav2's simulation ------------------------------------------------------------------------------------------------


@kernel
def project_state(pose, velocity, dt):
    """Move a pose (3,) for `dt` by a velocity (3,) in its frame of reference, then turn both: one step of Nav2's simulation."""
    pose[0] += velocity[0] * dt
    pose[1] += velocity[1] * dt
    turn = velocity[2] * dt
    pose[2] += turn
    c, s = math.cos(turn), math.sin(turn)
    vx, vy = velocity[0], velocity[1]
    velocity[0] = vx * c - vy * s
    velocity[1] = vx * s + vy * c


@kernel
def seen_from(pose, x, y):
    """Return a point in the frame of a pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = x - pose[0], y - pose[1]
    return c * dx + s * dy, c * dy - s * dx


@kernel
def stepped_contact(points, corners, radius, least, command, horizon, step):
    """Return the time before the step in which `least` points are in the shape, as Nav2 computes it; -1 if they never are."""
    pose = command * 0.0
    velocity = command.copy()
    count = 0
    for i in range(points.shape[0]):
        if in_shape(corners, radius, points[i, 0], points[i, 1]):
            count += 1
    if count >= least:
        return 0.0
    t = 0.0
    while t <= horizon:
        project_state(pose, velocity, step)
        count = 0
        for i in range(points.shape[0]):
            x, y = seen_from(pose, points[i, 0], points[i, 1])
            if in_shape(corners, radius, x, y):
                count += 1
        if count >= least:
            return t
        t += step
    return -1.0


# --- braking ----------------------------------------------------------------------------------------------------------


@kernel
def braking_poses(velocity, commands, until, decel, dt, reach, poses):
    """Write the poses while a robot follows one command, then another, and then brakes to a stop; return their number.

    `commands` (2, 3) are followed up to the times `until` (2,). `poses` (n, 4): x, y, yaw, and the path length that no part of
    the shape exceeds up to there (m); the first one is the current pose. Velocities change by at most `decel` (3,),
    magnitudes (m/s², rad/s²).
    """
    vx, vy, w = velocity[0], velocity[1], velocity[2]
    x, y, yaw, length, t = 0.0, 0.0, 0.0, 0.0, 0.0
    count = 0
    while count < poses.shape[0]:
        poses[count, 0], poses[count, 1], poses[count, 2], poses[count, 3] = x, y, yaw, length
        count += 1
        ux, uy, uw = 0.0, 0.0, 0.0
        if t < until[0] - TINY:
            ux, uy, uw = commands[0, 0], commands[0, 1], commands[0, 2]
        elif t < until[1] - TINY:
            ux, uy, uw = commands[1, 0], commands[1, 1], commands[1, 2]
        elif vx == 0.0 and vy == 0.0 and w == 0.0:
            break
        # the mean of the velocities before and after the change
        nx = vx + min(max(ux - vx, -decel[0] * dt), decel[0] * dt)
        ny = vy + min(max(uy - vy, -decel[1] * dt), decel[1] * dt)
        nw = w + min(max(uw - w, -decel[2] * dt), decel[2] * dt)
        mx, my, mw = 0.5 * (vx + nx), 0.5 * (vy + ny), 0.5 * (w + nw)
        c, s = math.cos(yaw + 0.5 * mw * dt), math.sin(yaw + 0.5 * mw * dt)
        x += dt * (mx * c - my * s)
        y += dt * (mx * s + my * c)
        yaw += mw * dt
        length += dt * (math.hypot(mx, my) + abs(mw) * reach)
        vx, vy, w = nx, ny, nw
        t += dt
    return count


@kernel
def comes_within(corners, radius, x, y, poses, count, nearest):
    """Return True if a shape comes closer to a point than half of the way to the next pose, or than `nearest` if that is less.

    `poses` (n, 4) as in `braking_poses`, `count` of them; the first one does not count.
    """
    total = poses[count - 1, 3]
    k = 0
    while k < count:
        px, py = seen_from(poses[k], x, y)
        distance = shape_distance(corners, radius, px, py)
        last_one = k + 1 >= count
        step = poses[k, 3] - poses[max(k - 1, 0), 3] if last_one else poses[k + 1, 3] - poses[k, 3]
        if k > 0 and distance <= min(0.5 * step, nearest):
            return True
        if last_one or distance > total - poses[k, 3]:
            return False
        ahead = poses[k, 3] + max(distance, TINY)
        k += 1
        while k < count - 1 and poses[k, 3] < ahead - 0.5 * step:
            k += 1
    return False


@kernel
def touched_while_braking(points, corners, radius, reach, body, poses, count, least):
    """Return the number of points that a shape touches on the poses (n, 4) of `braking_poses`, at most `least`, and one of them.

    Of points in the shape at the first pose count those that `body` (m, 2), the robot's outline, touches, or of whose distance
    from it less than half remains; points in the outline do not count. A pose touches a point if it is closer than half of the
    way to the next pose, so that nothing is missed between two poses.
    """
    total = poses[count - 1, 3]
    touched, last = 0, -1
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        if math.hypot(x, y) - reach > total:
            continue
        if in_shape(corners, radius, x, y):
            distance = shape_distance(body, 0.0, x, y)
            hit = distance > 0.0 and comes_within(body, 0.0, x, y, poses, count, 0.5 * distance)
        else:
            hit = comes_within(corners, radius, x, y, poses, count, math.inf)
        if hit:
            touched, last = touched + 1, i
            if touched >= least:
                break
    return touched, last


FRACTIONS: Final = (1.0, 0.75, 0.5, 0.25)
"""Factors of a command that are tried until the robot can brake; then it stops."""
BRAKING_STEP_S: Final = 0.02
"""Time between two poses of the braking robot (s)."""
_MOST_POSES: Final = 500


@dataclass(frozen=True, slots=True, eq=False)
class ApproachLimit:
    """A slower command."""

    ratio: float
    """Factor of the command."""
    kind: Literal["inside", "contact", "braking"]
    """Points in the zone come nearer; points touch it within `time_before_collision`; the robot could not brake."""
    time: float
    """Seconds to the first contact, inf if it is not predicted."""
    points: NDArray[np.float64]
    """(k, 2) points in question, base frame."""


class Approach:
    """Predicts contacts of zones with points."""

    def __init__(
        self,
        body: NDArray[np.float64],
        hull: Shape,
        *,
        decel: NDArray[np.float64] | None,
        reaction_s: float,
        period_s: float,
        as_nav2: bool,
    ) -> None:
        """`body`: the robot's outline (n, 2), counter-clockwise; `hull`: the same, but a circle for a round robot.

        `decel` (3,): magnitudes (m/s², rad/s²); None if unknown. `reaction_s`: time until the robot follows a command (s);
        `period_s`: time between two checks (s). `as_nav2`: simulate in steps, as Nav2 does.
        """
        self.sent = np.zeros(3)
        """(3,) the last command that was sent to the robot."""
        self._body = body
        # the polygon of a circle would come nearer to points next to it when it turns
        self._hull = hull
        self._body_reach = float(np.hypot(body[:, 0], body[:, 1]).max())
        # an axis without deceleration is one that the robot does not have
        self._decel = None if decel is None else np.where(decel > 0.0, decel, 1e9)
        # the last command is in force until the robot reacts, then the new one until the next check
        self._until = np.array((reaction_s, reaction_s + period_s))
        self._as_nav2 = as_nav2
        self._times = np.empty(0)
        self._poses = np.empty((_MOST_POSES, 4))

    def limit(
        self, zone: Zone, points: NDArray[np.float64], command: Twist2D, measured: Twist2D
    ) -> ApproachLimit | None:
        """Return the slower command that a zone demands, None if it lets the command pass.

        `points` (k, 2) in the base frame; `measured` is the robot's velocity.
        """
        shape = zone.shape
        assert shape is not None
        if not len(points):
            return None
        u = np.array(command, np.float64)
        if self._as_nav2:
            return self._stepped(zone, shape, points, u)
        horizon = zone.params.time_before_collision
        times = self._times
        if len(times) < len(points):
            times = self._times = np.empty(len(points))
        times = times[: len(points)]
        near = first_contacts(points, shape.corners, shape.radius, shape.reach, u, horizon, times)
        found: ApproachLimit | None = None
        if near >= zone.least and command.speed + abs(command.wz) > 0.0:
            found = self._contact(zone, shape, points, times, u)
        if found is not None and found.ratio <= 0.0:
            return found
        return self._braking(zone, shape, points, u, measured, found)

    def moves_away(self, zone: Zone, points: NDArray[np.float64], command: Twist2D, measured: Twist2D) -> bool:
        """Return True if a command brings none of the points in the zone nearer to the robot's outline.

        The robot, with the velocity `measured`, must not touch one of them either, before it has followed the command.
        """
        shape = zone.shape
        assert shape is not None
        found = np.empty(len(points), np.int64)
        count = kernels.count_inside(points, shape.corners, shape.radius, shape.reach, found)
        u = np.array(command, np.float64)
        if count == 0 or self._nearer(points, found, count, u) >= 0:
            return False
        if self._decel is None:
            return True
        velocity = np.array(measured, np.float64)
        return self._touched(zone, shape, points[found[:count]], velocity, u)[0] < zone.least

    def _nearer(self, points: NDArray[np.float64], found: NDArray[np.int64], count: int, u: NDArray[np.float64]) -> int:
        return kernels.any_nearer(points, found, count, self._hull.corners, self._hull.radius, u)

    def _stepped(
        self, zone: Zone, shape: Shape, points: NDArray[np.float64], u: NDArray[np.float64]
    ) -> ApproachLimit | None:
        horizon = zone.params.time_before_collision
        step = zone.params.simulation_time_step
        time = stepped_contact(points, shape.corners, shape.radius, zone.least, u, horizon, step)
        if time < 0.0:
            return None
        kind: Literal["inside", "contact"] = "inside" if time == 0.0 else "contact"
        return ApproachLimit(time / horizon, kind, time, points[zone.inside(points)[1]])

    def _contact(
        self,
        zone: Zone,
        shape: Shape,
        points: NDArray[np.float64],
        times: NDArray[np.float64],
        u: NDArray[np.float64],
    ) -> ApproachLimit | None:
        """The limit by the time at which the last of `min_points` points touches the zone."""
        inside = times <= 0.0
        count = int(inside.sum())
        if count >= zone.least:
            index = np.flatnonzero(inside)
            leaves = zone.params.allow_moving_away
            nearer = self._nearer(points, index, len(index), u) if leaves else int(index[0])
            if nearer >= 0:
                return ApproachLimit(0.0, "inside", 0.0, points[index[:MOST_SHOWN]])
            # those points are left behind: what counts is what comes next
            times = np.where(inside, math.inf, times)
        wanted = zone.least
        if int(np.isfinite(times).sum()) < wanted:
            return None
        order = np.argpartition(times, wanted - 1)[:wanted]
        time = float(times[order].max())
        ratio = time / zone.params.time_before_collision
        return ApproachLimit(ratio, "contact", time, points[order[:MOST_SHOWN]]) if ratio < 1.0 else None

    def _braking(
        self,
        zone: Zone,
        shape: Shape,
        points: NDArray[np.float64],
        u: NDArray[np.float64],
        measured: Twist2D,
        found: ApproachLimit | None,
    ) -> ApproachLimit | None:
        """The limit by the way that the robot needs to brake; `found` if that is stricter."""
        if self._decel is None:
            return found
        ratio = found.ratio if found is not None else 1.0
        velocity = np.array(measured, np.float64)
        hit = -1
        for fraction in FRACTIONS:
            touched, last = self._touched(zone, shape, points, velocity, fraction * ratio * u)
            if touched < zone.least:
                if fraction == 1.0:
                    return found
                return ApproachLimit(
                    fraction * ratio, "braking", found.time if found else math.inf, points[hit : hit + 1]
                )
            hit = last
        return ApproachLimit(0.0, "braking", found.time if found else math.inf, points[hit : hit + 1])

    def _touched(
        self,
        zone: Zone,
        shape: Shape,
        points: NDArray[np.float64],
        velocity: NDArray[np.float64],
        command: NDArray[np.float64],
    ) -> tuple[int, int]:
        assert self._decel is not None
        commands = np.vstack((self.sent, command))
        count = braking_poses(velocity, commands, self._until, self._decel, BRAKING_STEP_S, shape.reach, self._poses)
        return touched_while_braking(
            points, shape.corners, shape.radius, shape.reach, self._body, self._poses, count, zone.least
        )
