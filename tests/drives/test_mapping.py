"""Maps from logs with known poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from navstack.core import Transform2D
from navstack.core.errors import LogError
from navstack.drives import Drive, Odometry, Scan, drive_frames, open_drive
from navstack.drives.mapping import map_from_frames
from navstack.map_io import load_map, save_map
from tests.drives.carmen_files import circle, write_corrected_log
from tests.localization.rooms import rooms, scan_from


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    path = tmp_path_factory.mktemp("log") / "drive.log"
    return open_drive(write_corrected_log(path, rooms(), circle(Transform2D(1.0, 4.5, 0.2), 12)))


def test_the_map_is_that_of_the_world(log: Drive) -> None:
    world = rooms()
    grid, scans = map_from_frames(lambda: drive_frames(log), resolution=0.1)
    assert scans == 12
    g, w = grid.geometry, world.geometry
    # every wall that was seen is within a cell of a wall of the world (the scans are written with an error of up to 1.5 degrees)
    to_wall = np.asarray(distance_transform_edt(world.data != 100)) * w.resolution
    iy, ix = np.nonzero(grid.data == 100)
    x, y = g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution
    wx, wy = ((x - w.origin_x) / w.resolution).astype(int), ((y - w.origin_y) / w.resolution).astype(int)
    inside = (wx >= 0) & (wy >= 0) & (wx < w.nx) & (wy < w.ny)
    assert inside.mean() > 0.99
    assert np.quantile(to_wall[wy[inside], wx[inside]], 0.9) <= 0.2
    assert (grid.data == 0).sum() > 2000
    assert (grid.data == -1).any()
    assert grid.data[g.world_to_cell(1.0, 4.5)[::-1]] == 0  # type: ignore[index]


def test_the_same_log_gives_the_same_map_and_it_reads_back(log: Drive, tmp_path: Path) -> None:
    first, _ = map_from_frames(lambda: drive_frames(log, every=2), resolution=0.1)
    again, count = map_from_frames(lambda: drive_frames(log, every=2), resolution=0.1)
    assert count == 6
    assert np.array_equal(first.data, again.data)
    yaml, _ = save_map(first, tmp_path / "map.yaml")
    assert np.array_equal(load_map(yaml).data, first.data)
    assert load_map(yaml).geometry == first.geometry


def test_a_log_without_reference_and_a_map_that_is_too_large(log: Drive) -> None:
    scan = scan_from(rooms(), Transform2D(1.0, 4.5, 0.2))

    class Bare(Drive):
        def __iter__(self):  # type: ignore[no-untyped-def]
            yield Odometry(0.0, Transform2D())
            yield Scan(scan, Transform2D())

    with pytest.raises(LogError, match="no scan of the log has a reference pose"):
        map_from_frames(lambda: drive_frames(Bare(Path("bare"))))
    with pytest.raises(LogError, match=r"coarser --resolution than 0\.0001 m"):
        map_from_frames(lambda: drive_frames(log), resolution=1e-4)
