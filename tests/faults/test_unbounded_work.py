"""Parameters that would take all memory or time: one sentence with an estimate, before the work."""

from __future__ import annotations

import tracemalloc

import pytest

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import InputError, ParameterError, Pose2D
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration


@pytest.mark.parametrize(
    ("changes", "count", "memory"),
    [
        ({"width": 1e5}, "2000000 x 80 cells", "about 6 GB"),
        ({"width": 1e5, "height": 1e5, "resolution": 5.0}, "20000 x 20000 cells", "about 14 GB"),
        ({"resolution": 1e-4}, "40000 x 40000 cells", "about 56 GB"),
    ],
)
def test_a_costmap_that_does_not_fit(changes: dict[str, float], count: str, memory: str) -> None:
    configuration = load_configuration(["turtlebot", {"local_costmap": changes}])
    grid = load_map(map_path("office"))
    robot = simulated_robot(configuration, grid, Pose2D(0.8, 7.45))
    tracemalloc.start()
    try:
        with pytest.raises(
            InputError, match=f"local_costmap: width .* make {count}, which need {memory}; choose between"
        ):
            build_move_base(configuration, robot, static_map=grid)
        assert tracemalloc.get_traced_memory()[1] < 200_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "section", "changes", "message"),
    [
        (
            "jackal_dwa",
            "DWAPlannerROS",
            {"vx_samples": 1000, "vy_samples": 100, "vth_samples": 1000},
            "vx_samples 1,000 .* make 100,000,000 trajectories in a cycle; lower the numbers",
        ),
        ("jackal_dwa", "DWAPlannerROS", {"vx_samples": 10**8}, "make [0-9,]* trajectories in a cycle"),
        (
            "car_mppi",
            "MPPIController",
            {"batch_size": 1_000_000, "time_steps": 10_000, "iteration_count": 1000},
            "are 10,000,000,000,000 points in a cycle; lower them",
        ),
    ],
)
def test_more_work_in_a_cycle_than_is_possible(name: str, section: str, changes: dict[str, int], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        load_configuration([name, {section: changes}])
