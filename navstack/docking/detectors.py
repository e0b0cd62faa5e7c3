"""Detector of docks by poses that another program publishes: a detector of tags, or the simulated dock camera."""

from __future__ import annotations

import math

from navstack.core import DockDetection, Pose2D, SensorData
from navstack.plugins import DOCK_DETECTORS, DockDetector, PluginSection, param


class PoseTopicParams(PluginSection):
    """Poses of a topic, geometry_msgs/PoseStamped."""

    topic: str = param("detected_dock_pose", "topic of the poses")
    max_jump: float = param(
        0.5,
        "a pose farther than this from where the dock should be is of something else and is not used",
        unit="m",
        gt=0.0,
    )


@DOCK_DETECTORS.register("pose_topic")
class PoseTopicDetector(DockDetector[PoseTopicParams]):
    """Takes the poses of a topic as they are. Source: opennav_docking's external detection pose, which has no check of jumps."""

    Params = PoseTopicParams

    def detect(self, data: SensorData | DockDetection, expected: Pose2D) -> DockDetection | None:
        """Return a pose of the topic that is finite and near the expected one."""
        if not isinstance(data, DockDetection) or data.topic.strip("/") != self.params.topic.strip("/"):
            return None
        if not all(math.isfinite(value) for value in (data.x, data.y, *data.orientation)):
            self.remark = "a pose that is not finite"
            return None
        away = math.hypot(data.x - expected.x, data.y - expected.y)
        if away > self.params.max_jump:
            self.remark = f"a pose {away:.2f} m from where the dock should be, more than max_jump"
            return None
        self.remark = f"a pose {math.hypot(data.x, data.y):.2f} m before the sensor"
        return data
