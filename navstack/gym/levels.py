"""Levels: worlds with a start and a goal, from scenarios, suites, maps and BARN, in a training and a held-out half."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from navstack.core import InputError, Pose2D
from navstack.map_io import load_map, map_names, map_path
from navstack.parameters import nearest
from navstack.scenario import (
    GOAL,
    START,
    WORLDS_FILE,
    BarnWorld,
    FreeSpace,
    ScenarioSpec,
    barn_spec,
    is_scenario_file,
    load_suite,
    load_worlds,
    read_scenario,
    shipped_scenarios,
    single_goal_spec,
    suite_names,
)
from navstack.sim import OCCUPIED, World

Split = Literal["train", "held_out", "all"]
SPLITS: Final = {"train": (0, 2), "held_out": (1, 2), "all": (0, 1)}
"""First level and step of each split, as in the suites."""
BARN_TOLERANCE_M: Final = 1.0
"""A run through a BARN world succeeds within this distance of the goal."""
BARN_NAME: Final = "barn"
DEFAULT_TOLERANCE_M: Final = 0.3
DEFAULT_COUNT: Final = 16


@dataclass(frozen=True, eq=False)
class Level:
    """A world with a start and a goal."""

    name: str
    world: World
    """Levels with the same world share the object."""
    start: Pose2D
    goal: Pose2D
    tolerance: float = DEFAULT_TOLERANCE_M
    """Distance (m) at which the goal is reached."""
    yaw_tolerance: float = math.inf
    """Heading error (rad) at which it is; inf: any heading."""
    length: float = 0.0
    """Length of the shortest path (m)."""
    time_limit: float = 60.0
    """Seconds until the episode is truncated."""
    path: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)), repr=False)
    """(k, 2) points of a path from the start to the goal (m), which the observation `plan` shows."""
    spec: ScenarioSpec | None = field(default=None, repr=False)
    """The scenario, for the environments that run the whole stack."""

    def __repr__(self) -> str:
        start, goal = self.start, self.goal
        return f"Level({self.name!r}, from ({start.x:.2f}, {start.y:.2f}) to ({goal.x:.2f}, {goal.y:.2f}), {self.length:.1f} m)"


Levels = str | Path | ScenarioSpec | BarnWorld | Level
"""What a level, or several, may be given as."""


def read_levels(
    source: Levels | Sequence[Levels],
    *,
    split: str = "all",
    count: int | None = None,
    seed: int = 0,
    radius: float = 0.2,
) -> list[Level]:
    """Return the levels of a source.

    Args:
        source: `barn` (worlds generated like those of BARN), the folder or file of BARN's `worlds.npz`, a suite, a scenario by
            name or file, `map:NAME` or `map:FILE.yaml` (random starts and goals on a map), worlds and scenarios as objects; or
            a list of these.
        split: `train`: every second level of a named source from the first; `held_out`: the others; `all`.
        count: number of levels of a named source; where they are generated, 16 by default.
        seed: of generated levels.
        radius: starts and goals drawn on a map, and paths, keep this distance (m) from obstacles.

    Raises InputError, ScenarioError, MapError.
    """
    if split not in SPLITS:
        raise InputError(f'unknown split "{split}"; known splits: {", ".join(SPLITS)}', split=split)
    if count is not None and count < 1:
        raise InputError(f"count is {count}; it must be at least 1", count=count)
    sources = [source] if isinstance(source, (str, Path, ScenarioSpec, BarnWorld, Level)) else list(source)
    found = [level for item in sources for level in _read(item, split, count, seed, radius)]
    if not found:
        raise InputError(f"{source!r} has no level in the split {split}; use split='all'", split=split)
    return found


def level_number(level: Any, names: Sequence[str]) -> int:
    """Return the number of a level given by name or number. Raises InputError."""
    if isinstance(level, str):
        if level in names:
            return names.index(level)
        close = nearest(level, list(names))
        hint = f'did you mean "{close}"?' if close else f"levels: {', '.join(names[:20])}{', ..' * (len(names) > 20)}"
        raise InputError(f'there is no level "{level}"; {hint}', level=level)
    if isinstance(level, (int, np.integer)) and 0 <= level < len(names):
        return int(level)
    raise InputError(f"the level is {level!r}; give a name, or a number of 0 .. {len(names) - 1}")


def level_weights(weights: Sequence[float], number: int) -> NDArray[np.float64]:
    """Return the weights (n,) by which levels are drawn. Raises InputError."""
    try:
        values = np.asarray(weights, np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    valid = values.shape == (number,) and bool(np.isfinite(values).all() and (values >= 0.0).all())
    if not (valid and values.sum() > 0.0):
        raise InputError(f"give {number} weights of at least 0, not all 0: one per level")
    return values


def _of_split(levels: list[Level], split: str, count: int | None) -> list[Level]:
    first, step = SPLITS[split]
    return levels[first::step][:count]


def _read(source: Levels, split: str, count: int | None, seed: int, radius: float) -> list[Level]:
    if isinstance(source, Level):
        return [source]
    if isinstance(source, BarnWorld):
        return [barn_level(source)]
    if isinstance(source, ScenarioSpec):
        return [scenario_level(source, radius)]
    first, step = SPLITS[split]
    text = str(source)
    if text == BARN_NAME:
        numbers = range(first, first + step * (count or DEFAULT_COUNT), step)
        return [barn_level(world) for world in generated_barn_worlds(numbers, seed)]
    if text.startswith("map:"):
        return map_levels(text[4:], range(first, first + step * (count or DEFAULT_COUNT), step), seed, radius)
    path = Path(text)
    if path.suffix == ".npz" or (path / WORLDS_FILE).is_file():
        worlds = load_worlds(path / WORLDS_FILE if path.is_dir() else path)
        return _of_split([barn_level(world) for world in worlds], split, count)
    if text in shipped_scenarios():
        return [scenario_level(read_scenario(shipped_scenarios()[text]), radius)]
    if text in suite_names():
        specs = load_suite(text, split=split, count=count)  # pyright: ignore[reportArgumentType]
        return [scenario_level(spec, radius) for spec in specs if spec.start is not None and spec.goals]
    if path.is_file() and is_scenario_file(path):
        return [scenario_level(read_scenario(path), radius)]
    # a suite may have the name of a scenario
    maps = (f"map:{name}" for name in map_names())
    known = list(dict.fromkeys((BARN_NAME, *shipped_scenarios(), *suite_names(), *maps)))
    close = nearest(text, known)
    hint = (
        f'did you mean "{close}"?'
        if close
        else f"known: {', '.join(known)}, scenario files, folders with {WORLDS_FILE}"
    )
    raise InputError(f'unknown levels "{text}"; {hint}', levels=text, known=known)


# --- scenarios, maps --------------------------------------------------------------------------------------------------


def scenario_level(spec: ScenarioSpec, radius: float = 0.2) -> Level:
    """Return the level of a scenario: its start and its first goal. Raises InputError for one without a goal."""
    if spec.start is None or not spec.goals:
        raise InputError(
            f'the scenario "{spec.name}" has no goal to drive to (motions and tours are no levels); give one with goals',
            scenario=spec.name,
        )
    world = World(spec.map(), shapes=spec.shapes)
    path, length = _planned(world, spec.start, spec.goals[0], radius)
    limit = float(spec.values.get("time_limit_s", 60.0))
    return Level(spec.name, world, spec.start, spec.goals[0], length=length, time_limit=limit, path=path, spec=spec)


def map_levels(name: str, numbers: Sequence[int], seed: int, radius: float) -> list[Level]:
    """Return levels with random starts and goals, 2 m or more apart, on a map; the same number gives the same level."""
    file = map_path(name) if name in map_names() else Path(name)
    grid = load_map(file)
    space = FreeSpace(grid, radius + 0.1)
    if space.is_empty:
        raise InputError(f"a robot of {radius:g} m radius fits nowhere on the map {name}; use another map", map=name)
    world = World(grid)
    levels: list[Level] = []
    for number in numbers:
        rng = np.random.Generator(np.random.PCG64([seed, 41, number]))
        start, goal = space.draw_pair(rng, 2.0, math.inf)
        path, length = _planned(world, start, goal, radius)
        limit = max(30.0, 10.0 * length)
        spec = single_goal_spec(f"{file.stem} {number}", start, goal, limit, map_file=file)
        levels.append(Level(spec.name, world, start, goal, length=length, time_limit=limit, path=path, spec=spec))
    return levels


class _Grid:
    """Points of a grid over a world, with their clearance, joined in 8 directions where a disc of `radius` (m) fits."""

    def __init__(self, world: World, ends: NDArray[np.float64], radius: float, half_width: float) -> None:
        solids = world.solids_at(0.0)
        round_ones = np.concatenate((solids.discs, solids.circles))
        centers, extents = round_ones[:, :2], round_ones[:, 2:]
        corners = [ends, centers - extents, centers + extents]
        geometry = world.map.geometry
        has_cells = bool((world.map.data >= OCCUPIED).any())
        if has_cells:
            low, size = np.array([geometry.origin_x, geometry.origin_y]), [geometry.width_m, geometry.height_m]
            c, s = math.cos(world.map.origin_yaw), math.sin(world.map.origin_yaw)
            box = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * size
            corners.append(low + box @ np.array([[c, s], [-s, c]]))
        box = np.concatenate(corners)
        margin = 0.5 + 2.0 * radius  # a way around everything
        low, high = box.min(axis=0) - margin, box.max(axis=0) + margin
        low[0], high[0] = max(low[0], -half_width), min(high[0], half_width)
        self.cell = cell = max(0.1, math.sqrt(float(np.prod(high - low)) / 60_000.0))
        self.nx, self.ny = (np.ceil((high - low) / cell).astype(int) + 1).tolist()
        grid_x, grid_y = np.meshgrid(low[0] + cell * np.arange(self.nx), low[1] + cell * np.arange(self.ny))
        self.points = np.column_stack((grid_x.ravel(), grid_y.ravel()))
        clear = np.full(len(self.points), math.inf)
        if has_cells or len(solids.circles):
            nothing = np.empty((0, 3))
            poses = np.column_stack((self.points, np.zeros(len(self.points))))
            clear = world.clearances(poses, None, solids._replace(discs=nothing, tops=solids.polygon_tops))
        for size in np.unique(solids.discs[:, 2]).tolist():
            tree = KDTree(solids.discs[solids.discs[:, 2] == size, :2])
            clear = np.minimum(clear, tree.query(self.points)[0] - size)
        self.clear, self.radius = clear, radius
        self.free = np.flatnonzero(clear >= radius)

    def nearest(self, point: NDArray[np.float64]) -> int:
        """Return the number of the nearest point where the disc fits."""
        return int(self.free[np.argmin(np.hypot(*(self.points[self.free] - point).T))])

    def search(self, goal: int, factors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return costs to the goal (n,) and the next point on the way there (n,); `factors` (n,): cost of a meter."""
        free = np.zeros(len(self.points), np.bool_)
        free[self.free] = True
        free = free.reshape(self.ny, self.nx)
        index = np.arange(len(self.points)).reshape(self.ny, self.nx)
        rows: list[NDArray[np.int64]] = []
        columns: list[NDArray[np.int64]] = []
        steps: list[NDArray[np.float64]] = []
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            here = (slice(max(-dy, 0), self.ny - max(dy, 0)), slice(0, self.nx - dx))
            there = (slice(max(dy, 0), self.ny + min(dy, 0)), slice(dx, self.nx))
            both = free[here] & free[there]
            rows.append(index[here][both])
            columns.append(index[there][both])
            steps.append(np.full(int(both.sum()), self.cell * math.hypot(dx, dy)))
        row, column = np.concatenate(rows), np.concatenate(columns)
        weights = np.concatenate(steps) * 0.5 * (factors[row] + factors[column])
        graph = coo_matrix((weights, (row, column)), (len(self.points), len(self.points))).tocsr()
        found = dijkstra(graph, directed=False, indices=goal, return_predecessors=True)
        return found[0], found[1]


def plan_path(
    world: World, start: Pose2D, goal: Pose2D, radius: float, half_width: float = math.inf
) -> tuple[NDArray[np.float64], float] | None:
    """Return (k, 2) points of a path for a disc of `radius` (m), and the length of the shortest one; None if there is none.

    The path keeps its distance from obstacles as navfn's plans do: a meter costs 1 + 4 exp(-5 (clearance - radius)), the costs
    of ROS's inflation. `half_width`: largest distance (m) of its points from x = 0.
    """
    return _route(_Grid(world, np.array([start[:2], goal[:2]]), radius, half_width), start, goal)


def plan_paths(
    world: World, pairs: Sequence[tuple[Pose2D, Pose2D]], radius: float
) -> list[tuple[NDArray[np.float64], float] | None]:
    """Return what `plan_path` does for several pairs of a start and a goal in one world."""
    grid = _Grid(world, np.array([pose[:2] for pair in pairs for pose in pair]), radius, math.inf)
    return [_route(grid, start, goal) for start, goal in pairs]


def _route(grid: _Grid, start: Pose2D, goal: Pose2D) -> tuple[NDArray[np.float64], float] | None:
    if not len(grid.free):
        return None
    ends = np.array([start[:2], goal[:2]])
    first, last = grid.nearest(ends[0]), grid.nearest(ends[1])
    distances, _ = grid.search(last, np.ones(len(grid.points)))
    if not np.isfinite(distances[first]):
        return None
    _, following = grid.search(last, 1.0 + 4.0 * np.exp(-5.0 * np.maximum(grid.clear - grid.radius, 0.0)))
    at, cells = first, list[int]()
    while at >= 0:
        cells.append(at)
        at = int(following[at])
    return np.concatenate((ends[:1], grid.points[cells[1:-1]], ends[1:])), float(distances[first])


def _planned(world: World, start: Pose2D, goal: Pose2D, radius: float) -> tuple[NDArray[np.float64], float]:
    """As `plan_path`, the straight line if there is no path."""
    found = plan_path(world, start, goal, radius)
    return found if found is not None else (np.array([start[:2], goal[:2]]), start.distance_to(goal))


# --- BARN -------------------------------------------------------------------------------------------------------------
# Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020: cells of 0.15 m are filled at random, then
# smoothed by a cellular automaton; filled cells are cylinders between two walls.

CELL_M: Final = 0.15
CELLS: Final = 30
"""Cells on each side of the field."""
FILLS: Final = (0.15, 0.20, 0.25, 0.30)
SMOOTHINGS: Final = (2, 3, 4)
FIELD_Y_M: Final = 2.175
"""Center of the field's first row, in the robot's frame at the start."""
WALL_FROM_M: Final = -2.925
HALF_WIDTH_M: Final = 2.1
"""The walls are at this distance from the middle, and a little more."""
ROBOT_HALF_WIDTH_M: Final = 0.22
"""Clearance that some path through the world has."""


def barn_level(world: BarnWorld) -> Level:
    """Return the level of a BARN world."""
    # without the empty map of the scenario, whose rays would have to cross it
    place = World(None, world.discs)
    found = plan_path(place, START, GOAL, ROBOT_HALF_WIDTH_M, HALF_WIDTH_M)
    path = np.array([START[:2], GOAL[:2]]) if found is None else found[0]
    spec = barn_spec(world)
    length, limit = world.optimal_length_m, float(spec.values["time_limit_s"])
    return Level(spec.name, place, START, GOAL, BARN_TOLERANCE_M, math.inf, length, limit, path, spec)


def generated_barn_worlds(numbers: Sequence[int], seed: int = 0) -> list[BarnWorld]:
    """Return worlds made as BARN's are; the same number and seed give the same world."""
    return [_generated_barn_world(number, seed) for number in numbers]


@lru_cache(maxsize=4096)
def _generated_barn_world(number: int, seed: int) -> BarnWorld:
    # pairs of numbers: both splits have every combination
    fill = FILLS[number // 2 % len(FILLS)]
    smoothings = SMOOTHINGS[number // (2 * len(FILLS)) % len(SMOOTHINGS)]
    rng = np.random.Generator(np.random.PCG64([seed, 40, number]))
    while True:
        discs = _cylinders(_smoothed(rng.random((CELLS, CELLS)) < fill, smoothings))
        found = plan_path(World(None, discs), START, GOAL, ROBOT_HALF_WIDTH_M, HALF_WIDTH_M)
        if found is not None:
            return BarnWorld(number, discs, found[1])


def _smoothed(filled: NDArray[np.bool_], times: int) -> NDArray[np.bool_]:
    """Return cells (columns x, rows y) after the automaton: more than 4 neighbors fill a cell, less than 2 empty it.

    The first and the last column are the walls; what is outside of them counts as filled.
    """
    cells = filled.copy()
    cells[0] = cells[-1] = True
    kernel = np.ones((3, 3), int)
    kernel[1, 1] = 0
    for _ in range(times):
        outside = np.pad(cells, ((1, 1), (0, 0)), constant_values=True).astype(int)
        neighbors = ndimage.convolve(outside, kernel, mode="constant", cval=0)[1:-1]
        # the corners beyond a wall's ends are outside, too
        neighbors[[0, -1], 0] += 1
        neighbors[[0, -1], -1] += 1
        cells = np.where(neighbors > 4, True, np.where(neighbors < 2, False, cells))
    return cells


def _cylinders(cells: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the discs (n, 3) of the filled cells, of the walls before the field and of the wall behind the start (m)."""
    column, row = np.nonzero(cells)
    left = -0.5 * CELL_M * (CELLS - 1)
    x, y = left + CELL_M * column, FIELD_Y_M + CELL_M * row
    before = np.arange(WALL_FROM_M, FIELD_Y_M - 0.5 * CELL_M, CELL_M)
    sides = np.column_stack((np.repeat([left, -left], len(before)), np.tile(before, 2)))
    across = left + CELL_M * np.arange(1, CELLS - 1)
    behind = np.column_stack((across, np.full(len(across), WALL_FROM_M)))
    centers = np.concatenate((np.column_stack((x, y)), sides, behind))
    return np.column_stack((centers, np.full(len(centers), 0.5 * CELL_M)))
