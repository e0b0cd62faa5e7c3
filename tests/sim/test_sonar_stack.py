"""A robot with sonars only: the range sensor layer marks their readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.parameters import load_configuration

PARAMS = """
navstack:
  sim: {lasers: [], bumpers: [], sonars: [ping], ping: {x: 0.1, range_max: 2.0, frequency: 10.0}}
global_costmap: {global_frame: map, robot_base_frame: base_link, robot_radius: 0.2, static_map: true}
local_costmap:
  global_frame: odom
  robot_base_frame: base_link
  robot_radius: 0.2
  rolling_window: true
  width: 4.0
  height: 4.0
  resolution: 0.05
  update_frequency: 10.0
  plugins: [{name: sonar_layer, type: "range_sensor_layer::RangeSensorLayer"}]
  sonar_layer: {topics: [sonar], clear_on_max_reading: true}
"""


def test_sonars_mark_the_costmap_through_the_range_sensor_layer(tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(PARAMS)
    configuration = load_configuration([file])
    grid = OccupancyGrid(np.zeros((80, 80), np.int8), GridGeometry(80, 80, 0.1))
    robot = simulated_robot(configuration, grid, Pose2D(4.0, 4.0, 0.0), obstacles=[(5.2, 4.0, 0.2)])
    move_base = build_move_base(configuration, robot, static_map=grid)
    for k in range(1, 21):
        robot.advance_to(0.1 * k)
        move_base.tick(robot.time)
    master = move_base.local_costmap.master
    iy, ix = np.nonzero(master.data == 254)
    assert len(ix)
    x = master.geometry.origin_x + (ix + 0.5) * 0.05
    y = master.geometry.origin_y + (iy + 0.5) * 0.05
    # an arc as far off as the near side of the post, as wide as the cone
    assert np.hypot(x - 4.1, y - 4.0).min() > 0.8
    assert np.hypot(x - 4.1, y - 4.0).max() < 1.2
    assert np.abs(np.arctan2(y - 4.0, x - 4.1)).max() < 0.35
