"""The arrays of the search over poses, which are kept from query to query, and the calls of its kernels."""

from __future__ import annotations

import math
import time
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Window
from navstack.global_planner._curves import STRAIGHT
from navstack.global_planner._se2 import curve_checks as curves
from navstack.global_planner._se2 import heuristics, paths
from navstack.global_planner._se2 import search as kernels
from navstack.global_planner._se2 import shape as shapes
from navstack.global_planner._se2.connection import may_connect
from navstack.global_planner._se2.paths import rejoin
from navstack.global_planner._se2.primitives import PrimitiveTable
from navstack.global_planner._se2.records import ENTRY, FIELD, NODE, SEGMENT, SETTINGS, curve_table, untouched_zeros
from navstack.global_planner._se2.search import Outcome, Pose
from navstack.global_planner._se2.shape import Shape
from navstack.global_planner._search.cells import union

UNLIMITED: Final = 1 << 62
BUCKETS: Final = 1 << 14
"""Buckets of the queue, at least; more where twice the first estimate, with the greatest weight, needs them."""
MOST_BUCKETS: Final = 1 << 20
FIRST_NODES: Final = 1 << 14
WIDEST: Final = 16.0
"""Turning radii: no curve of the search or of the shortened path leads farther away from both of its ends."""
REACHES: Final = (16, 10, 6, 4, 3, 2)
"""Pieces on either side of a pose that are replaced when it is moved, round by round."""


class TimeLimit(NamedTuple):
    """When a search ends."""

    deadline: float
    """Of time.monotonic (s)."""
    interval: int
    """Expansions between looks at the clock."""


class PoseSearch:
    """A search over one costmap at a time. All lengths are in cells.

    Memory: 40 bytes per visited state, 8 per slot of the hash table (at most half full), 8 per queued state; 5 per cell of the
    obstacle heuristic and 8 per cell of its front, 1/8 per cell for packed obstacles, all touched only where the search looks;
    the table of curve lengths.
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        self.settings = np.zeros(1, SETTINGS)
        for name, value in settings.items():
            self.settings[name] = value
        self._nodes, self._entries = np.empty(FIRST_NODES, NODE), np.empty(2 * FIRST_NODES, ENTRY)
        self._slots = np.zeros(4 * FIRST_NODES, np.int32)
        self._heads = np.empty(BUCKETS, np.int32)
        self._field, self._front = np.zeros(0, FIELD), np.zeros(0, ENTRY)
        self._field_of: tuple[Any, ...] | None = None
        self._read: tuple[Window, NDArray[np.uint8]] | None = None
        self._unchanged = self.timed_out = False
        self.time_limit: TimeLimit | None = None
        self.read_beside: Window | None = None
        """Cells that the last search depends on although it has not read them itself."""
        self._last: tuple[NDArray[np.void], Pose, NDArray[np.float64]] | None = None
        self._margin = 0.0
        self._bits, self._yaws, self._added = np.zeros((0, 0), np.uint64), np.zeros(0), np.zeros(256, SEGMENT)
        p = self.settings[0]
        if p["cusp"] > 0.0 and p["reeds_shepp"] != curves.FORWARD:
            p["reeds_shepp"] = curves.CHEAPEST
        self._weight, self._table = float(p["weight"]), self._curve_table()

    @property
    def bytes_per_state(self) -> float:
        """Bytes held per visited state after the last search: nodes, hash table and queue."""
        visited = max(1, int(self.settings["nodes"][0]))
        return (self._nodes.nbytes + self._entries.nbytes + self._slots.nbytes) / visited

    def place(self, costs: NDArray[np.uint8], shape: Shape) -> None:
        """Prepare for searches over these costs with this footprint."""
        self.costs = costs
        ny, nx = costs.shape
        tile = shapes.TILE
        rows, words = ny + (ny + tile - 1) // tile, (nx + tile - 1) // tile
        if shape.corners > 0:
            self._bits = untouched_zeros(rows * words, np.dtype(np.uint64)).reshape(rows, words)
        elif self._bits.shape != (1, 1):
            self._bits = np.zeros((1, 1), np.uint64)
        self.use(shape)

    def use(self, shape: Shape) -> None:
        """Search with another padding of the footprint."""
        self.shape = shape
        p = self.settings
        p["corners"], p["convex"] = shape.corners, shape.convex
        p["reach"], p["sample_step"], p["fine_step"] = shape.reach, shape.step, shape.fine_step

    def turned_around(self) -> PoseSearch:
        """A search over the same costs, for a robot whose front is this one's back."""
        values = {name: self.settings[name][0] for name in SETTINGS.names or ()}
        other = PoseSearch({**values, "weight": self._weight})
        other.costs, other._bits, other.time_limit = self.costs, self._bits, self.time_limit
        rows = self.shape.rows.copy()
        rows[6:] *= -1.0
        other.use(self.shape._replace(rows=rows))
        return other

    def pose_is_free(self, x: float, y: float, yaw: float) -> bool:
        """Whether the robot may be at a pose."""
        return bool(shapes.pose_free(self.costs, self._bits, self.shape.rows, self.settings[0], x, y, yaw))

    def line_is_free(self, x: float, y: float, yaw: float, length: float) -> bool:
        """Whether the robot may drive straight on from a pose, for a signed length."""
        p = self.settings[0]
        return bool(
            self.pose_is_free(x, y, yaw)
            and curves.segment_free(self.costs, self._bits, self.shape.rows, p, STRAIGHT, x, y, yaw, length, 1.0)
        )

    def set_goal(self, x: float, y: float, start: tuple[float, float], *, keep: bool) -> None:
        """Prepare the obstacle heuristic to a goal; `keep` an old one for the same cell even if costs have changed."""
        p = self.settings
        factor = int(p["factor"][0])
        ny, nx = self.costs.shape
        same = (int(x), int(y), self.costs.shape)
        read, self._read = self._read, None  # until the end of this plan, which may read more
        known = self._field_of == same
        self._unchanged = known and read is not None and np.array_equal(self.costs[read[0].slices], read[1])
        if self._unchanged or (known and keep):
            return
        cells = ((ny + factor - 1) // factor) * ((nx + factor - 1) // factor)
        self._field, self._front = untouched_zeros(cells, FIELD), untouched_zeros(heuristics.RING + cells, ENTRY)
        self._field_of = same
        heuristics.start_field(self.costs, self._field, self._front, p[0], x, y, *start)

    def obstacle_cost(self, x: float, y: float) -> float:
        """The obstacle heuristic at a point; infinite if no cells connect it with the goal."""
        return float(heuristics.obstacle_cost(self.costs, self._field, self._front, self.settings[0], int(x), int(y)))

    def open_curve(self, start: Pose, goals: NDArray[np.float64], *, shorten: bool) -> Outcome | None:
        """The shortest curve to a goal, if it leads over cells of cost 0 only; with `shorten`, stretches of it are replaced.

        Its length counts as its cost does: backward times `reverse`, and `cusp` for changes, but arcs as straight lines.
        """
        p, self.read_beside = self.settings, None
        p["weight"], p["best_radius"], p["best_tail"] = self._weight, p["radius"], 0.0
        self._margin = WIDEST * float(p["radius"][0])
        words, non_straight = int(p["reeds_shepp"][0]), float(p["non_straight"][0])
        p["reeds_shepp"], p["non_straight"] = curves.CHEAPEST if words else curves.FORWARD, 1.0
        cost, k = curves.open_curve(self.costs, self._bits, self.shape.rows, p[0], start, goals)
        goal, path = (float(goals[k, 0]), float(goals[k, 1]), float(goals[k, 2])), np.zeros(FIRST_NODES, SEGMENT)
        if cost < math.inf:
            path = path[: self._write_curve(path, 0, start, goal, 0)]
            if shorten and (path["size"] < 0.0).any():
                path = self.shortened(path, goal)
        p["reeds_shepp"], p["non_straight"] = words, non_straight
        if cost == math.inf:
            return None
        return Outcome(kernels.FOUND, path, goal, self.cost_of(path), 1, 1, start[:2], False)

    def search(self, *, shorten: bool) -> Outcome:
        """Finish the search that `begin` has begun."""
        return self.outcome(self.advance(), shorten=shorten)

    def begin(self, table: PrimitiveTable, start: Pose, start_bin: int, goals: NDArray[np.float64]) -> None:
        """Begin to search from `start` to the cheapest of `goals` (n, 4): x, y, yaw, heading bin.

        The goal of the heuristic is set.
        """
        p = self.settings
        self._clear_nodes()
        h = min(self.obstacle_cost(start[0], start[1]), 1e6)
        self._clear_queue(h)
        p["nodes"], p["entries"], p["free_entry"], p["queued"] = 1, 0, -1, 0
        p["bucket"] = len(self._heads) - 1
        p["expanded"], p["countdown"], p["nearest_h"] = 0, 0.0, np.inf
        p["best_node"], p["best_goal"], p["best_cost"], p["best_is_curve"] = -1, -1, np.inf, 0
        p["weight"] = self._weight
        p["patience"] = kernels.PATIENCE if self._weight > 1.0 else UNLIMITED
        self._yaws = table.headings["yaw"]
        p["rotates"], p["bins"], p["turn_step"] = table.rotates, len(table.headings), table.turn_step
        p["goal_x"], p["goal_y"] = goals[0, 0], goals[0, 1]
        p["approach_node"], p["approach_since"], p["approach_distance"] = 0, 0, np.inf
        self._table = self._curve_table()
        self._margin = WIDEST * float(p["radius"][0]) + float(np.abs(table.primitives["length"]).max())
        self._write_root(start, start_bin)
        kernels.approach(p[0], goals, *start, 0)
        kernels.rehash(self._slots, self._nodes, 1)
        kernels.push(self._heads, self._entries, p[0], 0, self._weight * h)
        self._run, self.timed_out, self.read_beside = (table, goals), False, None

    def advance(self, upto: int = UNLIMITED) -> int:
        """Search on until something is found, nothing is left, or `upto` states are expanded: then return PAUSED."""
        p, (table, goals), limit = self.settings, self._run, self.time_limit
        all_shapes = (self.shape.rows, table.samples, goals)
        p["pause_at"] = upto if limit is None else min(upto, int(p["expanded"][0]) + limit.interval)
        while True:
            status = int(
                kernels.search(
                    self.costs,
                    self._bits,
                    all_shapes,
                    table.primitives,
                    table.headings,
                    self._nodes,
                    (self._slots, self._heads, self._front),
                    self._entries,
                    self._field,
                    self._table,
                    p,
                )
            )
            if status == kernels.GROW:
                self._grow()
            elif status != kernels.PAUSED or p["expanded"][0] >= upto:
                return status
            elif limit is not None and time.monotonic() >= limit.deadline:
                self.timed_out = True
                return kernels.FOUND if p["best_cost"][0] < np.inf else kernels.LIMIT
            else:
                p["pause_at"] = min(upto, int(p["expanded"][0]) + (upto if limit is None else limit.interval))

    def may_connect(self, start: Pose) -> bool:
        """Return False if it is certain that no path leads from `start` to the goal, for this footprint at any heading."""
        return may_connect(self.costs, self._bits, self.shape, (self._field, self._front), self.settings, start)

    def _write_root(self, start: Pose, start_bin: int) -> None:
        """Write the node of the start."""
        root, cell = self._nodes[0], int(start[1]) * self.costs.shape[1] + int(start[0])
        root["x"], root["y"], root["g"], root["parent"], root["primitive"] = start[0], start[1], 0.0, -1, -1
        root["heading"], root["closed"], root["direction"] = start_bin, 0, 0
        key = cell * int(self.settings["bins"][0]) + start_bin
        root["key"] = 2 * key if self.settings["cusp"][0] > 0.0 else key

    def furthest(self, resolution: float, origin_x: float, origin_y: float) -> tuple[float, float, float]:
        """The state of the last search with the least way left over the cells to the goal: x, y (m), yaw."""
        nodes = self._nodes[: int(self.settings["nodes"][0])]
        factor = int(self.settings["factor"][0])
        width = (self.costs.shape[1] + factor - 1) // factor
        cells = (nodes["y"].astype(np.int64) // factor) * width + nodes["x"].astype(np.int64) // factor
        left = self._field["cost"][cells]
        best = nodes[int(np.argmin(np.where(left > 0.0, left, np.inf)))]
        yaw = float(self._yaws[int(best["heading"])])
        x, y = float(best["x"]) * resolution + origin_x, float(best["y"]) * resolution + origin_y
        return x, y, math.remainder(yaw, 2.0 * math.pi)

    def farthest_from(self, x: float, y: float) -> float:
        """The largest distance of a state of the last search from a point."""
        nodes = self._nodes[: int(self.settings["nodes"][0])]
        return float(np.hypot(nodes["x"] - x, nodes["y"] - y).max())

    def _curve_table(self) -> NDArray[np.float32]:
        """The table of the lengths of curves."""
        p = self.settings[0]
        radius, cusp = float(p["radius"]), float(p["cusp"])
        return curve_table(int(p["half"]), int(p["bins"]), radius, cusp if p["reeds_shepp"] else None)

    @property
    def window(self) -> Window:
        """Contains all cells that the heuristic and the search have read."""
        p, (ny, nx) = self.settings[0], self.costs.shape
        factor = int(p["factor"])
        margin = math.ceil(self._margin + 4.0 * float(p["reach"]) + float(p["tolerance"])) + 2 * factor + 4
        x0, y0 = factor * int(p["low_x"]) - margin, factor * int(p["low_y"]) - margin
        x1, y1 = factor * (int(p["high_x"]) + 1) + margin, factor * (int(p["high_y"]) + 1) + margin
        read = Window(max(0, x0), max(0, y0), min(nx, x1), min(ny, y1))
        return read if self.read_beside is None else union(read, self.read_beside)

    def remember(self, outcome: Outcome) -> None:
        """Keep the heuristic and the path as long as the costs that they depend on stay as they are now.

        A path that took so long that the weight of the heuristic was raised is not kept: the next search may find a better one.
        """
        window = self.window
        self._read = window, self.costs[window.slices].copy()
        good = outcome.reached and self.settings["weight"][0] == self._weight
        self._last = (outcome.segments, outcome.end, self._outline()) if good else None

    def _outline(self) -> NDArray[np.float64]:
        """What the footprint of a search consists of, without the scratch rows."""
        return np.delete(self.shape.rows, (2, 3, 4, 5), axis=0)

    def follow(self, start: Pose, goals: NDArray[np.float64]) -> Outcome | None:
        """The rest of the last path, from a pose next to it: if its goal, footprint and costs are the same, None otherwise.

        It is as far above the least cost as the whole path was, and by the way back onto it.
        """
        if self._last is None or not self._unchanged:
            return None
        segments, end, outline = self._last
        if not (goals[:, :3] == end).all(axis=1).any() or not np.array_equal(outline, self._outline()):
            return None
        p, values = self.settings[0], np.zeros(len(segments))
        paths.pieces_cost(self.costs, p, segments, values)
        fresh, rest = rejoin(self.costs, self._bits, self.shape.rows, p, segments, values, end, start, self._added)
        if fresh == 0:
            return None
        path = np.concatenate([self._added[:fresh], segments[rest:]])
        return Outcome(kernels.FOUND, path, end, self.cost_of(path), 0, 0, start[:2], False)

    def cost_of(self, segments: NDArray[np.void]) -> float:
        """The cost of a path."""
        count = len(segments)
        values = np.zeros(count)
        paths.pieces_cost(self.costs, self.settings[0], segments, values)
        changes = int(paths.directions_around(segments, 0, count, count)[2])
        return float(values.sum()) + float(self.settings["cusp"][0]) * changes

    def _clear_nodes(self) -> None:
        """Empty the arrays of the nodes; return what a large search needed."""
        if len(self._nodes) > FIRST_NODES:
            self._nodes, self._entries = np.empty(FIRST_NODES, NODE), np.empty(2 * FIRST_NODES, ENTRY)
            self._slots = np.zeros(4 * FIRST_NODES, np.int32)
        else:
            self._slots[:] = 0

    def _clear_queue(self, estimate: float) -> None:
        """Empty the queue; lengthen it for costs of this order."""
        needed, count = 2.0 * max(self._weight, kernels.GREATEST) * estimate, len(self._heads)
        while count * kernels.BUCKET < needed and count < MOST_BUCKETS:
            count *= 2
        self._heads = np.full(count, -1, np.int32)

    def _grow(self) -> None:
        """Double the arrays of the nodes."""
        self._nodes = np.concatenate([self._nodes, np.empty(len(self._nodes), NODE)])
        self._entries = np.concatenate([self._entries, np.empty(len(self._entries), ENTRY)])
        if 4 * len(self._nodes) > len(self._slots):
            self._slots = np.zeros(4 * len(self._nodes), np.int32)
            kernels.rehash(self._slots, self._nodes, int(self.settings["nodes"][0]))

    def outcome(self, status: int, *, shorten: bool) -> Outcome:
        """What the search found, which ended with `status`."""
        table, goals = self._run
        p = self.settings[0]
        near = self._nodes[int(p["approach_node"])]
        nearest = (float(near["x"]), float(near["y"]))
        expanded, visited = int(p["expanded"]), int(p["nodes"])
        if status == kernels.FOUND:
            last, cost = int(p["best_node"]), float(p["best_cost"])
        elif float(p["approach_distance"]) <= float(p["tolerance"]):
            status = kernels.APPROACHED
            last, cost = int(p["approach_node"]), float(near["g"])
        else:
            return Outcome(
                status, np.zeros(0, SEGMENT), (0.0, 0.0, 0.0), math.inf, expanded, visited, nearest, self.timed_out
            )
        node = self._nodes[last]
        heading = table.headings[int(node["heading"])]
        end = (float(node["x"]), float(node["y"]), float(heading["yaw"]))
        goal = end
        steps = paths.trace(self._nodes, table.primitives, table.headings, table.pieces, last, np.zeros(0, SEGMENT))
        segments = np.zeros(steps + 256, SEGMENT)
        paths.trace(self._nodes, table.primitives, table.headings, table.pieces, last, segments)
        count = int(steps)
        if status == kernels.FOUND and p["best_is_curve"]:
            x, y, yaw = (float(v) for v in goals[int(p["best_goal"]), :3])
            goal = (x, y, yaw)
            if p["holonomic"]:
                count = int(paths.write_line(segments, count, end, goal))
            elif p["best_is_curve"] == kernels.PIVOT:
                count = int(paths.write_pivot(segments, count, end, goal))
            else:
                count = self._write_curve(segments, count, end, goal, int(node["direction"]))
        segments = segments[:count]
        if shorten and count > 1:
            segments = self.shortened(segments, goal)
            cost = self.cost_of(segments)
        return Outcome(status, segments, goal, cost, expanded, visited, nearest, self.timed_out)

    def shortened(self, segments: NDArray[np.void], goal: Pose) -> NDArray[np.void]:
        """Return a path with stretches replaced by cheaper ones."""
        p, count = self.settings[0], len(segments)
        room = np.zeros(count + 768, SEGMENT)
        room[:count] = segments
        values = np.zeros(len(room))
        arguments = self.costs, self._bits, self.shape.rows, p, room, self._added, values
        count = int(paths.shorten(*arguments, count, goal))
        for reach in REACHES:
            count = int(paths.relax(*arguments, count, goal, reach))
        return room[: int(paths.shorten(*arguments, count, goal))]

    def _write_curve(self, segments: NDArray[np.void], count: int, start: Pose, goal: Pose, before: int) -> int:
        """Write the curve that the search found, and the straight way after it; `before`: direction of travel at its start."""
        p = self.settings[0]
        tail = float(p["best_tail"])
        stage = (goal[0] - tail * math.cos(goal[2]), goal[1] - tail * math.sin(goal[2]), goal[2])
        ends = before, int(np.sign(tail))
        count = int(paths.write_curve(segments, count, p, start, stage, float(p["best_radius"]), ends))
        pieces = math.ceil(abs(tail) / paths.PIECE)
        for k in range(pieces):
            x, y = (stage[i] + (goal[i] - stage[i]) * k / pieces for i in (0, 1))
            paths.write_segment(segments, count + k, STRAIGHT, x, y, goal[2], tail / pieces, 1.0)
        return count + pieces
