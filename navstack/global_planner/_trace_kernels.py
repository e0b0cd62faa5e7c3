# pyright: basic
"""From a potential to a path: gradient descent, or from cell to cell.

Both go downhill to the root, where the potential is 0, and both always get there: a cell with a potential has a
4-neighbour with a lower one (the one it came from), so a step to the lowest neighbour is always progress, and gradient
descent falls back on such steps whenever it stops gaining.
"""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel

HIGH = np.float32(1e10)


@kernel
def _slope(pot, k, before, after):
    """Normalisable difference of the potential along one axis at cell k, positive where it falls toward `after`."""
    here = pot[k]
    lower, upper = pot[before], pot[after]
    s = np.float32(0.0)
    if lower < HIGH:
        s += lower - here
    if upper < HIGH:
        s += here - upper
    return s


@kernel
def _direction(pot, k, nx):
    """Unit vector of steepest descent at a cell with a potential; (0, 0) where it is flat."""
    gx = _slope(pot, k, k - 1, k + 1)
    gy = _slope(pot, k, k - nx, k + nx)
    norm = np.float32(np.hypot(gx, gy))
    if norm > 0.0:
        return gx / norm, gy / norm
    return np.float32(0.0), np.float32(0.0)


@kernel
def _interpolated(pot, k, nx, dx, dy):
    """Bilinear mean of the directions at the four cells k, right, up, up right, for the point (dx, dy) from k."""
    gx = np.float32(0.0)
    gy = np.float32(0.0)
    whole = np.float32(1.0)
    for j in range(2):
        wy = dy if j else whole - dy
        for i in range(2):
            w = wy * (dx if i else whole - dx)
            ux, uy = _direction(pot, k + j * nx + i, nx)
            gx += w * ux
            gy += w * uy
    return gx, gy


@kernel
def _lowest_neighbour(pot, k, nx):
    """The lowest of the 8 neighbours, k itself when none is lower. No step squeezes between two cells without potential."""
    best = k
    low = pot[k]
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            n = k + dy * nx + dx
            if pot[n] < low and (dx == 0 or dy == 0 or pot[k + dx] < HIGH or pot[k + dy * nx] < HIGH):
                low = pot[n]
                best = n
    return best


@kernel
def _surrounded(pot, k, nx):
    """True when the cell and its 8 neighbours all have a potential."""
    for dy in (-nx, 0, nx):
        for n in range(k + dy - 1, k + dy + 2):
            if not pot[n] < HIGH:
                return False
    return True


@kernel
def _doubled(points):
    larger = np.empty((2 * points.shape[0], 2), np.float32)
    for i in range(points.shape[0]):  # a slice would take the compiler a second
        larger[i, 0] = points[i, 0]
        larger[i, 1] = points[i, 1]
    return larger


@kernel
def gradient_path(pot, nx, ny, k, dx, dy, root_x, root_y, enough, near, patience):
    """Steps of half a cell down bilinearly interpolated unit gradients, from cell k (+ dx, dy) to the root.

    Returns points (>= n, 2) in cells, and n.

    Ends with the root once the nearest cell's potential is under `enough` or the root is within `near` cells. Beside a
    cell without potential, or when two steps cancel, it moves to the lowest of the 8 neighbours instead (navfn calcPath,
    GradientPath). When `patience` points bring no lower cell it goes on from the lowest so far by one such step. n = 0
    when the potential has no way down, which a wavefront's never has.
    """
    points = np.empty((1024, 2), np.float32)
    n = 0
    lowest = HIGH
    lowest_k = k
    lowest_n = 0
    limit = nx * ny
    half = np.float32(0.5)
    whole = np.float32(1.0)
    while True:
        nearest = k + int(np.rint(dx)) + nx * int(np.rint(dy))
        nearest = max(0, min(limit - 1, nearest))
        x = np.float32(k % nx) + dx
        y = np.float32(k // nx) + dy
        if n + 1 >= points.shape[0]:
            points = _doubled(points)
        if pot[nearest] < enough or np.hypot(x - root_x, y - root_y) < near:
            points[n, 0] = root_x
            points[n, 1] = root_y
            return points, n + 1
        ix, iy = k % nx, k // nx
        if ix < 1 or iy < 1 or ix > nx - 2 or iy > ny - 2:
            return points, 0
        points[n, 0] = x
        points[n, 1] = y
        n += 1
        if pot[k] < lowest:
            lowest, lowest_k, lowest_n = pot[k], k, n
        stuck = n - lowest_n > patience
        if stuck:
            k, n = lowest_k, lowest_n
        cancelled = n > 2 and points[n - 1, 0] == points[n - 3, 0] and points[n - 1, 1] == points[n - 3, 1]
        if not (stuck or cancelled) and _surrounded(pot, k, nx):
            gx, gy = _interpolated(pot, k, nx, dx, dy)
            norm = np.float32(np.hypot(gx, gy))
            if norm > 0.0:
                dx += gx * (half / norm)
                dy += gy * (half / norm)
                if dx > whole:
                    k += 1
                    dx -= whole
                if dx < -whole:
                    k -= 1
                    dx += whole
                if dy > whole:
                    k += nx
                    dy -= whole
                if dy < -whole:
                    k -= nx
                    dy += whole
                continue
        to = _lowest_neighbour(pot, k, nx)
        if to == k:
            k, n = lowest_k, lowest_n
            to = _lowest_neighbour(pot, k, nx)
            if to == k:
                if np.hypot(k % nx - root_x, k // nx - root_y) > 1.5:
                    return points, 0
                points[n, 0] = root_x
                points[n, 1] = root_y
                return points, n + 1
        k = to
        dx = np.float32(0.0)
        dy = np.float32(0.0)


@kernel
def _cheapest_neighbour(pot, k, nx, cost, steps):
    """The lower one of the 8 neighbours with the least sum of its potential and the cost of getting there; k if none is lower."""
    best = k
    least = HIGH
    here = steps[cost[k]]
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            n = k + dy * nx + dx
            if pot[n] < pot[k] and (dx == 0 or dy == 0 or pot[k + dx] < HIGH or pot[k + dy * nx] < HIGH):
                length = np.float32(1.0) if dx == 0 or dy == 0 else np.float32(1.4142135)
                p = pot[n] + np.float32(0.5) * length * (here + steps[cost[n]])
                if p < least:
                    least = p
                    best = n
    return best


@kernel
def grid_path(pot, nx, ny, k, cost, steps, cheapest):
    """From cell to cell until no neighbour is lower: points (>= n, 2), and n.

    To the lowest of the 8 neighbours (GridPath), or with `cheapest` to the one with the least sum of potential and cost
    of getting there.
    """
    points = np.empty((1024, 2), np.float32)
    n = 0
    while True:
        if n >= points.shape[0]:
            points = _doubled(points)
        ix, iy = k % nx, k // nx
        points[n, 0] = ix
        points[n, 1] = iy
        n += 1
        if ix < 1 or iy < 1 or ix > nx - 2 or iy > ny - 2:
            break
        to = _cheapest_neighbour(pot, k, nx, cost, steps) if cheapest else _lowest_neighbour(pot, k, nx)
        if to == k:
            break
        k = to
    return points, n
