"""VDA 5050 3.0: orders, instant actions, state, connection and factsheet as data; a robot driven by them, with or without MQTT.

`Vda5050Robot` takes messages and gives messages; `MqttLink` carries them over a broker. The robot drives a
`Vehicle`: `NavigatorVehicle` is a robot with navstack's whole stack, in the simulation or real.
Source: VDA 5050 version 3.0.0, chapters 6.1 (orders), 6.2 (actions), 6.6 (state) and its JSON schemas.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Any, Final, Literal, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from navstack.bringup import BasicNavigator, TaskResult
from navstack.core import InputError, Path, Pose2D, Twist2D
from navstack.plugins import limits_of

VERSION: Final = "3.0.0"
NEAR_M: Final = 0.3
"""A node counts as passed at this distance, unless it allows less or more."""
DENSITY_M: Final = 0.05
STANDS: Final = 1e-3
"""A robot slower than this (m/s, rad/s) stands."""
REQUEST_M: Final = 2.0
"""With less way left than this the robot asks for more."""

_NODE_STATE: Final = {"nodeId", "sequenceId", "released", "nodePosition"}
_EDGE_STATE: Final = {"edgeId", "sequenceId", "released"}

Blocking = Literal["NONE", "SOFT", "SINGLE", "HARD"]
ActionStatus = Literal["WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"]


class _Message(BaseModel):
    """Data of a message; fields that it does not know are ignored, as the standard asks for."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class ActionParameter(_Message):
    """A parameter of an action."""

    key: str
    value: Any


class Action(_Message):
    """What a robot is to do at a node, on an edge, or at once."""

    actionType: str
    actionId: str
    blockingType: Blocking
    actionParameters: list[ActionParameter] = []

    def parameter(self, key: str, default: Any = None) -> Any:
        """Return the value of a parameter."""
        return next((each.value for each in self.actionParameters if each.key == key), default)


class AllowedDeviation(_Message):
    """An ellipse around a node (m, rad)."""

    a: float = Field(ge=0.0)
    b: float = Field(ge=0.0)
    theta: float


class NodePosition(_Message):
    """Where a node is (m, rad), on which map."""

    x: float
    y: float
    mapId: str
    theta: float | None = Field(None, ge=-math.pi - 1e-6, le=math.pi + 1e-6)
    allowedDeviationXY: AllowedDeviation | None = None


class Node(_Message):
    """A node of an order; a node of the base is released."""

    nodeId: str
    sequenceId: int = Field(ge=0)
    released: bool
    nodePosition: NodePosition | None = None
    actions: list[Action]


class Edge(_Message):
    """An edge of an order, between the nodes with the sequence numbers before and after its own."""

    edgeId: str
    sequenceId: int = Field(ge=0)
    released: bool
    maximumSpeed: float | None = None
    actions: list[Action]


class Header(_Message):
    """What every message begins with."""

    headerId: int
    timestamp: str
    version: str
    manufacturer: str
    serialNumber: str


class Order(Header):
    """An order or an update of one."""

    orderId: str
    orderUpdateId: int = Field(ge=0)
    nodes: list[Node] = Field(min_length=1)
    edges: list[Edge]


class InstantActions(Header):
    """Actions to do at once."""

    actions: list[Action]


class ActionState(_Message):
    """How far an action is."""

    actionId: str
    actionType: str
    actionStatus: ActionStatus
    actionResult: str | None = None


class ErrorReference(_Message):
    """What an error is about."""

    referenceKey: str
    referenceValue: str


class Error(_Message):
    """Why something was refused or went wrong."""

    errorType: str
    errorLevel: Literal["WARNING", "URGENT", "CRITICAL", "FATAL"]
    errorDescription: str
    errorReferences: list[ErrorReference] = []


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What a robot is told about its vehicle."""

    time: float
    """s."""
    pose: Pose2D
    velocity: Twist2D
    localized: bool = True


class Vehicle(Protocol):
    """What moves: it follows one path at a time."""

    @property
    def state(self) -> VehicleState:
        """Time, pose and velocity."""
        ...

    @property
    def status(self) -> Literal["idle", "driving", "failed"]:
        """`idle` also at the end of a path."""
        ...

    def advance(self) -> None:
        """Let some time pass."""
        ...

    def follow(self, path: Path) -> None:
        """Follow a path instead of the one before."""
        ...

    def stop(self) -> None:
        """Stop as soon as possible."""
        ...

    def place(self, pose: Pose2D) -> None:
        """Take a pose for the own one."""
        ...

    def physical(self) -> dict[str, float]:
        """Return the `physicalParameters` of the factsheet: speeds (m/s), accelerations (m/s^2), sizes (m)."""
        ...


class NavigatorVehicle:
    """A robot with the whole stack as a vehicle: costmaps, local planner, recoveries."""

    def __init__(self, navigator: BasicNavigator, *, height_m: float = 0.0) -> None:
        """`height_m`: of the robot, for the factsheet; the stack has only its footprint."""
        self.navigator = navigator
        self.height_m = height_m
        self._followed = False

    @property
    def state(self) -> VehicleState:
        """Time, pose and velocity as the stack knows them."""
        move_base = self.navigator.move_base
        state = move_base.robot.state()
        return VehicleState(state.stamp, move_base.global_costmap.robot_pose(), state.velocity)

    @property
    def status(self) -> Literal["idle", "driving", "failed"]:
        """Whether the last path is being driven, or failed."""
        result = self.navigator.getResult()
        if result is TaskResult.FAILED:
            return "failed"
        return "idle" if result is not TaskResult.UNKNOWN or not self._followed else "driving"

    def advance(self) -> None:
        """Let one control cycle or more pass."""
        navigator = self.navigator
        if self.status == "driving":
            navigator.isTaskComplete()
        else:
            navigator.idle()

    def follow(self, path: Path) -> None:
        """Follow a path with the local planner."""
        self._followed = True
        self.navigator.followPath(path)

    def stop(self) -> None:
        """End the task."""
        self.navigator.cancelTask()

    def place(self, pose: Pose2D) -> None:
        """Initialize the localization."""
        self.navigator.setInitialPose(pose)

    def physical(self) -> dict[str, float]:
        """Return the limits of the local planner, and the size of the footprint."""
        move_base = self.navigator.move_base
        limits, corners = (
            limits_of(move_base.local_planner),
            move_base.global_costmap.footprint.at(Pose2D(0.0, 0.0, 0.0)),
        )
        length, width = np.ptp(corners, axis=0).tolist()
        return {
            "minimumSpeed": float(limits.min_vel_trans),
            "maximumSpeed": float(limits.max_vel_trans),
            "maximumAcceleration": float(limits.acc_lim_x),
            "maximumDeceleration": float(limits.acc_lim_x),
            "minimumHeight": self.height_m,
            "maximumHeight": self.height_m,
            "width": width,
            "length": length,
        }


class Vda5050Robot:
    """A robot driven by VDA 5050 messages: base and horizon, updates, actions, pause, cancel.

    robot = Vda5050Robot(NavigatorVehicle(navigator), "navstack", "robot_1", "office", publish=print)
    robot.receive("order", order)
    while not robot.idle:
        robot.step()
    """

    def __init__(
        self,
        vehicle: Vehicle,
        manufacturer: str,
        serial_number: str,
        map_id: str,
        *,
        publish: Callable[[str, dict[str, Any]], None] | None = None,
        actions: Mapping[str, Callable[[Action], str]] | None = None,
        state_interval_s: float = 1.0,
        started: datetime = datetime(2026, 1, 1, tzinfo=UTC),
    ) -> None:
        """`publish` gets the topic (`state`, `connection`, ..) and the message. `actions` are those of nodes and edges by type:
        functions that do it and return the result as text. `started` is the date of time 0.
        """
        self.vehicle = vehicle
        self.manufacturer, self.serial_number, self.map_id = manufacturer, serial_number, map_id
        self.order_id, self.order_update_id = "", 0
        self.nodes: list[Node] = []
        """Not passed yet, horizon included."""
        self.edges: list[Edge] = []
        self.last_node: tuple[str, int] = ("", 0)
        self.action_states: dict[str, ActionState] = {}
        self.instant_states: dict[str, ActionState] = {}
        self.errors: list[Error] = []
        self.paused = False
        self.battery, self.charging = 1.0, False
        """State of charge, 0 to 1."""
        self.publish = publish or _keep_silent
        self._actions = {**dict.fromkeys(("startCharging", "stopCharging"), self._charge), **(actions or {})}
        self._interval, self._started = state_interval_s, started
        self._headers: dict[str, int] = {}
        self._waiting: list[Action] = []
        """Actions of the node that the robot stands at."""
        self._base_end: tuple[str, int] = ("", 0)
        self._target: int | None = None
        """Sequence number of the node at the end of the path that the vehicle follows."""
        self._canceled = ""
        self._canceling: list[str] = []
        self._sent_at = -math.inf
        self._driving = False
        self._changed = True
        self._passed_at = vehicle.state.pose

    # --- messages in --------------------------------------------------------------------------------------------------

    def receive(self, topic: str, message: str | bytes | Mapping[str, Any]) -> None:
        """Take a message of the topic `order` or `instantActions`; what is wrong with it is an error of the state.

        Raises InputError for another topic.
        """
        if topic not in ("order", "instantActions"):
            raise InputError(
                f'a robot takes no messages of the topic "{topic}"; send "order" or "instantActions"', topic=topic
            )
        try:
            data = json.loads(message) if isinstance(message, (str, bytes)) else message
            if topic == "order":
                self._take(Order.model_validate(data))
            else:
                for action in InstantActions.model_validate(data).actions:
                    self._do_now(action)
        except (ValidationError, ValueError) as error:
            if isinstance(error, ValidationError):
                first = error.errors()[0]
                text = f"{'.'.join(map(str, first['loc'])) or 'message'}: {first['msg']}"
            else:
                text = f"the message is no JSON: {error}"
            self._refuse("VALIDATION_FAILURE", f"{topic}: {text}", {"topic": topic})
        self._changed = True

    def _refuse(self, kind: str, text: str, about: Mapping[str, object]) -> None:
        references = [ErrorReference(referenceKey=key, referenceValue=str(value)) for key, value in about.items()]
        self.errors.append(
            Error(errorType=kind, errorLevel="WARNING", errorDescription=text, errorReferences=references)
        )

    # --- orders -------------------------------------------------------------------------------------------------------

    @property
    def idle(self) -> bool:
        """True without an order, or when its last node has been reached and its actions are done."""
        return not self.nodes and not self._waiting and not self._canceling

    def _take(self, order: Order) -> None:
        """Accept an order or an update, or say why not (figure 8 of the standard)."""
        about = {"topic": "order", "orderId": order.orderId, "orderUpdateId": order.orderUpdateId}
        if wrong := self._wrong(order):
            self._refuse("INVALID_ORDER", wrong, about)
            return
        unknown = [
            a.actionType
            for part in (*order.nodes, *order.edges)
            for a in part.actions
            if a.actionType not in self._actions
        ]
        if unknown:
            known = ", ".join(sorted(self._actions))
            self._refuse("INVALID_ORDER_ACTION", f'the robot cannot do "{unknown[0]}"; it can do {known}', about)
            return
        first = order.nodes[0]
        if order.orderId == self.order_id:
            if order.orderId == self._canceled:
                self._refuse(
                    "ORDER_UPDATE_FOLLOWING_CANCEL", f"the order {order.orderId} was canceled; send a new one", about
                )
            elif order.orderUpdateId == self.order_update_id:
                self._refuse("SAME_ORDER_UPDATE_ID", f"update {order.orderUpdateId} is here already", about)
            elif order.orderUpdateId < self.order_update_id:
                have = self.order_update_id
                self._refuse("OUTDATED_ORDER_UPDATE", f"update {order.orderUpdateId} is older than {have}", about)
            elif (first.nodeId, first.sequenceId) != self._base_end:
                end = f"{self._base_end[0]} ({self._base_end[1]})"
                text = f"an update begins with the last node of the base, {end}, not with {first.nodeId} ({first.sequenceId})"
                self._refuse("INVALID_ORDER", text, about)
            else:
                self._stitch(order)
            return
        if not self.idle:
            self._refuse("INVALID_ORDER", f"the order {self.order_id} is not finished; cancel it, or update it", about)
            return
        place, pose = first.nodePosition, self.vehicle.state.pose
        if (first.nodeId, first.sequenceId) != self.last_node and place is not None:
            away = math.hypot(place.x - pose.x, place.y - pose.y)
            if away > max(_reach(first), NEAR_M):
                text = f"the robot is {away:.2f} m away from the first node, {first.nodeId}; begin where it stands"
                self._refuse("NODE_UNREACHABLE", text, about)
                return
        self.errors.clear()
        self.action_states.clear()
        self.order_id, self.order_update_id, self._canceled = order.orderId, order.orderUpdateId, ""
        self.nodes, self.edges = list(order.nodes), list(order.edges)
        self._target = None
        self._add_states(order)
        self._pass_node()

    def _wrong(self, order: Order) -> str:
        """Return what is wrong with the nodes and edges of an order."""
        if len(order.edges) != len(order.nodes) - 1:
            return f"{len(order.nodes)} nodes have {len(order.nodes) - 1} edges between them, not {len(order.edges)}"
        parts: list[Node | Edge] = [order.nodes[0]]
        for edge, node in zip(order.edges, order.nodes[1:], strict=True):
            parts += [edge, node]
        for k, part in enumerate(parts):
            if part.sequenceId != parts[0].sequenceId + k:
                return f"the sequence numbers go up by one, nodes even and edges odd; {part.sequenceId} is out of line"
            if part.released and not parts[max(k - 1, 0)].released:
                return f"what is released comes first; {part.sequenceId} is released after the horizon began"
        if parts[0].sequenceId % 2 or not parts[0].released:
            return "the first node has an even sequence number and is released"
        for node in order.nodes:
            if node.nodePosition is None:
                return f"node {node.nodeId} has no nodePosition, and the robot has no map of nodes; write it"
            if node.nodePosition.mapId != self.map_id:
                return f'node {node.nodeId} is on the map "{node.nodePosition.mapId}"; the robot is on "{self.map_id}"'
        return ""

    def _stitch(self, order: Order) -> None:
        """Replace the horizon by what an update brings."""
        begin = order.nodes[0].sequenceId
        self.errors.clear()
        for part in (*self.nodes, *self.edges):
            if part.sequenceId > begin:
                for action in part.actions:
                    self.action_states.pop(action.actionId, None)
        self.nodes = [node for node in self.nodes if node.sequenceId <= begin] + order.nodes[1:]
        self.edges = [edge for edge in self.edges if edge.sequenceId < begin] + order.edges
        self.order_update_id = order.orderUpdateId
        known = set(self.action_states)
        fresh = [action for action in order.nodes[0].actions if action.actionId not in known]
        if fresh and (self.nodes and self.nodes[0].sequenceId == begin):
            self.nodes[0].actions.extend(fresh)
        elif fresh:
            self._waiting += fresh
        self._add_states(order)

    def _add_states(self, order: Order) -> None:
        for part in (*order.nodes, *order.edges):
            for action in part.actions:
                state = ActionState(actionId=action.actionId, actionType=action.actionType, actionStatus="WAITING")
                self.action_states.setdefault(action.actionId, state)
        released = [node for node in order.nodes if node.released]
        self._base_end = (released[-1].nodeId, released[-1].sequenceId)

    # --- driving ------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Advance the vehicle, pass nodes, do actions, and publish the state if it changed or is due."""
        self.vehicle.advance()
        state = self.vehicle.state
        stands = abs(state.velocity.vx) + abs(state.velocity.vy) < STANDS and abs(state.velocity.wz) < STANDS
        if self._driving == stands:
            self._driving, self._changed = not stands, True
        if self._canceling and stands:
            for each in self._canceling:
                self.instant_states[each].actionStatus = "FINISHED"
            self._canceling, self._changed = [], True
        if not self.paused and not self._canceling:
            self._do_waiting(stands)
            if not self._waiting:
                self._drive(state)
        if self._changed or state.time - self._sent_at >= self._interval - 1e-9:
            self.send("state", self.state())
            self._changed, self._sent_at = False, state.time

    def _drive(self, state: VehicleState) -> None:
        """Pass the next node if it is reached, and follow the base to its end or to the next node with actions."""
        base = [node for node in self.nodes if node.released]
        if not base:
            return
        place = base[0].nodePosition
        assert place is not None
        last = base[0].sequenceId == self._target
        if math.hypot(place.x - state.pose.x, place.y - state.pose.y) <= _reach(base[0]) and (
            not last or self.vehicle.status == "idle"
        ):
            self._pass_node()
            return
        if self.vehicle.status == "failed" and self._target is not None:
            if not any(error.errorType == "NODE_UNREACHABLE" for error in self.errors):
                self._refuse(
                    "NODE_UNREACHABLE", f"the vehicle found no way to node {base[0].nodeId}", {"nodeId": base[0].nodeId}
                )
                self._changed = True
            return
        end = next((node for node in base if node.actions), base[-1])
        if self._target != end.sequenceId:
            self._target = end.sequenceId
            corners = [(state.pose.x, state.pose.y)]
            for node in base[: base.index(end) + 1]:
                assert node.nodePosition is not None
                corners.append((node.nodePosition.x, node.nodePosition.y))
            theta = None if end.nodePosition is None else end.nodePosition.theta
            self.vehicle.follow(_path(corners, theta, state.pose.yaw))
        elif self.vehicle.status == "idle":  # ended short of the node
            self._target = None

    def _pass_node(self) -> None:
        """Take the next node for passed, with the edge before it; its actions wait."""
        node = self.nodes.pop(0)
        self.edges = [edge for edge in self.edges if edge.sequenceId > node.sequenceId]
        self.last_node = (node.nodeId, node.sequenceId)
        self._waiting += node.actions
        for edge in self.edges[:1]:
            if edge.released:
                self._waiting += edge.actions
                edge.actions = []
        if self._target == node.sequenceId:
            self._target = None
        self._passed_at = self.vehicle.state.pose
        self._changed = True

    def _do_waiting(self, stands: bool) -> None:
        """Do the actions that are due, in their order; those that block driving once the robot stands."""
        while self._waiting and (stands or self._waiting[0].blockingType in ("NONE", "SINGLE")):
            action = self._waiting.pop(0)
            state = self.action_states[action.actionId]
            try:
                state.actionResult = self._actions[action.actionType](action) or None
                state.actionStatus = "FINISHED"
            except Exception as error:
                state.actionStatus, state.actionResult = "FAILED", f"{type(error).__name__}: {error}"
            self._changed = True

    def _charge(self, action: Action) -> str:
        self.charging = action.actionType == "startCharging"
        return ""

    # --- instant actions ----------------------------------------------------------------------------------------------

    def _do_now(self, action: Action) -> None:
        state = ActionState(actionId=action.actionId, actionType=action.actionType, actionStatus="RUNNING")
        self.instant_states[action.actionId] = state
        doing = getattr(self, f"_now_{action.actionType}", None)
        try:
            if doing is None:
                raise InputError(
                    f'the robot has no instant action "{action.actionType}"', error="INVALID_INSTANT_ACTION"
                )
            doing(action)
        except InputError as error:
            state.actionStatus, state.actionResult = "FAILED", error.message
            kind = str(error.data.get("error", "INVALID_INSTANT_ACTION"))
            self._refuse(kind, error.message, {"topic": "instantActions", "actionId": action.actionId})
            return
        if action.actionId not in self._canceling:
            state.actionStatus = "FINISHED"

    def _now_cancelOrder(self, action: Action) -> None:
        wanted = action.parameter("orderId", self.order_id)
        if self.idle or wanted != self.order_id:
            raise InputError(f'there is no order "{wanted}" to cancel', error="NO_ORDER_TO_CANCEL")
        self.vehicle.stop()
        for state in self.action_states.values():
            if state.actionStatus == "WAITING":
                state.actionStatus = "FAILED"
        self.nodes, self.edges, self._waiting, self._target = [], [], [], None
        self._canceled = self.order_id
        self._canceling.append(action.actionId)

    def _now_startPause(self, action: Action) -> None:
        del action
        self.vehicle.stop()
        self.paused, self._target = True, None

    def _now_stopPause(self, action: Action) -> None:
        del action
        self.paused = False

    def _now_stateRequest(self, action: Action) -> None:
        del action  # every change is published with the next step

    def _now_factsheetRequest(self, action: Action) -> None:
        del action
        self.send("factsheet", self.factsheet())

    def _now_startCharging(self, action: Action) -> None:
        self._charge(action)

    def _now_stopCharging(self, action: Action) -> None:
        self._charge(action)

    def _now_clearInstantActions(self, action: Action) -> None:
        ended = ("FINISHED", "FAILED")
        self.instant_states = {
            key: state
            for key, state in self.instant_states.items()
            if state.actionStatus not in ended or key == action.actionId
        }

    def _now_initializePosition(self, action: Action) -> None:
        values = [action.parameter(key) for key in ("x", "y", "theta")]
        if any(
            isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value)
            for value in values
        ):
            raise InputError("initializePosition needs x, y (m) and theta (rad) as numbers")
        if (wanted := action.parameter("mapId", self.map_id)) != self.map_id:
            raise InputError(f'the robot has no map "{wanted}"; it is on "{self.map_id}"', error="UNKNOWN_MAP_ID")
        if not self.idle:
            raise InputError("the robot drives an order; cancel it first")
        self.vehicle.place(Pose2D(*map(float, values)))
        self.last_node = (str(action.parameter("lastNodeId", "")), 0)

    # --- messages out -------------------------------------------------------------------------------------------------

    def send(self, topic: str, message: dict[str, Any]) -> None:
        """Publish a message with the next header of its topic."""
        number = self._headers.get(topic, 0)
        self._headers[topic] = number + 1
        self.publish(topic, {**self._header(number), **message})

    def _header(self, number: int) -> dict[str, Any]:
        moment = self._started + timedelta(seconds=self.vehicle.state.time)
        return {
            "headerId": number,
            "timestamp": moment.strftime("%Y-%m-%dT%H:%M:%S.") + f"{moment.microsecond // 1000:03d}Z",
            "version": VERSION,
            "manufacturer": self.manufacturer,
            "serialNumber": self.serial_number,
        }

    def connect(self, state: Literal["ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN"] = "ONLINE") -> None:
        """Publish the state of the connection."""
        self.send("connection", {"connectionState": state})

    def last_will(self) -> dict[str, Any]:
        """Return the message that the broker publishes if the robot is cut off."""
        return {**self._header(self._headers.get("connection", 0)), "connectionState": "CONNECTION_BROKEN"}

    def state(self) -> dict[str, Any]:
        """Return the state without the header."""
        state, base = self.vehicle.state, [node for node in self.nodes if node.released]
        pose, left, here = state.pose, 0.0, (state.pose.x, state.pose.y)
        for node in base:
            assert node.nodePosition is not None
            there = (node.nodePosition.x, node.nodePosition.y)
            left, here = left + math.dist(here, there), there
        return {
            "orderId": self.order_id,
            "orderUpdateId": self.order_update_id,
            "lastNodeId": self.last_node[0],
            "lastNodeSequenceId": self.last_node[1],
            "nodeStates": [node.model_dump(include=_NODE_STATE, exclude_none=True) for node in self.nodes],
            "edgeStates": [edge.model_dump(include=_EDGE_STATE) for edge in self.edges],
            "mobileRobotPosition": {
                "x": pose.x,
                "y": pose.y,
                "theta": pose.yaw,
                "mapId": self.map_id,
                "localized": state.localized,
            },
            "velocity": {"vx": state.velocity.vx, "vy": state.velocity.vy, "omega": state.velocity.wz},
            "driving": self._driving,
            "paused": self.paused,
            "newBaseRequest": len(base) < len(self.nodes) and left < REQUEST_M,
            "distanceSinceLastNode": pose.distance_to(self._passed_at),
            "actionStates": [each.model_dump(exclude_none=True) for each in self.action_states.values()],
            "instantActionStates": [each.model_dump(exclude_none=True) for each in self.instant_states.values()],
            "powerSupply": {"stateOfCharge": 100.0 * self.battery, "charging": self.charging},
            "operatingMode": "AUTOMATIC",
            "errors": [error.model_dump() for error in self.errors],
            "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": False},
        }

    def factsheet(self) -> dict[str, Any]:
        """Return the factsheet without the header: what the robot can do."""
        now = [name.removeprefix("_now_") for name in sorted(dir(self)) if name.startswith("_now_")]
        kinds = dict.fromkeys([*now, *sorted(self._actions)])
        scopes = {
            kind: [*(["INSTANT"] if kind in now else []), *(["NODE", "EDGE"] if kind in self._actions else [])]
            for kind in kinds
        }
        return {
            "typeSpecification": {
                "seriesName": "navstack",
                "mobileRobotKinematics": "DIFFERENTIAL",
                "mobileRobotClass": "CARRIER",
                "maximumLoadMass": 0.0,
                "localizationTypes": ["NATURAL"],
                "navigationTypes": ["AUTONOMOUS"],
            },
            "physicalParameters": self.vehicle.physical(),
            "protocolLimits": {
                "maximumStringLengths": {},
                "maximumArrayLengths": {},
                "timing": {"minimumOrderInterval": 0.0, "minimumStateInterval": self._interval},
            },
            "protocolFeatures": {
                "optionalParameters": [],
                "mobileRobotActions": [
                    {"actionType": kind, "actionScopes": scopes[kind], "pauseAllowed": False, "cancelAllowed": False}
                    for kind in kinds
                ],
            },
            "mobileRobotGeometry": {},
            "loadSpecification": {},
        }


def _keep_silent(topic: str, message: dict[str, Any]) -> None:
    """Publish nothing."""


def _reach(node: Node) -> float:
    place = node.nodePosition
    allowed = None if place is None else place.allowedDeviationXY
    return NEAR_M if allowed is None or min(allowed.a, allowed.b) == 0.0 else min(allowed.a, allowed.b)


def _path(corners: list[tuple[float, float]], theta: float | None, yaw: float) -> Path:
    """Return the path along straight lines between corners (m); it ends with `theta`, or with the direction of the last line."""
    pieces: list[Any] = []
    for a, b in pairwise(corners):
        count = max(1, math.ceil(math.dist(a, b) / DENSITY_M))
        yaw = math.atan2(b[1] - a[1], b[0] - a[0]) if math.dist(a, b) > 1e-6 else yaw
        share = np.arange(count)[:, None] / count
        pieces.append(np.column_stack([np.array(a) + (np.array(b) - np.array(a)) * share, np.full(count, yaw)]))
    pieces.append(np.array([[*corners[-1], yaw if theta is None else theta]]))
    return Path(np.concatenate(pieces), "map")
