"""Planning errors name the layer that set the cost."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from navstack.bringup import plan_on_map
from navstack.core import Costmap, GoalOccupiedError, GridGeometry, NoValidPathError, Pose2D, StartOccupiedError
from navstack.global_planner import AStarParams, AStarPlanner, NavfnROS
from navstack.map_io import load_map, map_path
from navstack.move_base.planning import add_layer
from navstack.parameters import load_configuration
from tests.costmap.build import frames_at, inflation, obstacle, rolling, scan


def test_inflation_of_an_observation() -> None:
    """A scan of a wall 1 m ahead: its cells by the obstacle layer, those before it by the inflation, both from that scan."""
    live = rolling(obstacle(), inflation(), frames=frames_at(stamp=2.5))
    live.observe(scan(np.full(360, 1.0), stamp=2.5))
    live.update(2.5)
    before = live.master.data.copy()
    wall = np.argwhere(live.master.data == 254)
    iy, ix = wall[len(wall) // 2].tolist()
    x, y = live.master.geometry.cell_to_world(ix, iy)
    planner = AStarPlanner(AStarParams(start_policy="refuse"))
    with pytest.raises(GoalOccupiedError) as caught:
        planner.make_plan(live.master, Pose2D(0.0, 0.0, 0.0), Pose2D(x, y, 0.0))
    explained = add_layer(live, caught.value)
    assert explained.message.endswith('the goal\'s cell was set by the layer obstacle_layer, from "scan" at 2.500 s')
    assert explained.data["layer"] == "obstacle_layer"
    assert explained.data["source"] == "scan"
    assert explained.data["stamp"] == 2.5
    assert explained.data["cell"] == [ix, iy]
    assert explained.code == 206
    assert (live.master.data == before).all()
    assert add_layer(live, explained) is explained
    near = np.argwhere(live.master.data == 253)
    iy, ix = near[len(near) // 2].tolist()
    x, y = live.master.geometry.cell_to_world(ix, iy)
    with pytest.raises(StartOccupiedError) as refused:
        planner.make_plan(live.master, Pose2D(x, y, 0.0), Pose2D(0.0, 0.0, 0.0))
    explained = add_layer(live, refused.value)
    assert explained.data["layer"] == "inflation_layer"
    assert explained.data["source"] == "scan"
    assert "start's cell was set by the layer inflation_layer" in explained.message
    assert pickle.loads(pickle.dumps(explained)).as_dict() == explained.as_dict()


def test_of_the_map() -> None:
    configuration = load_configuration(["turtlebot"])
    with pytest.raises(GoalOccupiedError, match=r"set by the layer static_layer, from \"map\"") as error:
        plan_on_map(configuration, load_map(map_path("office")), Pose2D(0.8, 7.45, 0.0), Pose2D(2.075, 1.425, 0.0))
    assert error.value.data["layer"] == "static_layer"


def test_other_errors_are_unchanged() -> None:
    live = rolling(obstacle(), inflation())
    live.update(0.0)
    other = NoValidPathError("no path", cell=[1, 1], cost=254)
    assert add_layer(live, other) is other
    elsewhere = Costmap(GridGeometry(9, 9, 0.1), np.full((9, 9), 254, np.uint8))
    with pytest.raises(GoalOccupiedError) as caught:
        NavfnROS().make_plan(elsewhere, Pose2D(0.15, 0.15, 0.0), Pose2D(0.45, 0.45, math.pi))
    assert add_layer(live, caught.value) is caught.value  # another costmap's cost
