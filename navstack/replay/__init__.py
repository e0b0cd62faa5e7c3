"""Replays logs through the stack, open loop, and exports runs as logs."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.replay.export import EPOCH_NS as EPOCH_NS
    from navstack.replay.export import export_run as export_run
    from navstack.replay.export import foxglove_layout as foxglove_layout
    from navstack.replay.log_replay import LogReplay as LogReplay
    from navstack.replay.log_replay import ReplayedGoal as ReplayedGoal
    from navstack.replay.log_replay import ReplayOptions as ReplayOptions
    from navstack.replay.log_replay import is_of_log as is_of_log
    from navstack.replay.log_replay import replay_of_log as replay_of_log
    from navstack.replay.moment import snapshot as snapshot
    from navstack.replay.player import empty_map as empty_map
    from navstack.replay.player import last_pose as last_pose
    from navstack.replay.player import logged_map as logged_map
    from navstack.replay.report import ReplayReport as ReplayReport
    from navstack.replay.topics import find_topics as find_topics
    from navstack.replay.topics import sensor_topics as sensor_topics
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
