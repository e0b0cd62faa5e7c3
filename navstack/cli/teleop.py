"""`navstack teleop`: drive a simulated robot with the keyboard."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.live import Live
from rich.text import Text

from navstack.behaviors import HELP, KeyboardTeleop
from navstack.cli import options
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.motions import MotionOptions, World
from navstack.cli.output import counted, loading_kernels, print_files, stdout
from navstack.cli.terminal import map_lines, single_keys
from navstack.core import LETHAL, NavError, locked_folder
from navstack.plot import plot_run
from navstack.scenario import INTERACTION, Run, warm_up

if TYPE_CHECKING:
    from navstack.scenario import Scenario

POLL_S = 0.04
"""Time between two looks at the keyboard (s)."""
IDLE_S = 5.0
"""Simulated time by which an idle run is prolonged (s)."""
FOREVER_S = 1e7
QUIT = "\x03"
"""Ctrl-C, in a terminal that passes it as a key."""


@options.with_options(chosen=MotionOptions)
def teleop(
    world: World = "office",
    speed: Annotated[float, typer.Option("--speed", help="Speed at the start (m/s).", min=0.0)] = 0.3,
    turn: Annotated[float, typer.Option("--turn", help="Turn rate at the start (rad/s).", min=0.0)] = 0.6,
    hold: Annotated[
        float,
        typer.Option(
            "--hold",
            help="The robot stops this long after a key (simulated s), as on a base with a timeout; 0: never.",
            min=0.0,
        ),
    ] = 1.0,
    rate: Annotated[float, typer.Option("--rate", help="Simulated seconds per second.", min=0.01, max=1000.0)] = 1.0,
    map_: Annotated[bool, typer.Option("--map/--no-map", help="Draw the map in the terminal.")] = True,
    zoom: Annotated[
        float, typer.Option("--zoom", help="Width of a character of the map (m).", min=0.01, max=10.0)
    ] = 0.1,
    chosen: MotionOptions = MotionOptions(),
    out: options.RunOutput = Path("navstack_teleop"),
) -> int:
    """Drive a simulated robot with the keyboard; Ctrl-C quits, and the run is recorded.

    Keys as in teleop_twist_keyboard: u i o, j k l, m , . drive; shifted they drive a holonomic robot sideways; q z, w x, e c
    change the speeds by 10 %; any other key stops. With a `twist_mux`, `velocity_smoother` or `collision_monitor` among the
    parameters, the commands pass through them.

    Exit codes: 0 quit by Ctrl-C, 2 invalid input, 143 by SIGTERM, 129 by SIGHUP. The terminal is restored in every case.
    """
    import signal

    scenario = chosen.build(world, ())
    with locked_folder(out):
        with interrupt_flag() as interrupt, single_keys() as read:
            with loading_kernels(scenario.configuration.planner_names):
                warm_up(scenario)
            session = Session(Run(scenario), scenario, KeyboardTeleop(speed, turn), hold or FOREVER_S)
            with _display(session, map_=map_, zoom=zoom) as show:
                drive(session, read, show, interrupt, rate)
        _save(session, out)
    return 0 if interrupt.signal in (None, signal.SIGINT) else interrupt.exit_code


class Session:
    """A run that a person drives: its interactions are added to its record, which can be replayed like any other."""

    def __init__(self, run: Run, scenario: Scenario, keyboard: KeyboardTeleop, hold_s: float) -> None:
        self.run = run
        self.keyboard = keyboard
        self.last_key = ""
        self.refused = ""
        """Why the last key had no effect."""
        self._scenario = scenario
        self._hold_s = hold_s
        self._items: list[Any] = []

    def press(self, key: str) -> None:
        """Drives as the key says."""
        self.last_key = key
        twist = self.keyboard.press(key)
        now = self.run.robot.time
        try:
            self._interact("teleop", velocity=list(twist), until=min(now + self._hold_s, FOREVER_S))
            self.refused = ""
        except NavError as exc:
            self.refused = exc.message

    def advance_to(self, until: float) -> None:
        """Runs to the simulated time `until` (s)."""
        while self.run.robot.time < until:
            if not self.run.step():
                self._interact("wait", duration=IDLE_S)

    def end(self) -> None:
        """Stops the robot, and ends the run when it stands."""
        robot = self.run.robot
        self._interact("teleop", velocity=[0.0, 0.0, 0.0], until=robot.time)
        first, last = robot.time + 0.2, robot.time + 5.0
        while robot.time < first or (robot.time < last and max(map(abs, robot.state().velocity)) > 1e-3):
            self.advance_to(robot.time + 0.05)
        self.run.stop()
        recorder = self.run.recorder
        assert recorder is not None
        recorder.set_scenario(replace(self._scenario, interactions=tuple(self._items)).as_dict())

    def _interact(self, kind: str, **values: Any) -> None:
        item = INTERACTION.validate_python({"time": self.run.robot.time, "kind": kind, **values})
        self.run.interact(item)
        self._items.append(item)


def drive(
    session: Session,
    read: Callable[[float], str],
    show: Callable[[], None],
    stop: Callable[[], bool],
    rate: float,
) -> None:
    """Reads keys and advances the run at `rate` simulated seconds per second, until `stop` returns True or Ctrl-C."""
    begin, begun_at = time.monotonic(), session.run.robot.time
    show()
    while not stop():
        keys = read(POLL_S)
        if QUIT in keys:
            break
        for key in keys:
            session.press(key)
        wanted = begun_at + rate * (time.monotonic() - begin)
        late = wanted - session.run.robot.time
        if late > max(1.0, 0.5 * rate):  # the machine is slower than that, or was suspended
            begin, begun_at = time.monotonic(), session.run.robot.time
            wanted = begun_at + rate * POLL_S
        session.advance_to(wanted)
        show()
    session.end()


def _save(session: Session, folder: Path) -> None:
    run, recorder = session.run, session.run.recorder
    assert recorder is not None
    files = save_record(recorder, folder)
    plot_run(recorder.record(), folder / "run.png")
    files["picture"] = str(folder / "run.png")
    collisions = counted(len(run.robot.collisions), "collision")
    stdout().print(f"{run.robot.time:.1f} s simulated, {run.robot.distance_travelled:.2f} m driven, {collisions}")
    print_files(files)


def _display(session: Session, *, map_: bool, zoom: float) -> Any:
    if map_ and stdout().is_terminal:
        return MapDisplay(session, zoom)
    return plain_display(session)


# ----------------------------------------------------------------------------------------------------------------------
# What `navstack teleop` shows: the map and the state, or a line per key.


HEIGHT_OF_TEXT = 12
"""Lines below the map."""
MOST_TRAIL = 4000


@contextlib.contextmanager
def plain_display(session: Session) -> Generator[Callable[[], None]]:
    """Print the help once, then a line for every key."""
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
        """Draw the current state."""
        self._live.update(self._picture(), refresh=True)

    def _picture(self) -> Any:
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
            meters=self._zoom,
            trail=self._trail,
            seen=self._seen(),
        )
        text = Text("\n".join(lines), no_wrap=True, overflow="crop")
        collisions = len(robot.collisions)
        text.append("\n" + counted(collisions, "collision"), style="bold red" if collisions else "bold")
        text.append("\n" + status_of(session), style="bold")
        text.append("\n" + HELP, style="dim")
        return text

    def _seen(self) -> list[tuple[float, float]]:
        """The lethal cells of the local costmap, in the map: what the sensors have marked."""
        import numpy as np

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
