"""The life cycle of a node: what lifecycle_manager and clients of Nav2 ask for."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable
from typing import Any, Final

from navstack.ros2 import ros
from navstack.ros2.ros import RosNode
from navstack.ros_node import Inbox

ACTIVE: Final = (3, "active")
"""Number and label of lifecycle_msgs/State."""
BOND: Final = "bond/msg/Status"
HEARTBEAT_S: Final = 0.1
"""Time between two heartbeats (s, wall), as of Nav2's nodes."""
HEARTBEAT_TIMEOUT_S: Final = 4.0
CONNECT_S: Final = 10.0
"""Time (s, wall) after which a bond without a manager ends, as in bondcpp."""


def offer_state(node: RosNode, inbox: Inbox, name: str, state: Callable[[], tuple[int, str]] = lambda: ACTIVE) -> None:
    """Offer `<name>/get_state` for a part of Nav2 that this node stands in for."""

    def answer(request: Any, response: Any) -> None:
        del request
        response.current_state.id, response.current_state.label = state()

    node.serve(f"{name}/get_state", "lifecycle_msgs/srv/GetState", inbox, answer)


COMMANDS: Final[dict[int, tuple[str, ...]]] = {
    0: ("configure", "activate"),
    1: ("deactivate",),
    2: ("activate",),
    3: ("deactivate", "cleanup"),
    4: ("deactivate", "cleanup", "shutdown"),
    5: ("configure",),
    6: ("cleanup",),
}
"""Transitions of each command of nav2_msgs/ManageLifecycleNodes: startup, pause, resume, reset, shutdown, configure, cleanup."""


def offer_manager(
    node: RosNode, name: str, is_active: Callable[[], bool], change: Callable[[str], bool] = lambda transition: True
) -> None:
    """Offer the services of a lifecycle_manager for this node, which clients and RViz's panel of Nav2 use.

    `change` takes a transition of the life cycle, in the thread of rclpy, and returns True if it was possible.
    """

    def on_active(request: Any, response: Any) -> Any:
        del request
        response.success = is_active()
        return response

    def on_command(request: Any, response: Any) -> Any:
        wanted = COMMANDS.get(int(request.command), ())
        response.success = bool(wanted) and all(change(transition) for transition in wanted)
        return response

    node.serve_here(f"{name}/is_active", "std_srvs/srv/Trigger", on_active)
    if ros.has_message("nav2_msgs/srv/ManageLifecycleNodes"):
        node.serve_here(f"{name}/manage_nodes", "nav2_msgs/srv/ManageLifecycleNodes", on_command)


def managed_node(change: Callable[[str], None]) -> Callable[..., Any]:
    """Return what makes a node with rclpy's life cycle; `change` gets each transition in the thread of rclpy."""
    base = ros.load("rclpy.lifecycle").LifecycleNode
    outcome = ros.load("rclpy.lifecycle").TransitionCallbackReturn

    class Managed(base):  # type: ignore[misc,valid-type]
        def _apply(self, name: str) -> Any:
            change(name)
            return outcome.SUCCESS

        def on_configure(self, state: Any) -> Any:
            super().on_configure(state)
            return self._apply("configure")

        def on_activate(self, state: Any) -> Any:
            super().on_activate(state)
            return self._apply("activate")

        def on_deactivate(self, state: Any) -> Any:
            super().on_deactivate(state)
            return self._apply("deactivate")

        def on_cleanup(self, state: Any) -> Any:
            super().on_cleanup(state)
            return self._apply("cleanup")

        def on_shutdown(self, state: Any) -> Any:
            super().on_shutdown(state)
            return self._apply("shutdown")

    return Managed


class Bond:
    """Tells lifecycle_manager that the active node lives: heartbeats on `bond` under the name of the node, as of Nav2's nodes.

    A manager whose `bond_timeout` is not 0 expects them, and stops all of its nodes when they end. The side that ends the bond
    says so, and the other side answers. Used in the thread of rclpy. Source: bondcpp (bond.cpp, BondSM.sm).
    """

    def __init__(self, node: RosNode) -> None:
        self._build, self._id = node.build, str(node.handle.get_name())
        self._instance = ""
        """Identifies this bond, as another one than that of the manager; empty without one."""
        self._has_manager, self._began = False, 0.0
        self._out = node.publisher("bond", BOND, depth=5)
        node.subscribe("bond", BOND, self._receive, depth=100)
        clock = ros.load("rclpy.clock")
        steady = clock.Clock(clock_type=clock.ClockType.STEADY_TIME)
        self._timer = node.create(lambda: node.handle.create_timer(HEARTBEAT_S, self._beat, clock=steady))
        self._timer.cancel()

    def begin(self) -> None:
        """Form a bond."""
        if not self._instance:
            self._instance, self._has_manager, self._began = str(uuid.uuid4()), False, time.monotonic()
            self._timer.reset()

    def end(self) -> None:
        """End the bond: the manager hears that this is no failure."""
        if self._instance:
            self._publish(active=False)
            self._instance = ""
            self._timer.cancel()

    def _beat(self) -> None:
        if self._has_manager or time.monotonic() - self._began < CONNECT_S:
            self._publish(active=True)
        else:
            self.end()

    def _receive(self, message: Any) -> None:
        if not self._instance or message.id != self._id or message.instance_id == self._instance:
            return
        self._has_manager = True
        if not message.active:
            self.end()

    def _publish(self, *, active: bool) -> None:
        self._out.publish(
            self._build.of(
                BOND,
                header=self._build.header(time.monotonic_ns(), ""),
                id=self._id,
                instance_id=self._instance,
                active=active,
                heartbeat_timeout=HEARTBEAT_TIMEOUT_S,
                heartbeat_period=HEARTBEAT_S,
            )
        )
