"""What the robot sees, in a corner of the map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.browser.conftest import Live, at, drag, wait_until

Start = Callable[..., Live]
Open = Callable[..., Any]

PIXELS = """() => { const c = document.querySelector('#view canvas');
    return [c.width, c.height, Array.from(c.getContext('2d').getImageData(0, 0, c.width, c.height).data)]; }"""


def shown(page: Any) -> tuple[int, int, list[int]]:
    """Width, height and RGBA values of the picture on the page."""
    width, height, values = page.evaluate(PIXELS)
    return width, height, values


def test_the_page_shows_what_the_robot_sees_while_the_view_is_open(live: Start, open_page: Open) -> None:
    server = live(paused=True, ahead=1.0)
    page = open_page(server)
    assert page.locator("#view").is_hidden() and not page.evaluate("window.navstack.layers.wanted().includes('camera')")
    page.click("#eye")
    page.locator("#view").wait_for()
    expected = server.call(lambda: server.session.run.robot.camera(width=320).rgb)
    width, height, values = shown(page)
    assert (width, height) == (320, 240)
    assert [values[k] for k in range(len(values)) if k % 4 != 3] == expected.ravel().tolist()

    page.click("#tool-box")
    drag(page, (3.0, 7.2), (3.4, 7.6))  # it is seen while the time stands
    wait_until(page, "side.shapes.length === 1")
    middle = 3 * (120 * 320 + 160)
    before = ",".join(map(str, expected.ravel().tolist()[middle : middle + 3]))
    wait_until(page, f"side.camera.rgb.slice({middle}, {middle + 3}).join() !== '{before}'")
    page.keyboard.press("i")
    page.locator("#view").wait_for(state="hidden")
    assert not page.evaluate("window.navstack.layers.wanted().includes('camera')")


def test_on_a_phone_the_view_leaves_room_for_the_map(live: Start, open_page: Open) -> None:
    server = live("map: office\nstart: [0.8, 7.45, 0.0]\ngoals: []\ninteractions: []\n", speed=1.0)
    page = open_page(server, size=(390, 844), has_touch=True, is_mobile=True)
    page.tap("#eye")
    page.locator("#view").wait_for()
    page.tap("#tool-drive")
    view, stage, drive = (page.locator(name).bounding_box() for name in ("#view", "#stage", "#drive"))
    assert 140 <= view["width"] <= 0.5 * stage["width"] and abs(view["height"] - 0.75 * view["width"]) < 2
    assert view["y"] + view["height"] < drive["y"] and page.locator("#view").evaluate(
        "(e) => e.scrollWidth <= e.clientWidth"
    )
    page.tap("#view")
    large = page.locator("#view").bounding_box()
    assert large["width"] > 1.5 * view["width"] and large["x"] + large["width"] <= stage["width"]
    u, v = at(page, 0.8, 7.45)
    assert 0 < u < 390 and v > stage["y"]
