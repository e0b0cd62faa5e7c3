"""The bag of a real TurtleBot3: what it contains, and a replay of its first seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.core import Pose2D
from navstack.logs import log_info, open_log
from navstack.parameters import load_configuration
from navstack.replay import LogReplay, ReplayOptions
from navstack.replay.player import empty_map
from navstack.replay.report import ReplayReport
from navstack.replay.topics import find_topics


@pytest.fixture
def bag(data_dir: Path) -> Path:
    file = data_dir / "logs" / "fuse_turtlebot3.bag"
    if not file.is_file():
        pytest.skip("no bag of a TurtleBot3 in the foreign data")
    return file


@pytest.mark.slow
def test_info(bag: Path) -> None:
    with open_log(bag) as log:
        info = log_info(log)
    counts = {topic.topic: topic.count for topic in info.topics}
    assert (counts["/scan"], counts["/odom"], counts["/imu"], counts["/cmd_vel"]) == (457, 2741, 2253, 2335)
    assert info.duration == pytest.approx(91.34, abs=0.01)
    found = {need.what: need.found for need in info.needs}
    assert found["sensor data"] and found["odometry"] and found["velocity commands"]
    assert not found["map"] and not found["goals"] and not found["localization"]


@pytest.mark.slow
def test_replay(bag: Path) -> None:
    parameters = sorted((bag.parents[1] / "params" / "turtlebot3").glob("*.yaml"))
    names = (
        "costmap_common_params_waffle",
        "global_costmap",
        "local_costmap",
        "move_base",
        "dwa_local_planner_params_waffle.",
    )
    chosen = [
        str(file) for file in parameters if any(name in file.name for name in names) and "waffle_pi" not in file.name
    ]
    configuration = load_configuration(chosen, overrides=["base_local_planner=dwa_local_planner/DWAPlannerROS"])
    options = ReplayOptions(
        end=10.0,
        goals=((0.0, Pose2D(1.62, -0.34)),),
        mountings={"base_scan": ("base_footprint", (-0.064, 0.0, 0.122, 0.0))},
    )
    with open_log(bag) as log:
        grid = empty_map(log, find_topics(log, configuration), None, "map")
        replay = LogReplay(log, configuration, grid, options)
        replay.run()
    assert replay.run_recorder is not None
    record = replay.run_recorder.record()
    # the person drives away to the right of the pillar at (-1.1, 0), which the scan shows
    assert record.pose_at(5.0) == pytest.approx(Pose2D(-1.33, -0.59, record.pose_at(5.0).yaw), abs=0.05)
    costmap = record.costmap_at("global", 9.0)
    assert costmap is not None
    cell = costmap.geometry.world_to_cell(-1.1, 0.0)
    assert cell is not None
    assert (costmap.data[cell[1] - 4 : cell[1] + 5, cell[0] - 4 : cell[0] + 5] == 254).sum() > 5
    report = ReplayReport(replay)
    assert report.commands is not None and report.commands.first is not None
    assert report.commands.first.command.vx > 0.2 and report.commands.first.recorded.vx == 0.0
