"""Simulate, export, replay with the same parameters: the same costmaps cell for cell, the same commands cycle for cycle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import InputError, Pose2D, RangeReading, RecordError
from navstack.logs import open_log
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.replay import LogReplay
from navstack.replay.export import export_run
from navstack.replay.player import logged_map
from navstack.replay.topics import find_topics
from navstack.scenario import Run, Scenario, read_scenario, shipped_scenarios

NOT_IN_A_LOG = {"clearances", "solid_corners", "solid_discs", "solid_first", "people", "persons"}
"""What only a simulator knows."""


def recorded(scenario: Scenario, readings: list[RangeReading] | None = None) -> Record:
    run = Run(scenario)
    while run.step():
        if readings is not None:
            readings += [data for data in run.move_base.last_tick.scans if isinstance(data, RangeReading)]
    assert run.recorder is not None
    return run.recorder.record()


def office(*overrides: str, params: str = "turtlebot") -> Scenario:
    grid = load_map(map_path("office"))
    start, goal = Pose2D(2.0, 7.45, 0.0), Pose2D(4.5, 7.45, 0.0)
    configuration = load_configuration([params], overrides=list(overrides))
    return Scenario(grid, configuration, start, (goal,), seed=3)


def packaged(name: str) -> Scenario:
    return read_scenario(shipped_scenarios()[name]).build()


SCENARIOS: dict[str, Any] = {
    "narrow door": lambda: packaged("narrow_door"),
    "pedestrian": lambda: packaged("crossing_pedestrian"),
    "holonomic": lambda: packaged("holonomic_robot"),
    "rotating laser": lambda: office(
        "navstack/sim/laser/fov=6.283185307179586", "navstack/sim/laser/yaw=0.3", "navstack/sim/laser/beams=360"
    ),
    "slip and noise": lambda: office(
        "navstack/sim/wheel_slip=0.05",
        "navstack/sim/odometry_noise=0.05",
        "navstack/sim/laser/range_noise=0.01",
        "navstack/sim/laser/dropout=0.02",
    ),
    "sonars": lambda: office(
        "navstack/sim/sonars=[left, right]",
        "navstack/sim/left={frame: left, y: 0.1, yaw: 0.4, range_min: 0.1, range_noise: 0.02, fov: 0.3}",
        "navstack/sim/right={frame: right, y: -0.1, yaw: -0.4, range_max: 2.55, no_return: inf}",
        "local_costmap/plugins=[{name: obstacle_layer, type: 'costmap_2d::ObstacleLayer'}, {name: sonar_layer, type: "
        "'range_sensor_layer::RangeSensorLayer'}, {name: inflation_layer, type: 'costmap_2d::InflationLayer'}]",
        "local_costmap/sonar_layer={topics: [sonar], clear_on_max_reading: true, inflate_cone: 0.9}",
    ),
    "unreachable": lambda: packaged("unreachable_goal"),
}
IN_BAGS_ONLY = ("unreachable", "sonars")


@pytest.mark.slow
@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    ("name", "suffix"),
    [
        (name, suffix)
        for name in SCENARIOS
        for suffix in ("bag", "mcap")
        if suffix == "bag" or name not in ("unreachable", "sonars")
    ],
)
def test_replay_equals_the_run(name: str, suffix: str, tmp_path: Path) -> None:
    scenario = SCENARIOS[name]()
    sonar: list[RangeReading] = []
    heard: list[RangeReading] = []
    run = recorded(scenario, sonar)
    file = tmp_path / f"run.{suffix}"
    exported = export_run(run, file)
    assert exported.duration == run.times[-1] and exported.messages > 100
    with open_log(file) as log:
        found = logged_map(log, find_topics(log, scenario.configuration))
        assert found is not None
        replay = LogReplay(log, scenario.configuration, found)
        while replay.step():
            heard += [data for data in replay.move_base.last_tick.scans if isinstance(data, RangeReading)]
    assert heard == sonar and bool(sonar) == (name == "sonars")
    again = replay.recorder.recorder.record() if replay.recorder is not None else None
    assert again is not None
    assert not replay.player.problems
    for key, array in run.arrays.items():
        if key not in NOT_IN_A_LOG:
            assert array.tobytes() == again.arrays[key].tobytes(), key
    compared = [cycle for cycle in replay.cycles if cycle.controlled and cycle.recorded is not None]
    assert len(compared) > 5 or name == "unreachable"
    assert all(cycle.command == cycle.recorded for cycle in compared)


@pytest.mark.slow
def test_export_is_the_same_file_every_time(tmp_path: Path) -> None:
    run = recorded(packaged("narrow_door"))
    for suffix in ("bag", "mcap"):
        first, second = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
        export_run(run, first)
        export_run(run, second)
        assert first.read_bytes() == second.read_bytes()


def test_other_suffix_and_replays_are_refused(tmp_path: Path) -> None:
    run = recorded(packaged("unreachable_goal"))
    with pytest.raises(InputError, match=r"end the name with \.bag \(ROS 1\) or \.mcap \(ROS 2\)"):
        export_run(run, tmp_path / "run.db3")
    run.scenario["log"] = {"path": "x.bag"}
    with pytest.raises(RecordError, match="the replay of a log, which has no simulation to export"):
        export_run(run, tmp_path / "run.bag")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_run_of_another_version_is_refused(tmp_path: Path) -> None:
    run = recorded(packaged("narrow_door"))
    run.samples["vx"][5] += 1e-9
    with pytest.raises(RecordError, match="the run is not the same when it is simulated again"):
        export_run(run, tmp_path / "run.bag")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_costmaps_of_the_export_are_those_of_the_run(tmp_path: Path) -> None:
    from navstack.ros_messages import published_costs

    scenario = packaged("narrow_door")
    run = recorded(scenario)
    export_run(run, tmp_path / "run.bag")
    values = published_costs()
    grid = None
    origin = None
    with open_log(tmp_path / "run.bag") as log:
        for message in log.messages(["/move_base/global_costmap/costmap", "/move_base/global_costmap/costmap_updates"]):
            data = message.data
            if message.topic.endswith("costmap"):
                grid = data.data.reshape(data.info.height, data.info.width).copy()
                origin = data.info.origin.position
            else:
                assert grid is not None
                window = data.data.reshape(data.height, data.width)
                grid[data.y : data.y + data.height, data.x : data.x + data.width] = window
            expected = run.costmap_at("global", message.time - 1_600_000_000.0 + 1e-6)
            assert expected is not None and grid is not None and origin is not None
            assert np.array_equal(grid, values[expected.data])
            assert (origin.x, origin.y) == (expected.geometry.origin_x, expected.geometry.origin_y)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "stands_still"), [((), True), (("navstack/sim/wheel_slip=0.05",), False)], ids=["exact", "slips"]
)
def test_transforms_of_the_export_lead_to_the_true_pose(
    overrides: tuple[str, ...], stands_still: bool, tmp_path: Path
) -> None:
    """map -> odom is static for an odometry without errors; otherwise it moves. The chain of both gives the true pose."""
    export_run(recorded(office(*overrides)), tmp_path / "run.bag")
    edges: dict[str, set[tuple[str, str]]] = {"/tf": set(), "/tf_static": set()}
    places: dict[tuple[str, str], tuple[complex, complex]] = {}
    checked = 0
    with open_log(tmp_path / "run.bag") as log:
        for message in log.messages(["/tf", "/tf_static", "/base_pose_ground_truth"]):
            if message.topic in edges:
                for item in message.data.transforms:
                    edge = item.header.frame_id, item.child_frame_id
                    edges[message.topic].add(edge)
                    at, q = item.transform.translation, item.transform.rotation
                    places[edge] = complex(at.x, at.y), complex(q.w, q.z) ** 2
                    if edge[1] == "laser":
                        assert at.z == 0.3
                continue
            (x, turn), (step, _) = places["map", "odom"], places["odom", "base_footprint"]
            true = message.data.pose.pose.position
            assert abs(x + turn * step - complex(true.x, true.y)) < 1e-9
            checked += 1
    assert checked > 100
    assert (("map", "odom") in edges["/tf_static"]) == stands_still
    assert (("map", "odom") in edges["/tf"]) != stands_still
    assert ("odom", "base_footprint") in edges["/tf"]


@pytest.mark.slow
def test_mcap_passes_the_checks_of_its_library(tmp_path: Path) -> None:
    from mcap.reader import NonSeekingReader, make_reader

    export_run(recorded(packaged("narrow_door")), tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        messages = sum(1 for _ in reader.iter_messages())
        assert messages == summary.statistics.message_count > 1000
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    with (tmp_path / "run.mcap").open("rb") as file:
        assert (
            sum(1 for _ in NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False)) == messages
        )
