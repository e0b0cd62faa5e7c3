"""The kernel wrapper: lazy compilation, with and without a cache."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CODE = """
import sys
import navstack.core.jit as jit
assert "numba" not in sys.modules, "numba was imported before the first kernel ran"

@jit.kernel
def inner(x):
    return x + 1

@jit.kernel
def outer(a):
    total = 0
    for i in range(a.size):
        total += inner(a[i])
    return total

@jit.kernel
def beyond(a, i):
    return a[i]

import numpy as np
print(outer(np.arange(4)))
try:
    beyond(np.arange(4), 10**6 if jit.boundscheck_enabled() else 3)
    print("read")
except IndexError:
    print("caught")
print(jit._cache_folder(jit._files_behind(outer.function)))
"""


def run(tmp_path: Path, **environment: str) -> list[str]:
    script = tmp_path / "use_kernels.py"
    script.write_text(CODE)
    env = {k: v for k, v in os.environ.items() if not k.startswith(("NAVSTACK_BOUNDS", "NUMBA_", "XDG_"))}
    out = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, env=env | environment, timeout=120
    )
    assert out.returncode == 0, out.stderr
    return out.stdout.split()


def test_cache_is_in_the_users_folder(tmp_path: Path) -> None:
    total, verdict, folder = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert (total, verdict) == ("10", "read")
    assert folder.startswith(str(tmp_path / "cache"))
    assert list(Path(folder).rglob("*.nbi"))


def test_kernels_work_without_a_cache(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder should be")
    total, verdict, folder = run(tmp_path, XDG_CACHE_HOME=str(blocked), HOME=str(blocked))
    assert (total, verdict, folder) == ("10", "read", "None")


def test_boundscheck_has_a_separate_cache(tmp_path: Path) -> None:
    plain = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    checked = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"), NAVSTACK_BOUNDSCHECK="1")
    assert checked[:2] == ["10", "caught"]
    assert checked[2] != plain[2]


def test_old_caches_are_removed(tmp_path: Path) -> None:
    old, recent = (tmp_path / "cache" / "navstack" / f"kernels-{name}" for name in ("old", "recent"))
    old.mkdir(parents=True)
    recent.mkdir()
    os.utime(old, (0, 0))
    run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert not old.exists()
    assert recent.exists()


def test_changed_callee_in_another_file_recompiles_the_caller(tmp_path: Path) -> None:
    called, caller, unrelated = (tmp_path / f"{name}_kernels.py" for name in ("called", "caller", "unrelated"))
    head = "from navstack.core.jit import kernel\n"
    called.write_text(head + "@kernel\ndef add(x):\n    return x + 1\n")
    caller.write_text(head + "from called_kernels import add\n@kernel\ndef outer(x):\n    return add(x)\n")
    unrelated.write_text(head + "@kernel\ndef other(x):\n    return x\n")
    code = (
        "import navstack.core.jit as jit, caller_kernels as c, unrelated_kernels as u\n"
        "values, compiled = [], []\n"
        "for kernel in (c.outer, u.other):\n"
        "    reports = []\n"
        "    with jit.compilation_reported(lambda: reports.append(1)):\n"
        "        values.append(kernel(1))\n"
        "    compiled.append(len(reports))\n"
        "print(*values, *compiled)"
    )

    def use() -> str:
        env = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
        env.pop("NUMBA_CACHE_DIR", None)
        out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, timeout=120)
        assert out.returncode == 0, out.stderr
        return out.stdout.strip()

    assert use() == "2 1 1 1"
    assert use() == "2 1 0 0"
    called.write_text(head + "@kernel\ndef add(x):\n    return x + 10\n")
    assert use() == "11 1 1 0"
