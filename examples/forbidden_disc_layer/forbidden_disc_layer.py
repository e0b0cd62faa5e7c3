"""A costmap layer of one's own: a disc that the robot must keep out of."""

from __future__ import annotations

import numpy as np

from navstack.core import LETHAL, Bounds
from navstack.plugins import Layer, ParamModel, param


class ForbiddenDiscParams(ParamModel):
    """`<costmap>/<name of the layer>:`."""

    x: float = param(0.0, "center of the disc in the costmap's frame", unit="m")
    y: float = param(0.0, "center of the disc in the costmap's frame", unit="m")
    radius: float = param(0.5, "radius of the disc", unit="m", gt=0.0)


class ForbiddenDiscLayer(Layer):
    """Lethal within a disc; list it before the inflation layer, which keeps the whole robot out."""

    Params = ForbiddenDiscParams

    def match_size(self, geometry):
        """Holds no cells."""

    def update_bounds(self, robot, now, bounds):
        """The square around the disc, at every update: what was cleared there is written again."""
        x, y, r = self.params.x, self.params.y, self.params.radius
        return bounds.union(Bounds(x - r, y - r, x + r, y + r))

    def update_costs(self, master, window):
        """Lethal where a cell's center lies in the disc."""
        rows = np.arange(window.y0, window.y1)[:, None]
        x, y = master.geometry.cell_to_world(np.arange(window.x0, window.x1), rows)
        inside = np.hypot(x - self.params.x, y - self.params.y) <= self.params.radius
        master.data[window.slices][inside] = LETHAL
