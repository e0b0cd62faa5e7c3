"""Exact copies of a running simulation, to go back in time without simulating from the start.

A copy is a pickle in memory. What does not change (parameters, maps, code) is kept by reference; arrays that share memory share
memory again in the copy; functions keep the variables around them.
"""

from __future__ import annotations

import hashlib
import io
import math
import pickle
import struct
import types
import zlib
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import BaseModel

from navstack.core import InternalError
from navstack.parameters import Configuration
from navstack.record import Record, RunRecorder
from navstack.scenario import Run, Scenario, write_scenario

_BY_REFERENCE: Final = (type, types.BuiltinFunctionType, types.ModuleType, types.CodeType, np.ufunc, np.dtype)
"""Types whose values do not change."""
MAX_COUNT: Final = 40
MAX_BYTES: Final = 64_000_000
"""Most memory of the checkpoints of a session, compressed."""
RECENT_S: Final = 10.0
"""Checkpoints younger than this may be as dense as older ones (s)."""


@cache
def _compressing() -> ThreadPoolExecutor:
    """A thread of its own: compression takes as long as copying, and does not hold the interpreter."""
    return ThreadPoolExecutor(1, "navstack-checkpoints")


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A copy of an object and of all it refers to."""

    _data: Future[bytes]
    _references: tuple[Any, ...]

    @property
    def size(self) -> int:
        """Memory of the copy (bytes)."""
        return len(self._data.result())

    def restore(self) -> Any:
        """Returns a new object with the state of the moment of the copy."""
        return _Reader(io.BytesIO(zlib.decompress(self._data.result())), self._references).load()


def snapshot(item: Any, *, shared: tuple[Any, ...] = ()) -> Snapshot | None:
    """Copies an object; `shared` names objects in it that do not change. None if a part of it cannot be copied."""
    data = io.BytesIO()
    writer = _Writer(data, shared)
    try:
        writer.dump(item)
    except Exception:  # a plugin's part may raise anything; without a copy, going back takes longer
        return None
    return Snapshot(_compressing().submit(zlib.compress, data.getvalue(), 1), tuple(writer.references))


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A session at one moment."""

    time: float
    """Simulated time (s)."""
    cycles: int
    """Number of control cycles since the start."""
    done: int
    """Number of interactions carried out."""
    digest: Any
    """Hash of all cycles so far."""
    copied: Snapshot


class Checkpoints:
    """The checkpoints of a session: dense in the recent past, the older the sparser, bounded in number and memory."""

    def __init__(self) -> None:
        self._kept: list[Checkpoint] = []
        self._refused = False

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def times(self) -> list[float]:
        """When they were taken (simulated s)."""
        return [checkpoint.time for checkpoint in self._kept]

    def is_due(self, cycles: int, time: float, spacing: int) -> bool:
        """True if the last checkpoint before now is at least `spacing` control cycles old."""
        if self._refused:
            return False
        last = self.last_before(time)
        return cycles - (0 if last is None else last.cycles) >= spacing

    def keep(self, time: float, cycles: int, done: int, digest: Any, copied: Snapshot | None) -> None:
        """Adds a checkpoint; without a copy, there will be no more."""
        if copied is None:
            self._refused = True
            return
        self._kept.append(Checkpoint(time, cycles, done, digest, copied))
        self._kept.sort(key=lambda checkpoint: checkpoint.time)
        while len(self._kept) > MAX_COUNT or (len(self._kept) > 2 and self._size() > MAX_BYTES):
            del self._kept[self._least_useful()]

    def last_before(self, time: float) -> Checkpoint | None:
        """Returns the last checkpoint at or before a time (s)."""
        return next((checkpoint for checkpoint in reversed(self._kept) if checkpoint.time <= time), None)

    def all(self) -> tuple[Checkpoint, ...]:
        """Returns the checkpoints in the order of their times."""
        return tuple(self._kept)

    def drop_after(self, time: float) -> None:
        """Drops the checkpoints later than a time (s)."""
        self._kept = [checkpoint for checkpoint in self._kept if checkpoint.time <= time]

    def _size(self) -> int:
        return sum(checkpoint.copied.size for checkpoint in self._kept[:-1])  # the last one is still being compressed

    def _least_useful(self) -> int:
        """The one without which the longest way to simulate again, in relation to its age, grows least; never the last."""
        now = self._kept[-1].time
        times = [0.0, *self.times]

        def gap(k: int) -> float:
            return (times[k + 1] - times[k - 1]) / (now - times[k] + RECENT_S)

        return min(range(1, len(times) - 1), key=gap, default=1) - 1


class _Writer(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: tuple[Any, ...]) -> None:
        super().__init__(file, protocol=5)
        self.references: list[Any] = []
        self._index: dict[int, int] = {}
        self._owners: dict[int, Any] = {}
        for item in shared:
            self._reference(item)

    def persistent_id(self, obj: Any) -> int | None:
        """Returns the number of an object that is kept by reference."""
        found = self._index.get(id(obj))
        if found is not None:
            return found
        return self._reference(obj) if _is_constant(obj) else None

    def reducer_override(self, obj: Any) -> Any:
        """Returns how to build an object that pickle would build otherwise."""
        if isinstance(obj, (np.ndarray, np.void)) and obj.base is not None:
            owner = self._owner_of(obj)
            return NotImplemented if owner is obj else _reduced_view(obj, owner)
        if isinstance(obj, types.FunctionType):
            self._reference(obj.__globals__)
            return _function, (obj.__code__, obj.__globals__, obj.__name__, obj.__defaults__, obj.__closure__)
        if isinstance(obj, types.CellType):
            return types.CellType, (), obj.cell_contents, None, None, _fill_cell
        if isinstance(obj, types.MappingProxyType):
            return types.MappingProxyType, (dict(obj),)
        return NotImplemented

    def _owner_of(self, obj: Any) -> Any:
        """The array whose memory an array or a record uses."""
        while isinstance(obj.base, np.ndarray):
            obj = obj.base
        if obj.base is None:
            return obj
        # memory of numba: the first array of it stands for the owner, if it contains the other
        first = self._owners.setdefault(id(obj.base), obj)
        return first if first.base is obj.base and _contains(first, obj) else obj

    def _reference(self, obj: Any) -> int:
        number = self._index.setdefault(id(obj), len(self.references))
        if number == len(self.references):
            self.references.append(obj)
        return number


class _Reader(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, references: tuple[Any, ...]) -> None:
        super().__init__(file)
        self._references = references

    def persistent_load(self, pid: int) -> Any:
        """Returns the object that is kept by reference."""
        return self._references[pid]


def _is_constant(obj: Any) -> bool:
    if isinstance(obj, types.FunctionType):
        return obj.__closure__ is None
    if isinstance(obj, np.ndarray):
        return _is_frozen(obj)
    if isinstance(obj, BaseModel):
        return bool(obj.model_config.get("frozen"))
    kind = type(obj)
    return kind is object or isinstance(obj, _BY_REFERENCE) or kind.__module__.partition(".")[0] == "numba"


def _is_frozen(array: Any) -> bool:
    """True for an array that cannot be written to."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return array is None or isinstance(array, bytes)


def _contains(first: Any, other: Any) -> bool:
    (low, high), (begin, end) = _bounds(first), _bounds(other)
    return bool(low <= begin and end <= high and first.flags.c_contiguous)


def _bounds(array: Any) -> tuple[int, int]:
    """First address of an array's memory and the one after the last."""
    low = high = _address(array)
    for length, stride in zip(array.shape, array.strides, strict=True):
        low, high = low + min(0, (length - 1) * stride), high + max(0, (length - 1) * stride)
    return low, high + array.itemsize


def _address(array: Any) -> int:
    return int(array.__array_interface__["data"][0])


def _reduced_view(obj: Any, owner: Any) -> Any:
    """How to build a view of another array, or a record in it."""
    record = isinstance(obj, np.void)
    place = (_address(obj) - _address(owner), obj.shape, None if record else obj.strides, obj.dtype)
    return _view, (owner, *place, bool(obj.flags.writeable), record)


def _view(owner: Any, offset: int, shape: Any, strides: Any, dtype: Any, writeable: bool, record: bool) -> Any:
    view = np.ndarray(shape, dtype, owner, offset, strides)
    view.flags.writeable = writeable
    return view[()] if record else view


def _function(*parts: Any) -> Any:
    return types.FunctionType(*parts)


def _fill_cell(cell: Any, contents: Any) -> None:
    cell.cell_contents = contents


# ----------------------------------------------------------------------------------------------------------------------
# A session at one moment, to be simulated again in another thread: for its record, and for explanations.


NEAR_S: Final = 5.0
"""Before a command that is explained, the record begins this much earlier (s)."""
SLACK_S: Final = 1e-3
"""Tolerance of requested times (s), as `navstack.explain` has it."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a scenario came from, to write it to a file again."""

    map_file: Path | None = None
    sources: tuple[str, ...] = ()
    """The parameters' `--params`."""


@dataclass(frozen=True, slots=True)
class Twin:
    """A session at one moment, to be simulated again."""

    scenario: Scenario
    """With the interactions so far."""
    origin: Origin
    cycles: int
    done: bool
    digest: bytes
    """Digest of all cycles."""
    configuration: Configuration
    """The parameters in force."""
    until: float
    """The current time (s)."""
    goals: tuple[tuple[str, float], ...]
    """Id of each goal so far, and when it was sent (s)."""
    checkpoints: tuple[Checkpoint, ...]

    def recorded(self) -> RunRecorder:
        """Simulates the run again, with its record. Raises InternalError if it differs from the session."""
        again = Run(self.scenario)
        digest = hashlib.blake2b()
        for _ in range(self.cycles):
            again.step()
            digest.update(digest_of(again))
        self._check(digest.digest())
        if self.done:
            again.step()  # finishes the record
        assert again.recorder is not None
        return again.recorder

    def record_for_command(self, time: float) -> Record:
        """Returns a record with the last command until `time` (s): from a checkpoint on, or, without one, of the whole run."""
        by_hand = max(
            (i.time for i in self.scenario.interactions if i.kind == "teleop" and i.time <= time), default=-1.0
        )
        before = [checkpoint for checkpoint in self.checkpoints if checkpoint.time < time]
        nearer = [self._nearer(checkpoint, time - NEAR_S) for checkpoint in before[-1:]]
        for checkpoint in (*nearer, *reversed(before)):
            record = self._record_from(checkpoint, time)
            searches = (*record.local_plan_times, *(event.time for event in record.events_of("control_failed")))
            begun = len(record.times) > 0 and record.times[0] <= time + SLACK_S
            if begun and (min(searches, default=math.inf) <= time + SLACK_S or by_hand >= record.times[0]):
                return record
        return self.recorded().record()

    def record_for_goal(self, number: int) -> tuple[Record, str | None]:
        """Returns a record with a goal (from 1), and its id: from a checkpoint on, or, without one, of the whole run."""
        if 1 <= number <= len(self.goals):
            name, sent = self.goals[number - 1]
            before = [checkpoint for checkpoint in self.checkpoints if checkpoint.time < sent]
            if before:
                return self._record_from(before[-1], math.inf), name
        return self.recorded().record(), None

    def _nearer(self, checkpoint: Checkpoint, time: float) -> Checkpoint:
        """Returns a checkpoint at about `time` (s), without a record on the way: recording and checking it takes longer."""
        if checkpoint.time >= time:
            return checkpoint
        run, history = checkpoint.copied.restore()
        run.replace_upcoming(self.scenario.interactions[checkpoint.done :])
        digest, cycles = checkpoint.digest.copy(), checkpoint.cycles
        while cycles < self.cycles and run.robot.time < time:
            before = run.robot.time
            while cycles < self.cycles and run.robot.time <= before:  # interactions come between two times only
                run.step()
                digest.update(digest_of(run))
                cycles += 1
        done = len(self.scenario.interactions) - len(run.upcoming)
        copied = snapshot((run, history), shared=(self.scenario, run.scenario, self.scenario.map))
        return checkpoint if copied is None else Checkpoint(run.robot.time, cycles, done, digest, copied)

    def _record_from(self, checkpoint: Checkpoint, time: float) -> Record:
        """Simulates the run again from a checkpoint until `time` (s), or until now. Raises InternalError as `recorded`."""
        run = self._resumed(checkpoint)
        digest = checkpoint.digest.copy()
        for _ in range(self.cycles - checkpoint.cycles):
            if run.robot.time > time + SLACK_S:
                break
            run.step()
            digest.update(digest_of(run))
        else:
            self._check(digest.digest())
            if self.done:
                run.step()
        assert run.recorder is not None
        record = run.recorder.record()
        record.resume = lambda: self._resumed(checkpoint)
        return record

    def _resumed(self, checkpoint: Checkpoint) -> Run:
        """Returns the run at a checkpoint, with a record that begins there."""
        run: Run
        run, _ = checkpoint.copied.restore()
        run.replace_upcoming(self.scenario.interactions[checkpoint.done :])
        run.record_from_here(self.scenario)
        return run

    def _check(self, digest: bytes) -> None:
        if digest != self.digest:
            raise InternalError(
                "the run simulated again differs from the session; this is a bug in navstack, please report it with the "
                "saved scenario"
            )

    def save_scenario(self, path: Path) -> Scenario:
        """Writes the session as a scenario file and returns what it loads to. Raises OutputError."""
        return write_scenario(self.scenario, path, map_file=self.origin.map_file, sources=self.origin.sources)


def digest_of(run: Run) -> bytes:
    """Bytes that differ if a cycle differs."""
    return struct.pack("<7d", run.robot.time, *run.robot.pose, *run.move_base.command)
