# pyright: basic
"""The body of the robot: velocities, motion, collision. One call drives many physics steps.

Motion over a step of dt at constant (vx, vy, wz): the displacement is taken along the heading at half of the step,
x += dt (vx cos(yaw + wz dt / 2) - vy sin(..)), yaw += wz dt (second-order Runge-Kutta).
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.sim._polygon_kernels import polygon_contains, polygon_to_point, polygons_meet
from navstack.sim.body import BodyModel
from navstack.sim.solids import Solids

# layout of `state`
X, Y, YAW = 0, 1, 2  # truth, map frame
VX, VY, WZ = 3, 4, 5  # of the wheels
LX, LY, LZ = 6, 7, 8  # what the velocity controller has come to under its lag
OX, OY, OYAW = 9, 10, 11  # odometry, odom frame
DISTANCE = 12  # travelled, m
TOUCHING = 13  # 1 from a collision until it is left
CX, CY, CYAW = 14, 15, 16  # pose of that collision
OVERRUN = 17  # 1 while a moving obstacle lies over the robot
GX, GY, GZ = 18, 19, 20  # change of the velocity in the last step: the acceleration
STEER, LSTEER = 21, 22  # steering angle of a car; what its controller has come to under its lag
STATE_SIZE = 23

# no point of the footprint moves further than this between two tests for collision, m
SWEEP_STEP = 0.005
# a collision is left once a point of the footprint is this far from where it was, m
RELEASE = 0.02
# driving along what lies over the robot is not driving into it: more than what rounding makes of the distance, m
TANGENT = 1e-9
# obstacles further away than this from where they were last chosen are not looked at, m
HORIZON = 1.0


@kernel
def segment_meets_square(x0, y0, x1, y1, left, bottom):
    """True when the segment has a point in the unit square with that corner (Liang and Barsky, 1984)."""
    t0, t1 = 0.0, 1.0
    d = x1 - x0
    if d == 0.0:
        if x0 < left or x0 > left + 1.0:
            return False
    else:
        a, b = (left - x0) / d, (left + 1.0 - x0) / d
        t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
    d = y1 - y0
    if d == 0.0:
        if y0 < bottom or y0 > bottom + 1.0:
            return False
    else:
        a, b = (bottom - y0) / d, (bottom + 1.0 - y0) / d
        t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
    return t0 <= t1


@kernel
def free_around(squares, ix, iy):
    """So many cells are free in every direction from the cell, and along both diagonals; -1: it is occupied itself."""
    return int(min(min(squares[0, iy, ix], squares[1, iy, ix]), min(squares[2, iy, ix], squares[3, iy, ix]))) - 1


@kernel
def polygon_on_cells(squares, polygon, cx, cy, radius):
    """Index iy * nx + ix of an occupied cell that the polygon (n, 2) meets, -1 if there is none. All lengths in cells.

    (cx, cy) and `radius` bound the polygon. Exact: a polygon meets a square if one of its edges does or the square's centre
    is inside.
    """
    _, ny, nx = squares.shape
    n = polygon.shape[0]
    # the field at the centre often tells that nothing can be near
    ix, iy = math.floor(cx), math.floor(cy)
    if 0 <= ix < nx and 0 <= iy < ny and free_around(squares, ix, iy) >= radius:
        return -1
    x0, y0 = polygon[0, 0], polygon[0, 1]
    x1, y1 = x0, y0
    for i in range(1, n):
        x0, x1 = min(x0, polygon[i, 0]), max(x1, polygon[i, 0])
        y0, y1 = min(y0, polygon[i, 1]), max(y1, polygon[i, 1])
    # a polygon far outside, or of any size, is clipped to the map before it becomes an integer
    if x1 < 0.0 or y1 < 0.0 or x0 >= nx or y0 >= ny:
        return -1
    first_x, last_x = math.floor(max(x0, 0.0)), math.floor(min(x1, nx - 1.0))
    first_y, last_y = math.floor(max(y0, 0.0)), math.floor(min(y1, ny - 1.0))
    for iy in range(first_y, last_y + 1):
        for ix in range(first_x, last_x + 1):
            if squares[0, iy, ix] != 0:
                continue
            j = n - 1
            for i in range(n):
                if segment_meets_square(
                    polygon[j, 0], polygon[j, 1], polygon[i, 0], polygon[i, 1], float(ix), float(iy)
                ):
                    return iy * nx + ix
                j = i
            if polygon_contains(polygon, ix + 0.5, iy + 0.5):
                return iy * nx + ix
    return -1


@kernel
def choose_solids(solids, x, y, reach, chosen):
    """Writes the numbers of the solids that may come within `reach` (m) of the point; returns how many.

    Discs are counted first, then polygons.
    """
    count = 0
    discs, circles = solids.discs, solids.circles
    for k in range(discs.shape[0]):
        dx, dy, far = discs[k, 0] - x, discs[k, 1] - y, reach + discs[k, 2]
        if dx * dx + dy * dy < far * far:
            chosen[count] = k
            count += 1
    for k in range(circles.shape[0]):
        dx, dy, far = circles[k, 0] - x, circles[k, 1] - y, reach + circles[k, 2]
        if dx * dx + dy * dy < far * far:
            chosen[count] = discs.shape[0] + k
            count += 1
    return count


@kernel
def solid_collision(solids, number, footprint, radius, x, y, c, s, placed):
    """True when the footprint (n, 2), at a pose with cosine c and sine s of its yaw, meets the solid of that number.

    `placed` (n, 2) is scratch.
    """
    discs, circles = solids.discs, solids.circles
    if number < discs.shape[0]:
        dx, dy, r = discs[number, 0] - x, discs[number, 1] - y, discs[number, 2]
        if dx * dx + dy * dy > (radius + r) * (radius + r):
            return False
        return polygon_to_point(footprint, c * dx + s * dy, c * dy - s * dx) < r
    k = number - discs.shape[0]
    dx, dy, r = circles[k, 0] - x, circles[k, 1] - y, circles[k, 2]
    if dx * dx + dy * dy > (radius + r) * (radius + r):
        return False
    for i in range(footprint.shape[0]):
        placed[i, 0] = x + c * footprint[i, 0] - s * footprint[i, 1]
        placed[i, 1] = y + s * footprint[i, 0] + c * footprint[i, 1]
    return polygons_meet(placed, solids.corners[solids.first[k] : solids.first[k + 1]])


@kernel
def find_collision(squares, grid, solids, chosen, count, footprint, radius, x, y, yaw, placed):
    """What the footprint (n, 2) touches at a pose in the map: cell index >= 0, solid -2 - number, or -1 for nothing.

    `placed` (n, 2) is scratch.
    """
    resolution = grid[3]
    c, s = math.cos(grid[2]), math.sin(grid[2])
    gx = (c * (x - grid[0]) + s * (y - grid[1])) / resolution
    gy = (c * (y - grid[1]) - s * (x - grid[0])) / resolution
    c, s = math.cos(yaw - grid[2]), math.sin(yaw - grid[2])
    for i in range(footprint.shape[0]):
        placed[i, 0] = gx + (c * footprint[i, 0] - s * footprint[i, 1]) / resolution
        placed[i, 1] = gy + (s * footprint[i, 0] + c * footprint[i, 1]) / resolution
    cell = polygon_on_cells(squares, placed, gx, gy, radius / resolution)
    if cell >= 0:
        return cell
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(count):
        if solid_collision(solids, chosen[k], footprint, radius, x, y, c, s, placed):
            return -2 - chosen[k]
    return -1


@kernel
def gap_to(solids, number, x, y):
    """Distance (m) from the point to the solid of that number, 0 inside."""
    discs = solids.discs
    if number < discs.shape[0]:
        return max(math.hypot(discs[number, 0] - x, discs[number, 1] - y) - discs[number, 2], 0.0)
    k = number - discs.shape[0]
    return polygon_to_point(solids.corners[solids.first[k] : solids.first[k + 1]], x, y)


@kernel
def wrapped(angle):
    """`angle` (rad), at most a circle off, in (-pi, pi]."""
    if angle > math.pi:
        return angle - 2.0 * math.pi
    if angle <= -math.pi:
        return angle + 2.0 * math.pi
    return angle


@kernel
def jerk_limited(error, last, jerk):
    """The next change of a velocity that is to change by `error` in all, when two changes differ by `jerk` at most.

    The largest change from which the velocity still comes to rest at its goal without overshooting: in units of `jerk`, with
    whole m and 0 <= f < 1, the changes m + f, m - 1 + f, .., f add up to (m + 1) (f + m / 2). Set equal to the error, this
    gives m and f. An acceleration that is still the wrong way is taken back first.
    """
    way = abs(error) / jerk
    m = math.floor(0.5 * (math.sqrt(8.0 * way + 1.0) - 1.0))
    wanted = math.copysign(jerk * (m + way / (m + 1.0) - 0.5 * m), error) if m > 0 else error
    return min(max(wanted, last - jerk), last + jerk)


@kernel
def accelerate(state, command, model):
    """Velocities (and the steering angle) after a step: lag, then the limits of acceleration and jerk."""
    for i in range(3):
        at, lagged = VX + i, LX + i
        if i == 2 and model.wheelbase > 0.0:
            at, lagged = STEER, LSTEER
        state[lagged] = command[i] + model.keep * (state[lagged] - command[i])
        change = state[lagged] - state[at]
        if model.jerks[i] < math.inf:
            change = jerk_limited(change, state[GX + i], model.jerks[i])
        change = min(max(change, -model.limits[i]), model.limits[i])
        state[GX + i] = change
        state[at] += change
    if model.wheelbase > 0.0:
        # the rear axle's centre: the front wheel's direction and the wheelbase give the circle
        state[WZ] = state[VX] * math.tan(state[STEER]) / model.wheelbase


@kernel
def drive(
    state,
    command,
    steps,
    dt,
    limits,
    jerks,
    bias,
    keep,
    wheelbase,
    footprint,
    radius,
    facing,
    noise,
    squares,
    grid,
    discs,
    disc_tops,
    circles,
    corners,
    first,
    polygon_tops,
    moving,
    samples,
    collisions,
):
    """Drives `steps` physics steps of `dt` (s) at `command` [vx, vy, wz]; returns the number of new collisions.

    A car's command is [vx, 0, steering angle]. `state` (STATE_SIZE,) is changed. `limits` .. `facing`: the robot, as
    `BodyModel` has it; `discs` .. `polygon_tops`: the world beside the map, as `Solids`. One by one: numba takes longer to
    find out what a NamedTuple is than to drive ten steps.
    `noise` (steps or 0, 8): relative errors of the true motion vx, vy, wz against the wheels', and of the odometry against
    the wheels'; then what both headings gain for every root of a metre (rad). `moving`: the solids have moved since the last
    call. `samples` (>= steps, 10) receives true pose, odometry pose, velocity after each step, and 1 where the robot is in
    collision; `collisions` (>= 2 steps, 2) int64 the step and what was hit (as `find_collision`).
    """
    model = BodyModel(limits, jerks, bias, keep, wheelbase, footprint, radius, facing)
    solids = Solids(discs, disc_tops, circles, corners, first, polygon_tops)
    hits = 0
    placed = np.empty((footprint.shape[0], 2))
    chosen = np.empty(solids.discs.shape[0] + solids.circles.shape[0], np.int64)
    count = choose_solids(solids, state[X], state[Y], radius + HORIZON, chosen)
    chosen_x, chosen_y = state[X], state[Y]
    over, struck = 0, False
    if moving:
        # what came over the robot stops it; then it may turn, and leave to where it is not: away from each of them
        c, s = math.cos(state[YAW]), math.sin(state[YAW])
        if not math.isnan(facing):
            c, s = math.cos(facing), math.sin(facing)
        # chosen: first those that do not lie over the robot, then `over` that do
        rest = 0
        for k in range(count):
            if not solid_collision(solids, chosen[k], footprint, radius, state[X], state[Y], c, s, placed):
                chosen[rest], chosen[k] = chosen[k], chosen[rest]
                rest += 1
        over, count = count - rest, rest
        struck = over > 0 and state[OVERRUN] == 0.0
        if struck and state[TOUCHING] == 0.0:
            collisions[hits, 0], collisions[hits, 1] = 0, -2 - chosen[rest]
            hits += 1
        state[OVERRUN] = 1.0 if over > 0 else 0.0
    for step in range(steps):
        accelerate(state, command, model)
        mx, my, mz = dt * state[VX], dt * state[VY], dt * state[WZ]
        ox, oy, oz = mx, my, mz
        if noise.shape[0] > 0:
            root = math.sqrt(math.hypot(mx, my))
            mx, my, mz = mx * (1.0 + noise[step, 0]), my * (1.0 + noise[step, 1]), mz * (1.0 + noise[step, 2])
            ox, oy, oz = ox * (1.0 + noise[step, 3]), oy * (1.0 + noise[step, 4]), oz * (1.0 + noise[step, 5])
            mz += root * noise[step, 6]
            oz += root * noise[step, 7]
        if model.bias[0] != 0.0 or model.bias[1] != 0.0:
            oz += model.bias[1] * ox
            ox, oy = ox * (1.0 + model.bias[0]), oy * (1.0 + model.bias[0])
        c, s = math.cos(state[YAW] + 0.5 * mz), math.sin(state[YAW] + 0.5 * mz)
        dx, dy = c * mx - s * my, s * mx + c * my
        length = math.hypot(dx, dy)
        moved = length + radius * abs(mz)
        if moved > 0.0:
            held_down = struck
            for k in range(count, count + over):
                now = gap_to(solids, chosen[k], state[X], state[Y])
                held_down = held_down or gap_to(solids, chosen[k], state[X] + dx, state[Y] + dy) < now - TANGENT
            if over == 0 and math.hypot(state[X] + dx - chosen_x, state[Y] + dy - chosen_y) + length > HORIZON:
                count = choose_solids(solids, state[X], state[Y], radius + length + HORIZON, chosen)
                chosen_x, chosen_y = state[X], state[Y]
            # swept: the outline is tested every SWEEP_STEP of its way
            parts = math.ceil(moved / SWEEP_STEP)
            hit = -1
            free = 0
            for part in range(1, 1 if held_down else parts + 1):
                f = part / parts
                x, y, yaw = state[X] + f * dx, state[Y] + f * dy, state[YAW] + f * mz
                if not math.isnan(facing):
                    yaw = facing
                hit = find_collision(squares, grid, solids, chosen, count, footprint, radius, x, y, yaw, placed)
                if hit != -1:
                    break
                free = part
            f = free / parts
            state[X] += f * dx
            state[Y] += f * dy
            # a round robot that is held goes on turning, its outline slides on itself; a car turns only as it rolls
            held = math.isnan(facing) or model.wheelbase > 0.0
            g = f if held else 1.0
            state[YAW] = wrapped(state[YAW] + g * mz)
            state[DISTANCE] += f * length
            c, s = math.cos(state[OYAW] + 0.5 * oz), math.sin(state[OYAW] + 0.5 * oz)
            state[OX] += f * (c * ox - s * oy)
            state[OY] += f * (s * ox + c * oy)
            state[OYAW] = wrapped(state[OYAW] + g * oz)
            if hit != -1 or held_down:
                for i in range(3 if held else 2):
                    state[VX + i] = 0.0
                    state[LX + i] = 0.0
                    state[GX + i] = 0.0
                if hit != -1 and state[TOUCHING] == 0.0:
                    state[TOUCHING] = 1.0
                    state[CX], state[CY], state[CYAW] = state[X], state[Y], state[YAW]
                    collisions[hits, 0], collisions[hits, 1] = step, hit
                    hits += 1
            elif state[TOUCHING] != 0.0:
                turned = abs(wrapped(state[YAW] - state[CYAW]))
                if math.hypot(state[X] - state[CX], state[Y] - state[CY]) + radius * turned > RELEASE:
                    state[TOUCHING] = 0.0
        samples[step, 0], samples[step, 1], samples[step, 2] = state[X], state[Y], state[YAW]
        samples[step, 3], samples[step, 4], samples[step, 5] = state[OX], state[OY], state[OYAW]
        samples[step, 6], samples[step, 7], samples[step, 8] = state[VX], state[VY], state[WZ]
        samples[step, 9] = max(state[TOUCHING], state[OVERRUN])
    return hits
