"""Print the seconds that each kernel compiles, cold: `python tools/bench/compile.py [--top N] simulate --out /tmp/run`.

The command runs in this process with an empty cache. The time of a kernel excludes that of the kernels that it calls.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
import time
from typing import Any

from numba.core import event


class Stopwatch(event.Listener):
    """Measures the CPU seconds of each compilation, without those of the compilations inside it."""

    def __init__(self) -> None:
        self.seconds: list[tuple[float, str, str]] = []
        self._running: list[list[float]] = []

    def on_start(self, event: Any) -> None:
        self._running.append([time.process_time(), 0.0])

    def on_end(self, event: Any) -> None:
        start, inside = self._running.pop()
        whole = time.process_time() - start
        name = event.data["dispatcher"].py_func.__name__
        self.seconds.append((whole - inside, name, ", ".join(map(str, event.data["args"]))))
        if self._running:
            self._running[-1][1] += whole


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--top", type=int, default=20, help="kernels to list")
    parser.add_argument("--types", action="store_true", help="list each specialization with its types")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="arguments of navstack")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"XDG_CACHE_HOME": folder, "NAVSTACK_COMPILE_PROCESSES": "0"}
        os.environ.pop("NUMBA_CACHE_DIR", None)
        stopwatch = Stopwatch()
        event.register("numba:compile", stopwatch)
        from navstack.cli import main as navstack

        sys.argv = ["navstack", *chosen.command]
        start, cpu = time.perf_counter(), time.process_time()
        with contextlib.suppress(SystemExit):
            navstack()
        wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    totals: dict[str, list[float]] = {}
    for seconds, name, types in stopwatch.seconds:
        totals.setdefault(f"{name}({types})" if chosen.types else name, []).append(seconds)
    for name, each in sorted(totals.items(), key=lambda item: -sum(item[1]))[: chosen.top]:
        print(f"{sum(each):7.2f} s  {len(each):2d}  {name}")
    compiled = sum(seconds for seconds, _, _ in stopwatch.seconds)
    print(
        f"{compiled:7.2f} s of {len(stopwatch.seconds)} specializations of {len({s[1] for s in stopwatch.seconds})} kernels"
    )
    print(f"{cpu:7.2f} s of CPU, {wall:.2f} s of wall time for the command")
    return 0


if __name__ == "__main__":
    sys.exit(main())
