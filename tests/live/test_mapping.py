"""A session in which a person drives a robot that makes its map: the map grows, and the session is a log of the drive."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import pytest

from navstack.core import Pose2D
from navstack.live.session import Session
from navstack.logs import logged_scans, open_scan_log
from navstack.mapping import Mapper
from navstack.parameters import load_configuration
from navstack.scenario import Scenario
from tests.mapping.test_exploration import two_rooms


@pytest.mark.slow
def test_the_map_grows_while_a_person_drives_and_the_session_is_a_log(tmp_path: Path) -> None:
    sets = ["navstack.sim.localization=mapping", "navstack.sim.odometry_noise=0.02"]
    configuration = load_configuration(["omni_dwa"], overrides=sets)
    session = Session(
        Scenario(map=two_rooms(), configuration=configuration, start=Pose2D(1.0, 1.5), goals=()), speed=None
    )

    def known_at(time: float) -> int:
        ticks = count()
        while session.time < time:
            session.advance(1.0, budget_s=1.0, timer=lambda: 0.1 * next(ticks), limit=time)
        return int((session.run.known_map.data != -1).sum())

    session.interact({"kind": "drive", "velocity": [0.4, 0.0, 0.0], "seconds": 7.0})
    first, last = known_at(1.5), known_at(7.0)
    assert 500 < first < last - 500
    costmap = session.run.move_base.global_costmap.master
    assert costmap.geometry == session.run.known_map.geometry  # what the page shows
    # back in time, the map is what it was then
    session.seek(1.5)
    session.finish_seek()
    assert int((session.run.known_map.data != -1).sum()) == first
    assert known_at(7.0) == last
    session.recorded().save(tmp_path)
    mapper = Mapper()
    for frame in logged_scans(open_scan_log(tmp_path)):
        mapper.add_scan(frame.scan.stamp, frame.odometry, frame.scan, frame.sensor)
    assert (mapper.map().data == 100).sum() > 200
