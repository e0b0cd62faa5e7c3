"""teleop_twist_keyboard: a velocity for each key that is pressed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from navstack.behaviors import HELP, SPEED_KEYS, START_SPEED, START_TURN, KeyboardTeleop
from navstack.ros1 import parameters, ros
from navstack.ros1.open_motion import VELOCITY_TOPIC

POLL_S: Final = 0.1
"""Time between two looks at the shutdown (s, wall)."""
HELP_EVERY: Final = 15
"""The help is printed again after so many speed keys."""
UP_DOWN: Final = {"t": 1.0, "b": -1.0}
"""Keys for the vertical velocity of flying robots."""
QUIT: Final = "\x03"
"""Ctrl-C, in a terminal that passes it as a key."""


class Teleop:
    """Publishes a Twist per key; the base stops by its own time-out."""

    def __init__(self, say: Callable[[str], None]) -> None:
        """`say` prints a line. Raises InputError for parameters that are not positive numbers."""
        rospy = ros.rospy()
        speed = parameters.number("speed", START_SPEED, positive=True)
        turn = parameters.number("turn", START_TURN, positive=True)
        self.keyboard = KeyboardTeleop(speed, turn)
        self._say = say
        self._topic = parameters.text("vel_topic", VELOCITY_TOPIC)
        self._type = ros.message("geometry_msgs/Twist")
        self._out = rospy.Publisher(self._topic, self._type, queue_size=1)
        self._changes = 0
        self._is_warned = False

    def spin(self, read: Callable[[float], str]) -> None:
        """Read keys by `read(timeout)` until Ctrl-C or the shutdown, then stop the robot."""
        self._say(HELP)
        self._say(str(self.keyboard))
        try:
            while not ros.is_stopping():
                keys = read(POLL_S)
                if QUIT in keys:
                    break
                for key in keys:
                    self._press(key)
        finally:
            ros.shut_down(lambda: self._publish(0.0, 0.0, 0.0, 0.0))

    def _press(self, key: str) -> None:
        twist = self.keyboard.press(key)
        self._publish(twist.vx, twist.vy, UP_DOWN.get(key, 0.0) * self.keyboard.speed, twist.wz)
        if not self._is_warned and self._out.get_num_connections() == 0:
            self._is_warned = True
            self._say(f"no node subscribes to {self._topic}; set _vel_topic:=TOPIC to the robot's topic")
        if key in SPEED_KEYS:
            self._changes += 1
            self._say(str(self.keyboard))
            if self._changes % HELP_EVERY == 0:
                self._say(HELP)

    def _publish(self, x: float, y: float, z: float, yaw: float) -> None:
        twist: Any = self._type()
        twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.z = x, y, z, yaw
        self._out.publish(twist)
