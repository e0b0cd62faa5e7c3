"""The kernel wrapper: lazy compilation, the cache by content, and compilation ahead in processes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core import event

from navstack.core import compile_clock, kernel_cache
from navstack.core.compilation import MANIFEST, PROCESSES_VARIABLE, import_all_kernels
from navstack.core.jit import kernel
from navstack.core.kernel_cache import describe, parse

ADD = "@kernel\ndef add(x):\n    return x + 1\n"
OUTER = "@kernel\ndef outer(x):\n    return add(x)\n"


def run(folder: Path, code: str, **environment: str) -> str:
    """Run code in a process whose modules and cache are in a folder; return what it prints."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("NAVSTACK_", "NUMBA_", "XDG_"))}
    env |= {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": os.pathsep.join((str(folder), *sys.path))}
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=env | environment, timeout=600, check=False
    )
    assert out.returncode == 0, out.stderr
    return out.stdout.strip()


class Machine:
    """Runs modules of kernels as new processes would: nothing is known but the cache folder."""

    def __init__(self) -> None:
        self.compiled: list[str] = []

    def start(self, *sources: str) -> dict[str, Any]:
        """Execute the modules in one namespace: kernels import each other."""
        names: dict[str, Any] = {"kernel": kernel, "__name__": "kernels"}
        for source in sources:
            names = names | {"__name__": f"kernels_{len(names)}"}
            exec(compile(source, f"module_{len(names)}.py", "exec"), names)
        return names

    def outer(self, *sources: str) -> tuple[Any, list[str]]:
        """Call `outer(1)`; return its value and the kernels that were compiled."""
        self.compiled.clear()
        return self.start(*sources)["outer"](1), self.compiled.copy()


class Listener(event.Listener):
    """Notes what is compiled, not loaded."""

    def __init__(self, names: list[str]) -> None:
        self.names = names

    def on_start(self, event: Any) -> None:
        if isinstance(event.data["dispatcher"], kernel_cache.KernelDispatcher):
            self.names.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        pass


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder in use."""
    folder = tmp_path / "navstack" / "kernels-present"
    folder.mkdir(parents=True)
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda: folder)
    return folder


@pytest.fixture
def machine(folder: Path) -> Generator[Machine]:
    machine = Machine()
    with event.install_listener("numba:compile", Listener(machine.compiled)):
        yield machine


def entries(folder: Path) -> list[Path]:
    return [file for file in folder.iterdir() if file.name != "lock"]


def test_numba_is_imported_at_the_first_call(tmp_path: Path) -> None:
    code = "import sys, navstack.core.jit, navstack.core.compilation\nprint('numba' in sys.modules)"
    assert run(tmp_path, code) == "False"


@pytest.mark.slow
def test_only_a_change_of_content_compiles(machine: Machine, folder: Path) -> None:
    assert machine.outer(ADD, OUTER) == (2, ["outer", "add"])
    assert len(entries(folder)) == 2
    # comments, docstrings, lines and the module do not count
    commented = '# moved down\n\n@kernel\ndef add(x):\n    """Add one."""\n    # to x\n    return x + 1\n'
    assert machine.outer(ADD, OUTER) == (2, [])
    assert machine.outer(commented, OUTER) == (2, [])
    assert machine.outer(ADD + OUTER) == (2, [])
    # constants and called kernels do
    assert machine.outer(ADD.replace("1", "10"), OUTER) == (11, ["outer", "add"])
    named = ADD.replace("1", "ONE")
    assert machine.outer("ONE = 1\n" + named, OUTER) == (2, ["outer", "add"])
    assert machine.outer("ONE = 3\n" + named, OUTER) == (4, ["outer", "add"])
    assert machine.outer("import numpy as np\nONE = np.array([3])[0]\n" + named, OUTER)[0] == 4
    assert machine.outer(ADD, OUTER) == (2, [])


@pytest.mark.slow
def test_options_are_content(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    beyond = "@kernel\ndef outer(x):\n    return (np.arange(4))[x + {}]\n"
    assert machine.outer("import numpy as np\n" + beyond.format(2)) == (3, ["outer"])
    monkeypatch.setenv("NAVSTACK_BOUNDSCHECK", "1")
    assert machine.outer("import numpy as np\n" + beyond.format(2)) == (3, ["outer"])
    with pytest.raises(IndexError):
        machine.outer("import numpy as np\n" + beyond.format(10**6))


@pytest.mark.slow
@pytest.mark.parametrize("content", [b"", b"\0" * 100, None], ids=["empty", "zeros", "truncated"])
def test_damaged_files_are_compiled_again(machine: Machine, folder: Path, content: bytes | None) -> None:
    machine.outer(ADD, OUTER)
    for file in entries(folder):
        file.write_bytes(file.read_bytes()[:-10] if content is None else content)
    assert machine.outer(ADD, OUTER) == (2, ["outer", "add"])
    assert machine.outer(ADD, OUTER) == (2, [])


def test_equal_kernels_of_two_modules_share_an_entry(machine: Machine) -> None:
    one, two = machine.start(ADD, OUTER), machine.start(ADD, OUTER)
    assert (one["outer"](1), two["outer"](1), two["add"](1)) == (2, 2, 2)
    assert machine.compiled == ["outer", "add", "add"]  # the second one for Python


def test_kernels_work_without_a_cache(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda: None)
    assert machine.outer(ADD, OUTER) == (2, ["outer", "add"])
    assert machine.outer(ADD, OUTER) == (2, ["outer", "add"])


def test_kernels_work_if_the_folder_cannot_be_written(machine: Machine, folder: Path) -> None:
    shutil.rmtree(folder)
    assert machine.outer(ADD, OUTER) == (2, ["outer", "add"])


@pytest.mark.slow
def test_the_folder_is_that_of_the_user(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder should be")
    code = "from navstack.core.kernel_cache import cache_folder; print(cache_folder())"
    assert run(tmp_path, code).startswith(str(tmp_path / "cache" / "navstack" / "kernels-"))
    assert run(tmp_path, code, XDG_CACHE_HOME=str(blocked)) == "None"


def test_a_process_waits_for_another_that_compiles_the_same(machine: Machine, folder: Path) -> None:
    file = folder / ("1" * 32)
    hold = (
        "import fcntl, os, sys; f = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT); fcntl.lockf(f, fcntl.LOCK_EX, 1, 7)"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", hold + "; print(); sys.stdin.read(); open(sys.argv[2], 'w')", folder / "lock", file],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert holder.stdin is not None and holder.stdout is not None
    holder.stdout.readline()
    with holder.stdin, holder.stdout:
        threading.Timer(0.2, holder.stdin.close).start()
        assert kernel_cache._lock(file, 7) is False  # it was compiled meanwhile
        holder.wait()
    assert kernel_cache._lock(folder / "another", 8) is True


def test_old_entries_and_folders_are_removed(machine: Machine, folder: Path) -> None:
    kernel_cache._remove_outdated.cache_clear()
    old, recent = folder.parent / "kernels-old", folder.parent / "kernels-recent"
    old.mkdir()
    recent.mkdir()
    stale = folder / ("0" * 32)
    stale.write_bytes(b"")
    for path in (old, stale):
        os.utime(path, (0, 0))
    machine.outer(ADD, OUTER)
    assert not old.exists() and not stale.exists()
    assert recent.exists() and len(entries(folder)) == 2


@pytest.mark.slow
def test_constant_arguments_need_no_specialization(machine: Machine) -> None:
    calls = "@kernel\ndef outer(x):\n    return add(x) + add(1) + add(2)\n"
    assert machine.outer(ADD, calls) == (7, ["outer", "add"])
    pick = "@kernel\ndef pick(pair, i):\n    return pair[i]\n"  # which needs the constant: the items have two types
    assert machine.outer(pick, "@kernel\ndef outer(x):\n    return pick((x, 2.5), 1)\n")[0] == 2.5


def test_types_survive_the_manifest() -> None:
    from numba import typeof, types

    record = np.zeros(3, np.dtype([("x", "f8"), ("id", "i4"), ("corner", "f4", (2,))], align=True))
    frozen = np.zeros((2, 2))
    frozen.flags.writeable = False
    values = (1, 2.5, True, None, (1, 2), (1, 2.5), record, record[0], frozen, np.zeros((4, 4), np.uint8)[:, 1:])
    signature = (*map(typeof, values), types.Omitted(1.5), types.float32)
    assert parse(describe(signature)) == signature


AHEAD = """
import os, sys, caller
from pathlib import Path
from navstack.core import compilation, jit

reports = []
compilation.MANIFEST = Path(caller.__file__).with_name("kernels.json")
seen = []
def progress(done, total):
    seen.append((done, total))
    if "STOP" in os.environ:
        raise KeyboardInterrupt
try:
    print(compilation.compile_ahead(["use"], progress))
except KeyboardInterrupt:
    print("interrupted")
with jit.compilation_reported(lambda: reports.append("compiled")):
    print(seen[:1], caller.above_2(1), *reports)
"""


@pytest.fixture
def listed(tmp_path: Path) -> Path:
    """A folder with four kernels and the list of their specializations."""
    text = "".join(f"@kernel\ndef above_{i}(x):\n    return add(x) + {i}\n" for i in range(3))
    (tmp_path / "caller.py").write_text("from navstack.core.jit import kernel\n" + ADD + text)
    kernels = {f"above_{i}(x)": [["int64", 0, [0]]] for i in range(3)}
    kernels |= {"add(x)": [["int64", 1, [0]], ["float64", 0, [1]]], "gone(y)": [["int64", 0, [0]]]}
    (tmp_path / "kernels.json").write_text(json.dumps({"uses": ["use", "other"], "kernels": kernels}))
    return tmp_path


@pytest.mark.slow
def test_kernels_are_compiled_ahead_in_processes(listed: Path) -> None:
    assert run(listed, AHEAD, STOP="1", **{PROCESSES_VARIABLE: "2"}).splitlines()[0] == "interrupted"
    files = entries(next(listed.glob("cache/navstack/kernels-*")))
    assert not [file for file in files if file.suffix] and len(files) < 4
    for file in files:
        file.unlink()
    assert run(listed, AHEAD, **{PROCESSES_VARIABLE: "2"}).splitlines() == ["4", "[(0, 4)] 4"]
    assert run(listed, AHEAD, **{PROCESSES_VARIABLE: "2"}).splitlines() == ["0", "[] 4"]


@pytest.mark.slow
def test_on_a_single_core_kernels_are_compiled_ahead_only_if_required(listed: Path) -> None:
    required = AHEAD.replace('["use"], progress', '["use"], progress, required=True')
    assert run(listed, AHEAD, **{PROCESSES_VARIABLE: "0"}).splitlines() == ["0", "[] 4 compiled"]
    # that first call compiled two of the four
    assert run(listed, required, **{PROCESSES_VARIABLE: "0"}).splitlines()[0] == "2"
    assert run(listed, required, **{PROCESSES_VARIABLE: "0"}).splitlines()[0] == "0"


@pytest.mark.slow
def test_without_processes_kernels_are_compiled_at_their_first_call(listed: Path) -> None:
    broken = AHEAD.replace("reports = []", "reports = []; sys.executable = '/no/python'")
    assert run(listed, broken, **{PROCESSES_VARIABLE: "2"}).splitlines() == ["4", "[] 4 compiled"]


def test_the_manifest_names_kernels_and_uses() -> None:
    import_all_kernels()  # and the named tuples among the types
    document = json.loads(MANIFEST.read_text())
    for rows in document["kernels"].values():
        for types, inner, uses in rows:
            assert len(parse(types)) <= 64 and inner in (0, 1) and uses


@kernel
def _measured_callee(x: float) -> float:
    return x * 1.25 + 0.5


@kernel
def _measured_caller(x: float) -> float:
    return _measured_callee(x) + _measured_callee(x + 1.0)


def test_measured_times_leave_out_the_compilation_of_nested_kernels() -> None:
    begin, working, compiled = time.perf_counter(), compile_clock.working_time(), compile_clock.compile_seconds()
    assert _measured_caller(1.0) == 4.75
    elapsed = time.perf_counter() - begin
    compiled = compile_clock.compile_seconds() - compiled
    # each second of the compilation counts once, although the inner kernel is compiled within the outer one
    assert 0.5 * elapsed < compiled <= elapsed
    assert compile_clock.working_time() - working <= elapsed - compiled + 1e-3
    again = compile_clock.compile_seconds()
    _measured_caller(2.0)
    assert compile_clock.compile_seconds() == again
