# pyright: basic
"""Distances over the local costmap (base_local_planner's MapGrid), and the base of the four critics that read them.

A grid is stored flat with a border of obstacle cells, so that neighbors need no bounds checks. Values: 0 and more = steps
to the target over 4-connected free cells, FREE_UNREACHED, BLOCKED (cost >= 253, or the border). One extra element at the
end stays FREE_UNREACHED.

A wavefront expands only as far as scores need it: rollouts end near the robot, and the wavefront covers most of the costmap
after that. A distance is final once it is set, so a wavefront that is interrupted and resumed gives the same grid.

From a single cell, usually at the edge of the window, an undirected wavefront would cover most of the costmap before it
reaches the robot. It is directed instead: A* (P. Hart, N. Nilsson, B. Raphael, 1968) towards the cell where rollouts are
expected to end. The Manhattan distance is a consistent heuristic, so the distances equal those of the undirected wavefront.
Each step keeps the estimated path length or increases it by two, so two stacks suffice as the priority queue.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import plain_kernel
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import Critic, DistanceGrid, RolloutCells, Rollouts, ScoringContext

P = TypeVar("P")

RosDistro = Literal["noetic", "indigo"]


def distance_weight(bias: float, resolution: float, distro: RosDistro) -> float:
    """Weight of a grid distance (cells): the bias per meter; half of that before 2018."""
    return resolution * bias * (0.5 if distro == "indigo" else 1.0)


CENTER_CODES = {
    -2: "passes a cell from which its target cannot be reached",
    -3: "passes an obstacle cell",
    -4: "leaves the map",
}
NOSE_CODES = {-4: "its nose leaves the map"}


FREE_UNREACHED = -1
BLOCKED = -2

STATE_SIZE = 16
"""Elements before the distances; 64 bytes, so that the distances are aligned."""
# state of an undirected wavefront: begin and end of its queue
HEAD, TAIL = 0, 1
# state of a directed one: cells on the stack of paths of `LENGTH`, and on the stack of paths longer by two
SHORT, LONG = 0, 1
LENGTH = 2
TARGET_X, TARGET_Y = 3, 4  # in cells of the padded grid
SWAPPED = 5  # 1 while the stack of the longer paths is the first half of the queue
DIRECTED = 6  # 1 for a directed wavefront
SEEDS = 7  # cells the wavefront started from
STEPPED_BACK = 8  # blocked cells of the plan that the target was moved back over


class MapGridCritic(Critic[P]):
    """Distance (cells, around obstacles) to a target from a rollout's last point, or from the nose at that point."""

    def __init__(self, name: str, params: P, *, ahead: float | None = None) -> None:
        """`ahead`: distance of the nose from the center (m); None uses the center, which must stay off obstacles."""
        super().__init__(name, params)
        self._ahead = ahead
        self._scale = 0.0
        self._builder = MapGridBuilder()
        self._out = np.empty(0)
        self.context: ScoringContext | None = None
        self.grid: DistanceGrid | None = None

    @property
    def scale(self) -> float:
        """Weight of a cell in the last prepared cycle."""
        return self._scale

    @abstractmethod
    def weight(self, context: ScoringContext) -> float:
        """Return the weight of a cell in this cycle."""

    @abstractmethod
    def build(self, context: ScoringContext) -> DistanceGrid:
        """Build the grid of distances to the target."""

    def prepare(self, context: ScoringContext) -> None:
        """Compute the weight, and build the grid."""
        self.context, self._scale, self.grid = context, self.weight(context), self.build(context)

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) cells; -4 off the map. At the center also -2 and -3; at the nose nx*ny and more if unreachable."""
        if self.grid is None or self.context is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        cells = shared_cells(self.context, rollouts)
        if self._ahead is None:
            return self.grid.at_center(rollouts, cells, self._out)
        return self.grid.at_nose(rollouts, cells, self._ahead, self._out)

    def grid_values(self) -> NDArray[np.float64] | None:
        """(ny, nx) distances to the target."""
        return None if self.grid is None else self.grid.values()


@dataclass(slots=True, eq=False)
class MapGrid(DistanceGrid):
    """Breadth-first distances (cells) to a plan, or to its last cell inside the window."""

    storage: NDArray[np.int32]
    """State, distances and queue of the wavefront: see `storage_size`."""
    grid: NDArray[Any]
    """(1,) geometry: see `grid_record`."""

    @property
    def seeds(self) -> int:
        """Cells the wavefront started from; 0 if no part of the plan is inside the window."""
        return int(self.storage[SEEDS])

    @property
    def stepped_back(self) -> int:
        """Blocked cells of the plan that the target was moved back over."""
        return int(self.storage[STEPPED_BACK])

    def values(self) -> NDArray[np.float64]:
        """(ny, nx) as in C++: distance, nx*ny in obstacles next to reached cells, nx*ny + 1 where unreachable."""
        out = np.empty((int(self.grid[0]["ny"]), int(self.grid[0]["nx"])))
        whole_grid(self.grid, self.storage, out)
        return out

    def at_center(self, rollouts: Rollouts, cells: RolloutCells, out: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K,) value at each rollout's last point; -4 if a point is off the map, -3 in an obstacle, -2 unreachable.

        `out` (K,) is written where the rollout is alive, and returned.
        """
        center_scores(self.grid, self.storage, cells.padded, rollouts.counts, rollouts.alive, out)
        return out

    def at_nose(
        self, rollouts: Rollouts, cells: RolloutCells, ahead: float, out: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(K,) value `ahead` meters in front of each rollout's last point; -4 if this point is ever off the map."""
        nose_scores(self.grid, self.storage, rollouts.poses, rollouts.counts, cells.boxes, rollouts.alive, ahead, out)
        return out


class MapGridBuilder:
    """Builds one grid per cycle in memory that it reuses."""

    def __init__(self) -> None:
        self._storage = np.empty(0, np.int32)

    def build(
        self,
        context: ScoringContext,
        plan: NDArray[np.float64],
        near: tuple[float, float],
        *,
        last_only: bool,
        step_back: bool = False,
    ) -> MapGrid:
        """Grid of distances to `plan` (n, 3), or with `last_only` to its last cell inside the window.

        `near`: where the grid will be read; it is computed from the target towards there. With `step_back` a blocked last
        cell is replaced by the last free one before it.
        """
        ny, nx = context.costmap.data.shape
        size = storage_size(nx, ny)
        if len(self._storage) != size:
            self._storage = np.empty(size, np.int32)
        x, y = near
        start_wavefront(
            context.costmap.data, context.grid, plan, last_only, step_back, float(x), float(y), self._storage
        )
        return MapGrid(self._storage, context.grid)


def shared_path_grid(context: ScoringContext, builder: MapGridBuilder) -> DistanceGrid:
    """Grid of distances to the plan: built for the first critic that needs it, then shared."""
    if context.path_grid is None:
        context.path_grid = builder.build(context, context.plan, context.state.pose[:2], last_only=False)
    return context.path_grid


# --- kernels --------------------------------------------------------------------------------------------------------


def storage_size(nx, ny):
    """Elements of a grid's storage: state, distances, queue.

    A cell is queued at most once by each of its neighbors. Cells that need not be queued are written to the next free
    position, where the next cell overwrites them.
    """
    cells = (nx + 2) * (ny + 2)
    return STATE_SIZE + cells + 1 + 2 * (4 * cells + 1)


@plain_kernel
def mark_obstacles(costs, distances):
    """Set every cell of `distances` to FREE_UNREACHED or BLOCKED."""
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


@plain_kernel
def start_wavefront(costs, grid, plan, last_only, step_back, x, y, storage):
    """Start a wavefront at the plan's cells inside the map or, with `last_only`, at the last of them, towards (x, y).

    `plan` (n, 3) is densified to the resolution. Its cells count from the first inside the map until the plan leaves the
    map (unknown cells are outside). With `step_back` a blocked last cell is replaced by the last free cell before it.
    `grid`: see `grid_record`. `storage` int32, see `storage_size`: SEEDS of its state is 0 if no part of the plan is inside.
    """
    ny, nx = costs.shape
    width = nx + 2
    cells = (ny + 2) * width
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    end = STATE_SIZE + cells + 1
    state, distances, queue = storage[:STATE_SIZE], storage[STATE_SIZE:end], storage[end:]
    mark_obstacles(costs, distances)
    tail = 0
    started = False
    left = False
    last = -1
    last_free = -1
    behind = 0  # cells of the plan after the last free cell
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
    state[:] = 0
    state[TAIL] = tail
    state[SEEDS] = tail
    if last_only and last >= 0:
        cell = last
        if step_back and last_free >= 0:
            cell = last_free
            state[STEPPED_BACK] = behind
        state[DIRECTED] = 1
        # the wavefront starts there even if the cell is an obstacle
        distances[cell] = FREE_UNREACHED
        queue[0] = cell
        state[SHORT] = 1
        state[LONG] = 0
        state[SEEDS] = 1
        # a target off the map, or NaN, is replaced by a cell at the border
        fx, fy = (x - origin_x) / resolution, (y - origin_y) / resolution
        state[TARGET_X] = int(min(max(fx, 0.0), nx - 1.0)) + 1 if fx == fx else 1
        state[TARGET_Y] = int(min(max(fy, 0.0), ny - 1.0)) + 1 if fy == fy else 1
        row = cell // width
        state[LENGTH] = abs(cell - row * width - state[TARGET_X]) + abs(row - state[TARGET_Y])


@plain_kernel
def expand(distances, queue, state, until, width):
    """Expand the wavefront until it reaches the cell `until`, or completely."""
    if state[DIRECTED]:
        expand_directed(distances, queue, state, until, width)
        return
    head, tail = np.int64(state[HEAD]), np.int64(state[TAIL])
    # branchless: a cell that needs no visit is written to where the next one overwrites it
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
    state[HEAD] = head
    state[TAIL] = tail


@plain_kernel
def expand_directed(distances, queue, state, until, width):
    """Expand a directed wavefront until it reaches the cell `until`, or completely.

    A free neighbor in the direction of the target belongs to a path of the same length: it is the next cell, without the stack.
    """
    half = len(queue) // 2
    base = half if state[SWAPPED] else 0
    short, long, length = np.int64(state[SHORT]), np.int64(state[LONG]), np.int64(state[LENGTH])
    to_x, to_y = np.int64(state[TARGET_X]), np.int64(state[TARGET_Y])
    cell, x, y, distance = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    follows = False
    while distances[until] == FREE_UNREACHED:
        if not follows:
            if short == 0:
                if long == 0:
                    break
                base = half - base
                short, long, length = long, 0, length + 2
            short -= 1
            cell = np.int64(queue[base + short])
            if distances[np.uint64(cell)] != FREE_UNREACHED:
                continue
            y = np.int64(np.uint32(cell) // np.uint32(width))
            x = cell - y * width
            distance = length - abs(x - to_x) - abs(y - to_y)
        distances[np.uint64(cell)] = distance
        other = half - base
        beside, level = x == to_x, y == to_y
        step_x, step_y = 1 if x <= to_x else -1, 1 if y <= to_y else -1
        # branchless: a cell that is not put on a stack is overwritten by the next one
        along_x, along_y = cell + step_x, cell + step_y * width
        new_x, new_y = (
            distances[np.uint64(along_x)] == FREE_UNREACHED,
            distances[np.uint64(along_y)] == FREE_UNREACHED,
        )
        queue[np.uint64(other + long)] = cell - step_x
        long += distances[np.uint64(cell - step_x)] == FREE_UNREACHED
        queue[np.uint64(other + long)] = cell - step_y * width
        long += distances[np.uint64(cell - step_y * width)] == FREE_UNREACHED
        queue[np.uint64(other + long)] = along_x
        long += new_x & beside
        queue[np.uint64(other + long)] = along_y
        long += new_y & level
        nearer_x, nearer_y = new_x & (not beside), new_y & (not level)
        queue[np.uint64(base + short)] = along_x
        short += nearer_x & nearer_y
        follows = nearer_x | nearer_y
        cell = along_y if nearer_y else along_x
        x += 0 if nearer_y else step_x
        y += step_y if nearer_y else 0
        distance += 1
    if follows:
        queue[base + short] = cell
        short += 1
    state[SHORT], state[LONG], state[LENGTH] = short, long, length
    state[SWAPPED] = 1 if base > 0 else 0


@plain_kernel
def grid_value(distances, queue, state, cell, width, size):
    """C++'s target_dist of a cell: its distance, `size` for an obstacle next to a reached cell, `size + 1` if unreachable."""
    blocked = distances[cell] == BLOCKED
    for side in range(5):
        # C++ marks an obstacle when the wavefront reaches one of its neighbors
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
            expand(distances, queue, state, near, width)
        if distances[near] >= 0:
            return np.int64(size) if blocked else np.int64(distances[near])
    return np.int64(size + 1)


@plain_kernel
def whole_grid(grid, storage, out):
    """Write the completely expanded grid to `out` (ny, nx), with C++'s values: see `grid_value`."""
    nx, ny = grid[0].nx, grid[0].ny
    width = nx + 2
    cells = (ny + 2) * width
    end = STATE_SIZE + cells + 1
    state, distances, queue = storage[:STATE_SIZE], storage[STATE_SIZE:end], storage[end:]
    expand(distances, queue, state, cells, width)
    for iy in range(ny):
        for ix in range(nx):
            out[iy, ix] = grid_value(distances, queue, state, (iy + 1) * width + ix + 1, width, nx * ny)


@plain_kernel
def center_scores(grid, storage, cells, counts, alive, out):
    """Write the grid's value at the last point of each rollout that is alive to `out` (K,).

    `cells` (K, T): cells of the points in the padded grid. -4: a point off the map; -3: in an obstacle; -2: in a cell from
    which the target is unreachable; whichever comes first.
    """
    nx, ny = grid[0].nx, grid[0].ny
    width = nx + 2
    size = nx * ny
    end = STATE_SIZE + (ny + 2) * width + 1
    state, distances, queue = storage[:STATE_SIZE], storage[STATE_SIZE:end], storage[end:]
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
                value = grid_value(distances, queue, state, cell, width, size)
                if value >= size:
                    score = -3.0 if value == size else -2.0
                    break
            score = np.float64(value)
        out[k] = score


@plain_kernel
def nose_scores(grid, storage, poses, counts, boxes, alive, ahead, out):
    """Write the grid's value `ahead` meters in front of the last point of each rollout that is alive to `out` (K,).

    -4: the nose is off the map at any point. Obstacles count as far away. `boxes` (K + 1, 4): see `point_cells`.
    """
    nx, ny = grid[0].nx, grid[0].ny
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    width = nx + 2
    size = nx * ny
    end = STATE_SIZE + (ny + 2) * width + 1
    state, distances, queue = storage[:STATE_SIZE], storage[STATE_SIZE:end], storage[end:]
    margin = math.ceil(min(abs(ahead) / resolution, nx + ny)) + 1
    for k in range(len(counts)):
        if not alive[k]:
            continue
        score = 0.0
        n = counts[k]
        # the nose cannot leave the map on a rollout that stays clear of the border: only the last one is checked
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
                    value = grid_value(distances, queue, state, cell, width, size)
                score = np.float64(value)
        out[k] = score
