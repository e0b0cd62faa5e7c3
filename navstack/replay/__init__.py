"""Replays logs through the stack, open loop, and exports runs as logs."""

from navstack.replay.from_record import is_of_log, replay_of_log
from navstack.replay.replay import LogReplay, ReplayOptions

__all__ = ["LogReplay", "ReplayOptions", "is_of_log", "replay_of_log"]
