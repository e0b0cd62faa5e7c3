"""smac_hybrid: Hybrid-A* (D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel, 2008) with the parameters of Nav2's planner."""

from __future__ import annotations

import math
from typing import Any, Literal

from navstack.global_planner._se2.params import PosePlannerParams
from navstack.global_planner._se2.planner import PosePlanner
from navstack.global_planner._se2.primitives import PrimitiveTable, hybrid_arcs, hybrid_table
from navstack.global_planner._se2.shape import Shape
from navstack.plugins import GLOBAL_PLANNERS, param


class SmacHybridParams(PosePlannerParams):
    """Parameters of smac_hybrid."""

    motion_model_for_search: Literal["DUBIN", "REEDS_SHEPP"] = param(
        "DUBIN", "DUBIN: the robot drives forward only; REEDS_SHEPP: also backward"
    )
    angle_quantization_bins: int = param(72, "number of headings of the search", ge=4, le=360)
    minimum_turning_radius: float = param(
        0.4, "turning radius of the robot; at least one cell of the search", unit="m", gt=0.0, le=1000.0
    )
    allow_primitive_interpolation: bool = param(
        True,
        "whether arcs of larger radii are added to the primitives where the smallest one turns by several headings",
    )
    downsample_costmap: bool = param(
        False, "whether the search uses blocks of downsampling_factor x downsampling_factor cells"
    )
    downsampling_factor: int = param(
        1, "cells per side of these blocks, whose cost is the highest in them", ge=1, le=64
    )


@GLOBAL_PLANNERS.register("smac_hybrid", aliases=("nav2_smac_planner/SmacPlannerHybrid", "smac_planner_hybrid"))
class SmacHybridPlanner(PosePlanner):
    """smac_hybrid: plans for a robot with a footprint and a turning radius, forward or in both directions.

    States are (cell, cell, heading) with the exact pose that reached them. Motions are arcs and straight lines as in Nav2; the
    headings are those of the start plus multiples of a bin, so plans begin at the start's and end at the goal's exact heading.
    Curves to the goal (Dubins or Reeds-Shepp) compete with the rest of the search by their cost. `Plan.cost` is in meters of
    free straight driving.
    """

    Params = SmacHybridParams
    params: SmacHybridParams
    finer_headings = (2, 4)

    def __init__(self, params: SmacHybridParams | None = None) -> None:
        super().__init__(params or SmacHybridParams())

    @property
    def downsampling(self) -> int:
        """Cells of the costmap per cell of the search."""
        return self.params.downsampling_factor if self.params.downsample_costmap else 1

    def _radius(self, resolution: float) -> float:
        """The turning radius in cells of the search, at least 1."""
        return max(1.0, self.params.minimum_turning_radius / resolution)

    def settings(self, resolution: float) -> dict[str, Any]:
        """Return the settings of the search for this motion model."""
        return {
            "bins": self.params.angle_quantization_bins,
            "radius": self._radius(resolution),
            "reeds_shepp": self.params.motion_model_for_search == "REEDS_SHEPP",
        }

    def table(self, resolution: float, shape: Shape, start_yaw: float, finer: int) -> tuple[PrimitiveTable, int]:
        """Return the arcs of the turning radius, at headings that contain the start's, `finer` times as many as usual."""
        p = self.params
        bins = finer * p.angle_quantization_bins
        width = 2.0 * math.pi / bins
        arcs = hybrid_arcs(
            self._radius(resolution),
            bins,
            reverse=p.motion_model_for_search == "REEDS_SHEPP",
            interpolate=p.allow_primitive_interpolation,
        )
        nearest = round(start_yaw / width)
        table = hybrid_table(arcs, bins, start_yaw - nearest * width, reach=shape.reach, step=shape.step)
        return table, nearest % bins

    def heading_bin(self, table: PrimitiveTable, yaw: float) -> int:
        """Return the bin nearest to a heading (rad)."""
        bins = len(table.headings)
        return round((yaw - float(table.headings["yaw"][0])) * bins / (2.0 * math.pi)) % bins

    def goal_headings(self) -> int:
        """Return how many headings ALL_DIRECTION stands for."""
        return self.params.angle_quantization_bins
