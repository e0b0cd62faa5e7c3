"""Occupancy grids: the maps that map_server publishes, and how arrays become one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navstack.core.errors import InputError
from navstack.core.grid import GridGeometry

Values = Literal["occupied", "free", "occupancy", "probability"]
"""What the values of an array mean, see `OccupancyGrid.from_array`."""

OCCUPIED_THRESHOLD: Final = 0.65
FREE_THRESHOLD: Final = 0.196
"""The thresholds of map_server: from 65 % a cell is occupied, up to 19.6 % it is free, between them it is unknown."""

_MEANINGS: Final = (
    'values="occupied" (nonzero is occupied), values="free" (nonzero is free), values="occupancy" (0 free .. 100 occupied, '
    '-1 unknown) or values="probability" (0 free .. 1 occupied, NaN unknown)'
)


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """A map as published by map_server: `data` (ny, nx) int8, 0 free .. 100 occupied, -1 unknown, in `frame`.

    `origin_yaw` (rad) rotates the grid about its lower left corner. costmap_2d ignores it; navstack's static layer applies it.
    With `raw`, any int8 is a valid value, as map_server publishes in the mode raw. Raises InputError for an array of
    another dtype or shape, for values out of range, and for a geometry that is none: use `from_array` for other arrays.
    """

    data: NDArray[np.int8]
    geometry: GridGeometry
    origin_yaw: float = 0.0
    frame: str = "map"
    raw: bool = False

    def __post_init__(self) -> None:
        data: Any = self.data  # callers without a type checker pass anything
        geometry: Any = self.geometry
        frame: Any = self.frame
        if not isinstance(geometry, GridGeometry):
            raise InputError(
                f"the geometry of an occupancy grid must be a GridGeometry, not {_short(self.geometry)}; use "
                "OccupancyGrid.from_array(array, resolution)",
                argument="geometry",
            )
        if getattr(data, "dtype", None) != np.int8:
            found = getattr(data, "dtype", type(data).__name__)
            raise InputError(
                f"the data of an occupancy grid must be an int8 array (0 free .. 100 occupied, -1 unknown), not {found}; "
                "use OccupancyGrid.from_array(array, resolution)",
                argument="data",
            )
        if self.data.shape != self.geometry.shape:
            raise InputError(
                f"the data of an occupancy grid must have the shape (ny, nx) = {self.geometry.shape} of its geometry, not "
                f"{self.data.shape}",
                argument="data",
            )
        if not self.raw:
            _require_range(self.data, -1, 100)
        if not is_number(self.origin_yaw) or not math.isfinite(self.origin_yaw):
            raise InputError(
                f"origin_yaw must be a finite angle in radians, not {_short(self.origin_yaw)}", argument="origin_yaw"
            )
        if not isinstance(frame, str) or not frame:
            raise InputError(
                f'the frame of an occupancy grid must be a name such as "map", not {_short(self.frame)}',
                argument="frame",
            )

    @classmethod
    def from_array(
        cls,
        array: ArrayLike,
        resolution: float,
        *,
        origin: tuple[float, float] = (0.0, 0.0),
        values: Values | None = None,
        frame: str = "map",
    ) -> OccupancyGrid:
        """Return the map of an array (ny, nx): `array[iy, ix]`, row 0 has the smallest y (an image has it at the bottom).

        `resolution` is the size of a cell (m), `origin` the lower left corner (x, y; m) in `frame`. The result contains 0,
        100 and -1 only. `values` names the meaning of the array:

        - `occupied`: nonzero is occupied. The default for bool.
        - `free`: nonzero is free.
        - `occupancy`: whole numbers, 0 free .. 100 occupied, -1 unknown. The default for integers, unless all of them
          are 0 and 1, which could mean either. From 65 a cell is occupied, up to 19 it is free, between them it is
          unknown (the thresholds of map_server).
        - `probability`: 0 free .. 1 occupied, NaN unknown, with the same thresholds.

        Floats have no default. Raises InputError.
        """
        cells = _cells(array)
        meaning = _meaning(cells, values)
        if not is_number(resolution) or not (math.isfinite(resolution) and resolution > 0.0):
            raise InputError(
                f"the resolution must be a positive number of meters per cell, not {_short(resolution)}; write for "
                "example 0.05",
                argument="resolution",
            )
        ny, nx = cells.shape
        x, y = _corner(origin)
        geometry = GridGeometry(nx, ny, float(resolution), x, y)
        return cls(_trinary(cells, meaning), geometry, frame=frame)

    def __repr__(self) -> str:
        nx, ny, size = self.geometry.nx, self.geometry.ny, self.geometry.resolution
        known = float((self.data != -1).mean()) if self.data.size else 0.0
        extent = f"{nx * size:.1f} x {ny * size:.1f} m"
        return f"OccupancyGrid({nx} x {ny} cells of {size:g} m, {extent}, {known:.0%} known, frame {self.frame!r})"


def _cells(array: ArrayLike) -> NDArray[Any]:
    """Return a two-dimensional array of numbers or bools that has cells."""
    try:
        cells = np.asarray(array)
    except ValueError as error:
        raise InputError(f"the map is not an array (ny, nx): {error}", argument="array") from None
    if cells.ndim != 2 or cells.size == 0:
        raise InputError(
            f"a map must be an array (ny, nx) with at least one cell, not of shape {cells.shape}", argument="array"
        )
    if cells.dtype.kind not in "biuf":
        raise InputError(f"a map must be an array of bools or numbers, not of {cells.dtype}", argument="array")
    return cells


def _meaning(cells: NDArray[Any], values: str | None) -> str:
    if values is not None:
        if values not in get_args(Values):
            raise InputError(f"values={values!r} is unknown; pass {_MEANINGS}", argument="values")
        if values == "occupancy" and cells.dtype.kind == "b":
            raise InputError('values="occupancy" needs numbers up to 100, not bools; pass values="occupied"')
        return values
    if cells.dtype.kind == "b":
        return "occupied"
    if cells.dtype.kind == "f":
        raise InputError(
            f"the values of a {cells.dtype} map have no default meaning; pass {_MEANINGS}", argument="values"
        )
    if cells.max() == 1 and cells.min() >= 0:
        raise InputError(f"all values of the map are 0 and 1, which is ambiguous; pass {_MEANINGS}", argument="values")
    return "occupancy"


def _trinary(cells: NDArray[Any], meaning: str) -> NDArray[np.int8]:
    """Return (ny, nx) int8: 0 free, 100 occupied, -1 unknown."""
    if meaning in ("occupied", "free"):
        if cells.dtype.kind == "f" and not np.isfinite(cells).all():
            _refuse(cells, ~np.isfinite(cells), "which is not finite")
        return np.where((cells != 0) == (meaning == "occupied"), 100, 0).astype(np.int8)
    if meaning == "occupancy":
        if cells.dtype.kind == "f" and (cells != np.rint(cells)).any():
            _refuse(cells, cells != np.rint(cells), "which is not a whole number from -1 to 100")
        _require_range(cells, -1, 100)
        share, unknown = cells / 100.0, cells == -1
    else:
        unknown = np.isnan(cells) if cells.dtype.kind == "f" else np.zeros(cells.shape, np.bool_)
        _require_range(np.where(unknown, 0, cells), 0, 1)
        share = cells.astype(np.float64)
    known = np.where(share >= OCCUPIED_THRESHOLD, 100, np.where(share <= FREE_THRESHOLD, 0, -1))
    return np.where(unknown, -1, known).astype(np.int8)


def _require_range(cells: NDArray[Any], lowest: int, highest: int) -> None:
    if int(cells.min() < lowest) or int(cells.max() > highest):
        hint = "; load images with load_map; costs belong into a Costmap" if highest == 100 else ""
        _refuse(cells, (cells < lowest) | (cells > highest), f"which is not in {lowest} .. {highest}{hint}")


def _refuse(cells: NDArray[Any], wrong: NDArray[np.bool_], problem: str) -> None:
    """Raise InputError for the first of the wrong cells."""
    iy, ix = np.argwhere(wrong)[0].tolist()
    value = cells[iy, ix].item()
    raise InputError(f"the map has the value {value!r} at [iy={iy}, ix={ix}], {problem}", value=value, cell=(ix, iy))


def _corner(origin: Any) -> tuple[float, float]:
    try:
        x, y = (float(v) for v in origin)
    except (TypeError, ValueError):
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"the origin must be (x, y) in meters, not {_short(origin)}", argument="origin")
    return x, y


def is_number(value: object) -> bool:
    """Return True for a number that is not a bool."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + ".."
