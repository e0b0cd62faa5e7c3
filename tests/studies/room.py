"""A room of 3 x 2 m with scenarios of a few simulated seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image


def make_room(folder: Path, *, names: tuple[str, ...] = ("across", "back")) -> Path:
    """Writes the map and a scenario file per name; returns the folder of the scenarios."""
    cells = np.full((40, 60), 254, np.uint8)
    cells[[0, -1]] = 0
    cells[:, [0, -1]] = 0
    Image.fromarray(cells).save(folder / "room.png")
    (folder / "room.yaml").write_text(
        "image: room.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    suite = folder / "suite"
    suite.mkdir()
    for i, name in enumerate(names):
        ends = ("[0.6, 1.0, 0]", f"[{1.7 + 0.1 * i}, 1.0, 0]")
        (suite / f"{name}.yaml").write_text(
            f"name: {name}\nmap: ../room.yaml\nstart: {ends[0]}\ngoals: [{ends[1]}]\ntime_limit: 20\n"
        )
    return suite
