"""The tab with the behavior tree of a Nav2 robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from navstack.live import Options, Origin, Session, Stage
from navstack.live.view import tree_of
from navstack.map_io import map_path
from navstack.scenario import Scenario
from tests.browser.conftest import Live, wait_until

Start = Callable[..., Live]
Open = Callable[..., Any]
Load = Callable[..., Scenario]

NAV2 = "map: office\nparams: nav2_turtlebot\nstart: [0.8, 7.45, 0.0]\ngoals: [[4.8, 7.45, 0.0]]\n"


def stage(scenario: Load, text: str = NAV2, until: float = 2.0) -> Stage:
    """A paused session of a robot that is driven by a tree."""
    session = Session(scenario(text), origin=Origin(map_path("office"), ("nav2_turtlebot",)), speed=5.0)
    while session.time < until and not session.is_done:
        session.step_once()
    session.pause(True)
    return Stage([session], Options())


def shown(page: Any) -> dict[str, tuple[str, str]]:
    """State and numbers of each node, by label."""
    texts = "[r.children[1].textContent, r.className, r.children[2].textContent]"
    rows = page.evaluate(f"() => [...document.querySelectorAll('.tree li')].map((r) => {texts})")
    return {label: (state, text) for label, state, text in rows}


def test_the_tree_is_shown_with_its_running_nodes(live: Start, open_page: Open, scenario: Load) -> None:
    server = live(stage=stage(scenario))
    page = open_page(server)
    assert not page.evaluate("window.navstack.store.main.tree_states")
    page.click("#show-tree")
    wait_until(page, "side.tree_states")
    page.wait_for_function("() => document.querySelector('.tree li.running')")
    tree = tree_of(server.session)
    nodes = shown(page)
    assert page.locator(".tree li span").all_inner_texts() == [item.label for item in tree.nodes]
    follow = next(item for item in tree.nodes if item.label == "FollowPath")
    assert nodes["FollowPath"] == ("running", f"running · {sum(follow.counts[1:])}×")
    assert nodes["ComputePathToPose"][0] == "good" and nodes["Spin"] == ("never", "")

    page.click("#play")
    wait_until(page, "side.done")
    page.wait_for_function("() => !document.querySelector('.tree li.running')")
    assert shown(page)["FollowPath"][0] == "good"
    page.click("#tab-tree input")
    assert not page.locator(".tree li.never").first.is_visible()
    page.click("#show-robot")
    page.wait_for_function("() => document.getElementById('tab-tree').hidden")


def test_a_failure_says_why(live: Start, open_page: Open, scenario: Load) -> None:
    page = open_page(live(stage=stage(scenario, NAV2.replace("[4.8, 7.45, 0.0]", "[-3.0, -3.0, 0.0]"))))
    page.click("#show-tree")
    failed = page.locator(".tree li.bad", has_text="ComputePathToPose").first
    failed.locator("small", has_text="outside the costmap").wait_for()


def test_on_a_phone_the_tree_fits_its_width(live: Start, open_page: Open, scenario: Load) -> None:
    page = open_page(live(stage=stage(scenario)), size=(390, 844), has_touch=True, is_mobile=True)
    page.tap("#sheet-button")
    page.tap("#show-tree")
    page.locator(".tree li.running").first.wait_for()
    assert page.locator("#tab-tree").evaluate("(e) => e.scrollWidth <= e.clientWidth")
    assert page.locator("#tabs").evaluate("(e) => e.scrollWidth <= e.clientWidth")
    assert page.locator(".tree li").first.evaluate("(e) => parseFloat(getComputedStyle(e).fontSize)") >= 12


def test_a_robot_of_move_base_has_no_tab(live: Start, open_page: Open) -> None:
    page = open_page(live(paused=True))
    assert page.locator("#show-tree").is_hidden() and page.locator("#show-why").is_visible()
