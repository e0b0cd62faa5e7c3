"""A point as a vehicle for VDA 5050, orders to drive, and the published schemas."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path as File
from typing import Any

import jsonschema

from navstack.core import Path, Pose2D, Twist2D
from navstack.vda5050 import Vda5050Robot, VehicleState

SCHEMAS = {
    file.stem: json.loads(file.read_text(encoding="utf-8"))
    for file in (File(__file__).parent / "schemas").glob("*.schema")
}


def check(topic: str, message: dict[str, Any]) -> None:
    """Validate a message against the published schema of its topic."""
    jsonschema.Draft202012Validator(SCHEMAS[topic], format_checker=jsonschema.FormatChecker()).validate(message)


class Point:
    """A vehicle that drives at 1 m/s."""

    def __init__(self) -> None:
        self.time, self.pose, self.path, self.moving = 0.0, Pose2D(0.0, 0.0, 0.0), None, False

    @property
    def state(self) -> VehicleState:
        return VehicleState(self.time, self.pose, Twist2D(1.0 if self.moving else 0.0))

    @property
    def status(self) -> str:
        return "driving" if self.path is not None else "idle"

    def advance(self) -> None:
        self.time += 0.2
        self.moving = self.path is not None
        if self.path is not None:
            poses = self.path.poses
            near = int(((poses[:, :2] - self.pose[:2]) ** 2).sum(axis=1).argmin())
            self.pose = self.path[min(near + 4, len(poses) - 1)]
            if near + 4 >= len(poses) - 1:
                self.path = None

    def follow(self, path: Path) -> None:
        self.path = path

    def stop(self) -> None:
        self.path = None

    def place(self, pose: Pose2D) -> None:
        self.pose = pose

    def physical(self) -> dict[str, float]:
        speeds = {"minimumSpeed": 0.0, "maximumSpeed": 1.0, "maximumAcceleration": 1.0, "maximumDeceleration": 1.0}
        return speeds | {"minimumHeight": 0.5, "maximumHeight": 0.5, "width": 0.5, "length": 0.5}


def header(number: int = 0) -> dict[str, Any]:
    return {
        "headerId": number,
        "timestamp": "2026-01-01T00:00:00.000Z",
        "version": "3.0.0",
        "manufacturer": "control",
        "serialNumber": "0",
    }


def order(
    names: str,
    *,
    base: int,
    update: int = 0,
    first: int = 0,
    name: str = "o1",
    actions: dict[str, list[dict[str, Any]]] | None = None,
) -> dict[str, Any]:
    """An order along nodes A, B, .. at 2 m from each other; the first `base` of them are released."""
    nodes = [
        {
            "nodeId": letter,
            "sequenceId": first + 2 * k,
            "released": k < base,
            "nodePosition": {"x": 2.0 * (ord(letter) - ord("A")), "y": 0.0, "mapId": "hall"},
            "actions": (actions or {}).get(letter, []),
        }
        for k, letter in enumerate(names)
    ]
    edges = [
        {"edgeId": f"{a}{b}", "sequenceId": first + 2 * k + 1, "released": k + 1 < base, "actions": []}
        for k, (a, b) in enumerate(pairwise(names))
    ]
    message = {**header(update), "orderId": name, "orderUpdateId": update, "nodes": nodes, "edges": edges}
    check("order", message)
    return message


def instant(kind: str, number: str = "i1", **parameters: object) -> dict[str, Any]:
    listed = [{"key": key, "value": value} for key, value in parameters.items()]
    action = {"actionType": kind, "actionId": number, "blockingType": "NONE", "actionParameters": listed}
    message = {**header(), "actions": [action]}
    check("instantActions", message)
    return message


class Bench:
    """A robot whose messages are all validated and kept."""

    def __init__(self, **options: Any) -> None:
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.vehicle = Point()
        self.robot = Vda5050Robot(self.vehicle, "navstack", "r1", "hall", publish=self.keep, **options)

    def keep(self, topic: str, message: dict[str, Any]) -> None:
        check(topic, message)
        self.sent.append((topic, message))

    def drive(self, until: float = 60.0) -> None:
        begun = self.vehicle.time
        while not self.robot.idle and self.vehicle.time - begun < until:
            self.robot.step()
        self.robot.step()

    @property
    def state(self) -> dict[str, Any]:
        return next(message for topic, message in reversed(self.sent) if topic == "state")

    @property
    def errors(self) -> list[str]:
        self.robot.step()
        return [error["errorType"] for error in self.state["errors"]]

    def at(self, x: float) -> bool:
        return math.isclose(self.vehicle.pose.x, x, abs_tol=0.31)
