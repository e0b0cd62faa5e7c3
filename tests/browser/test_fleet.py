"""A fleet on the page: the other robots are drawn, and a click on one shows it."""

from __future__ import annotations

from typing import Any

from navstack.fleet import make_fleet
from navstack.live import FleetSession, Options, Stage
from tests.browser.conftest import at
from tests.fleet.stage import WEST, scenario

IDLE = scenario((1.0, 1.0, 0.0))


def test_a_click_on_another_robot_shows_it(live: Any, open_page: Any) -> None:
    session = FleetSession(make_fleet({"idle": IDLE, "west": WEST}, seed=2))
    session.pause(True)
    page = open_page(live(stage=Stage([session], Options())))
    page.wait_for_function("() => window.navstack.store.main.robots.length === 1")
    name, x, y = page.evaluate("window.navstack.store.main.robots[0].slice(0, 3)")
    assert name == "west"
    beside = page.evaluate(f"window.navstack.camera.toScreen({x + 0.05}, {y + 0.05})")
    pixels = page.evaluate(
        """([u, v]) => {
            const context = document.querySelector('#scene').getContext('2d'), ratio = devicePixelRatio;
            return [...context.getImageData(u * ratio, v * ratio, 1, 1).data.slice(0, 3)];
        }""",
        beside,
    )
    assert pixels == [0x8F, 0x5B, 0xD6]  # the color of the other robots, away from the line of the heading
    page.mouse.click(*at(page, x, y))
    page.wait_for_function("() => window.navstack?.store.main?.robots[0]?.[0] === 'idle'")
    assert page.locator("#robots").input_value() == "west" and session.selected == "west"
