"""Topics are found by choice, by their usual name, or because they are the only one of their type."""

from __future__ import annotations

import pytest

from navstack.core import LogError
from navstack.ros_messages import TopicFinder, topic_name
from navstack.ros_messages.messages import ODOMETRY, PATH, SCAN, TWIST, TWIST_STAMPED

ROBOT = {
    "/front": {SCAN},
    "/rear": {SCAN},
    "/wheels": {ODOMETRY},
    "/base_pose_ground_truth": {ODOMETRY},
    "/cmd_vel": {TWIST_STAMPED},
    "/tf": {"tf2_msgs/msg/TFMessage"},
}


def finder(**chosen: str) -> TopicFinder:
    return TopicFinder("run.bag", ROBOT, chosen)


def test_a_name_has_one_leading_slash() -> None:
    assert [topic_name(name) for name in ("scan", "/scan", "//a//scan/")] == ["/scan", "/scan", "/a/scan"]


def test_the_usual_name_wins_without_a_note() -> None:
    found = finder()
    assert found.find("cmd_vel", (TWIST, TWIST_STAMPED), ("/cmd_vel",)) == "/cmd_vel"
    assert found.find("scan", (SCAN,), ("/laser", "/rear", "/front")) == "/rear"
    assert found.notes == []


def test_the_only_topic_of_the_type_is_used_with_a_note_and_the_true_pose_never() -> None:
    found = finder()
    assert found.find("odom", (ODOMETRY,), ("/odom",)) == "/wheels"
    assert found.notes == ["the log has no /odom; its only Odometry /wheels is used for it"]


def test_what_is_in_doubt_or_missing_is_left_out_with_a_note_unless_it_is_needed() -> None:
    found = finder()
    assert found.find("scan", (SCAN,), ("/scan",)) == ""
    assert found.find("plan", (PATH,), ("/plan",), what="plans") == ""
    assert found.notes == [
        "the log has several topics of LaserScan: /front, /rear; name one with --topic scan=NAME",
        "the log has no plans (Path)",
    ]
    with pytest.raises(LogError, match=r"^run\.bag has several topics of LaserScan: /front, /rear; name one with"):
        found.find("scan", (SCAN,), ("/scan",), needed="so there is nothing to localize with")
    with pytest.raises(LogError, match=r"^run\.bag has no topic of Path, so there is no way$"):
        found.find("plan", (PATH,), ("/plan",), needed="so there is no way")


def test_a_choice_must_be_there_and_of_the_type() -> None:
    assert finder(scan="rear").find("/scan", (SCAN,), ("/front",)) == "/rear"
    assert finder(odom="/base_pose_ground_truth").find("odom", (ODOMETRY,), ("/odom",)) == "/base_pose_ground_truth"
    with pytest.raises(
        LogError, match=r"^run\.bag has no topic /wheels of LaserScan for scan; those it has: /front, /rear$"
    ):
        finder(scan="wheels").find("scan", (SCAN,), ("/front",))
    with pytest.raises(
        LogError, match=r"^run\.bag has no topic /side; its topics are /base_pose_ground_truth, /cmd_vel,"
    ):
        finder(anything="side").check_chosen()
    assert finder().transforms() == ("/tf",)
