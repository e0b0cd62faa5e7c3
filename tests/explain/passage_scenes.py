"""Random walls with openings, and what is known about them: an independent brute force over poses with shapely.

    python -m tests.explain.passage_scenes [COUNT] [FIRST SEED]

compares `find_passages` with it and prints the scenes and the disagreements by kind.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from navstack.core import Footprint, GridGeometry, OccupancyGrid
from navstack.explain import PassageReport, find_passages
from navstack.explain.crossing import ShapePassage
from navstack.explain.passages import Passage
from navstack.parameters import load_configuration
from tests.global_planner.pose_referee import Referee

RESOLUTION: Final = 0.05
SIZE_M: Final = 11.0
KINDS: Final = ("door", "slanted door", "two walls", "corridor behind", "niche behind", "posts", "clutter")
MARGIN_M: Final = 0.002
"""m: a pose is surely free if the footprint padded by this is free, and surely not if it is not free shrunk by it."""
STEP: Final = math.radians(2.0)


@dataclass(frozen=True)
class Scene:
    """A wall with an opening in a room, and a robot."""

    kind: str
    grid: OccupancyGrid
    footprint: Footprint
    radius: float
    """Turning radius (m); 0 for none."""
    at: tuple[float, float]
    """Middle of the opening."""
    normal: float
    """Direction across the wall (rad)."""
    thickness: float
    width: float
    slant: float
    """How far the opening moves along the wall per meter across it (m)."""

    @cached_property
    def cells(self) -> shapely.STRtree:
        """The occupied cells."""
        g = self.grid.geometry
        iy, ix = np.nonzero(self.grid.data == 100)
        x, y = g.origin_x + ix * RESOLUTION, g.origin_y + iy * RESOLUTION
        return shapely.STRtree(shapely.box(x, y, x + RESOLUTION, y + RESOLUTION))

    @cached_property
    def clearance(self) -> NDArray[np.float64]:
        """Least distance (m) of the points of a cell to the occupied cells, from below."""
        away = np.asarray(ndimage.distance_transform_edt(self.grid.data != 100))
        return away * RESOLUTION - math.sqrt(2.0) * RESOLUTION

    def free(self, poses: NDArray[np.float64], margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether the footprint, padded by `margin` (m), covers no occupied cell at `poses` (n, 3)."""
        g = self.grid.geometry
        ix = np.floor((poses[:, 0] - g.origin_x) / RESOLUTION).astype(int)
        iy = np.floor((poses[:, 1] - g.origin_y) / RESOLUTION).astype(int)
        inside = (ix >= 0) & (iy >= 0) & (ix < g.nx) & (iy < g.ny)
        found = np.zeros(len(poses), bool)
        reach = self.footprint.circumscribed_radius + 2.0 * max(margin, 0.0)
        found[inside] = self.clearance[iy[inside], ix[inside]] > reach
        rest = np.flatnonzero(inside & ~found)
        outline = np.asarray(self.footprint.polygon.buffer(margin, join_style="mitre").exterior.coords)[:-1]
        c, s = np.cos(poses[rest, 2])[:, None], np.sin(poses[rest, 2])[:, None]
        x = poses[rest, 0:1] + c * outline[:, 0] - s * outline[:, 1]
        y = poses[rest, 1:2] + s * outline[:, 0] + c * outline[:, 1]
        hits = self.cells.query(shapely.polygons(np.stack((x, y), axis=-1)), predicate="intersects")[0]
        free = np.ones(len(rest), bool)
        free[hits] = False
        found[rest] = free
        return found

    def report(self) -> PassageReport:
        """The passages of this robot."""
        points = [[float(x), float(y)] for x, y in self.footprint.vertices]
        shape = [f"{name}_costmap/{key}" for name in ("global", "local") for key in (f"footprint={points}", PADDING)]
        configuration = load_configuration(["turtlebot"], overrides=shape)
        return find_passages(configuration, self.grid, narrowest=0.0, widest=2.2, turning_radius=self.radius)

    def opening(self, report: PassageReport) -> tuple[Passage, ShapePassage] | None:
        """The passage of a report that is this opening: the narrowest whose bar lies in it and across it."""
        assert report.shapes is not None
        for passage, shape in zip(report.passages, report.shapes, strict=True):
            across, along = self.local(np.array([[passage.x, passage.y]]))[0]
            (ax, ay), (bx, by) = passage.ends
            slope = abs(math.cos(math.atan2(by - ay, bx - ax) - self.normal))
            beside = abs(along - self.slant * across)
            if abs(across) < 0.5 * self.thickness + 0.1 and beside < 0.5 * self.width and slope < 0.8:
                return passage, shape
        return None

    def local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (n, 2) as distances across and along the wall from the middle of the opening."""
        c, s = math.cos(self.normal), math.sin(self.normal)
        x, y = points[:, 0] - self.at[0], points[:, 1] - self.at[1]
        return np.column_stack((c * x + s * y, c * y - s * x))


PADDING: Final = "footprint_padding=0.0"


def random_footprint(rng: np.random.Generator) -> Footprint:
    """A box with the base anywhere on its middle line, an L, or a pentagon."""
    length, width = float(rng.uniform(0.4, 1.4)), float(rng.uniform(0.3, 0.8))
    rear = -length * float(rng.choice([0.5, rng.uniform(0.15, 0.5)]))
    front, half = rear + length, 0.5 * width
    kind = rng.integers(4)
    if kind == 0:
        points = [[front, half], [rear, half], [rear, -half], [0.3 * front, -half], [0.3 * front, -0.1], [front, -0.1]]
    elif kind == 1:
        points = [[front, 0.0], [0.4 * front, half], [rear, half], [rear, -half], [0.4 * front, -half]]
    else:
        points = [[front, half], [rear, half], [rear, -half], [front, -half]]
    return Footprint(np.array(points))


def scene(seed: int) -> Scene:
    """A random scene; the kind is the remainder of the seed."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    n = round(SIZE_M / RESOLUTION)
    middle = (np.arange(n) + 0.5) * RESOLUTION - 0.5 * SIZE_M
    x, y = np.meshgrid(middle, middle)
    normal, at = float(rng.uniform(-math.pi, math.pi)), (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5)))
    c, s = math.cos(normal), math.sin(normal)
    u, v = c * (x - at[0]) + s * (y - at[1]), c * (y - at[1]) - s * (x - at[0])
    footprint = random_footprint(rng)
    width = float(rng.uniform(0.7, 2.0)) * 2.0 * footprint.inscribed_radius + 0.05
    thickness = float(rng.choice([0.1, 0.2, rng.uniform(0.1, 1.5)]))
    slant = float(rng.uniform(-0.7, 0.7)) if kind == "slanted door" else 0.0
    wall = (np.abs(u) <= 0.5 * thickness) & (np.abs(v - slant * u) >= 0.5 * width)
    behind = float(rng.uniform(0.3, 2.0))
    if kind == "two walls":
        other, shift = float(rng.uniform(0.8, 1.6)) * width, float(rng.uniform(-1.5, 1.5))
        wall |= (np.abs(u - 0.5 * thickness - behind - 0.1) <= 0.1) & (np.abs(v - shift) >= 0.5 * other)
    elif kind == "corridor behind":
        wall |= np.abs(u - 0.5 * thickness - behind - 0.1) <= 0.1
    elif kind == "niche behind":
        half = 0.5 * width + float(rng.uniform(0.0, 0.8))
        inner = (u > 0.5 * thickness) & (u < 0.5 * thickness + behind) & (np.abs(v) < half)
        wall |= (u > 0.5 * thickness) & (u < 0.5 * thickness + behind + 0.2) & (np.abs(v) < half + 0.2) & ~inner
    elif kind == "posts":
        wall = np.abs(np.abs(v) - 0.5 * width - 0.1) <= 0.1
        wall &= np.abs(u) <= 0.1
    elif kind == "clutter":
        for bx, by in rng.uniform(-3.0, 3.0, (40, 2)):
            half = float(rng.uniform(0.05, 0.3))
            # the way straight through stays free for 1.3 times the length of the robot
            beside = max(abs(by) - half - 0.5 * width, abs(bx) - half - 1.3 * footprint.circumscribed_radius)
            wall |= (np.abs(u - bx) < half) & (np.abs(v - by) < half) if beside > 0.0 else False
    wall |= (np.abs(x) > 0.5 * SIZE_M - 0.1) | (np.abs(y) > 0.5 * SIZE_M - 0.1)
    data = np.where(wall, 100, 0).astype(np.int8)
    geometry = GridGeometry(n, n, RESOLUTION, -0.5 * SIZE_M, -0.5 * SIZE_M)
    radius = float(rng.choice([0.0, 0.3, 0.6, 1.0]))
    thick = 0.2 if kind == "posts" else thickness
    return Scene(kind, OccupancyGrid(data, geometry), footprint, radius, at, normal, thick, width, slant)


def _poses(columns: tuple[NDArray[Any], ...]) -> NDArray[np.float64]:
    return np.column_stack(columns).astype(np.float64)


def headings(scene: Scene, passage: Passage) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether the robot surely fits, and may fit, at headings in steps with its base between the ends of a passage."""
    a, b = np.array(passage.ends)
    n = math.ceil(math.dist(a, b) / 0.004)
    line = a + (b - a) * (np.arange(n + 1) / n)[:, None]
    yaws = np.arange(round(2.0 * math.pi / STEP)) * STEP
    poses = _poses((np.tile(line, (len(yaws), 1)), np.repeat(yaws, len(line))))
    # half the distance between two points of the line on top
    surely, maybe = (scene.free(poses, margin).reshape(len(yaws), -1) for margin in (MARGIN_M, -MARGIN_M - 0.002))
    return np.any(surely, axis=1, keepdims=True)[:, 0], np.any(maybe, axis=1, keepdims=True)[:, 0]


def straight_through(scene: Scene, passage: Passage) -> NDArray[np.float64] | None:
    """A motion without change of direction that takes the whole robot through an opening (n, 3); None if none is found.

    Through poses in the opening, 5 cm and 6 degrees apart, two pieces of arcs or lines to either side.
    """
    a, b = np.array(passage.ends)
    n = max(2, math.ceil(math.dist(a, b) / 0.05))
    line = a + (b - a) * (np.arange(1, n) / n)[:, None]
    yaws = np.arange(60) * math.radians(6.0)
    poses = _poses((np.tile(line, (60, 1)), np.repeat(yaws, len(line))))
    poses = poses[scene.free(poses, MARGIN_M)]
    goal = scene.footprint.circumscribed_radius + 0.5 * scene.thickness + 0.1
    ways = [_pieces(scene, poses, sign, goal) for sign in (1.0, -1.0)]
    for i in range(len(poses)):
        if i in ways[0] and i in ways[1]:
            ends = [math.copysign(1.0, scene.local(way[i][-1:, :2])[0, 0]) for way in ways]
            if ends[0] != ends[1]:
                return np.concatenate((ways[1][i][::-1], ways[0][i][1:]))
    return None


def _pieces(scene: Scene, poses: NDArray[np.float64], sign: float, goal: float) -> dict[int, NDArray[np.float64]]:
    """For the poses from which one is found, a motion of two pieces in one direction to `goal` (m) across the wall."""
    step = 0.04
    curvatures = (0.0, 1.0 / scene.radius, -1.0 / scene.radius)
    found: dict[int, NDArray[np.float64]] = {}
    steps = math.ceil((goal + 2.0) / step)
    for first in curvatures:
        for second in curvatures:
            for switch in (0,) if first == second else (6, 12, 20, 30):
                todo = np.array([i for i in range(len(poses)) if i not in found], int)
                ways = [poses[todo]]
                for k in range(steps):
                    here, curvature = ways[-1], first if k < switch else second
                    turn = 0.5 * sign * step * curvature
                    mean = here[:, 2] + turn
                    chord = sign * step * (math.sin(turn) / turn if turn else 1.0)
                    there = here + np.column_stack(
                        (chord * np.cos(mean), chord * np.sin(mean), np.full(len(here), 2 * turn))
                    )
                    ok = scene.free(there, MARGIN_M)
                    todo, ways = todo[ok], [*(way[ok] for way in ways), there[ok]]
                    done = np.abs(scene.local(ways[-1][:, :2])[:, 0]) > goal
                    for j in np.flatnonzero(done):
                        found[int(todo[j])] = np.array([way[j] for way in ways])
                    todo, ways = todo[~done], [way[~done] for way in ways]
                    if not len(todo):
                        break
    return found


def connected(scene: Scene) -> bool:
    """Whether poses surely connect both sides of an opening for a robot that can turn on the spot and reverse.

    Poses in a box around the opening, in steps of 5 cm and 5 degrees.
    """
    half = scene.footprint.circumscribed_radius + 0.5 * scene.thickness + 0.6
    axis = np.arange(-half, half + 0.025, 0.05)
    side = np.arange(-0.5 * scene.width - half, 0.5 * scene.width + half, 0.05)
    yaws = np.arange(72) * math.radians(5.0)
    u, v, t = (grid.ravel() for grid in np.meshgrid(axis, side, yaws, indexing="ij"))
    c, s = math.cos(scene.normal), math.sin(scene.normal)
    poses = _poses((scene.at[0] + c * u - s * v, scene.at[1] + s * u + c * v, t + scene.normal))
    # between two poses, a point moves by half a step and half a turn at most
    margin = 0.5 * (0.05 + scene.footprint.circumscribed_radius * math.radians(5.0))
    free = scene.free(poses, margin).reshape(len(axis), len(side), 72)
    label: Any = ndimage.label
    labels, _ = label(np.concatenate((free, free), axis=2))  # twice around
    return bool(len(np.intersect1d(labels[0][labels[0] > 0], labels[-1][labels[-1] > 0])))


def disagreements(scene: Scene) -> list[str]:
    """What the report and the brute force do not agree on."""
    found: list[str] = []
    report = scene.report()
    opening = scene.opening(report)
    if opening is None:
        # space behind must widen, and a second wall can be nearer than the other side of the opening
        return [] if scene.kind in ("two walls", "corridor behind", "niche behind") else ["not listed"]
    passage, shape = opening
    surely, maybe = headings(scene, passage)
    yaws = np.arange(len(surely)) * STEP
    stated = np.zeros(len(surely), bool)
    for r in shape.headings:
        stated |= np.remainder(yaws - r.low + 1e-9, 2.0 * math.pi) <= r.high - r.low + 2e-9
    if (stated & ~maybe).any():
        found.append("heading stated that does not fit")
    if (surely & ~stated).any():
        lone = surely & ~stated & ~np.roll(stated, 1) & ~np.roll(stated, -1)
        found.append("heading missing" if lone.any() else "heading missing at the end of a range")
    if shape.path is not None:
        found += way_faults(scene, report, passage, shape)
    if scene.radius > 0.0 and shape.changes != 0 and straight_through(scene, passage) is not None:
        found.append(f"verdict {shape.verdict}, a way without change of direction exists")
    if scene.radius == 0.0 and scene.kind != "posts":
        found += ["blocked, poses are connected"] if shape.verdict == "blocked" and connected(scene) else []
    return found


def way_faults(scene: Scene, report: PassageReport, passage: Passage, shape: ShapePassage) -> list[str]:
    """What is wrong with a way through."""
    assert shape.path is not None
    referee = Referee(report.costmap, scene.footprint, False, scene.radius, True)
    found = referee.faults_of_path(shape.path)
    bar = shapely.LineString(passage.ends)
    for end in (0, len(shape.path) - 1):
        if shapely.Polygon(scene.footprint.at(shape.path[end])).intersects(bar):
            found.append("an end is still in the opening")
    if len(crossings(shape.path.poses, passage)) % 2 == 0:
        found.append("the way does not cross the opening")
    signs = shape.path.directions
    if int((signs[1:] * signs[:-1] < 0).sum()) != shape.changes:
        found.append("wrong number of changes")
    return [f"way: {fault[:40]}" for fault in found]


def crossings(poses: NDArray[np.float64], passage: Passage) -> NDArray[np.int64]:
    """Indices i at which a path (n, 3) crosses the line between the ends of a passage between pose i and i + 1."""
    (ax, ay), (bx, by) = passage.ends
    length = math.dist(*passage.ends)
    side = ((bx - ax) * (poses[:, 1] - ay) - (by - ay) * (poses[:, 0] - ax)) / length
    share = ((poses[:, 0] - ax) * (bx - ax) + (poses[:, 1] - ay) * (by - ay)) / length**2
    at = np.flatnonzero((side[1:] > 0.0) != (side[:-1] > 0.0))
    weight = side[at] / (side[at] - side[at + 1])
    where = share[at] + weight * (share[at + 1] - share[at])
    return at[(where >= 0.0) & (where <= 1.0)]


def main() -> None:
    """Compares scenes and prints the disagreements."""
    count, first = (int(sys.argv[k]) if len(sys.argv) > k else default for k, default in ((1, 500), (2, 0)))
    kinds: Counter[str] = Counter()
    for seed in range(first, first + count):
        here = scene(seed)
        kinds[f"{here.kind}: scenes"] += 1
        for fault in disagreements(here):
            kinds[f"{here.kind}: {fault}"] += 1
            print(seed, here.kind, fault, flush=True)
    for kind, number in sorted(kinds.items()):
        print(f"{number:5d}  {kind}")


if __name__ == "__main__":
    main()
