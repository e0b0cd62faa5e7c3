"""The kernel wrapper: lazy, cached where it can, working where it cannot."""

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
print(jit._cache_folder())
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


def test_kernels_cache_in_the_users_folder(tmp_path: Path) -> None:
    total, verdict, folder = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert (total, verdict) == ("10", "read")
    assert folder.startswith(str(tmp_path / "cache"))
    assert list(Path(folder).rglob("*.nbi"))


def test_kernels_work_where_nothing_can_be_cached(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder should be")
    total, verdict, folder = run(tmp_path, XDG_CACHE_HOME=str(blocked), HOME=str(blocked))
    assert (total, verdict, folder) == ("10", "read", "None")


def test_boundscheck_is_a_compilation_of_its_own(tmp_path: Path) -> None:
    plain = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    checked = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"), NAVSTACK_BOUNDSCHECK="1")
    assert checked[:2] == ["10", "caught"]
    assert checked[2] != plain[2]


def test_caches_of_former_kernels_are_removed_in_time(tmp_path: Path) -> None:
    old, recent = (tmp_path / "cache" / "navstack" / f"kernels-{name}" for name in ("old", "recent"))
    old.mkdir(parents=True)
    recent.mkdir()
    os.utime(old, (0, 0))
    run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert not old.exists()
    assert recent.exists()
