# pyright: basic
"""Costs under a robot's outline."""

from __future__ import annotations

import math

from navstack.core.jit import kernel


@kernel
def line_cost(costs, x0, y0, x1, y1):
    """Highest cost on the line of cells from (x0, y0) to (x1, y1), both in the grid, ends included.

    The cells are those of base_local_planner's LineIterator (Bresenham).
    """
    dx = abs(x1 - x0)
    dy = abs(y1 - y0)
    step_x = 1 if x1 >= x0 else -1
    step_y = 1 if y1 >= y0 else -1
    highest = 0
    ix = x0
    iy = y0
    if dx >= dy:
        rest = dx // 2
        for _ in range(dx + 1):
            highest = max(highest, int(costs[iy, ix]))
            rest += dy
            if rest >= dx and dx > 0:
                rest -= dx
                iy += step_y
            ix += step_x
    else:
        rest = dy // 2
        for _ in range(dy + 1):
            highest = max(highest, int(costs[iy, ix]))
            rest += dx
            if rest >= dy:
                rest -= dy
                ix += step_x
            iy += step_y
    return highest


@kernel
def outline_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, interior):
    """Highest cost under the outline `vertices` (n, 2) at (x, y, yaw): its edges and, with `interior`, the cells whose
    centre lies inside (even-odd rule). -1 when the centre or a vertex lies outside the grid.
    """
    ny, nx = costs.shape
    n = len(vertices)
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    cx = (x - origin_x) / resolution
    cy = (y - origin_y) / resolution
    if not (cx >= 0.0 and cy >= 0.0 and cx < nx and cy < ny):
        return -1
    highest = int(costs[int(cy), int(cx)]) if interior else 0
    low_y = ny
    high_y = -1
    px = (x + cos * vertices[n - 1, 0] - sin * vertices[n - 1, 1] - origin_x) / resolution
    py = (y + sin * vertices[n - 1, 0] + cos * vertices[n - 1, 1] - origin_y) / resolution
    if not (px >= 0.0 and py >= 0.0 and px < nx and py < ny):
        return -1
    for i in range(n):
        qx = (x + cos * vertices[i, 0] - sin * vertices[i, 1] - origin_x) / resolution
        qy = (y + sin * vertices[i, 0] + cos * vertices[i, 1] - origin_y) / resolution
        if not (qx >= 0.0 and qy >= 0.0 and qx < nx and qy < ny):
            return -1
        highest = max(highest, line_cost(costs, int(px), int(py), int(qx), int(qy)))
        low_y = min(low_y, int(qy))
        high_y = max(high_y, int(qy))
        px = qx
        py = qy
    if not interior:
        return highest
    for iy in range(low_y, high_y + 1):
        # a cell is inside when an odd number of edges cross its row to the left of its centre
        level = iy + 0.5
        low_x = nx
        high_x = -1
        for i in range(n):
            qx = (x + cos * vertices[i, 0] - sin * vertices[i, 1] - origin_x) / resolution
            low_x = min(low_x, int(qx))
            high_x = max(high_x, int(qx))
        for ix in range(low_x, high_x + 1):
            if int(costs[iy, ix]) <= highest:
                continue
            middle = ix + 0.5
            inside = False
            px = (x + cos * vertices[n - 1, 0] - sin * vertices[n - 1, 1] - origin_x) / resolution
            py = (y + sin * vertices[n - 1, 0] + cos * vertices[n - 1, 1] - origin_y) / resolution
            for i in range(n):
                qx = (x + cos * vertices[i, 0] - sin * vertices[i, 1] - origin_x) / resolution
                qy = (y + sin * vertices[i, 0] + cos * vertices[i, 1] - origin_y) / resolution
                if (py > level) != (qy > level) and middle > px + (level - py) / (qy - py) * (qx - px):
                    inside = not inside
                px = qx
                py = qy
            if inside:
                highest = int(costs[iy, ix])
    return highest


@kernel
def turn_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, arc, step, limit, interior):
    """`outline_cost` at headings `yaw`, `yaw + step`, .. up to `yaw + arc` (rad; `step` > 0, `arc` of any sign): the highest,
    or the first that is -1 or at least `limit`, and how far the turn came (rad).
    """
    highest = 0
    size = abs(arc)
    sign = 1.0 if arc >= 0.0 else -1.0
    n = math.ceil(size / step - 1e-9) + 1
    for k in range(n):
        turned = min(k * step, size)
        cost = outline_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw + sign * turned, interior)
        if cost < 0 or cost >= limit:
            return cost, sign * turned
        highest = max(highest, cost)
    return highest, arc
