"""Pedestrians in a simulated world, by social forces or ORCA; the same for the same seed and the same robot motion."""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import kernel
from navstack.sim.map_cells import free_around
from navstack.sim.orca import avoiding_velocity, reciprocal_plane
from navstack.sim.shapes import PedestrianMotion, Shape
from navstack.sim.solids import Solids, polygon_contains, solids_from_discs

# --- social forces ----------------------------------------------------------------------------------------------------
# Source: D. Helbing, P. Molnár, "Social force model for pedestrian dynamics", Phys. Rev. E 51, 4282 (1995), equations 2 to 9
# and its parameters: relaxation 0.5 s; other pedestrians V0 = 2.1 m²/s², sigma = 0.3 m, step of 2 s; walls U0 = 10 m²/s²,
# R = 0.2 m; forces from more than 100 degrees off the walking direction count half; the maximum speed is 1.3 times the
# desired one.


RELAXATION = 0.5  # s
OTHERS = 2.1  # m²/s²
OTHERS_REACH = 0.3  # m
OTHERS_STEP = 2.0  # s
WALLS = 10.0  # m²/s²
WALLS_REACH = 0.2  # m
SIGHT = math.cos(math.radians(100.0))
BEHIND = 0.5
HURRY = 1.3
# radius of the pedestrians in the model, m: its distances are between the centers of two of them
BODY = 0.25
# beyond these distances (m) the force is below 0.03 m/s²
WALLS_SEEN = 1.5
OTHERS_SEEN = 5.0
# what a distance may be off by rounding, m
ROUNDING = 1e-9
# groups: M. Moussaïd et al., PLoS ONE 5 e10047 (2010), equations 3 to 5; the strengths are those of HuNavSim, m/s² (the first one
# per m/s and rad)
GAZE = 3.0
COHERENCE = 2.0
REPULSION = 1.0
FIELD_OF_VIEW = 0.5 * math.pi

PERSON = np.dtype(
    [
        ("x", "f8"),  # position in the map, m
        ("y", "f8"),
        ("vx", "f8"),  # velocity in the map, m/s
        ("vy", "f8"),
        ("goal", "i8"),  # index of the current goal
        ("pause", "f8"),  # seconds left at it
        ("clock", "f8"),  # time since the start, s
        ("walked", "f8"),  # length of the path, m
        ("arrivals", "i8"),  # goals reached, one after another
        ("first_arrival", "f8"),  # time of the first of them, s; inf before it
        ("last_arrival", "f8"),  # time of the last counted one, s
        ("walked_then", "f8"),  # length of the path until then, m
        ("counted", "i8"),  # arrivals that are counted; later ones change nothing
    ],
    align=True,
)
"""Element type of the pedestrians' state."""

PEDESTRIAN = np.dtype(
    [
        ("speed", "f8"),  # desired speed, m/s
        ("radius", "f8"),  # m
        ("goal_radius", "f8"),  # distance at which a goal is reached, m
        ("pause", "f8"),  # at each goal, s
        ("first_goal", "i8"),  # index of the first goal
        ("goals", "i8"),  # number of goals
        ("notices_robot", "?"),
        ("orca", "?"),  # else social forces
        ("group", "i8"),  # -1 without one
        ("neighbor_distance", "f8"),  # ORCA: of others that are avoided, m
        ("max_neighbors", "i8"),
        ("time_horizon", "f8"),  # s
        ("time_horizon_obstacles", "f8"),  # s
    ],
    align=True,
)
"""Element type of the pedestrians' settings."""


@kernel
def nearest_wall(squares, grid, x, y, reach):
    """Distance (m) from the point to the nearest occupied cell, and the nearest point (m); inf beyond `reach` (m)."""
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
    """Distance (m) from the point to the border of the polygon (n, 2), negative inside; and the nearest point."""
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
    """Acceleration (m/s²) away from a wall whose nearest point is (wx, wy), at the distance `away` (m) (equation 5)."""
    if away >= WALLS_SEEN or away == 0.0:
        return 0.0, 0.0
    push = WALLS / WALLS_REACH * math.exp(-max(away, 0.0) / WALLS_REACH)
    return push * (x - wx) / away, push * (y - wy) / away


PUSHES: Final = 9
"""Rows of the scratch memory of `pushes_from_others`."""


@kernel
def pushes_from_others(pairs, count):
    """Accelerations (m/s²) away from pedestrians (equations 3 and 4), one in each of the first `count` columns of `pairs`.

    Rows 0 and 1: (rx, ry), the way from the pedestrian to here (m); 2 and 3: its velocity (m/s); 4: the excess of the two radii
    over those of the model (m). Rows 0 and 1 become the acceleration, the others are scratch. The equipotential lines are
    ellipses that extend ahead of the pedestrian by the length of the next step.
    """
    number = np.uint64(count)
    # without branches and exponentials, so that the loop is vectorized: the roots and quotients take most of the time
    for i in range(number):
        rx, ry, extra = pairs[0, i], pairs[1, i], pairs[4, i]
        away = math.sqrt(rx * rx + ry * ry)
        near = away - extra
        near = near if near > 0.01 else 0.01
        rx, ry = rx * near / away, ry * near / away
        sx, sy = pairs[2, i] * OTHERS_STEP, pairs[3, i] * OTHERS_STEP
        yx, yy = rx - sx, ry - sy
        ahead = math.sqrt(yx * yx + yy * yy)
        squared = (near + ahead) ** 2 - sx * sx - sy * sy
        b = 0.5 * math.sqrt(squared if squared > 1e-6 else 1e-6)
        fx, fy = rx / near, ry / near
        pairs[0, i] = fx + yx / ahead if ahead > 0.0 else fx
        pairs[1, i] = fy + yy / ahead if ahead > 0.0 else fy
        pairs[5, i], pairs[6, i], pairs[7, i] = -b / OTHERS_REACH, near + ahead, 4.0 * b
        pairs[8, i] = 1.0 if (away <= OTHERS_SEEN + extra) & (away > 0.0) else 0.0
    for i in range(number):
        if pairs[8, i] > 0.0:
            push = OTHERS / OTHERS_REACH * math.exp(pairs[5, i]) * pairs[6, i] / pairs[7, i]
            pairs[0, i], pairs[1, i] = push * pairs[0, i], push * pairs[1, i]
        else:
            pairs[0, i], pairs[1, i] = 0.0, 0.0


@kernel
def distance_to_obstacle(x, y, squares, grid, solids):
    """Distance (m) from the point to the nearest wall or solid."""
    nearest, _, _ = nearest_wall(squares, grid, x, y, WALLS_SEEN)
    for k in range(solids.discs.shape[0]):
        away = math.hypot(x - solids.discs[k, 0], y - solids.discs[k, 1]) - solids.discs[k, 2]
        if away < nearest:  # not of one that is absent
            nearest = away
    for k in range(solids.circles.shape[0]):
        if math.hypot(x - solids.circles[k, 0], y - solids.circles[k, 1]) - solids.circles[k, 2] < nearest:
            away, _, _ = nearest_on_polygon(solids.corners[solids.first[k] : solids.first[k + 1]], x, y)
            nearest = min(nearest, away)
    return nearest


@kernel
def head_for_goal(people, k, settings, goals, dt):
    """Unit vector towards the goal of person `k`, (0, 0) while pausing or when it is reached; updates goal and pause."""
    goal = settings.first_goal + people[k].goal
    gx, gy = goals[goal, 0] - people[k].x, goals[goal, 1] - people[k].y
    left = math.hypot(gx, gy)
    if people[k].pause > 0.0:
        people[k].pause = max(people[k].pause - dt, 0.0)
    elif left <= settings.goal_radius:
        if people[k].arrivals < people[k].counted and (settings.goals > 1 or people[k].arrivals == 0):
            people[k].arrivals += 1
            people[k].first_arrival = min(people[k].first_arrival, people[k].clock)
            people[k].last_arrival, people[k].walked_then = people[k].clock, people[k].walked
        people[k].goal = (people[k].goal + 1) % settings.goals
        people[k].pause = settings.pause
    else:
        return gx / left, gy / left
    return 0.0, 0.0


@kernel
def people_within(xs, ys, x, y, reach, near):
    """Writes the numbers of the people at (xs, ys) (n,) within `reach` (m) of the point to `near` (n,), ascending; their count.

    Without a branch, that takes less than a nanosecond a person, where the force of a person takes many: cell lists would save
    little below a thousand people, and they would lose the order in which the forces are added.
    """
    count = np.uint64(0)
    for j in range(np.uint64(xs.shape[0])):
        dx, dy = xs[j] - x, ys[j] - y
        near[count] = j
        count += np.uint64(dx * dx + dy * dy <= reach * reach)
    return np.int64(count)


@kernel
def weight_of_force(fx, fy, ex, ey):
    """Share of a force of someone else that counts: half if it comes from behind, for the walking direction (ex, ey)."""
    along = ex * fx + ey * fy
    squared, border = along * along, SIGHT * SIGHT * (fx * fx + fy * fy)
    behind = (along > 0.0) & (squared > border)
    if abs(squared - border) <= 1e-12 * border:  # only then can rounding matter
        behind = -along < SIGHT * math.hypot(fx, fy)
    return BEHIND if behind else 1.0


@kernel
def add_social_forces(before, settings, k, near, count, ex, ey, robot, pairs, ax, ay):
    """Adds the forces of the people `near[:count]`, and of the robot if it is noticed, to the acceleration of person `k`.

    `pairs` (PUSHES, count + 1) is scratch.
    """
    x, y, radius = before[k].x, before[k].y, settings[k].radius
    number = 0
    for i in range(count):
        j = near[i]
        if j != k:
            pairs[0, number], pairs[1, number] = x - before[j].x, y - before[j].y
            pairs[2, number], pairs[3, number] = before[j].vx, before[j].vy
            pairs[4, number] = settings[j].radius + radius - 2.0 * BODY
            number += 1
    if settings[k].notices_robot:
        pairs[0, number], pairs[1, number] = x - robot[0], y - robot[1]
        pairs[2, number], pairs[3, number] = robot[2], robot[3]
        pairs[4, number] = robot[4] + radius - 2.0 * BODY
        number += 1
    pushes_from_others(pairs, number)
    for i in range(number):
        fx, fy = pairs[0, i], pairs[1, i]
        weight = weight_of_force(fx, fy, ex, ey)
        ax, ay = ax + weight * fx, ay + weight * fy
    return ax, ay


@kernel
def add_obstacle_forces(x, y, squares, grid, solids, ax, ay):
    """Adds the forces of walls and solids to the acceleration; returns it, the smallest distance (m) and its point."""
    away, wx, wy = nearest_wall(squares, grid, x, y, WALLS_SEEN)
    fx, fy = push_from_wall(away, wx, wy, x, y)
    ax, ay = ax + fx, ay + fy
    nearest, nearest_x, nearest_y = away, wx, wy
    for j in range(solids.discs.shape[0]):
        rx, ry = x - solids.discs[j, 0], y - solids.discs[j, 1]
        center = math.hypot(rx, ry)
        away = center - solids.discs[j, 2]
        if away < WALLS_SEEN and center > 0.0:
            wx, wy = x - rx / center * away, y - ry / center * away
            fx, fy = push_from_wall(away, wx, wy, x, y)
            ax, ay = ax + fx, ay + fy
            if away < nearest:
                nearest, nearest_x, nearest_y = away, wx, wy
    for j in range(solids.circles.shape[0]):
        if math.hypot(x - solids.circles[j, 0], y - solids.circles[j, 1]) - solids.circles[j, 2] < WALLS_SEEN:
            away, wx, wy = nearest_on_polygon(solids.corners[solids.first[j] : solids.first[j + 1]], x, y)
            fx, fy = push_from_wall(away, wx, wy, x, y)
            ax, ay = ax + fx, ay + fy
            if away < nearest:
                nearest, nearest_x, nearest_y = away, wx, wy
    return ax, ay, nearest, nearest_x, nearest_y


@kernel
def add_group_forces(before, settings, k, ax, ay):
    """Adds the forces that keep person `k` with its group: to see the others, to stay with them, and not to touch them.

    The head turns until the others' center is at the border of the field of view; turning it slows down in proportion.
    """
    x, y, vx, vy = before[k].x, before[k].y, before[k].vx, before[k].vy
    members, sx, sy = 0, 0.0, 0.0
    for j in range(before.shape[0]):
        if j != k and settings[j].group == settings[k].group:
            members += 1
            sx, sy = sx + before[j].x, sy + before[j].y
            away = math.hypot(x - before[j].x, y - before[j].y)
            if 0.0 < away < settings[j].radius + settings[k].radius:
                ax, ay = ax + REPULSION * (x - before[j].x) / away, ay + REPULSION * (y - before[j].y) / away
    if members == 0:
        return ax, ay
    cx, cy = sx / members - x, sy / members - y
    angle = abs(math.atan2(vx * cy - vy * cx, vx * cx + vy * cy))
    turned = max(angle - FIELD_OF_VIEW, 0.0)
    ax, ay = ax - GAZE * turned * vx, ay - GAZE * turned * vy
    # the center of all of the group, and how far from it they walk: half of a meter for each of the others
    cx, cy = cx * members / (members + 1.0), cy * members / (members + 1.0)
    away = math.hypot(cx, cy)
    if away > 0.5 * members:
        ax, ay = ax + COHERENCE * cx / away, ay + COHERENCE * cy / away
    return ax, ay


@kernel
def add_wall_planes(x, y, own, squares, grid, solids, planes):
    """Writes the half-planes of the walls and solids in sight to `planes`; returns their number.

    Towards the nearest point of each, the speed is at most the distance to it divided by the time horizon.
    """
    away, wx, wy = nearest_wall(squares, grid, x, y, WALLS_SEEN)
    count = 0
    discs = solids.discs.shape[0]
    for j in range(-1, discs + solids.circles.shape[0]):
        if 0 <= j < discs:
            cx, cy = x - solids.discs[j, 0], y - solids.discs[j, 1]
            center = math.hypot(cx, cy)
            away = center - solids.discs[j, 2]
            if away >= WALLS_SEEN or center == 0.0:
                continue
            wx, wy = x - cx / center * away, y - cy / center * away
        elif j >= discs:
            i = j - discs
            if math.hypot(x - solids.circles[i, 0], y - solids.circles[i, 1]) - solids.circles[i, 2] >= WALLS_SEEN:
                continue
            away, wx, wy = nearest_on_polygon(solids.corners[solids.first[i] : solids.first[i + 1]], x, y)
        if away < WALLS_SEEN and away != 0.0:
            planes[count, 0], planes[count, 1] = (x - wx) / away, (y - wy) / away
            planes[count, 2] = (own.radius - away) / own.time_horizon_obstacles
            count += 1
    return count


@kernel
def add_person_planes(before, settings, k, near, number, robot, dt, planes, count):
    """Writes the half-planes of the nearest of the people `near[:number]`, and of a noticed robot, to `planes`; their count.

    The robot is expected to keep its velocity: the whole change is left to the person. Sorts `near`.
    """
    own = settings[k]
    x, y, vx, vy = before[k].x, before[k].y, before[k].vx, before[k].vy
    taken = 0
    for i in range(number):
        j = near[i]
        if j == k:
            continue
        away2 = (before[j].x - x) ** 2 + (before[j].y - y) ** 2
        # insertion among the nearest ones so far
        at = taken
        while at > 0 and away2 < (before[near[at - 1]].x - x) ** 2 + (before[near[at - 1]].y - y) ** 2:
            at -= 1
        if at == own.max_neighbors:
            continue
        taken = min(taken + 1, own.max_neighbors)
        for m in range(taken - 1, at, -1):
            near[m] = near[m - 1]
        near[at] = j
    for i in range(taken):
        other = before[near[i]]
        nx, ny, offset = reciprocal_plane(
            other.x - x,
            other.y - y,
            vx,
            vy,
            other.vx,
            other.vy,
            own.radius + settings[near[i]].radius,
            own.time_horizon,
            dt,
            0.5,
        )
        planes[count, 0], planes[count, 1], planes[count, 2] = nx, ny, offset
        count += 1
    if own.notices_robot and math.hypot(robot[0] - x, robot[1] - y) < own.neighbor_distance:
        nx, ny, offset = reciprocal_plane(
            robot[0] - x, robot[1] - y, vx, vy, robot[2], robot[3], own.radius + robot[4], own.time_horizon, dt, 1.0
        )
        planes[count, 0], planes[count, 1], planes[count, 2] = nx, ny, offset
        count += 1
    return count


@kernel
def remove_approach(vx, vy, dx, dy):
    """Removes the component of the velocity towards (dx, dy)."""
    size = math.hypot(dx, dy)
    into = (vx * dx + vy * dy) / (size * size) if size > 0.0 else 0.0
    if into > 0.0:
        vx, vy = vx - into * dx, vy - into * dy
    return vx, vy


@kernel
def group_forces(people, settings, out):
    """Writes the acceleration (n, 2) (m/s²) of each person by its group, 0 without one."""
    for k in range(people.shape[0]):
        out[k, 0], out[k, 1] = 0.0, 0.0
        if settings[k].group >= 0:
            out[k, 0], out[k, 1] = add_group_forces(people, settings, k, 0.0, 0.0)


@kernel
def orca_velocities(people, settings, goals, squares, grid, solids, robot, push, dt, out):
    """Writes the velocity (n, 2) (m/s) that each person by ORCA takes for the next step; arguments as of `step_crowd`."""
    n = people.shape[0]
    xs, ys, near = np.empty(n), np.empty(n), np.empty(n + 1, np.int64)
    for k in range(n):
        xs[k], ys[k] = people[k].x, people[k].y
    rows = 2 + n + solids.discs.shape[0] + solids.circles.shape[0]
    planes, scratch = np.empty((rows, 3)), np.empty((rows, 3))
    for k in range(n):
        own = settings[k]
        if not own.orca:
            continue
        x, y = people[k].x, people[k].y
        goal = own.first_goal + people[k].goal
        gx, gy = goals[goal, 0] - x, goals[goal, 1] - y
        left = math.hypot(gx, gy)
        px, py = 0.0, 0.0
        if people[k].pause <= 0.0 and left > own.goal_radius:
            px, py = own.speed * gx / left, own.speed * gy / left
        px, py = px + push[k, 0], py + push[k, 1]
        walls = add_wall_planes(x, y, own, squares, grid, solids, planes)
        number = people_within(xs, ys, x, y, own.neighbor_distance, near)
        count = add_person_planes(people, settings, k, near, number, robot, dt, planes, walls)
        out[k, 0], out[k, 1] = avoiding_velocity(planes, count, walls, px, py, own.speed, scratch)


@kernel
def step_crowd(people, settings, goals, squares, grid, solids, robot, sway, dt, chosen):
    """Moves the people (n,) of type `PERSON` by one step of `dt` (s).

    `settings` (n,) of type `PEDESTRIAN`; `goals` (g, 2) of all people (m); `robot` = [x, y, vx, vy, radius] in the map; `sway`
    (n, 2) further accelerations (m/s²); `chosen` (n, 2) velocities of those by ORCA (m/s), (0, 2) without any. A person whose
    next position is closer to a wall, a solid or a noticed robot than the radii allow slides along it, or stops.
    """
    n = people.shape[0]
    before = people.copy()
    xs, ys, near = np.empty(n), np.empty(n), np.empty(n + 1, np.int64)
    pairs = np.empty((PUSHES, n + 1))
    largest = 0.0
    for k in range(n):
        xs[k], ys[k], largest = before[k].x, before[k].y, max(largest, settings[k].radius)
    for k in range(n):
        own = settings[k]
        x, y, vx, vy = before[k].x, before[k].y, before[k].vx, before[k].vy
        ex, ey = head_for_goal(people, k, own, goals, dt)
        ax, ay = (own.speed * ex - vx) / RELAXATION + sway[k, 0], (own.speed * ey - vy) / RELAXATION + sway[k, 1]
        if not own.orca:
            reach = OTHERS_SEEN + largest + own.radius - 2.0 * BODY + ROUNDING
            number = people_within(xs, ys, x, y, reach, near)
            ax, ay = add_social_forces(before, settings, k, near, number, ex, ey, robot, pairs, ax, ay)
        ax, ay, nearest, nearest_x, nearest_y = add_obstacle_forces(x, y, squares, grid, solids, ax, ay)
        if own.orca:
            vx, vy = chosen[k, 0], chosen[k, 1]
        else:
            vx, vy = vx + dt * ax, vy + dt * ay
            speed = math.hypot(vx, vy)
            if speed > HURRY * own.speed:
                vx, vy = vx * HURRY * own.speed / speed, vy * HURRY * own.speed / speed
        nx, ny = x, y
        for attempt in range(2):
            nx, ny = x + dt * vx, y + dt * vy
            blocked = False
            if nearest - math.hypot(nx - x, ny - y) < own.radius:
                there = distance_to_obstacle(nx, ny, squares, grid, solids)
                blocked = there < own.radius and there < nearest
            there = math.hypot(nx - robot[0], ny - robot[1])
            by_robot = (
                own.notices_robot and there < own.radius + robot[4] and there < math.hypot(x - robot[0], y - robot[1])
            )
            if not blocked and not by_robot:
                break
            if attempt == 1:
                vx, vy = 0.0, 0.0
                nx, ny = x, y
                break
            dx, dy = (nearest_x - x, nearest_y - y) if blocked else (robot[0] - x, robot[1] - y)
            vx, vy = remove_approach(vx, vy, dx, dy)
        people[k].x, people[k].y, people[k].vx, people[k].vy = nx, ny, vx, vy
        people[k].clock += dt
        people[k].walked += math.hypot(nx - x, ny - y)


DESIRED_SPEED: Final = (1.34, 0.26)
"""Mean and standard deviation of the desired speed (m/s), after Helbing and Molnár."""
MIN_DESIRED_SPEED: Final = 0.5
"""Lower limit of random desired speeds (m/s)."""
SWAY: Final = 0.1
"""Standard deviation of random accelerations (m/s² over one second); they resolve deadlocks."""
MAX_STEP: Final = 0.05
"""Longer simulation steps are divided into equal steps of at most this length (s)."""


_NOBODY: Final = np.empty((0, 2))


class Crowd:
    """The pedestrians of a world during one run; their motion depends on the robot's."""

    def __init__(self, shapes: Sequence[Shape], seed: int, before: Crowd | None = None) -> None:
        """`shapes`: discs with the motion of a pedestrian. Those that are also in the crowd `before` continue from there."""
        people = [(shape, shape.motion) for shape in shapes if isinstance(shape.motion, PedestrianMotion)]
        self._shapes = [shape for shape, _ in people]
        self._rng = np.random.Generator(np.random.PCG64([seed, 1 << 20])) if before is None else before._rng
        drawn = DESIRED_SPEED[0] + DESIRED_SPEED[1] * self._rng.standard_normal(len(people))
        self._settings = np.zeros(len(people), PEDESTRIAN)
        self._settings["speed"] = [
            max(speed, MIN_DESIRED_SPEED) if motion.speed is None else motion.speed
            for (_, motion), speed in zip(people, drawn.tolist(), strict=True)
        ]
        self._settings["radius"] = [shape.radius for shape, _ in people]
        self._settings["notices_robot"] = [motion.notices_robot for _, motion in people]
        self._settings["goal_radius"] = [motion.goal_radius for _, motion in people]
        self._settings["pause"] = [motion.pause for _, motion in people]
        self._settings["orca"] = [motion.model == "orca" for _, motion in people]
        groups = sorted({motion.group for _, motion in people} - {""})
        self._settings["group"] = [groups.index(motion.group) if motion.group else -1 for _, motion in people]
        for name in ("neighbor_distance", "max_neighbors", "time_horizon", "time_horizon_obstacles"):
            self._settings[name] = [getattr(motion, name) for _, motion in people]
        counts = np.array([len(motion.goals) for _, motion in people], np.int64)
        self._settings["goals"] = counts
        self._settings["first_goal"] = np.cumsum(counts) - counts
        self._goals = np.array([goal for _, motion in people for goal in motion.goals], np.float64).reshape(-1, 2)
        self._tops = np.array([shape.top for shape, _ in people])
        self._people = np.zeros(len(people), PERSON)
        self._people["x"] = [shape.pose[0] for shape, _ in people]
        self._people["y"] = [shape.pose[1] for shape, _ in people]
        self._people["first_arrival"] = math.inf
        self._people["counted"] = np.iinfo(np.int64).max
        self._has_orca = bool(self._settings["orca"].any())
        self._has_groups = bool((self._settings["group"] >= 0).any())
        self.is_original = before is None
        """True unless pedestrians were added or removed since the start."""
        if before is not None:
            self._continue(before)

    def _continue(self, before: Crowd) -> None:
        """Copies the state and the speed of the pedestrians that are in both crowds."""
        old = list(before._shapes)
        for row, shape in enumerate(self._shapes):
            if shape in old:
                was = old.index(shape)
                self._people[row] = before._people[was]
                self._settings["speed"][row] = before._settings["speed"][was]

    @property
    def velocities(self) -> NDArray[np.float64]:
        """(n, 2) velocities in the map (m/s)."""
        return np.column_stack((self._people["vx"], self._people["vy"]))

    @property
    def groups(self) -> NDArray[np.int32]:
        """(n,) number of each pedestrian's group, -1 without one."""
        return self._settings["group"].astype(np.int32)

    @property
    def first_arrivals(self) -> NDArray[np.float64]:
        """(n,) time at which each reached its first goal (s), inf before."""
        return self._people["first_arrival"].copy()

    @property
    def arrivals(self) -> NDArray[np.int64]:
        """(n,) number of goals that each has reached."""
        return self._people["arrivals"].copy()

    @property
    def notice_robot(self) -> bool:
        """True if any pedestrian notices the robot."""
        return bool(self._settings["notices_robot"].any())

    def count_arrivals(self, number: NDArray[np.int64]) -> None:
        """Counts at most `number` (n,) arrivals of each from now on."""
        self._people["counted"] = number

    def delays(self, others: Crowd) -> NDArray[np.float64]:
        """(n, 2) how much longer each took to its last goal than in `others`: time (s), path (m); NaN if one of them has not."""
        own, other = self._people, others._people
        delays = np.column_stack([own[name] - other[name] for name in ("last_arrival", "walked_then")])
        delays[(own["arrivals"] == 0) | (own["arrivals"] != other["arrivals"])] = math.nan
        return delays

    def solids(self) -> Solids:
        """Returns the pedestrians as discs at the current time."""
        return solids_from_discs(
            np.column_stack((self._people["x"], self._people["y"], self._settings["radius"])), self._tops
        )

    def step(
        self,
        dt: float,
        squares: NDArray[np.uint8],
        grid: NDArray[np.float64],
        solids: Solids,
        robot: NDArray[np.float64],
    ) -> None:
        """Advances by `dt` (s) among the map's walls (`World.squares`, `World.grid`) and `solids`.

        `robot` = [x, y, vx, vy, radius] in the map (m, m/s).
        """
        parts = max(1, math.ceil(dt / MAX_STEP - 1e-9))
        for _ in range(parts):
            sway = self._rng.standard_normal((len(self._people), 2)) * (SWAY / math.sqrt(dt / parts))
            state = self._people, self._settings, self._goals, squares, grid, solids.geometry, robot
            pull = _NOBODY
            if self._has_groups:
                pull = np.empty_like(sway)
                group_forces(self._people, self._settings, pull)
            chosen = _NOBODY
            if self._has_orca:
                chosen = np.zeros_like(sway)
                push = dt / parts * sway + RELAXATION * pull if self._has_groups else dt / parts * sway
                orca_velocities(*state, push, dt / parts, chosen)
            step_crowd(*state, sway + pull if self._has_groups else sway, dt / parts, chosen)
