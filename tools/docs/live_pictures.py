#!/usr/bin/env python
"""Draw the pictures of the live page for the documentation: ten moments, one of them for the README, and a short animation.

    python tools/docs/live_pictures.py [--out build/live] [--docs]

`--docs` writes docs/images/live.png, live_versus.png and live.gif as well. Needs Chromium and Playwright.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
FRAMES = 44


def started(*arguments: str) -> tuple[subprocess.Popen[str], str]:
    """Starts `navstack live`; returns the process and its address."""
    command = [sys.executable, "-m", "navstack", "live", *arguments, "--no-open", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, process.stdout.readline().split()[-1]


class Moments:
    """Takes the pictures."""

    def __init__(self, browser: Any, out: Path) -> None:
        self._browser, self._out = browser, out
        out.mkdir(parents=True, exist_ok=True)

    def page(self, address: str, *, size: tuple[int, int] = (1280, 800), **context: Any) -> Any:
        """Opens a page."""
        made = self._browser.new_context(viewport={"width": size[0], "height": size[1]}, **context)
        page = made.new_page()
        page.goto(address)
        page.wait_for_function("() => window.navstack?.store.main?.pose && window.navstack.scene.frames > 0")
        return page

    def take(self, page: Any, name: str, until: str = "true") -> Path:
        """Waits until a condition on `side` and saves the picture."""
        page.wait_for_function(f"() => {{ const side = window.navstack.store.main; return {until}; }}", timeout=120_000)
        page.wait_for_timeout(300)
        path = self._out / f"{name}.png"
        page.screenshot(path=path)
        return path


def seek(page: Any, time: float) -> None:
    """Goes to a time and pauses."""
    page.evaluate("() => window.navstack.act({ type: 'pause', paused: true })")
    page.evaluate(f"() => window.navstack.timeline.seek({time})")
    page.wait_for_function(
        f"() => {{ const s = window.navstack.store.main; return !s.seeking && Math.abs(s.t - {time}) < 0.5; }}"
    )


def act(page: Any, **message: Any) -> None:
    """Sends a request."""
    page.evaluate("(message) => window.navstack.act(message)", message)


def ten_moments(moments: Moments, address: str) -> None:
    """Takes the pictures of one session."""
    page = moments.page(address)
    act(page, type="speed", factor=20.0)
    moments.take(page, "01_driving", "side.t > 14")
    seek(page, 12.0)
    act(page, type="put", shape={"name": "box", "box": [0.5, 0.45], "pose": [7.3, 10.2, 0.4]})
    for _ in range(17):
        act(page, type="step")
    page.evaluate("() => window.navstack.layers.toggle('trajectories', true)")
    page.evaluate("() => { const n = window.navstack; n.camera.x = 6.6; n.camera.y = 9.2; n.camera.scale = 92; }")
    moments.take(page, "00_readme", "side.trajectories")
    page.evaluate("() => window.navstack.fit()")
    act(page, type="remove", name="box")
    act(page, type="put", shape={"name": "box", "box": [0.5, 0.45], "pose": [11.6, 8.0, 0.2]})
    person = {"kind": "pedestrian", "goals": [[17.0, 7.2], [9.0, 7.4]]}
    act(page, type="put", shape={"name": "bob", "radius": 0.25, "pose": [12.5, 7.2], "motion": person})
    for layer in ("global", "trajectories", "former"):
        page.evaluate(f"() => window.navstack.layers.toggle('{layer}', true)")
    moments.take(page, "02_layers", "side.trajectories")
    page.evaluate(
        "() => { const n = window.navstack; [n.camera.x, n.camera.y] = n.store.main.pose; n.camera.scale = 170; }"
    )
    page.evaluate("() => window.navstack.layers.toggle('global', false)")
    moments.take(page, "03_trajectories")
    page.evaluate("() => window.navstack.fit()")
    page.evaluate("() => window.navstack.why.command(null)")
    moments.take(page, "04_why", "!document.getElementById('answer')?.textContent.startsWith('simulating')")
    page.click("#show-parameters")
    page.fill("#parameter-search", "max_vel")
    page.evaluate("() => window.navstack.parameters.set({ values: { 'DWAPlannerROS/max_vel_x': 0.35 } })")
    moments.take(page, "05_parameters")
    for layer, on in (("potential", "true"), ("trajectories", "false")):
        page.evaluate(f"() => window.navstack.layers.toggle('{layer}', {on})")
    page.evaluate("() => window.navstack.act({ type: 'step' })")
    page.click("#show-layers")
    moments.take(page, "06_potential")
    page.evaluate("() => window.navstack.layers.toggle('potential', false)")
    act(page, type="queue", goals=[[6.0, 7.4, 0.0], [2.0, 7.4, 3.1], [20.0, 7.4, 0.0]], loop=True)
    page.click("#show-goals")
    moments.take(page, "07_queue", "side.goals.waiting.length === 3")


def editor(moments: Moments, address: str) -> None:
    """Takes the picture of the editor of the route graph: a selected edge, and what the check found."""
    page = moments.page(address)
    act(page, type="pause", paused=True)
    page.click("#tool-graph")
    page.wait_for_function("() => window.navstack.graph.data?.nodes.length === 8")
    page.click("#graph-check")
    page.wait_for_timeout(1500)
    page.click("#graph-select")
    x, y = page.evaluate(
        "() => { const n = window.navstack, r = document.getElementById('scene').getBoundingClientRect();"
        " const [x, y] = n.camera.toScreen(3.2, 7.4); return [x + r.left, y + r.top]; }"
    )
    page.mouse.click(x, y)
    moments.take(page, "11_graph")


def lanes(folder: Path) -> Path:
    """Writes the graph of the tutorial on routes; returns the file."""
    text = (ROOT / "docs" / "tutorials" / "routes.md").read_text(encoding="utf-8")
    code = next(part for part in text.split("```python\n")[1:] if "build_graph" in part).split("```")[0]
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return folder / "lanes.geojson"


def animation(page: Any, target: Path) -> None:
    """Writes a short animation: a box is put in the way, and the plan goes around it."""
    pictures: list[Image.Image] = []
    page.click("#sheet-button")
    page.evaluate("() => { const n = window.navstack; n.camera.x = 5.2; n.camera.y = 8.6; n.camera.scale = 105; }")
    for k in range(FRAMES):
        if k == 9:
            act(page, type="put", shape={"name": "box", "box": [0.4, 0.4], "pose": [4.45, 7.25, 0.0]})
        act(page, type="step")
        act(page, type="step")
        page.wait_for_timeout(150)
        shot = Image.open(io.BytesIO(page.locator("#scene").screenshot())).convert("RGB")
        pictures.append(shot.resize((640, round(640 * shot.height / shot.width))).quantize(96))
    pictures[0].save(target, save_all=True, append_images=pictures[1:], duration=140, loop=0, optimize=True)


def with_server(arguments: list[str], use: Callable[[str], None]) -> None:
    """Calls `use` with the address of a server."""
    process, address = started(*arguments)
    try:
        use(address)
    finally:
        process.terminate()
        process.wait(10.0)


def main() -> int:
    """Runs the command."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "live")
    parser.add_argument("--docs", action="store_true")
    arguments = parser.parse_args()
    chromium = os.environ.get("NAVSTACK_CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-dev-shm-usage"])
        moments = Moments(browser, arguments.out)
        with_server(["office"], lambda address: ten_moments(moments, address))

        def phone_and_dark(address: str) -> None:
            page = moments.page(address, size=(390, 844), has_touch=True)
            act(page, type="speed", factor=20.0)
            moments.take(page, "08_phone", "side.t > 12")
            page = moments.page(address, color_scheme="dark")
            moments.take(page, "09_dark", "side.t > 20")

        with_server(["office"], phone_and_dark)
        graph = ["office", "--graph", str(lanes(arguments.out))]
        with_server(graph, lambda address: editor(moments, address))
        slow = arguments.out / "slow.yaml"
        slow.write_text("DWAPlannerROS: {max_vel_x: 0.35, max_vel_trans: 0.35}\n", encoding="utf-8")
        versus = ["office", "--versus", "turtlebot", "--versus", str(slow), "--speed", "20"]
        with_server(versus, lambda address: moments.take(moments.page(address), "10_versus", "side.t > 20") and None)
        if arguments.docs:
            images = ROOT / "docs" / "images"
            for moment, name in (("00_readme", "live"), ("10_versus", "live_versus"), ("11_graph", "route_editor")):
                picture = Image.open(arguments.out / f"{moment}.png").convert("RGB")
                picture.quantize(200).save(images / f"{name}.png", optimize=True)

            def film(address: str) -> None:
                page = moments.page(address)
                act(page, type="restart")
                act(page, type="pause", paused=True)
                animation(page, images / "live.gif")

            with_server(["office"], film)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
