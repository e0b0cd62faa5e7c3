"""Finds the passages of a map and rates them by the costmap of a parameter set."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, OccupancyGrid
from navstack.core.errors import InputError
from navstack.costmap import LayeredCostmap
from navstack.costmap.inflation_layer import InflationLayer
from navstack.explain.passages.inflated_map import inflated_map, known_cells
from navstack.explain.passages.narrow_places import NarrowPlace, narrow_places
from navstack.explain.passages.rating import PassageRater
from navstack.explain.passages.report import PassageReport
from navstack.explain.passages.shape import Shape
from navstack.parameters.configuration import Configuration

WIDENING_M = 0.15
"""On both sides of a passage, free space widens by this length and by the share `WIDENING` at least.

Smaller changes are a rough wall or a row of posts.
"""
WIDENING = 0.25
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
    the width at which inflation ends. The report counts the narrower ones. `smallest_obstacle` (m) leaves out the gaps beside
    smaller free-standing obstacles, which the robot can drive around. `unknown_is_wall` treats unknown space as walls, for
    maps whose walls are unknown cells. For a robot that is not round, `PassageReport.shapes` has the headings at which it passes
    and, with a `turning_radius` (m; default: that of base and controller), a way through. `progress(done, total)` is called
    after each of these.
    Raises InputError for limits without a width between them.
    """
    chosen = configuration.local_costmap if costmap == "local" else configuration.global_costmap
    live = inflated_map(chosen, static_map, costmap)
    inflation = next((x for x in live.layers if isinstance(x, InflationLayer) and x.params.enabled), None)
    radius = float(inflation.params.inflation_radius) if inflation is not None else 0.0
    low = chosen.footprint.inscribed_radius if narrowest is None else narrowest
    high = _upper_limit(live, radius) if widest is None else widest
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
        else Shape(chosen.footprint, radius_m).passages(_walled(live.master, wall), passages, progress),
    )


def _walled(costmap: Costmap, wall: NDArray[np.bool_]) -> Costmap:
    """The costmap with lethal cells wherever `wall` (ny, nx) is True."""
    return Costmap(costmap.geometry, np.where(wall, LETHAL, costmap.data).astype(np.uint8), costmap.frame)


def _upper_limit(live: LayeredCostmap, inflation_radius: float) -> float:
    """The width from which on inflation does not reach the centreline, but at least that of a door (m)."""
    return max(_LEAST_UPPER_LIMIT_M, 2.0 * (inflation_radius + live.master.geometry.resolution))


def _search(
    wall: NDArray[np.bool_],
    free: NDArray[np.bool_],
    high: float,
    needed: float,
    smallest: float,
    resolution: float,
) -> list[NarrowPlace]:
    """Narrow places with free widths from one cell to `high` (m), beside obstacles of `smallest` (m) or more.

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
    """Share of unknown cells among the neighbours of free cells that are not free."""
    free = known & ~wall
    beside = np.zeros_like(free)
    beside[1:] |= free[:-1]
    beside[:-1] |= free[1:]
    beside[:, 1:] |= free[:, :-1]
    beside[:, :-1] |= free[:, 1:]
    unknown, walls = int((beside & ~known).sum()), int((beside & wall).sum())
    return unknown / (unknown + walls) if unknown + walls else 0.0
