# pyright: basic
"""Kernels: the shortest route in a graph, costs along lines of a costmap, and the search for the nearest of some cells."""

from __future__ import annotations

import math

import numpy as np

from navstack.core import kernel, line_next, line_start

NODE = np.dtype(
    [
        ("route_cost", "f4"),
        ("by_edge", "i4"),
        ("in_search", "i8"),
        ("x", "f4"),
        ("y", "f4"),
        ("first", "i4"),
        ("end", "i4"),
    ]
)
"""Of a node: cost from the start, the edge by which it was reached (-1: the start), the number of the search that wrote both;
position (m), and its edges `first` to `end`.

One record lies in one line of the cache, and no search has to clear those of the one before."""

FOUND, NO_ROUTE, TOO_MANY, NEEDS_POSES, NO_COST, QUEUE_FULL = range(6)
"""Results of `shortest_route`."""
NO_COST_WEIGHT = -1.0
"""Weight of an edge whose own cost counts, but is 0. NaN: its scorers need poses; infinity: it is closed."""
QUEUED = np.dtype([("priority", "f8"), ("route_cost", "f4"), ("node", "i4")])
"""An entry of the queue of a search: lowest priority first."""


@kernel
def _push(queue, at, priority, cost, node):
    """Move an entry up from the hole `at` (uint64) to its place; entries that are equal stay above it.

    Indices are unsigned: signed ones are checked for Python's negative indices at every access.
    """
    one = np.uint64(1)
    while at > 0:
        parent = (at - one) >> one
        if not queue[parent].priority > priority:
            break
        queue[at] = queue[parent]
        at = parent
    queue[at].priority = priority
    queue[at].route_cost = cost
    queue[at].node = node


@kernel
def _pop(queue, size):
    """Remove the first of `size` (uint64) entries: the hole goes down to the bottom, the last entry up from there.

    That is the order of the C++ standard library's heap, in which entries of equal cost, and so routes of equal cost, come.
    """
    one = np.uint64(1)
    rest = size - one
    priority, cost, node = queue[rest].priority, queue[rest].route_cost, queue[rest].node
    at = np.uint64(0)
    left = one
    while left + one < rest:
        right = left + one
        child = left if queue[right].priority > queue[left].priority else right
        queue[at] = queue[child]
        at = child
        left = at + at + one
    if left + one == rest:
        queue[at] = queue[left]
        at = left
    _push(queue, at, priority, cost, node)


@kernel
def shortest_route(nodes, ends, weights, queue, search, start, goal, scale, max_iterations):
    """Search from node `start` to `goal`; return (result, edge, nodes taken from the queue).

    `weights` (m,) float32 are the costs of the edges, sums are float32 as in Nav2. `scale` is a lower bound of cost per meter:
    with 0 it is Dijkstra's algorithm, with more A*. `nodes` (n,) are marked with the number `search`; QUEUE_FULL asks for a
    longer `queue`.
    """
    goal_x, goal_y = nodes[goal].x, nodes[goal].y
    room = np.uint64(len(queue))
    largest = np.finfo(np.float32).max
    nodes[start].route_cost = np.float32(0.0)
    nodes[start].by_edge = -1
    nodes[start].in_search = search
    _push(queue, np.uint64(0), 0.0, np.float32(0.0), start)
    size, iterations = np.uint64(1), 0
    while size > 0 and iterations < max_iterations:
        iterations += 1
        cost, taken = queue[0].route_cost, queue[0].node
        _pop(queue, size)
        size -= np.uint64(1)
        node = nodes[np.uint64(taken)]
        if cost != node.route_cost:
            continue
        if taken == goal:
            return FOUND, -1, iterations
        for edge in range(np.uint64(node.first), np.uint64(node.end)):
            weight = weights[edge]
            if np.isnan(weight):
                return NEEDS_POSES, np.int64(edge), iterations
            if weight < 0.0:
                return NO_COST, np.int64(edge), iterations
            total = cost + weight
            to = nodes[np.uint64(ends[edge])]
            known = to.route_cost if to.in_search == search else largest
            if total < known:
                to.route_cost = total
                to.by_edge = edge
                to.in_search = search
                priority = float(total)
                if scale > 0.0:
                    dx, dy = to.x - goal_x, to.y - goal_y
                    priority += scale * math.sqrt(dx * dx + dy * dy)
                if size == room:
                    return QUEUE_FULL, -1, iterations
                _push(queue, size, priority, total, ends[edge])
                size += np.uint64(1)
    return (TOO_MANY if iterations == max_iterations else NO_ROUTE), -1, iterations


@kernel
def edges_to(nodes, starts, goal, edges):
    """Write the edges by which a search reached `goal`, the last one first, while `edges` has room; return how many there are."""
    count, edge = 0, nodes[goal].by_edge
    while edge >= 0:
        if count < len(edges):
            edges[count] = edge
        count += 1
        edge = nodes[starts[edge]].by_edge
    return count


@kernel
def edge_directions(steps, directions):
    """Write the directions (k,) of `steps` (k, 2) float32: with the float32 function of the C library, as Nav2.

    numpy has an own one, which differs in the last digits, and costs are to be the same.
    """
    for i in range(len(steps)):
        directions[i] = math.atan2(steps[i, 1], steps[i, 0])


@kernel
def costs_along(cells, nx, lines, stride, figures):
    """Look at every `stride`-th cell of lines (k, 4) = x0, y0, x1, y1; cells are flat, `nx` per row.

    Writes `figures` (k, 5): highest cost without unknown cells, highest cost, sum of the costs without unknown cells, number of
    cells, number of unknown cells. A line with a negative x0 is outside: its figures stay.
    """
    for i in range(len(lines)):
        x0, y0, x1, y1 = lines[i, 0], lines[i, 1], lines[i, 2], lines[i, 3]
        if x0 < 0:
            continue
        line = line_start(x0, y0, x1, y1, nx)
        cell, error = y0 * nx + x0, line[0] // 2
        known = highest = total = count = unknown = 0
        for k in range(line[0] + 1):
            if k % stride == 0:
                cost = int(cells[cell])
                count += 1
                highest = max(highest, cost)
                if cost == 255:
                    unknown += 1
                else:
                    known = max(known, cost)
                    total += cost
            cell, error = line_next(cell, error, line)
        figures[i, 0], figures[i, 1], figures[i, 2], figures[i, 3], figures[i, 4] = (
            known,
            highest,
            total,
            count,
            unknown,
        )


@kernel
def nearest_by_cells(cells, nx, start, wanted, max_iterations):
    """Return the index of the first of the cells `wanted` (k,) that a breadth-first search from the cell `start` meets, or -1.

    It goes to the 8 neighbors, through unknown cells, not through costs of 253 and 254; `wanted` may have -1 for none.
    """
    offsets = np.array([-1, 1, -nx, nx, -nx - 1, -nx + 1, nx - 1, nx + 1])
    visited = np.zeros(len(cells), np.bool_)
    queue = np.empty(len(cells), np.int32)
    queue[0], visited[start] = start, True
    head, tail = 0, 1
    while head < tail and head < max_iterations:
        cell = queue[head]
        head += 1
        for k in range(len(wanted)):
            if wanted[k] == cell:
                return k
        for offset in offsets:
            other = cell + offset
            if other < 0 or other >= len(cells) or abs(other % nx - cell % nx) > 1 or visited[other]:
                continue
            if 253 <= cells[other] <= 254:
                continue
            visited[other] = True
            queue[tail] = other
            tail += 1
    return -1
