"""A simulation that a program steps, such as an environment of Gymnasium: pages see it and set its pace.

The program hands each step over to the simulation's thread, where it is carried out when its time has come, and waits for the
result. So no step runs while a page is drawn, and pause, speed and single steps work as in any session.
"""

from __future__ import annotations

import math
import queue
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Final, TypeVar, cast

from navstack.core import InputError
from navstack.explain import Replayed
from navstack.live.session import History, Session
from navstack.scenario import Run, Scenario

T = TypeVar("T")

PATIENCE_S: Final = 0.005
"""The session waits so long for the program's next step before pages are served (s)."""
ALIVE_S: Final = 0.2
"""Time between two looks at whether the server still runs (s)."""


class WatchedSession(Session):
    """Episodes that a program begins and steps; what a page may do is to pause, to step and to set the speed."""

    only_time = "a program steps this simulation: only pause, single steps and the speed are possible here"
    rewinds = False

    def __init__(self, scenario: Scenario, run: Run, *, speed: float | None = 1.0) -> None:
        """`run`: the first episode, or what has the parts of a `Run` that pages show."""
        self._waiting: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = queue.SimpleQueue()
        self.run = run
        super().__init__(scenario, speed=speed)

    # --- for the program --------------------------------------------------------------------------------------------

    def carry_out(self, action: Callable[[], T], *, alive: Callable[[], bool] = lambda: True) -> T:
        """Call a function in the simulation's thread when the time has come for a step, and return its result.

        Raises its errors, and InputError if the server has ended (`alive` returns False).
        """
        result: Future[T] = Future()
        self._waiting.put((action, result))
        try:
            while True:
                try:
                    return result.result(timeout=ALIVE_S)
                except TimeoutError:
                    if result.done():  # the action's own error
                        raise
                    if not alive():
                        raise InputError("the server of the live page has ended; make a new environment") from None
        finally:
            result.cancel()  # of no effect on one that is done

    def show(self, scenario: Scenario, run: Run) -> None:
        """Begin to show another episode; call it in the simulation's thread."""
        self.scenario, self.run = scenario, run
        self.worlds += 1
        self.changes += 1
        self._start()

    @property
    def has_stack(self) -> bool:
        """Whether the episode is a `Run`, with all its parts."""
        return isinstance(cast(object, self.run), Run)

    # --- what a session does ----------------------------------------------------------------------------------------

    @property
    def is_done(self) -> bool:
        """Never: the program may begin another episode."""
        return False

    @property
    def explained(self) -> Replayed:
        """What explanations of the present look at. Raises InputError if there is no stack."""
        if not self.has_stack:
            raise InputError("there are no costmaps here: the agent drives without the stack")
        return self.run

    def advance(
        self, elapsed_s: float, *, budget_s: float, timer: Callable[[], float], limit: float = math.inf
    ) -> bool:
        """As of any session; the beginning of an episode counts, too."""
        before = self.worlds, self.time
        super().advance(elapsed_s, budget_s=budget_s, timer=timer, limit=limit)
        return (self.worlds, self.time) != before

    def interact(self, action: dict[str, Any]) -> Any:
        """Raise InputError."""
        raise InputError(self.only_time)

    def seek(self, time: float) -> None:
        """Raise InputError."""
        raise InputError(self.only_time)

    def restart(self) -> None:
        """Raise InputError."""
        raise InputError(self.only_time)

    def twin(self) -> Any:
        """Raise InputError: only the program could simulate the episode again."""
        raise InputError("a program steps this simulation, without a record; explain a run of navstack simulate")

    def _start(self) -> None:
        self.history = History()
        self._begin()

    def _measure(self, simulated_s: float, elapsed_s: float) -> None:
        super()._measure(max(simulated_s, 0.0), elapsed_s)  # a new episode begins at 0 s

    def _step(self) -> bool:
        """Carry out the next step of the program; return False if it has none yet."""
        try:
            action, result = self._waiting.get(timeout=PATIENCE_S)
        except queue.Empty:
            return False
        if not result.set_running_or_notify_cancel():  # the program was interrupted
            return False
        try:
            value = action()
        except BaseException as error:
            result.set_exception(error)
            return False
        self.cycles += 1
        self.end = max(self.end, self.time)
        result.set_result(value)
        return True
