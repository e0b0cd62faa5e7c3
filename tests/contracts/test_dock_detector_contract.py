"""The detectors of docks under the contract suite, and the suite under a detector that breaks it."""

from __future__ import annotations

import pytest

from navstack.core import DockDetection, Pose2D, SensorData
from navstack.docking.detectors import PoseTopicDetector
from navstack.docking.reflector import VReflectorDetector
from navstack.plugins import DockDetector, PluginSection
from navstack.testing import dock_detector_contract
from tests.docking.scenes import reflector_scan, tag_pose

TestPoseTopic = dock_detector_contract(PoseTopicDetector, measure=tag_pose)
TestVReflector = dock_detector_contract(VReflectorDetector, measure=reflector_scan)
TestVReflectorOutwards = dock_detector_contract(
    VReflectorDetector, measure=lambda marker, stamp: reflector_scan(marker, stamp, angle=4.2), angle=4.2
)


class Gullible(DockDetector[PluginSection]):
    """Believes every pose."""

    Params = PluginSection

    def detect(self, data: SensorData | DockDetection, expected: Pose2D) -> DockDetection | None:
        """Return it."""
        self.remark = "seen"
        return data if isinstance(data, DockDetection) else None


def test_the_suite_finds_a_detector_that_takes_another_dock() -> None:
    suite = dock_detector_contract(Gullible, measure=tag_pose)()
    suite.test_says_what_it_saw()
    with pytest.raises(AssertionError):
        suite.test_a_marker_far_from_the_expected_one_is_of_another_dock()
