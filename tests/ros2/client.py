"""Helpers of the scripts that `Graph.ask` runs as a client of rclpy; a file of their own, not a module of the tests."""

import json
import pathlib
import sys
import time

import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

rclpy.init()
node = Node("client", parameter_overrides=[Parameter("use_sim_time", value=True)])
found = {}
END_S = 240.0


def spin(until, what, timeout_s=END_S):
    """Process messages until a condition is true."""
    end = time.monotonic() + timeout_s
    while not until():
        assert time.monotonic() < end, f"{what} did not happen"
        rclpy.spin_once(node, timeout_sec=0.1)


def wait(future, what, timeout_s=END_S):
    """Return the result of a future."""
    spin(future.done, what, timeout_s)
    return future.result()


def qos(depth=1, latched=False, reliable=True):
    """Return a quality of service."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def first(kind, topic, **quality):
    """Return the first message of a topic."""
    got = []
    subscription = node.create_subscription(kind, topic, got.append, qos(**quality))
    spin(lambda: got, f"a message on {topic}")
    node.destroy_subscription(subscription)
    return got[0]


def call(kind, name, request):
    """Call a service."""
    client = node.create_client(kind, name)
    spin(client.service_is_ready, f"the service {name}")
    return wait(client.call_async(request), name)


class Action:
    """A client of one action."""

    def __init__(self, kind, name):
        self.kind, self.name = kind, name
        self.client = ActionClient(node, kind, name)
        spin(self.client.server_is_ready, f"the action {name}")
        self.feedback = []

    def send(self, goal):
        """Send a goal; return its handle."""
        self.feedback.clear()
        return wait(
            self.client.send_goal_async(goal, feedback_callback=lambda m: self.feedback.append(m.feedback)), self.name
        )

    def end(self, handle):
        """Return status and result of a goal."""
        answer = wait(handle.get_result_async(), f"the result of {self.name}")
        return answer.status, answer.result

    def run(self, goal):
        """Send a goal and return status, code and text of its end."""
        handle = self.send(goal)
        if not handle.accepted:
            return ["rejected"]
        status, result = self.end(handle)
        return [status, getattr(result, "error_code", 0), getattr(result, "error_msg", "")]


def stamped(x, y, yaw=0.0, frame="map"):
    """Return a PoseStamped."""
    import math

    from geometry_msgs.msg import PoseStamped

    pose = PoseStamped()
    pose.header.frame_id = frame
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    return pose


def robot():
    """Return the true pose of the simulated robot."""
    from nav_msgs.msg import Odometry

    at = first(Odometry, "base_pose_ground_truth", depth=10).pose.pose.position
    return at.x, at.y


def finish(found):
    """Write what was found."""
    pathlib.Path(sys.argv[1]).write_text(json.dumps(found))
    rclpy.try_shutdown()
