"""What a tree acts on: action servers, services, and the robot. A goal manager supplies it; tests supply a mock."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Protocol

from navstack.behavior_trees.blackboard import StampedPose
from navstack.core import Twist2D


class ActionState(Enum):
    """State of a goal that an action server works on."""

    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    CANCELED = "canceled"


class ActionTicket:
    """A goal of an action server; the server changes it while it works."""

    __slots__ = ("code", "feedback", "message", "result", "state")

    def __init__(self) -> None:
        self.state = ActionState.ACTIVE
        self.code = 0
        """Nav2's error code once ABORTED."""
        self.message = ""
        self.result: Mapping[str, object] = {}
        """Values by the names of Nav2's result: `path`."""
        self.feedback: Mapping[str, object] = {}
        """Values by the names of Nav2's feedback: `tracking_feedback`."""

    def end(self, state: ActionState, code: int = 0, message: str = "", **result: object) -> ActionTicket:
        """End the goal; return the ticket."""
        self.state, self.code, self.message, self.result = state, code, message, result
        return self


class Servers(Protocol):
    """The robot and its servers, as the nodes of a tree see them. No call waits."""

    def send(self, server: str, goal: Mapping[str, object]) -> ActionTicket | None:
        """Start a goal on an action server (`follow_path`), which replaces its current one; None if it is rejected."""
        ...

    def poll(self, ticket: ActionTicket) -> ActionState:
        """Return the state of a goal."""
        ...

    def cancel(self, ticket: ActionTicket) -> None:
        """Cancel a goal."""
        ...

    def cancel_all(self, server: str) -> bool:
        """Cancel every goal of a server; False if there is no such server."""
        ...

    def call(self, service: str, kind: str, request: Mapping[str, object]) -> Mapping[str, object] | None:
        """Call a service of a `kind` (`ClearEntireCostmap`); None if there is no such service. `success` tells the result."""
        ...

    def recovers(self) -> None:
        """Note that the next goal or call is a recovery, as the entry `number_recoveries` counts them."""
        ...

    def robot_pose(self, frame: str, base_frame: str) -> StampedPose | None:
        """Return the robot's pose in `frame` (empty: the global one); None if it is not known."""
        ...

    def velocity(self) -> Twist2D:
        """Return the velocity of the last odometry."""
        ...

    def smoothed_velocity(self) -> Twist2D:
        """Return the velocity of the odometry, smoothed."""
        ...

    def can_transform(self, child: str, parent: str) -> bool:
        """Return True if the transform between two frames is known."""
        ...

    def parameter(self, name: str, default: float) -> float:
        """Return a parameter of bt_navigator, such as `goal_reached_tol`."""
        ...


class NoServers:
    """A robot that stands at the origin and has no server: every goal is rejected."""

    def send(self, server: str, goal: Mapping[str, object]) -> ActionTicket | None:
        """Reject the goal."""
        del server, goal

    def poll(self, ticket: ActionTicket) -> ActionState:
        """Return the state of the ticket."""
        return ticket.state

    def cancel(self, ticket: ActionTicket) -> None:
        """Cancel the goal."""
        ticket.end(ActionState.CANCELED)

    def cancel_all(self, server: str) -> bool:
        """Return False: there is no server."""
        del server
        return False

    def call(self, service: str, kind: str, request: Mapping[str, object]) -> Mapping[str, object] | None:
        """Return None: there is no service."""
        del service, kind, request

    def recovers(self) -> None:
        """Do nothing."""

    def robot_pose(self, frame: str, base_frame: str) -> StampedPose | None:
        """Return the origin."""
        del base_frame
        return StampedPose(0.0, 0.0, 0.0, frame or "map")

    def velocity(self) -> Twist2D:
        """Return rest."""
        return Twist2D()

    def smoothed_velocity(self) -> Twist2D:
        """Return rest."""
        return Twist2D()

    def can_transform(self, child: str, parent: str) -> bool:
        """Return False."""
        del child, parent
        return False

    def parameter(self, name: str, default: float) -> float:
        """Return the default."""
        del name
        return default
