"""Docks of a simulated world: bodies that lidars see, markers that the dock camera sees, contacts, and the battery.

The errors of the detections depend only on the seed and on the number of the detection.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from navstack.core import BatteryState, DockDetection, FrameTree, Pose2D, Transform2D, angle_between
from navstack.parameters import BatteryParams, SimDockParams, SimParams
from navstack.sim.shapes import Shape

MAX_DETECTIONS: Final = 1000
"""Maximum number of detections that wait to be fetched; the oldest are dropped."""
_STREAM: Final = 1 << 23
"""Random stream of the detections."""


def dock_shapes(params: SimParams) -> tuple[Shape, ...]:
    """Return the bodies of the docks as obstacles, named like the docks."""
    shapes = [_body(name, params.dock(name)) for name in params.docks]
    return tuple(shape for shape in shapes if shape is not None)


def _body(name: str, dock: SimDockParams) -> Shape | None:
    """Return the body of a dock; None if it has none."""
    if dock.body == "none":
        return None
    x = dock.marker_x
    if dock.body == "box":
        center = Transform2D(*dock.pose).apply(Pose2D(x + 0.5 * dock.depth, 0.0, 0.0))
        return Shape(name=name, box=[dock.depth, dock.width], pose=list(center), height=dock.height)
    half = 0.5 * dock.reflector_angle
    along, across = -dock.reflector_length * math.cos(half), dock.reflector_length * math.sin(half)
    back = x + max(along, 0.0) + dock.depth
    corners = [[x + along, across], [x, 0.0], [x + along, -across], [back, -across], [back, across]]
    return Shape(name=name, polygon=corners, pose=list(dock.pose), height=dock.height)


def current_of(battery: BatteryParams, speed: float) -> float:
    """Return the current (A) that a robot takes at a speed (m/s)."""
    return battery.idle_current + battery.drive_current * speed


def energy_of(battery: BatteryParams, time_s: float, length_m: float) -> float:
    """Return the energy (Wh) that a robot takes for a way of `length_m` in `time_s`."""
    return battery.voltage * current_of(battery, length_m / time_s) * time_s / 3600.0 if time_s > 0.0 else 0.0


class Docks:
    """The docks of a world as one robot meets them: detections of their markers, contacts, and the robot's battery."""

    def __init__(self, params: SimParams, *, seed: int) -> None:
        self.params = params
        self.at_contacts: str | None = None
        """The dock at whose contacts the robot is now."""
        self._docks = {name: params.dock(name) for name in params.docks}
        self._seed = seed
        camera = params.dock_camera
        self._mounting = Transform2D(camera.x, camera.y, camera.yaw)
        self._frequency = params.physics_frequency
        self._next = 0
        """Number of the next detection."""
        self._contact_since = 0.0
        self._time = self._distance = 0.0
        self._charge = params.battery.charge
        self._current = -params.battery.idle_current
        self._waiting: deque[tuple[float, DockDetection]] = deque(maxlen=MAX_DETECTIONS)
        """Time of arrival (s) and detection."""

    @property
    def is_empty(self) -> bool:
        """True if the battery has no charge left."""
        return self.params.battery.capacity is not None and self._charge <= 0.0

    @property
    def battery(self) -> BatteryState:
        """The state of the battery now."""
        return BatteryState(self._charge, self._current, self.params.battery.voltage, self._time)

    def mount(self, frames: FrameTree, base_frame: str) -> None:
        """Add the frame of the dock camera, if there are docks to see."""
        if self._docks:
            frames.set_static(base_frame, self.params.dock_camera.frame, self._mounting)

    def start(self, pose: Pose2D) -> None:
        """Begin at `pose` (map frame), with the detection of time 0."""
        self._touch(pose, 0.0)
        self._see(pose, 0)

    def observe(self, before: int, rows: Sequence[Sequence[float]], distance: float) -> None:
        """Measure the physics steps after `before`, whose true poses begin `rows`; `distance` (m) is the way since the start."""
        period = self._frequency / self.params.dock_camera.frequency
        last = before + len(rows)
        while True:
            step = math.ceil(self._next * period - 1e-6)
            if step > last:
                break
            step = max(step, before + 1)
            x, y, yaw = rows[step - before - 1][:3]
            self._see(Pose2D(x, y, yaw), step)
        x, y, yaw = rows[-1][:3]
        self._drain(last / self._frequency, distance)
        self._touch(Pose2D(x, y, yaw), last / self._frequency)

    def fetch(self, now: float) -> list[DockDetection]:
        """Return the detections that arrived until `now` (s) since the last call, the oldest first."""
        found: list[DockDetection] = []
        while self._waiting and self._waiting[0][0] <= now + 1e-9:
            found.append(self._waiting.popleft()[1])
        return found

    # --- contacts and battery -----------------------------------------------------------------------------------------

    def _touch(self, pose: Pose2D, now: float) -> None:
        """Find the contacts that the robot touches at `pose`."""
        touched = next((name for name, dock in self._docks.items() if _is_at_contacts(dock, pose)), None)
        if touched != self.at_contacts:
            self.at_contacts, self._contact_since = touched, now

    def _drain(self, now: float, distance: float) -> None:
        """Take the charge of the time and the way since the last call, and add that of the contacts."""
        battery, elapsed = self.params.battery, now - self._time
        way = distance - self._distance
        speed = way / elapsed if elapsed > 0.0 else 0.0
        self._current = -current_of(battery, speed)
        dock = self._docks.get(self.at_contacts or "")
        if dock is not None and dock.powered and now - self._contact_since >= dock.charging_delay - 1e-9:
            self._current += dock.charging_current if self._charge < 1.0 or battery.capacity is None else -self._current
        if battery.capacity is not None:
            self._charge = min(1.0, max(0.0, self._charge + self._current * elapsed / 3600.0 / battery.capacity))
        self._time, self._distance = now, distance

    # --- detections ---------------------------------------------------------------------------------------------------

    def _see(self, pose: Pose2D, step: int) -> None:
        """Take the detection due at a physics step; the nearest dock is reported, as by a detector of one tag."""
        number, stamp = self._next, step / self._frequency
        self._next += 1
        camera = self.params.dock_camera
        eye = Transform2D(*pose) @ self._mounting
        seen = [found for dock in self._docks.values() if (found := self._marker(dock, eye)) is not None]
        if not seen:
            return
        marker = min(seen, key=lambda at: math.hypot(at.x, at.y))
        # a stream per detection: what one robot sees does not depend on when it looked away
        random = np.random.Generator(np.random.PCG64([self._seed, _STREAM, number]))
        if random.random() < camera.dropout:
            return
        dx, dy, turn = random.standard_normal(3).tolist()
        x, y, yaw = marker.x + camera.noise * dx, marker.y + camera.noise * dy, marker.yaw + camera.yaw_noise * turn
        detection = DockDetection.of_heading(x, y, yaw, stamp, camera.frame, camera.topic)
        self._waiting.append((stamp + camera.delay, detection))

    def _marker(self, dock: SimDockParams, eye: Transform2D) -> Pose2D | None:
        """Return the pose of a dock's marker in the frame of the camera at `eye`; None if the camera does not see it."""
        camera = self.params.dock_camera
        marker = eye.inverse().apply(Transform2D(*dock.pose).apply(Pose2D(dock.marker_x, 0.0, 0.0)))
        bearing, distance = math.atan2(marker.y, marker.x), math.hypot(marker.x, marker.y)
        visible = (
            dock.has_marker
            and camera.range_min <= distance <= camera.range_max
            and abs(bearing) <= 0.5 * camera.fov
            and abs(angle_between(bearing, marker.yaw)) <= camera.max_obliqueness
        )
        return marker if visible else None


def contact_error(dock: SimDockParams, pose: Pose2D) -> Pose2D:
    """Return the pose of a robot at `pose` (map frame) in the frame of the dock: zero where all contacts meet."""
    error = Transform2D(*dock.pose).inverse().apply(pose)
    return error if dock.contact_side == "front" else error._replace(yaw=angle_between(math.pi, error.yaw))


def _is_at_contacts(dock: SimDockParams, pose: Pose2D) -> bool:
    """True if both contacts meet; a robot that has come too far presses them harder."""
    error = contact_error(dock, pose)
    return (
        -dock.contact_depth <= error.x
        and error.x <= 4.0 * dock.contact_depth
        and abs(error.y) <= dock.contact_width
        and abs(error.yaw) <= dock.contact_angle
    )
