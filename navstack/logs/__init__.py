"""Recorded logs: ROS 1 bags, ROS 2 bags (sqlite3 or MCAP) and MCAP files, read message by message with bounded memory.

    import navstack as nav

    with nav.logs.open("run.bag") as log:
        for message in log.messages(["/scan", "/odom"]):
            print(message.time, message.topic, message.data.header.frame_id)

The messages are the types of the library rosbags (extra `bags`); MCAP files need the extra `mcap`. No ROS installation is
used. `Log` describes what every format offers.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.logs.carmen import read_lines as read_lines
    from navstack.logs.carmen import read_relations as read_relations
    from navstack.logs.contents import CLOCKS_DIFFER_S as CLOCKS_DIFFER_S
    from navstack.logs.contents import LOOK_AHEAD_S as LOOK_AHEAD_S
    from navstack.logs.contents import LogInfo as LogInfo
    from navstack.logs.contents import TopicInfo as TopicInfo
    from navstack.logs.contents import first_odometry as first_odometry
    from navstack.logs.contents import first_parents as first_parents
    from navstack.logs.contents import log_info as log_info
    from navstack.logs.formats import open_log as open  # pyright: ignore[reportUnusedImport]
    from navstack.logs.formats import open_log as open_log
    from navstack.logs.log import Channel as Channel
    from navstack.logs.log import Log as Log
    from navstack.logs.log import LogMessage as LogMessage
    from navstack.logs.mapping import GrowingMap as GrowingMap
    from navstack.logs.mapping import MappingModel as MappingModel
    from navstack.logs.mapping import cell_changes as cell_changes
    from navstack.logs.mapping import map_from_frames as map_from_frames
    from navstack.logs.scan_log import RunScanLog as RunScanLog
    from navstack.logs.scan_log import ScanLog as ScanLog
    from navstack.logs.scan_log import ScanLogOptions as ScanLogOptions
    from navstack.logs.scan_log import logged_scans as logged_scans
    from navstack.logs.scan_log_formats import open_scan_log as open_scan_log
    from navstack.logs.writer import LogWriter as LogWriter
    from navstack.logs.writer import open_writer as open_writer
    from navstack.logs.writer import typestore as typestore
    from navstack.ros_messages import topic_name as topic_name
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
