"""The editor of the route graph, as a person uses it, with mouse and touch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from navstack.live import Options, Origin, Session, Stage
from navstack.map_io import map_path
from navstack.routes import build_graph, load_graph, save_graph
from navstack.scenario import Scenario
from tests.browser.conftest import Live, at, drag, value, wait_until

Start = Callable[..., Live]
Open = Callable[..., Any]
Load = Callable[..., Scenario]

EMPTY = "map: office\nstart: [0.8, 7.45, 0.0]\ngoals: []\ninteractions: []\n"
NODES = "window.navstack.graph.data?.nodes.length"
EDGES = "window.navstack.graph.data?.edges.length"


def staged(scenario: Load, folder: Path, *, speed: float = 20.0) -> Stage:
    """A paused session with a lane in the corridor."""
    graph = build_graph({0: (1.5, 7.45), 1: (3.0, 7.45)}, [(0, 1)], name="lane")
    save_graph(graph, folder / "lane.geojson")
    session = Session(scenario(EMPTY), origin=Origin(map_path("office"), ("turtlebot",)), speed=speed)
    session.pause(True)
    return Stage([session], Options(graph=folder / "lane.geojson"))


def test_two_nodes_are_added_connected_saved_and_reloaded(
    live: Start, open_page: Open, scenario: Load, tmp_path: Path
) -> None:
    server = live(stage=staged(scenario, tmp_path))
    page = open_page(server)
    page.click("#tool-graph")
    page.click("#graph-node")
    for count, x in ((3, 5.0), (4, 7.0)):
        page.mouse.click(*at(page, x, 7.45))
        wait_until(page, f"{NODES} === {count}")
    page.click("#graph-connect")
    drag(page, (5.0, 7.45), (7.0, 7.45))
    wait_until(page, f"{EDGES} === 3")
    page.mouse.click(*at(page, 3.0, 7.45))  # or one after the other
    page.mouse.click(*at(page, 5.0, 7.45))
    wait_until(page, f"{EDGES} === 5")
    page.click("#graph-select")
    drag(page, (7.0, 7.45), (7.5, 7.9))
    wait_until(page, "window.navstack.graph.data.nodes.some((n) => Math.abs(n[2] - 7.9) < 0.05)")
    page.mouse.click(*at(page, 2.25, 7.45))
    page.fill("#graph-speed_limit", "0.5")
    page.keyboard.press("Tab")
    wait_until(page, "window.navstack.graph.data.edges[0][3].speed_limit === 0.5")
    page.fill("#graph-penalty", "-3")
    page.keyboard.press("Tab")
    page.locator(".toast.error", has_text="penalty is -3").wait_for()
    page.expected.append("penalty is -3")
    page.fill("#graph-name", "mine")
    page.click("#graph-save")
    page.locator(".toast", has_text="mine.geojson").wait_for()
    page.reload()
    page.wait_for_function("() => window.navstack?.graph.data?.nodes.length === 4")
    loaded = load_graph(tmp_path / "mine.geojson")
    assert len(loaded) == 4 and loaded.edge_count == 5 and loaded.edge_metadata[0] == {"speed_limit": 0.5}
    page.click("#tool-graph")
    page.click("#graph-undo")
    wait_until(page, "!('speed_limit' in window.navstack.graph.data.edges[0][3])")


def test_findings_are_listed_and_show_their_place(live: Start, open_page: Open, scenario: Load, tmp_path: Path) -> None:
    page = open_page(live(stage=staged(scenario, tmp_path)))
    page.click("#show-graph")
    page.click("#graph-check")
    page.locator("#graph-findings .finding.bad").first.click()
    assert abs(value(page, "window.navstack.camera.y") - 7.45) < 0.1
    assert value(page, "window.navstack.camera.scale") >= 60


def test_the_robot_drives_to_a_node_and_the_current_edge_is_shown(
    live: Start, open_page: Open, scenario: Load, tmp_path: Path
) -> None:
    page = open_page(live(stage=staged(scenario, tmp_path, speed=2.0)))
    page.click("#tool-graph")
    page.mouse.click(*at(page, 3.0, 7.45))
    page.click("#graph-drive")
    page.click("#play")
    wait_until(page, "side.route?.edge === 2")
    page.locator("#graph-driving", has_text="On edge 2 (node 0 to 1), next node 1").wait_for()
    page.select_option("#speed", "max")
    wait_until(page, "side.goals.ended.length === 1")
    assert value(page, "side.goals.ended[0].state") == "SUCCEEDED"
    wait_until(page, "side.route === null")


def test_a_phone_edits_by_touch_and_another_page_sees_it(
    live: Start, open_page: Open, scenario: Load, tmp_path: Path
) -> None:
    server = live(stage=staged(scenario, tmp_path))
    other = open_page(server)
    page = open_page(server, size=(390, 844), has_touch=True, is_mobile=True)
    page.tap("#tool-graph")
    page.tap("#graph-node")
    page.touchscreen.tap(*at(page, 8.0, 7.45))
    wait_until(page, f"{NODES} === 3")
    wait_until(other, f"{NODES} === 3")
    page.tap("#graph-connect")
    page.touchscreen.tap(*at(page, 3.0, 7.45))
    page.touchscreen.tap(*at(page, 8.0, 7.45))
    wait_until(other, f"{EDGES} === 3")


def test_a_viewer_cannot_edit(live: Start, open_page: Open, scenario: Load, tmp_path: Path) -> None:
    page = open_page(live(stage=staged(scenario, tmp_path), read_only=True))
    page.click("#show-graph")
    assert page.locator("#graph-save").is_disabled() and page.locator("#graph-from-map").is_disabled()
    assert page.locator("#graph-check").is_enabled()


def test_a_task_begins_from_the_list(live: Start, open_page: Open) -> None:
    server = live(EMPTY, paused=True)
    page = open_page(server)
    page.click("#show-goals")
    page.select_option("#tasks", label="Cover the whole map")
    wait_until(page, "side.interactions.some(([, kind]) => kind === 'step')")
