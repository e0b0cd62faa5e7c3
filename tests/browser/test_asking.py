"""Why, saving, two parameter sets, runs, several pages, other devices."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import OccupancyGrid
from navstack.live import LoggedSession, Options, Origin, Session, Stage
from navstack.map_io import load_map, map_path, save_map
from navstack.parameters import load_configuration
from navstack.scenario import Scenario, load_scenario, run_scenario
from tests.browser.conftest import CORRIDOR, Live, at, drag, value, wait_until
from tests.replay.test_replay import Maker, record_of, replayed

Start = Callable[..., Live]
Open = Callable[..., Any]
Load = Callable[..., Scenario]

EMPTY = "map: office\nstart: [0.8, 7.45, 0.0]\ngoals: []\ninteractions: []\n"


def answer(page: Any) -> str:
    """The text of the tab Why, once it is there."""
    page.wait_for_function(
        "() => { const a = document.getElementById('answer'); return a && !a.textContent.startsWith('simulating'); }"
    )
    return "\n".join(line.rstrip() for line in page.locator("#answer").inner_text().splitlines()).strip()


def command_line(*arguments: str) -> str:
    """Output of a command in a terminal of 100 columns."""
    done = subprocess.run(
        [sys.executable, "-m", "navstack", *arguments],
        env={**os.environ, "COLUMNS": "100"},
        capture_output=True,
        text=True,
        check=True,
    )
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip()


def saved_run(page: Any, server: Live) -> str:
    """Saves the session's record; returns its folder."""
    assert page.evaluate(
        "() => window.navstack.connection.request({ type: 'save', what: 'run', name: 'run' }).then((a) => a.ok)"
    )
    return str(server.stage.options.save_to / "run")  # type: ignore[operator]


def test_the_explanations_are_those_of_the_command_line(live: Start, open_page: Open) -> None:
    server = live(CORRIDOR, paused=True, ahead=60.0)  # to the end
    page = open_page(server)
    folder = saved_run(page, server)
    page.click("#show-layers")
    page.uncheck("#layer-local")
    page.mouse.click(*at(page, 3.5, 8.4))
    x, y, _ = page.evaluate("() => document.getElementById('pose-text').textContent.split(',').map(Number)")
    shown = answer(page)
    wanted = command_line("explain", "cell", folder, "--at", f"{x},{y}")
    assert shown.splitlines()[1:] == wanted.splitlines()[1:] and shown.startswith("global_costmap at")

    time = round(server.session.time / 2, 3)
    page.evaluate(f"() => {{ window.navstack.why.command({time}); }}")
    assert answer(page) == command_line("explain", "command", folder, "--time", str(time))

    page.click("#show-goals")
    page.locator("#ended").get_by_label("What happened to this goal").click()
    assert answer(page) == command_line("explain", "goal", folder, "--goal", "1")


def test_a_trajectory_and_a_chart_say_why(live: Start, open_page: Open) -> None:
    page = open_page(live("map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[20.0, 7.45, 0.0]]\n", paused=True, ahead=6.0))
    page.click("#show-layers")
    page.check("#layer-trajectories")
    wait_until(page, "side.trajectories && side.trajectories.rows > 10")
    page.evaluate(
        "() => { const n = window.navstack; [n.camera.x, n.camera.y] = n.store.main.pose; n.camera.scale = 300; }"
    )
    target = page.evaluate(
        """() => { const side = window.navstack.store.main, t = side.trajectories, i = 2 * (2 * t.points - 1);
        const [ox, oy, a] = side.odom, x = t.origin[0] + t.xy[i] / 100, y = t.origin[1] + t.xy[i + 1] / 100;
        return [ox + Math.cos(a) * x - Math.sin(a) * y, oy + Math.sin(a) * x + Math.cos(a) * y]; }"""
    )
    page.mouse.click(*at(page, *target))
    assert answer(page).startswith("trajectory ")
    page.click("#show-robot")
    box = page.locator(".chart").first.bounding_box()
    page.mouse.click(box["x"] + box["width"] * 0.12, box["y"] + 50)
    assert "DWAPlanner at" in answer(page)


def test_can_the_robot_pass(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True))
    page.click("#tool-passage")
    page.mouse.click(*at(page, 6.9, 8.4))
    text = answer(page)
    assert "passable" in text and "minimum width" in text


def test_save_and_drive_again_byte_for_byte(live: Start, open_page: Open, tmp_path: Path) -> None:
    server = live(CORRIDOR, paused=True, ahead=2.0)
    page = open_page(server)
    page.click("#tool-person")
    drag(page, (6.0, 7.2), (6.0, 8.0))
    wait_until(page, "side.shapes.length === 1")
    page.click("#tool-goal")
    page.mouse.click(*at(page, 3.0, 7.6))
    wait_until(page, "side.goals.under_way.length === 2 || side.interactions.length === 2")
    page.select_option("#speed", "max")
    page.click("#play")
    wait_until(page, "side.done")
    page.keyboard.press("s")
    page.fill("#save-name", "my session")
    page.click("#save-do")
    page.locator(".toast", has_text="saved").wait_for()
    folder = saved_run(page, server)
    again = run_scenario(load_scenario(tmp_path / "saved" / "my session.yaml")).recorder
    same = run_scenario(load_scenario(tmp_path / "saved" / "run.yaml")).recorder
    assert again is not None and same is not None
    mine = Path(folder, "run.npz").read_bytes()
    assert same.save(tmp_path / "again")["record"].read_bytes() == mine
    same.set_scenario({})
    again.set_scenario({})
    first, second = same.save(tmp_path / "a")["record"], again.save(tmp_path / "b")["record"]
    assert first.read_bytes() == second.read_bytes()


def test_two_parameter_sets_in_one_world(live: Start, open_page: Open, scenario: Load) -> None:
    base = scenario(CORRIDOR)
    slow = load_configuration(
        ["turtlebot"], overrides=["DWAPlannerROS/max_vel_x=0.3", "DWAPlannerROS/max_vel_trans=0.3"]
    )
    sessions = [Session(base, speed=20.0), Session(replace(base, configuration=slow), speed=20.0)]
    page = open_page(live(stage=Stage(sessions, Options(labels=("turtlebot", "slow")))))
    wait_until(page, "window.navstack.store.sides.every((s) => s.done)")
    rows = page.locator("#versus tr")
    assert rows.count() == 4
    assert "slow" in rows.nth(2).inner_text() and "+" in rows.nth(3).inner_text()
    page.click("#tool-goal")
    page.mouse.click(*at(page, 3.0, 7.4))
    wait_until(page, "window.navstack.store.sides.every((s) => s.goals.ended.length === 2)")


def test_two_robots_side_by_side(live: Start, open_page: Open, scenario: Load) -> None:
    base = scenario(CORRIDOR)
    other = load_configuration(["turtlebot"], overrides=["DWAPlannerROS/max_vel_x=0.3"])
    sessions = [Session(base, origin=Origin(None, ("turtlebot",))), Session(replace(base, configuration=other))]
    for session in sessions:
        while session.time < 3.0:
            session.step_once()
    server = live(stage=Stage(sessions, Options(labels=("turtlebot", "slow"))))
    page = open_page(server)
    left, right = (page.locator(name).bounding_box() for name in ("#scene", "#scene2"))
    assert left["width"] == right["width"] > 300 and left["x"] + left["width"] <= right["x"]
    assert page.locator("#name2").inner_text().endswith("slow")
    u, v = page.evaluate("window.navstack.camera.toScreen(3.0, 7.4)")
    page.mouse.click(right["x"] + u, right["y"] + v)  # a question about the second robot
    assert "costmap" in answer(page) and value(page, "side.index") == 1
    page.click("#show-parameters")
    page.fill("#parameter-search", "max_vel_x")
    row = page.locator('[data-name="DWAPlannerROS/max_vel_x"]')
    row.locator('input[type="number"]').fill("0.25")
    page.keyboard.press("Enter")
    page.locator('[data-name="DWAPlannerROS/max_vel_x"].changed').wait_for()
    speeds = server.call(lambda: [s.run.move_base.local_planner.limits.max_vel_x for s in sessions])
    assert speeds[1] == 0.25 and speeds[0] > 0.4
    page.locator("#which button").first.click()
    page.locator('[data-name="DWAPlannerROS/max_vel_x"]:not(.changed)').wait_for()
    page.click("#tool-disc")
    page.mouse.click(right["x"] + u, right["y"] + v)  # the world is one
    wait_until(page, "window.navstack.store.sides.every((s) => s.shapes.length === 1)")
    page.keyboard.press("x")
    assert page.locator("#scene2").is_hidden()
    assert page.locator("#scene").bounding_box()["width"] > 2 * left["width"]


def test_a_recorded_run_has_a_time_line(live: Start, open_page: Open, scenario: Load) -> None:
    session = Session(scenario(CORRIDOR))
    session.end = 12.0
    session.pause(True)
    page = open_page(live(stage=Stage([session], Options(fixed=True))))
    assert page.locator("#tool-goal").is_disabled() and page.locator("#clear").is_disabled()
    page.locator("#timeline").fill("6")
    wait_until(page, "!side.seeking && Math.abs(side.t - 6) < 0.3")
    page.locator("#timeline").fill("2")
    wait_until(page, "!side.seeking && Math.abs(side.t - 2) < 0.3")
    page.evaluate("() => { window.navstack.act({ type: 'cancel' }); }")
    page.locator(".toast.error", has_text="recorded run").wait_for()
    page.expected.append("recorded run")


def test_the_replay_of_a_log_has_a_time_line(live: Start, open_page: Open, tmp_path: Path) -> None:
    session = LoggedSession(record_of(replayed(Maker(tmp_path / "robot.bag").write())))
    page = open_page(live(stage=Stage([session], Options(fixed=True))))
    page.locator("#timeline").fill("5")
    wait_until(page, "!side.seeking && Math.abs(side.t - 5) < 0.3 && side.goals.under_way.length == 1")
    assert value(page, "side.pose[0]") == pytest.approx(1.0, abs=0.1)


def test_two_pages_share_a_session(live: Start, open_page: Open) -> None:
    server = live(EMPTY, paused=True)
    first, second = open_page(server), open_page(server)
    first.click("#tool-disc")
    first.mouse.click(*at(first, 3.0, 7.4))
    wait_until(second, "side.shapes.length === 1")
    second.keyboard.press("Space")
    wait_until(first, "!side.paused")


def test_the_page_connects_again_after_a_restart_of_the_server(live: Start, open_page: Open) -> None:
    server = live(EMPTY, paused=True)
    page = open_page(server)
    port = server.port
    server.stop()
    page.locator("#link", has_text="connection lost, trying again").wait_for()
    live(CORRIDOR, paused=True, port=port)
    page.locator("#link", has_text="connected").wait_for()
    wait_until(page, "side.goals.waiting.length === 1")
    # the lost connection itself is an error on the console
    page.problems[:] = [p for p in page.problems if "WebSocket" not in p and "Failed to load resource" not in p]


def test_a_phone(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True), size=(390, 844), has_touch=True)
    box = page.locator("#scene").bounding_box()
    assert box["width"] == 390 and box["height"] > 500
    assert page.evaluate(
        "() => document.documentElement.scrollWidth <= 390 && document.documentElement.scrollHeight <= 844"
    )
    page.tap("#tool-goal")
    page.touchscreen.tap(*at(page, 3.0, 7.4))
    wait_until(page, "side.goals.under_way.length === 1")
    page.tap("#sheet-button")
    page.tap("#show-goals")
    page.locator("#queue li", has_text="goal 1").wait_for()
    scene = page.locator("#scene").bounding_box()
    page.wait_for_function(f"() => Math.abs(window.navstack.camera.height - {scene['height']}) < 1")
    robot = at(page, *value(page, "side.pose")[:2])
    assert scene["y"] < robot[1] < scene["y"] + scene["height"]  # the sheet does not hide it
    for button in page.locator("#tools button").all():
        size = button.bounding_box()
        assert size["width"] >= 44 and size["height"] >= 44


def test_by_keyboard_alone(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True))
    page.keyboard.press("g")
    page.focus("#scene")
    for _ in range(4):
        page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("[")
    page.keyboard.press("Enter")
    wait_until(page, "side.goals.under_way.length === 1")
    assert abs(value(page, "side.goals.under_way[0].pose[2]") - 0.2618) < 0.01
    page.keyboard.press("v")
    page.keyboard.press("Enter")
    assert answer(page)
    page.keyboard.press("?")
    page.locator("#help[open]").wait_for()
    page.keyboard.press("Escape")
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement !== document.body")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_light_and_dark(live: Start, open_page: Open, scheme: str) -> None:
    page = open_page(live(EMPTY, paused=True), color_scheme=scheme)
    wall = page.evaluate("() => window.navstack.theme.mapWall")
    background = page.evaluate("() => getComputedStyle(document.body).backgroundColor")
    assert wall == ("#22262e" if scheme == "light" else "#e3e7ee")
    assert background == ("rgb(244, 245, 247)" if scheme == "light" else "rgb(20, 22, 26)")


def test_a_viewer_can_look_only(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True, read_only=True))
    assert page.locator("#tool-goal").is_disabled() and page.locator("#play").is_disabled()
    page.mouse.click(*at(page, 3.0, 7.4))
    assert "costmap" in answer(page)


def test_parameters_show_their_changes(live: Start, open_page: Open) -> None:
    page = open_page(live(CORRIDOR, paused=True, ahead=2.0))
    page.click("#show-parameters")
    page.fill("#parameter-search", "inflation_radius")
    row = page.locator('[data-name="local_costmap/inflation_layer/inflation_radius"]')
    row.locator('input[type="number"]').fill("0.8")
    page.keyboard.press("Enter")
    page.locator('[data-name="local_costmap/inflation_layer/inflation_radius"].changed').wait_for()
    page.click("#diff")
    assert "+" in answer(page) and "0.8" in answer(page)


def test_a_browser_without_what_is_needed_gets_one_sentence(live: Start, browser: Any) -> None:
    context = browser.new_context()
    page = context.new_page()
    page.add_init_script("delete window.DecompressionStream")
    page.goto(live(EMPTY, paused=True).address)
    sentence = page.locator("#unsupported")
    assert sentence.is_visible() and sentence.inner_text().startswith("This page needs a browser")
    context.close()


CROWDED = "map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[20.0, 7.45, 0.0]]\n"


def test_why_in_cards_with_the_fan_on_the_map(live: Start, open_page: Open) -> None:
    page = open_page(live(CROWDED, paused=True, ahead=6.0))
    page.click("#why-command")
    page.locator(".card", has_text="Costs of the chosen trajectory").wait_for()
    assert page.locator("#answer").is_hidden() and "--all" not in page.locator("#cards").inner_text()
    panel = page.evaluate(
        "() => { const s = document.getElementById('tab-why'); return [s.scrollWidth, s.clientWidth]; }"
    )
    assert panel[0] <= panel[1]
    assert page.evaluate("() => window.navstack.why.fan.rows.length") > 10
    row = page.locator(".samples tbody tr").nth(4)
    row.hover()
    marked = page.evaluate("() => window.navstack.why.marked")
    assert marked is not None
    row.click()
    page.locator("#tab-why h2", has_text="this trajectory").wait_for()
    page.wait_for_function(f"() => window.navstack.why.fan?.sample === {marked}")
    page.get_by_role("button", name="As text").click()
    assert page.locator("#answer").inner_text().startswith("trajectory ")
    page.click("#show-robot")
    assert page.evaluate("() => window.navstack.why.fan") is None


def test_the_panel_does_not_move_the_map_and_has_the_size_that_one_wants(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True))
    before = at(page, 3.5, 8.4)
    page.mouse.click(*before)
    assert "costmap" in answer(page)
    assert at(page, 3.5, 8.4) == pytest.approx(before)
    box = page.locator("#grip").bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] - 145, box["y"] + 200, steps=3)
    page.mouse.up()
    assert page.locator("#panel").bounding_box()["width"] == pytest.approx(490, abs=3)
    page.wait_for_function("() => window.navstack.camera.width < 760")
    assert at(page, 3.5, 8.4) == pytest.approx(before)
    page.click("#sheet-button")
    page.wait_for_function("() => window.navstack.camera.width > 1200")
    assert at(page, 3.5, 8.4) == pytest.approx(before)
    page.reload()
    page.wait_for_function("() => window.navstack?.store.main?.pose")
    assert page.locator("#panel").bounding_box()["width"] == pytest.approx(490, abs=3)


def test_the_value_under_the_pointer_a_legend_and_a_ruler(live: Start, open_page: Open) -> None:
    page = open_page(live(CROWDED, paused=True, ahead=2.0))
    wait_until(page, "side.grids.global.cells !== null")
    page.mouse.move(*at(page, 15.0, 8.4))
    page.locator("#where", has_text="15.0").wait_for()
    assert "global" in page.locator("#where").inner_text()
    page.mouse.move(*at(page, 1.5, 7.4))
    page.locator("#where", has_text="local").wait_for()
    assert "lethal 254" in page.locator("#legend").inner_text()
    page.keyboard.press("m")
    drag(page, (2.0, 6.0), (5.0, 10.0))
    text = page.evaluate("() => window.navstack.tools.measureText(window.navstack.tools.measured)")
    length, angle = (float(part.rstrip("m °")) for part in text.split(","))
    assert length == pytest.approx(5.0, abs=0.1) and angle == pytest.approx(53.0, abs=2.0)
    assert value(page, "side.interactions.length") == 0


def test_the_robot_tab_has_the_heading_and_no_event_each_second(live: Start, open_page: Open) -> None:
    page = open_page(live(CROWDED, paused=True, ahead=9.0))
    assert "heading" in page.locator("#tab-robot .numbers").inner_text().lower()
    rows = page.locator("#events li").all_inner_texts()
    assert 1 <= sum("a plan of" in row for row in rows) <= 2  # of 10; the first is followed by a change of the state
    assert sum("Got new plan" in row for row in rows) <= 2
    assert any("×" in row for row in rows)


def test_walls_are_drawn_and_erased_and_saved_as_a_map(live: Start, open_page: Open, tmp_path: Path) -> None:
    page = open_page(live(EMPTY, paused=True))
    page.click("#tool-wall")
    drag(page, (3.0, 7.0), (3.0, 7.6))
    wait_until(page, "side.shapes.length === 1")
    page.click("#tool-erase")
    drag(page, (3.5, 8.35), (4.5, 8.35))
    page.click("#show-layers")
    page.click("#save-map")
    page.fill("#save-name", "mine")
    page.click("#save-do")
    page.locator(".toast", has_text="saved").wait_for()
    before, after = load_map(map_path("office")), load_map(tmp_path / "saved" / "mine.yaml")
    assert (after.data[before.data == 0] == 100).sum() > 5 and (after.data[before.data == 100] == 0).sum() > 5


@pytest.mark.parametrize("step", [(0.5, 3, 0.2), (0.17, 3, 0.1), (12.0, 3, 5.0), (3.0, 3, 1.0)])
def test_axes_have_round_steps(live: Start, open_page: Open, step: tuple[float, int, float]) -> None:
    page = open_page(live(EMPTY, paused=True))
    span, count, wanted = step
    found = page.evaluate(f"async () => (await import('./charts.js')).niceStep({span}, {count})")
    assert found == pytest.approx(wanted)


def test_two_robots_on_a_wide_map_are_one_above_the_other(live: Start, open_page: Open, tmp_path: Path) -> None:
    cells = np.zeros((60, 400), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    save_map(OccupancyGrid.from_array(cells, 0.05), tmp_path / "wide.yaml")
    text = "map: wide.yaml\nparams: [turtlebot]\nstart: [1.0, 1.5, 0.0]\ngoals: [[18.0, 1.5, 0.0]]\n"
    (tmp_path / "wide_scenario.yaml").write_text(text, encoding="utf-8")
    base = load_scenario(tmp_path / "wide_scenario.yaml")
    sessions = [Session(base), Session(base)]
    for session in sessions:
        session.pause(True)
    page = open_page(live(stage=Stage(sessions, Options(labels=("one", "two")))))
    upper, lower = (page.locator(name).bounding_box() for name in ("#scene", "#scene2"))
    assert upper["width"] > 800 and upper["y"] + upper["height"] <= lower["y"]
    shown = page.evaluate(
        "() => { const { scene, camera } = window.navstack; return (scene.extent[1] - scene.extent[0]) * camera.scale; }"
    )
    assert shown > 0.9 * upper["width"]
    page.keyboard.press("x")
    assert page.locator("#scene2").is_visible()
    assert page.evaluate("() => window.navstack.versus.arrangement") == "beside"
    page.keyboard.press("x")
    assert page.locator("#scene2").is_hidden()
