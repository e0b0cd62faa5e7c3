# pyright: basic
"""Costs of the footprints of all points of a cycle's rollouts, by the tables of their edges."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel
from navstack.local_planner.critics._edge_table_kernels import (
    CHUNK,
    LARGEST_YAW,
    SCALE,
    YAW,
    X,
    Y,
    headings,
    place_corner,
    place_exactly,
    raise_to_edges,
    walk_edges,
)

PATCH, TABLES, SLOTS, EDGES, CLASSES, OUTLINE = 1 << 18, 1 << 21, 1 << 18, 1 << 17, 1 << 20, 1 << 13
"""Largest patch and tables (bytes), elements of the differences and descriptions of edges, classes of poses, lethal cells."""
COLUMNS = 6


def table_scratch_size(points, vertices):
    """Bytes that the kernels below need as scratch, a multiple of eight."""
    per_point = 8 * COLUMNS + 4 * vertices + 4 * 2 + 4
    return per_point * ((points + 7) // 8 * 8) + 3 * PATCH + TABLES + 4 * (SLOTS + EDGES) + CLASSES + 12 * OUTLINE


@kernel
def split_table_scratch(scratch, points, vertices):
    """Views of `scratch`: per point poses (6, N), codes (n, N), row and point (2, N), costs, bounds, doubtful, near (4, N).

    Then patch and its bounds (3, PATCH), tables, slots, edges, classes, outline (3, OUTLINE).
    """
    points = (points + 7) // 8 * 8
    at = 8 * COLUMNS * points
    poses = scratch[:at].view(np.float64).reshape(COLUMNS, points)
    codes = scratch[at : at + 4 * vertices * points].view(np.int32).reshape(vertices, points)
    at += 4 * vertices * points
    chosen = scratch[at : at + 8 * points].view(np.int32).reshape(2, points)
    at += 8 * points
    bytes_of_points = scratch[at : at + 4 * points].reshape(4, points)
    at += 4 * points
    patch = scratch[at : at + 3 * PATCH].reshape(3, PATCH)
    at += 3 * PATCH
    tables, classes = scratch[at : at + TABLES], scratch[at + TABLES : at + TABLES + CLASSES]
    at += TABLES + CLASSES
    slots, edges = (
        scratch[at : at + 4 * SLOTS].view(np.int32),
        scratch[at + 4 * SLOTS : at + 4 * (SLOTS + EDGES)].view(np.int32),
    )
    at += 4 * (SLOTS + EDGES)
    outline = scratch[at : at + 12 * OUTLINE].view(np.float32).reshape(3, OUTLINE)
    return poses, codes, chosen, bytes_of_points, patch, (tables, slots, edges), classes, outline


@kernel
def pack_poses(poses, chosen, scales, settings, packed, doubtful):
    """Write the chosen points of rollouts to `packed` (6, N), see `X` .. `SCALE`.

    `chosen` (2, N): rows and points. `scales` (K,): of the footprint. Points with a heading that `headings` does not accept are
    `doubtful`.
    """
    inverse = 1.0 / settings.resolution
    for n in range(np.uint64(chosen.shape[1])):
        k, i = np.uint64(chosen[0, n]), np.uint64(chosen[1, n])
        yaw = poses[k, i, 2]
        usable = abs(yaw) < LARGEST_YAW
        packed[X, n] = (poses[k, i, 0] - settings.origin_x) * inverse
        packed[Y, n] = (poses[k, i, 1] - settings.origin_y) * inverse
        packed[YAW, n] = yaw if usable else 0.0
        packed[SCALE, n] = scales[k]
        doubtful[n] = 0 if usable else 1


@kernel
def place_corners(vertices, settings, poses, chosen, packed, patch, codes, doubtful, boxes):
    """Write the cells of all corners to `codes` (n, N); a footprint that is not inside the costmap remains `doubtful`.

    `boxes` (n, 4): lowest x and y, highest x and y of each corner. `patch`: see `place_corner`. `chosen`, `packed`: see
    `pack_poses`.
    """
    number = chosen.shape[1]
    for j in range(len(vertices)):
        boxes[j, 0], boxes[j, 1], boxes[j, 2], boxes[j, 3] = 1 << 30, 1 << 30, -1, -1
    cells = 1.0 / settings.resolution
    for first in range(0, number, CHUNK):
        last = min(first + CHUNK, number)
        headings(packed, first, last)
        for j in range(len(vertices)):
            corner = vertices[j, 0] * cells, vertices[j, 1] * cells
            place_corner(packed, first, last, corner, patch, j, codes, doubtful, boxes)
    total = 0
    for i in range(np.uint64(number)):
        total += doubtful[i]
    if total == 0:
        return
    for n in range(number):
        if doubtful[n]:
            pose = poses[chosen[0, n], chosen[1, n]]
            inside = place_exactly(vertices, packed[SCALE, n], pose, settings, patch, codes[:, n], boxes)
            doubtful[n] = 0 if inside else 1


@kernel
def edge_costs(vertices, settings, poses, chosen, scales, frame, patch, packed, codes, doubtful, found, memory):
    """Write the highest cost on the edges of the footprint at the chosen points to `found` (N,); 255 if it is not inside the
    costmap.

    `frame`: box of the patch x0, y0, x1, y1, its axis, length of its rows, columns and rows of the costmap, margin of
    `place_corner`.
    `memory`: tables, slots, edges, see `raise_to_edges`; if they are empty, edges are walked. Others: see `pack_poses`.
    """
    area, along_y, pitch, nx, ny, margin = frame
    pack_poses(poses, chosen, scales, settings, packed, doubtful)
    strides = (pitch, 1) if along_y else (1, pitch)
    place = (
        *(np.int32(area[0]), np.int32(area[1]), np.int32(strides[0]), np.int32(strides[1])),
        *(float(nx), float(ny), margin),
    )
    boxes = np.empty((len(vertices), 4), np.int32)
    place_corners(vertices, settings, poses, chosen, packed, place, codes, doubtful, boxes)
    number = chosen.shape[1]
    found = found[:number]
    for i in range(np.uint64(number)):
        found[i] = np.uint8(255) if doubtful[i] else np.uint8(0)
    tables, slots, edges = memory
    u, v = (1, 0) if along_y else (0, 1)
    pair = np.empty((2, 4), np.int64)
    for j in range(len(vertices)):
        before = len(vertices) - 1 if j == 0 else j - 1
        begins, ends = codes[before, :number], codes[j, :number]
        if len(tables) == 0:
            walk_edges(patch, pitch, begins, ends, found)
            continue
        for side in range(2):
            box = boxes[before if side == 0 else j]
            pair[side, 0], pair[side, 1] = box[u] - area[u], box[v] - area[v]
            pair[side, 2], pair[side, 3] = box[2 + u] - area[u], box[2 + v] - area[v]
        raise_to_edges(patch, pitch, begins, ends, pair, tables, slots, edges, found)
