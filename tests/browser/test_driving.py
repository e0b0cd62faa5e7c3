"""Goals, queues, obstacles, parameters and driving by hand, as a person does them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import yaml

from navstack.behaviors import MOVE_KEYS, START_SPEED
from navstack.live import Options, Session, Stage
from navstack.parameters import load_configuration
from navstack.scenario import Scenario, shipped_scenarios
from tests.browser.conftest import CORRIDOR, Live, at, drag, value, wait_until

Start = Callable[..., Live]
Open = Callable[..., Any]
Load = Callable[..., Scenario]

EMPTY = "map: office\nstart: [0.8, 7.45, 0.0]\ngoals: []\ninteractions: []\n"


def test_the_robot_drives_and_arrives(live: Start, open_page: Open) -> None:
    page = open_page(live())
    wait_until(page, "side.goals.ended.length === 1 && side.done")
    assert value(page, "side.goals.ended[0].state") == "SUCCEEDED"
    assert page.locator("#state").inner_text() == "done"


def test_a_goal_is_dragged_and_the_robot_arrives_with_its_heading(live: Start, open_page: Open) -> None:
    server = live(EMPTY)
    page = open_page(server)
    page.click("#tool-goal")
    drag(page, (3.0, 7.45), (3.0, 8.2))
    wait_until(page, "side.goals.under_way.length === 1")
    x, y, yaw = value(page, "side.goals.under_way[0].pose")
    assert abs(x - 3.0) < 0.05 and abs(y - 7.45) < 0.05 and abs(yaw - 1.5708) < 0.1
    wait_until(page, "side.goals.ended.length === 1")
    assert value(page, "side.goals.ended[0].state") == "SUCCEEDED"
    pose = server.call(lambda: server.session.run.robot.pose)
    assert abs(pose.yaw - 1.57) < 0.4


def test_a_queue_of_three_is_reordered(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True))
    page.click("#tool-goal")
    page.mouse.click(*at(page, 2.0, 7.4))
    wait_until(page, "side.goals.under_way.length === 1")
    for x in (3.0, 4.0, 5.0):
        before = value(page, "side.goals.waiting.length")
        page.keyboard.down("Shift")
        page.mouse.click(*at(page, x, 7.4))
        page.keyboard.up("Shift")
        wait_until(page, f"side.goals.waiting.length === {before + 1}")
    page.click("#show-goals")
    page.locator("#queue li").nth(3).get_by_label("Earlier").click()
    wait_until(page, "Math.abs(side.goals.waiting[1][0] - 5) < 0.1")
    page.locator("#queue li").nth(2).get_by_label("Earlier").click()
    wait_until(page, "Math.abs(side.goals.waiting[0][0] - 5) < 0.1")
    order = value(page, "side.goals.waiting.map((pose) => Math.round(pose[0]))")
    assert order == [5, 3, 4]
    page.click("#play")
    wait_until(page, "side.goals.ended.length === 4")
    assert value(page, "side.goals.ended.map((goal) => Math.round(goal.pose[0]))") == [2, 5, 3, 4]


def test_a_box_on_the_path_and_the_plan_goes_round(live: Start, open_page: Open) -> None:
    page = open_page(
        live("map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[8.0, 7.45, 0.0]]\n", speed=2.0, paused=True, ahead=1.0)
    )
    wait_until(page, "side.plans.length > 0")
    page.click("#tool-box")
    drag(page, (4.25, 7.0), (4.65, 7.4))
    wait_until(page, "side.shapes.length === 1")
    first = value(page, "side.plans.at(-1)[0]")
    page.click("#play")
    wait_until(page, f"side.plans.at(-1)[0] > {first} + 2")
    nearest = """side.plans.at(-1)[1].reduce((best, x, i, p) => i % 2 ? best
        : Math.min(best, Math.hypot(x - 4.45, p[i + 1] - 7.2)), 99)"""
    assert value(page, nearest) > 0.35
    page.select_option("#speed", "max")
    wait_until(page, "side.goals.ended.length === 1")
    assert value(page, "side.goals.ended[0].state") == "SUCCEEDED"
    assert value(page, "side.collisions") == 0


def test_an_obstacle_is_moved_and_removed(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True))
    page.click("#tool-disc")
    page.mouse.click(*at(page, 3.0, 7.4))
    wait_until(page, "side.shapes.length === 1")
    page.click("#tool-why")
    drag(page, (3.0, 7.4), (4.0, 7.8))
    wait_until(page, "Math.abs(side.shapes[0].pose[0] - 4) < 0.05 && Math.abs(side.shapes[0].pose[1] - 7.8) < 0.05")
    page.click("#tool-delete")
    page.mouse.click(*at(page, 4.0, 7.8))
    wait_until(page, "side.shapes.length === 0")
    page.click("#tool-disc")
    page.mouse.click(*at(page, 3.0, 7.4))
    wait_until(page, "side.shapes.length === 1")
    page.click("#tool-why")
    page.mouse.click(*at(page, 3.0, 7.4))  # marks it
    page.keyboard.press("Delete")
    wait_until(page, "side.shapes.length === 0")
    page.click("#tool-box")
    page.mouse.click(*at(page, 0.8, 7.45))  # on the robot
    page.locator(".toast.error", has_text="would overlap the robot").wait_for()
    page.expected.append("would overlap the robot")


def test_a_slider_changes_the_very_next_control_cycle(live: Start, open_page: Open) -> None:
    server = live("map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[12.0, 7.45, 0.0]]\n", paused=True, ahead=4.0)
    page = open_page(server)
    page.click("#show-parameters")
    page.fill("#parameter-search", "max_vel_x")
    slider = page.locator('[data-name="DWAPlannerROS/max_vel_x"] input[type="range"]')
    slider.focus()
    page.keyboard.press("Home")
    page.locator('[data-name="DWAPlannerROS/max_vel_x"].changed').wait_for()
    assert server.call(lambda: server.session.run.move_base.local_planner.limits.max_vel_x) == 0.0
    page.click("#step")
    wait_until(page, "side.command[0] < 0.5")
    page.locator('[data-name="DWAPlannerROS/max_vel_x"]').get_by_title("Back to").click()
    page.locator('[data-name="DWAPlannerROS/max_vel_x"]:not(.changed)').wait_for()


def test_pause_step_rewind_five_seconds_and_go_on(live: Start, open_page: Open) -> None:
    page = open_page(live("map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[20.0, 7.45, 0.0]]\n", speed=1.0, ahead=8.0))
    page.keyboard.press("Space")
    wait_until(page, "side.paused")
    before = value(page, "side.t")
    page.keyboard.press("n")
    wait_until(page, f"side.t > {before}")
    now = value(page, "side.t")
    page.click("#back")
    wait_until(page, f"!side.seeking && Math.abs(side.t - ({now} - 5)) < 0.3")
    assert value(page, "side.end") == now
    page.select_option("#speed", "10")
    page.click("#play")
    wait_until(page, f"side.t > {now} + 1")


def test_driving_by_hand(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, speed=1.0))
    page.keyboard.press("t")
    page.keyboard.down("i")
    wait_until(page, "side.by_hand && side.velocity[0] > 0.2")
    page.keyboard.up("i")
    wait_until(page, "!side.by_hand && Math.abs(side.velocity[0]) < 0.02")
    assert value(page, "side.pose[0]") > 0.805
    page.keyboard.press("j")
    wait_until(page, "side.interactions.some((item) => item[1] === 'drive')")
    page.keyboard.press("Escape")
    assert value(page, "window.navstack.teleop.on") is False


def test_as_fast_as_it_goes_the_page_keeps_up(live: Start, open_page: Open) -> None:
    """On a fast machine, the window of the local costmap moves by more than its width between two frames."""
    page = open_page(live(EMPTY))
    page.evaluate(
        """() => { const app = window.navstack;
        app.act({ type: 'queue', loop: true, goals: [[20.0, 7.45, 0.0], [0.8, 7.45, 3.14]] });
        app.act({ type: 'speed', factor: null }); }"""
    )
    wait_until(page, "side.t > 100 && side.goals.ended.length > 1")


def test_a_frame_that_cannot_be_read_is_followed_by_everything_anew(live: Start, open_page: Open) -> None:
    page = open_page(live(CORRIDOR, speed=1.0))
    page.evaluate(
        "() => { const c = window.navstack.connection; c.receive(new Uint8Array(9).fill(7).buffer, c.socket); }"
    )
    page.locator("#link", has_text="connection lost, trying again").wait_for()
    page.locator("#link", has_text="connected").wait_for()
    before = value(page, "side.t")
    wait_until(page, f"side.t > {before} + 0.5")
    assert all("console" in problem for problem in page.problems)  # it says what it could not read
    page.problems.clear()


def test_a_window_that_moves_by_more_than_its_width_is_emptied(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True))
    cells = page.evaluate(
        """async () => { const { Grid } = await import('./grid.js'), grid = new Grid(), found = [];
        const change = { nx: 3, ny: 2, resolution: 1, origin: [0, 0] };
        for (const shift of [[1, 0], [-1, 1], [2, 0], [5, 0], [-5, 0], [0, 7], [-4, -4]]) {
          grid.update({ ...change, box: [0, 0, 3, 2], blob: 0 }, [new Uint8Array([1, 2, 3, 4, 5, 6]).buffer]);
          grid.update({ ...change, shift, box: [0, 0, 0, 0] }, []);
          found.push(Array.from(grid.cells));
        }
        return found; }"""
    )
    empty = [0] * 6
    assert cells == [[2, 3, 0, 5, 6, 0], [0, 4, 5, 0, 0, 0], [3, 0, 0, 6, 0, 0], empty, empty, empty, empty]


def test_a_car_shows_its_wheels_and_its_steering_angle(live: Start, open_page: Open) -> None:
    text = shipped_scenarios()["car_park"].read_text(encoding="utf-8").replace("car_mppi", "car_rpp")
    page = open_page(live(text, paused=True, ahead=10.0))
    angle = value(page, "side.steering")
    assert abs(angle) > 0.3
    wheels = value(page, "side.wheels")
    assert len(wheels) == 4 and [wheel[0] for wheel in wheels] == [0, 0, 0.5, 0.5]
    assert wheels[2][2] * angle > 0.0 and wheels[0][2] == 0.0
    page.click("#show-robot")
    assert page.locator("canvas[aria-label='Steering angle over time']").is_visible()
    assert "steering" in page.locator("#tab-robot .numbers").inner_text().lower()


def test_a_robot_that_turns_in_place_has_no_steering_chart(live: Start, open_page: Open) -> None:
    page = open_page(live(paused=True, ahead=1.0))
    page.click("#show-robot")
    assert not page.locator("canvas[aria-label='Steering angle over time']").is_visible()
    assert value(page, "side.steering === undefined")


def test_footprints_have_a_toggle_each(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, paused=True))
    page.click("#show-layers")
    drawn = """() => { const scene = window.navstack.scene, drawn = [], parts = ['drawRobot', 'drawPadded'];
        for (const part of parts) {
          const draw = scene[part];
          scene[part] = (side) => { drawn.push(part); draw.call(scene, side); };
        }
        scene.draw(0);
        for (const part of parts) delete scene[part];
        return drawn; }"""
    assert page.evaluate(drawn) == ["drawPadded", "drawRobot"]
    page.uncheck("#layer-padded")
    assert page.evaluate(drawn) == ["drawRobot"]
    page.uncheck("#layer-footprint")
    assert page.evaluate(drawn) == []


def test_the_keys_are_those_of_teleop(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, speed=1.0))
    page.keyboard.press("t")
    assert value(page, "window.navstack.teleop.linear") == START_SPEED
    assert value(page, "window.navstack.teleop.keys.moves") == {key: list(signs) for key, signs in MOVE_KEYS.items()}
    page.keyboard.press("q")
    assert value(page, "window.navstack.teleop.linear") == pytest.approx(1.1 * START_SPEED)
    page.keyboard.down("u")
    wait_until(page, "side.by_hand && side.velocity[0] > 0.1 && side.velocity[2] > 0.1")
    page.keyboard.press("k")
    wait_until(page, "!side.by_hand")
    page.keyboard.up("u")


def test_driving_by_hand_goes_through_the_collision_monitor(live: Start, open_page: Open, scenario: Load) -> None:
    monitor = """
collision_monitor:
  polygons: [stop]
  stop: {type: circle, radius: 0.6, action_type: stop}
  observation_sources: [scan]
  scan: {type: scan, topic: scan}
"""
    base = scenario("map: office\nstart: [3.0, 7.45, 1.57]\ngoals: []\ninteractions: []\n")
    configuration = load_configuration(["turtlebot", yaml.safe_load(monitor)])
    session = Session(replace(base, configuration=configuration), speed=5.0)
    server = live(stage=Stage([session], Options()))
    page = open_page(server)
    page.keyboard.press("t")
    page.keyboard.down("i")
    wait_until(page, "side.interactions.some((item) => item[1] === 'teleop') && side.t > 8")
    page.keyboard.up("i")
    assert value(page, "side.collisions") == 0
    assert value(page, "side.pose[1]") < 8.3  # the wall is at 8.4 m


def test_the_page_shows_the_preparation_and_never_an_empty_list(live: Start, browser: Any, scenario: Load) -> None:
    go_on, session = threading.Event(), Session(scenario(CORRIDOR), speed=20.0)

    def prepare(report: Callable[[str, int, int], None]) -> Stage:
        report("compiling kernels, once per machine", 12, 96)
        go_on.wait(60.0)
        return Stage([session], Options())

    server = live(stage=Stage([session], Options()), prepare=prepare)
    context = browser.new_context()
    page = context.new_page()
    page.goto(server.address)
    progress = page.locator("#progress")
    progress.get_by_text("12 of 96").wait_for()
    assert "compiling kernels" in progress.inner_text()
    page.click("#show-parameters")
    assert "when the robot is ready" in page.locator("#parameter-list").inner_text()
    go_on.set()
    page.locator('[data-name="DWAPlannerROS/max_vel_x"]').wait_for(state="attached")
    assert progress.is_hidden()
    wait_until(page, "side.done")
    context.close()


@pytest.mark.parametrize("keys", [("ArrowUp", "ArrowLeft"), ("w", "a")])
def test_driving_by_arrow_keys_and_letters(live: Start, open_page: Open, keys: tuple[str, str]) -> None:
    page = open_page(live(EMPTY, speed=1.0))
    page.keyboard.press("t")
    page.focus("#scene")
    for key in keys:
        page.keyboard.down(key)
    wait_until(page, "side.by_hand && side.velocity[0] > 0.1 && side.velocity[2] > 0.1")
    page.keyboard.up(keys[0])
    wait_until(page, "Math.abs(side.velocity[0]) < 0.02 && side.velocity[2] > 0.1")
    page.keyboard.up(keys[1])
    wait_until(page, "!side.by_hand")
    assert value(page, "window.navstack.tools.cross") is None


def test_driving_by_pad_on_a_phone(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, speed=1.0), size=(390, 844), has_touch=True, is_mobile=True)
    assert page.locator("#pad").is_hidden()
    page.tap("#tool-drive")
    box = page.locator("#pad").bounding_box()
    assert box["width"] >= 120
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    touch = page.context.new_cdp_session(page)
    for kind, points in (("touchStart", [(x, y)]), ("touchMove", [(x - 40, y - 60)])):
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": u, "y": v} for u, v in points]})
    wait_until(page, "side.by_hand && side.velocity[0] > 0.1 && side.velocity[2] > 0.1")
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    wait_until(page, "!side.by_hand && Math.abs(side.velocity[0]) < 0.02")
    assert page.evaluate("() => document.documentElement.scrollWidth <= 390")


def test_driving_by_game_pad(live: Start, open_page: Open) -> None:
    page = open_page(live(EMPTY, speed=1.0))
    page.evaluate(
        """() => { window.axes = [0, 0, 0, 0];
        navigator.getGamepads = () => [{ connected: true, axes: window.axes, buttons: [] }]; }"""
    )
    page.keyboard.press("t")
    page.evaluate("() => { window.axes = [-0.8, -1, 0, 0]; }")
    wait_until(page, "side.by_hand && side.velocity[0] > 0.1 && side.velocity[2] > 0.1")
    page.evaluate("() => { window.axes = [0.02, 0.02, 0, 0]; }")  # within the dead zone
    wait_until(page, "!side.by_hand")


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_the_hint_is_beside_the_map_and_the_state_is_whole(live: Start, open_page: Open, size: tuple[int, int]) -> None:
    page = open_page(live(EMPTY, paused=True), size=size)
    before = page.locator("#scene").bounding_box()
    for tool in ("goal", "pose", "drive"):
        page.click(f"#tool-{tool}")
        hint = page.locator("#hint").bounding_box()
        assert page.locator("#hint").inner_text() and hint["y"] + hint["height"] <= before["y"]
        assert page.locator("#scene").bounding_box() == before
    state = page.evaluate(
        "() => { const s = document.getElementById('state'); return [s.scrollWidth, s.clientWidth]; }"
    )
    assert page.locator("#state").inner_text() == "paused" and state[0] <= state[1]
