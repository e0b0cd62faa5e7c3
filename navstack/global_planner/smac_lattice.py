"""smac_lattice: A* on a state lattice (M. Pivtoraiko, R. Knepper, A. Kelly, 2009) with the parameters of Nav2's planner."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, cast

from navstack.core import InputError
from navstack.global_planner._lattice import Lattice, MotionModel
from navstack.global_planner._lattice_file import read_lattice
from navstack.global_planner._lattice_generate import generate_lattice
from navstack.global_planner._se2.lattice_table import LatticeTables, bins_of
from navstack.global_planner._se2.params import PosePlannerParams
from navstack.global_planner._se2.planner import PosePlanner
from navstack.global_planner._se2.primitives import PrimitiveTable
from navstack.global_planner._se2.shape import Shape
from navstack.plugins import GLOBAL_PLANNERS, CheckContext, Issue, param

_SAMPLE: Final = re.compile(
    r"(?P<old>old_)?(?P<cell>[\d.]+)cm_resolution/(?P<radius>[\d.]+)m_turning_radius/(?P<model>ackermann|diff|omni)/output\.json$"
)
_SAME_RESOLUTION: Final = 1e-3
_DEFAULT_RADIUS_M: Final = 0.5


class SmacLatticeParams(PosePlannerParams):
    """Parameters of smac_lattice."""

    lattice_filepath: str = param(
        "",
        "file with the motion primitives (`navstack lattice generate`). Empty: generated for a turning radius of 0.5 m, 16 "
        "headings, a car, and the costmap's cells, as Nav2's default file is. Nav2's sample files need not exist: what "
        "`5cm_resolution/0.5m_turning_radius/diff/output.json` contains is generated",
        ros_differs="Nav2's default is the installed file 5cm_resolution/0.5m_turning_radius/ackermann/output.json",
    )
    allow_reverse_expansion: bool = param(
        False, "whether the primitives are driven backward, too; has no effect on omnidirectional ones"
    )
    change_penalty: float = param(0.05, "added to non_straight_penalty where the direction of turning changes", ge=0.0)
    non_straight_penalty: float = param(1.05, "factor on the cost of turning", ge=1.0)
    rotation_penalty: float = param(5.0, "cost of a turn in place to the next heading, in cells", ge=0.0)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what is wrong with the primitive file."""
        yield from super().check(context)
        if not self.lattice_filepath:
            return
        path = Path(self.lattice_filepath).expanduser()
        if path.exists():
            try:
                read_lattice(path)
            except InputError as error:
                yield Issue("error", "lattice-file", ("lattice_filepath",), error.message)
        elif _SAMPLE.search(path.as_posix()) is None:
            message = f"the file {path} does not exist; write one with `navstack lattice generate --out {path.name}`"
            yield Issue("error", "lattice-file", ("lattice_filepath",), message)


@GLOBAL_PLANNERS.register("smac_lattice", aliases=("nav2_smac_planner/SmacPlannerLattice", "smac_planner_lattice"))
class SmacLatticePlanner(PosePlanner):
    """smac_lattice: plans of motion primitives for robots that steer, turn in place, or drive in any direction.

    Primitives are read from a file in Nav2's format, or generated. They start and end at the headings of the lattice; from the
    start's own heading, arcs lead onto the lattice, and curves (or lines, for an omnidirectional robot) lead to the exact goal.
    Each primitive costs its mean over the cells on its way. `Plan.cost` is in meters of free straight driving.
    """

    Params = SmacLatticeParams
    params: SmacLatticeParams

    def __init__(self, params: SmacLatticeParams | None = None) -> None:
        super().__init__(params or SmacLatticeParams())
        self._lattices: dict[float, Lattice] = {}
        self._tables: dict[tuple[float, float, float], LatticeTables] = {}

    def lattice(self, resolution: float) -> Lattice:
        """Return the primitives for cells of `resolution` (m).

        Raises InputError for a primitive file that cannot be read, or is for cells of another size.
        """
        if resolution not in self._lattices:
            self._lattices[resolution] = load_lattice(self.params.lattice_filepath, resolution)
        return self._lattices[resolution]

    @property
    def _reverse(self) -> bool:
        return self.params.allow_reverse_expansion

    @property
    def shortest_in_the_open(self) -> bool:
        """Whether the robot steers: one that turns in place, or drives in any direction, has shorter ways than curves."""
        return next(iter(self._lattices.values())).motion_model == "ackermann"

    def settings(self, resolution: float) -> dict[str, Any]:
        """Return the settings of the search for these primitives."""
        lattice = self.lattice(resolution)
        holonomic = lattice.motion_model == "omni"
        return {
            "bins": bins_of(lattice),
            "radius": max(1.0, lattice.turning_radius / resolution),
            "reeds_shepp": self._reverse and not holonomic,
            "holonomic": holonomic,
            "rotation": self.params.rotation_penalty,
        }

    def table(self, resolution: float, shape: Shape, start_yaw: float, finer: int) -> tuple[PrimitiveTable, int]:
        """Return the primitives of the file, and those from the start's heading; its headings are those of the file."""
        del finer
        key = (resolution, shape.reach, shape.step)
        if key not in self._tables:
            lattice = self.lattice(resolution)
            reverse = self._reverse and lattice.motion_model != "omni"
            self._tables[key] = LatticeTables(lattice, reverse=reverse, reach=shape.reach, step=shape.step)
        return self._tables[key].table(start_yaw)

    def heading_bin(self, table: PrimitiveTable, yaw: float) -> int:
        """Return the heading of the lattice nearest to one (rad)."""
        lattice = next(iter(self._lattices.values()))
        return lattice.nearest_heading(yaw)

    def goal_headings(self) -> int:
        """Return how many headings ALL_DIRECTION stands for."""
        return len(next(iter(self._lattices.values())).headings)


def load_lattice(path: str, resolution: float) -> Lattice:
    """Return the primitives of `lattice_filepath` for cells of `resolution` (m).

    Raises InputError for a file that cannot be read, or is for cells of another size.
    """
    if not path:
        try:
            return generate_lattice(_DEFAULT_RADIUS_M, resolution)
        except InputError as exc:
            message = f"smac_lattice needs a file of primitives for this costmap (lattice_filepath): {exc.message}"
            raise InputError(message, costmap_resolution=resolution) from None
    file = Path(path).expanduser()
    sample = _SAMPLE.search(file.as_posix())
    if sample is not None and not file.exists():
        lattice = generate_lattice(
            float(sample["radius"]),
            float(sample["cell"]) / 100.0,
            motion_model=cast("MotionModel", sample["model"]),
            distinctness_ratio=0.0 if sample["old"] else 0.9,
        )
    else:
        lattice = read_lattice(file)
    if abs(lattice.resolution / resolution - 1.0) > _SAME_RESOLUTION:
        raise InputError(
            f"the primitives of {path} are for cells of {lattice.resolution:g} m, but the costmap has cells of {resolution:g} m; "
            f"generate them with `navstack lattice generate --radius {lattice.turning_radius:g} --resolution {resolution:g} "
            f"--motion-model {lattice.motion_model}`, or leave lattice_filepath empty",
            lattice_filepath=path,
            lattice_resolution=lattice.resolution,
            costmap_resolution=resolution,
        )
    return lattice
