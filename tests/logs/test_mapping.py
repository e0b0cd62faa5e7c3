"""Maps from logs with known poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from navstack.core import LogError, Transform2D
from navstack.localization import LoggedScan
from navstack.logs.mapping import map_from_frames
from navstack.logs.scan_log import ScanLog, logged_scans
from navstack.logs.scan_log_formats import open_scan_log
from navstack.map_io import load_map, save_map
from tests.localization.rooms import rooms, scan_from
from tests.logs.carmen_files import circle, write_corrected_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> ScanLog:
    path = tmp_path_factory.mktemp("log") / "drive.log"
    return open_scan_log(write_corrected_log(path, rooms(), circle(Transform2D(1.0, 4.5, 0.2), 12)))


def test_the_map_is_that_of_the_world(log: ScanLog) -> None:
    world = rooms()
    grid, scans = map_from_frames(lambda: logged_scans(log), resolution=0.1)
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


def test_the_same_log_gives_the_same_map_and_it_reads_back(log: ScanLog, tmp_path: Path) -> None:
    first, _ = map_from_frames(lambda: logged_scans(log, every=2), resolution=0.1)
    again, count = map_from_frames(lambda: logged_scans(log, every=2), resolution=0.1)
    assert count == 6
    assert np.array_equal(first.data, again.data)
    yaml, _ = save_map(first, tmp_path / "map.yaml")
    assert np.array_equal(load_map(yaml).data, first.data)
    assert load_map(yaml).geometry == first.geometry


def test_a_log_without_reference_and_a_map_that_is_too_large(log: ScanLog) -> None:
    scan = scan_from(rooms(), Transform2D(1.0, 4.5, 0.2))

    class Bare(ScanLog):
        def __iter__(self):  # type: ignore[no-untyped-def]
            yield LoggedScan(0, scan, Transform2D(), Transform2D(), None)

    with pytest.raises(LogError, match="no scan of the log has a reference pose"):
        map_from_frames(lambda: logged_scans(Bare(Path("bare"))))
    with pytest.raises(LogError, match=r"coarser --resolution than 0\.0001 m"):
        map_from_frames(lambda: logged_scans(log), resolution=1e-4)
