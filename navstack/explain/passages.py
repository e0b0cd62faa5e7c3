"""The doors and corridors of a map that a robot can pass, at what cost. Lengths in meters, coordinates in the map frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import (
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    Costmap,
    Footprint,
    FrameTree,
    InputError,
    NavError,
    OccupancyGrid,
    Pose2D,
)
from navstack.costmap import (
    InflationLayer,
    KeepoutMaskLayer,
    LayeredCostmap,
    StaticLayer,
    inflation_cost,
    map_from_frame,
)
from navstack.explain.crossing import VERDICT_TEXTS, ShapePassage, Verdict, shape_passages
from navstack.explain.narrow_places import NarrowPlace, narrow_places
from navstack.map_io import load_map
from navstack.parameters import Configuration, CostmapConfiguration
from navstack.plugins import Layer, Plugin
from navstack.record import Record
from navstack.scenario import Scenario

Rating = Literal["free", "costly", "blocked"]
RATINGS: tuple[Rating, ...] = ("free", "costly", "blocked")
LABELS: dict[Rating, str] = {"free": "passable", "costly": "at high cost", "blocked": "not passable"}

HIGH_COST = 126
"""Cells from this cost on are of high cost: half of the largest inflated cost (252)."""


@dataclass(frozen=True, slots=True)
class Passage:
    """A door, the narrowest part of a corridor, or the gap between two obstacles."""

    x: float
    """x of the center."""
    y: float
    """y of the center."""
    ends: tuple[tuple[float, float], tuple[float, float]]
    """Centers of the two obstacle cells on either side."""
    width: float
    """Free width: distance between the ends minus one cell; accurate to one cell."""
    length: float
    """Length of the part that is equally narrow, within one cell; 0 for a door in a thin wall."""
    obstacle: float
    """Size of the smaller of the two obstacles: the longer side of its box, with the obstacles closer to it than this width."""
    cost: int
    """Lowest cost at which the robot's center can pass."""
    clearance: float
    """Distance from the cell of that cost to the nearer end, center to center."""
    rating: Rating
    fits: bool
    """True if the unpadded footprint is narrower than the passage."""
    can_turn: bool
    """True if the circumscribed circle is narrower than the passage."""
    reason: str
    """The cause of the rating: clearance of the centerline, and what it means for the robot."""

    def as_dict(self) -> dict[str, Any]:
        """Return the passage for JSON."""
        return {
            "at": [self.x, self.y],
            "ends": [list(end) for end in self.ends],
            "width_m": self.width,
            "length_m": self.length,
            "obstacle_m": self.obstacle,
            "cost": self.cost,
            "clearance_m": self.clearance,
            "rating": self.rating,
            "fits": self.fits,
            "can_turn": self.can_turn,
            "reason": self.reason,
        }


@dataclass(frozen=True, slots=True)
class RequiredWidths:
    """Widths between straight walls along the grid that a robot requires, in whole cells."""

    minimum: float
    """Narrowest passage whose centerline is not inscribed."""
    low_cost: float
    """Narrowest passage whose centerline costs less than `HIGH_COST`."""
    robot: float
    """Width of the robot: that of the unpadded footprint across its narrow side; of a round one its diameter."""
    turning: float
    """Twice the circumscribed radius of the unpadded footprint: the width for a turn in place; of a round one its diameter."""

    def as_dict(self) -> dict[str, Any]:
        """Return the widths for JSON."""
        return {
            "minimum_m": self.minimum,
            "low_cost_m": self.low_cost,
            "robot_m": self.robot,
            "turning_m": self.turning,
        }


@dataclass(frozen=True, slots=True, eq=False)
class PassageReport:
    """All passages of a map for one robot, the narrowest first."""

    passages: tuple[Passage, ...]
    widths: RequiredWidths
    costmap: Costmap
    """The inflated map in which the passages were rated."""
    costmap_name: str
    inscribed_radius: float
    """With padding."""
    circumscribed_radius: float
    """With padding."""
    inflation_radius: float
    """0 without an inflation layer."""
    narrowest: float
    """Lower limit of the searched widths."""
    widest: float
    """Upper limit of the searched widths."""
    narrower: int
    """Number of openings that are left out because they are narrower than `narrowest`."""
    smallest_obstacle: float
    """Lower limit of `Passage.obstacle`."""
    unknown_border: float
    """Share of unknown cells among the cells that border free space."""
    footprint: Footprint
    """With padding."""
    turning_radius: float = 0.0
    """m; 0 without one."""
    shapes: tuple[ShapePassage, ...] | None = None
    """For each passage what it means for the footprint; None for a round robot."""

    def count(self, rating: Rating) -> int:
        """Return the number of passages with this rating."""
        return sum(passage.rating == rating for passage in self.passages)

    @property
    def shape_counts(self) -> dict[Verdict, int]:
        """Number of passages by what they mean for the footprint; empty for a round robot."""
        verdicts = [shape.verdict for shape in self.shapes or ()]
        return {verdict: verdicts.count(verdict) for verdict in VERDICT_TEXTS} if self.shapes is not None else {}

    def as_dict(self) -> dict[str, Any]:
        """Return the report for JSON, without the costmap."""
        return {
            "costmap": self.costmap_name,
            "inscribed_radius_m": self.inscribed_radius,
            "circumscribed_radius_m": self.circumscribed_radius,
            "inflation_radius_m": self.inflation_radius,
            "narrowest_m": self.narrowest,
            "widest_m": self.widest,
            "narrower": self.narrower,
            "smallest_obstacle_m": self.smallest_obstacle,
            "unknown_border": self.unknown_border,
            "required_widths": self.widths.as_dict(),
            "counts": {rating: self.count(rating) for rating in RATINGS},
            "footprint": None if self.footprint.is_round else self.footprint.vertices.tolist(),
            "turning_radius_m": self.turning_radius,
            "footprint_counts": self.shape_counts,
            "passages": [
                passage.as_dict() if shape is None else {**passage.as_dict(), "footprint": shape.as_dict()}
                for passage, shape in zip(self.passages, self.shapes or [None] * len(self.passages), strict=True)
            ],
        }


# --- rating -----------------------------------------------------------------------------------------------------------


def own_width(footprint: Footprint) -> float:
    """Return the width of a footprint across its narrow side (m); of one that stands for a circle, the circle's diameter."""
    if footprint.is_round:
        return 2.0 * footprint.circumscribed_radius
    hull: NDArray[np.float64] = shapely.get_coordinates(footprint.polygon.convex_hull)
    edges = np.diff(hull, axis=0)
    across = np.column_stack((-edges[:, 1], edges[:, 0])) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    return round(float(np.ptp(hull @ across.T, axis=0).min()), 9)


class PassageRater:
    """Rates passages in a costmap for the robot of a configuration."""

    def __init__(self, master: Costmap, chosen: CostmapConfiguration, inflation: InflationLayer | None) -> None:
        self.master = master
        self.inflation = inflation
        self.inscribed = chosen.footprint.inscribed_radius
        self.circumscribed = chosen.true_footprint.circumscribed_radius
        self.robot_width = own_width(chosen.true_footprint)

    def passage(self, place: NarrowPlace) -> Passage:
        """Return the rated passage at a narrow place."""
        g = self.master.geometry
        ends = (g.cell_to_world(*place.first), g.cell_to_world(*place.second))
        width = (place.distance - 1.0) * g.resolution
        # the robot crosses every bar of the stretch: the most costly one counts
        cost, clearance = max((self._crossing(*bar) for bar in place.bars), key=lambda c: (c[0], -c[1]))
        rating: Rating = "free" if cost < HIGH_COST else "costly" if cost < INSCRIBED else "blocked"
        fits, can_turn = width >= self.robot_width - 1e-9, width >= 2.0 * self.circumscribed - 1e-9
        return Passage(
            x=(ends[0][0] + ends[1][0]) / 2.0,
            y=(ends[0][1] + ends[1][1]) / 2.0,
            ends=ends,
            width=round(width, 6),
            length=round(place.stretch * g.resolution, 6),
            obstacle=round(place.smaller * g.resolution, 6),
            cost=cost,
            clearance=round(clearance, 6),
            rating=rating,
            fits=fits,
            can_turn=can_turn,
            reason=self._reason(cost, clearance, fits, can_turn),
        )

    def _crossing(self, first: tuple[int, int], second: tuple[int, int]) -> tuple[int, float]:
        """Return the lowest cost between two obstacle cells, and the distance of that cell to the nearer of them (m)."""
        a, b = np.array(first), np.array(second)
        steps = max(2, math.ceil(4.0 * math.dist(first, second)))
        along = a + (b - a) * (np.arange(1, steps)[:, None] / steps)
        cells = np.unique(np.floor(along + 0.5).astype(np.int64), axis=0)
        apart = np.minimum(np.hypot(*(cells - a).T), np.hypot(*(cells - b).T))
        cells, apart = cells[apart > 0.0], apart[apart > 0.0]
        costs = self.master.data[cells[:, 1], cells[:, 0]].astype(np.int64)
        costs[costs == UNKNOWN] = 0 if (costs == UNKNOWN).all() else LETHAL
        # ties go to the cell with the largest clearance
        best = int(np.lexsort((-apart, costs))[0])
        return int(costs[best]), float(apart[best]) * self.master.geometry.resolution

    def _reason(self, cost: int, clearance: float, fits: bool, can_turn: bool) -> str:
        text = f"{clearance:.2f} m from the walls"
        if self.inflation is None:
            text += ", no inflation layer"
        elif cost >= INSCRIBED:
            text += f", inscribed radius {self.inscribed:.2f} m"
        elif cost == 0:
            text += f", inflation radius {self.inflation.params.inflation_radius:.2f} m"
        else:
            text += f", cost {cost} of 252"
        if cost < INSCRIBED and not fits:
            text += f"; narrower than the robot ({self.robot_width:.2f} m): it may collide"
        elif cost < INSCRIBED and not can_turn:
            text += f"; too narrow to turn (circumscribed radius {self.circumscribed:.2f} m)"
        return text

    def required_widths(self) -> RequiredWidths:
        """Return the widths that this robot requires."""
        return RequiredWidths(
            minimum=round(self._narrowest_below(INSCRIBED), 6),
            low_cost=round(self._narrowest_below(HIGH_COST), 6),
            robot=self.robot_width,
            turning=2.0 * self.circumscribed,
        )

    def _narrowest_below(self, cost: int) -> float:
        """Width of the narrowest passage along the grid whose centerline costs less than `cost` (m).

        With n free cells between two walls, the middle cell is (n + 1) // 2 cells from the nearer wall.
        """
        resolution = self.master.geometry.resolution
        layer = self.inflation
        if layer is None:
            return resolution
        away = np.arange(1.0, layer.radius_cells + 2.0)
        # the layer computes distances with the float32 resolution of the map message
        distances: NDArray[np.float64] = (away * float(np.float32(resolution))).astype(np.float64)
        costs = inflation_cost(distances, layer.inscribed_radius, layer.params.cost_scaling_factor).astype(np.int64)
        costs[away > layer.radius_cells] = 0
        cells = int(away[int(np.argmax(costs < cost))])
        return (2 * cells - 1) * resolution


# --- the map in a costmap ---------------------------------------------------------------------------------------------


def inflated_map(chosen: CostmapConfiguration, static_map: OccupancyGrid, name: str) -> LayeredCostmap:
    """Return the whole map, at its resolution, with the static, keepout and inflation layers of a costmap."""
    params = chosen.params.model_copy(
        update={"global_frame": static_map.frame, "robot_base_frame": "base", "rolling_window": False}
    )
    kinds = (StaticLayer, KeepoutMaskLayer, InflationLayer)
    specs = [Plugin[Layer[Any]](x.name, x.cls, x.params) for x in chosen.layers if issubclass(x.cls, kinds)]
    if not any(issubclass(spec.cls, StaticLayer) for spec in specs):
        # a costmap without a static layer observes the same walls with its sensors
        specs.insert(0, Plugin[Layer[Any]]("static_layer", StaticLayer, StaticLayer.Params()))
    costmap = LayeredCostmap(
        f"{name}_costmap",
        params,
        specs,
        footprint=chosen.footprint,
        frames=FrameTree(),
        static_map=static_map,
        read_map=load_map,
    )
    g = costmap.master.geometry
    costmap.update_at(Pose2D(*g.cell_to_world(0, 0), 0.0), 0.0)
    return costmap


def known_cells(static_map: OccupancyGrid, live: LayeredCostmap) -> NDArray[np.bool_]:
    """Return (ny, nx) True for the costmap's cells that the map knows."""
    if static_map.data.shape == live.master.data.shape and static_map.origin_yaw == 0.0:
        return static_map.data >= 0
    layer = next(x for x in live.layers if isinstance(x, StaticLayer))
    return _known_in_rotated_map(layer, live.master)


def _known_in_rotated_map(layer: StaticLayer, master: Costmap) -> NDArray[np.bool_]:
    """Look up the center of every cell of the master grid in the map."""
    g, m = master.geometry, layer.map.geometry
    to_map = map_from_frame(layer.map, FrameTree(), layer.map.frame, None)
    x = g.origin_x + (np.arange(g.nx) + 0.5) * g.resolution
    y = g.origin_y + (np.arange(g.ny) + 0.5) * g.resolution
    grid: NDArray[np.float64] = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float64)
    points = to_map.apply_points(grid)
    ix = np.floor((points[:, 0] - m.origin_x) / m.resolution).astype(np.int64)
    iy = np.floor((points[:, 1] - m.origin_y) / m.resolution).astype(np.int64)
    inside = (ix >= 0) & (ix < m.nx) & (iy >= 0) & (iy < m.ny)
    known = np.zeros(len(points), bool)
    known[inside] = layer.map.data[iy[inside], ix[inside]] >= 0
    return known.reshape(g.shape)


# --- the search -------------------------------------------------------------------------------------------------------


WIDENING_M = 0.15
"""On both sides of a passage, free space widens by this length and by the share `WIDENING` at least.

Smaller changes are a rough wall or a row of posts.
"""
WIDENING = 0.25
_TURNS = 1.5
"""Default of the largest width to search, in widths for a turn in place."""
_LEAST_UPPER_LIMIT_M = 1.25


def find_passages(
    configuration: Configuration,
    static_map: OccupancyGrid,
    *,
    costmap: str = "global",
    narrowest: float | None = None,
    widest: float | None = None,
    smallest_obstacle: float = 0.0,
    unknown_is_wall: bool = False,
    turning_radius: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PassageReport:
    """Doors, corridors and gaps between obstacles of a map, rated by the `global` or `local` costmap.

    `narrowest` and `widest` limit the widths (m); the defaults are the inscribed radius (half the width of the robot) and
    the width at which inflation ends, at least 1.25 m and one and a half times the width for a turn in place. The report
    counts the narrower ones. `smallest_obstacle` (m) leaves out the gaps next to smaller free-standing obstacles, which the
    robot can drive around. `unknown_is_wall` treats unknown space as walls, for maps whose walls are unknown cells. For a
    robot that is not round, `PassageReport.shapes` has the headings at which it passes and, with a `turning_radius` (m;
    default: that of base and controller), a way through. `progress(done, total)` is called after each of these.
    Raises InputError for limits without a width between them.
    """
    chosen = configuration.local_costmap if costmap == "local" else configuration.global_costmap
    live = inflated_map(chosen, static_map, costmap)
    inflation = next((x for x in live.layers if isinstance(x, InflationLayer) and x.params.enabled), None)
    radius = float(inflation.params.inflation_radius) if inflation is not None else 0.0
    low = chosen.footprint.inscribed_radius if narrowest is None else narrowest
    high = _upper_limit(live, radius, chosen.true_footprint) if widest is None else widest
    if not (0.0 <= low <= high and math.isfinite(high)):
        raise InputError(
            f"--narrowest {low:g} m and --widest {high:g} m leave no width; give --narrowest below --widest",
            narrowest=low,
            widest=high,
        )
    lethal = live.master.data == LETHAL
    # the map, not the costmap: without track_unknown_space the costmap has unknown space as free
    known = known_cells(static_map, live)
    wall = lethal | ~known if unknown_is_wall else lethal
    resolution = live.master.geometry.resolution
    rater = PassageRater(live.master, chosen, inflation)
    widths = rater.required_widths()
    needed = max(widths.minimum, widths.low_cost, widths.robot)
    everywhere = _search(wall, known & ~wall, high, needed, smallest_obstacle, resolution)
    places = [place for place in everywhere if place.distance >= low / resolution + 1.0 - 1e-6]
    passages = tuple(rater.passage(place) for place in places)
    radius_m = configuration.turning_radius if turning_radius is None else turning_radius
    return PassageReport(
        passages=passages,
        widths=widths,
        costmap=live.master,
        costmap_name=costmap,
        inscribed_radius=chosen.footprint.inscribed_radius,
        circumscribed_radius=chosen.footprint.circumscribed_radius,
        inflation_radius=radius,
        narrowest=low,
        widest=high,
        narrower=len(everywhere) - len(places),
        smallest_obstacle=smallest_obstacle,
        unknown_border=_unknown_border(known, lethal),
        footprint=chosen.footprint,
        turning_radius=radius_m,
        shapes=None
        if chosen.footprint.is_round
        else shape_passages(
            _walled(live.master, wall), chosen.footprint, radius_m, [p.ends for p in passages], progress
        ),
    )


def _walled(costmap: Costmap, wall: NDArray[np.bool_]) -> Costmap:
    """Return the costmap with lethal cells wherever `wall` (ny, nx) is True."""
    return Costmap(costmap.geometry, np.where(wall, LETHAL, costmap.data).astype(np.uint8), costmap.frame)


def _upper_limit(live: LayeredCostmap, inflation_radius: float, footprint: Footprint) -> float:
    """Return the largest width to search (m).

    That from which on inflation does not reach the centerline, but at least that of a door, and one and a half times what the
    robot needs for a turn in place.
    """
    inflated = 2.0 * (inflation_radius + live.master.geometry.resolution)
    return max(_LEAST_UPPER_LIMIT_M, inflated, _TURNS * 2.0 * footprint.circumscribed_radius)


def _search(
    wall: NDArray[np.bool_],
    free: NDArray[np.bool_],
    high: float,
    needed: float,
    smallest: float,
    resolution: float,
) -> list[NarrowPlace]:
    """Narrow places with free widths from one cell to `high` (m), next to obstacles of `smallest` (m) or more.

    All pairs of obstacles are included whose distance is up to `needed` (m), which the robot needs at low cost.
    """
    return narrow_places(
        wall,
        free,
        narrowest=2.0,
        widest=high / resolution + 1.0 + 1e-6,
        widening=max(3.0, WIDENING_M / resolution),
        relative=WIDENING,
        always=needed / resolution + 1.0 + 1e-6,
        smallest=smallest / resolution,
    )


def _unknown_border(known: NDArray[np.bool_], wall: NDArray[np.bool_]) -> float:
    """Return the share of unknown cells among the neighbors of free cells that are not free."""
    free = known & ~wall
    beside = np.zeros_like(free)
    beside[1:] |= free[:-1]
    beside[:-1] |= free[1:]
    beside[:, 1:] |= free[:, :-1]
    beside[:, :-1] |= free[:, 1:]
    unknown, walls = int((beside & ~known).sum()), int((beside & wall).sum())
    return unknown / (unknown + walls) if unknown + walls else 0.0


# --- openings that stop a robot ---------------------------------------------------------------------------------------

_AHEAD_M: Final = 1.0
"""A goal that fails at most this far from an opening, from the robot's circumscribed circle, may fail because of it."""


def narrow_advice(record: Record) -> tuple[str, ...]:
    """Return the openings next to which goals of a run failed and in which its robot cannot turn, a sentence each.

    Nothing for a run whose goals were reached, and for one that no map and parameters belong to: a log.
    """
    failed = [k for k, result in enumerate(record.results) if result.get("state") not in ("SUCCEEDED", "PREEMPTED")]
    try:
        scenario = Scenario.from_record(record) if failed else None
    except NavError:
        return ()
    if scenario is None:
        return ()
    report = find_passages(scenario.configuration, scenario.map, turning_radius=0.0)
    radius = report.circumscribed_radius
    found: dict[int, list[int]] = {}
    for k in failed:
        end = float(record.goal_times[k]) + float(record.results[k].get("time_s", 0.0))
        x, y, _ = record.poses[record.index_at(end)]
        near = [(math.hypot(p.x - x, p.y - y), n) for n, p in enumerate(report.passages) if not p.can_turn]
        distance, number = min(near, default=(math.inf, -1))
        if distance <= radius + _AHEAD_M:
            found.setdefault(number, []).append(k + 1)
    return tuple(_narrow_sentence(report, report.passages[n], goals) for n, goals in found.items())


def _narrow_sentence(report: PassageReport, passage: Passage, goals: list[int]) -> str:
    where = f"the opening at ({passage.x:.2f}, {passage.y:.2f})"
    which = f"goal {goals[0]} ended" if len(goals) == 1 else f"goals {', '.join(map(str, goals))} ended"
    widths = report.widths
    if not passage.fits:
        needs = f"the robot is {widths.robot:.2f} m wide"
    elif report.footprint.is_round:
        needs = f"the robot has a diameter of {widths.robot:.2f} m"
    else:
        needs = f"the robot is {widths.robot:.2f} m wide and needs {widths.turning:.2f} m to turn"
    return (
        f"{which} next to {where}, which is {passage.width:.2f} m wide: {needs}; navstack explain passages lists all that are "
        "too narrow"
    )
