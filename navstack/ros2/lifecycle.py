"""The life cycle of a node: what lifecycle_manager and clients of Nav2 ask for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from navstack.ros2 import ros
from navstack.ros2.ros import RosNode
from navstack.ros_node import Inbox

ACTIVE: Final = (3, "active")
"""Number and label of lifecycle_msgs/State."""


def offer_state(node: RosNode, inbox: Inbox, name: str, state: Callable[[], tuple[int, str]] = lambda: ACTIVE) -> None:
    """Offer `<name>/get_state` for a part of Nav2 that this node stands in for."""

    def answer(request: Any, response: Any) -> None:
        del request
        response.current_state.id, response.current_state.label = state()

    node.serve(f"{name}/get_state", "lifecycle_msgs/srv/GetState", inbox, answer)


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
