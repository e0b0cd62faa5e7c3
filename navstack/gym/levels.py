"""Levels: worlds with a start and a goal, from scenarios, suites, maps and BARN, in a training and a held-out half."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

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
        split: `train`: every second level from the first; `held_out`: the others; `all`.
        count: number of levels of the split; needed where levels are generated (default: 16).
        seed: of generated levels.
        radius: starts and goals drawn on a map, and paths, keep this distance (m) from obstacles.

    Raises InputError, ScenarioError, MapError.
    """
    if split not in SPLITS:
        raise InputError(f'unknown split "{split}"; known splits: {", ".join(SPLITS)}', split=split)
    if count is not None and count < 1:
        raise InputError(f"count is {count}; it must be at least 1", count=count)
    if isinstance(source, (str, Path, ScenarioSpec, BarnWorld, Level)):
        found = _read(source, split, count, seed, radius)
    else:
        whole = [level for item in source for level in _read(item, "all", None, seed, radius)]
        found = _of_split(whole, split, count)
    if not found:
        raise InputError(
            f"{source!r} has no level in the split {split}; use split='all'", levels=str(source), split=split
        )
    return found


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
    known = [BARN_NAME, *shipped_scenarios(), *suite_names(), *(f"map:{name}" for name in map_names())]
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
    path = shortest_path(world, spec.start, spec.goals[0], radius)
    limit = float(spec.values.get("time_limit_s", 60.0))
    return Level(
        spec.name, world, spec.start, spec.goals[0], length=_length(path), time_limit=limit, path=path, spec=spec
    )


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
        path = shortest_path(world, start, goal, radius)
        length = _length(path)
        limit = max(30.0, 10.0 * length)
        spec = single_goal_spec(f"{file.stem} {number}", start, goal, limit, map_file=file)
        levels.append(Level(spec.name, world, start, goal, length=length, time_limit=limit, path=path, spec=spec))
    return levels


def shortest_path(world: World, start: Pose2D, goal: Pose2D, radius: float) -> NDArray[np.float64]:
    """Return (k, 2) points of a shortest path of a disc of `radius` (m) on a grid; a straight line if there is none."""
    points = _path_on_grid(world, start, goal, radius)
    return np.array([start[:2], goal[:2]]) if points is None else points


def _path_on_grid(
    world: World, start: Pose2D, goal: Pose2D, radius: float, half_width: float = math.inf
) -> NDArray[np.float64] | None:
    """Return the path, None if there is none; `half_width`: largest distance (m) of its points from x = 0."""
    ends = np.array([start[:2], goal[:2]])
    solids = world.solids_at(0.0)
    corners = [ends, solids.discs[:, :2], solids.circles[:, :2]]
    geometry = world.map.geometry
    if (world.map.data >= OCCUPIED).any():
        reach = math.hypot(geometry.width_m, geometry.height_m)
        low, high = np.array([geometry.origin_x, geometry.origin_y]), np.array([geometry.width_m, geometry.height_m])
        corners.append(np.array([low, low + (high if world.map.origin_yaw == 0.0 else reach)]))
    box = np.concatenate(corners)
    low, high = box.min(axis=0) - 0.5, box.max(axis=0) + 0.5
    low[0], high[0] = max(low[0], -half_width), min(high[0], half_width)
    cell = max(0.1, math.sqrt(float(np.prod(high - low)) / 60_000.0))
    nx, ny = (np.ceil((high - low) / cell).astype(int) + 1).tolist()
    grid_x, grid_y = np.meshgrid(low[0] + cell * np.arange(nx), low[1] + cell * np.arange(ny))
    poses = np.zeros((nx * ny, 3))
    poses[:, 0], poses[:, 1] = grid_x.ravel(), grid_y.ravel()
    clear = np.full(len(poses), math.inf)
    if len(corners) > 3 or len(solids.circles):
        nothing = np.empty((0, 3))
        clear = world.clearances(poses, None, solids._replace(discs=nothing, tops=solids.polygon_tops))
    for size in np.unique(solids.discs[:, 2]).tolist():
        tree = cKDTree(solids.discs[solids.discs[:, 2] == size, :2])
        clear = np.minimum(clear, tree.query(poses[:, :2])[0] - size)
    free = (clear >= radius).reshape(ny, nx)
    index = np.arange(nx * ny).reshape(ny, nx)
    rows: list[NDArray[np.int64]] = []
    columns: list[NDArray[np.int64]] = []
    weights: list[NDArray[np.float64]] = []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        here = (slice(max(-dy, 0), ny - max(dy, 0)), slice(0, nx - dx))
        there = (slice(max(dy, 0), ny + min(dy, 0)), slice(dx, nx))
        both = free[here] & free[there]
        rows.append(index[here][both])
        columns.append(index[there][both])
        weights.append(np.full(int(both.sum()), cell * math.hypot(dx, dy)))
    size = nx * ny
    graph = coo_matrix((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), (size, size))
    free_points = np.flatnonzero(free)
    if not len(free_points):
        return None
    nearest_cells = [free_points[np.argmin(np.hypot(*(poses[free_points, :2] - end).T))] for end in ends]
    found = dijkstra(graph.tocsr(), directed=False, indices=int(nearest_cells[1]), return_predecessors=True)
    distances, before = found[0], found[1]
    if not np.isfinite(distances[nearest_cells[0]]):
        return None
    at, cells = int(nearest_cells[0]), list[int]()
    while at >= 0:
        cells.append(at)
        at = int(before[at])
    return np.concatenate((ends[:1], poses[cells[1:-1], :2], ends[1:]))


def _length(path: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


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
    path = _path_on_grid(place, START, GOAL, ROBOT_HALF_WIDTH_M, HALF_WIDTH_M)
    if path is None:
        path = np.array([START[:2], GOAL[:2]])
    spec = barn_spec(world)
    length, limit = world.optimal_length_m, float(spec.values["time_limit_s"])
    return Level(spec.name, place, START, GOAL, BARN_TOLERANCE_M, math.inf, length, limit, path, spec)


def generated_barn_worlds(numbers: Sequence[int], seed: int = 0) -> list[BarnWorld]:
    """Return worlds made as BARN's are; the same number and seed give the same world."""
    return [_generated_barn_world(number, seed) for number in numbers]


@lru_cache(maxsize=4096)
def _generated_barn_world(number: int, seed: int) -> BarnWorld:
    fill = FILLS[number % len(FILLS)]
    smoothings = SMOOTHINGS[number // len(FILLS) % len(SMOOTHINGS)]
    rng = np.random.Generator(np.random.PCG64([seed, 40, number]))
    while True:
        discs = _cylinders(_smoothed(rng.random((CELLS, CELLS)) < fill, smoothings))
        path = _path_on_grid(World(None, discs), START, GOAL, ROBOT_HALF_WIDTH_M, HALF_WIDTH_M)
        if path is not None:
            return BarnWorld(number, discs, _length(path))


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
    """Return the discs (n, 3) of the filled cells and of the walls before the field (m)."""
    column, row = np.nonzero(cells)
    left = -0.5 * CELL_M * (CELLS - 1)
    x, y = left + CELL_M * column, FIELD_Y_M + CELL_M * row
    before = np.arange(WALL_FROM_M, FIELD_Y_M - 0.5 * CELL_M, CELL_M)
    walls = np.column_stack((np.repeat([left, -left], len(before)), np.tile(before, 2)))
    centers = np.concatenate((np.column_stack((x, y)), walls))
    return np.column_stack((centers, np.full(len(centers), 0.5 * CELL_M)))
