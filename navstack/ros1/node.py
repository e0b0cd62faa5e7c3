"""What every node of ROS 1 has: its wait for a simulated clock, and its watch of the ROS master."""

from __future__ import annotations

import threading
import time
import xmlrpc.client
from collections.abc import Callable
from typing import Any, Final

from navstack.ros1 import ros


def wait_for_clock() -> bool:
    """Wait for the first message on `/clock` if time is simulated, with a warning every 5 s; return whether it is."""
    rospy = ros.rospy()
    if not rospy.get_param("/use_sim_time", False):
        return False
    warned = time.monotonic() - 4.0
    while rospy.Time.now().is_zero() and not ros.is_stopping():
        if time.monotonic() - warned > 5.0:
            warned = time.monotonic()
            rospy.logwarn("/use_sim_time is set: waiting for /clock")
        rospy.rostime.wallsleep(0.02)
    return True


# --- watches the ROS master: a node that outlives its master registers again at the next one --------------------------
# rospy registers once. After a restart of roscore the connections between nodes still work, but no other node finds it any more.


CHECK_S: Final = 1.0
"""Time between two checks (s, wall)."""


class MasterWatch:
    """A thread that asks the master for this node; it logs the loss and the return of the master once each."""

    def __init__(self, on_return: Callable[[], None] | None = None) -> None:
        """`on_return` is called in the thread after a registration at a new master, whose parameter server is empty."""
        self._rospy = ros.rospy()
        self._on_return = on_return
        self._name = str(self._rospy.get_name())
        self._uri = str(self._rospy.get_node_uri())
        self._master = xmlrpc.client.ServerProxy(ros.load("rosgraph").get_master_uri())
        self._is_lost = False
        self.registrations = 0
        """Number of registrations at a new master."""
        threading.Thread(target=self._run, name="master", daemon=True).start()

    def _run(self) -> None:
        while not ros.is_stopping():
            try:
                self.check()
            except (OSError, xmlrpc.client.Error) as exc:
                self._lose(exc)
            time.sleep(CHECK_S)

    def check(self) -> None:
        """Ask the master for this node, and register where it is unknown. Raises OSError without a master."""
        code, text, found = _answer(self._master.lookupNode(self._name, self._name))
        if code == 1 and found:
            # another node of this name: its registration has already asked this one to end
            self._is_lost = False
            return
        del text
        self._register()
        self.registrations += 1
        self._is_lost = False
        self._rospy.logwarn("the ROS master is a new one; this node is registered there now")
        if self._on_return is not None:
            self._on_return()

    def _lose(self, error: Exception) -> None:
        if not self._is_lost and not ros.is_stopping():
            self._is_lost = True
            self._rospy.logerr(
                "the ROS master does not answer (%s): connections that exist go on, new ones wait for it", error
            )

    def _register(self) -> None:
        """Register publishers, subscribers and services, and connect the subscribers to the publishers that are known."""
        own: Any = xmlrpc.client.ServerProxy(self._uri)
        master = self._master
        for topic, kind in _answer(own.getPublications(self._name))[2]:
            master.registerPublisher(self._name, topic, kind, self._uri)
        for topic, kind in _answer(own.getSubscriptions(self._name))[2]:
            publishers = _answer(master.registerSubscriber(self._name, topic, kind, self._uri))[2]
            own.publisherUpdate("/master", topic, publishers)
        for service, uri in ros.load("rospy.impl.registration").get_service_manager().get_services():
            master.registerService(self._name, service, uri, self._uri)


def _answer(value: Any) -> tuple[int, str, Any]:
    code, text, data = value
    return int(code), str(text), data
