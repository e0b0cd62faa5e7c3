"""Numba's dispatcher of a kernel, and the cache on disk of what it compiled.

A file holds one specialization: a checksum, then numba's compile result. Its name is the hash of the kernel's fingerprint and
of the types. Processes that need the same specialization wait for the first one, which compiles it.
"""

# pyright: reportAttributeAccessIssue=false, reportUnknownLambdaType=false, reportUnnecessaryIsInstance=false
# pyright: reportGeneralTypeIssues=false
# numba has no types

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import pickle
import shutil
import sys
import time
import types
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import llvmlite.binding
import numba
import numba.core.compiler
import numpy as np
from numba.core import config, errors, serialize
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.sigutils import normalize_signature
from numba.core.types import unliteral

from navstack.core.compile_clock import compiling

if TYPE_CHECKING:
    from collections.abc import Sequence


_FORMAT: Final = 2
_OUTDATED_S: Final = 30 * 86400.0
_LONGEST_WAIT_S: Final = 120.0
"""Longest wait for another process that compiles the same specialization; then it is compiled here, too."""


class KernelSource(Protocol):
    """What is compiled: `navstack.core.Kernel`."""

    @property
    def function(self) -> Any:
        """The Python function."""
        ...

    @property
    def name(self) -> str:
        """The name and the parameters."""
        ...

    @property
    def allocates(self) -> bool:
        """Whether it allocates arrays."""
        ...

    @property
    def boundscheck(self) -> bool:
        """Whether it is compiled with bounds checks."""
        ...

    @property
    def callees(self) -> Any:
        """The kernels that it calls, by name."""
        ...

    @property
    def fingerprint(self) -> str | None:
        """A hash of all that determines the machine code except the types of arguments."""
        ...


class KernelDispatcher(CPUDispatcher):
    """The specializations of a kernel that Python calls; `inner` has those that other kernels call.

    Those need no wrapper that unpacks Python objects, which takes a large part of the time to compile.
    """

    def __init__(self, kernel: KernelSource, *, inner: bool = False) -> None:
        original: Any = kernel.function
        prints = kernel.fingerprint
        # a copy, whose globals are set when it is compiled, and whose names do not tell where it is from
        self._names: dict[str, Any] = {"__builtins__": __builtins__, "__name__": __name__}
        function = types.FunctionType(
            original.__code__, self._names, original.__name__, original.__defaults__, original.__closure__
        )
        function.__module__ = __name__
        function.__qualname__ = f"{original.__name__}_{prints[:12]}" if prints else original.__qualname__
        options = {"nopython": True, "nogil": True, "boundscheck": kernel.boundscheck, "error_model": "numpy"}
        options["_nrt"] = kernel.allocates  # always given: without it, a kernel inherits it from its caller
        options["no_cfunc_wrapper"] = True
        options["no_cpython_wrapper"] = inner
        super().__init__(function, {}, options)
        self.kernel = kernel
        self._inner: KernelDispatcher | None = None
        self.is_inner = inner
        self.calls: dict[tuple[Any, ...], tuple[tuple[str, str], ...]] = {}
        self._cache = DiskCache(self) if prints is not None else self._cache

    @property
    def inner(self) -> KernelDispatcher:
        """The specializations that other kernels call."""
        if self._inner is None:
            self._inner = KernelDispatcher(self.kernel, inner=True)
        return self._inner

    def link(self) -> None:
        """Set the globals of the function: the kernels that it calls must be numba's dispatchers."""
        if len(self._names) == 2:
            self._names |= {k: v for k, v in self.kernel.function.__globals__.items() if k not in self._names}
            for name, callee in self.kernel.callees.items():
                self._names[name] = self if callee is self.kernel else callee.dispatcher

    def compile(self, sig: Any) -> Any:
        arguments, _ = normalize_signature(sig)
        with compiling(), global_compiler_lock:
            depth = len(_CALLS)
            try:
                return super().compile(arguments)
            finally:
                del _CALLS[depth:]
                if isinstance(self._cache, DiskCache):
                    self._cache.unlock()

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Give the type of a call in another kernel; a constant is its type, except where typing needs the constant."""
        if not self.is_inner:
            return self.inner.get_call_template(args, kws)
        try:
            found = super().get_call_template(tuple(map(unliteral, args)), {k: unliteral(v) for k, v in kws.items()})
        except errors.TypingError:
            found = super().get_call_template(args, kws)
        types_ = tuple(found[2])
        for calls in _CALLS[-1:]:
            calls += [(self.kernel.name, describe(types_)), *self.calls.get(types_, ())]
        return found

    def get_overload(self, sig: Any) -> Any:
        """Return what another kernel calls."""
        return super().get_overload(sig) if self.is_inner else self.inner.get_overload(sig)


_CALLS: list[list[tuple[str, str]]] = []
"""For each kernel in compilation, the outermost first: the specializations that it calls, directly or not."""


class DiskCache:
    """The files of one kernel; what numba's dispatcher expects of a cache."""

    cache_path: Path | None = None

    def __init__(self, dispatcher: KernelDispatcher) -> None:
        self._dispatcher = dispatcher
        self._locked: list[int] = []

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        file = cache_file(self._dispatcher.kernel, sig, inner=self._dispatcher.is_inner)
        loaded = None if file is None else self._load(file, sig, target_context)
        if loaded is None:
            target_context.refresh()
            if file is not None:
                self._locked.append(number := int(file.name[:7], 16))
                if not _lock(file, number):  # another process compiled it meanwhile
                    loaded = self._load(file, sig, target_context)
            if loaded is None:
                _CALLS.append([])
                self._dispatcher.link()
        return loaded

    def _load(self, file: Path, sig: Any, target_context: Any) -> Any:
        try:
            content = file.read_bytes()
            if hashlib.sha256(content[32:]).digest() != content[:32]:
                return None
            calls, symbols, reduced = pickle.loads(content[32:])
            _provide(symbols, target_context)
            loaded = numba.core.compiler.CompileResult._rebuild(target_context, *reduced)
        except Exception:  # not there, damaged, or of another version of a library: it is compiled
            return None
        self._dispatcher.calls[tuple(sig)] = calls
        _note_use(file)
        return loaded

    def save_overload(self, sig: Any, data: Any) -> None:
        calls = tuple(dict.fromkeys(_CALLS[-1]))
        self._dispatcher.calls[tuple(sig)] = calls
        file = cache_file(self._dispatcher.kernel, sig, inner=self._dispatcher.is_inner)
        if file is None or data.library.has_dynamic_globals:
            return
        content = serialize.dumps((calls, _external_symbols(data.library), data._reduce()))
        part = file.with_name(f"{file.name}.{os.getpid()}.part")
        try:
            part.write_bytes(hashlib.sha256(content).digest() + content)
            part.replace(file)
        except OSError:  # full, or not writable
            with contextlib.suppress(OSError):
                part.unlink()
            return
        _remove_outdated(file.parent)

    def unlock(self) -> None:
        """Release the lock of the specialization that was compiled last."""
        if self._locked:
            _unlock(self._locked.pop())


def _external_symbols(library: Any) -> tuple[str, ...]:
    """Return the names of what the machine code of a library uses and does not contain."""
    module = library._final_module
    values = itertools.chain(module.functions, module.global_variables)
    return tuple(sorted(value.name for value in values if value.is_declaration and not value.name.startswith("llvm.")))


def _provide(symbols: Sequence[str], target_context: Any) -> None:
    """Make symbols known to the linker. Numba's whole library, which takes 0.3 s, is loaded only for those that need it."""
    rtsys.initialize(target_context)
    if not all(map(llvmlite.binding.address_of_symbol, symbols)):
        target_context.refresh()


def cache_file(kernel: KernelSource, arguments: Sequence[Any], *, inner: bool) -> Path | None:
    """Return the file of a specialization; None if it cannot be cached."""
    folder = cache_folder()
    text = f"{kernel.fingerprint} {inner} {', '.join(map(_key, arguments))}"
    if folder is None or kernel.fingerprint is None or " at 0x" in text:  # the address of an object
        return None
    return folder / hashlib.sha256(text.encode()).hexdigest()[:32]


def _key(type_: Any) -> str:
    """Write a type so that equal texts mean equal machine code; numba does not write the fields of a named tuple."""
    if isinstance(type_, numba.types.BaseTuple):
        return f"{type_} {getattr(type_, 'fields', '')} {[_key(item) for item in type_]}"
    return str(type_)


def describe(arguments: Sequence[Any]) -> str:
    """Write types of arguments as Python, which `parse` reads."""
    return ", ".join(map(_describe, arguments))


def _describe(type_: Any) -> str:
    from numba.np.numpy_support import as_dtype

    if isinstance(type_, numba.types.Array):
        flags = "" if type_.mutable else ", readonly=True"
        flags += "" if type_.aligned else ", aligned=False"
        return f"array({_describe(type_.dtype)}, {type_.ndim}, {type_.layout!r}{flags})"
    if isinstance(type_, numba.types.Record):
        return f"record({as_dtype(type_)!r})"
    if isinstance(type_, numba.types.BaseNamedTuple):
        return f"named({type_.instance_class.__name__!r}, {describe(type_.types)})"
    if isinstance(type_, numba.types.UniTuple):
        return f"repeated({_describe(type_.dtype)}, {type_.count})"
    if isinstance(type_, numba.types.Tuple):
        return f"row({describe(type_.types)})"
    if isinstance(type_, numba.types.Omitted):
        return f"omitted({type_.value!r})"
    return str(type_)


def parse(text: str) -> tuple[Any, ...]:
    """Read what `describe` wrote. Raises an exception of any class if it is not that."""
    return eval(f"({text},)" if text else "()", {"__builtins__": {}}, _parse_names())


def named_tuple_modules(arguments: Sequence[Any]) -> set[str]:
    """Return the modules that define the named tuples among types of arguments."""
    return {each.instance_class.__module__ for each in arguments if isinstance(each, numba.types.BaseNamedTuple)}


@cache
def _named_tuple(name: str, *items: Any) -> Any:
    """Return the type of a named tuple, whose class is in any module of the package that is imported."""
    for module, content in list(sys.modules.items()):
        found = vars(content).get(name) if module.partition(".")[0] == "navstack" else None
        if len(getattr(found, "_fields", ())) == len(items) > 0:
            of_one_type = len(set(items)) == 1
            return (
                numba.types.NamedUniTuple(items[0], len(items), found)
                if of_one_type
                else numba.types.NamedTuple(items, found)
            )
    raise LookupError(name)


@cache
def _parse_names() -> dict[str, Any]:
    from numba.np.numpy_support import from_dtype

    kinds = ("int", "uint", "float", "complex")
    scalars = {name: value for name, value in vars(numba.types).items() if name.rstrip("0123456789") in kinds}
    return scalars | {
        "bool": numba.types.boolean,
        "none": numba.types.none,
        "True": True,
        "False": False,
        "None": None,
        "array": lambda dtype, ndim, layout, **flags: numba.types.Array(dtype, ndim, layout, **flags),
        "record": from_dtype,
        "dtype": np.dtype,
        "repeated": numba.types.UniTuple,
        "row": lambda *items: numba.types.Tuple(items),
        "named": _named_tuple,
        "omitted": numba.types.Omitted,
    }


@cache
def cache_folder() -> Path | None:
    """Return the folder for these versions of the libraries and this processor; None if it cannot be made or read."""
    from numba.core.registry import cpu_target

    versions = (
        _FORMAT,
        numba.__version__,
        llvmlite.__version__,
        np.__version__,
        sys.implementation.cache_tag,
        sys.version,
    )
    settings = (config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE, config.BOUNDSCHECK, config.DEBUGINFO_DEFAULT)
    text = repr((versions, tuple(map(str, settings)), cpu_target.target_context.codegen().magic_tuple()))
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        root = Path(base) if base else Path.home() / ".cache"
        folder = root / "navstack" / f"kernels-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return None
    return folder if os.access(folder, os.R_OK | os.X_OK) else None


@cache
def _lock_file(folder: Path) -> int | None:
    """Open the file whose bytes are the locks; it stays open, because closing it would release them all."""
    try:
        return os.open(folder / "lock", os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
    except OSError:
        return None


def _lock(file: Path, number: int) -> bool:
    """Lock a specialization before it is compiled. Returns False if another process had the lock meanwhile."""
    try:
        import fcntl
    except ImportError:
        return True
    descriptor = _lock_file(file.parent)
    start = time.monotonic()
    waited = False
    while descriptor is not None and time.monotonic() - start < _LONGEST_WAIT_S:
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, number)
        except (BlockingIOError, PermissionError):
            waited = True
            time.sleep(0.01)
        except OSError:  # a file system without locks
            break
        else:
            return not waited and not file.exists()
    return True


def _unlock(number: int) -> None:
    folder = cache_folder()
    descriptor = None if folder is None else _lock_file(folder)
    if descriptor is not None:
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            fcntl.lockf(descriptor, fcntl.LOCK_UN, 1, number)


def _note_use(file: Path) -> None:
    """Set the times of a file and of its folder, once a day."""
    with contextlib.suppress(OSError):
        if time.time() - file.stat().st_mtime > 86400.0:
            os.utime(file)
            os.utime(file.parent)


@cache
def _remove_outdated(present: Path) -> None:
    """Remove what was not used for a month: files in the current folder, and folders of other versions; once per process."""
    oldest = time.time() - _OUTDATED_S
    with contextlib.suppress(OSError):
        for file in present.iterdir():
            if file.name != "lock" and file.stat().st_mtime < oldest:
                file.unlink(missing_ok=True)
        for other in present.parent.glob("kernels-*"):
            if other != present and other.stat().st_mtime < oldest:
                shutil.rmtree(other, ignore_errors=True)
