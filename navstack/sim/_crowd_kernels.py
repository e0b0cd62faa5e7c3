# pyright: basic
"""People who walk: the social force model.

Source: D. Helbing, P. Molnár, "Social force model for pedestrian dynamics", Phys. Rev. E 51, 4282 (1995), equations 2 to 9
and the values given there: relaxation 0.5 s; others V0 = 2.1 m²/s², sigma = 0.3 m, their step in 2 s; walls U0 = 10 m²/s²,
R = 0.2 m; what lies outside 100 degrees to either side counts half; nobody walks faster than 1.3 times what he likes.
"""

from __future__ import annotations

import math

from navstack.core.jit import kernel
from navstack.sim._body_kernels import free_around
from navstack.sim._polygon_kernels import polygon_contains

RELAXATION = 0.5  # s
OTHERS = 2.1  # m²/s²
OTHERS_REACH = 0.3  # m
OTHERS_STEP = 2.0  # s
WALLS = 10.0  # m²/s²
WALLS_REACH = 0.2  # m
SIGHT = math.cos(math.radians(100.0))
BEHIND = 0.5
HURRY = 1.3
# of a person, m: how near the centres of two come is meant between such
BODY = 0.25
# walls further away push less than 0.03 m/s²; others likewise
WALLS_SEEN = 1.5
OTHERS_SEEN = 5.0

# layout of a row of the people's state
PX, PY, PVX, PVY, GOAL, PAUSE = 0, 1, 2, 3, 4, 5


@kernel
def nearest_wall(squares, grid, x, y, reach):
    """Distance (m) from the point to the nearest occupied cell, and that place (m); inf beyond `reach` (m)."""
    _, ny, nx = squares.shape
    resolution = grid[3]
    c, s = math.cos(grid[2]), math.sin(grid[2])
    gx = (c * (x - grid[0]) + s * (y - grid[1])) / resolution
    gy = (c * (y - grid[1]) - s * (x - grid[0])) / resolution
    best = reach / resolution
    found = False
    px, py = 0.0, 0.0
    ix, iy = math.floor(gx), math.floor(gy)
    ring = free_around(squares, ix, iy) + 1 if 0 <= ix < nx and 0 <= iy < ny else 0
    while ring - 1 <= best:
        for row in range(max(iy - ring, 0), min(iy + ring, ny - 1) + 1):
            whole = row == iy - ring or row == iy + ring
            for column in range(ix - ring, ix + ring + 1, 1 if whole else max(2 * ring, 1)):
                if 0 <= column < nx and squares[0, row, column] == 0:
                    qx, qy = min(max(gx, float(column)), column + 1.0), min(max(gy, float(row)), row + 1.0)
                    away = math.hypot(gx - qx, gy - qy)
                    if away < best:
                        best, px, py, found = away, qx, qy, True
        ring += 1
    if not found:
        return math.inf, 0.0, 0.0
    u, v = px * resolution, py * resolution
    return best * resolution, grid[0] + c * u - s * v, grid[1] + s * u + c * v


@kernel
def nearest_on_polygon(polygon, x, y):
    """Distance (m) from the point to the border of the polygon (n, 2), below 0 inside; and that place."""
    best, px, py = math.inf, 0.0, 0.0
    j = polygon.shape[0] - 1
    for i in range(polygon.shape[0]):
        ex, ey = polygon[i, 0] - polygon[j, 0], polygon[i, 1] - polygon[j, 1]
        length2 = ex * ex + ey * ey
        t = ((x - polygon[j, 0]) * ex + (y - polygon[j, 1]) * ey) / length2 if length2 > 0.0 else 0.0
        t = min(max(t, 0.0), 1.0)
        qx, qy = polygon[j, 0] + t * ex, polygon[j, 1] + t * ey
        away = math.hypot(x - qx, y - qy)
        if away < best:
            best, px, py = away, qx, qy
        j = i
    return -best if polygon_contains(polygon, x, y) else best, px, py


@kernel
def push_from_wall(away, wx, wy, x, y):
    """Acceleration (m/s²) away from a wall whose nearest place is (wx, wy), `away` (m) off (equation 5)."""
    if away >= WALLS_SEEN or away == 0.0:
        return 0.0, 0.0
    push = WALLS / WALLS_REACH * math.exp(-max(away, 0.0) / WALLS_REACH)
    return push * (x - wx) / away, push * (y - wy) / away


@kernel
def push_from_other(rx, ry, vx, vy, extra):
    """Acceleration (m/s²) away from somebody who walks at (vx, vy), where (rx, ry) leads from him here (equations 3 and 4).

    `extra` (m): how much bigger than a person's his body is. The potential's lines are ellipses that reach as far ahead of
    him as his next step.
    """
    away = math.hypot(rx, ry)
    if away > OTHERS_SEEN + extra or away == 0.0:
        return 0.0, 0.0
    near = max(away - extra, 0.01)
    rx, ry = rx * near / away, ry * near / away
    sx, sy = vx * OTHERS_STEP, vy * OTHERS_STEP
    yx, yy = rx - sx, ry - sy
    ahead = math.hypot(yx, yy)
    b = 0.5 * math.sqrt(max((near + ahead) ** 2 - sx * sx - sy * sy, 1e-6))
    push = OTHERS / OTHERS_REACH * math.exp(-b / OTHERS_REACH) * (near + ahead) / (4.0 * b)
    fx, fy = rx / near, ry / near
    if ahead > 0.0:
        fx, fy = fx + yx / ahead, fy + yy / ahead
    return push * fx, push * fy


@kernel
def room_for(x, y, squares, grid, solids):
    """Distance (m) from the point to the nearest wall or solid."""
    room, _, _ = nearest_wall(squares, grid, x, y, WALLS_SEEN)
    for k in range(solids.discs.shape[0]):
        room = min(room, math.hypot(x - solids.discs[k, 0], y - solids.discs[k, 1]) - solids.discs[k, 2])
    for k in range(solids.circles.shape[0]):
        if math.hypot(x - solids.circles[k, 0], y - solids.circles[k, 1]) - solids.circles[k, 2] < room:
            away, _, _ = nearest_on_polygon(solids.corners[solids.first[k] : solids.first[k + 1]], x, y)
            room = min(room, away)
    return room


@kernel
def step_crowd(
    people, speeds, bodies, notices, goal_radii, pauses, goals, first_goal, squares, grid, solids, robot, sway, dt
):
    """Moves the people (n, 6) on by `dt` (s).

    `robot` = [x, y, vx, vy, radius] in the map; `sway` (n, 2) accelerations (m/s²) that have no reason; `goals` of person k
    are `first_goal[k]` .. `first_goal[k + 1] - 1`. Whoever would come nearer than his body allows to a wall, a solid or, if
    he notices it, the robot, slides along it, or stays.
    """
    n = people.shape[0]
    before = people.copy()
    for k in range(n):
        x, y, vx, vy = before[k, PX], before[k, PY], before[k, PVX], before[k, PVY]
        goal = first_goal[k] + int(before[k, GOAL])
        gx, gy = goals[goal, 0] - x, goals[goal, 1] - y
        left = math.hypot(gx, gy)
        ex, ey = 0.0, 0.0
        if before[k, PAUSE] > 0.0:
            people[k, PAUSE] = max(before[k, PAUSE] - dt, 0.0)
        elif left <= goal_radii[k]:
            people[k, GOAL] = (before[k, GOAL] + 1.0) % (first_goal[k + 1] - first_goal[k])
            people[k, PAUSE] = pauses[k]
        else:
            ex, ey = gx / left, gy / left
        ax, ay = (speeds[k] * ex - vx) / RELAXATION + sway[k, 0], (speeds[k] * ey - vy) / RELAXATION + sway[k, 1]
        for j in range(n + 1):
            if j == k or (j == n and not notices[k]):
                continue
            if j < n:
                fx, fy = push_from_other(
                    x - before[j, PX],
                    y - before[j, PY],
                    before[j, PVX],
                    before[j, PVY],
                    bodies[j] + bodies[k] - 2.0 * BODY,
                )
            else:
                fx, fy = push_from_other(
                    x - robot[0], y - robot[1], robot[2], robot[3], robot[4] + bodies[k] - 2.0 * BODY
                )
            # who is looked at pushes in full
            if -(ex * fx + ey * fy) < SIGHT * math.hypot(fx, fy):
                fx, fy = BEHIND * fx, BEHIND * fy
            ax, ay = ax + fx, ay + fy
        away, wx, wy = nearest_wall(squares, grid, x, y, WALLS_SEEN)
        fx, fy = push_from_wall(away, wx, wy, x, y)
        ax, ay = ax + fx, ay + fy
        room, nearest_x, nearest_y = away, wx, wy
        for j in range(solids.discs.shape[0]):
            rx, ry = x - solids.discs[j, 0], y - solids.discs[j, 1]
            centre = math.hypot(rx, ry)
            away = centre - solids.discs[j, 2]
            if away < WALLS_SEEN and centre > 0.0:
                wx, wy = x - rx / centre * away, y - ry / centre * away
                fx, fy = push_from_wall(away, wx, wy, x, y)
                ax, ay = ax + fx, ay + fy
                if away < room:
                    room, nearest_x, nearest_y = away, wx, wy
        for j in range(solids.circles.shape[0]):
            if math.hypot(x - solids.circles[j, 0], y - solids.circles[j, 1]) - solids.circles[j, 2] < WALLS_SEEN:
                away, wx, wy = nearest_on_polygon(solids.corners[solids.first[j] : solids.first[j + 1]], x, y)
                fx, fy = push_from_wall(away, wx, wy, x, y)
                ax, ay = ax + fx, ay + fy
                if away < room:
                    room, nearest_x, nearest_y = away, wx, wy
        vx, vy = vx + dt * ax, vy + dt * ay
        speed = math.hypot(vx, vy)
        if speed > HURRY * speeds[k]:
            vx, vy = vx * HURRY * speeds[k] / speed, vy * HURRY * speeds[k] / speed
        for attempt in range(2):
            nx, ny = x + dt * vx, y + dt * vy
            held = False
            if room - math.hypot(nx - x, ny - y) < bodies[k]:
                there = room_for(nx, ny, squares, grid, solids)
                held = there < bodies[k] and there < room
            apart = bodies[k] + robot[4]
            there = math.hypot(nx - robot[0], ny - robot[1])
            by_robot = notices[k] and there < apart and there < math.hypot(x - robot[0], y - robot[1])
            if not held and not by_robot:
                break
            if attempt == 1:
                vx, vy = 0.0, 0.0
                nx, ny = x, y
                break
            # the part towards it is lost
            dx, dy = (nearest_x - x, nearest_y - y) if held else (robot[0] - x, robot[1] - y)
            size = math.hypot(dx, dy)
            into = (vx * dx + vy * dy) / (size * size) if size > 0.0 else 0.0
            if into > 0.0:
                vx, vy = vx - into * dx, vy - into * dy
        people[k, PX], people[k, PY], people[k, PVX], people[k, PVY] = nx, ny, vx, vy
