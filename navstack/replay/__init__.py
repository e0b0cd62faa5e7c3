"""Replays logs through the stack, open loop, and exports runs as logs."""
