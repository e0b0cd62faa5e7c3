"""`@kernel`: lazy compilation with numba, and a cache of the machine code.

- Importing a module of kernels is cheap: numba (half a second) is imported at the first call of a kernel, and only then are the
  kernels that call each other compiled.
- The cache is in the user's cache folder. Its key contains the size and time of the kernel's file and of the files of all
  kernels that it calls (numba checks the file of the caller only). So a change in one file recompiles its callers, and no
  other kernels.
- Without a writable folder, each process compiles the kernels again.
- NAVSTACK_BOUNDSCHECK=1 compiles every kernel with bounds checks, into a separate cache.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache, update_wrapper
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")

_LOCK = threading.RLock()
_OUTDATED_S = 30 * 86400.0
_PACKAGE = Path(__file__).resolve().parent.parent


def boundscheck_enabled() -> bool:
    """Return True if NAVSTACK_BOUNDSCHECK enables bounds checks."""
    return os.environ.get("NAVSTACK_BOUNDSCHECK", "") not in ("", "0")


class Kernel(Generic[P, R]):
    """A function that numba compiles at its first call."""

    def __init__(self, function: Callable[P, R], *, allocates: bool = True) -> None:
        self.function = function
        self._allocates = allocates
        self._compiled: Callable[P, R] | None = None
        update_wrapper(self, function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        compiled = self._compiled
        if compiled is None:
            compiled = self.compiled()
        return compiled(*args, **kwargs)

    def compiled(self) -> Callable[P, R]:
        """Return numba's dispatcher, which saves a tenth of a microsecond per call."""
        if self._compiled is None:
            with _LOCK:
                if self._compiled is None:
                    dispatcher = _dispatcher(self.function, self._allocates)
                    self._compiled = dispatcher
                    # replace the kernels that this one calls by their dispatchers, which numba requires
                    names = self.function.__globals__
                    for name in self.function.__code__.co_names:
                        other = names.get(name)
                        if isinstance(other, Kernel):
                            names[name] = cast("Kernel[..., Any]", other).compiled()
        return self._compiled


def kernel(function: Callable[P, R]) -> Kernel[P, R]:
    """Compile with numba in nopython mode, releasing the GIL. No fastmath and no threads: reproducible to the bit."""
    return Kernel(function)


def plain_kernel(function: Callable[P, R]) -> Kernel[P, R]:
    """As `kernel`, for a function that allocates no array: the references of its arguments are not counted.

    Counting takes atomic operations, which wait for all stores before them: half of the time of a search over records.
    """
    return Kernel(function, allocates=False)


def _dispatcher(function: Callable[P, R], allocates: bool) -> Callable[P, R]:
    import numba
    import numba.core.config

    config: Any = numba.core.config

    options: dict[str, Any] = {"nogil": True, "boundscheck": boundscheck_enabled(), "error_model": "numpy"}
    options["_nrt"] = allocates  # always given: without it, a kernel inherits it from its caller
    folder = _cache_folder(_files_behind(function))
    if folder is not None:
        before = config.CACHE_DIR
        config.CACHE_DIR = folder  # read by numba during decoration; restored for other users of numba
        try:
            dispatcher: Any = numba.njit(cache=True, **options)(function)
            _lock_cache_writes(dispatcher, Path(folder))
            return cast("Callable[P, R]", dispatcher)
        except (RuntimeError, OSError):
            pass  # the folder is not usable: compile without a cache
        finally:
            config.CACHE_DIR = before
    return cast("Callable[P, R]", numba.njit(**options)(function))


def _lock_cache_writes(dispatcher: Any, folder: Path) -> None:
    """Serialize the cache writes of all processes.

    numba chooses a free file name and writes the index and the file without a lock. If two processes compile one kernel for
    different types at the same time, one can store the machine code of the other under its own types.
    """
    try:
        import fcntl
    except ImportError:  # not available on this system
        return
    save = dispatcher._cache.save_overload

    def save_overload(signature: Any, compiled: Any) -> None:
        try:
            lock = (folder / "lock").open("w")
        except OSError:
            return
        with lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            save(signature, compiled)

    dispatcher._cache.save_overload = save_overload


@contextmanager
def compilation_reported(report: Callable[[], None]) -> Generator[None]:
    """Call `report` in the block before the first kernel that is compiled because the cache does not contain it."""
    from numba.core import event

    class FirstCompilation(event.Listener):
        reported = False

        def on_start(self, event: Any) -> None:
            if not self.reported:
                self.reported = True
                report()

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", FirstCompilation()):
        yield


def _files_behind(function: Callable[..., Any]) -> tuple[str, ...]:
    """Return the files of a kernel and of all kernels that its module can call, sorted."""
    files = {function.__code__.co_filename, __file__}
    modules = [function.__globals__]
    while modules:
        for value in list(modules.pop().values()):
            # a kernel, or the dispatcher that replaced it
            other: Any = value.function if isinstance(value, Kernel) else getattr(value, "py_func", None)
            if other is not None and other.__code__.co_filename not in files:
                files.add(other.__code__.co_filename)
                modules.append(other.__globals__)
    return tuple(sorted(files))


@cache
def _cache_folder(files: tuple[str, ...]) -> str | None:
    """Return the cache folder for the kernels in these files, in their current state; None if it is not writable."""
    digest = hashlib.sha256(b"boundscheck" if boundscheck_enabled() else b"")
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        for file in files:
            status = Path(file).stat()
            digest.update(f"{file}:{status.st_size}:{status.st_mtime_ns};".encode())
        root = Path(base) if base else Path.home() / ".cache"
        folder = root / "navstack" / f"kernels-{digest.hexdigest()[:16]}"
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            _remove_outdated(folder)
    except (OSError, RuntimeError):
        return None
    return str(folder) if os.access(folder, os.W_OK | os.X_OK) else None


def _remove_outdated(present: Path) -> None:
    """Remove caches of former states of the kernels that were not used for a month."""
    for other in present.parent.glob("kernels-*"):
        if other != present and time.time() - other.stat().st_mtime > _OUTDATED_S:
            shutil.rmtree(other, ignore_errors=True)
