"""Drives: odometry, scans and reference poses of a robot from files of several formats, as one stream of typed messages.

`navstack.logs` reads the messages of ROS by topic; a drive is what localization and mapping need of a log.
"""

from navstack.drives.messages import (
    Drive,
    DriveFrame,
    DriveMessage,
    DriveOptions,
    Odometry,
    Reference,
    Scan,
    drive_frames,
)
from navstack.drives.open import open_drive

__all__ = [
    "Drive",
    "DriveFrame",
    "DriveMessage",
    "DriveOptions",
    "Odometry",
    "Reference",
    "Scan",
    "drive_frames",
    "open_drive",
]
