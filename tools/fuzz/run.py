"""Reads mutated inputs and counts what they lead to, in one process or in several that are watched."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import random
import signal
import tempfile
import time
import traceback
import warnings
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from navstack.core import NavError
from tools.fuzz.inputs import KINDS, CommandError, Inputs, valid_record
from tools.fuzz.measure import limit_address_space, measured, queued_seconds

MAX_SECONDS: Final = 5.0
MAX_BYTES: Final = 1_000_000_000
_HANG: Final = 60.0
"""A process that reads one input for longer, without waiting for the processor, is ended (s)."""
_PIECE: Final = 500
"""Inputs between two reports of a process."""


@dataclass
class KindCounts:
    """What the inputs of one reader led to."""

    inputs: int = 0
    accepted: int = 0
    seconds: float = 0.0
    slowest: tuple[float, int] = (0.0, -1)
    """Longest read (s) and its input."""
    largest: tuple[int, int] = (0, -1)
    """Largest growth of memory (bytes) and its input."""


@dataclass
class Counts:
    """What all inputs led to."""

    inputs: int = 0
    accepted: int = 0
    unmade: list[str] = field(default_factory=list[str])
    """Inputs that could not be made: defects of the mutations."""
    tracebacks: list[str] = field(default_factory=list[str])
    slow: list[str] = field(default_factory=list[str])
    large: list[str] = field(default_factory=list[str])
    readers: dict[str, KindCounts] = field(default_factory=lambda: defaultdict(KindCounts))

    @property
    def failures(self) -> list[str]:
        """One text per offending input."""
        return self.unmade + self.tracebacks + self.slow + self.large

    def add(self, other: Counts) -> None:
        """Add the counts of another part of the inputs."""
        self.inputs += other.inputs
        self.accepted += other.accepted
        self.unmade += other.unmade
        self.tracebacks += other.tracebacks
        self.slow += other.slow
        self.large += other.large
        for reader, counts in other.readers.items():
            mine = self.readers[reader]
            mine.inputs += counts.inputs
            mine.accepted += counts.accepted
            mine.seconds += counts.seconds
            mine.slowest = max(mine.slowest, counts.slowest)
            mine.largest = max(mine.largest, counts.largest)


@dataclass(frozen=True)
class Plan:
    """Which inputs are read: input i, of kind i modulo the number of kinds, depends only on the seed and i."""

    seed: int
    kinds: tuple[str, ...] = KINDS
    commands: float = 0.0
    keep: Path | None = None


class Reader:
    """Makes and reads inputs in this process, in a folder of its own."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan = plan
        self.inputs = Inputs(folder, commands=plan.commands)
        if plan.commands:
            self._warm_up()

    def _warm_up(self) -> None:
        """Load what commands load on their first use, so that it is not counted for an input."""
        folder = self.inputs.folder
        (folder / "warm.npz").write_bytes(valid_record(self.inputs.members))
        (folder / "warm.launch").write_bytes(self.inputs.launch)
        from navstack.cli.app import run

        pose = ["--start", "0.2,0.2", "--goal", "0.4,0.2"]
        for arguments in (
            ["plan", str(folder / "small.yaml"), *pose, "--json"],
            ["explain", "goal", str(folder / "warm.npz"), "--json"],
            ["check", "turtlebot", "--json"],
            ["check", "turtlebot"],
            ["check", str(folder / "warm.launch")],
        ):
            _quiet(run, arguments)

    def read(self, number: int, counts: Counts) -> None:
        """Make and read one input, and count what it leads to."""
        try:
            wall, seconds, grown, failure, made, kind = self._measured(number)
        except Exception as exc:
            counts.unmade.append(f"input {number} cannot be made: {_shown(exc)}")
            return
        failed = len(counts.failures)
        counts.inputs += 1
        of_reader = counts.readers[made.reader]
        of_reader.inputs += 1
        of_reader.seconds += seconds
        of_reader.slowest = max(of_reader.slowest, (seconds, number))
        of_reader.largest = max(of_reader.largest, (grown, number))
        name = f"{kind} {number} ({made.reader})"
        if failure is None:
            counts.accepted += 1
            of_reader.accepted += 1
        elif not isinstance(failure, NavError):
            counts.tracebacks.append(f"{name}: {_shown(failure)}")
        if seconds > MAX_SECONDS:
            counts.slow.append(f"{name}: {seconds:.1f} s, and {wall - seconds:.1f} s of waiting for the processor")
        if grown > MAX_BYTES:
            counts.large.append(f"{name}: {grown / 1e6:.0f} MB")
        if self.plan.keep is not None and len(counts.failures) > failed:
            self._keep(number, made.path)

    def _measured(self, number: int) -> tuple[float, float, int, Exception | None, Any, str]:
        kind = self.plan.kinds[number % len(self.plan.kinds)]
        made = self.inputs.make(kind, random.Random(f"{self.plan.seed}/{number}"))
        return *measured(made.read), made, kind

    def _keep(self, number: int, path: Path) -> None:
        keep = self.plan.keep
        if keep is None or not path.is_file() or path.is_symlink():
            return
        keep.mkdir(parents=True, exist_ok=True)
        for file in (path, path.with_name("mutated.png")):
            if file.is_file():
                (keep / f"{number}_{file.name}").write_bytes(file.read_bytes())


def _quiet(call: Any, arguments: list[str]) -> None:
    from contextlib import redirect_stderr, redirect_stdout
    from io import StringIO

    with redirect_stdout(StringIO()), redirect_stderr(StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        call(arguments)


def _shown(failure: Exception) -> str:
    """The exception, and the places of navstack and of its end in the traceback."""
    text = f"{type(failure).__name__}: {' '.join(str(failure).split())[:200]}"
    if isinstance(failure, CommandError):
        return text
    frames = traceback.extract_tb(failure.__traceback__)
    ours = [frame for frame in frames if "navstack" in Path(frame.filename).parts]
    places = dict.fromkeys(f"{Path(frame.filename).name}:{frame.lineno}" for frame in (*ours[-2:], frames[-1]))
    return f"{text} ({' > '.join(places)})"


def fuzz(
    count: int,
    seed: int,
    kinds: tuple[str, ...] = KINDS,
    *,
    first: int = 0,
    commands: float = 0.0,
    keep: Path | None = None,
) -> Counts:
    """Read `count` mutated inputs from number `first` on, in this process, the kinds in turn."""
    counts = Counts()
    with tempfile.TemporaryDirectory(prefix="navstack_fuzz_") as name, warnings.catch_warnings():
        reader = Reader(Plan(seed, kinds, commands, keep), Path(name))
        warnings.simplefilter("error")
        for number in range(first, first + count):
            reader.read(number, counts)
    return counts


# --- several processes ----------------------------------------------------------------------------------------------------


class _Worker:
    """A process that reads pieces of the inputs; it is ended if one input takes too long."""

    def __init__(self, context: Any, plan: Plan) -> None:
        self.connection, theirs = context.Pipe()
        self.current = context.Array("d", [-1.0, 0.0, 0.0], lock=False)
        """The input that is read, since when (s), and how long the process had waited for the processor by then (s)."""
        self.process = context.Process(target=_serve, args=(plan, theirs, self.current), daemon=True)
        self.process.start()
        theirs.close()
        self.piece: range | None = None

    def send(self, piece: range) -> None:
        self.piece = piece
        self.current[:] = [-1.0, time.monotonic(), queued_seconds(self.process.pid)]
        self.connection.send((piece.start, len(piece)))

    def hangs(self) -> bool:
        """True if the current input takes too long."""
        number, since, queued = self.current
        if number < 0.0 or time.monotonic() - since <= _HANG:
            return False
        waiting = queued_seconds(self.process.pid) - queued
        return time.monotonic() - since - waiting > _HANG and self.current[0] == number

    def end(self) -> None:
        if self.process.is_alive():
            os.kill(self.process.pid, signal.SIGKILL)
        self.process.join()
        self.connection.close()


def _serve(plan: Plan, connection: Any, current: Any) -> None:
    limit_address_space()
    with tempfile.TemporaryDirectory(prefix="navstack_fuzz_") as name, warnings.catch_warnings():
        reader = Reader(plan, Path(name))
        warnings.simplefilter("error")
        while True:
            try:
                first, count = connection.recv()
            except EOFError:
                return
            counts = Counts()
            for number in range(first, first + count):
                current[:] = [float(number), time.monotonic(), queued_seconds()]
                reader.read(number, counts)
            current[0] = -1.0
            connection.send_bytes(pickle.dumps(counts))


def fuzz_in_processes(plan: Plan, count: int, processes: int, *, first: int = 0, progress: Any = None) -> Counts:
    """Read `count` inputs in several processes. An input that ends or blocks its process is counted, and the rest read."""
    context: Any = multiprocessing.get_context("fork")
    total = Counts()
    todo = [range(i, min(i + _PIECE, first + count)) for i in range(first, first + count, _PIECE)][::-1]
    workers: list[_Worker] = []
    try:
        while todo or any(worker.piece for worker in workers):
            while len(workers) < processes and todo:
                workers.append(_Worker(context, plan))
            for worker in tuple(workers):
                if worker.piece is None and todo:
                    worker.send(todo.pop())
                _collect(worker, workers, todo, total)
            if progress is not None:
                progress(total)
            time.sleep(0.02)
    finally:
        for worker in workers:
            worker.end()
    return total


def _collect(worker: _Worker, workers: list[_Worker], todo: list[range], total: Counts) -> None:
    """Take the counts of a piece; after the end of a process, continue behind the input that it read."""
    if worker.piece is None:
        return
    try:
        if worker.connection.poll():
            total.add(pickle.loads(worker.connection.recv_bytes()))
            worker.piece = None
            return
    except (EOFError, OSError):
        pass
    if worker.process.is_alive() and not worker.hangs():
        return
    number, piece = int(worker.current[0]), worker.piece
    hangs = worker.process.is_alive()
    worker.end()
    workers.remove(worker)
    if number < 0:
        raise RuntimeError(f"a process ended while it made the valid files (exit code {worker.process.exitcode})")
    total.inputs += 1
    if hangs:
        total.slow.append(f"input {number}: more than {_HANG:g} s; its process was ended")
    else:
        total.tracebacks.append(f"input {number}: ended its process (exit code {worker.process.exitcode})")
    # the piece is read again without the input, because its counts are lost
    todo += [part for part in (range(piece.start, number), range(number + 1, piece.stop)) if part]
