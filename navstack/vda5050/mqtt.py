"""Messages of a VDA 5050 robot over an MQTT broker (extra `fleet`)."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from navstack.core import InputError, require
from navstack.vda5050.vehicle import Vda5050Robot


class MqttLink:
    """Carries the messages of a robot over an MQTT broker: topics `interface/v3/manufacturer/serialNumber/..`.

    The last will says CONNECTION_BROKEN. Needs the extra `fleet`.
    """

    def __init__(
        self, robot: Vda5050Robot, host: str, port: int = 1883, *, interface: str = "uagv", timeout_s: float = 10.0
    ) -> None:
        """Connect, subscribe, and publish ONLINE. Raises InputError if there is no broker."""
        mqtt = require("paho.mqtt.client", "MQTT")
        self.robot = robot
        self._topic = f"{interface}/v3/{robot.manufacturer}/{robot.serial_number}"
        self._timeout = timeout_s
        self._received: list[tuple[str, bytes]] = []
        self._subscribed = False
        name = f"{robot.manufacturer}-{robot.serial_number}"
        self._client: Any = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id=name)
        self._client.will_set(f"{self._topic}/connection", json.dumps(robot.last_will()), qos=1, retain=True)
        self._client.on_connect = self._connected
        self._client.on_subscribe = self._subscribes
        self._client.on_message = self._takes
        try:
            self._client.connect(host, port)
        except OSError as error:
            text = f"no MQTT broker answers at {host}:{port} ({error}); start one, or name another"
            raise InputError(text, host=host, port=port) from None
        robot.publish = self.publish
        self._wait(lambda: self._subscribed)
        robot.connect("ONLINE")

    def _connected(self, client: Any, *_: Any) -> None:
        client.subscribe([(f"{self._topic}/{topic}", 0) for topic in ("order", "instantActions")])

    def _subscribes(self, *_: Any) -> None:
        self._subscribed = True

    def _takes(self, client: Any, data: Any, message: Any) -> None:
        del client, data
        self._received.append((message.topic, message.payload))

    def publish(self, topic: str, message: Mapping[str, Any]) -> None:
        """Publish a message: connection retained with quality of service 1, the others with 0."""
        lasting = topic == "connection"
        self._client.publish(f"{self._topic}/{topic}", json.dumps(message), qos=int(lasting), retain=lasting)

    def exchange(self) -> None:
        """Send and receive what is due; give the robot its messages."""
        self._client.loop(timeout=0.001)
        received, self._received = self._received, []
        for topic, payload in received:
            self.robot.receive(topic.rpartition("/")[2], payload)

    def _wait(self, done: Callable[[], bool]) -> None:
        for _ in range(max(1, round(self._timeout / 0.05))):
            if done():
                return
            self._client.loop(timeout=0.05)
        raise InputError("the MQTT broker does not answer; look at its log")

    def close(self) -> None:
        """Publish OFFLINE and disconnect."""
        self.robot.connect("OFFLINE")
        for _ in range(20):
            if not self._client.want_write():
                break
            self._client.loop(timeout=0.01)
        self._client.disconnect()
