"""A simulated robot with its whole stack behind a real MQTT broker (mosquitto), driven by VDA 5050 orders."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest

import navstack as nav
from navstack.bringup import BasicNavigator
from navstack.core import InputError
from navstack.vda5050 import MqttLink, NavigatorVehicle, Vda5050Robot
from tests.vda5050.rig import Bench, check, header

mqtt = pytest.importorskip("paho.mqtt.client")


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The port of a broker on the loopback interface."""
    program = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        number = free.getsockname()[1]
    settings = tmp_path_factory.mktemp("broker") / "mosquitto.conf"
    settings.write_text(
        f"listener {number} 127.0.0.1\nallow_anonymous true\npersistence false\nlog_dest stderr\nconnection_messages false\n"
    )
    with subprocess.Popen([program, "-c", settings], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as broker:
        assert broker.stderr is not None and any(
            line.rstrip().endswith(b"running") for line in broker.stderr
        )  # it listens
        yield number
        broker.terminate()


class Control:
    """A fleet control: sends orders, and keeps what the robot sends."""

    def __init__(self, port: int) -> None:
        self.got: list[tuple[str, dict]] = []
        self.client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        self.client.on_message = self.take
        self.client.connect("127.0.0.1", port)
        self.client.subscribe([(f"uagv/v3/navstack/r1/{topic}", 1) for topic in ("state", "connection", "factsheet")])
        self.wait(lambda: False, 0.3)

    def take(self, client: object, data: object, message: mqtt.MQTTMessage) -> None:
        topic = message.topic.rpartition("/")[2]
        content = json.loads(message.payload)
        check(topic, content)
        self.got.append((topic, content))

    def wait(self, done: object, limit: float = 10.0) -> None:
        end = time.monotonic() + limit
        while not done() and time.monotonic() < end:
            self.client.loop(timeout=0.01)

    def send(self, topic: str, message: dict) -> None:
        check(topic, message)
        self.client.publish(f"uagv/v3/navstack/r1/{topic}", json.dumps(message))
        self.client.loop(timeout=0.01)

    def last(self, topic: str) -> dict:
        return next((content for name, content in reversed(self.got) if name == topic), {})


def test_a_simulated_robot_drives_an_order_from_a_broker(port: int) -> None:
    places = nav.load_places("office")
    start = places.start
    navigator = BasicNavigator.simulated(
        nav.load_configuration(["turtlebot"]), nav.load_map(nav.map_path("office")), start
    )
    robot = Vda5050Robot(NavigatorVehicle(navigator), "navstack", "r1", "office")
    control = Control(port)
    link = MqttLink(robot, "127.0.0.1", port)
    control.wait(lambda: control.last("connection"))
    assert control.last("connection")["connectionState"] == "ONLINE"

    goal = nav.plan("office", start, places.goals[0]).path
    spots = [goal[min(k, len(goal) - 1)] for k in (0, 20, 40)]
    nodes = [
        {
            "nodeId": f"n{k}",
            "sequenceId": 2 * k,
            "released": True,
            "nodePosition": {"x": spot.x, "y": spot.y, "mapId": "office"},
            "actions": [],
        }
        for k, spot in enumerate(spots)
    ]
    edges = [
        {"edgeId": f"e{a}", "sequenceId": 2 * a + 1, "released": True, "actions": []}
        for a, _ in pairwise(range(len(nodes)))
    ]
    control.send("order", {**header(), "orderId": "o1", "orderUpdateId": 0, "nodes": nodes, "edges": edges})

    def cycle() -> bool:
        link.exchange()
        robot.step()
        control.client.loop(timeout=0.0)
        return control.last("state").get("lastNodeId") == "n2" and not control.last("state")["nodeStates"]

    for _ in range(2000):
        if cycle():
            break
    state = control.last("state")
    assert (state["orderId"], state["lastNodeId"], state["errors"]) == ("o1", "n2", [])
    position = state["mobileRobotPosition"]
    assert abs(position["x"] - spots[-1].x) + abs(position["y"] - spots[-1].y) < 0.5

    action = {"actionType": "factsheetRequest", "actionId": "a1", "blockingType": "NONE"}
    control.send("instantActions", {**header(), "actions": [action]})
    for _ in range(200):
        cycle()
        if control.last("factsheet"):
            break
    physical = control.last("factsheet")["physicalParameters"]
    assert physical["maximumSpeed"] > 0.2 and physical["width"] > 0.1
    link.close()
    control.wait(lambda: control.last("connection")["connectionState"] == "OFFLINE")
    assert control.last("connection")["connectionState"] == "OFFLINE"


def test_without_a_broker_the_message_says_so() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    with pytest.raises(InputError, match="no MQTT broker answers"):
        MqttLink(Bench().robot, "127.0.0.1", port)
