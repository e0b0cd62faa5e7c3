#!/usr/bin/env python
"""Measure `navstack live` with a real Chromium: latency, frames, load, traffic, memory.

    python tools/bench/live.py [--map MAP.yaml --start x,y --goal x,y] [--hours 10] [--pages 8]

Prints one line per figure with the target; exits with 1 if one is not met. The server runs in a process of its own. On a machine
that does other things, the figures are worse: the load average is printed.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from navstack.map_io import map_names

CLICKS = 40


class Server:
    """`navstack live` in a process of its own."""

    def __init__(self, arguments: argparse.Namespace, *more: str) -> None:
        where = [arguments.map, "--start", arguments.start, *(f"--goal={goal}" for goal in arguments.goal)]
        if arguments.map in map_names():
            where = [arguments.map]
        command = [sys.executable, "-m", "navstack", "live", *where, "--no-open", "--port", "0", *more]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        found = re.search(r"http://\S+", line)
        if found is None:
            raise SystemExit(f"the server did not start: {line}")
        self.address = found[0]

    def cpu_s(self) -> float:
        """Processor time so far (s)."""
        with open(f"/proc/{self.process.pid}/stat", encoding="ascii") as file:  # noqa: PTH123
            fields = file.read().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def memory_mb(self) -> float:
        """Resident memory (MB)."""
        with open(f"/proc/{self.process.pid}/statm", encoding="ascii") as file:  # noqa: PTH123
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    def stop(self) -> None:
        """Ends the server."""
        self.process.terminate()
        self.process.wait(10.0)


def opened(browser: Any, server: Server, layers: tuple[str, ...] = ()) -> Any:
    """Opens a page and waits for the first frame."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(180_000)  # eight pages on a busy machine
    page.goto(server.address)
    page.wait_for_function("() => window.navstack?.store.main?.pose && window.navstack.scene.frames > 0")
    for layer in layers:
        page.evaluate(f"() => window.navstack.layers.toggle('{layer}', true)")
    return page


def latency_ms(page: Any) -> float:
    """p95 of the time from a click to the first drawn frame that shows the goal (ms)."""
    times: list[float] = page.evaluate(
        """async (count) => {
          const app = window.navstack, canvas = document.getElementById('scene'), times = [];
          app.tools.choose('goal');
          for (let k = 0; k < count; k++) {
            const [x, y] = app.store.main.pose;
            const [u, v] = app.camera.toScreen(x + 0.02 * (k % 5 + 1), y + 0.02 * (k % 3));
            const box = canvas.getBoundingClientRect(), where = { clientX: box.left + u, clientY: box.top + v };
            const init = { ...where, pointerId: 1, button: 0, bubbles: true };
            const before = JSON.stringify(app.store.main.goals.under_way), started = performance.now();
            canvas.setPointerCapture = () => {};
            canvas.dispatchEvent(new PointerEvent('pointerdown', init));
            canvas.dispatchEvent(new PointerEvent('pointerup', init));
            while (JSON.stringify(app.store.main.goals.under_way) === before) await new Promise(requestAnimationFrame);
            const frames = app.scene.frames;
            while (app.scene.frames === frames) await new Promise(requestAnimationFrame);
            times.push(performance.now() - started);
            await new Promise((done) => setTimeout(done, 60 + 37 * (k % 4)));
          }
          return times;
        }""",
        CLICKS,
    )
    return float(np.percentile(times, 95))


def over(page: Any, server: Server, seconds: float) -> dict[str, float]:
    """Frames per second, processor load and traffic while the robot drives."""
    probe = "() => [window.navstack.scene.frames, window.navstack.connection.received, window.navstack.store.main.t]"
    cpu, start, before = server.cpu_s(), time.monotonic(), page.evaluate(probe)
    page.wait_for_timeout(seconds * 1000)
    after, elapsed = page.evaluate(probe), time.monotonic() - start
    return {
        "fps": (after[0] - before[0]) / elapsed,
        "kB/s": (after[1] - before[1]) / elapsed / 1000.0,
        "load": (server.cpu_s() - cpu) / elapsed,
        "factor": (after[2] - before[2]) / elapsed,
    }


def drive_on(page: Any) -> None:
    """Lets the robot drive through some places again and again, as fast as it goes."""
    page.evaluate(
        """() => { const app = window.navstack, pose = app.store.main.pose, places = Object.values(app.store.world.places);
        const goals = places.length >= 2 ? places.slice(0, 6) : [pose, [pose[0] + 0.8, pose[1], 3.1]];
        app.act({ type: 'queue', loop: true, goals });
        app.act({ type: 'speed', factor: null }); }"""
    )


def memory_growth_mb(server: Server, page: Any, hours: float) -> tuple[float, float]:
    """Growth of the server's memory over `hours` simulated hours of driving (MB), and its growth over the second half of them.

    Prints the memory of each tenth. The checkpoints for going back fill up in the first half; their number is bounded.
    """
    drive_on(page)
    sizes: list[float] = []
    while len(sizes) < 10:
        now = float(page.evaluate("() => window.navstack.store.main.t"))
        if now > 360.0 * hours * (len(sizes) + 1):
            sizes.append(server.memory_mb())
            print(f"  after {0.1 * hours * len(sizes):5.2f} simulated hours: {sizes[-1]:.1f} MB", flush=True)
        page.wait_for_timeout(200)
    return sizes[-1] - sizes[0], sizes[-1] - sizes[4]


def main() -> int:
    """Runs the command."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--map", default="warehouse")
    parser.add_argument("--start", default="")
    parser.add_argument("--goal", action="append", default=[])
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--pages", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10.0)
    arguments = parser.parse_args()
    chromium = os.environ.get("NAVSTACK_CHROMIUM") or shutil.which("chromium")
    failed: list[str] = []

    def report(name: str, value: float, unit: str, target: str, met: Callable[[float], bool]) -> None:
        good = met(value)
        if not good:
            failed.append(name)
        print(f"{name:<58} {value:9.1f} {unit:<5} {target:<12} {'met' if good else 'NOT MET'}", flush=True)

    print(f"map {arguments.map}; load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-dev-shm-usage"])
        server = Server(arguments)
        page = opened(browser, server)
        page.wait_for_timeout(2000)
        at_1 = over(page, server, arguments.seconds)
        report("frames drawn while it drives", at_1["fps"], "1/s", ">= 30", lambda v: v >= 30.0)
        report("load of the server at 1x, one page", 100.0 * at_1["load"], "%", "< 15", lambda v: v < 15.0)
        report("traffic at 1x", at_1["kB/s"], "kB/s", "< 150", lambda v: v < 150.0)
        report("click to first frame that shows it, p95", latency_ms(page), "ms", "< 100", lambda v: v < 100.0)
        server.stop()
        page.close()

        server = Server(arguments)
        page = opened(browser, server)
        drive_on(page)
        page.wait_for_timeout(1000)
        fast = over(page, server, arguments.seconds)
        report("speed with a page open, times real time", fast["factor"], "x", ">= 100", lambda v: v >= 100.0)
        share = fast["factor"] / max(fast["load"], 1e-9)
        report("the same per second of processor time", share, "x", ">= 100", lambda v: v >= 100.0)
        page.evaluate("() => window.navstack.act({ type: 'restart' })")
        page.evaluate("() => window.navstack.act({ type: 'speed', factor: 1 })")
        pages = [page, *(opened(browser, server) for _ in range(arguments.pages - 1))]
        many = over(page, server, arguments.seconds)
        report(f"load of the server at 1x, {len(pages)} pages", 100.0 * many["load"], "%", "< 100", lambda v: v < 100.0)
        report(f"speed kept with {len(pages)} pages", many["factor"], "x", ">= 0.95", lambda v: v >= 0.95)
        for other in pages[1:]:
            other.close()
        growth, late = memory_growth_mb(server, page, arguments.hours)
        name = f"growth of memory, hour {0.1 * arguments.hours:g} to {arguments.hours:g}"
        report(name, growth, "MB", "< 64", lambda v: v < 64.0)
        name = f"growth of memory, hour {0.5 * arguments.hours:g} to {arguments.hours:g}"
        report(name, late, "MB", "< 5", lambda v: v < 5.0)
        server.stop()
        browser.close()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
