"""Costs of an array of occupied cells, without layers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, INSCRIBED, LETHAL


def costs_of_occupied(lethal: NDArray[np.bool_], radius_cells: float) -> NDArray[np.uint8]:
    """Return (ny, nx) costs: lethal, inscribed where a lethal cell's centre is within the radius, and free."""
    costs = np.where(lethal, np.uint8(LETHAL), np.uint8(FREE))
    if radius_cells >= 1.0 and lethal.any():
        from scipy.ndimage import distance_transform_edt  # slow import, not needed for a point

        distance = np.asarray(distance_transform_edt(~lethal))
        costs[(distance <= radius_cells + 1e-9) & ~lethal] = INSCRIBED
    return costs
