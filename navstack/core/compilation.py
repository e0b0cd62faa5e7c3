"""Compilation of kernels ahead of their first call, in parallel processes.

`kernels.json` lists the specializations that the commands use, by the names of kernels and not by their modules; it is written
by `tools/record_kernels.py`. `compile_ahead` lets processes compile those that the cache does not contain, callees first; it
returns when the cache is complete. What is not listed is compiled at its first call.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import IO, Any, Final, cast

from navstack.core.jit import Kernel, imported_kernels

MANIFEST: Final = Path(__file__).with_name("kernels.json")
PROCESSES_VARIABLE: Final = "NAVSTACK_COMPILE_PROCESSES"
"""Environment variable: the number of processes that compile; 0 compiles each kernel at its first call."""
_FEWEST: Final = 4
"""Fewer missing specializations than this are compiled at their first call: a process takes a second to start."""

Progress = Callable[[int, int], None]
"""Called with the number of compiled specializations and of all, at least twice a second."""


@dataclass(eq=False)
class Specialization:
    """A kernel and the types of its arguments; `inner` if other kernels call it, not Python."""

    kernel: Kernel[..., Any]
    types: str
    inner: bool
    uses: tuple[str, ...] = ()
    waits_for: set[Specialization] = field(default_factory=lambda: set())
    height: int = 0  # of the calls above it: the highest ones are compiled first

    def is_cached(self) -> bool | None:
        """Return True if its file exists; None if it cannot be cached."""
        from navstack.core.kernel_cache import cache_file, parse

        try:
            file = cache_file(cast("Any", self.kernel), parse(self.types), inner=self.inner)
        except Exception:  # types of another version of numba
            return None
        return None if file is None else file.exists()

    @property
    def modules(self) -> tuple[str, ...]:
        """The modules that define the kernel, and the named tuples among the types."""
        from navstack.core.kernel_cache import named_tuple_modules, parse

        return self.kernel.function.__module__, *sorted(named_tuple_modules(parse(self.types)))

    def compile(self) -> None:
        """Compile it into the cache. Raises numba's errors."""
        from navstack.core.kernel_cache import parse

        dispatcher = self.kernel.dispatcher.inner if self.inner else self.kernel.dispatcher
        dispatcher.compile(parse(self.types))


@cache
def recorded_uses() -> dict[str, list[tuple[str, bool, tuple[str, ...]]]]:
    """Return the specializations of the manifest: (types, inner, names of uses), by the names of kernels."""
    document = json.loads(MANIFEST.read_text())
    names = document["uses"]
    return {
        kernel: [(types, bool(inner), tuple(names[i] for i in uses)) for types, inner, uses in rows]
        for kernel, rows in document["kernels"].items()
    }


def recorded_specializations(uses: Collection[str] | None = None) -> list[Specialization]:
    """Return the recorded specializations of all imported kernels, only those of some uses if given."""
    recorded = recorded_uses()
    return [
        Specialization(kernel, types, inner, names)
        for kernel in imported_kernels()
        for types, inner, names in recorded.get(kernel.name, ())
        if uses is None or not set(names).isdisjoint(uses)
    ]


def compile_ahead(
    uses: Collection[str] | None = None, progress: Progress | None = None, *, required: bool = False
) -> int:
    """Compile what is recorded for these uses (None: all), of the modules that are imported, and missing in the cache.

    Returns the number of specializations that were missing; 0 if nothing can be cached. Where a process gains nothing, as
    on a single core, kernels are left to their first use, unless compiling ahead is `required`.
    """
    processes = max(_processes(), int(required))
    if processes < 1:
        return 0
    missing = [each for each in recorded_specializations(uses) if each.is_cached() is False]
    if not missing or (len(missing) < _FEWEST and not required):
        return 0
    _order(missing)
    _Workers(missing, min(processes, len(missing))).run(progress)
    return len(missing)


def import_all_kernels() -> None:
    """Import every module of the package that defines kernels."""
    package = Path(__file__).resolve().parents[1]
    for file in sorted(package.rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if "\n@kernel\n" in text or "\n@plain_kernel\n" in text:
            importlib.import_module(".".join((package.name, *file.relative_to(package).with_suffix("").parts)))


def _processes() -> int:
    """Return the number of processes to start: one per core; none where a single one gains nothing."""
    wanted = os.environ.get(PROCESSES_VARIABLE, "")
    if wanted.isdigit():
        return int(wanted)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, 8) if cores > 1 else 0


def _order(missing: list[Specialization]) -> None:
    """Let each wait for the kernels that it calls, and sort: those with the longest chain of callers first."""
    inner: dict[Kernel[..., Any], list[Specialization]] = {}
    for each in missing:
        if each.inner:
            inner.setdefault(each.kernel, []).append(each)
    for each in missing:
        each.waits_for = {callee for kernel in each.kernel.callees.values() for callee in inner.get(kernel, ())} - {
            each
        }

    def raise_callees(caller: Specialization) -> None:
        for callee in caller.waits_for:
            if callee.height <= caller.height < len(missing):
                callee.height = caller.height + 1
                raise_callees(callee)

    for each in missing:
        raise_callees(each)
    missing.sort(key=lambda each: -each.height)


class _Workers:
    """Processes that compile, each served by a thread."""

    def __init__(self, missing: list[Specialization], count: int) -> None:
        self._waiting = missing.copy()
        self._total = len(missing)
        self._done = 0
        self._changed = threading.Condition()
        self._processes: list[subprocess.Popen[str]] = []
        self._count = count

    def run(self, progress: Progress | None) -> None:
        """Compile everything; end the processes if an exception interrupts this."""
        threads: list[threading.Thread] = []
        try:
            for _ in range(self._count):
                self._processes.append(process := _start())
                threads.append(threading.Thread(target=self._serve, args=(process,), daemon=True))
                threads[-1].start()
            while any(thread.is_alive() for thread in threads):
                if progress is not None:
                    progress(self._done, self._total)
                with self._changed:
                    self._changed.wait(0.2)
        except OSError:  # no processes here: each kernel is compiled at its first call
            pass
        finally:
            with self._changed:
                self._waiting.clear()
                self._changed.notify_all()
            for process in self._processes:
                process.kill()
                process.wait()
            for thread in threads:
                thread.join()

    def _serve(self, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None and process.stdout is not None
        with process.stdin as tasks, process.stdout as replies:
            for task in self._tasks():
                try:
                    tasks.write(json.dumps((task.modules, task.kernel.name, task.types, task.inner)) + "\n")
                    tasks.flush()
                    ended = not replies.readline()
                except (OSError, ValueError):
                    ended = True
                self._finish(task)
                if ended:
                    return

    def _tasks(self) -> Iterator[Specialization]:
        """Yield the next specialization whose callees are compiled, until none is left."""
        while True:
            with self._changed:
                while (
                    not (ready := next((each for each in self._waiting if not each.waits_for), None)) and self._waiting
                ):
                    self._changed.wait()
                if ready is None:
                    return
                self._waiting.remove(ready)
            yield ready

    def _finish(self, task: Specialization) -> None:
        with self._changed:
            self._done += 1
            for each in self._waiting:
                each.waits_for.discard(task)
            self._changed.notify_all()


def _start() -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", "from navstack.core.compilation import serve; serve()"]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True, env=environment)


def serve(tasks: IO[str] = sys.stdin) -> None:
    """Compile each specialization that a line of the input names, and reply with a line; what a worker does."""
    with os.fdopen(os.dup(1), "w") as replies:
        os.dup2(2, 1)  # nothing else may write to the pipe
        for line in tasks:
            modules, name, types, inner = json.loads(line)
            try:
                for module in modules:
                    importlib.import_module(module)
                for kernel in imported_kernels():
                    if kernel.name == name and kernel.function.__module__ == modules[0]:
                        Specialization(kernel, types, inner).compile()
            except Exception:  # it is compiled, or fails, at its first call
                pass
            replies.write("\n")
            replies.flush()
