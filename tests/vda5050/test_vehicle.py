"""VDA 5050: orders with base and horizon, stitching, what is refused and why, instant actions; every message by its schema."""

from __future__ import annotations

import json

import pytest

from navstack.core import InputError
from tests.vda5050.rig import Bench, instant, order


def test_an_order_is_driven_to_its_end() -> None:
    bench = Bench()
    bench.robot.connect("ONLINE")
    bench.robot.receive("order", json.dumps(order("ABC", base=3)))
    bench.drive()
    assert bench.at(4.0)
    assert bench.robot.idle
    state = bench.state
    assert (state["orderId"], state["lastNodeId"], state["lastNodeSequenceId"]) == ("o1", "C", 4)
    assert state["nodeStates"] == state["edgeStates"] == state["errors"] == []
    lasts = [message["lastNodeId"] for topic, message in bench.sent if topic == "state"]
    assert list(dict.fromkeys(lasts)) == ["A", "B", "C"]
    numbers = [message["headerId"] for topic, message in bench.sent if topic == "state"]
    assert numbers == list(range(len(numbers)))


def test_the_robot_waits_at_the_end_of_the_base_and_asks_for_more() -> None:
    bench = Bench()
    bench.robot.receive("order", order("ABCD", base=2))
    bench.drive(20.0)
    assert bench.at(2.0)
    assert not bench.robot.idle
    assert bench.state["newBaseRequest"]
    assert [node["nodeId"] for node in bench.state["nodeStates"]] == ["C", "D"]


def test_an_update_replaces_the_horizon_from_the_last_base_node_on() -> None:
    bench = Bench()
    bench.robot.receive("order", order("ABCD", base=2))
    bench.drive(1.0)
    bench.robot.receive("order", order("BCE", base=3, update=1, first=2))
    assert bench.errors == []
    bench.drive()
    assert bench.at(8.0)
    assert (bench.state["lastNodeId"], bench.state["orderUpdateId"]) == ("E", 1)


def test_an_update_of_a_driven_order_goes_on() -> None:
    bench = Bench()
    bench.robot.receive("order", order("AB", base=2))
    bench.drive()
    bench.robot.receive("order", order("BC", base=2, update=1, first=2))
    bench.drive()
    assert bench.at(4.0)


@pytest.mark.parametrize(
    ("second", "error"),
    [
        (order("ABC", base=3), "SAME_ORDER_UPDATE_ID"),
        (order("CD", base=2, update=2, first=4), "INVALID_ORDER"),
        (order("AB", base=2, name="o2"), "INVALID_ORDER"),
    ],
)
def test_what_does_not_continue_the_order_is_refused(second: dict, error: str) -> None:
    bench = Bench()
    bench.robot.receive("order", order("ABC", base=2))
    bench.robot.receive("order", second)
    assert bench.errors == [error]
    assert bench.state["orderUpdateId"] == 0


def test_an_outdated_update_is_refused() -> None:
    bench = Bench()
    bench.robot.receive("order", order("ABC", base=2, update=0))
    bench.robot.receive("order", order("BC", base=2, update=3, first=2))
    bench.robot.receive("order", order("BC", base=2, update=2, first=2))
    assert bench.errors == ["OUTDATED_ORDER_UPDATE"]


def test_an_order_that_begins_elsewhere_is_refused() -> None:
    bench = Bench()
    bench.robot.receive("order", order("CD", base=2))
    assert bench.errors == ["NODE_UNREACHABLE"]
    assert "2" not in bench.robot.order_id


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        (lambda m: m["edges"].clear(), "INVALID_ORDER", "edges between"),
        (lambda m: m["nodes"][1].update(sequenceId=7), "INVALID_ORDER", "out of line"),
        (lambda m: m["nodes"][0].update(released=False), "INVALID_ORDER", "released"),
        (lambda m: m["nodes"][1].pop("nodePosition"), "INVALID_ORDER", "nodePosition"),
        (lambda m: m["nodes"][1]["nodePosition"].update(mapId="roof"), "INVALID_ORDER", "roof"),
        (lambda m: m["nodes"][1].update(sequenceId="x"), "VALIDATION_FAILURE", "nodes.1.sequenceId"),
        (lambda m: m.pop("orderId"), "VALIDATION_FAILURE", "orderId"),
    ],
)
def test_a_wrong_order_is_refused_with_the_reason(change, error: str, text: str) -> None:
    message = order("ABC", base=3)
    change(message)
    bench = Bench()
    bench.robot.receive("order", message)
    assert bench.errors == [error]
    assert text in bench.state["errors"][0]["errorDescription"]
    assert bench.robot.idle


def test_text_that_is_no_json_is_refused() -> None:
    bench = Bench()
    bench.robot.receive("order", "{")
    assert bench.errors == ["VALIDATION_FAILURE"]
    with pytest.raises(InputError, match='send "order" or "instantActions"'):
        bench.robot.receive("state", "{}")


def action(kind: str, number: str = "a1", blocking: str = "HARD") -> dict:
    return {"actionType": kind, "actionId": number, "blockingType": blocking, "actionParameters": []}


def test_actions_at_a_node_are_done_there_while_the_robot_stands() -> None:
    places = []
    bench = Bench(actions={"lift": lambda a: places.append(bench.vehicle.pose.x) or "lifted"})
    bench.robot.receive("order", order("ABC", base=3, actions={"B": [action("lift")]}))
    bench.robot.step()
    assert bench.state["actionStates"][0]["actionStatus"] == "WAITING"
    bench.drive()
    assert places == [pytest.approx(2.0, abs=0.31)]
    assert bench.state["actionStates"][0] == {
        "actionId": "a1",
        "actionType": "lift",
        "actionStatus": "FINISHED",
        "actionResult": "lifted",
    }
    assert bench.at(4.0)


def test_an_action_that_fails_says_why() -> None:
    def broken(_: object) -> str:
        raise RuntimeError("no oil")

    bench = Bench(actions={"lift": broken})
    bench.robot.receive("order", order("AB", base=2, actions={"B": [action("lift")]}))
    bench.drive()
    state = bench.state["actionStates"][0]
    assert (state["actionStatus"], state["actionResult"]) == ("FAILED", "RuntimeError: no oil")


def test_an_order_with_an_unknown_action_is_refused() -> None:
    bench = Bench()
    bench.robot.receive("order", order("AB", base=2, actions={"B": [action("dance")]}))
    assert bench.errors == ["INVALID_ORDER_ACTION"]


def test_cancel_stops_the_robot_and_ends_the_order() -> None:
    bench = Bench()
    bench.robot.receive("order", order("ABCD", base=4, actions={"D": [action("startCharging")]}))
    for _ in range(5):
        bench.robot.step()
    bench.robot.receive("instantActions", instant("cancelOrder"))
    bench.drive()
    state = bench.state
    assert state["nodeStates"] == []
    assert state["actionStates"][0]["actionStatus"] == "FAILED"
    assert state["instantActionStates"][0]["actionStatus"] == "FINISHED"
    assert bench.vehicle.pose.x < 3.0
    bench.robot.receive("order", order("DE", base=2, update=1, first=6))
    assert bench.errors == ["ORDER_UPDATE_FOLLOWING_CANCEL"]


def test_nothing_to_cancel_is_an_error() -> None:
    bench = Bench()
    bench.robot.receive("instantActions", instant("cancelOrder"))
    assert bench.errors == ["NO_ORDER_TO_CANCEL"]
    assert bench.state["instantActionStates"][0]["actionStatus"] == "FAILED"


def test_a_pause_holds_the_robot_until_it_ends() -> None:
    bench = Bench()
    bench.robot.receive("order", order("AC", base=2))
    for _ in range(5):
        bench.robot.step()
    bench.robot.receive("instantActions", instant("startPause"))
    bench.drive(5.0)
    here = bench.vehicle.pose.x
    assert 0.0 < here < 2.0
    assert bench.state["paused"] and not bench.state["driving"]
    bench.robot.receive("instantActions", instant("stopPause", "i2"))
    bench.drive()
    assert bench.at(4.0)


def test_further_instant_actions() -> None:
    bench = Bench()
    bench.robot.receive(
        "instantActions", instant("initializePosition", x=4.0, y=0.0, theta=0.5, mapId="hall", lastNodeId="C")
    )
    bench.robot.receive("instantActions", instant("stateRequest", "i2"))
    bench.robot.receive("instantActions", instant("factsheetRequest", "i3"))
    bench.robot.receive("instantActions", instant("startCharging", "i4"))
    assert bench.errors == []
    assert bench.state["powerSupply"]["charging"]
    assert bench.state["lastNodeId"] == "C"
    assert bench.vehicle.pose.x == 4.0
    factsheet = next(message for topic, message in bench.sent if topic == "factsheet")
    kinds = {each["actionType"] for each in factsheet["protocolFeatures"]["mobileRobotActions"]}
    assert {"cancelOrder", "startPause", "stopPause"} <= kinds
    bench.robot.receive("instantActions", instant("clearInstantActions", "i5"))
    bench.robot.step()
    assert [each["actionId"] for each in bench.state["instantActionStates"]] == ["i5"]


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (instant("fly"), "INVALID_INSTANT_ACTION"),
        (instant("initializePosition", x=1.0), "INVALID_INSTANT_ACTION"),
        (instant("initializePosition", x=1.0, y=0.0, theta=0.0, mapId="roof"), "UNKNOWN_MAP_ID"),
    ],
)
def test_instant_actions_that_cannot_be_done_fail(message: dict, error: str) -> None:
    bench = Bench()
    bench.robot.receive("instantActions", message)
    assert bench.errors == [error]
