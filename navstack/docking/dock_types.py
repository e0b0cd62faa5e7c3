"""Simple docks: opennav_docking::SimpleChargingDock and SimpleNonChargingDock."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal, TypeVar

from navstack.core import (
    BatteryState,
    DockDetection,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    angle_between,
)
from navstack.parameters import make_section, section_model
from navstack.plugins import DOCK_DETECTORS, DOCK_TYPES, DockDetector, DockType, PluginSection, param

DEFAULT_DETECTOR: Final = "pose_topic"
STALLED_STEPS: Final = 10
"""Steps in which a robot that is commanded to move stands, until it counts as stalled."""
STALLED_SPEED: Final = 0.01
"""Below this speed it stands (m/s)."""


class SimpleNonChargingDockParams(PluginSection):
    """A place where the robot docks without being charged."""

    CHILD_FIELD: ClassVar[str | None] = "sections"
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "stall_joint_names": "a stall is seen in the odometry",
        "stall_velocity_threshold": "a stall is seen in the odometry",
        "stall_effort_threshold": "a stall is seen in the odometry",
        "detector_service_name": "detectors are plugins",
        "detector_service_timeout": "detectors are plugins",
        "subscribe_toggle": "detectors are plugins",
    }

    use_external_detection_pose: bool = param(
        False, "refine the pose of the dock by a detector; false: trust its known pose"
    )
    external_detection_timeout: float = param(1.0, "age at which a detection is no longer used", unit="s", gt=0.0)
    external_detection_translation_x: float = param(-0.2, "docked base, seen from the marker", unit="m")
    external_detection_translation_y: float = param(0.0, "docked base, seen from the marker", unit="m")
    external_detection_rotation_roll: float = param(-1.57, "rotation of the marker about its z axis", unit="rad")
    external_detection_rotation_pitch: float = param(1.57, "rotation of the marker about its x axis", unit="rad")
    external_detection_rotation_yaw: float = param(0.0, "rotation of the marker about its y axis", unit="rad")
    filter_coef: float = param(
        0.1,
        "share of a new detection in the filtered pose; the first detections are averaged",
        gt=0.0,
        le=1.0,
        ros_differs="each detection counts once; in Nav2 the last one counts again in every cycle",
    )
    use_stall_detection: bool = param(
        False, "a robot that is commanded to move but stands is docked", ros_differs="Nav2 reads the efforts of joints"
    )
    docking_threshold: float = param(
        0.05,
        "distance to the pose of the dock at which the robot is docked",
        unit="m",
        gt=0.0,
        ros_differs="a robot that has passed that pose is docked, too; in Nav2 it drives on",
    )
    staging_x_offset: float = param(-0.7, "staging pose before the dock, along its x axis", unit="m")
    staging_yaw_offset: float = param(0.0, "heading of the staging pose, seen from the dock", unit="rad")
    dock_direction: Literal["forward", "backward"] = param("forward", "how the robot drives into the dock")
    rotate_to_dock: bool = param(False, "face the dock until it is detected, then turn around and drive in backward")
    sections: dict[str, Any] = param({}, "parameters of the detector, from the namespace `detector`")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the model of the detector, by its plugin."""
        return {"detector": section_model(DOCK_DETECTORS, values, "detector", DEFAULT_DETECTOR)}

    def make_detector(self) -> DockDetector:
        """Return the detector."""
        return make_section(DOCK_DETECTORS, self.sections, "detector", DEFAULT_DETECTOR)


class SimpleChargingDockParams(SimpleNonChargingDockParams):
    """A place where the robot is charged."""

    use_battery_status: bool = param(
        True, "the battery says whether it is charged; false: a docked robot is taken to be charged"
    )
    charging_threshold: float = param(0.5, "current from which on the battery is charged", unit="A")


N = TypeVar("N", bound=SimpleNonChargingDockParams)


class PoseFilter:
    """A mean of poses that weighs the last ones: weight 1/n of the n-th pose, but not less than `coef`."""

    def __init__(self, coef: float) -> None:
        self.coef = coef
        self.pose: Pose2D | None = None
        self.count = 0

    def reset(self) -> None:
        """Forget all poses."""
        self.pose, self.count = None, 0

    def update(self, pose: Pose2D) -> Pose2D:
        """Add a pose and return the mean."""
        self.count += 1
        if self.pose is None:
            self.pose = pose
            return pose
        share = max(self.coef, 1.0 / self.count)
        x, y, yaw = self.pose
        turn = angle_between(yaw, pose.yaw)
        self.pose = Pose2D(x + share * (pose.x - x), y + share * (pose.y - y), yaw + share * turn)
        return self.pose


class SimpleDock(DockType[N]):
    """A dock whose pose is known, and refined by a detector."""

    def __init__(self, name: str, params: N) -> None:
        super().__init__(name, params)
        self.detector = params.make_detector()
        self._filter = PoseFilter(params.filter_coef)
        self._known = Pose2D(0.0, 0.0)
        self._last_seen = -math.inf
        self._stalled = 0

    @property
    def drives_backward(self) -> bool:
        """True for `dock_direction: backward`, and for a robot that turns around."""
        return self.params.dock_direction == "backward" or self.params.rotate_to_dock

    @property
    def rotates_to_dock(self) -> bool:
        """True for `rotate_to_dock`."""
        return self.params.rotate_to_dock

    def staging_pose(self, dock: Pose2D) -> Pose2D:
        """Return the dock's pose shifted along its x axis."""
        return Transform2D(*dock).apply(Pose2D(self.params.staging_x_offset, 0.0, self.params.staging_yaw_offset))

    def begin(self, dock: Pose2D, now: float) -> None:
        """Forget earlier detections unless they are recent: the detections of a failed attempt help the next one."""
        self._known, self._stalled = dock, 0
        if now - self._last_seen > self.params.external_detection_timeout:
            self._last_seen = -math.inf
            self._filter.reset()
            self.detector.reset()

    def observe(self, data: SensorData | DockDetection, to_fixed: Transform2D) -> None:
        """Take a measurement into the mean, if the detector finds the marker in it."""
        if not self.params.use_external_detection_pose:
            return
        p = self.params
        around = self._filter.pose or self._known
        away = Transform2D(p.external_detection_translation_x, p.external_detection_translation_y, 0.0).inverse()
        expected = to_fixed.inverse().apply((Transform2D(*around) @ away).apply(Pose2D(0.0, 0.0)))
        found = self.detector.detect(data, expected)
        if found is None:
            return
        seen = Transform2D(found.x, found.y, self._yaw_of(found))
        x, y = p.external_detection_translation_x, p.external_detection_translation_y
        self._filter.update(Pose2D(*(to_fixed @ seen @ Transform2D(x, y, 0.0))))
        self._last_seen = found.stamp

    def refined_pose(self, now: float) -> Pose2D | None:
        """Return the mean of the detections; without a detector the known pose."""
        if not self.params.use_external_detection_pose:
            return self._known
        if now - self._last_seen > self.params.external_detection_timeout:
            return None
        return self._filter.pose

    def is_docked(self, pose: Pose2D, state: RobotState, command: Twist2D) -> bool:
        """Return True within docking_threshold, beyond the dock's pose, and for a robot that is stalled there."""
        dock = self._filter.pose or self._known
        here = Transform2D(*dock).inverse().apply(pose)
        if self.params.use_stall_detection:
            stands = abs(command.vx) > STALLED_SPEED and abs(state.velocity.vx) < STALLED_SPEED
            self._stalled = self._stalled + 1 if stands else 0
            return self._stalled >= STALLED_STEPS
        return math.hypot(here.x, here.y) < self.params.docking_threshold or here.x >= 0.0

    def seen(self) -> str:
        """Return the number of detections and the last remark of the detector."""
        if not self.params.use_external_detection_pose:
            return "no detector is used"
        remark = f"; {self.detector.remark}" if self.detector.remark else ""
        if self._filter.count == 0:
            return f"no detection{remark}"
        return f"{self._filter.count} detection{'s' * (self._filter.count != 1)}, the last at {self._last_seen:.2f} s{remark}"

    def _yaw_of(self, found: DockDetection) -> float:
        """Return the heading of the dock: of the x axis of the marker after the rotation of the parameters.

        The rotation is that of tf2's setEuler(yaw, pitch, roll): about y, then x, then z.
        """
        p = self.params
        turned = _product(
            found.orientation,
            _product(
                (
                    0.0,
                    math.sin(0.5 * p.external_detection_rotation_yaw),
                    0.0,
                    math.cos(0.5 * p.external_detection_rotation_yaw),
                ),
                _product(
                    (
                        math.sin(0.5 * p.external_detection_rotation_pitch),
                        0.0,
                        0.0,
                        math.cos(0.5 * p.external_detection_rotation_pitch),
                    ),
                    (
                        0.0,
                        0.0,
                        math.sin(0.5 * p.external_detection_rotation_roll),
                        math.cos(0.5 * p.external_detection_rotation_roll),
                    ),
                ),
            ),
        )
        x, y, z, w = turned
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation `b`, then `a`."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@DOCK_TYPES.register("simple_non_charging_dock", aliases=("opennav_docking/SimpleNonChargingDock",))
class SimpleNonChargingDock(SimpleDock[SimpleNonChargingDockParams]):
    """A dock without a charger: a conveyor, a shelf, a parking place. The robot is done when it is docked."""

    Params = SimpleNonChargingDockParams


@DOCK_TYPES.register("simple_charging_dock", aliases=("opennav_docking/SimpleChargingDock",))
class SimpleChargingDock(SimpleDock[SimpleChargingDockParams]):
    """A dock with a charger: the robot is done when its battery is charged."""

    Params = SimpleChargingDockParams
    is_charger = True

    def is_charging(self, battery: BatteryState | None, *, docked: bool) -> bool:
        """Return True for a current above charging_threshold; without use_battery_status if it is docked."""
        if not self.params.use_battery_status:
            return docked
        return battery is not None and battery.current > self.params.charging_threshold
