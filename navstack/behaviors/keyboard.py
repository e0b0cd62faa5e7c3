"""Driving with the keyboard: which key gives which velocity.

Keys, factors and the speeds at the start are those of teleop_twist_keyboard.
"""

from __future__ import annotations

from typing import Final

from navstack.core import Twist2D

START_SPEED: Final = 0.3
"""m/s."""
START_TURN: Final = 0.6
"""rad/s."""

MOVE_KEYS: Final[dict[str, tuple[int, int, int]]] = {
    "i": (1, 0, 0),
    "o": (1, 0, -1),
    "j": (0, 0, 1),
    "l": (0, 0, -1),
    "u": (1, 0, 1),
    ",": (-1, 0, 0),
    ".": (-1, 0, 1),
    "m": (-1, 0, -1),
    "I": (1, 0, 0),
    "O": (1, -1, 0),
    "J": (0, 1, 0),
    "L": (0, -1, 0),
    "U": (1, 1, 0),
    "<": (-1, 0, 0),
    ">": (-1, -1, 0),
    "M": (-1, 1, 0),
    "t": (0, 0, 0),
    "b": (0, 0, 0),
}
"""Key -> signs of vx, vy and wz. t and b move flying robots up and down; a robot on the ground stands."""
SPEED_KEYS: Final[dict[str, tuple[float, float]]] = {
    "q": (1.1, 1.1),
    "z": (0.9, 0.9),
    "w": (1.1, 1.0),
    "x": (0.9, 1.0),
    "e": (1.0, 1.1),
    "c": (1.0, 0.9),
}
"""Key -> factors of the speed and of the turn rate. They also stop the robot."""

HELP: Final = """\
   u    i    o      forwards, and turning
   j    k    l      turn in place; k: stop
   m    ,    .      backwards, and turning
shifted: sideways (holonomic robots)    t / b: up / down (no effect on the ground)
q / z: all speeds +- 10 %    w / x: the speed    e / c: the turn rate
any other key: stop          Ctrl-C: quit"""


class KeyboardTeleop:
    """The speeds, and the velocity of the last key."""

    def __init__(self, speed: float = START_SPEED, turn: float = START_TURN) -> None:
        """`speed` in m/s, `turn` in rad/s."""
        self.speed, self.turn = speed, turn
        self.twist = Twist2D()

    def press(self, key: str) -> Twist2D:
        """Return the velocity for a key; every other key stops."""
        if key in SPEED_KEYS:
            of_speed, of_turn = SPEED_KEYS[key]
            self.speed, self.turn = self.speed * of_speed, self.turn * of_turn
        x, y, yaw = MOVE_KEYS.get(key, (0, 0, 0))
        self.twist = Twist2D(x * self.speed + 0.0, y * self.speed + 0.0, yaw * self.turn + 0.0)
        return self.twist

    def __str__(self) -> str:
        return f"speed {self.speed:.3f} m/s, turn {self.turn:.3f} rad/s"
