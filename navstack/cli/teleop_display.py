"""What `navstack teleop` shows: the map and the state, or a line per key."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator
from types import TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navstack.cli.teleop import Session

HEIGHT_OF_TEXT = 11
"""Lines below the map."""
MOST_TRAIL = 4000


@contextlib.contextmanager
def plain_display(session: Session) -> Generator[Callable[[], None]]:
    """Print the help once, then a line for every key."""
    from navstack.cli.output import stdout
    from navstack.motion.keyboard import HELP

    out = stdout()
    out.print(HELP, markup=False)
    out.print(f"ready: {session.keyboard}", markup=False)
    shown: list[Any] = [None]

    def show() -> None:
        state = (session.last_key, session.keyboard.twist, session.keyboard.speed, session.keyboard.turn)
        if session.last_key and state != shown[0]:
            shown[0] = state
            out.print(status_of(session), markup=False)

    yield show


def status_of(session: Session) -> str:
    """Return key, command, speeds and pose on one line."""
    robot, (vx, vy, wz) = session.run.robot, session.keyboard.twist
    key = session.last_key if session.last_key.isprintable() else repr(session.last_key)
    text = f"key {key}: vx {vx:.3f}, vy {vy:.3f}, wz {wz:.3f}; {session.keyboard}"
    x, y, yaw = robot.pose
    text += f"; {robot.time:.1f} s at ({x:.2f}, {y:.2f}, {yaw:.2f})"
    return f"{text}; refused: {session.refused}" if session.refused else text


class MapDisplay:
    """The map around the robot, drawn in the terminal."""

    def __init__(self, session: Session, zoom: float) -> None:
        """`zoom`: width of a character (m)."""
        from rich.live import Live

        from navstack.cli.output import stdout

        self._session, self._zoom = session, zoom
        self._console = stdout()
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._trail: list[tuple[float, float]] = []

    def __enter__(self) -> Callable[[], None]:
        self._live.__enter__()
        return self.show

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.__exit__(kind, exc, trace)

    def show(self) -> None:
        """Draw the present state."""
        self._live.update(self._picture(), refresh=True)

    def _picture(self) -> Any:
        from rich.text import Text

        from navstack.cli.terminal import map_lines
        from navstack.motion.keyboard import HELP

        session, size = self._session, self._console.size
        robot = session.run.robot
        at = (robot.pose.x, robot.pose.y)
        if not self._trail or at != self._trail[-1]:
            self._trail = [*self._trail[-MOST_TRAIL:], at]
        lines = map_lines(
            robot.world.map,
            robot.pose,
            columns=max(size.width - 1, 20),
            rows=max(size.height - HEIGHT_OF_TEXT, 5),
            metres=self._zoom,
            trail=self._trail,
            seen=self._seen(),
        )
        text = Text("\n".join(lines), no_wrap=True, overflow="crop")
        collisions = len(robot.collisions)
        text.append(
            "\n" + status_of(session) + f"; {collisions} collisions", style="bold red" if collisions else "bold"
        )
        text.append("\n" + HELP, style="dim")
        return text

    def _seen(self) -> list[tuple[float, float]]:
        """The lethal cells of the local costmap, in the map: what the sensors have marked."""
        import numpy as np

        from navstack.core import LETHAL

        robot, costmap = self._session.run.robot, self._session.run.move_base.local_costmap
        master = costmap.master
        rows, columns = np.nonzero(master.data == LETHAL)
        if costmap.frame == robot.map_frame:
            transform = None
        else:
            transform = robot.frames.lookup(robot.map_frame, costmap.frame)
        g = master.geometry
        points = np.empty((len(rows), 2))
        points[:, 0] = g.origin_x + (columns + 0.5) * g.resolution
        points[:, 1] = g.origin_y + (rows + 0.5) * g.resolution
        placed = points if transform is None else transform.apply_points(points)
        return [(float(x), float(y)) for x, y in placed]
