"""The old form of map_server's arguments: an image and a resolution, without a YAML file."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import yaml

from navstack.core import OccupancyGrid
from navstack.core.errors import InputError
from navstack.core.files import resolved
from navstack.map_io import load_map
from navstack.ros1 import private


def load_image(image: str, resolution: str) -> OccupancyGrid:
    """Return the map of an image with its origin at (0, 0) and `resolution` (m per cell), by map_server's defaults.

    `~negate`, `~occupied_thresh` (0.65) and `~free_thresh` (0.196) are read from the parameter server. Raises InputError and
    MapError.
    """
    try:
        cell = float(resolution)
    except ValueError:
        cell = math.nan
    if not (math.isfinite(cell) and cell > 0.0):
        raise InputError(f"the resolution {resolution} of {image} is not a positive number (m per cell)")
    if not Path(image).is_file():
        raise InputError(f"the image {image} does not exist", file=image)
    document = {
        "image": str(resolved(Path(image))),
        "resolution": cell,
        "origin": [0.0, 0.0, 0.0],
        "negate": int(private.flag("negate", False)),
        "occupied_thresh": private.number("occupied_thresh", 0.65),
        "free_thresh": private.number("free_thresh", 0.196),
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{Path(image).stem}.yaml"
        file.write_text(yaml.safe_dump(document), encoding="utf-8")
        return load_map(file)
