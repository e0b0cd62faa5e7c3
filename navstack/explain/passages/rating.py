"""Rates passages by the costs between their sides."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, LETHAL, UNKNOWN, Costmap
from navstack.costmap.inflation_layer import InflationLayer, inflation_cost
from navstack.explain.passages.narrow_places import NarrowPlace
from navstack.explain.passages.report import HIGH_COST, Passage, Rating, RequiredWidths
from navstack.parameters.configuration import CostmapConfiguration


class PassageRater:
    """Rates passages in a costmap for the robot of a configuration."""

    def __init__(self, master: Costmap, chosen: CostmapConfiguration, inflation: InflationLayer | None) -> None:
        self.master = master
        self.inflation = inflation
        self.inscribed = chosen.footprint.inscribed_radius
        self.circumscribed = chosen.footprint.circumscribed_radius
        self.robot_width = 2.0 * chosen.true_footprint.inscribed_radius

    def passage(self, place: NarrowPlace) -> Passage:
        """The rated passage at a narrow place."""
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
        """The lowest cost between two obstacle cells, and the distance of that cell to the nearer of them (m)."""
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
        """The widths that this robot requires."""
        return RequiredWidths(
            minimum=round(self._narrowest_below(INSCRIBED), 6),
            low_cost=round(self._narrowest_below(HIGH_COST), 6),
            robot=self.robot_width,
            turning=2.0 * self.circumscribed,
        )

    def _narrowest_below(self, cost: int) -> float:
        """Width of the narrowest passage along the grid whose centreline costs less than `cost` (m).

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
