"""The window of a grid that differs from an earlier state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import Window
from navstack.record._grid_kernels import copy_changes


def copy_changed_window(new: NDArray[np.uint8], last: NDArray[np.uint8], within: Window | None = None) -> Window:
    """Copies the cells of `new` into `last` (both (ny, nx)) and returns the smallest window that contains the changes.

    Only cells in the window `within` (default: all) are compared.
    """
    ny, nx = new.shape
    return Window(*copy_changes(new, last, *(Window(0, 0, nx, ny) if within is None else within)))
