"""A middleware that is too busy for messages, and another node of the same name: a warning, and the node goes on."""

from __future__ import annotations

from pathlib import Path

from tests.ros2.conftest import Graph

BUSY = """
from types import SimpleNamespace
from navstack.ros2 import Navigator, ros
from navstack.ros2.ros import RosNode
from std_msgs.msg import Empty

rclpy.try_shutdown()
refused = ros.load("rclpy.impl.implementation_singleton").rclpy_implementation.RCLError
own = RosNode("busy", [])
node = own.handle
lines, tries = [], []
own.log.logwarn = lambda text, *values: lines.append(text % values)

class Refusing:
    topic_name = "/topic"

    def __init__(self, refusals):
        self.refusals = refusals

    def publish(self, message):
        tries.append(self.refusals)
        self.refusals -= 1
        if self.refusals >= 0:
            raise refused("cannot publish data")

for important, refusals in ((False, 1), (True, 2), (True, 3), (False, 5)):
    publisher = own.publisher("topic", "std_msgs/msg/Empty", important=important)
    publisher._publisher = Refusing(refusals)
    tries.clear()
    publisher.publish(Empty())
    found[f"{important} {refusals}"] = [len(tries), len(lines)]
found["line"] = lines[0]
own.sender.send("other", lambda: Refusing(1).publish(None))
found["lines"] = len(lines)
navigator = SimpleNamespace(node=own)
Navigator._warn_of_namesake(navigator)
found["alone"] = len(lines)
other = rclpy.create_node("busy")
spin(lambda: node.get_node_names().count("busy") > 1, "the other node")
Navigator._warn_of_namesake(navigator)
found["namesake"] = lines[-1]
other.destroy_node()
own.shut_down(lambda: None)
publisher.publish(Empty())
found["after the end"] = len(tries)
"""


def test_a_message_that_the_middleware_refuses(tmp_path: Path) -> None:
    graph = Graph(tmp_path)
    try:
        found = graph.ask(BUSY)
    finally:
        graph.close()
    assert found["False 1"] == [1, 1] and found["True 2"] == [3, 1]  # the third try went through
    assert found["True 3"] == [3, 1] and found["False 5"] == [1, 1]  # one warning in 5 s
    assert found["line"] == "a message on /topic was dropped: cannot publish data; the machine is too busy"
    assert found["alone"] == 2 and found["namesake"].startswith("another node is called /busy, or was killed")
    assert found["lines"] == 2 and found["after the end"] == 2
