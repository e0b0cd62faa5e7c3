"""The passable-width report: which doors and corridors of a map a robot can pass, which only at high cost, which not at all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, LETHAL, UNKNOWN, Costmap, FrameTree, OccupancyGrid, Pose2D
from navstack.core.errors import InputError
from navstack.costmap import LayeredCostmap, LayerSpec
from navstack.costmap.inflation_layer import InflationLayer, inflation_cost
from navstack.costmap.mask_layers import KeepoutMaskLayer
from navstack.costmap.static_layer import StaticLayer
from navstack.explain.narrow import NarrowPlace, narrow_places
from navstack.map_io import load_map
from navstack.parameters.configuration import Configuration, CostmapConfiguration

Verdict = Literal["free", "costly", "blocked"]
VERDICTS: tuple[Verdict, ...] = ("free", "costly", "blocked")
IN_WORDS: dict[Verdict, str] = {"free": "passable", "costly": "at high cost", "blocked": "not passable"}

HALF = 126
"""From half of the largest inflated cost (252) on, planners shun a place."""
ISLAND_M = 1.0
"""What is smaller and stands alone is furniture: there is a way around it, and no passage beside it."""
_WIDENING_M = 0.15
_WIDENING = 0.25
"""Beyond a narrow place it gets wider by so much, on both sides; else it is a wall's roughness, or one of a row of posts."""


@dataclass(frozen=True, slots=True)
class Passage:
    """A door, or a corridor's narrowest place. Metres, in the map's frame."""

    x: float
    """Its middle."""
    y: float
    ends: tuple[tuple[float, float], tuple[float, float]]
    """Centres of the two obstacle cells that it lies between."""
    width: float
    """Free width: the distance between the two less a cell; true to a cell."""
    length: float
    """How far the narrowness stretches, up to a cell of width: 0 for a door in a thin wall."""
    cost: int
    """Least cost that the robot's centre meets on the way across."""
    clearance: float
    """From the cell of that cost to the nearer of the two obstacle cells, centre to centre."""
    verdict: Verdict
    fits: bool
    """The robot's outline is narrower than the opening."""
    can_turn: bool
    """The circumscribed circle fits in."""
    reason: str
    """The verdict in words, with its numbers: how far the middle is from the walls, and what that means."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "at": [self.x, self.y],
            "ends": [list(end) for end in self.ends],
            "width_m": self.width,
            "length_m": self.length,
            "cost": self.cost,
            "clearance_m": self.clearance,
            "verdict": self.verdict,
            "fits": self.fits,
            "can_turn": self.can_turn,
            "reason": self.reason,
        }


@dataclass(frozen=True, slots=True)
class Widths:
    """What widths a robot needs (m) between straight walls along the grid, in whole cells."""

    passable: float
    """The narrowest opening whose middle is not inscribed."""
    free: float
    """The narrowest one whose middle costs less than half of 252."""
    own: float
    """Twice the inscribed radius of the outline without padding: what the robot itself measures."""
    turning: float
    """Twice the circumscribed radius: it turns on the spot."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "passable_m": self.passable,
            "free_m": self.free,
            "own_m": self.own,
            "turning_m": self.turning,
        }


@dataclass(frozen=True, slots=True)
class PassageReport:
    """All narrow places of a map under one parameter set."""

    passages: tuple[Passage, ...]
    """The narrowest first."""
    widths: Widths
    costmap: Costmap
    """What was looked at: the map, inflated."""
    costmap_name: str
    inscribed_radius: float
    """With the padding (m)."""
    circumscribed_radius: float
    inflation_radius: float
    """0 without an inflation layer (m)."""
    narrowest: float
    """Openings narrower than this were left out (m)."""
    widest: float
    """And those wider than this."""
    unknown_border: float
    """Share of the free space's border that is unknown, not occupied: there no passage is found, nor a cost."""

    def count(self, verdict: Verdict) -> int:
        """Passages of that verdict."""
        return sum(passage.verdict == verdict for passage in self.passages)

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "costmap": self.costmap_name,
            "inscribed_radius_m": self.inscribed_radius,
            "circumscribed_radius_m": self.circumscribed_radius,
            "inflation_radius_m": self.inflation_radius,
            "narrowest_m": self.narrowest,
            "widest_m": self.widest,
            "unknown_border": self.unknown_border,
            "needs": self.widths.as_dict(),
            "counts": {verdict: self.count(verdict) for verdict in VERDICTS},
            "passages": [passage.as_dict() for passage in self.passages],
        }


def find_passages(
    configuration: Configuration,
    static_map: OccupancyGrid,
    *,
    costmap: str = "global",
    narrowest: float | None = None,
    widest: float | None = None,
    unknown_is_wall: bool = False,
) -> PassageReport:
    """Doors and narrow places of a map, judged by what the `global` or `local` costmap makes of its walls.

    Widths in metres: `narrowest` defaults to the inscribed radius (half as wide as the robot: a crack), `widest` to where
    inflation ends. `unknown_is_wall` takes the border to unknown space for a wall as well, for maps whose walls were never
    quite seen. Raises InputError for limits that leave nothing.
    """
    chosen = configuration.local_costmap if costmap == "local" else configuration.global_costmap
    live = _inflated_map(chosen, static_map, costmap)
    inflation = next((x for x in live.layers if isinstance(x, InflationLayer) and x.params.enabled), None)
    radius = float(inflation.params.inflation_radius) if inflation is not None else 0.0
    inscribed, circumscribed = chosen.footprint.inscribed_radius, chosen.footprint.circumscribed_radius
    resolution = live.master.geometry.resolution
    low = inscribed if narrowest is None else narrowest
    high = max(1.25, 2.0 * (radius + resolution)) if widest is None else widest
    if not (0.0 <= low <= high and math.isfinite(high)):
        raise InputError(
            f"no passage is wider than {low:g} m and narrower than {high:g} m; give --narrowest below --widest",
            narrowest=low,
            widest=high,
        )
    costs = live.master.data
    # where unknown space is not told from free space, the map still knows
    wall = costs == LETHAL
    known = _known(static_map, live)
    if unknown_is_wall:
        wall = wall | ~known
    places = narrow_places(
        wall,
        known & ~wall,
        narrowest=max(2.0, low / resolution + 1.0 - 1e-6),
        widest=high / resolution + 1.0 + 1e-6,
        widening=max(3.0, _WIDENING_M / resolution),
        relative=_WIDENING,
        clutter=ISLAND_M / resolution,
    )
    judge = _Judge(live, chosen, inflation)
    return PassageReport(
        passages=tuple(judge.passage(place) for place in places),
        widths=judge.widths(),
        costmap=live.master,
        costmap_name=costmap,
        inscribed_radius=inscribed,
        circumscribed_radius=circumscribed,
        inflation_radius=radius,
        narrowest=low,
        widest=high,
        unknown_border=_unknown_border(known, costs == LETHAL),
    )


def _inflated_map(chosen: CostmapConfiguration, static_map: OccupancyGrid, name: str) -> LayeredCostmap:
    """The map as a costmap of these parameters has it before any sensor spoke: all of it, at the map's resolution."""
    params = chosen.params.model_copy(
        update={"global_frame": static_map.frame, "robot_base_frame": "base", "rolling_window": False}
    )
    kinds = (StaticLayer, KeepoutMaskLayer, InflationLayer)
    specs = [LayerSpec(x.name, x.cls, x.params) for x in chosen.layers if issubclass(x.cls, kinds)]
    if not any(issubclass(spec.cls, StaticLayer) for spec in specs):
        # it sees the same walls through its sensors
        specs.insert(0, LayerSpec("static_layer", StaticLayer, StaticLayer.Params()))
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


def _known(static_map: OccupancyGrid, live: LayeredCostmap) -> NDArray[np.bool_]:
    """Cells the map knows, on the costmap's grid."""
    if static_map.data.shape == live.master.data.shape and static_map.origin_yaw == 0.0:
        return static_map.data >= 0
    layer = next(x for x in live.layers if isinstance(x, StaticLayer))
    return _layer_known(layer, live.master)


def _layer_known(layer: StaticLayer, master: Costmap) -> NDArray[np.bool_]:
    """Cells of the master at which a turned map says something."""
    from navstack.costmap.static_layer import map_from_frame

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


def _unknown_border(known: NDArray[np.bool_], wall: NDArray[np.bool_]) -> float:
    """Of the neighbours of free cells that are not free, the share that is unknown."""
    free = known & ~wall
    beside = np.zeros_like(free)
    beside[1:] |= free[:-1]
    beside[:-1] |= free[1:]
    beside[:, 1:] |= free[:, :-1]
    beside[:, :-1] |= free[:, 1:]
    unknown, walls = int((beside & ~known).sum()), int((beside & wall).sum())
    return unknown / (unknown + walls) if unknown + walls else 0.0


class _Judge:
    """What the costmap makes of an opening."""

    def __init__(self, live: LayeredCostmap, chosen: CostmapConfiguration, inflation: InflationLayer | None) -> None:
        self.master = live.master
        self.chosen = chosen
        self.inflation = inflation
        self.inscribed = chosen.footprint.inscribed_radius
        self.circumscribed = chosen.footprint.circumscribed_radius
        self.own = 2.0 * chosen.true_footprint.inscribed_radius

    def passage(self, place: NarrowPlace) -> Passage:
        g = self.master.geometry
        ends = (g.cell_to_world(*place.first), g.cell_to_world(*place.second))
        width = (place.distance - 1.0) * g.resolution
        # of all the bars of a stretch one has to cross, the dearest
        cost, clearance = max((self._crossing(*bar) for bar in place.bars), key=lambda c: (c[0], -c[1]))
        verdict: Verdict = "free" if cost < HALF else "costly" if cost < INSCRIBED else "blocked"
        fits, can_turn = width >= self.own - 1e-9, width >= 2.0 * self.circumscribed - 1e-9
        return Passage(
            x=(ends[0][0] + ends[1][0]) / 2.0,
            y=(ends[0][1] + ends[1][1]) / 2.0,
            ends=ends,
            width=round(width, 6),
            length=round(place.stretch * g.resolution, 6),
            cost=cost,
            clearance=round(clearance, 6),
            verdict=verdict,
            fits=fits,
            can_turn=can_turn,
            reason=self._reason(cost, clearance, fits, can_turn),
        )

    def _crossing(self, first: tuple[int, int], second: tuple[int, int]) -> tuple[int, float]:
        """The least cost between two obstacle cells, and how far from the nearer of them it is (m)."""
        a, b = np.array(first), np.array(second)
        steps = max(2, math.ceil(4.0 * math.dist(first, second)))
        along = a + (b - a) * (np.arange(1, steps)[:, None] / steps)
        cells = np.unique(np.floor(along + 0.5).astype(np.int64), axis=0)
        apart = np.minimum(np.hypot(*(cells - a).T), np.hypot(*(cells - b).T))
        cells, apart = cells[apart > 0.0], apart[apart > 0.0]
        costs = self.master.data[cells[:, 1], cells[:, 0]].astype(np.int64)
        costs[costs == UNKNOWN] = 0 if (costs == UNKNOWN).all() else LETHAL
        # of equals, the one farthest from the walls
        best = int(np.lexsort((-apart, costs))[0])
        return int(costs[best]), float(apart[best]) * self.master.geometry.resolution

    def _reason(self, cost: int, clearance: float, fits: bool, can_turn: bool) -> str:
        said = f"{clearance:.2f} m from the walls"
        if self.inflation is None:
            said += ", and no inflation layer keeps the robot away"
        elif cost >= INSCRIBED:
            said += f", inscribed radius {self.inscribed:.2f} m"
        elif cost == 0:
            said += f", inflated up to {self.inflation.params.inflation_radius:.2f} m"
        else:
            said += f": cost {cost} of 252"
        if cost < INSCRIBED and not fits:
            said += f"; narrower than the robot ({self.own:.2f} m), which may touch"
        elif cost < INSCRIBED and not can_turn:
            said += f"; cannot turn there (circumscribed radius {self.circumscribed:.2f} m)"
        return said

    def widths(self) -> Widths:
        """What this robot needs."""
        return Widths(
            passable=round(self._narrowest(INSCRIBED), 6),
            free=round(self._narrowest(HALF), 6),
            own=self.own,
            turning=2.0 * self.circumscribed,
        )

    def _narrowest(self, cost: int) -> float:
        """Width of the narrowest opening along the grid whose middle costs less (m).

        Of n free cells between two walls, the middle one is (n + 1) // 2 cells from the nearer wall.
        """
        resolution = self.master.geometry.resolution
        layer = self.inflation
        if layer is None:
            return resolution
        away = np.arange(1.0, layer.radius_cells + 2.0)
        # the layer reckons in the map message's float32
        distances: NDArray[np.float64] = (away * float(np.float32(resolution))).astype(np.float64)
        costs = inflation_cost(distances, layer.inscribed_radius, layer.params.cost_scaling_factor).astype(np.int64)
        costs[away > layer.radius_cells] = 0
        cells = int(away[int(np.argmax(costs < cost))])
        return (2 * cells - 1) * resolution
