"""`@kernel`: lazy compilation with numba, and a cache of the machine code.

- Importing a module of kernels is cheap: numba (half a second) is imported at the first call of a kernel, and only then are the
  kernels that call each other compiled.
- The cache is in the user's cache folder, one for all installations. Its key is the content of a kernel and of everything that
  it uses (`fingerprint`), not its place: comments, moved kernels and new installations compile nothing.
- Without a readable folder, each process compiles the kernels again.
- NAVSTACK_BOUNDSCHECK=1 compiles every kernel with bounds checks, as other entries of the cache.
- `navstack.core.compilation` compiles ahead, in parallel processes.
"""

from __future__ import annotations

import hashlib
import os
import threading
import types
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from functools import cached_property, partial, update_wrapper
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, Self, TypeVar, cast

if TYPE_CHECKING:
    from navstack.core.kernel_cache import KernelDispatcher

P = ParamSpec("P")
R = TypeVar("R")

_LOCK = threading.RLock()
_KERNELS: list[Kernel[..., Any]] = []


def boundscheck_enabled() -> bool:
    """Return True if NAVSTACK_BOUNDSCHECK enables bounds checks."""
    return os.environ.get("NAVSTACK_BOUNDSCHECK", "") not in ("", "0")


class Kernel(partial[R], Generic[P, R]):
    """A function that numba compiles at its first call.

    It is a `partial` of the compiled function, without arguments, because that is called without a frame of Python: a control
    cycle calls more than 20 kernels.
    """

    function: Callable[P, R]
    allocates: bool
    _compiled: Callable[P, R] | None

    if TYPE_CHECKING:

        def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
            """Call the compiled function."""
            ...

    def __new__(cls, function: Callable[P, R], *, allocates: bool = True) -> Self:
        """Wrap a function; `allocates` is False if it allocates no array."""
        self = super().__new__(cls, function)
        self.function = function
        self.allocates = allocates
        self._compiled = None
        _KERNELS.append(self)
        update_wrapper(self, function)
        self._set_target(self._first_call)
        return self

    def _set_target(self, target: Callable[..., Any]) -> None:
        cast("Any", self).__setstate__((target, (), {}, self.__dict__))

    def _first_call(self, *args: Any, **kwargs: Any) -> R:
        return cast("Callable[..., R]", self.compiled())(*args, **kwargs)

    def compiled(self) -> Callable[P, R]:
        """Return numba's dispatcher, which saves a tenth of a microsecond per call."""
        if self._compiled is None:
            from navstack.core.kernel_cache import KernelDispatcher

            with _LOCK:
                if self._compiled is None:
                    self._compiled = cast("Callable[P, R]", KernelDispatcher(cast("Any", self)))
                    self._set_target(self._compiled)
        return self._compiled

    @property
    def dispatcher(self) -> KernelDispatcher:
        """Numba's dispatcher, with the types of numba."""
        return cast("KernelDispatcher", self.compiled())

    @property
    def boundscheck(self) -> bool:
        """Whether it is compiled with bounds checks."""
        return boundscheck_enabled()

    @cached_property
    def name(self) -> str:
        """The name and the parameters, which identify a kernel wherever it is defined."""
        code = self.function.__code__
        return f"{code.co_name}({', '.join(code.co_varnames[: code.co_argcount])})"

    @cached_property
    def callees(self) -> dict[str, Kernel[..., Any]]:
        """The kernels that it calls directly, by their names in its module."""
        names = self.function.__globals__
        return {name: names[name] for name in _names(self.function.__code__) if isinstance(names.get(name), Kernel)}

    @cached_property
    def fingerprint(self) -> str | None:
        """A hash of all that determines the machine code except the types of arguments; None if something has no stable value.

        That is the bytecode without positions and docstring, the constants and kernels that it names, and the options.
        """
        try:
            text = (_description(self.function), self.allocates, boundscheck_enabled())
        except (_NoStableValueError, RecursionError):
            return None
        return hashlib.sha256(repr(text).encode()).hexdigest()


def kernel(function: Callable[P, R]) -> Kernel[P, R]:
    """Compile with numba in nopython mode, releasing the GIL. No fastmath and no threads: reproducible to the bit."""
    return Kernel(function)


def plain_kernel(function: Callable[P, R]) -> Kernel[P, R]:
    """As `kernel`, for a function that allocates no array: the references of its arguments are not counted.

    Counting takes atomic operations, which wait for all stores before them: half of the time of a search over records.
    """
    return Kernel(function, allocates=False)


def imported_kernels() -> list[Kernel[..., Any]]:
    """Return the kernels of all modules that are imported, in the order of their definitions."""
    return list(_KERNELS)


@contextmanager
def compilation_reported(report: Callable[[], None], *, each: bool = False) -> Generator[None]:
    """Call `report` in the block before the first kernel, or each, that is compiled because the cache does not contain it."""
    from numba.core import event

    class FirstCompilation(event.Listener):
        reported = False

        def on_start(self, event: Any) -> None:
            if each or not self.reported:
                self.reported = True
                report()

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", FirstCompilation()):
        yield


class _NoStableValueError(Exception):
    """A kernel names an object whose content cannot be described."""


def _names(code: types.CodeType) -> Iterator[str]:
    """The global names and attributes in a function and in those defined in it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)


def _description(function: types.FunctionType | Callable[..., Any]) -> Any:
    """Describe the content of a function, without its place."""
    function = cast("types.FunctionType", function)
    names = function.__globals__
    code = function.__code__
    return (
        _code_description(code, function.__doc__),
        [_value_description(value) for value in function.__defaults__ or ()],
        [_value_description(cell.cell_contents) for cell in function.__closure__ or ()],
        [(name, _value_description(names[name], set(_names(code)))) for name in _names(code) if name in names],
    )


def _code_description(code: types.CodeType, doc: str | None = None) -> Any:
    constants = [
        _code_description(value) if isinstance(value, types.CodeType) else _value_description(value)
        for value in code.co_consts
        if value is not doc
    ]
    shape = (code.co_name, code.co_argcount, code.co_kwonlyargcount, code.co_posonlyargcount, code.co_flags)
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return code.co_code.hex(), getattr(code, "co_exceptiontable", b"").hex(), constants, shape, names


def _value_description(value: Any, attributes: set[str] = frozenset()) -> Any:  # type: ignore[assignment]
    """Describe a value that a kernel uses; of a module or class of the project, its attributes of these names."""
    if isinstance(value, Kernel):
        if value.fingerprint is None:
            raise _NoStableValueError
        return value.fingerprint
    if value is None or value is ... or isinstance(value, (bool, int, float, complex, str, bytes)):
        return type(value).__name__, repr(value)
    if isinstance(value, (tuple, list)):
        return type(value).__name__, [_value_description(item) for item in cast("tuple[Any]", value)]
    python_function: Any = getattr(value, "py_func", None)  # numba's own decorator
    if python_function is not None:
        return _description(python_function), repr(value.targetoptions)
    if isinstance(value, types.ModuleType):
        if value.__name__.partition(".")[0] in ("math", "numpy", "numba"):
            return value.__name__
        return [(name, _value_description(getattr(value, name))) for name in sorted(attributes) if hasattr(value, name)]
    if isinstance(value, type) and value.__module__.partition(".")[0] not in ("builtins", "numpy", "numba"):
        members = {name: vars(value).get(name) for name in ("_fields", "_member_map_")}
        return value.__qualname__, [_value_description(list(each)) for each in members.values() if each]
    return _foreign_description(value)


def _foreign_description(value: Any) -> Any:
    """Describe an array, a dtype, or a function or class of the libraries."""
    import numpy as np

    if isinstance(value, np.ndarray):
        array = cast("np.ndarray[Any, Any]", value)
        return str(array.dtype), array.shape, array.strides, hashlib.sha256(array.tobytes()).hexdigest()
    if isinstance(value, (np.dtype, np.generic)):
        return repr(cast("Any", value))
    name = getattr(value, "__qualname__", getattr(value, "__name__", None))
    if name is None:
        raise _NoStableValueError
    return getattr(value, "__module__", ""), name
