"""The terminal of teleop: single keys without Enter, restored in every case; and the map as text."""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import sys
from collections.abc import Callable, Generator
from types import FrameType
from typing import TYPE_CHECKING, Any

from navstack.core import Bounds, InputError

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid, Pose2D

ARROWS = "→↗↑↖←↙↓↘"
"""The robot, by its heading in eighths of a turn."""
OCCUPIED, UNKNOWN, FREE, TRAIL, SEEN = "█", "░", " ", "·", "▒"


@contextlib.contextmanager
def single_keys() -> Generator[Callable[[float], str]]:
    """Put the terminal of stdin into a mode in which every key is read at once; yield a function that reads keys.

    `read(timeout)` returns the keys pressed until `timeout` (s) at the latest, "" for none. Ctrl-C still is a signal. On leaving,
    also by an exception, the terminal is as it was. Raises InputError if stdin is not a terminal.
    """
    try:
        import termios
        import tty
    except ImportError:
        raise InputError("teleop needs a POSIX terminal; this system has none") from None
    number = _terminal_of_stdin()
    if number is None:
        raise InputError("teleop reads single keys from a terminal, but stdin is not one; run it in a terminal")
    before: list[Any] = termios.tcgetattr(number)

    def enter(*_: object) -> None:
        tty.setcbreak(number, termios.TCSANOW)

    def restore() -> None:
        termios.tcsetattr(number, termios.TCSANOW, before)

    def suspend(signum: int, frame: FrameType | None) -> None:
        # Ctrl-Z: the shell gets its terminal back, and `fg` continues here
        del frame
        restore()
        signal.signal(signum, signal.SIG_DFL)
        os.kill(os.getpid(), signum)
        signal.signal(signum, suspend)
        enter()

    try:
        stop_handler = signal.signal(signal.SIGTSTP, suspend)
    except ValueError:  # not in the main thread, where signals are received
        stop_handler = None
    try:
        enter()
        yield lambda timeout: _read(number, timeout)
    finally:
        restore()
        if stop_handler is not None:
            signal.signal(signal.SIGTSTP, stop_handler)


def _terminal_of_stdin() -> int | None:
    try:
        number = sys.stdin.fileno()
    except (ValueError, OSError, AttributeError):
        return None
    return number if os.isatty(number) else None


def _read(number: int, timeout: float) -> str:
    ready, _, _ = select.select([number], [], [], max(timeout, 0.0))
    if not ready:
        return ""
    data = os.read(number, 256)
    # the terminal is gone: as if Ctrl-C was pressed
    return data.decode("utf-8", "replace") if data else "\x03"


def map_lines(
    grid: OccupancyGrid,
    robot: Pose2D,
    *,
    columns: int,
    rows: int,
    meters: float,
    trail: list[tuple[float, float]] | None = None,
    seen: list[tuple[float, float]] | None = None,
) -> list[str]:
    """Return `rows` lines of `columns` characters around the robot; a character is `meters` wide and twice as high.

    A character is occupied if any cell in it is. `trail` and `seen` (obstacles of the sensors) are points of the map (m).
    """
    import numpy as np

    wide, high = meters, 2.0 * meters
    left, top = robot.x - 0.5 * columns * wide, robot.y + 0.5 * rows * high
    g = grid.geometry
    cells = np.full((rows, columns), -2, np.int16)
    data, first_x, first_y = grid.data, 0, 0
    if grid.origin_yaw == 0.0:
        view = Bounds(left, top - rows * high, left + columns * wide, top)
        window = g.window_of(view)
        data, first_x, first_y = data[window.slices], window.x0, window.y0
    iy, ix = np.indices(data.shape)
    ix, iy = ix + first_x, iy + first_y
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = (ix + 0.5) * g.resolution, (iy + 0.5) * g.resolution
    column = np.floor((g.origin_x + c * dx - s * dy - left) / wide).astype(np.int64)
    row = np.floor((top - g.origin_y - s * dx - c * dy) / high).astype(np.int64)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    np.maximum.at(cells, (row[inside], column[inside]), data[inside].astype(np.int16))
    text = np.full((rows, columns), FREE)
    text[cells < 0] = UNKNOWN
    text[cells >= 65] = OCCUPIED
    for points, mark in ((trail or [], TRAIL), (seen or [], SEEN)):
        for x, y in points:
            at, line = math.floor((x - left) / wide), math.floor((top - y) / high)
            if 0 <= at < columns and 0 <= line < rows and text[line, at] == FREE:
                text[line, at] = mark
    eighth = round(robot.yaw / (0.25 * math.pi)) % 8
    text[rows // 2, columns // 2] = ARROWS[eighth]
    return ["".join(line) for line in text.tolist()]
