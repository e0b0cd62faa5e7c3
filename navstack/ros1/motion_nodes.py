"""LinearMove and RadianTurn: drive a distance or turn by an angle, as nodes and as the services move_distance and turn_radian."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable
from typing import Any, Final

from navstack.core import InputError, NavError
from navstack.ros1 import parameters, ros
from navstack.ros1.open_motion import OpenMotion, OpenMotionRunner, OpenTurn, Settings

NODE_WAIT_S: Final = 5.0
"""Longest wait of a node for the transform (s, wall)."""
SERVICE_WAIT_S: Final = 60.0
"""Longest wait of a service for the transform (s, wall)."""


def linear_settings() -> Settings:
    """Return the parameters of LinearMove. Raises InputError."""
    return Settings.read(0.08, "speed_linear", 0.1)


def turn_settings() -> Settings:
    """Return the parameters of RadianTurn. Raises InputError."""
    return Settings.read(0.03, "speed_radian", 0.436)


def linear_move(distance: float | None = None) -> int:
    """Drive `distance` (m), by default `~t_dis`; return the exit code. Raises InputError and FrameError."""
    settings = linear_settings()
    wanted = parameters.number("t_dis", 0.2) if distance is None else distance
    if wanted == 0.0:
        raise InputError("the distance is 0; set ~t_dis to a distance (m), negative for backwards")
    return _run_once(settings, settings.move(wanted))


def radian_turn(angle: float | None = None) -> int:
    """Turn by `angle` (rad), by default `~t_rad`; return the exit code. Raises InputError and FrameError."""
    settings = turn_settings()
    wanted = parameters.number("t_rad", 0.5 * math.pi) if angle is None else angle
    if wanted == 0.0:
        raise InputError("the angle is 0; set ~t_rad to an angle (rad), negative for clockwise")
    return _run_once(settings, settings.turn(wanted, direct=parameters.flag("direct", False)))


def _run_once(settings: Settings, motion: OpenMotion) -> int:
    rospy = ros.rospy()
    runner = OpenMotionRunner(settings)
    runner.wait_for_transform(NODE_WAIT_S)
    code = 0
    if not ros.is_stopping():
        try:
            rospy.loginfo("%s", runner.run(motion))
        except NavError as exc:
            rospy.logerr("%s", exc.message)
            code = 1
    ros.shut_down(lambda: None)
    return code


def serve_moves() -> None:
    """Offer move_distance (handsfree_msgs/SpecialMove) until the node is shut down. Raises InputError and FrameError."""
    settings = linear_settings()
    _Server(
        settings, "move_distance", "SpecialMove", lambda request: settings.move(request.target_distance_move)
    ).spin()


def serve_turns() -> None:
    """Offer turn_radian (handsfree_msgs/SpecialTurn) until the node is shut down. Raises InputError and FrameError."""
    settings, direct = turn_settings(), parameters.flag("direct", False)

    def make(request: Any) -> OpenTurn:
        return settings.turn(request.target_radian_turn, direct=direct)

    _Server(settings, "turn_radian", "SpecialTurn", make).spin()


class _Request:
    """A call that waits for its motion."""

    def __init__(self, request: Any) -> None:
        self.request = request
        self.done = threading.Event()
        self.success = False


class _Server:
    """A service whose calls are motions; they run one after another, in the thread of the node."""

    def __init__(self, settings: Settings, name: str, kind: str, make: Callable[[Any], OpenMotion]) -> None:
        rospy = self._rospy = ros.rospy()
        self._make = make
        self._waiting: queue.SimpleQueue[_Request] = queue.SimpleQueue()
        self._runner = OpenMotionRunner(settings)
        self._runner.wait_for_transform(SERVICE_WAIT_S)
        self._response = ros_class = ros.message(f"handsfree_msgs/srv/{kind}")
        self._service = rospy.Service(name, ros_class, self._call)
        rospy.loginfo("the service %s is ready", rospy.resolve_name(name))

    def _call(self, request: Any) -> Any:
        """Hand the call over to the node's thread, and wait for its end."""
        item = _Request(request)
        self._waiting.put(item)
        self._runner.inbox.post(lambda: None)
        while not item.done.wait(0.2):
            if ros.is_stopping():
                break
        return self._response._response_class(success=item.success)

    def spin(self) -> None:
        """Serve until the node is shut down."""
        while not ros.is_stopping():
            self._runner.inbox.run(0.1, self._report)
            try:
                item = self._waiting.get_nowait()
            except queue.Empty:
                continue
            item.success = self._drive(item.request)
            item.done.set()
        ros.shut_down(lambda: None)

    def _drive(self, request: Any) -> bool:
        try:
            self._rospy.loginfo("%s", self._runner.run(self._make(request)))
        except NavError as exc:
            self._rospy.logerr("%s", exc.message)
            return False
        return True

    def _report(self, error: NavError) -> None:
        self._rospy.logwarn("%s", error.message)
