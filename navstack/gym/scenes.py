"""Scenes: worlds with a start and a goal for each of several robots, drawn, from fleet files and on maps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely

from navstack.core import InputError, Pose2D
from navstack.fleet import is_fleet_file, read_fleet, shipped_fleets
from navstack.gym.levels import SPLITS, Level, plan_paths
from navstack.map_io import load_map, map_names, map_path
from navstack.parameters import nearest
from navstack.scenario import FreeSpace
from navstack.sim import Shape, World

DEFAULT_AGENTS: Final = 4
DEFAULT_SCENES: Final = 4
APART_M: Final = 0.3
"""Least distance between the circles around two robots at their starts, and at their goals."""
CLEAR_M: Final = 0.15
"""Least distance of starts and goals from obstacles."""
TRIES: Final = 3000
Layout = tuple[list[Shape], list[Pose2D], list[Pose2D]]
"""Obstacles, starts and goals."""


@dataclass(frozen=True, eq=False)
class Scene:
    """One world, and a level in it for each robot."""

    name: str
    levels: tuple[Level, ...]
    """They share the world; each has the start and the goal of one robot."""


Scenes = str | Path | Scene
"""What a scene, or several, may be given as."""


def read_scenes(
    source: Scenes | Sequence[Scenes],
    *,
    agents: int | None = None,
    split: str = "all",
    count: int | None = None,
    seed: int = 0,
    radius: float = 0.2,
) -> list[Scene]:
    """Return the scenes of a source; all have the same number of robots.

    Args:
        source: drawn scenes (`crossing`: across a circle; `corridor`: two groups in opposite directions; `narrow_door`: the same
            through a door for one; `random`: among random obstacles; `warehouse`: between racks), a packaged fleet by name or a
            fleet file (the start and the first goal of each robot), `map:NAME` or `map:FILE.yaml` (random starts and goals),
            a `Scene`; or a list of these.
        agents: number of robots, of sources that do not determine it; 4 by default.
        split: of the drawn scenes `train` has every second from the first, `held_out` the others, `all` all of them.
        count: number of drawn scenes; 4 by default.
        seed: of drawn scenes.
        radius: of the circle around a robot (m): starts and goals keep their distance from it.

    Raises InputError, ScenarioError, MapError.
    """
    if split not in SPLITS:
        raise InputError(f'unknown split "{split}"; known splits: {", ".join(SPLITS)}', split=split)
    for name, value in (("count", count), ("agents", agents)):
        if value is not None and value < 1:
            raise InputError(f"{name} is {value}; it must be at least 1", argument=name)
    first, step = SPLITS[split]
    numbers = range(first, first + step * (count or DEFAULT_SCENES), step)
    sources = [source] if isinstance(source, (str, Path, Scene)) else list(source)
    found = [scene for item in sources for scene in _read(item, agents, numbers, seed, radius)]
    sizes = {len(scene.levels) for scene in found}
    if not sizes:
        raise InputError("the list of scenes is empty; name one, such as crossing", scenes=[])
    if len(sizes) > 1:
        given = ", ".join(f"{scene.name}: {len(scene.levels)}" for scene in found)
        raise InputError(f"the scenes have different numbers of robots ({given}); give scenes with the same number")
    if agents not in (None, *sizes):
        raise InputError(
            f"{found[0].name} has {sizes.pop()} robots, but agents is {agents}; leave agents out", agents=agents
        )
    return found


def _read(source: Scenes, agents: int | None, numbers: Sequence[int], seed: int, radius: float) -> list[Scene]:
    if isinstance(source, Scene):
        return [source]
    text = str(source)
    if text in LAYOUTS:
        return [_drawn(text, agents or DEFAULT_AGENTS, number, seed, radius) for number in numbers]
    if text.startswith("map:"):
        return _on_map(text[4:], agents or DEFAULT_AGENTS, numbers, seed, radius)
    file = shipped_fleets().get(text, Path(text))
    if is_fleet_file(file):
        return [_of_fleet(file, radius)]
    maps = (f"map:{name}" for name in map_names())
    known = [*LAYOUTS, *shipped_fleets(), *maps]
    close = nearest(text, known)
    hint = f'did you mean "{close}"?' if close else f"known: {', '.join(known)}, fleet files"
    raise InputError(f'unknown scenes "{text}"; {hint}', scenes=text, known=known)


def _scene(
    name: str,
    world: World,
    starts: Sequence[Pose2D],
    goals: Sequence[Pose2D],
    radius: float,
    limit: float | None = None,
) -> Scene | None:
    """Return a scene; None if a robot has no path."""
    paths = plan_paths(world, list(zip(starts, goals, strict=True)), radius)
    known = [path for path in paths if path is not None]
    if len(known) < len(paths):
        return None
    limit = limit or max(30.0, 10.0 * max(length for _, length in known))
    return Scene(
        name,
        tuple(
            Level(f"{name} {k}", world, start, goal, length=length, time_limit=limit, path=path)
            for k, (start, goal, (path, length)) in enumerate(zip(starts, goals, known, strict=True))
        ),
    )


def _of_fleet(file: Path, radius: float) -> Scene:
    """Return the scene of a fleet file. Raises InputError for a robot without a goal."""
    spec = read_fleet(file)
    starts: list[Pose2D] = []
    goals: list[Pose2D] = []
    for robot in spec.robots:
        if robot.spec.start is None or not (robot.spec.goals or robot.route):
            raise InputError(
                f"{robot.name} of {file} has no goal to drive to; give it goals or a route", robot=robot.name
            )
        goal = robot.spec.goals[0] if robot.spec.goals else None
        if goal is None and spec.graph is not None:
            x, y = spec.graph.xy[spec.graph.node(robot.route[-1])].tolist()
            goal = Pose2D(x, y, 0.0)
        assert goal is not None  # the reader refuses routes without a graph
        starts.append(robot.spec.start)
        goals.append(goal)
    first = spec.robots[0].spec
    world = World(first.map(), shapes=first.shapes)
    scene = _scene(file.stem, world, starts, goals, radius, float(first.values.get("time_limit_s", 60.0)))
    if scene is None:
        raise InputError(
            f"a robot of {radius:g} m radius has no path to a goal of {file}; use a smaller one", radius=radius
        )
    return scene


# --- drawn scenes -----------------------------------------------------------------------------------------------------


def _generator(seed: int, purpose: str, number: int, attempt: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64([seed, 43, number, attempt, *purpose.encode()]))


def _drawn(name: str, agents: int, number: int, seed: int, radius: float) -> Scene:
    for attempt in range(20):
        drawn = LAYOUTS[name](_generator(seed, name, number, attempt), agents, radius)
        if drawn is not None:
            shapes, starts, goals = drawn
            scene = _scene(f"{name} {number}", World(None, shapes=shapes), starts, goals, radius + 0.05)
            if scene is not None:
                return scene
    raise InputError(f"{agents} robots of {radius:g} m radius do not fit into {name}; give fewer", agents=agents)


def _on_map(name: str, agents: int, numbers: Sequence[int], seed: int, radius: float) -> list[Scene]:
    file = map_path(name) if name in map_names() else Path(name)
    grid = load_map(file)
    space = FreeSpace(grid, radius + CLEAR_M)
    if space.is_empty:
        raise InputError(f"a robot of {radius:g} m radius fits nowhere on the map {name}; use another map", map=name)
    world = World(grid)
    scenes: list[Scene] = []
    for number in numbers:
        for attempt in range(20):
            rng = _generator(seed, "map", number, attempt)
            starts = _apart(lambda rng=rng: space.draw(rng), agents, radius)
            goals = _apart(lambda rng=rng: space.draw(rng), agents, radius, away_from=starts)
            scene = _scene(f"{file.stem} {number}", world, starts, goals, radius) if starts and goals else None
            if scene is not None:
                scenes.append(scene)
                break
        else:
            raise InputError(
                f"{agents} robots of {radius:g} m radius do not fit on the map {name}; give fewer", map=name
            )
    return scenes


def _apart(
    draw: Callable[[], Pose2D | None], number: int, radius: float, away_from: Sequence[Pose2D] | None = None
) -> list[Pose2D]:
    """Return drawn poses apart from each other, each 2 m or more from the one of its number in `away_from`; [] if in vain."""
    found: list[Pose2D] = []
    for _ in range(TRIES):
        if len(found) == number:
            return found
        pose = draw()
        if pose is None or any(pose.distance_to(other) < 2.0 * radius + APART_M for other in found):
            continue
        if away_from is None or (len(found) < len(away_from) and pose.distance_to(away_from[len(found)]) >= 2.0):
            found.append(pose)
    return found if len(found) == number else []


def _free(
    rng: np.random.Generator,
    box: tuple[float, float, float, float],
    shapes: Sequence[Shape],
    radius: float,
    yaw: float | None = None,
) -> Callable[[], Pose2D | None]:
    """Return a function that draws a pose in a box (x, y, x, y) away from the shapes, or None."""
    solid = shapely.union_all([_outline(shape) for shape in shapes])
    shapely.prepare(solid)

    def draw() -> Pose2D | None:
        x, y = rng.uniform(box[0] + radius, box[2] - radius), rng.uniform(box[1] + radius, box[3] - radius)
        turn = rng.uniform(-math.pi, math.pi)
        near = shapely.dwithin(solid, shapely.Point(x, y), radius + CLEAR_M)
        return None if near else Pose2D(x, y, turn if yaw is None else yaw)

    return draw


def _outline(shape: Shape) -> shapely.Geometry:
    assert shape.box is not None
    (length, width), (x, y, yaw) = shape.box, shape.pose
    box = shapely.box(x - 0.5 * length, y - 0.5 * width, x + 0.5 * length, y + 0.5 * width)
    return shapely.affinity.rotate(box, yaw, (x, y), use_radians=True)


def _box(x: float, y: float, length: float, width: float, yaw: float = 0.0) -> Shape:
    return Shape(box=[length, width], pose=[x, y, yaw])


def _walls(half_x: float, half_y: float) -> list[Shape]:
    """Return four walls around a room that reaches from -half to half."""
    beside = [_box(s * (half_x + 0.1), 0.0, 0.2, 2.0 * half_y + 0.4) for s in (-1.0, 1.0)]
    return [*beside, *(_box(0.0, s * (half_y + 0.1), 2.0 * half_x, 0.2) for s in (-1.0, 1.0))]


def _crossing(rng: np.random.Generator, agents: int, radius: float) -> Layout | None:
    """From around a circle to the other side, without obstacles, as in CrowdNav."""
    around = max(3.0, agents * (2.0 * radius + 2.0 * APART_M) / (2.0 * math.pi))
    share = 2.0 * math.pi / agents
    angles = rng.uniform(-math.pi, math.pi) + share * (np.arange(agents) + rng.uniform(-0.2, 0.2, agents))
    starts = [Pose2D(around * math.cos(a), around * math.sin(a), math.remainder(a + math.pi, math.tau)) for a in angles]
    return [], starts, [Pose2D(-p.x, -p.y, p.yaw) for p in starts]


def _rooms(rng: np.random.Generator, agents: int, radius: float, length: float, width: float) -> Layout | None:
    """Two rooms that a corridor joins; half of the robots begin in each and drive to the other."""
    spacing = 2.0 * radius + APART_M + 0.2
    half_y = 0.5 * max(4.0, width + 1.0)
    depth = max(2.5, 2.5 * spacing * spacing * math.ceil(agents / 2) / (2.0 * half_y))
    block = half_y - 0.5 * width
    shapes = _walls(0.5 * length + depth, half_y)
    shapes += [_box(0.0, s * (half_y - 0.5 * block), length, block) for s in (-1.0, 1.0)]
    left = (-0.5 * length - depth, -half_y, -0.5 * length, half_y)
    right = (0.5 * length, -half_y, 0.5 * length + depth, half_y)
    few, more = agents // 2, agents - agents // 2
    starts = [_apart(_free(rng, left, shapes, radius, 0.0), more, radius)]
    starts += [_apart(_free(rng, right, shapes, radius, math.pi), few, radius)]
    goals = [_apart(_free(rng, right, shapes, radius, 0.0), more, radius, away_from=starts[0])]
    goals += [_apart(_free(rng, left, shapes, radius, math.pi), few, radius, away_from=starts[1])]
    found = [*starts[0], *starts[1]], [*goals[0], *goals[1]]
    return (shapes, *found) if len(found[0]) == len(found[1]) == agents else None


def _corridor(rng: np.random.Generator, agents: int, radius: float) -> Layout | None:
    """A corridor of 8 m, a little wider than two robots."""
    return _rooms(rng, agents, radius, 8.0, 4.0 * radius + rng.uniform(0.4, 1.0))


def _narrow_door(rng: np.random.Generator, agents: int, radius: float) -> Layout | None:
    """A door for one robot."""
    return _rooms(rng, agents, radius, 0.2, 2.0 * radius + rng.uniform(0.25, 0.5))


def _random(rng: np.random.Generator, agents: int, radius: float) -> Layout | None:
    """A room with boxes of 0.3 to 1 m, one on 5 square meters, between random poses."""
    half = 0.5 * max(6.0, 2.5 * math.sqrt(agents))
    shapes = _walls(half, half)
    for _ in range(round(4.0 * half * half / 5.0)):
        (x, y), size = rng.uniform(-half, half, 2).tolist(), rng.uniform(0.3, 1.0, 2).tolist()
        shapes.append(_box(x, y, size[0], size[1], rng.uniform(-math.pi, math.pi)))
    return _between(rng, agents, radius, shapes, half, half)


def _warehouse(rng: np.random.Generator, agents: int, radius: float) -> Layout | None:
    """Racks of 4 m by 0.8 m in two columns, with aisles a little wider than two robots, between random poses."""
    rows = max(3, math.ceil(math.sqrt(2.0 * agents)))
    aisle = 4.0 * radius + rng.uniform(0.3, 0.8)
    half_x, half_y = 4.0 + 1.5 * aisle, 0.5 * (rows * 0.8 + (rows + 1) * aisle)
    rack_y = [-half_y + aisle + 0.4 + k * (0.8 + aisle) for k in range(rows)]
    shapes = _walls(half_x, half_y)
    shapes += [_box(s * (2.0 + 0.5 * aisle), y, 4.0, 0.8) for y in rack_y for s in (-1.0, 1.0)]
    return _between(rng, agents, radius, shapes, half_x, half_y)


def _between(
    rng: np.random.Generator, agents: int, radius: float, shapes: list[Shape], half_x: float, half_y: float
) -> Layout | None:
    """Return random starts and goals among the shapes."""
    draw = _free(rng, (-half_x, -half_y, half_x, half_y), shapes, radius)
    starts = _apart(draw, agents, radius)
    goals = _apart(draw, agents, radius, away_from=starts)
    return (shapes, starts, goals) if starts and goals else None


LAYOUTS: Final[dict[str, Callable[[np.random.Generator, int, float], Layout | None]]] = {
    "crossing": _crossing,
    "corridor": _corridor,
    "narrow_door": _narrow_door,
    "random": _random,
    "warehouse": _warehouse,
}
"""The drawn scenes: name -> function of a generator, the number of robots and the radius of the circle around each (m)."""
