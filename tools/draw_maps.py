#!/usr/bin/env python3
"""Draw the packaged maps: `python tools/draw_maps.py [FOLDER]` (by default `maps`).

Each map is a plan of shapely polygons: floor, solids (walls and furniture), places. A cell is occupied if its center is in a
solid, free if it is on the floor, else unknown. The same plan gives the same pixels on every machine: random numbers come from a
generator in this file.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image
from shapely import Geometry, affinity
from shapely.geometry import Point, box

FREE, OCCUPIED, UNKNOWN = 254, 0, 205
"""Gray values of maps that map_server saves."""

Pose = tuple[float, float, float]
EAST, NORTH, WEST, SOUTH = 0.0, 1.5708, 3.1415, -1.5708


@dataclass
class Plan:
    """A building in meters; `size` and `origin` are those of the image."""

    name: str
    title: str
    size: tuple[float, float]
    origin: tuple[float, float]
    resolution: float = 0.05
    floor: list[Geometry] = field(default_factory=list)
    solids: list[Geometry] = field(default_factory=list)
    openings: list[Geometry] = field(default_factory=list)
    furniture: list[Geometry] = field(default_factory=list)
    places: dict[str, Pose] = field(default_factory=dict)
    start: str = ""
    goals: tuple[str, ...] = ()

    def wall(self, x0: float, y0: float, x1: float, y1: float, thickness: float = 0.1) -> None:
        """Adds an axis-parallel wall with the centerline from one point to the other, with square ends."""
        h = thickness / 2
        self.solids.append(box(min(x0, x1) - h, min(y0, y1) - h, max(x0, x1) + h, max(y0, y1) + h))

    def outer_walls(self, width: float, height: float, thickness: float = 0.15) -> None:
        """Adds the floor from the origin to (width, height), and walls around it."""
        self.floor.append(box(0, 0, width, height))
        outside = box(-thickness, -thickness, width + thickness, height + thickness)
        self.solids.append(outside.difference(box(0, 0, width, height)))

    def door(self, x: float, y: float, *, along: str, width: float = 0.9) -> None:
        """Adds an opening, centered at the point, in a wall along "x" or "y"."""
        h, deep = width / 2, 0.2
        self.openings.append(
            box(x - h, y - deep, x + h, y + deep) if along == "x" else box(x - deep, y - h, x + deep, y + h)
        )

    def block(self, x: float, y: float, width: float, depth: float, degrees: float = 0.0) -> None:
        """Adds a rectangular piece of furniture, centered at the point."""
        shape = box(x - width / 2, y - depth / 2, x + width / 2, y + depth / 2)
        self.furniture.append(affinity.rotate(shape, degrees, origin=(x, y)))

    def round(self, x: float, y: float, radius: float) -> None:
        """Adds a round piece of furniture."""
        self.furniture.append(Point(x, y).buffer(radius, quad_segs=16))

    def pixels(self) -> NDArray[np.uint8]:
        """Returns the image (rows from the top), uint8."""
        nx, ny = (round(length / self.resolution) for length in self.size)
        xs = self.origin[0] + (np.arange(nx) + 0.5) * self.resolution
        ys = self.origin[1] + (np.arange(ny) + 0.5) * self.resolution
        x, y = np.meshgrid(xs, ys)
        floor = shapely.union_all(self.floor)
        walls = shapely.difference(shapely.union_all(self.solids), shapely.union_all(self.openings))
        solid = shapely.union_all([walls, *self.furniture])
        # a small margin decides about edges through cell centers, not floating-point rounding
        floor, solid = floor.buffer(-1e-6, join_style="mitre"), solid.buffer(1e-6, join_style="mitre")
        shapely.prepare(floor)
        shapely.prepare(solid)
        image = np.where(shapely.contains_xy(floor, x, y), FREE, UNKNOWN)
        image = np.where(shapely.contains_xy(solid, x, y), OCCUPIED, image)
        return image[::-1].astype(np.uint8)

    def yaml(self) -> str:
        """Returns the YAML file for map_server."""
        return (
            f"# {self.title}\n"
            f"image: {self.name}.png\n"
            f"resolution: {self.resolution}\n"
            f"origin: [{self.origin[0]}, {self.origin[1]}, 0.0]\n"
            "negate: 0\n"
            "occupied_thresh: 0.65\n"
            "free_thresh: 0.196\n"
        )

    def places_yaml(self) -> str:
        """Returns the file of places."""

        def pose(name: str) -> str:
            return "[{:g}, {:g}, {:g}]".format(*self.places[name])

        lines = [f"# {self.title}: free poses x, y (m), yaw (rad) in the map", "places:"]
        lines += [f"  {name}: {pose(name)}" for name in self.places]
        lines += [f"start: {pose(self.start)} # {self.start}", "goals:"]
        lines += [f"  - {pose(name)} # {name}" for name in self.goals]
        return "\n".join(lines) + "\n"


class Lehmer:
    """A random number generator (Lehmer 1951, constants of Park and Miller 1988): the same numbers in every Python version."""

    def __init__(self, seed: int) -> None:
        self._state = seed % 2147483647 or 1

    def below(self, n: int) -> int:
        """Returns an integer in [0, n)."""
        self._state = self._state * 48271 % 2147483647
        return self._state * n // 2147483647

    def chance(self, share: float) -> bool:
        """Returns True with probability `share`."""
        return self.below(1_000_000) < share * 1_000_000


def office() -> Plan:
    """Rooms on both sides of a corridor, behind doors of 0.9 m."""
    plan = Plan("office", "Office: rooms on both sides of a corridor, doors 0.9 m wide", (24.0, 16.0), (-0.5, -0.5))
    width, height = 23.0, 15.0
    low, high = 6.5, 8.4  # centerlines of the corridor's walls
    plan.outer_walls(width, height)
    plan.wall(0, low, width, low)
    plan.wall(0, high, width, high)
    for x in (4.6, 8.6, 12.6, 17.6):
        plan.wall(x, high, x, height)
    for x in (6.0, 10.0, 13.0):
        plan.wall(x, 0, x, low)
    for x in (3.6, 7.6, 9.6, 15.1, 21.6):
        plan.door(x, high, along="x")
    for x in (1.5, 8.0, 11.5, 14.4, 21.0):
        plan.door(x, low, along="x")
    plan.door(17.6, 13.6, along="y")

    def desk(x: float, y: float, side: float, chair: bool = True) -> None:
        """A desk 1.6 x 0.8 m with its chair on the side of +1 (north) or -1 (south)."""
        plan.block(x, y, 1.6, 0.8)
        if chair:
            plan.round(x + 0.1, y + side * 0.75, 0.25)

    # three offices for two, desks at the windows
    for left, right in ((0.0, 4.6), (4.6, 8.6), (8.6, 12.6)):
        center = (left + right) / 2
        desk(center - 0.9, 14.1, -1)
        desk(center + 0.9, 14.1, -1)
    plan.block(0.2, 10.2, 0.4, 2.4)  # shelves
    plan.block(8.35, 10.4, 0.4, 2.0)
    plan.block(12.35, 11.6, 0.4, 1.6)
    plan.round(5.0, 8.85, 0.18)  # plants
    plan.round(12.2, 8.85, 0.18)
    plan.round(4.2, 12.9, 0.18)
    # a meeting room: a table for eight
    plan.block(15.1, 11.8, 2.8, 1.2)
    for x in (14.2, 15.1, 16.0):
        plan.round(x, 10.85, 0.23)
        plan.round(x, 12.75, 0.23)
    plan.round(13.4, 11.8, 0.23)
    plan.block(15.1, 14.85, 2.0, 0.3)  # a sideboard
    # a laboratory: benches and racks
    plan.block(20.3, 11.2, 0.9, 3.0)
    plan.block(22.65, 12.2, 0.7, 4.6)
    plan.block(19.9, 14.7, 3.2, 0.6)
    plan.round(19.5, 10.6, 0.22)
    plan.round(19.5, 12.0, 0.22)
    plan.block(17.95, 9.3, 0.6, 0.8)
    # an open-plan office with two islands of desks
    for x, y in ((1.6, 1.6), (4.3, 1.6), (1.6, 4.1), (4.3, 4.1)):
        plan.block(x, y, 1.4, 1.4)
    for x, y in ((1.6, 0.6), (4.3, 0.6), (1.6, 2.6), (4.3, 2.6), (1.2, 5.1), (4.3, 5.1)):
        plan.round(x, y, 0.24)
    plan.block(5.75, 5.4, 0.4, 1.6)
    # the manager's room
    desk(8.2, 1.6, -1)
    plan.block(6.25, 3.4, 0.4, 2.2)
    plan.round(9.0, 3.7, 0.5)
    plan.round(9.65, 6.1, 0.18)
    # stores: shelves on both sides
    plan.block(10.3, 2.6, 0.5, 4.4)
    plan.block(12.7, 2.6, 0.5, 4.4)
    plan.block(11.5, 0.25, 1.4, 0.5)
    # kitchen and lounge with two pillars
    plan.block(17.6, 0.35, 5.0, 0.7)
    plan.block(22.7, 1.6, 0.6, 2.4)
    plan.block(16.4, 3.6, 0.3, 0.3)
    plan.block(19.8, 3.6, 0.3, 0.3)
    for x, y in ((15.0, 2.9), (18.1, 3.2)):
        plan.round(x, y, 0.45)
        for k in range(3):
            a = math.radians(90 + 120 * k)
            plan.round(x + 0.75 * math.cos(a), y + 0.75 * math.sin(a), 0.2)
    plan.block(17.6, 6.05, 2.2, 0.8)  # a sofa
    plan.block(17.6, 5.0, 0.9, 0.5)
    plan.round(22.5, 6.0, 0.25)
    plan.block(13.3, 4.4, 0.5, 0.9)
    # obstacles in the corridor
    plan.block(12.6, 8.1, 0.7, 0.5)
    plan.round(5.6, 6.8, 0.2)
    plan.round(18.6, 6.8, 0.2)

    plan.places = {
        "corridor_west": (0.8, 7.45, EAST),
        "corridor_middle": (11.4, 7.4, EAST),
        "corridor_east": (22.2, 7.45, WEST),
        "office_1": (2.4, 11.6, NORTH),
        "office_2": (6.2, 12.0, NORTH),
        "office_3": (10.6, 12.0, NORTH),
        "meeting_room": (16.9, 9.6, NORTH),
        "laboratory": (21.4, 9.8, NORTH),
        "open_plan": (2.9, 3.0, SOUTH),
        "manager": (7.6, 3.6, SOUTH),
        "stores": (11.5, 2.0, SOUTH),
        "kitchen": (20.6, 2.2, SOUTH),
        "lounge": (19.6, 5.2, WEST),
    }
    plan.start = "corridor_west"
    plan.goals = ("office_2", "meeting_room", "kitchen")
    return plan


def maze() -> Plan:
    """A maze of 11 x 9 squares of 1.4 m with a few walls removed, so that there are several routes."""
    columns, rows, cell, thickness = 11, 9, 1.4, 0.1
    width, height = columns * cell, rows * cell
    plan = Plan("maze", "Maze: lanes 1.3 m wide, with loops", (width + 1.0, height + 1.0), (-0.5, -0.5))
    rng = Lehmer(20100218)
    # depth-first spanning tree, then remove some more walls
    seen = {(0, 0)}
    opened: set[tuple[int, int, int, int]] = set()
    stack = [(0, 0)]
    while stack:
        x, y = stack[-1]
        around = [(x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1)]
        new = [(u, v) for u, v in around if 0 <= u < columns and 0 <= v < rows and (u, v) not in seen]
        if not new:
            stack.pop()
            continue
        u, v = new[rng.below(len(new))]
        seen.add((u, v))
        opened.add((min(x, u), min(y, v), max(x, u), max(y, v)))
        stack.append((u, v))
    for _ in range(9):
        x, y = rng.below(columns - 1), rng.below(rows - 1)
        opened.add((x, y, x + 1, y) if rng.chance(0.5) else (x, y, x, y + 1))
    plan.outer_walls(width, height)
    for y in range(rows):
        for x in range(columns):
            if x + 1 < columns and (x, y, x + 1, y) not in opened:
                plan.wall((x + 1) * cell, y * cell, (x + 1) * cell, (y + 1) * cell, thickness)
            if y + 1 < rows and (x, y, x, y + 1) not in opened:
                plan.wall(x * cell, (y + 1) * cell, (x + 1) * cell, (y + 1) * cell, thickness)

    def square(x: int, y: int, yaw: float) -> Pose:
        return (round((x + 0.5) * cell, 3), round((y + 0.5) * cell, 3), yaw)

    plan.places = {
        "south_west": square(0, 0, NORTH),
        "south_east": square(columns - 1, 0, NORTH),
        "north_east": square(columns - 1, rows - 1, SOUTH),
        "north_west": square(0, rows - 1, SOUTH),
        "centre": square(columns // 2, rows // 2, EAST),
    }
    plan.start = "south_west"
    plan.goals = ("centre", "north_east", "south_east")
    return plan


def warehouse() -> Plan:
    """Racks with aisles of 1.2 m between them, cross aisles, docks and a packing area."""
    plan = Plan("warehouse", "Warehouse: racks with aisles 1.2 m wide", (32.0, 21.0), (-0.5, -0.5))
    width, height = 31.0, 20.0
    plan.outer_walls(width, height)
    rng = Lehmer(1954)
    # double rows of racks along x: bays of 2.7 m, pallets back to back; an empty bay has only its posts
    depth, aisle, bay = 1.1, 1.2, 2.7
    bottom = 5.2
    rows: list[float] = []
    while bottom + 2 * depth < height - 1.2:
        rows.append(bottom)
        bottom += 2 * depth + aisle
    for row in rows:
        for first, bays in ((1.6, 4), (14.6, 5)):
            for side in range(2):
                y = row + side * depth
                for k in range(bays):
                    x = first + k * bay
                    if rng.chance(0.12):
                        continue
                    loads = 2 if rng.chance(0.2) else 3
                    for load in range(loads):
                        deep = 1.0 if rng.chance(0.7) else 0.9
                        center = x + bay * (load + 0.5) / loads
                        inner = y + depth - deep / 2 if side == 0 else y + deep / 2
                        plan.block(center, inner, 0.8 if loads == 3 else 1.2, deep)
                for k in range(bays + 1):
                    for post in (0.05, depth - 0.05):
                        plan.block(first + k * bay, y + post, 0.1, 0.1)
    # dock doors in the south wall with pallets waiting, an office, packing tables, pillars
    for x in (19.0, 23.0, 27.0):
        plan.block(x, 0.1, 2.4, 0.2)
        plan.block(x - 0.7, 1.6, 1.2, 0.8)
        if rng.chance(0.6):
            plan.block(x + 0.7, 1.6, 1.2, 0.8, 6.0)
    plan.wall(0, 3.6, 5.0, 3.6)
    plan.wall(5.0, 0, 5.0, 3.6)
    plan.door(5.0, 2.4, along="y")
    plan.block(1.4, 0.6, 1.8, 0.8)
    plan.round(1.5, 1.4, 0.25)
    plan.block(3.6, 3.35, 1.8, 0.4)
    for x in (8.0, 11.0, 14.0):
        plan.block(x, 1.2, 2.0, 0.8)
        plan.round(x, 2.05, 0.22)
    for x in (7.3, 16.6, 25.9):
        plan.block(x, 3.9, 0.4, 0.4)
    plan.block(29.9, 4.1, 1.2, 1.2)  # the charging station
    plan.block(30.7, 17.6, 0.6, 2.6)

    lane = [row + 2 * depth + aisle / 2 for row in rows[:-1]]
    plan.places = {
        "charger": (28.4, 4.0, WEST),
        "packing": (9.5, 3.0, SOUTH),
        "docks": (21.0, 3.2, SOUTH),
        "office": (3.0, 2.2, WEST),
        "cross_aisle": (13.5, 10.0, NORTH),
        "west_side": (0.8, 12.0, NORTH),
        "east_side": (29.2, 12.0, NORTH),
        "aisle_1": (6.0, round(lane[0], 3), EAST),
        "aisle_2": (21.0, round(lane[1], 3), WEST),
        "aisle_3": (7.0, round(lane[2], 3), EAST),
    }
    plan.start = "charger"
    plan.goals = ("aisle_2", "aisle_3", "packing")
    return plan


def clinic() -> Plan:
    """Wards on both sides of a service corridor of 1.3 m, behind doors of 1.0 m: a trolley fits, but hardly turns."""
    plan = Plan("clinic", "Clinic: wards along a corridor 1.3 m wide, doors 1.0 m wide", (15.0, 11.0), (-0.5, -0.5))
    width, height = 14.0, 10.0
    west, east, south, north = 1.85, 12.65, 2.05, 5.95  # centerlines of the inner block's walls
    corridor = 7.35  # centerline of the wall between corridor and northern wards
    plan.outer_walls(width, height)
    plan.wall(west, south, east, south)
    plan.wall(west, north, east, north)
    plan.wall(west, south, west, north)
    plan.wall(east, south, east, north)
    plan.wall(7.0, south, 7.0, north)
    plan.wall(0, corridor, width, corridor)
    for x in (5.0, 9.5):
        plan.wall(x, corridor, x, height)
    for x, y in ((3.5, south), (9.5, south), (8.4, north), (3.2, corridor), (7.6, corridor)):
        plan.door(x, y, along="x", width=1.0)
    plan.places = {
        "hall": (8.0, 1.0, WEST),
        "hall_east": (12.8, 1.0, WEST),
        "corridor_west": (1.6, 6.65, EAST),
        "corridor_east": (11.0, 6.65, WEST),
        "ward_1": (4.0, 4.4, NORTH),
        "ward_2": (9.8, 4.0, SOUTH),
        "ward_3": (2.6, 8.9, NORTH),
        "ward_4": (7.0, 8.9, NORTH),
    }
    plan.start = "corridor_west"
    plan.goals = ("ward_3", "ward_4", "ward_2")
    return plan


PLANS = (office, maze, warehouse, clinic)


def draw(folder: Path, plans: Sequence[Plan]) -> list[Path]:
    """Writes each plan's image, map_server YAML and places; returns the files."""
    written: list[Path] = []
    for plan in plans:
        image, yaml, places = (folder / f"{plan.name}{ending}" for ending in (".png", ".yaml", ".places.yaml"))
        Image.fromarray(plan.pixels()).save(image, optimize=True)
        yaml.write_text(plan.yaml(), encoding="utf-8")
        places.write_text(plan.places_yaml(), encoding="utf-8")
        written += [image, yaml, places]
    return written


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1] / "maps"
    target.mkdir(parents=True, exist_ok=True)
    for file in draw(target, [make() for make in PLANS]):
        print(file)
