"""Map files against what the real map_server made of them, and every foreign map there is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from navstack.core import MapError
from navstack.map_io import load_map, save_map
from tests.conftest import data_files, golden_files


def test_willow_is_what_map_server_published(data_dir: Path, golden_dir: Path) -> None:
    grid = load_map(data_dir / "maps/turtlebot_apps__willow-2010-02-18-0.10/willow-2010-02-18-0.10.yaml")
    for path in sorted(golden_dir.glob("costmap_static_willow010_*.npz")):
        np.testing.assert_array_equal(grid.data, np.load(path)["occupancy"])
    assert grid.geometry.shape == (608, 566)
    assert grid.geometry.resolution == 0.1


@pytest.mark.parametrize("path", golden_files("costmap_static_ten_*.npz"), ids=lambda p: p.stem)
def test_ten_by_ten_in_every_mode(path: Path, data_dir: Path, tmp_path: Path) -> None:
    mode = "raw" if "_raw_" in path.stem else "scale" if "_scale_" in path.stem else "trinary"
    image = data_dir / "maps/navigation2__TenByTen/TenByTen.pgm"
    yaml = tmp_path / "ten.yaml"
    yaml.write_text(
        f"image: {image}\nresolution: 1.0\norigin: [0, 0, 0]\nnegate: 0\n"
        f"occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: {mode}\n"
    )
    np.testing.assert_array_equal(load_map(yaml).data, np.load(path)["occupancy"])


@pytest.mark.parametrize("path", data_files("maps/*/*.yaml"), ids=lambda p: p.parent.name)
def test_foreign_maps_load_and_survive_saving(path: Path, tmp_path: Path) -> None:
    if "image: /" in path.read_text():  # a path of its author's machine: the message says what to write
        with pytest.raises(MapError, match="the folder of the YAML file contains it"):
            load_map(path)
        return
    grid = load_map(path)
    assert grid.data.dtype == np.int8
    assert grid.data.flags.c_contiguous
    assert len(np.unique(grid.data)) > 1
    yaml, image = save_map(grid, tmp_path / "copy.yaml")
    again = load_map(yaml)
    np.testing.assert_array_equal(again.data, grid.data)
    assert (again.geometry, again.origin_yaw) == (grid.geometry, grid.origin_yaw)
    assert image.exists()
