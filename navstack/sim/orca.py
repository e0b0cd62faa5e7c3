"""Pedestrians who avoid each other by optimal reciprocal collision avoidance (ORCA).

Source: J. van den Berg, S. J. Guy, M. Lin, D. Manocha, "Reciprocal n-body collision avoidance", ISRR 2009. For each pair, the
velocities that avoid a collision within the time horizon, if the other person does its share, are approximated by a half-plane;
of the velocities in all half-planes and below the speed limit, the one nearest to the desired velocity is taken (sections 4 and
5.1). In a dense crowd there may be none: then it is the one that is least deep in the forbidden half-planes (section 5.3).

A half-plane is a row `normal x, normal y, offset`: velocities v (m/s) with normal . v >= offset, for a unit normal.
"""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math

from navstack.core import kernel

# sine of the angle below which two borders are parallel
PARALLEL = 1e-9


@kernel
def reciprocal_plane(px, py, vx, vy, other_vx, other_vy, reach, horizon, dt, share):
    """The half-plane of one person against another at the relative position (px, py) (m): normal x, normal y, offset.

    (vx, vy) and (other_vx, other_vy): their velocities (m/s); `reach`: the sum of the radii (m); `horizon`: time without
    collision (s); two that overlap part within `dt`. `share` of the change is this person's: 0.5, or 1 if the other does nothing.

    The relative velocities that collide within the horizon are a cone, cut off by the disc of radius `reach` / `horizon` around
    the position divided by the horizon. The least change `u` of the relative velocity leads to the border of that set, and the
    border's normal there is that of the half-plane.
    """
    rx, ry = vx - other_vx, vy - other_vy
    away2 = px * px + py * py
    if away2 <= reach * reach:
        horizon = dt
    wx, wy = rx - px / horizon, ry - py / horizon
    along = wx * px + wy * py
    size = math.hypot(wx, wy)
    if away2 <= reach * reach or (along < 0.0 and along * along > reach * reach * size * size):
        nx, ny = (wx / size, wy / size) if size > 0.0 else (1.0, 0.0)
        u = reach / horizon - size
    else:
        # the tangents from the origin to the disc around the other person
        tangent = math.sqrt(away2 - reach * reach)
        if px * wy - py * wx > 0.0:
            nx, ny = -(px * reach + py * tangent) / away2, (px * tangent - py * reach) / away2
        else:
            nx, ny = (py * tangent - px * reach) / away2, -(px * tangent + py * reach) / away2
        u = -(rx * nx + ry * ny)
    return nx, ny, nx * vx + ny * vy + share * u


@kernel
def nearest_velocity(planes, count, px, py, direction, limit):
    """The velocity of at most `limit` (m/s) in the first `count` half-planes (n, 3) that is nearest to (px, py).

    With `direction`, (px, py) is a unit vector, and it is the velocity farthest in that direction. The half-planes are added one
    by one: where one excludes the best velocity so far, the new best one is on its border. Returns the velocity, and how many
    half-planes it respects: fewer than `count` if the next one leaves nothing.
    """
    size = math.hypot(px, py)
    vx, vy = px, py
    if direction or size > limit:
        vx, vy = limit * px / size, limit * py / size
    for k in range(count):
        nx, ny, offset = planes[k, 0], planes[k, 1], planes[k, 2]
        if nx * vx + ny * vy >= offset:
            continue
        if abs(offset) > limit:
            return vx, vy, k
        high = math.sqrt(limit * limit - offset * offset)
        low = -high
        for j in range(k):
            slope = planes[j, 1] * nx - planes[j, 0] * ny
            needed = planes[j, 2] - offset * (planes[j, 0] * nx + planes[j, 1] * ny)
            if abs(slope) <= PARALLEL:
                if needed > 0.0:
                    return vx, vy, k
            elif slope > 0.0:
                low = max(low, needed / slope)
            else:
                high = min(high, needed / slope)
        if low > high:
            return vx, vy, k
        along = py * nx - px * ny
        if direction:
            along = math.copysign(math.inf, along)
        along = min(max(along, low), high)
        vx, vy = offset * nx - along * ny, offset * ny + along * nx
    return vx, vy, count


@kernel
def least_violating(planes, count, fixed, begin, limit, vx, vy, scratch):
    """The velocity of at most `limit` (m/s) whose greatest depth in the forbidden half-planes is least.

    The first `fixed` half-planes (walls) do not give way. (vx, vy) is the best one for those before `begin`. `scratch` (n, 3).
    A half-plane that is violated more than the others so far determines the result: the others must not be worse, which is a
    half-plane for each, with the difference of the two normals.
    """
    depth = 0.0
    for k in range(begin, count):
        nx, ny, offset = planes[k, 0], planes[k, 1], planes[k, 2]
        if offset - (nx * vx + ny * vy) <= depth:
            continue
        number = 0
        for j in range(k):
            dx, dy, more = planes[j, 0], planes[j, 1], planes[j, 2]
            size = 1.0
            if j >= fixed:
                dx, dy, more = dx - nx, dy - ny, more - offset
                size = math.hypot(dx, dy)
                if size <= PARALLEL:
                    continue
            scratch[number, 0], scratch[number, 1], scratch[number, 2] = dx / size, dy / size, more / size
            number += 1
        wx, wy, respected = nearest_velocity(scratch, number, nx, ny, True, limit)
        if respected == number:
            vx, vy = wx, wy
        depth = offset - (nx * vx + ny * vy)
    return vx, vy


@kernel
def avoiding_velocity(planes, count, fixed, px, py, limit, scratch):
    """The velocity (m/s), at most `limit`, for the desired one (px, py) and `count` half-planes, the first `fixed` of walls."""
    vx, vy, respected = nearest_velocity(planes, count, px, py, False, limit)
    if respected < count:
        vx, vy = least_violating(planes, count, fixed, respected, limit, vx, vy, scratch)
    return vx, vy
