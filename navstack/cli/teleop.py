"""`navstack teleop`: drive a simulated robot with the keyboard."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navstack.cli import options
from navstack.cli.motion_options import MotionOptions, World

if TYPE_CHECKING:
    from navstack.motion.keyboard import KeyboardTeleop
    from navstack.scenario import Run, Scenario

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

    from navstack.cli.interrupts import interrupt_flag
    from navstack.cli.output import loading_kernels
    from navstack.cli.terminal import single_keys
    from navstack.core.file_lock import locked_folder
    from navstack.core.files import ensure_directory
    from navstack.motion.keyboard import KeyboardTeleop
    from navstack.scenario import Run, warm_up

    scenario = chosen.build(world, ())
    with locked_folder(ensure_directory(out)):
        with interrupt_flag() as interrupt, single_keys() as read:
            with loading_kernels():
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
        from navstack.core.errors import NavError

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
        from navstack.scenario.interactions import INTERACTION

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
    from navstack.cli.output import print_files, stdout
    from navstack.plot import plot_run

    run, recorder = session.run, session.run.recorder
    assert recorder is not None
    files = {what: str(name) for what, name in recorder.save(folder).items()}
    plot_run(recorder.record(), folder / "run.png")
    files["picture"] = str(folder / "run.png")
    collisions = len(run.robot.collisions)
    stdout().print(
        f"{run.robot.time:.1f} s simulated, {run.robot.distance_travelled:.2f} m driven, {collisions} collisions"
    )
    print_files(files)


def _display(session: Session, *, map_: bool, zoom: float) -> Any:
    from navstack.cli.output import stdout
    from navstack.cli.teleop_display import MapDisplay, plain_display

    if map_ and stdout().is_terminal:
        return MapDisplay(session, zoom)
    return plain_display(session)
