"""Recorded logs: ROS 1 bags, ROS 2 bags (sqlite3 or MCAP) and MCAP files, read message by message with bounded memory.

    import navstack as nav

    with nav.logs.open("run.bag") as log:
        for message in log.messages(["/scan", "/odom"]):
            print(message.time, message.topic, message.data.header.frame_id)

The messages are the types of the library rosbags (extra `bags`); MCAP files need the extra `mcap`. No ROS installation is
used. `Log` describes what every format offers.
"""

from __future__ import annotations

from navstack.logs.log import Channel, Log, LogMessage, topic_name
from navstack.logs.open_log import open_log
from navstack.logs.open_log import open_log as open

__all__ = ["Channel", "Log", "LogMessage", "open", "open_log", "topic_name"]
