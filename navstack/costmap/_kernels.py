"""Kernels of the costmaps: scans to points, rays, marks, polygons, windows, inflation.

Callers check the input (dtypes, contiguity, sizes); what a sensor may contain (NaN, infinities, points off the map) is
checked here. Cells are flat indices `iy * nx + ix` wherever a ray walks; unsigned ones spare numba's wrap-around test.
"""
# pyright: basic

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

FIXED = 40
"""Bits behind the point of a ray's slope: exact for rays of up to 700,000 cells."""


# --- scans ------------------------------------------------------------------------------------------------------------


@kernel
def project_scan(ranges, directions, range_min, range_max, inf_range, x, y, yaw, height, out):
    """Points (x, y, z) float32 in the global frame of the valid beams of a scan; how many.

    `directions` (n, 2) = cos, sin of each beam; `inf_range` replaces +inf unless it is NaN; `x, y, yaw` = pose of the
    sensor's frame. Rounds to float32 where ROS does: laser_geometry's points, then tf2's transform of a cloud, which takes
    a quaternion in float32 and makes a matrix of it in float32.
    """
    count = 0
    qz, qw = np.float32(math.sin(0.5 * yaw)), np.float32(math.cos(0.5 * yaw))
    tz = qz + qz
    c, s = np.float32(1.0) - tz * qz, tz * qw
    tx, ty, z = np.float32(x), np.float32(y), np.float32(height)
    replace = not math.isnan(inf_range)
    for i in range(ranges.size):
        r = float(ranges[i])
        if replace and r == math.inf:
            r = float(inf_range)
        if r >= range_min and r < range_max:  # false for NaN
            px = np.float32(r * directions[i, 0])
            py = np.float32(r * directions[i, 1])
            out[count, 0] = (c * px - s * py) + tx
            out[count, 1] = (s * px + c * py) + ty
            out[count, 2] = z
            count += 1
    return count


@kernel
def project_points(points, x, y, yaw, min_height, max_height, out):
    """Points (n, 3) float32 into the global frame, those between the heights (m) only; how many."""
    count = 0
    qz, qw = np.float32(math.sin(0.5 * yaw)), np.float32(math.cos(0.5 * yaw))
    tz = qz + qz
    c, s = np.float32(1.0) - tz * qz, tz * qw
    tx, ty = np.float32(x), np.float32(y)
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        if math.isfinite(px) and math.isfinite(py) and pz >= min_height and pz <= max_height:
            out[count, 0] = (c * px - s * py) + tx
            out[count, 1] = (s * px + c * py) + ty
            out[count, 2] = pz
            count += 1
    return count


# --- rays -------------------------------------------------------------------------------------------------------------


@kernel
def clear_line(cells, nx, x0, y0, x1, y1, max_length):
    """Sets the Bresenham line between two cells, both included, to 0; cut after `max_length` cells of Euclidean length.

    The cell after i steps along the dominant axis lies `(da // 2 + i * db) // da` steps along the other one. With a slope
    in fixed point each cell costs one addition and no branch.
    """
    dx, dy = x1 - x0, y1 - y0
    step_x, step_y = 1 if dx > 0 else -1, nx if dy > 0 else -nx
    adx, ady = abs(dx), abs(dy)
    if adx >= ady:
        da, db, step_a, step_b = adx, ady, step_x, step_y
    else:
        da, db, step_a, step_b = ady, adx, step_y, step_x
    offset = y0 * nx + x0
    if da == 0:
        cells[np.uint64(offset)] = 0
        return
    steps = da
    squared = float(da * da + db * db)
    if squared > max_length * max_length:
        steps = int(max_length / math.sqrt(squared) * da)
    scale = (1 << FIXED) / da
    slope = int(db * scale) + 1
    at = int((da // 2) * scale) + 1
    for _ in range(steps + 1):
        cells[np.uint64(offset + (at >> FIXED) * step_b)] = 0
        offset += step_a
        at += slope


@kernel
def clear_rays(costs, points, count, origin_x, origin_y, resolution, sx, sy, reach, reach_cells, bounds):
    """Frees the cells between the sensor at (sx, sy) and each point; grows `bounds`. False when the sensor is off the map.

    Points outside the map are pulled back along their ray onto its border (costmap_2d/plugins/obstacle_layer.cpp).
    """
    ny, nx = costs.shape
    if not (sx >= origin_x and sy >= origin_y):
        return False
    fx, fy = (sx - origin_x) / resolution, (sy - origin_y) / resolution
    if not (fx < nx and fy < ny):
        return False
    x0, y0 = int(fx), int(fy)
    cells = costs.reshape(-1)
    end_x, end_y = origin_x + nx * resolution, origin_y + ny * resolution
    min_x, min_y, max_x, max_y = min(bounds[0], sx), min(bounds[1], sy), max(bounds[2], sx), max(bounds[3], sy)
    reach_squared = reach * reach
    last_x, last_y = -1, -1
    for i in range(count):
        wx, wy = float(points[i, 0]), float(points[i, 1])
        a, b = wx - sx, wy - sy
        if wx < origin_x:
            wy = sy + b * ((origin_x - sx) / a)
            wx = origin_x
        if wy < origin_y:
            wx = sx + a * ((origin_y - sy) / b)
            wy = origin_y
        if wx > end_x:
            wy = sy + b * ((end_x - sx) / a)
            wx = end_x - 0.001
        if wy > end_y:
            wx = sx + a * ((end_y - sy) / b)
            wy = end_y - 0.001
        if not (wx >= origin_x and wy >= origin_y):
            continue
        fx, fy = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        if not (fx < nx and fy < ny):
            continue
        x1, y1 = int(fx), int(fy)
        dx, dy = wx - sx, wy - sy
        squared = dx * dx + dy * dy
        if squared > reach_squared:
            cut = reach / math.sqrt(squared)
            dx, dy = dx * cut, dy * cut
        min_x, min_y, max_x, max_y = min(min_x, sx + dx), min(min_y, sy + dy), max(max_x, sx + dx), max(max_y, sy + dy)
        # a ray depends on its two cells only: neighbouring beams often end in the same one
        if x1 != last_x or y1 != last_y:
            clear_line(cells, nx, x0, y0, x1, y1, reach_cells)
            last_x, last_y = x1, y1
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y
    return True


@kernel
def mark_points(
    costs, serials, serial, points, count, origin_x, origin_y, resolution, sx, sy, sz, max_height, reach, bounds
):
    """Makes the cells of the points closer than `reach` (3-D) lethal and signs them with `serial`; grows `bounds`."""
    ny, nx = costs.shape
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    reach_squared = reach * reach
    for i in range(count):
        px, py, pz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        squared = (px - sx) * (px - sx) + (py - sy) * (py - sy) + (pz - sz) * (pz - sz)
        if not (squared < reach_squared) or pz > max_height or px < origin_x or py < origin_y:
            continue
        fx, fy = (px - origin_x) / resolution, (py - origin_y) / resolution
        if not (fx < nx and fy < ny):
            continue
        ix, iy = int(fx), int(fy)
        costs[iy, ix] = 254
        serials[iy, ix] = serial
        min_x, min_y, max_x, max_y = min(min_x, px), min(min_y, py), max(max_x, px), max(max_y, py)
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y


# --- voxels -----------------------------------------------------------------------------------------------------------
# A column holds its levels as bits: `levels` low bits "seen free", `levels` bits "marked" above them (neither: unknown), and
# in what is left of the word the serial of the observation that marked it last. A word of 0 is unknown all the way up.


@kernel
def bits_set(n):
    """Number of ones."""
    count = 0
    while n:
        n &= n - 1
        count += 1
    return count


@kernel
def clear_voxel_rays(
    columns,
    costs,
    points,
    count,
    grid,
    levels,
    sx,
    sy,
    sz,
    reach,
    reach_cells,
    mark_threshold,
    unknown_threshold,
    bounds,
):
    """Clears the voxels between the sensor and each point and settles the columns passed; False when it is off the map.

    `grid` = origin_x, origin_y, origin_z, resolution, z_resolution, highest z. See costmap_2d/plugins/voxel_layer.cpp and
    voxel_grid.h: rays are shortened by two cells, then clipped to the map and the heights.
    """
    ny, nx = costs.shape
    origin_x, origin_y, origin_z, resolution, z_resolution, top = grid[0], grid[1], grid[2], grid[3], grid[4], grid[5]
    if not (sx >= origin_x and sy >= origin_y and sz >= origin_z):
        return False
    x0, y0 = (sx - origin_x) / resolution, (sy - origin_y) / resolution
    z0 = (sz - origin_z) / z_resolution
    if not (x0 < nx and y0 < ny and z0 < levels):
        return False
    ix0, iy0, iz0 = int(x0), int(y0), int(z0)
    flat_columns, flat_costs = columns.reshape(-1), costs.reshape(-1)
    level_mask = (1 << levels) - 1
    end_x, end_y = origin_x + (nx - 0.5) * resolution, origin_y + (ny - 0.5) * resolution
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    last_x, last_y, last_z = -1, -1, -1
    for i in range(count):
        wx, wy, wz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        a, b, c = wx - sx, wy - sy, wz - sz
        distance = math.sqrt(a * a + b * b + c * c)
        if not (distance < math.inf):
            continue
        short = max((distance - 2.0 * resolution) / distance, 0.0) if distance > 0.0 else 0.0
        wx, wy, wz = short * a + sx, short * b + sy, short * c + sz
        a, b, c = wx - sx, wy - sy, wz - sz
        t = 1.0
        if wz > top:
            t = max(0.0, min(t, (top - 0.01 - sz) / c))
        elif wz < origin_z:
            t = min(t, (origin_z - sz) / c)
        if wx < origin_x:
            t = min(t, (origin_x - sx) / a)
        if wy < origin_y:
            t = min(t, (origin_y - sy) / b)
        if wx > end_x:
            t = min(t, (end_x - sx) / a)
        if wy > end_y:
            t = min(t, (end_y - sy) / b)
        wx, wy, wz = sx + a * t, sy + b * t, sz + c * t
        if not (wx >= origin_x and wy >= origin_y and wz >= origin_z):
            continue
        x1, y1 = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        z1 = (wz - origin_z) / z_resolution
        if not (x1 < nx and y1 < ny and z1 < levels):
            continue
        dx, dy = wx - sx, wy - sy
        full = math.sqrt(dx * dx + dy * dy)
        if full > reach:
            cut = reach / full
            dx, dy = dx * cut, dy * cut
        min_x, min_y, max_x, max_y = min(min_x, sx + dx), min(min_y, sy + dy), max(max_x, sx + dx), max(max_y, sy + dy)

        ix1, iy1, iz1 = int(x1), int(y1), int(z1)
        span_x, span_y, span_z = abs(ix1 - ix0), abs(iy1 - iy0), abs(iz1 - iz0)
        dominant = max(span_x, span_y, span_z)
        length = math.sqrt((x0 - x1) * (x0 - x1) + (y0 - y1) * (y0 - y1) + (z0 - z1) * (z0 - z1))
        steps = dominant
        if length > reach_cells:
            steps = int(reach_cells / length * dominant)
        elif ix1 == last_x and iy1 == last_y and iz1 == last_z:
            continue  # the same voxels as the beam before
        else:
            last_x, last_y, last_z = ix1, iy1, iz1
        step_x, step_y, step_z = 1 if ix1 > ix0 else -1, nx if iy1 > iy0 else -nx, 1 if iz1 > iz0 else -1
        error_x = error_y = error_z = dominant // 2
        offset, level = iy0 * nx + ix0, iz0
        for _ in range(steps + 1):
            old = int(flat_columns[np.uint64(offset)])
            word = (old | (1 << level)) & ~(1 << (level + levels))
            if word != old:
                flat_columns[np.uint64(offset)] = word
            marked = (word >> levels) & level_mask
            if marked == 0 or bits_set(marked) <= mark_threshold:
                unknown = level_mask & ~(word | marked)
                known = unknown_threshold >= levels or bits_set(unknown) <= unknown_threshold
                flat_costs[np.uint64(offset)] = 0 if known else 255
            # the dominant axis steps each time, since its error reaches the threshold each time
            error_x += span_x
            error_y += span_y
            error_z += span_z
            if error_x >= dominant:
                error_x -= dominant
                offset += step_x
            if error_y >= dominant:
                error_y -= dominant
                offset += step_y
            if error_z >= dominant:
                error_z -= dominant
                level += step_z
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y
    return True


@kernel
def mark_voxels(columns, costs, serial, points, count, grid, levels, sx, sy, sz, reach, mark_threshold, bounds):
    """Marks the voxels of the points closer than `reach`; columns with more marks than the threshold become lethal."""
    ny, nx = costs.shape
    origin_x, origin_y, origin_z, resolution, z_resolution, top = grid[0], grid[1], grid[2], grid[3], grid[4], grid[5]
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    reach_squared = reach * reach
    level_mask = (1 << levels) - 1
    bits_mask = (1 << (2 * levels)) - 1
    for i in range(count):
        px, py, pz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        squared = (px - sx) * (px - sx) + (py - sy) * (py - sy) + (pz - sz) * (pz - sz)
        if not (squared < reach_squared) or pz > top or px < origin_x or py < origin_y:
            continue
        fx, fy = (px - origin_x) / resolution, (py - origin_y) / resolution
        fz = max(pz - origin_z, 0.0) / z_resolution
        if not (fx < nx and fy < ny and fz < levels):
            continue
        ix, iy, iz = int(fx), int(fy), int(fz)
        word = (int(columns[iy, ix]) | (1 << (iz + levels))) & ~(1 << iz)
        columns[iy, ix] = (word & bits_mask) | (serial << (2 * levels))
        if bits_set((word >> levels) & level_mask) > mark_threshold:
            costs[iy, ix] = 254
            min_x, min_y, max_x, max_y = min(min_x, px), min(min_y, py), max(max_x, px), max(max_y, py)
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y


# --- polygons ---------------------------------------------------------------------------------------------------------


@kernel
def place_footprint(vertices, x, y, yaw, out, bounds):
    """The outline (n, 2) at a pose, into `out`; grows `bounds` to hold it."""
    c, s = math.cos(yaw), math.sin(yaw)
    for i in range(vertices.shape[0]):
        wx = x + (vertices[i, 0] * c - vertices[i, 1] * s)
        wy = y + (vertices[i, 0] * s + vertices[i, 1] * c)
        out[i, 0], out[i, 1] = wx, wy
        bounds[0], bounds[1] = min(bounds[0], wx), min(bounds[1], wy)
        bounds[2], bounds[3] = max(bounds[2], wx), max(bounds[3], wy)


@kernel
def fill_convex(costs, vertices, first, last, spans, origin_x, origin_y, resolution, value):
    """Sets the cells of a convex polygon: in each column from the lowest to the highest cell of the outline.

    `vertices[first:last]` are its corners (m), `spans` (2, >= nx) scratch. False, and nothing set, when a corner is off the
    map (costmap_2d's setConvexPolygonCost).
    """
    ny, nx = costs.shape
    left, right = nx, -1
    for i in range(first, last):
        wx, wy = vertices[i, 0], vertices[i, 1]
        if not (wx >= origin_x and wy >= origin_y):
            return False
        fx, fy = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        if not (fx < nx and fy < ny):
            return False
        left, right = min(left, int(fx)), max(right, int(fx))
    for x in range(left, right + 1):
        spans[0, x] = ny
        spans[1, x] = -1
    for i in range(first, last):
        j = i + 1 if i + 1 < last else first
        x = int((vertices[i, 0] - origin_x) / resolution)
        y = int((vertices[i, 1] - origin_y) / resolution)
        dx = int((vertices[j, 0] - origin_x) / resolution) - x
        dy = int((vertices[j, 1] - origin_y) / resolution) - y
        step_x, step_y = 1 if dx > 0 else -1, 1 if dy > 0 else -1
        adx, ady = abs(dx), abs(dy)
        longest = max(adx, ady)
        error_x = error_y = longest // 2
        for _ in range(longest + 1):
            spans[0, x] = min(spans[0, x], y)
            spans[1, x] = max(spans[1, x], y)
            # the dominant axis steps each time, since its error reaches the threshold each time
            error_x += adx
            error_y += ady
            if error_x >= longest:
                error_x -= longest
                x += step_x
            if error_y >= longest:
                error_y -= longest
                y += step_y
            # the last step may leave the grid, but then nothing is written any more
    for x in range(left, right + 1):
        for y in range(spans[0, x], spans[1, x] + 1):
            costs[y, x] = value
    return True


# --- windows ----------------------------------------------------------------------------------------------------------


@kernel
def fill_window(cells, x0, y0, x1, y1, value):
    """Sets the window to one value."""
    cells[y0:y1, x0:x1] = value


@kernel
def combine_max(master, layer, x0, y0, x1, y1):
    """Writes the larger of both into the window; unknown cells of the layer are skipped, of the master overwritten."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            ours, theirs = layer[y, x], master[y, x]
            # unknown (255) turned into 0 by adding 1 in a byte: the order of what is left is kept
            if np.uint8(ours + np.uint8(1)) > np.uint8(theirs + np.uint8(1)):
                master[y, x] = ours


@kernel
def combine_overwrite(master, layer, x0, y0, x1, y1):
    """Writes the known cells of the layer into the window."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            ours = layer[y, x]
            master[y, x] = master[y, x] if ours == 255 else ours


@kernel
def look_up_map(master, costs, x0, y0, x1, y1, affine, maximum):
    """Fills the window with the costs of another grid at each cell centre; cells outside that grid stay as they are.

    `affine` (6,): column, row (as real numbers) of the other grid = a0 + a1 * ix + a2 * iy, a3 + a4 * ix + a5 * iy.
    """
    ny, nx = costs.shape
    for iy in range(y0, y1):
        for ix in range(x0, x1):
            fx = affine[0] + affine[1] * ix + affine[2] * iy
            fy = affine[3] + affine[4] * ix + affine[5] * iy
            if fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny:
                cost = costs[int(fy), int(fx)]
                if not maximum or np.uint8(cost + np.uint8(1)) > np.uint8(master[iy, ix] + np.uint8(1)):
                    master[iy, ix] = cost


# --- inflation --------------------------------------------------------------------------------------------------------


@kernel
def count_up(lethal_row, counts, radius, out):
    """One row further: cells to the nearest lethal cell behind in each column, at most radius + 1; kept in `out` too."""
    for x in range(counts.size):
        further = np.uint8(min(counts[x], radius) + np.uint8(1))
        further = np.uint8(0) if lethal_row[x] == np.uint8(254) else further
        counts[x] = further
        out[x] = further


@kernel
def keep_nearer(distances, others):
    """The smaller of both, cell by cell, into `distances`."""
    for x in range(others.size):
        distances[x] = min(distances[x], others[x])


@kernel
def keep_dearer(costs, others):
    """The larger of both, cell by cell, into `costs`."""
    for x in range(others.size):
        costs[x] = max(costs[x], others[x])


@kernel
def set_bytes(row, value):
    """Sets all of a row."""
    for x in range(row.size):
        row[x] = value


@kernel
def raise_costs(row, costs, unknown_from):
    """The larger of both, into `row`; unknown cells are overwritten from a cost on."""
    for x in range(row.size):
        old, cost = row[x], costs[x]
        kept = np.uint8(cost if cost >= unknown_from else np.uint8(255))
        row[x] = kept if old == np.uint8(255) else max(old, cost)


@kernel
def inflate(master, x0, y0, x1, y1, radius, ahead, behind, below, rows, near, near_words, unknown_from):
    """Raises the window to the inflation cost of the nearest lethal cell, by its exact Euclidean distance.

    `ahead` (radius + 1, n): cost at `row` cells across and 1 + `column` cells along, 0 beyond the radius; column n - 1 holds
    the cost right across. `behind` is `ahead` mirrored. An unknown cell is overwritten from the cost `unknown_from` on.
    Scratch: `below` (>= y1 - y0, >= nx), `rows` (2, >= nx + 2 n + 16), `near` (a multiple of 8, >= nx + 24), which
    `near_words` shows as uint64.

    Rows of the window are taken from the top down. `below` holds how far down the nearest lethal cell of each column is,
    `counts` how far up, `near` the smaller of both. Seen from this row that is all there is to know of a column, and it
    matters to the cells on its right only while its right neighbour is farther from an obstacle (the same on the left):
    few columns have to be spread along the row, and most of the row has nothing near. The small loops that run over whole
    rows are functions of their own because they vectorise there.
    """
    ny, nx = master.shape
    left, right = max(0, x0 - radius), min(nx, x1 + radius)
    bottom, top = max(0, y0 - radius), min(ny, y1 + radius)
    width = right - left
    reach = ahead.shape[1] - 1
    most = np.uint8(radius)
    far = np.uint8(radius + 1)
    counts = rows[0, 0:width]
    set_bytes(counts, far)
    for y in range(bottom, y1):
        count_up(master[y, left:right], counts, most, below[max(y - y0, 0), 0:width])
    # eight cells at a time: one word of `near` says that nothing is near; a word of margin on both sides
    words = (width + 7) // 8 + 2
    set_bytes(near[0 : 8 * words], far)
    nothing = near_words[0]
    near_row = near[8 : 8 + width]
    margin = reach + 8
    costs = rows[1, 0 : width + 2 * margin]
    set_bytes(costs, np.uint8(0))
    set_bytes(counts, far)
    for y in range(top - 1, y0 - 1, -1):
        row = master[y, left:right]
        count_up(row, counts, most, near_row)
        if y >= y1:
            continue
        keep_nearer(near_row, below[y - y0, 0:width])
        first, last = width, -1
        for word in range(1, words - 1):
            if near_words[word] == nothing:
                continue
            for at in range(8 * word, 8 * word + 8):
                d = near[at]
                if d == far:
                    continue
                first, last = min(first, at - 8), at - 8
                here = at - 8 + margin
                costs[here] = max(costs[here], ahead[d, reach])
                if near[at + 1] > d:
                    keep_dearer(costs[here + 1 : here + 1 + reach], ahead[d, 0:reach])
                if near[at - 1] > d:
                    keep_dearer(costs[here - reach : here], behind[d, 1 : reach + 1])
        if last >= 0:
            first, last = max(x0 - left, first - radius), min(x1 - left, last + radius + 1)
            if first < last:
                raise_costs(row[first:last], costs[margin + first : margin + last], unknown_from)
            set_bytes(costs, np.uint8(0))
