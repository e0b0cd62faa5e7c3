"""The map of a session, saved with what a person changed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from navstack.core import GridGeometry, OccupancyGrid
from navstack.live import messages
from navstack.live.map_edits import edited_map
from navstack.live.messages import Stroke
from navstack.live.session import Session
from navstack.live.stage import Options, Stage
from navstack.map_io import load_map
from navstack.sim import Shape


def cell(grid: OccupancyGrid, x: float, y: float) -> int:
    """The cell at a point (m) of the map frame."""
    cos, sin = np.cos(-grid.origin_yaw), np.sin(-grid.origin_yaw)
    u, v = x - grid.geometry.origin_x, y - grid.geometry.origin_y
    ix = int((cos * u - sin * v) / grid.geometry.resolution)
    iy = int((sin * u + cos * v) / grid.geometry.resolution)
    return int(grid.data[iy, ix])


@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_walls_are_drawn_and_erased_in_the_map_frame(yaw: float) -> None:
    grid = OccupancyGrid(np.full((60, 80), -1, np.int8), GridGeometry(80, 60, 0.1, -1.0, 2.0), yaw)
    middle = (-1.0 + 4.0 * np.cos(yaw) - 3.0 * np.sin(yaw), 2.0 + 4.0 * np.sin(yaw) + 3.0 * np.cos(yaw))
    x, y = middle
    shapes = [
        Shape(box=[1.0, 0.02], pose=[x, y, 0.5]),  # thinner than a cell
        Shape(radius=0.3, pose=[x + 1.0, y, 0.0]),
        Shape.model_validate(
            {"radius": 0.3, "pose": [x, y + 1.0, 0.0], "motion": {"kind": "pedestrian", "goals": [[x, y]]}}
        ),
    ]
    made = edited_map(grid, shapes, [Stroke(points=[[x - 1.0, y], [x + 1.0, y]], width=0.4)])
    along = [cell(made, x + s * np.cos(0.5), y + s * np.sin(0.5)) for s in np.linspace(-0.45, 0.45, 19)]
    assert along == [100] * 19
    assert cell(made, x + 1.2, y) == 100 and cell(made, x - 0.8, y + 0.1) == 0
    assert cell(made, x, y + 1.0) == -1  # a person is no wall
    assert (grid.data == -1).all()


def test_the_page_saves_a_map(session: Session, tmp_path: Path) -> None:
    session.interact({"kind": "put", "shape": {"name": "box", "box": [0.3, 0.3], "pose": [3.0, 7.5]}})
    stage = Stage([session], Options(save_to=tmp_path))
    grid = session.scenario.map
    iy, ix = np.argwhere(grid.data == 100)[0]
    wall = [grid.geometry.origin_x + (ix + 0.5) * grid.geometry.resolution]
    wall.append(grid.geometry.origin_y + (iy + 0.5) * grid.geometry.resolution)
    request = {"type": "save", "what": "map", "name": "mine", "erased": [{"points": [wall], "width": 0.3}]}
    saved = stage.request(messages.read_request(json.dumps(request)))
    assert "navstack live" in saved.text
    saved_map = load_map(tmp_path / "mine.yaml")
    assert cell(saved_map, 3.0, 7.5) == 100 and cell(saved_map, *wall) == 0
    assert cell(grid, *wall) == 100
