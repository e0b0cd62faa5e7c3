# pyright: basic
"""Breadth-first distances over the local costmap, and what trajectories cost on them (base_local_planner's MapGrid).

A grid is stored flat with a ring of obstacles around it, so that no neighbour needs a bounds check. Its values:
0.. = steps to the target over 4-connected free cells, FREE_UNREACHED, BLOCKED (cost >= 253, or the ring). One more value
at the end is FREE_UNREACHED for ever.

The wave goes no farther than somebody looks: trajectories end near the robot, and the wave passes most of the costmap only
after that. A distance is final when it is set, so a wave that stopped and went on gives the same grid.

From a single cell, which as a rule lies at the window's edge, a wave in all directions would pass most of the costmap on
its way to the robot. It is steered instead: A* (P. Hart, N. Nilsson, B. Raphael, 1968) towards the cell where trajectories
are expected to end. The Manhattan distance to it is consistent, so that the distances are those of the wave; and each step
keeps the length of the way or makes it longer by two, so that two stacks are all the order there is to keep.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

FREE_UNREACHED = -1
BLOCKED = -2

WAVE_SIZE = 7
# of a wave in all directions: where its queue begins and ends
HEAD, TAIL = 0, 1
# of a steered one: how many wait on the stack of ways as long as `LENGTH`, and on that of ways longer by two
SHORT, LONG = 0, 1
LENGTH = 2
TOWARDS_X, TOWARDS_Y = 3, 4  # where to, in cells of the ringed grid
SWAPPED = 5  # 1 when the stack of the longer ways lies first
STEERED = 6  # 1 for a steered wave


def queue_length(cells):
    """What a wave over so many cells (ring included) needs as its queue.

    A cell waits at most once from each of its neighbours; what need not wait is written where the next one will be.
    """
    return 2 * (4 * cells + 1)


@kernel
def start_wave(costs, origin_x, origin_y, resolution, plan, last_only, step_back, x, y, distances, queue, wave):
    """Starts a wave at the plan's cells inside the map, or with `last_only` at the last of them, towards x, y.

    `plan` (n, 3) is densified to the resolution; its cells count from the first inside the map until it leaves (unknown
    cells are outside). With `step_back` a last cell that is blocked is replaced by the last one before that is not.
    `distances` int32, (ny + 2) * (nx + 2) + 1; `queue` int32, see `queue_length`; `wave` (WAVE_SIZE,) int64. Returns how many
    seeds there were and how many cells were stepped back over; 0 seeds: nothing of the plan is inside.
    """
    ny, nx = costs.shape
    width = nx + 2
    distances[:width] = BLOCKED
    distances[(ny + 1) * width :] = BLOCKED
    distances[(ny + 2) * width] = FREE_UNREACHED
    for iy in range(ny):
        row = costs[iy]
        base = (iy + 1) * width
        distances[base] = BLOCKED
        distances[base + nx + 1] = BLOCKED
        inner = distances[base + 1 : base + 1 + nx]
        for ix in range(len(row)):
            inner[ix] = FREE_UNREACHED if row[ix] < 253 else BLOCKED

    tail = 0
    started = False
    left = False
    last = -1
    last_free = -1
    behind = 0  # cells of the plan after the last free one
    for i in range(len(plan)):
        steps = 1
        x0, y0, dx, dy = plan[i, 0], plan[i, 1], 0.0, 0.0
        if i > 0:
            x0, y0 = plan[i - 1, 0], plan[i - 1, 1]
            dx, dy = plan[i, 0] - x0, plan[i, 1] - y0
            squared = dx * dx + dy * dy
            if squared > resolution * resolution:
                steps = math.ceil(math.sqrt(squared) / resolution)
            dx /= steps
            dy /= steps
        for j in range(1, steps + 1):
            if j == steps:
                px, py = plan[i, 0], plan[i, 1]
            else:
                px, py = x0 + j * dx, y0 + j * dy
            inside = False
            if px >= origin_x and py >= origin_y:
                fx = (px - origin_x) / resolution
                fy = (py - origin_y) / resolution
                if fx < nx and fy < ny:
                    ix, iy = int(fx), int(fy)
                    if costs[iy, ix] != 255:
                        inside = True
                        started = True
                        cell = (iy + 1) * width + ix + 1
                        if last_only:
                            if cell != last:
                                behind += 1
                            last = cell
                            if costs[iy, ix] < 253:
                                last_free = cell
                                behind = 0
                        elif distances[cell] != 0:
                            distances[cell] = 0
                            queue[tail] = cell
                            tail += 1
            if started and not inside:
                left = True
                break
        if left:
            break
    stepped_back = 0
    if last_only and last >= 0:
        cell = last
        if step_back and last_free >= 0:
            cell = last_free
            stepped_back = behind
        wave[:] = 0
        wave[STEERED] = 1
        # the wave begins there, be it an obstacle
        distances[cell] = FREE_UNREACHED
        queue[0] = cell
        wave[SHORT] = 1
        # towards a place off the map, or none at all: to the border
        fx, fy = (x - origin_x) / resolution, (y - origin_y) / resolution
        wave[TOWARDS_X] = int(min(max(fx, 0.0), nx - 1.0)) + 1 if fx == fx else 1
        wave[TOWARDS_Y] = int(min(max(fy, 0.0), ny - 1.0)) + 1 if fy == fy else 1
        row = cell // width
        wave[LENGTH] = abs(cell - row * width - wave[TOWARDS_X]) + abs(row - wave[TOWARDS_Y])
        return 1, stepped_back
    wave[:] = 0
    wave[TAIL] = tail
    return tail, stepped_back


@kernel
def run_wave(distances, queue, wave, until, width):
    """Goes on with the wave until the cell `until` is reached, or to its end."""
    if wave[STEERED]:
        run_steered(distances, queue, wave, until, width)
        return
    head, tail = wave[HEAD], wave[TAIL]
    # without branches: a cell that needs no visit is written where the next one will overwrite it
    while head < tail and distances[until] == FREE_UNREACHED:
        cell = queue[head]
        head += 1
        step = distances[cell] + 1

        near = cell - 1
        new = distances[near] == FREE_UNREACHED
        queue[tail] = near
        distances[near] = step if new else distances[near]
        tail += new

        near = cell + 1
        new = distances[near] == FREE_UNREACHED
        queue[tail] = near
        distances[near] = step if new else distances[near]
        tail += new

        near = cell - width
        new = distances[near] == FREE_UNREACHED
        queue[tail] = near
        distances[near] = step if new else distances[near]
        tail += new

        near = cell + width
        new = distances[near] == FREE_UNREACHED
        queue[tail] = near
        distances[near] = step if new else distances[near]
        tail += new
    wave[HEAD] = head
    wave[TAIL] = tail


@kernel
def run_steered(distances, queue, wave, until, width):
    """Goes on with a steered wave until the cell `until` is reached, or to its end."""
    half = len(queue) // 2
    base = half if wave[SWAPPED] else 0
    short, long, length = wave[SHORT], wave[LONG], wave[LENGTH]
    to_x, to_y = wave[TOWARDS_X], wave[TOWARDS_Y]
    while distances[until] == FREE_UNREACHED:
        if short == 0:
            if long == 0:
                break
            base = half - base
            short, long, length = long, 0, length + 2
        short -= 1
        cell = np.uint32(queue[base + short])
        if distances[cell] != FREE_UNREACHED:
            continue
        y = np.int64(cell // np.uint32(width))
        x = np.int64(cell) - y * width
        distances[cell] = length - abs(x - to_x) - abs(y - to_y)
        other = half - base

        near = np.int64(cell) - 1
        new = distances[near] == FREE_UNREACHED
        nearer = x > to_x
        queue[base + short if nearer else other + long] = near
        short += new & nearer
        long += new & (not nearer)

        near = np.int64(cell) + 1
        new = distances[near] == FREE_UNREACHED
        nearer = x < to_x
        queue[base + short if nearer else other + long] = near
        short += new & nearer
        long += new & (not nearer)

        near = np.int64(cell) - width
        new = distances[near] == FREE_UNREACHED
        nearer = y > to_y
        queue[base + short if nearer else other + long] = near
        short += new & nearer
        long += new & (not nearer)

        near = np.int64(cell) + width
        new = distances[near] == FREE_UNREACHED
        nearer = y < to_y
        queue[base + short if nearer else other + long] = near
        short += new & nearer
        long += new & (not nearer)
    wave[SHORT], wave[LONG], wave[LENGTH] = short, long, length
    wave[SWAPPED] = 1 if base > 0 else 0


@kernel
def grid_value(distances, queue, wave, cell, width, size):
    """C++'s target_dist of a cell: its distance, `size` for an obstacle the wave touched, `size + 1` unreachable."""
    blocked = distances[cell] == BLOCKED
    for side in range(5):
        # an obstacle was touched when the wave reached one of its neighbours
        near = cell
        if side == 1:
            near = cell - 1
        elif side == 2:
            near = cell + 1
        elif side == 3:
            near = cell - width
        elif side == 4:
            near = cell + width
        if side > 0 and not blocked:
            break
        if distances[near] == FREE_UNREACHED:
            run_wave(distances, queue, wave, near, width)
        if distances[near] >= 0:
            return np.int64(size) if blocked else np.int64(distances[near])
    return np.int64(size + 1)


@kernel
def center_scores(distances, queue, wave, nx, ny, cells, counts, alive, out):
    """Value of the grid at the last point of each trajectory that is alive.

    `cells` (K, T): each point's cell in the ringed grid. -4: a point off the map, -3: in an obstacle, -2: that cannot be
    reached; whichever comes first.
    """
    width = nx + 2
    size = nx * ny
    for k in range(len(counts)):
        if not alive[k]:
            continue
        score = 0.0
        for i in range(counts[k]):
            cell = cells[k, i]
            if cell < 0:
                score = -4.0
                break
            value = np.int64(distances[cell])
            if value < 0:
                value = grid_value(distances, queue, wave, cell, width, size)
                if value >= size:
                    score = -3.0 if value == size else -2.0
                    break
            score = np.float64(value)
        out[k] = score


@kernel
def nose_scores(
    distances, queue, wave, nx, ny, origin_x, origin_y, resolution, poses, counts, boxes, alive, ahead, out
):
    """Value of the grid `ahead` metres before the last point of each trajectory that is alive; obstacles count as far away.

    -4: a nose off the map at any point. `boxes` (K, 4): see `point_cells`.
    """
    width = nx + 2
    size = nx * ny
    margin = math.ceil(min(abs(ahead) / resolution, nx + ny)) + 1
    for k in range(len(counts)):
        if not alive[k]:
            continue
        score = 0.0
        n = counts[k]
        # the noses of a trajectory that keeps clear of the border cannot leave the map: only the last one is looked at
        clear = (
            boxes[k, 0] >= margin and boxes[k, 1] >= margin and boxes[k, 2] < nx - margin and boxes[k, 3] < ny - margin
        )
        for i in range(max(n - 1, 0) if clear else 0, n):
            x = poses[k, i, 0] + ahead * math.cos(poses[k, i, 2])
            y = poses[k, i, 1] + ahead * math.sin(poses[k, i, 2])
            fx = (x - origin_x) / resolution
            fy = (y - origin_y) / resolution
            if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
                score = -4.0
                break
            if i == n - 1:
                cell = (int(fy) + 1) * width + int(fx) + 1
                value = np.int64(distances[cell])
                if value < 0:
                    value = grid_value(distances, queue, wave, cell, width, size)
                score = np.float64(value)
        out[k] = score
