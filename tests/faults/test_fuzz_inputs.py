"""Mutated maps, records, scenarios, parameters (also of Nav2), launch files and logs; CI runs 24,000 (`tools/fuzz_inputs.py`)."""

from __future__ import annotations

import mmap
from pathlib import Path

import pytest

from navstack.core import InputError
from tools.fuzz import run as fuzz_run
from tools.fuzz.inputs import KINDS, Input, Inputs
from tools.fuzz.run import Counts, Plan, fuzz, fuzz_in_processes


@pytest.mark.slow
@pytest.mark.exhaustive  # CI runs tools/fuzz_inputs.py with more
@pytest.mark.parametrize("kind", KINDS)
def test_mutated_inputs(kind: str) -> None:
    number = 100 if kind == "log" else 400  # a log takes ten times as long as another input
    counts = fuzz(number, 0, (kind,))
    assert counts.inputs == number
    assert counts.accepted < number or kind in ("parameters", "nav2", "launch")  # their readers return findings
    assert counts.unmade + counts.tracebacks + counts.large == []


@pytest.mark.slow
def test_maps_of_mutated_logs() -> None:
    counts = fuzz(40, 0, ("mapping",))
    assert counts.inputs == 40
    assert 0 < counts.accepted < 40
    assert counts.unmade + counts.tracebacks + counts.large == []


def test_mutated_files_of_nav2() -> None:
    counts = fuzz(200, 1, ("nav2",))
    assert counts.inputs == 200
    assert counts.unmade + counts.tracebacks + counts.large == []


@pytest.mark.slow
def test_an_input_depends_on_seed_and_number_only(tmp_path: Path) -> None:
    import random

    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one, other = Inputs(tmp_path / "a"), Inputs(tmp_path / "b")
    other.make("map", random.Random(5))
    for number in range(40):
        made = [i.make(KINDS[number % len(KINDS)], random.Random(f"9/{number}")) for i in (one, other)]
        assert made[0].reader == made[1].reader
        assert made[0].path.name == made[1].path.name
        if made[0].path.is_file() and not made[0].path.is_symlink():
            assert made[0].path.read_bytes() == made[1].path.read_bytes()


class Failing(Inputs):
    """Reads that fail in every way: input 0 raises, 1 ends the process, 2 takes memory, 3 is rejected, 4 is accepted."""

    def make(self, kind: str, rng: object) -> Input:
        del kind
        number = int(rng.number)  # type: ignore[attr-defined]
        return Input(self.folder / "x", [_raise, _end, _allocate, _reject, _accept][number % 5], "x")


def _raise() -> None:
    raise KeyError("x")


def _end() -> None:
    import os

    os._exit(7)


def _allocate() -> None:
    # not from the heap: a free part of it may be resident since the tests before
    with mmap.mmap(-1, 60_000_000, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as pages:
        pages[::4096] = b"x" * len(range(0, 60_000_000, 4096))


def _reject() -> None:
    raise InputError("wrong")


def _accept() -> None:
    return


@pytest.mark.slow
def test_failing_reads_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    class Numbered:
        def __init__(self, text: str) -> None:
            self.number = text.partition("/")[2]

    monkeypatch.setattr(fuzz_run, "Inputs", Failing)
    monkeypatch.setattr(fuzz_run.random, "Random", Numbered)
    monkeypatch.setattr(fuzz_run, "MAX_BYTES", 30_000_000)
    counts: Counts = fuzz_in_processes(Plan(0), 10, 2)
    assert counts.inputs == 10
    assert counts.accepted == 4  # the inputs that take memory, and the good ones
    assert sorted(text.split(":")[0] for text in counts.tracebacks) == [
        "input 1",
        "input 6",
        "launch 5 (x)",
        "map 0 (x)",
    ]
    assert sorted(text.split(":")[0] for text in counts.large) == ["scenario 2 (x)", "tree 7 (x)"]
    assert counts.slow == []
