"""What a log has of what navigation needs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from navstack.logs.contents import _Collector, _needs  # pyright: ignore[reportPrivateUsage]

POSE = "geometry_msgs/msg/PoseStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
MAP = "nav_msgs/msg/OccupancyGrid"
TWIST = "geometry_msgs/msg/Twist"


def needs_of(**topics: str) -> dict[str, tuple[bool, str]]:
    """What the needs of a log with these topics (with `__` for `/`) of these types say."""
    types = {"/" + name.replace("__", "/"): kind for name, kind in topics.items()}
    log: Any = SimpleNamespace(topics_of=lambda *kinds: [t for t, kind in types.items() if kind in kinds])
    info: Any = SimpleNamespace(topics=[], transforms=[])
    return {need.what: (need.found, need.text) for need in _needs(log, info)}


@pytest.mark.parametrize("topic", ["goal_pose", "robot_1__goal_pose", "move_base_simple__goal"])
def test_goals_are_poses_on_the_topics_of_rviz(topic: str) -> None:
    named = "/" + topic.replace("__", "/")
    assert needs_of(**{topic: POSE, "object_pose": POSE})["goals"] == (True, named)
    assert needs_of(object_pose=POSE)["goals"] == (False, "give them with --goal")


def test_topics_that_look_alike_do_not_count() -> None:
    """The truth of a simulator is no odometry, a costmap is no map, and not every twist is a command."""
    found = needs_of(base_pose_ground_truth=ODOMETRY, local_costmap__costmap=MAP, imu__twist=TWIST)
    assert not any(found[what][0] for what in ("odometry", "map", "velocity commands"))
    found = needs_of(odom=ODOMETRY, map=MAP, cmd_vel_mux__cmd_vel=TWIST)
    assert [found[what] for what in ("odometry", "map", "velocity commands")] == [
        (True, "/odom"),
        (True, "/map"),
        (True, "/cmd_vel_mux/cmd_vel"),
    ]


def test_a_transform_is_static_if_no_message_of_tf_has_it() -> None:
    """Some robots send a frame both latched and every cycle."""
    collector: Any = _Collector(SimpleNamespace(channels=(), start_ns=0))  # pyright: ignore[reportArgumentType]

    def add(topic: str, child: str) -> None:
        stamp = SimpleNamespace(sec=1, nanosec=0)
        edge = SimpleNamespace(header=SimpleNamespace(frame_id="base_link", stamp=stamp), child_frame_id=child)
        collector._add_transforms(SimpleNamespace(topic=topic, data=SimpleNamespace(transforms=[edge])))

    for topic, child in (("/tf_static", "laser"), ("/tf", "wheel"), ("/tf_static", "both"), ("/tf", "both")):
        add(topic, child)
    add("/tf_static", "wheel")
    assert {child: edge.is_static for child, edge in collector._edges.items()} == {
        "laser": True,
        "wheel": False,
        "both": False,
    }
